"""A long study on a simulated board in another process: ``python -m tests.benchmarks.soak``.

Over TCP or a pseudo terminal; counts rows, gaps by reason, frames and their delay.  The accident
happens two seconds into the first trial: the cable is pulled, or the board loses its power.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.board import KneeBoard, be_ready
from esea_host.assess.probing import Comfort
from esea_host.connection import open_device
from esea_host.connection.receiver import KEY
from esea_host.interaction.on_board import ElementBoard
from esea_host.recording.log import open_log
from esea_host.study.board import BoardSource
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.protocol import parse_protocol
from esea_host.study.recorded import BoardInputs
from esea_host.study.session import replay
from esea_host.study.source import InputSource, SessionWatcher
from esea_host.study.task import TaskStep
from esea_host.wrist.tasks import Neutral

# Tasks of a device, and their seconds; a knee has none, and is watched.
TASKS = {
    "elbow_drive": (("interaction.tracking", "interaction.pong"), "60.0"),
    "wrist_drive": ((Neutral.name,), "15.0, still_deg = 20"),
    "knee_board": ((), ""),
}


class BoardProcess:
    """A simulated board in another process, which can be powered off and on."""

    def __init__(self, device: str, pty: bool, speed: float) -> None:
        self._speed, self._device = speed, device
        self._place = ["--pty"] if pty else ["--tcp=0"]
        self._start()

    def _start(self) -> None:
        command = [sys.executable, "-m", "esea_host.simulated", self._device]
        if self._device == "elbow_drive":
            command.append("--hands")
        self._process = subprocess.Popen(
            [*command, *self._place, f"--speed={self._speed}"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if " at " not in line:
            raise UserError("The simulated board did not start.", line)
        self.address = line.rpartition(" at ")[2].strip()

    def power_off(self, seconds: float) -> None:
        """Take its power, and give it back at the same place."""
        self.close()
        time.sleep(seconds)
        self._place = [f"--tcp={self.address.rpartition(':')[2]}"]
        self._start()

    def hand(self, word: str, number: float) -> None:
        """See :class:`esea_host.simulated.server.Hands`."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{word} {number:.6f}\n")
        self._process.stdin.flush()

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


class _Watcher(SessionWatcher):
    # Counts frames and delays, ends the session in time, and has something happen within a trial.

    def __init__(
        self, source: InputSource, until_s: float, most_s: float, accident: Callable[[], None]
    ) -> None:
        super().__init__()
        self.source, self.until_s, self._accident = source, until_s, accident
        self._end_s = time.monotonic() + most_s
        self.frames, self.delays_s, self.at_s = 0, list[float](), list[float]()
        self._done = False

    def between(self) -> None:
        if self.source.now_s() > self.until_s or time.monotonic() > self._end_s:
            self._stop = lambda: "the time is up"

    def steps(self, time_s: float, step: TaskStep) -> None:
        self.frames += 1
        self.at_s.append(time.monotonic())
        if (tick_s := self.source.tick_s()) is not None:
            self.delays_s.append(time.monotonic() - tick_s)
        if time_s > 2.0 and not self._done:
            self._done = True
            threading.Thread(target=self._accident, daemon=True).start()


def _protocol(device: str, minutes: float) -> str:
    head = 'schema = 1\nname = "soak"\ntitle = "for long"\nseed = 1\n'
    head += f"[stopping]\nlongest_min = {2 * minutes + 10:g}\nfailed_in_a_row = 20\n"
    head += '[[session]]\nname = "all"\n'
    tasks, seconds = TASKS[device]
    copies = max(1, round(minutes * 60 / float(seconds.partition(",")[0]) / len(tasks)))
    return head + "".join(
        f'[[session.block]]\nname = "{k}"\ntask = "{task}"\n'
        f"trials = [{{ parameters = {{ seconds = {seconds} }} }}]\n"
        for k, task in enumerate(tasks * copies)
    )


def soak(
    name: str, minutes: float, folder: Path, pty: bool, speed: float, accident: str, most: float
) -> dict[str, Any]:
    """Run for so long of the board's time; most: minutes by the clock, then no trial begins."""
    study = StudyFolder.create(
        folder / "s", parse_protocol(_protocol(name, minutes), "soak"), simulated=True
    )
    study.enrol("P01", True)
    path = study.log_of("P01", 0)
    process = BoardProcess(name, pty, speed)
    try:
        with open_device(process.address) as device:
            source = (
                ElementBoard(device, path.parent, True, hands=process.hand)
                if name == "elbow_drive"
                else BoardSource(device, path.parent, True)
            )
            happens = {
                "": lambda: None,
                "unplug": device.receiver.transport.close,
                "power-off": lambda: process.power_off(2.0),
            }[accident]
            watcher = _Watcher(source, 60 * minutes, 60 * most, happens)
            session = study.session("P01", 0, source)
            reason = session.run(watcher=watcher)
            clock, health = device.clock(), device.health()
            state = session.state
            session.close()
            source.close()
    finally:
        process.close()
    ended = [e.data["state"] for e in read_log(path).entries if e.kind == "trial_end"]
    same = [same for _, _, same in replay(path, (), BoardInputs(path))]
    ms = 1e3 * np.percentile(watcher.delays_s or [np.nan], [50, 99])
    steps_ms = 1e3 * np.diff(watcher.at_s) if watcher.frames > 1 else np.array([np.nan])
    return {
        "device": name, "over": "pty" if pty else "tcp", "speed": speed, "accident": accident,
        "simulated": True, "ended": reason, "board_s": source.now_s(), "frames": watcher.frames,
        "delay_p50_ms": float(ms[0]), "delay_p99_ms": float(ms[1]),
        "frame_step_p99_ms": float(np.percentile(steps_ms, 99)),
        "trials": dict(Counter(ended)), "reasons": sorted({*state.reasons.values()} - {""}),
        "scenes_from_recording": len(same), "scenes_the_same": all(same),
        "recordings": [_recorded(p) for p in sorted(path.parent.glob("device-*.mcap"))],
        "link": health, "board": clock,
    }  # fmt: skip


def watched(name: str, minutes: float, folder: Path, pty: bool) -> dict[str, Any]:
    """Look at a knee for so long, 50 times a second, and record it."""
    process = BoardProcess(name, pty, 1.0)
    try:
        with open_device(process.address) as device:
            board = KneeBoard(device, Comfort(), folder / "s.json")
            be_ready(board, lambda _: None)
            end_s, events = time.monotonic() + 60 * minutes, Counter[str]()
            while time.monotonic() < end_s:
                events.update(e.kind for e in board.poll(0.02))
            health, clock = device.health(), device.clock()
            board.close()
    finally:
        process.close()
    return {
        "device": name, "over": "pty" if pty else "tcp", "simulated": True, "events": events,
        "recordings": [_recorded(p) for p in sorted(folder.glob("*.mcap"))],
        "link": health, "board": clock,
    }  # fmt: skip


def _recorded(path: Path) -> dict[str, Any]:
    with open_log(path) as log:
        streams = {}
        for stream in log.streams:
            if stream == KEY:
                continue
            steps = np.diff(log[stream].tick.astype(float))
            every = int(np.median(steps))
            # Where ticks go back the board was zeroed, or had lost its power.
            missing = int(np.sum(np.round(steps[steps > 0] / every) - 1))
            streams[stream] = {"rows": len(steps) + 1, "missing": missing}
        gaps = Counter[str]()
        for gap in log.gaps:
            gaps[gap.reason] += max(gap.missing, 0)
        # Every missing row is in a gap with a reason, or it is unexplained.
        missing = sum(s["missing"] for s in streams.values())
        return {
            "integrity": log.integrity.state.value, "streams": streams, "gaps": len(log.gaps),
            "missing_by_reason": dict(gaps), "unexplained": missing - sum(gaps.values()),
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="of the board's time")
    parser.add_argument("--pty", action="store_true")
    parser.add_argument("--speed", type=float, default=1.0, help="of the board's time")
    parser.add_argument("--accident", choices=("unplug", "power-off"), default="")
    parser.add_argument("--most-minutes", type=float, default=60.0, help="by the clock")
    parser.add_argument("--device", choices=TASKS, default="elbow_drive")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        found = (
            soak(
                given.device, given.minutes, at, given.pty, given.speed, given.accident,
                given.most_minutes,
            )
            if TASKS[given.device][0]
            else watched(given.device, given.minutes, at, given.pty)
        )  # fmt: skip
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
