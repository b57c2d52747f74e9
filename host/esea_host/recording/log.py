"""Recordings as arrays and tables, with units, and with their holes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from esea_gen.errors import UserError
from esea_host.recording.gaps import Gap, GapError
from esea_host.recording.layout import Array, StreamLayout
from esea_host.recording.reader import LogFile, PieceError

if TYPE_CHECKING:
    import pandas

TICK = "sequence"


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

    def __init__(
        self,
        layout: StreamLayout,
        rows: Array,
        board_ns: Array,
        start_ns: int,
        gaps: tuple[Gap, ...] = (),
    ) -> None:
        self.layout, self.rows, self.board_ns = layout, rows, board_ns
        self.start_ns, self.gaps = start_ns, gaps

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> Array:
        """A column, shape (n,), or (n, size) of a vector."""
        if name not in self.names:
            known = ", ".join(self.names)
            raise UserError(f"{self.layout.name} has no column {name}.", f"It has {known}.")
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

        columns: dict[str, Array] = {}
        for c in self.layout.columns:
            if c.size == 1:
                columns[c.name] = self[c.name]
            else:
                columns |= {f"{c.name}[{i}]": self[c.name][:, i] for i in range(c.size)}
        out = pd.DataFrame(columns, index=pd.Index(self.time_s, name="time_s"))
        out.attrs["units"] = self.units
        out.attrs["meanings"] = {c.name: c.meaning for c in self.layout.columns}
        out.attrs["gaps"] = [g.to_dict() for g in self.gaps]
        return out

    def _holes(self) -> list[tuple[int, Gap]]:
        # Row behind each hole, and the hole.
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

        Returns
        -------
        Table
            Without a hole.

        Raises
        ------
        GapError
            When there is a hole in it, or the clock started again.
        """
        first, last = np.searchsorted(self.time_s, [start_s, end_s])
        holes = [g for row, g in self._holes() if first < row < last]
        if holes:
            what = f"{len(holes)} gaps" if len(holes) > 1 else "A gap"
            raise GapError(f"{what} from {start_s:g} to {end_s:g} s: {holes[0]}.", tuple(holes))
        part = self.tick[first:last].astype(np.int64)
        if len(part) > 2 and np.ptp(np.diff(part)) != 0:
            what = f"From {start_s:g} to {end_s:g} s the ticks of {self.layout.name} are uneven."
            raise GapError(what, ())
        return self._cut(int(first), int(last))

    def pieces(self) -> Iterator[Table]:
        """The stretches between the holes, and between new starts of the board's clock."""
        starts = np.flatnonzero(np.diff(self.tick.astype(np.int64)) <= 0) + 1
        cuts = sorted({0, len(self), *(row for row, _ in self._holes()), *starts.tolist()})
        for first, last in pairwise(cuts):
            yield self._cut(first, last)


class Log:
    """A recording, read piece by piece as it is asked for.

    Parameters
    ----------
    path : Path
        The file; one that was cut off is read up to the cut.

    Raises
    ------
    UserError
        When it is no recording.
    """

    def __init__(self, path: Path) -> None:
        self._file = LogFile(Path(path))
        self.path = self._file.path

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    @property
    def file(self) -> LogFile:
        """The pieces below."""
        return self._file

    @property
    def whole(self) -> bool:
        """Whether the recording was ended, and not cut off."""
        return self._file.whole

    @property
    def attachments(self) -> dict[str, bytes]:
        """What belongs to it, by file name."""
        return self._file.attachments

    @cached_property
    def facts(self) -> dict[str, Any]:
        """Device, content hash, versions, the computer; empty where nobody wrote them."""
        found: dict[str, Any] = json.loads(self.attachments.get("facts.json", b"{}"))
        return found

    @property
    def streams(self) -> list[str]:
        """Names of the streams."""
        return [t for t in self._file.topics() if self._file.layout(t) is not None]

    @property
    def topics(self) -> list[str]:
        """Streams and events."""
        return list(self._file.topics())

    def events(self, topic: str) -> list[dict[str, Any]]:
        """Events of a topic, each with its ``log_ns``.

        Parameters
        ----------
        topic : str
            ``note``, ``gap``, ``clock`` ...

        Returns
        -------
        list of dict
            In the order of writing; empty for a topic that is not there.
        """
        return [{"log_ns": ns, **content} for ns, content in self._file.events(topic)]

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """Holes that were found while recording, and pieces that are damaged since."""
        found = [Gap(**{k: v for k, v in e.items() if k != "log_ns"}) for e in self.events("gap")]
        for stream in self.streams:
            for piece in self._file.pieces:
                try:
                    self._file.content(piece)
                except PieceError:
                    found.append(self._around(stream, piece.offset))
        return tuple(found)

    def _around(self, stream: str, offset: int) -> Gap:
        # The last run before a damaged piece, and the first behind it.
        before, behind, board_ns = -1, -1, -1
        for at, rows, ns in self._rows(stream):
            if at > offset:
                behind = int(rows[TICK][0])
                break
            before, board_ns = int(rows[TICK][-1]), int(ns[-1])
        return Gap(stream, before, behind, -1, "recording", board_ns)

    def _layout(self, stream: str) -> StreamLayout:
        if stream not in self._file.topics() or self._file.layout(stream) is None:
            raise UserError(
                f"{self.path.name} has no stream {stream}.",
                f"It has {', '.join(self.streams) or 'none'}.",
            )
        layout = self._file.layout(stream)
        assert layout is not None
        return layout

    def _rows(self, stream: str, checked: bool = True) -> Iterator[tuple[int, Array, Array]]:
        layout = self._layout(stream)
        for piece in self._file.pieces:
            try:
                found = self._file.read(piece, stream, checked)
            except PieceError:
                continue
            if found is not None:
                yield piece.offset, layout.rows(found.data), found.board_ns

    def read(self, stream: str, checked: bool = True) -> Iterator[Array]:
        """A stream's rows, a piece at a time: for recordings that are larger than the memory.

        Parameters
        ----------
        stream : str
            One of :attr:`streams`.
        checked : bool
            Leave out pieces whose checksum is wrong.

        Returns
        -------
        iterator of ndarray
            Structured, of the rows of one piece.
        """
        for _, rows, _ in self._rows(stream, checked):
            yield rows

    def read_all(self, stream: str, damaged: list[str]) -> Iterator[tuple[Array, Array]]:
        """Rows and board times of every piece, those with a wrong checksum too, which are named.

        Parameters
        ----------
        stream : str
            One of :attr:`streams`.
        damaged : list of str
            Gets what is wrong with each piece, once.

        Returns
        -------
        iterator of (ndarray, ndarray)
            Rows, and nanoseconds of the board's clock.
        """
        layout = self._layout(stream)
        for piece in self._file.pieces:
            try:
                self._file.content(piece)
            except PieceError as error:
                if str(error) not in damaged:
                    damaged.append(str(error))
            try:
                found = self._file.read(piece, stream, checked=False)
                if found is not None:
                    yield layout.rows(found.data), found.board_ns
            except (PieceError, ValueError, IndexError):
                continue

    def __getitem__(self, stream: str) -> Table:
        """All of a stream.

        Parameters
        ----------
        stream : str
            One of :attr:`streams`, such as ``sense_out``.

        Returns
        -------
        Table
            Its rows, times and holes.
        """
        layout = self._layout(stream)
        parts = [*self._rows(stream)]
        rows = np.concatenate([r for _, r, _ in parts]) if parts else np.empty(0, layout.dtype)
        board_ns = np.concatenate([ns for _, _, ns in parts]) if parts else np.empty(0, np.int64)
        gaps = tuple(g for g in self.gaps if g.stream == stream)
        return Table(layout, rows, board_ns, self.start_ns, gaps)

    @cached_property
    def start_ns(self) -> int:
        """The recording's beginning, on the board's clock."""
        firsts = [next(self._rows(s), None) for s in self.streams]
        return min((int(f[2][0]) for f in firsts if f is not None), default=0)

    @property
    def tick_s(self) -> float:
        """The board's base tick, in seconds."""
        return float(self.facts.get("tick_us", 1000)) * 1e-6


def open_log(path: str | Path) -> Log:
    """Open a recording.

    Parameters
    ----------
    path : str or Path
        An MCAP file of ``esea-host record``; one that was cut off is read up to the cut.

    Returns
    -------
    Log
        ``log["sense_out"]["tau_Nm"]`` is an array, ``log["sense_out"].frame()`` a pandas frame.

    Raises
    ------
    UserError
        When it is no recording.
    """
    return Log(Path(path))
