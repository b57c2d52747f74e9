"""A recording in a board's place, as fast or slow as somebody likes."""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Iterator

import numpy as np

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_host.connection.device import ConnectedDevice
from esea_host.connection.identity import Identity
from esea_host.connection.receiver import Batch
from esea_host.recording.log import Log
from esea_host.recording.reader import PieceError
from esea_host.recording.replay import device_of

STEP_S = 0.03  # of whoever watches
SLOWEST, FASTEST = 0.001, 1000.0


class NobodyListens:
    """The link of a recording: nothing comes, nothing can be said."""

    def read(self, timeout_s: float) -> bytes:
        """Nothing."""
        return b""

    def write(self, data: bytes, timeout_s: float) -> None:
        """Refused."""
        raise LinkError("This is a recording: there is no board to command", "")

    def close(self) -> None:
        """Nothing is open."""

    def said(self) -> str:
        """Nothing."""
        return ""


class PlayedBoard(ConnectedDevice):
    """A recording that is listened to as a board is; whoever has subscribed gets its rows.

    Parameters
    ----------
    log : Log
        Open; it stays the caller's.
    speed : float
        1: as it was.
    """

    def __init__(self, log: Log, speed: float = 1.0) -> None:
        if not SLOWEST <= speed <= FASTEST:
            raise UserError(
                f"Nothing is played at {speed:g} times its speed.", "Say 0.001 to 1000."
            )
        device, facts = device_of(log), log.facts
        words = str(facts.get("real", "f32")), str(facts["content_hash"]), str(facts["board"])
        super().__init__(
            Identity(device, *words, round(log.tick_s * 1e6)), NobodyListens(), threaded=False
        )
        self.log, self.speed, self.ended = log, speed, False
        self.held = False  # while somebody looks
        self._halt, self._player = threading.Event(), threading.Thread(target=self._run)

    def listen(
        self, streams: Collection[str] | None = None, rate_Hz: float | None = None
    ) -> list[str]:
        """What is recorded comes, and nothing else; see :class:`ConnectedDevice`."""
        return [s for s in (self.streams if streams is None else streams) if s in self.log.streams]

    def state(self) -> str:
        """That it is a recording, and whether it has ended."""
        return f"RECORDED: {self.log.path.name}" + (", its end" if self.ended else "")

    def health(self) -> dict[str, int]:
        """The recording's own gaps."""
        return {"gaps": len(self.log.gaps)}

    def play(self) -> None:
        """Begin, in a thread."""
        self._player.start()

    def close(self) -> None:
        """Stop playing."""
        self._halt.set()
        if self._player.ident is not None:
            self._player.join(5.0)
        super().close()

    def _run(self) -> None:
        started_s = time.monotonic()
        for at_s, batches in self.steps():
            while self.held and not self._halt.is_set():
                before_s = time.monotonic()
                self._halt.wait(STEP_S)
                started_s += time.monotonic() - before_s
            if self._halt.wait(max(0.0, at_s / self.speed - (time.monotonic() - started_s))):
                return
            for batch in batches:
                self.receiver.hand_out(batch)
        self.ended = True

    def steps(self) -> Iterator[tuple[float, list[Batch]]]:
        """What comes a moment later: seconds since the beginning, and the rows until then."""
        file, log = self.log.file, self.log
        layouts = {x.name: x for x in self._layouts if x.name in log.streams}
        seen_ns, at_s = dict.fromkeys(layouts, -1), 0.0
        for piece in file.pieces:
            found = {}
            for name, layout in layouts.items():
                try:
                    rows = file.read(piece, name)
                except PieceError:
                    break  # one of the log's gaps
                if rows is not None:
                    held = layout.rows(rows.data)
                    found[name] = Batch(layout, held, rows.board_ns, int(time.time_ns()))
            if not found:
                continue
            first = min(int(b.board_ns[0]) for b in found.values())
            last = max(int(b.board_ns[-1]) for b in found.values())
            step_ns = max(1, round(STEP_S * self.speed * 1e9))
            for start_ns in range(first, last + 1, step_ns):
                parts = []
                for name, batch in found.items():
                    a, b = np.searchsorted(batch.board_ns, [start_ns, start_ns + step_ns])
                    if b > a:
                        ns = batch.board_ns[a:b]
                        gaps = tuple(
                            g
                            for g in log.gaps
                            if g.stream == name and seen_ns[name] <= g.board_ns < int(ns[-1])
                        )
                        seen_ns[name] = int(ns[-1])
                        part = batch.rows[a:b]
                        parts.append(Batch(batch.layout, part, ns, batch.arrived_ns, gaps))
                # Pieces overlap by a moment: time stands meanwhile.
                at_s = max(at_s, (start_ns + step_ns - log.start_ns) * 1e-9)
                yield at_s, parts
