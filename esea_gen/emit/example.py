"""Example program of a System, and its expected output from the symbolic System.

A System without a drive gets a triangle on one input.  A System with a drive gets a short recording
of its encoders; its latch is armed, torque control runs, and then the latch is tested. All numbers
are in units and the same for every number format.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from esea_gen.control.limits.faults import FAULT_TEXT, Fault
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External, System, Task
from esea_gen.model.drive import NominalDrive
from esea_gen.model.mode import Mode
from esea_gen.model.sensing import zeros_missing

SAMPLES = 12  # of a triangle
MOST_PEAK = 255
DIGITS = 6  # behind the point


@dataclass(frozen=True)
class Sample:
    step: int
    expected: float


@dataclass(frozen=True)
class Triangle:
    input: External
    output: External
    start: int  # the input is ``(start + triangle) * lattice``, with whole numbers
    peak: int
    lattice: float
    steps: int
    samples: tuple[Sample, ...]
    held: Mapping[str, float]  # values of all inputs, by name

    template = "device/main.c.j2"

    @property
    def checked(self) -> tuple[External, ...]:
        return (self.output,)

    tunables: tuple[tuple[str, str, float], ...] = ()


@dataclass(frozen=True)
class Column:
    name: str
    feeds: tuple[External, ...]  # inputs that are given it, every element of them


@dataclass(frozen=True)
class RecordedTick:
    """A base tick of the recording: inputs by column, and the expected outputs."""

    given: tuple[float, ...]
    expected: tuple[float, ...]


@dataclass(frozen=True)
class Axis:
    """Inputs and outputs of one axis' latch."""

    command: External
    fault: External


@dataclass(frozen=True)
class DriveExample:
    columns: tuple[Column, ...]  # the recording; inputs in no column keep their value of ``held``
    rows: tuple[RecordedTick, ...]
    checked: tuple[External, ...]  # outputs that are compared at every tick
    held: Mapping[str, float]
    axes: tuple[Axis, ...]
    modes: tuple[External, ...]
    stop: External
    rearm: External
    wait: int  # ticks in which the control task delivers for certain
    rearmed: int  # last value of ``rearm`` in the recording
    driven: bool  # whether the law moves the motor on this recording
    tunables: tuple[tuple[str, str, float], ...]  # instance, name, value

    template = "device/main_drive.c.j2"
    off = float(Mode.OFF)
    torque = float(Mode.TORQUE)
    stopped = float(Fault.STOP)


_MADE: WeakKeyDictionary[System, Triangle | DriveExample] = WeakKeyDictionary()


def example(system: System) -> Triangle | DriveExample:
    """The example of a System, worked out once."""
    if system not in _MADE:
        _MADE[system] = drive_example(system) if has_drive(system) else triangle_example(system)
    return _MADE[system]


def tolerance(system: System, external: External, share: float) -> float:
    """Largest error of an output that the example takes for rounding, in its unit."""
    if _sink(system, external) == ("limits", "u_Nm"):
        share = max(share, COMMAND_SHARE)
    most = max(abs(external.port.low), abs(external.port.high))
    return float(f"{share * most:.1g}")


def triangle(k: int, peak: int) -> int:
    """Whole-numbered triangle wave of period ``4 * peak``: 0, up, down through 0, back."""
    phase = k % (4 * peak)
    if phase <= peak:
        return phase
    return 2 * peak - phase if phase <= 3 * peak else phase - 4 * peak


def _nothing(system: System, why: str, fix: str) -> UserError:
    return UserError(f"{system.name}: the example program would compare nothing: {why}.", fix)


# -- a triangle ------------------------------------------------------------------------------------


def _lattice(port: Port) -> tuple[int, int, float]:
    # Start, peak and lattice.  The lattice is a power of two, so that every number is exact.  The
    # triangle goes round zero or, where that is no place inside the range, round a quarter of it;
    # a count moves in steps of one.
    inside = port.low < 0 < port.high
    middle = 0.0 if inside else port.low + 0.25 * (port.high - port.low)
    reach = 0.5 * min(port.high - middle, middle - port.low)
    shift = 8 - math.frexp(reach)[1]
    if not inside:
        shift = max(shift, 0)
    start = round(middle * 2.0**shift)
    return start, min(int(reach * 2.0**shift), MOST_PEAK), 2.0**-shift


def _rest(port: Port) -> float:
    return float(min(max(0.0, port.low), port.high))


def triangle_example(system: System) -> Triangle:
    source = next((x for x in system.inputs if x.port.size == 1), None)
    if source is None:
        raise _nothing(system, "it has no external input of one number", "Make one external.")
    start, peak, lattice = _lattice(source.port)

    def alike(port: Port) -> bool:
        mine = source.port
        return (port.unit, port.low, port.high) == (mine.unit, mine.low, mine.high)

    held = {x.name: start * lattice if alike(x.port) else _rest(x.port) for x in system.inputs}
    steps = 4 * peak
    run = _Run(system, {}, held)
    seen = []
    for k in range(steps):
        out = run.tick({source.name: (start + triangle(k, peak)) * lattice})
        if k % (steps // SAMPLES) == steps // (2 * SAMPLES):
            seen.append((k, out))
    results = [x for x in system.outputs if x.port.size == 1 and not x.port.flags]
    moving = [x for x in results if len({out[x.name] for _, out in seen}) > 1]
    if not moving:
        raise _nothing(
            system,
            f"{source.name} moves no output",
            "Make an output of one number external that answers to it.",
        )
    (result, *_) = moving
    samples = tuple(Sample(k, _number(out[result.name])) for k, out in seen)
    return Triangle(source, result, start, peak, lattice, steps, samples, held)


def _number(value: float) -> float:
    return round(float(value), DIGITS) + 0.0  # + 0.0: no negative zero


class _Run:
    # The symbolic System, tick by tick, with inputs that stay until they are given anew.

    def __init__(
        self, system: System, tunables: Mapping[str, Mapping[str, float]], held: Mapping[str, float]
    ) -> None:
        self.system, self.given = system, dict(held)
        self.simulator = system.simulator(tunables)
        self.now = 0
        self.out: dict[str, float] = {}

    def _inputs(self, task: Task) -> dict[str, Any]:
        return {
            x.name: self.given[x.name]
            if x.port.size == 1
            else np.full(x.port.size, self.given[x.name])
            for x in self.system.task_inputs(task)
        }

    def tick(self, given: Mapping[str, float]) -> dict[str, float]:
        """One base tick: release, then every task that is due.  Outputs of one number."""
        self.given |= given
        self.simulator.release(self.now)
        for task in self.system.tasks:
            if (self.now - task.phase) % task.every == 0:
                out = self.simulator.step(task.name, **self._inputs(task))
                self.out |= {n: float(v) for n, v in out.items() if np.size(v) == 1}
        self.now += 1
        return dict(self.out)


# -- a drive ---------------------------------------------------------------------------------------

ARMED_TICKS = 5  # between the release of the latch and torque mode
MOVE_TICKS = 120  # of the torque that is wanted: to one side, and half way back
LEAST_WAIT = 10  # where the control task runs at each tick, its inputs settle for longer
REST_TICKS = 10  # at the end: held, with no torque wanted
SHARES = (0.04, 0.015, 0.005)  # of the largest torque: what is wanted, tried in this order
COMMAND_SHARE = 4e-3  # largest seen: 2.4e-4 of the range in f32, 2.9e-3 in q31
LOAD_RATE_RAD_S = 0.2
WANTED_LATTICE_NM = 2.0**-8


def has_drive(system: System) -> bool:
    """Whether a System has all that the example of a drive runs: encoders, limits, a latch."""
    ends = {_sink(system, x) for x in (*system.inputs, *system.outputs)}
    needed = {("limits", port) for port in ("stop", "rearm", "u_Nm", "fault")}
    sides = {_side(x) for x in system.inputs if x.signals[0].port == "count"}
    wanted = any(port == "mode" for _, port in ends)
    return bool(system.latches) and needed <= ends and wanted and {"motor", "load"} <= sides


def _sink(system: System, external: External) -> tuple[str, str]:
    # Kind of Block and name of the port that it feeds or comes from.
    signal = external.signals[0]
    return system.blocks[signal.instance].name, signal.port


def _side(external: External) -> str:
    # Of a count of encoder_motor or encoder_motor_AXIS: motor.
    return external.signals[0].instance.removeprefix("encoder_").split("_")[0]


def _axis(system: System, external: External, kind: str) -> str:
    # Which axis it is of: what follows the Block's name in the instance's.
    for signal in external.signals:
        if system.blocks[signal.instance].name == kind:
            return signal.instance.removeprefix(kind)
    raise AssertionError(f"{external.name} has nothing to do with {kind}")


def _default(system: System, kind: str, name: str) -> float:
    block = next(b for b in system.kinds if b.name == kind)
    return float(next(t.default for t in block.tunables if t.name == name))


def _wave(x: float) -> float:
    # A parabola for sin(x pi / 2), up to its zero at 2: sums and products are the same on every
    # machine, a sine is not.
    return x * (2.0 - x)


SETTLE_TICKS = 20  # encoders and rates have settled


def _encoder(block: Block, tunables: Mapping[str, float]) -> Callable[[float], float]:
    # Which count an encoder gives at an angle: asked of its Block.
    full = int(next(p for p in block.inputs if p.name == "count").high) + 1

    def angle_rad(count: int) -> float:
        simulator = block.simulator(tunables)
        for _ in range(SETTLE_TICKS):
            out = simulator.step(count=float(count), frame_error=0.0)
        return float(out["theta_rad"])

    at_zero_rad, sign = 0.0, 1.0
    if block.name != "encoder_gear":  # that one counts on from wherever it starts
        at_zero_rad = angle_rad(0)
        # A hundredth of a turn on, the short way round.
        rise = math.remainder(angle_rad(full // 100) - at_zero_rad, 2 * math.pi)
        sign = math.copysign(1.0, rise)

    def count(angle_rad: float) -> float:
        turns = sign * (angle_rad - at_zero_rad) / (2 * math.pi)
        return float(round(turns * full) % full)

    return count


class _Recording:
    # The inputs of a drive's example, and what its tasks answer.

    def __init__(self, system: System, most_Nm: float) -> None:
        self.system, self.most_Nm = system, most_Nm
        every = max(t.every for t in system.tasks)
        self.wait = max(3 * every, LEAST_WAIT)
        self.arm = max(SETTLE_TICKS, 2 * every)
        self.start = self.arm + ARMED_TICKS
        self.end = self.start + MOVE_TICKS
        self.ticks = self.end + max(REST_TICKS, every + 1)
        self.tunables = zeros_missing(system)
        low, high = (_default(system, "limits", f"rom_{end}_rad") for end in ("min", "max"))
        self.middle = 0.5 * (low + high)
        # The nominal drive answers to the command: motor and motion may not contradict each other.
        (observer,) = (b for b in system.kinds if b.name == "drive_observer")
        numbers = {c.name: c.value for c in observer.constants}
        self.drive = NominalDrive(numbers, system.base_period_s, self.middle)
        self.columns = tuple(self._columns())
        self.held = {x.name: _rest(x.port) for x in system.inputs}
        self.run = _Run(system, self.tunables, self.held)

    def of(self, port: str) -> tuple[External, ...]:
        """External inputs that feed a port of that name."""
        return tuple(x for x in self.system.inputs if any(s.port == port for s in x.signals))

    def _columns(self) -> Iterator[tuple[Column, Callable[[int], float]]]:
        angles: dict[str, Callable[[int], float]] = {
            "motor": lambda _: self.drive.theta_rad,
            "load": self._load,
            "gear": lambda _: self.drive.theta_rad * self.drive.numbers["gear_ratio"],
        }
        for x in self.of("count"):
            instance = x.signals[0].instance
            count = _encoder(self.system.blocks[instance], self.tunables.get(instance, {}))
            yield Column(x.name, (x,)), partial(self._counted, count, angles[_side(x)])
        yield (Column("mode", self.of("mode")), lambda k: float(k >= self.start and Mode.TORQUE))
        yield Column("rearm", self.of("rearm")), lambda k: float(k >= self.arm)
        wanted = (*self.of("tau_desired_Nm"), *self.of("tau_preview_Nm"))
        if wanted:
            yield Column("tau_desired_Nm", wanted), self._wanted

    @staticmethod
    def _counted(
        count: Callable[[float], float], angle_rad: Callable[[int], float], k: int
    ) -> float:
        return count(angle_rad(k))

    def _load(self, k: int) -> float:
        return self.middle + LOAD_RATE_RAD_S * max(k - self.start, 0) * self.system.base_period_s

    def _wanted(self, k: int) -> float:
        if not self.start <= k < self.end:
            return 0.0
        wave = self.most_Nm * _wave(1.5 * (k - self.start) / MOVE_TICKS)
        return round(wave / WANTED_LATTICE_NM) * WANTED_LATTICE_NM

    def tick(self, k: int) -> tuple[tuple[float, ...], dict[str, float]]:
        """Inputs at a tick, by column, and expected outputs."""
        given = tuple(value(k) for _, value in self.columns)
        columns = zip(self.columns, given, strict=True)
        return given, self.run.tick({x.name: v for (c, _), v in columns for x in c.feeds})


def _outputs(system: System, kind: str, port: str) -> tuple[External, ...]:
    return tuple(x for x in system.outputs if _sink(system, x) == (kind, port))


def drive_example(system: System) -> DriveExample:
    """A recording of the encoders on which the latch opens and torque control runs."""
    largest = _default(system, "limits", "tau_max_Nm")
    said = ""
    for share in SHARES:
        made, said = _tried(system, share * largest)
        if not said:
            return made
    raise UserError(
        f"{system.name}: the example program cannot show the drive at work: {said}.",
        "Look at the limits of [safety], [joint] and [encoder] in the device file, and at what the "
        "law commands in mode 0.",
    )


def _tried(system: System, most_Nm: float) -> tuple[DriveExample, str]:
    # The example, and why it does not show the drive at work; empty when it does.
    recording = _Recording(system, most_Nm)
    commands, faults = (_outputs(system, "limits", port) for port in ("u_Nm", "fault"))
    torques = _outputs(system, "sensor", "tau_Nm")
    checked = (*commands, *torques, *faults)
    rows = []
    for k in range(recording.ticks):
        given, out = recording.tick(k)
        tau = out[torques[0].name] if torques else 0.0
        recording.drive.move(out[commands[0].name], tau)
        rows.append(RecordedTick(given, tuple(_number(out[x.name]) for x in checked)))
    at = {_axis(system, u, "limits"): u for u in commands}
    axes = tuple(Axis(at[_axis(system, fault, "limits")], fault) for fault in faults)
    columns = tuple(c for c, _ in recording.columns)
    moved = {x.name for c in columns for x in c.feeds}
    (stop,), (rearm,) = recording.of("stop"), recording.of("rearm")
    made = DriveExample(
        columns,
        tuple(rows),
        checked,
        {n: v for n, v in recording.held.items() if n not in moved},
        axes,
        recording.of("mode"),
        stop,
        rearm,
        recording.wait,
        1,
        all(out[a.command.name] != 0.0 for a in axes),
        tuple((i, n, v) for i, values in recording.tunables.items() for n, v in values.items()),
    )
    for x in faults:
        if out[x.name] != Fault.NONE:
            reason = Fault(round(out[x.name]))
            return made, f"on its recording {x.name} is {reason}: {FAULT_TEXT[reason]}"
    return made, _latch_fails(made, recording.run)


def _latch_fails(made: DriveExample, run: _Run) -> str:
    # What the C is asked, asked of the symbols: empty when the latch does as the program demands.
    def held(count: int, given: Mapping[str, float], fault: float) -> bool:
        good = True
        for _ in range(count):
            out = run.tick(given)
            for a in made.axes:
                good &= out[a.fault.name] == fault
                good &= fault == Fault.NONE or out[a.command.name] == 0.0
        return good

    def mode(value: float) -> dict[str, float]:
        return {m.name: value for m in made.modes}

    stop, rearm = made.stop.name, made.rearm.name
    asked = (
        ("a stop does not latch", 1, {stop: 1.0}, Fault.STOP),
        ("the latch opens when the stop is over", made.wait, {stop: 0.0}, Fault.STOP),
        ("rearm opens it in torque mode", made.wait, {rearm: made.rearmed + 1.0}, Fault.STOP),
        ("mode 0 opens it", made.wait, mode(Mode.OFF), Fault.STOP),
        ("rearm in mode 0 does not open it", 1, {rearm: made.rearmed + 2.0}, Fault.NONE),
        ("torque mode closes it again", made.wait, mode(Mode.TORQUE), Fault.NONE),
    )
    for said, count, given, fault in asked:
        if not held(count, given, float(fault)):
            return said
    if made.driven and any(run.out[a.command.name] == 0.0 for a in made.axes):
        return "after the latch was opened again, the motor is not driven"
    return ""
