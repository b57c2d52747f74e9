"""Records of the board's black box (``firmware/app/blackbox.h``): size and contents."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from esea_gen.device import Device
from esea_gen.emit.roles import board_roles
from esea_gen.emit.states import STATES

_PACKED = ("mode", "stop", "rearm")


@dataclass(frozen=True)
class BlackboxRecord:
    """A tick as the board lived it."""

    tick: int
    state: str
    fault: int
    on: bool
    stop_held: bool
    u_Nm: dict[str, float]
    limits: dict[str, int]
    wanted: dict[str, float | tuple[float, ...]]
    measured: dict[str, float]


def _desired(device: Device) -> list[tuple[str, int, str]]:
    # Name, elements and format of each.
    roles = board_roles(device.system)
    found = [(x.name, x.port.size, "I" if x.port.whole else "f") for x in roles.wanted]
    return [x for x in found if x[0] not in _PACKED] if roles.drive else [*found, ("mode", 1, "I")]


def _head(device: Device) -> struct.Struct:
    axes = max(1, len(board_roles(device.system).axes))
    return struct.Struct(f"<IHHBBB{1 + (axes + 2) // 4 * 4}s{axes}f")


def record_bytes(device: Device) -> int:
    """Size of a record."""
    words = sum(size for _, size, _ in _desired(device)) + len(board_roles(device.system).measured)
    return _head(device).size + 4 * words


def read_record(device: Device, data: bytes) -> BlackboxRecord:
    """A record out of its bytes."""
    head, roles = _head(device), board_roles(device.system)
    _, _, tick, state, fault, flags, faults, *u_Nm = head.unpack_from(data)
    layout = "".join(form * size for _, size, form in _desired(device))
    values = struct.unpack_from(f"<{layout}{len(roles.measured)}f", data, head.size)
    wanted: dict[str, float | tuple[float, ...]] = {}
    if roles.drive:
        packed = (flags & 3, flags >> 2 & 1, flags >> 3 & 7)
        wanted = {n: float(v) for n, v in zip(_PACKED, packed, strict=True)}
    at = 0
    for name, size, _ in _desired(device):
        wanted[name] = values[at] if size == 1 else values[at : at + size]
        at += size
    names = [x.name for x in roles.measured]
    return BlackboxRecord(
        tick,
        {s.value: s.name for s in STATES}.get(state, f"unknown {state}"),
        fault,
        bool(flags & 0x40),
        bool(flags & 0x80),
        {a.u: u for a, u in zip(roles.axes, u_Nm, strict=False)},
        {a.fault: n for a, n in zip(roles.axes, faults, strict=False)},
        wanted,
        dict(zip(names, values[at:], strict=True)),
    )


def blackbox_csv(records: Sequence[BlackboxRecord], simulated: bool = False) -> str:
    """A table of records: a tick a line; whether simulated in every one."""
    lines: list[str] = []
    for r in records:
        values: dict[str, object] = {
            "tick": r.tick,
            "state": r.state,
            "fault": r.fault,
            "on": int(r.on),
            "stop_held": int(r.stop_held),
        }
        values |= r.u_Nm | {f"limits_{n}": fault for n, fault in r.limits.items()}
        for name, value in r.wanted.items():
            parts = value if isinstance(value, tuple) else (value,)
            names = [f"{name}[{i}]" for i in range(len(parts))] if len(parts) > 1 else [name]
            values |= dict(zip(names, parts, strict=True))
        values |= r.measured | ({"simulated": 1} if simulated else {})
        if not lines:
            lines.append(",".join(values))
        lines.append(",".join(str(v) for v in values.values()))
    return "\n".join(lines) + "\n"
