"""Recordings as arrays and tables, with units, and with their holes."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from esea_gen.errors import UserError
from esea_gen.link.received import shown
from esea_host.recording.integrity import Gap, GapError, Integrity, RecordingState
from esea_host.recording.layout import Array, StreamLayout
from esea_host.recording.reader import LogFile

if TYPE_CHECKING:
    import pandas

TICK = "sequence"
FACTS: dict[str, type] = dict.fromkeys(("device", "content_hash", "real", "board"), str)
FACTS |= {"simulated": bool, "tick_us": int}
MOST_TICK_US = 1_000_000


@dataclass(eq=False)
class Table:
    """Rows of a stream.

    Parameters
    ----------
    layout : StreamLayout
        Its columns, units and meanings.
    rows : ndarray
        Structured, shape (n,).
    board_ns : ndarray of int
        Shape (n,): the board's time; it goes on where the board's ticks start again at 0.
    start_ns : int
        Where the recording begins, on that clock.
    gaps : tuple of Gap
        Holes between the rows.
    """

    layout: StreamLayout
    rows: Array
    board_ns: Array
    start_ns: int
    gaps: tuple[Gap, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> Array:
        """A column, shape (n,), or (n, size) of a vector."""
        if name not in self.names:
            known = ", ".join(self.names)
            raise UserError(f"{self.layout.name} has no column {name}.", f"Choose from {known}.")
        return np.asarray(self.rows[name])

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [c.name for c in self.layout.columns]

    @property
    def units(self) -> dict[str, str]:
        """Unit of every column that has one."""
        return self.layout.units

    @property
    def time_s(self) -> Array:
        """Seconds since the recording's beginning, by the board's clock."""
        return np.asarray((self.board_ns - self.start_ns) * 1e-9)

    @property
    def tick(self) -> Array:
        """Base tick of every row; starts again where the board's clock did."""
        return self[TICK]

    def frame(self) -> pandas.DataFrame:
        """The rows as a pandas frame.

        Returns
        -------
        pandas.DataFrame
            Index ``time_s``; ``attrs`` has ``units``, ``meanings`` and ``gaps``; a vector's
            elements are columns of their own.
        """
        import pandas as pd

        columns = {name: values for name, _, values in self.flat()}
        out = pd.DataFrame(columns, index=pd.Index(self.time_s, name="time_s"))
        out.attrs["units"] = self.units
        out.attrs["meanings"] = {c.name: c.meaning for c in self.layout.columns}
        out.attrs["gaps"] = [asdict(g) for g in self.gaps]
        return out

    def flat(self) -> Iterator[tuple[str, str, Array]]:
        """Name, unit and values of each column; a vector's elements by themselves."""
        for c in self.layout.columns:
            values = np.reshape(self[c.name], (len(self), c.size))
            for i, element in enumerate(values.T):
                yield f"{c.name}[{i}]" if c.size > 1 else c.name, c.unit, element

    def holes(self) -> list[tuple[int, Gap]]:
        """Row behind each hole, and the hole."""
        behind = [int(np.searchsorted(self.board_ns, g.board_ns, "right")) for g in self.gaps]
        return list(zip(behind, self.gaps, strict=True))

    def _cut(self, first: int, last: int) -> Table:
        return Table(self.layout, self.rows[first:last], self.board_ns[first:last], self.start_ns)

    def between(self, start_s: float, end_s: float) -> Table:
        """A stretch, for a figure that wants every sample.

        Parameters
        ----------
        start_s, end_s : float
            From the first to before the second.

        Raises
        ------
        GapError
            When there is a hole in it, or the clock started again.
        """
        first, last = np.searchsorted(self.time_s, [start_s, end_s])
        holes = [g for row, g in self.holes() if first < row < last]
        if holes:
            what = f"{len(holes)} gaps" if len(holes) > 1 else "A gap"
            raise GapError(f"{what} from {start_s:g} to {end_s:g} s: {holes[0]}.", tuple(holes))
        part = self.tick[first:last].astype(np.int64)
        if len(part) > 2 and np.ptp(np.diff(part)) != 0:
            what = "is uneven" if np.diff(part).min() >= 0 else "starts again, as after a reset"
            raise GapError(f"From {start_s:g} to {end_s:g} s the board's clock {what}.", ())
        return self._cut(int(first), int(last))

    def pieces(self) -> Iterator[Table]:
        """The stretches between the holes, and between new starts of the board's clock."""
        starts = np.flatnonzero(np.diff(self.tick.astype(np.int64)) < 0) + 1
        cuts = sorted({0, len(self), *(row for row, _ in self.holes()), *starts.tolist()})
        for first, last in pairwise(cuts):
            yield self._cut(first, last)


class Log(LogFile):
    """A recording, read piece by piece on demand.

    Parameters
    ----------
    path : Path
        The file; one that was cut off is read up to the cut.  ``attachments`` is what belongs to
        it, by file name.

    Raises
    ------
    UserError
        When it is not a recording.
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @cached_property
    def integrity(self) -> Integrity:
        """Whether anything is missing or changed, where, and how much."""
        found = self.judged
        if not any(g.reason == "disconnected" and g.before_tick < 0 for g in self.recorded_gaps):
            return found
        order = list(RecordingState)
        states = {*found.states, RecordingState.DISCONNECTED} - {RecordingState.COMPLETE}
        return replace(found, states=tuple(sorted(states, key=order.index)))

    @property
    def state(self) -> RecordingState:
        """The worst that applies: damaged, disk full, truncated, disconnected or complete."""
        return self.integrity.state

    @property
    def whole(self) -> bool:
        """Whether nothing is missing or changed."""
        return self.integrity.complete

    @cached_property
    def facts(self) -> dict[str, Any]:
        """Device, content hash, versions, the computer; empty where nobody wrote them."""
        what = f"{self.path.name}: facts.json"
        found = _json_object(self.attachments.get("facts.json", b"{}"), what)
        for name, kind in FACTS.items():
            value: Any = found.get(name, kind())
            wrong = type(value) is not kind
            if wrong or (name == "tick_us" and not 0 <= value <= MOST_TICK_US):
                raise UserError(f"{what} has {name} = {shown(repr(value))}.", "Record it again.")
            if kind is str and name in found:
                found[name] = shown(value)
        return found

    @property
    def streams(self) -> list[str]:
        """Names of the streams."""
        return list(self.layouts)

    @property
    def first_output(self) -> str:
        """Default stream: the sensing output of the first axis."""
        outputs = [s for s in self.streams if s.endswith("_out")]
        sensed = [s for s in outputs if s.startswith("sense")]
        return next(iter([*sensed, *outputs, *self.streams]), "sense_out")

    def events(self, topic: str) -> list[dict[str, Any]]:
        """Events of a topic, each with its ``log_ns``.

        Parameters
        ----------
        topic : str
            ``note``, ``gap``, ``clock`` ...
        """
        return [
            {"log_ns": ns, **_json_object(data, f"{self.path.name}: event {count} of {topic}")}
            for count, (ns, data) in enumerate(self.contents(topic), 1)
        ]

    @cached_property
    def recorded_gaps(self) -> tuple[Gap, ...]:
        """Holes that were found while recording."""
        found = [Gap.from_dict(content) for content in self.events("gap")]
        return tuple(g for g in found if g is not None)

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """Holes that were found while recording, and those of damaged pieces."""
        return (*self.recorded_gaps, *self._damaged_gaps())

    def _damaged_gaps(self) -> list[Gap]:
        # One pass: for every stream the last run before a damage, and the first behind it.
        found: list[Gap] = []
        last = dict.fromkeys(self.streams, (-1, -1))
        passed = dict.fromkeys(self.streams, 0)
        for piece in self.pieces if self.holes else ():
            before = bisect_left(self.holes, piece.offset)
            for stream, layout in self.layouts.items():
                rows = self.rows_of(piece, stream)
                if rows is None:
                    continue
                ticks = rows.of(layout)[TICK]
                if passed[stream] < before:
                    tick, ns = last[stream]
                    found.append(Gap(stream, tick, int(ticks[0]), -1, "recording", ns))
                last[stream], passed[stream] = (int(ticks[-1]), int(rows.board_ns[-1])), before
        for stream, (tick, ns) in last.items():
            if passed[stream] < len(self.holes):
                found.append(Gap(stream, tick, -1, -1, "recording", ns))
        return found

    def spans(self) -> dict[str, tuple[int, int, int]]:
        """Of every topic: messages, and the board's times of the first and the last, in ns."""
        found: dict[str, tuple[int, int, int]] = dict.fromkeys(self.topics, (0, 0, 0))
        for piece in self.pieces:
            if piece.spans is None:
                continue
            rows = piece.spans["channel"], piece.spans["count"], *piece.spans["board_ns"].T
            for channel, count, first, last in zip(*(r.tolist() for r in rows), strict=True):
                topic = self._topic(channel)
                before, start, _ = found.get(topic, (0, first, last))
                found[topic] = before + count, start if before else first, last
        return found

    def _layout(self, stream: str) -> StreamLayout:
        if stream in self.layouts:
            return self.layouts[stream]
        kind = self.kind(stream)
        has = f"It has {', '.join(self.streams) or 'no stream of esea-host'}."
        if kind:
            what = f"{self.path.name}: {stream} is {kind}; only streams of esea-host are tables."
            raise UserError(what, f"Convert it with the tool that wrote it. {has}")
        raise UserError(f"{self.path.name} has no stream {stream}.", has)

    def read_timed(self, stream: str) -> Iterator[tuple[Array, Array]]:
        """Rows and board times, a piece at a time: for recordings larger than the memory.

        Parameters
        ----------
        stream : str
            One of :attr:`streams`.
        """
        layout = self._layout(stream)
        for piece in self.pieces:
            found = self.rows_of(piece, stream)
            if found is not None:
                yield found.of(layout), found.board_ns

    def __getitem__(self, stream: str) -> Table:
        """All of a stream.

        Parameters
        ----------
        stream : str
            One of :attr:`streams`, such as ``sense_out``.
        """
        layout = self._layout(stream)
        parts = [*self.read_timed(stream)]
        rows = np.concatenate([r for r, _ in parts]) if parts else np.empty(0, layout.dtype)
        board_ns = np.concatenate([ns for _, ns in parts]) if parts else np.empty(0, np.int64)
        gaps = tuple(g for g in self.gaps if g.stream == stream)
        return Table(layout, rows, board_ns, self.start_ns, gaps)

    @cached_property
    def start_ns(self) -> int:
        """The recording's beginning, on the board's clock."""
        found = [self.spans()[stream] for stream in self.streams]
        return min((first for count, first, _ in found if count), default=0)

    @property
    def tick_s(self) -> float:
        """The board's base tick, in seconds."""
        return float(self.facts.get("tick_us") or 1000) * 1e-6


def open_log(path: str | Path) -> Log:
    """Open a recording.

    Parameters
    ----------
    path : str or Path
        An MCAP file of ``esea-host record``; one that was cut off is read up to the cut.

    Raises
    ------
    UserError
        When it is not a recording.
    """
    return Log(Path(path))


def _json_object(data: bytes, what: str) -> dict[str, Any]:
    # A JSON object that somebody wrote.
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise UserError(f"{what} is not a JSON object.", "Give a recording of esea-host.")
    return found
