"""A recording computed again, by the C that made it, and held against it bit for bit.

Every second the board tells all that its next ticks come from: a key frame.  From one to the next
the inputs of every tick must give every output, and the next frame's state.  Behind a gap the proof
goes on at the next key frame; what lies between is said to be unproven, not right.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device, load_device
from esea_gen.devices.file import read_file, shipped_devices
from esea_gen.emit.build import format_hash
from esea_gen.errors import UserError
from esea_gen.hostlib import HostLibrary, compile_device
from esea_gen.hostlib.codec import Field
from esea_host.recording.layout import Array
from esea_host.recording.log import TICK, Log

KEY = "key"
MOST_DIFFERENCES = 20


@dataclass(frozen=True)
class ReplayDifference:
    """A bit that is another than the C gives.

    tick: base tick of the run; time_s: since the recording's beginning.
    signal: the output, or a word of the state in a key frame.
    recorded, computed: both as numbers.
    input_signal: the input that explains it, where a single flipped bit of one does.
    """

    stream: str
    tick: int
    time_s: float
    signal: str
    recorded: float
    computed: float
    input_signal: str = ""

    def __str__(self) -> str:
        where = f"tick {self.tick} ({self.time_s:.3f} s), {self.stream}.{self.signal}"
        text = f"{where}: recorded {self.recorded!r}, computed {self.computed!r}"
        if self.input_signal:
            text += f"; one flipped bit of the input {self.input_signal} explains it"
        return text


@dataclass
class ReplayVerdict:
    """What came of a replay.

    ticks: base ticks that were computed again.
    values: outputs that were compared.
    unproven: ticks that no key frame reaches, or whose inputs are missing.
    key_frames: whole ones.
    damaged: pieces of the file with a wrong checksum; their content is compared all the same.
    """

    ticks: int = 0
    values: int = 0
    unproven: int = 0
    key_frames: int = 0
    damaged: list[str] = field(default_factory=list)
    differences: list[ReplayDifference] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether there was something to compare, and every bit of it is the C's."""
        return self.values > 0 and not self.differences


@dataclass(frozen=True)
class _KeyFrame:
    ns: int
    tick: int
    words: Array


def verify(log: Log, progress: Callable[[float], None] | None = None) -> ReplayVerdict:
    """Compute a recording again.

    Parameters
    ----------
    log : Log
        With the inputs and outputs of every tick, and key frames.
    progress : callable, optional
        Hears the share that is done.

    Returns
    -------
    ReplayVerdict
        Counts, and the first differences.

    Raises
    ------
    UserError
        When the recording cannot be computed again: other C, no inputs, no key frames.
    """
    return _Replay(log).run(progress or (lambda _: None))


def device_of(log: Log) -> Device:
    """The device that a recording is of; refused when this tree's C is not what made it."""
    facts = log.facts
    if "device" not in facts or "content_hash" not in facts:
        raise UserError(f"{log.path.name} does not say which C made it.", "Record with esea-host.")
    shipped = facts["device"] in shipped_devices()
    device = loaded_device(facts["device"]) if shipped else _attached(log)
    ours = format_hash(device, facts.get("real", "f32"))
    if ours != facts["content_hash"]:
        raise UserError(
            f"{log.path.name} was made by C of {device.name} with the content hash "
            f"{facts['content_hash']}; this tree's is {ours}.",
            "Replay it with the version that made it; its sources are attached (sources.zip).",
        )
    return device


def loaded_device(name: str) -> Device:
    """A device by name or file, loaded once for as long as its text is the same."""
    return _loaded(name, read_file(name)[0])


@lru_cache(maxsize=4)
def _loaded(name: str, text: str) -> Device:
    return load_device(name)


def _attached(log: Log) -> Device:
    # Of a file of somebody's own, which lies in the recording.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "device.toml"
        path.write_bytes(log.attachments.get("device.toml", b""))
        return load_device(path)


@lru_cache(maxsize=2)
def _compiled(device: Device, real: str) -> HostLibrary:
    return compile_device(device, real)


def _told(f: Field, held: Array) -> Array:
    # As the link tells it: of a q31 number the nearest float, which keeps 24 bits.
    values = np.asarray(f.decode(held))
    return values.astype(np.float32) if values.dtype.kind == "f" else values


class _Task:
    # A task's C, its recorded runs, and what the C gives in their place.

    def __init__(self, replay: _Replay, name: str, every: int, phase: int) -> None:
        library = replay.library
        self.name, self.every, self.phase = name, every, phase
        system = library.system
        task = system.task(name)
        stem = f"{library.prefix}_{name}"
        self.step = library.function(f"{stem}_step")
        self.inputs = [library.codec.external(x) for x in system.task_inputs(task)]
        self.outputs = [library.codec.external(x) for x in system.task_outputs(task)]
        self.given: Array | None = None
        self.given_at: Array | None = None
        if self.inputs:
            self.given, self.given_at = replay.rows(f"{name}_in")
        self.told, self.told_at = replay.rows(f"{name}_out")
        self.in_type, self.out_type = f"{stem}_in_t", f"{stem}_out_t"
        count = len(self.given) if self.given is not None else 1
        self.packed = np.zeros(max(count, 1), library.dtype(self.in_type))
        if self.given is not None:
            for f in self.inputs:
                self.packed[f.c_name] = f.encode(self.given[f.name])
        self.computed = np.zeros(max(len(self.told), 1), library.dtype(self.out_type))
        self.done = np.zeros(len(self.told), bool)
        ffi = library.ffi
        self.in_place = ffi.cast(f"{self.in_type} *", self.packed.ctypes.data)
        self.out_place = ffi.cast(f"{self.out_type} *", self.computed.ctypes.data)
        self.nowhere = ffi.new(f"{self.out_type} *")

    def rows(self, ns: Array) -> tuple[list[int], list[int]]:
        """Rows of what it was given and told at these times; -1: none."""
        given = [0] * len(ns) if self.given_at is None else _rows_at(self.given_at, ns)
        return given, _rows_at(self.told_at, ns)


def _rows_at(times: Array, ns: Array) -> list[int]:
    at = np.searchsorted(times, ns)
    there = times[np.minimum(at, len(times) - 1)] == ns
    return [int(row) for row in np.where(there, at, -1)]


class _Replay:
    def __init__(self, log: Log) -> None:
        self.log = log
        device = device_of(log)
        for needed in (KEY, f"{device.system.tasks[0].name}_in"):
            if needed not in log.streams:
                raise UserError(
                    f"{log.path.name} has no stream {needed}: it cannot be computed again.",
                    "Record all streams: esea-host record without --stream.",
                )
        self.library = _compiled(device, log.facts.get("real", "f32"))
        self.tick_ns = round(log.tick_s * 1e9)
        self.verdict = ReplayVerdict()
        self.tasks = [_Task(self, t.name, t.every, t.phase) for t in device.system.tasks]
        self.state_type = self.library.dtype(f"{self.library.prefix}_state_t")
        self.keys = self._key_frames()
        prefix, ffi = self.library.prefix, self.library.ffi
        self.state = np.zeros(1, self.state_type)
        self.state_place = ffi.cast(f"{prefix}_state_t *", self.state.ctypes.data)
        self.coeffs: tuple[Any, ...] = ()
        self.params: Array | None = None
        if device.system.tunables:
            self.params = np.zeros(1, self.library.dtype(f"{prefix}_params_t"))
            self.coeffs = (ffi.new(f"{prefix}_coeffs_t *"),)
        self.release = self.library.function(f"{prefix}_release")

    def rows(self, stream: str) -> tuple[Array, Array]:
        """Rows and their times, those of damaged pieces too."""
        parts = list(self.log.read_all(stream, self.verdict.damaged))
        if not parts:
            raise UserError(f"{self.log.path.name} has no stream {stream}.", "Record all streams.")
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def _key_frames(self) -> list[_KeyFrame]:
        rows, times = self.rows(KEY)
        found: list[_KeyFrame] = []
        words: list[Array] = []
        wanted = 0
        for row, ns in zip(rows, times.tolist(), strict=True):
            if row["first"] == 0:
                words, wanted = [], 0
            elif row["first"] != wanted:
                continue
            words.append(row["words"])
            wanted = int(row["first"]) + len(row["words"])
            if wanted >= row["total"]:
                whole = np.concatenate(words)[: int(row["total"])]
                found.append(_KeyFrame(ns, int(row[TICK]), whole))
        return found

    def run(self, progress: Callable[[float], None]) -> ReplayVerdict:
        v = self.verdict
        v.key_frames = len(self.keys)
        first = self.tasks[0]
        for i, key in enumerate(self.keys):
            end_ns = self.keys[i + 1].ns if i + 1 < len(self.keys) else None
            self._restore(key)
            reached = self._ticks(key, end_ns)
            if reached and end_ns is not None:
                self._compare_state(self.keys[i + 1])
            progress((i + 1) / len(self.keys))
        for task in self.tasks:
            self._compare(task)
        assert first.given is not None
        v.unproven = len(first.given) - v.ticks
        v.differences.sort(key=lambda d: (d.time_s, d.stream))
        self._explain()
        del v.differences[MOST_DIFFERENCES:]
        return v

    def _restore(self, key: _KeyFrame) -> None:
        data = key.words.astype("<u4").tobytes()
        start = 0
        if self.params is not None:
            start = self.params.dtype.itemsize
            self.params.view(np.uint8)[:] = np.frombuffer(data[:start], np.uint8)
            prefix, ffi = self.library.prefix, self.library.ffi
            place = ffi.cast(f"{prefix}_params_t *", self.params.ctypes.data)
            self.library.function(f"{prefix}_prepare")(place, *self.coeffs)
        self.state.view(np.uint8)[:] = np.frombuffer(data[start:], np.uint8)

    def _ticks(self, key: _KeyFrame, end_ns: int | None) -> bool:
        # Whether it came to the next key frame without a hole.
        given_at = self.tasks[0].given_at
        assert given_at is not None
        first = int(np.searchsorted(given_at, key.ns))
        last = len(given_at) if end_ns is None else int(np.searchsorted(given_at, end_ns))
        steady = key.ns + self.tick_ns * np.arange(last - first) == given_at[first:last]
        count = last - first if steady.all() else int(np.argmin(steady))
        self._run(key, count)
        self.verdict.ticks += count
        return end_ns is not None and key.ns + count * self.tick_ns == end_ns

    def _run(self, key: _KeyFrame, count: int) -> None:
        # So many base ticks from a key frame on.
        ns = key.ns + self.tick_ns * np.arange(count)
        rows = [task.rows(ns) for task in self.tasks]
        for i in range(count):
            self.step(key.tick + i, [(given[i], told[i]) for given, told in rows])

    def step(self, tick: int, rows: list[tuple[int, int]]) -> None:
        """One base tick; rows: of each task, what it was given and told, -1 where nothing was."""
        self.release(self.state_place, tick)
        for task, (given, told) in zip(self.tasks, rows, strict=True):
            if tick < task.phase or (tick - task.phase) % task.every or given < 0:
                continue
            place = task.out_place + told if told >= 0 else task.nowhere
            task.step(*self.coeffs, self.state_place, task.in_place + given, place)
            if told >= 0:
                task.done[told] = True

    def _compare(self, task: _Task) -> None:
        for f in task.outputs:
            told = np.ascontiguousarray(task.told[f.name][task.done]).view(np.uint32)
            computed = _told(f, task.computed[: len(task.told)][f.c_name][task.done])
            bits = np.ascontiguousarray(computed).view(np.uint32)
            self.verdict.values += told.size
            wrong = (told != bits).reshape(len(told), -1).any(axis=1) if told.size else told
            for row in np.flatnonzero(wrong)[:MOST_DIFFERENCES].tolist():
                at = int(np.flatnonzero(task.done)[row])
                pair = np.ravel(task.told[f.name][at])[0], np.ravel(computed[row])[0]
                self._differs(f"{task.name}_out", task.told[at], task.told_at[at], f.name, *pair)

    def _differs(
        self, stream: str, row: Any, ns: int, name: str, recorded: Any, computed: Any
    ) -> None:
        time_s = (int(ns) - self.log.start_ns) * 1e-9
        found = ReplayDifference(
            stream, int(row[TICK]), time_s, name, recorded.item(), computed.item()
        )
        self.verdict.differences.append(found)

    def _compare_state(self, key: _KeyFrame) -> None:
        # A state that was begun anew, by zeroing or a parameter, is no difference.
        start = self.params.dtype.itemsize // 4 if self.params is not None else 0
        told = key.words[start:]
        if self.params is not None and key.words[:start].tobytes() != self.params.tobytes():
            return
        mine = self.state.view("<u4").ravel()
        wrong = np.flatnonzero(told != mine)
        self.verdict.values += len(told)
        if len(wrong):
            time_s = (key.ns - self.log.start_ns) * 1e-9
            word = int(wrong[0])
            pair = float(told[word]), float(mine[word])
            self.verdict.differences.append(
                ReplayDifference(KEY, key.tick, time_s, f"state word {word}", *pair)
            )

    def _explain(self) -> None:
        # An input with one bit wrong shows as outputs that differ from that tick on.
        fast = self.tasks[0]
        if not self.verdict.differences:
            return
        first = self.verdict.differences[0]
        if first.stream != f"{fast.name}_out":
            return
        assert fast.given is not None
        ns = round(first.time_s * 1e9) + self.log.start_ns
        key = next((k for k in reversed(self.keys) if k.ns <= ns), None)
        if key is None:
            return
        self._restore(key)
        self._run(key, (ns - key.ns) // self.tick_ns)
        before = self.state.copy()
        rows = [(given[0], told[0]) for given, told in (t.rows(np.array([ns])) for t in self.tasks)]
        at, out = rows[0]
        for f in fast.inputs:
            held = fast.packed[f.c_name][at]
            for bit in range(32):
                bits = fast.given[f.name][at].view(np.uint32) ^ np.uint32(1 << bit)
                fast.packed[f.c_name][at] = f.encode(bits.view(np.float32))
                self.state[:] = before
                self.step(first.tick, rows)
                same = all(
                    _told(g, fast.computed[g.c_name][out]).tobytes()
                    == fast.told[g.name][out].tobytes()
                    for g in fast.outputs
                )
                fast.packed[f.c_name][at] = held
                if same:
                    explained = ReplayDifference(**{**vars(first), "input_signal": f.name})
                    self.verdict.differences = [explained]
                    return
