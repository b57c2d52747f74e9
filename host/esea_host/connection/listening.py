"""Ask a board for streams by name and rate, and listen to them."""

from __future__ import annotations

from collections.abc import Iterable

from esea_gen.errors import UserError
from esea_host.connection.device import ConnectedDevice
from esea_host.connection.identity import column_texts
from esea_host.connection.named import named_streams


def listen_named(
    device: ConnectedDevice, signals: Iterable[str], rate_Hz: float = 0.0, name: str = "chosen"
) -> list[str]:
    """Have a board send some values of its tasks, and make rows of them."""
    try:
        with device._lock:
            made = device.session.stream(signals, rate_Hz)
    except ValueError as error:
        raise UserError(f"{error}.", "Name signals of one task, such as sense.tau_Nm.") from None
    found = named_streams(made, name, *column_texts(device.identity.device))
    number = device.session.dialect.MAVLINK_MSG_ID_ESEA_DATA
    for stream in found:
        device.receiver.add_named(stream, number)
    return [s.layout.name for s in found]
