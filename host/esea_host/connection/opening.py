"""Open a connection to a board, with its warnings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from esea_gen.device import Device
from esea_gen.devices.fatigue import life_used
from esea_gen.devices.file import DeviceData, shipped_devices
from esea_gen.emit.dialect import load_dialect
from esea_gen.errors import UserError
from esea_gen.link.kept import CouplingLife, coupling_lives
from esea_host.connection.address import SimulatedProcess, open_transport, parse_address
from esea_host.connection.device import ConnectedDevice
from esea_host.connection.identity import ANYBODY, identify, passive
from esea_host.recording.replay import loaded_device


def open_device(
    address: str, device: str | None = None, key: Path | None = None
) -> ConnectedDevice:
    """Connect to a board, waiting until it has answered."""
    place = parse_address(address)
    if place.kind == "sim" and device is None:
        device = place.place.partition("?")[0]
    if place.kind != "file":  # first: a board gives up a host that says nothing for a second
        load_dialect(loaded_device(device or ANYBODY))
    transport = open_transport(place)
    try:
        identity = passive(device) if place.kind == "file" else identify(transport, device, key)
        connected = ConnectedDevice(identity, transport, place)
    except BaseException:
        transport.close()
        raise
    try:
        connected.texts.extend(warn_of_life(connected))
    except BaseException:
        connected.close()
        raise
    return connected


def require_device(device: Device, fits: Callable[[Device], bool], lacks: str) -> None:
    """Refuse a device that a command cannot use; the error names the shipped ones that it can.

    lacks: what is missing, as ``has no motor``.
    """
    if not fits(device):
        names = [n for n in sorted(shipped_devices()) if fits(loaded_device(n))]
        raise UserError(f"{device.name} {lacks}.", f"This needs {' or '.join(names)}.")


def hands_at(device: ConnectedDevice) -> Callable[..., None]:
    """Hands at the virtual machine of a simulated board in a process of its own, if it is one.

    Called with a word and numbers; see :class:`esea_host.simulated.server.Hands`.
    """

    def act(word: str, *numbers: float) -> None:
        process = device.receiver.transport
        if isinstance(process, SimulatedProcess):  # another one while it is opened again
            process.hand(word, *numbers)

    return act


def life_told(device: DeviceData, life: CouplingLife) -> tuple[str, bool]:
    """How much of a coupling's life is used, in words; and whether that is enough to warn."""
    curve = device.file.fatigue
    if curve is None:
        return "life used: not known (the device file has no [fatigue])", False
    used = life_used(curve, life.halves, life.width_rad)
    text = (
        f"life used: {100 * used.most:.3g} % ({100 * used.least:.3g} with the least range of each "
        f"class; curve {curve.cycles.status}: {curve.cycles.source})"
    )
    return text, used.most >= curve.warn_share.value


def warn_of_life(connected: ConnectedDevice) -> list[str]:
    """A sentence for each fitted coupling of whose life the stated share is used."""
    device = connected.identity.device
    if device.file.fatigue is None or connected.address is None or connected.address.kind == "file":
        return []
    found = []
    for life in coupling_lives(connected.session):
        text, warns = life_told(device, life)
        if warns and life.axis is not None:
            found.append(f"WARNING, coupling {life.serial or 'without a number'}: {text}")
    return found
