"""A recording played in place of a board, at any speed."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Collection, Iterator
from itertools import pairwise

import numpy as np

from esea_gen.errors import UserError
from esea_gen.link.received import shown
from esea_gen.link.transport import LinkError, Transport
from esea_host.connection.device import ConnectedDevice
from esea_host.connection.identity import Identity
from esea_host.connection.receiver import Batch
from esea_host.recording.export import LONGEST_S
from esea_host.recording.integrity import Gap
from esea_host.recording.log import Log
from esea_host.recording.replay import device_of

STEP_S = 0.03  # of whoever watches
SLOWEST, FASTEST = 0.001, 1000.0


class NobodyListens(Transport):
    """The link of a recording: it receives nothing and sends nothing."""

    def read(self, timeout_s: float) -> bytes:
        return b""

    def write(self, data: bytes, timeout_s: float) -> None:
        raise LinkError("This is a recording: there is no board to command")

    def close(self) -> None:
        """Nothing to let go of."""


class PlayedBoard(ConnectedDevice):
    """A recording played like a board's telemetry; every subscriber gets its rows."""

    def __init__(self, log: Log, speed: float = 1.0) -> None:
        if not SLOWEST <= speed <= FASTEST:
            raise UserError(
                f"A playback speed of {speed:g} is out of range.", "Give 0.001 to 1000."
            )
        device, facts = device_of(log), log.facts
        words = facts.get("real", "f32"), facts["content_hash"], facts.get("board", "unknown")
        identity = Identity(device, *words, round(log.tick_s * 1e6))
        super().__init__(identity, NobodyListens(), threaded=False)
        self.log, self.speed, self.ended = log, speed, False
        self.held = False  # while somebody looks
        self._halt, self._player = threading.Event(), threading.Thread(target=self._run)

    def listen(
        self, streams: Collection[str] | None = None, rate_Hz: float | None = None
    ) -> list[str]:
        """Deliver the recorded rows only; see :class:`ConnectedDevice`."""
        return [s for s in (self.streams if streams is None else streams) if s in self.log.streams]

    def state(self) -> str:
        """That it is a recording, whether it has ended, and whether it is complete."""
        text = f"RECORDED: {shown(self.log.path.name)}"
        text += "" if self.log.whole else f" ({self.log.state.value})"
        return text + (", at its end" if self.ended else "")

    def health(self) -> dict[str, int]:
        """The recording's own gaps."""
        return {"gaps": len(self.log.gaps)}

    def parameters(self) -> dict[str, float]:
        """Recorded values, without those that were changed meanwhile."""
        found = {k: v for told in self.log.events("parameters") for k, v in told.items()}
        new = {str(told.get("name")) for told in self.log.events("parameter")}
        return {k: float(v) for k, v in found.items() if k not in new and type(v) in (int, float)}

    def play(self) -> None:
        self._player.start()

    def close(self) -> None:
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
            wait_s = at_s / self.speed - (time.monotonic() - started_s)
            started_s -= max(0.0, wait_s - LONGEST_S)  # a clock that jumps
            if self._halt.wait(min(max(0.0, wait_s), LONGEST_S)):
                return
            for batch in batches:
                self.receiver.hand_out(batch)
        self.ended = True

    def steps(self) -> Iterator[tuple[float, list[Batch]]]:
        """Next part: seconds since the beginning, and the rows until then."""
        log, ours = self.log, {x.name: x.shape for x in self._layouts}
        layouts = {n: x for n, x in log.layouts.items() if ours.get(n) == x.shape}
        in_order = sorted(log.gaps, key=lambda g: g.board_ns)
        gaps = {name: deque(g for g in in_order if g.stream == name) for name in layouts}
        step_ns, at_s = max(1, round(STEP_S * self.speed * 1e9)), 0.0
        for piece in log.pieces:
            # By the step in which its rows come; a time may be any.
            steps: dict[int, list[Batch]] = {}
            for name, layout in layouts.items():
                found = log.rows_of(piece, name)
                if found is None:
                    continue
                rows, ns = found.of(layout), found.board_ns
                cuts = [0, *(np.flatnonzero(np.diff(ns // step_ns)) + 1).tolist(), len(ns)]
                for a, b in pairwise(cuts):
                    due: list[Gap] = []
                    while gaps[name] and gaps[name][0].board_ns < int(ns[b - 1]):
                        due.append(gaps[name].popleft())
                    part = Batch(layout, rows[a:b], ns[a:b], time.time_ns(), tuple(due))
                    steps.setdefault(int(ns[a]) // step_ns, []).append(part)
            for step in sorted(steps):
                # Pieces overlap by a moment: time stands still meanwhile.
                at_s = max(at_s, ((step + 1) * step_ns - log.start_ns) * 1e-9)
                yield at_s, steps[step]
