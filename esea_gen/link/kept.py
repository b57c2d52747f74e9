"""Values that a board stores: parameters, zeros, use counters, couplings, black box."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from esea_gen.link.parameters import find_parameter
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError

COUNTERS = ("starts", "armings", "faults", "watchdog_resets", "saves", "active_s")
_ZEROS = ("none", "taken", "put back")
_ROOM = 4  # encoders in a message
_RELEASE = _FORGET = 255
_SUM = "kept: "  # begins the last of the texts on kept values
_VALUE = re.compile(r"kept (\S+) (\S+): (clipped|out of bounds|conflicting|unknown)")


@dataclass(frozen=True)
class KeptUse:
    """Stored values other than parameters."""

    encoders: tuple[tuple[int, float | None], ...]  # serial (0: unnamed), kept zero in rad
    zero: str  # where the zero in force comes from: none, taken since power-on, put back
    counters: dict[str, int]  # by the names in :data:`COUNTERS`


@dataclass(frozen=True)
class KeptValue:
    """A stored parameter whose value in force differs from the saved one."""

    name: str  # full; the hash that it is kept by where this firmware has no such parameter
    value: float  # that was saved
    found: str  # clipped to the bound; out of bounds or conflicting: default in force; unknown


@dataclass(frozen=True)
class CouplingLife:
    serial: int  # number on it; 0: nobody said
    axis: int | None  # of the device, from 0 on, that it is fitted to; None: it lies aside
    seconds: int  # time counted
    energy_J: float  # that it has taken
    full: int  # times that the board had no room for a turning point and took half a cycle for it
    halves: tuple[int, ...]  # half cycles by range, in classes; smaller ranges are not counted
    width_rad: float


@dataclass(frozen=True)
class RawBlackbox:
    fault: int  # number of the fault that froze it; 0: a reset while the motor was on
    tick: int  # base tick at which that was
    records: tuple[bytes | None, ...]  # bytes of each, the oldest first; None where its check fails


def kept_use(session: Session) -> KeptUse:
    return _use(session.ask_for("ESEA_KEPT"))


def kept_values(session: Session) -> tuple[tuple[KeptValue, ...], str, tuple[str, ...]]:
    """Stored parameters that are not in force; the board's checksum; its other texts."""
    dialect = session.dialect
    known = session.known_parameters()
    asked, text = dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_STATUSTEXT
    if session.command(asked, text, drop_before=True) != dialect.MAV_RESULT_ACCEPTED:
        raise LinkError(
            "this board does not report which stored parameters are in force",
            "If it is paired, give --key; otherwise update its firmware.",
        )
    values: list[KeptValue] = []
    others: list[str] = []
    while True:
        said = str(session.wait_for("STATUSTEXT").text).rstrip("\0")
        if said.startswith(_SUM):
            return tuple(values), said.removeprefix(_SUM), tuple(others)
        if found := _VALUE.fullmatch(said):
            own, value, what = found.groups()
            name = own if what == "unknown" else find_parameter(known, own).name
            values.append(KeptValue(name, float(value), what))
        else:
            others.append(said)


def name_encoders(session: Session, serials: Sequence[int]) -> KeptUse:
    """Say which encoders are fitted, in the device's order; the board starts afresh."""
    dialect = session.dialect
    filled = [*serials, *[0] * (_ROOM - len(serials))]
    if len(filled) > _ROOM or any(not 0 <= s < 1 << 32 for s in filled):
        raise LinkError(f"{list(serials)} are not serial numbers", "Give 4 or fewer, below 2^32.")
    zeros = [0.0] * _ROOM
    session.send(session.message("ESEA_KEPT", filled, zeros, *[0] * (len(COUNTERS) + 3)))
    answer = session.wait_for("ESEA_KEPT")
    if answer.result == dialect.MAV_RESULT_DENIED:
        raise LinkError(f"{list(serials)}: two encoders have one serial number")
    if answer.result == dialect.MAV_RESULT_UNSUPPORTED:
        raise LinkError("this board cannot store zeros", "Use a board with memory and encoders.")
    if answer.result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
        raise LinkError("the board accepts no encoders in this state", "Switch the motor off.")
    return _use(answer)


def _use(m: Any) -> KeptUse:
    pairs = zip(m.serial, m.zero_rad, strict=True)
    encoders = [(int(s), None if math.isnan(z) else float(z)) for s, z in pairs]
    return KeptUse(
        tuple(encoders[: m.encoders]), _ZEROS[m.zero], {n: int(getattr(m, n)) for n in COUNTERS}
    )


def coupling_lives(session: Session) -> tuple[CouplingLife, ...]:
    """Use of every coupling: fitted ones first, then those in store."""
    first = session.ask_for("ESEA_LIFE")
    if first.couplings == 0:
        return ()
    told = [first, *(session.ask_for("ESEA_LIFE", k) for k in range(1, first.records))]
    found = [
        CouplingLife(
            *(m.serial, k if k < first.couplings else None, m.seconds, float(m.energy_J)),
            *(m.full, tuple(map(int, m.halves)), float(m.width_rad)),
        )
        for k, m in enumerate(told)
    ]
    return tuple(x for x in found if x.axis is not None or x.serial)


def name_coupling(session: Session, axis: int, serial: int) -> None:
    """Set the fitted coupling; the count of its earlier use continues."""
    _name(session, axis, serial, f"{serial}: another axis has it, or there is no room for one more")


def forget_coupling(session: Session, serial: int) -> None:
    _name(session, _FORGET, serial, f"{serial}: no coupling in store has this number")


def _name(session: Session, axis: int, serial: int, denied: str) -> None:
    if not 0 < serial < 1 << 32:
        raise LinkError(f"{serial} is not a serial number", "Give one from 1 on, below 2^32.")
    dialect = session.dialect
    life = dialect.mavlink_map[dialect.MAVLINK_MSG_ID_ESEA_LIFE]
    none = [0] * max(life.array_lengths)
    session.send(session.message("ESEA_LIFE", serial, 0, 0, 0.0, 0.0, none, axis, 0, 0, 0))
    result = session.wait_for("ESEA_LIFE").result
    if result == dialect.MAV_RESULT_DENIED:
        raise LinkError(denied, "Give its axis another number first, or forget one in store.")
    if result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
        raise LinkError("the board accepts no coupling in this state", "Switch the motor off.")
    if result != dialect.MAV_RESULT_ACCEPTED:
        raise LinkError(
            "this board stores no such coupling", "Give an axis of a board with memory."
        )


def read_blackbox(
    session: Session, progress: Callable[[int, int], None] | None = None
) -> RawBlackbox | None:
    """Read a frozen black box; None where the board has none that is frozen."""
    records: list[bytes | None] = []
    while True:
        part = _part(session, len(records))
        if part.count == 0:
            return None
        data = bytes(part.data)
        for k in range(part.records):
            record = data[k * part.size : (k + 1) * part.size]
            records.append(record if part.whole >> k & 1 else None)
        if progress is not None:
            progress(len(records), part.count)
        if len(records) >= part.count or part.records == 0:
            return RawBlackbox(int(part.fault), int(part.tick), tuple(records))


def _part(session: Session, first: int, records: int = 0) -> Any:
    name = "ESEA_BLACKBOX"
    question = session.message(name, first, 0, 0, 0, records, 0, 0, [0] * 224)

    def answer(limit_s: float) -> Any:
        return session.wait_for(name, limit_s, lambda m: m.first == first)

    return session.repeated(name, lambda: session.send(question), answer)


def release_blackbox(session: Session) -> None:
    """Restart the black box and discard its content."""
    if _part(session, 0, _RELEASE).count:
        raise LinkError("the black box was not released", "If the board is paired, give --key.")
