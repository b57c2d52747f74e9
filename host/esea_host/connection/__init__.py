"""A board at the other end: found, checked, listened to without a pause, commanded."""

from esea_host.connection.device import AsyncDevice, ConnectedDevice, Sample, connect, open_device
from esea_host.connection.receiver import Batch, Receiver, Subscription

__all__ = [
    "AsyncDevice",
    "Batch",
    "ConnectedDevice",
    "Receiver",
    "Sample",
    "Subscription",
    "connect",
    "open_device",
]
