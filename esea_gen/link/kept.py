"""What a board keeps without power: its encoders' zeros, use counters, the black box."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError

COUNTERS = ("starts", "armings", "faults", "watchdog_resets", "saves", "active_s")
_ZEROS = ("none", "taken", "put back")
_ROOM = 4  # encoders in a message
_RELEASE = 255
_TRIES = 3


@dataclass(frozen=True)
class KeptUse:
    """What outlasts the power beside parameters.

    encoders: serial number and kept zero (rad) of each; 0: nobody said which, None: no zero.
    zero: where the zero in force comes from: ``none``, ``taken`` since power-on, ``put back``.
    counters: by the names in :data:`COUNTERS`.
    """

    encoders: tuple[tuple[int, float | None], ...]
    zero: str
    counters: dict[str, int]


@dataclass(frozen=True)
class RawBlackbox:
    """A frozen black box as it came.

    fault: number of the fault that froze it; 0: a reset while the motor was on.
    tick: base tick at which that was.
    records: bytes of each, the oldest first; None where its check fails.
    """

    fault: int
    tick: int
    records: tuple[bytes | None, ...]


def kept_use(session: Session) -> KeptUse:
    """Ask the board what it keeps."""
    return _use(session.ask_for("ESEA_KEPT"))


def name_encoders(session: Session, serials: Sequence[int]) -> KeptUse:
    """Say which encoders are fitted, in the device's order; the board starts afresh.

    A zero that was kept for all of them is put back.
    """
    dialect = session.dialect
    filled = [*serials, *[0] * (_ROOM - len(serials))]
    if len(filled) > _ROOM or any(not 0 <= s < 1 << 32 for s in filled):
        raise LinkError(f"{list(serials)} are no serial numbers", "Give up to 4, below 2^32.")
    zeros = [0.0] * _ROOM
    session.send(session.message("ESEA_KEPT", filled, zeros, *[0] * (len(COUNTERS) + 3)))
    answer = session.wait_for("ESEA_KEPT")
    if answer.result == dialect.MAV_RESULT_DENIED:
        raise LinkError(f"{list(serials)}: two encoders have one serial number")
    if answer.result == dialect.MAV_RESULT_UNSUPPORTED:
        raise LinkError("this board keeps no zeros", "It has no memory, or no encoders.")
    if answer.result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
        raise LinkError("the board names no encoders in this state", "Switch the motor off.")
    return _use(answer)


def _use(m: Any) -> KeptUse:
    pairs = zip(m.serial, m.zero_rad, strict=True)
    encoders = [(int(s), None if math.isnan(z) else float(z)) for s, z in pairs]
    return KeptUse(
        tuple(encoders[: m.encoders]), _ZEROS[m.zero], {n: int(getattr(m, n)) for n in COUNTERS}
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
    # Asked again where a frame was lost: a question changes nothing.
    cls = session.message
    for again in range(_TRIES):
        session.send(cls("ESEA_BLACKBOX", first, 0, 0, 0, records, 0, 0, [0] * 224))
        try:
            return session.wait_for("ESEA_BLACKBOX", wanted=lambda m: m.first == first)
        except LinkError:
            if again + 1 == _TRIES:
                raise
    raise AssertionError("unreachable")


def release_blackbox(session: Session) -> None:
    """Let the black box go on: what it holds is lost."""
    if _part(session, 0, _RELEASE).count:
        raise LinkError("the black box was not released", "A paired board asks for its key.")
