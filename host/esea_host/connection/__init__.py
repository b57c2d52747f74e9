"""Connection to a board: identify, check, receive, command."""

from esea_host.connection.device import ConnectedDevice, RunSample
from esea_host.connection.opening import hands_at, life_told, open_device
from esea_host.connection.played import PlayedBoard
from esea_host.connection.receiver import Batch, Receiver, Subscription

__all__ = [
    "Batch",
    "ConnectedDevice",
    "PlayedBoard",
    "Receiver",
    "RunSample",
    "Subscription",
    "hands_at",
    "life_told",
    "open_device",
]
