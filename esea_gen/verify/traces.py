"""Committed traces: outputs of every shipped System on one fixed stream, as text.

For a drive, a person moves the joint and the nominal drive follows the motor.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.control.laws.predictive import device_horizon
from esea_gen.device import Device, load_device
from esea_gen.devices.file import shipped_devices
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.language.ports import Array
from esea_gen.language.system import External, System
from esea_gen.model.drive import NominalDrive
from esea_gen.model.sensing import zeros_missing
from esea_gen.tables import TableFormat, read_table

MARK = "# esea-gen trace"
EVERY = 20  # steps a row
TOLERANCE = 1e-9  # of full scale, and of the value: libm differs between machines by less
DIGITS = 10
LATTICE_BITS = 15
STORED = TableFormat(kind="csv", delimiter=",", decimal=".")
ACCEPT = "Accept with: esea-gen traces accept"


@dataclass(frozen=True)
class TracePart:
    name: str
    duration_s: float


PARTS = (
    TracePart("rest at zero", 0.2),
    TracePart("chirp in the domain", 3.0),
    TracePart("shrinking reversals", 1.5),
    TracePart("held deflection", 0.5),
    TracePart("beyond the domain", 1.0),
    TracePart("invalid samples", 0.8),
    TracePart("jumps", 0.4),
    TracePart("back to rest", 0.6),
)


@dataclass(frozen=True)
class Trace:
    """A System's answer, every so many steps."""

    device: str
    period_s: float
    steps: Array
    inputs: dict[str, Array]
    outputs: dict[str, Array]
    flags: dict[str, tuple[str, ...]]
    full_scale: dict[str, float]

    def text(self) -> str:
        out = io.StringIO()
        out.write(
            f"{MARK}: {self.device}, a tick of {self.period_s:.9g} s, every {EVERY}th step.  A "
            "status word has all bits set since the row above.\n"
        )
        writer = csv.writer(out, lineterminator="\n")
        columns = self.inputs | self.outputs
        writer.writerow(["step", *columns])
        for k, step in enumerate(self.steps.astype(int).tolist()):
            writer.writerow([step, *(_number(c[k], n in self.flags) for n, c in columns.items())])
        return out.getvalue()


def _number(value: float, whole: bool) -> str:
    return str(int(value)) if whole else f"{value + 0.0:.{DIGITS}g}"  # + 0.0: no negative zero


def trace_stream(device: Device) -> tuple[dict[str, Array], list[TaskRun]]:
    """The fixed stream of a device, the parts of ``PARTS`` in turn; and its tasks' outputs."""
    system, domain = device.system, device.file.domain
    rate_Hz = 1.0 / system.base_period_s
    top_Hz = 0.8 * domain.omega_max_rad_s.value / (2 * math.pi * domain.theta_max_rad.value)
    if device.laws:
        high = device.file.limits.theta_rad.value
        reach = 0.95 * domain.theta_max_rad.value
        return drive_stream(device, _pieces(rate_Hz, reach, high, top_Hz, 0))
    stream = {}
    for n, (name, external, _) in enumerate(scalars(system.inputs)):
        high = min(external.port.high, -external.port.low)
        angle = external.port.unit == "rad"
        reach = min(0.95 * domain.theta_max_rad.value, high) if angle else 0.55 * high
        grid = 2.0 ** (math.frexp(high)[1] - LATTICE_BITS)
        stream[name] = np.round(_pieces(rate_Hz, reach, high, top_Hz, n) / grid) * grid
    return stream, list(play(system, stream))


def _pieces(rate_Hz: float, reach: float, high: float, top_Hz: float, n: int) -> Array:
    counts = [max(1, round(part.duration_s * rate_Hz)) for part in PARTS]
    # Of each part, the share of it that is over.
    shares = [np.arange(count) / count for count in counts]
    pairs = zip(PARTS, shares, strict=True)
    return np.concatenate([_piece(part, s, reach, high, top_Hz, n) for part, s in pairs])


def _piece(part: TracePart, s: Array, reach: float, high: float, top_Hz: float, n: int) -> Array:
    phase = 0.9 * n
    if part.name == "chirp in the domain":
        turns = 0.5 * top_Hz * part.duration_s * s * s
        fade = np.minimum(1.0, 8.0 * s) if n else 1.0  # a phase shift does not start at zero
        return reach * fade * np.sin(2 * np.pi * turns + phase)
    if part.name == "shrinking reversals":
        triangle = np.abs((5.0 * s + 0.25 * (1 + n)) % 1.0 - 0.5) * 4.0 - 1.0
        return reach * triangle * (1.0 - 0.7 * s)
    if part.name == "held deflection":
        return np.full(len(s), 0.4 * reach * (-1.0) ** n)
    if part.name == "beyond the domain":
        return 0.97 * high * np.sin(2 * np.pi * s + phase)
    wave = 0.5 * reach * np.sin(4 * np.pi * s + phase)
    if part.name == "invalid samples":
        bad = (np.nan, np.inf, -np.inf, 1.5 * high, -3.0 * high)
        for k, at in enumerate(range(7 + 3 * n, len(s), 61)):
            wave[at : at + 1 + 4 * (k % 3)] = bad[(k + n) % len(bad)]
        return wave
    if part.name == "jumps":
        return 0.8 * reach * (-1.0) ** (n + np.floor(6 * s))
    return np.zeros(len(s))


def run_trace(device: Device) -> Trace:
    system = device.system
    columns = scalars(system.outputs)
    flags = {n: tuple(f.name for f in x.port.flags) for n, x, _ in columns if x.port.flags}
    stream, runs = trace_stream(device)
    rows: Any = np.arange(EVERY - 1, len(next(iter(stream.values()))), EVERY)
    kept = {n: np.zeros(len(rows), int if n in flags else float) for n, _, _ in columns}
    made_by = {t.name: scalars(system.task_outputs(t)) for t in system.tasks}
    for k, task, made in runs:
        row = k // EVERY
        for name, x, i in made_by[task]:
            value = made[x.name] if x.port.size == 1 else made[x.name][i]
            if name in flags:  # all that was told since the row before
                kept[name][row : row + 1] |= int(value)
            else:
                kept[name][row:] = value
    return Trace(
        device.name,
        system.base_period_s,
        rows,
        {n: a[rows] for n, a in stream.items()},
        {n: v.astype(float) for n, v in kept.items()},
        flags,
        {n: _full_scale(device, x) for n, x, _ in columns if not x.port.flags},
    )


def _full_scale(device: Device, external: External) -> float:
    domain = device.file.domain
    return {
        "Nm": domain.tau_full_scale_Nm.value,
        "rad": domain.theta_max_rad.value,
        "rad/s": domain.omega_max_rad_s.value,
    }.get(external.port.unit, max(abs(external.port.low), abs(external.port.high)))


def _read(text: str) -> tuple[list[str], dict[str, Array]]:
    table = read_table(Path("stored trace"), form=STORED, raw=text.encode())
    return list(table.names), {n: table.numbers(n, holes=True) for n in table.names}


def differences(trace: Trace, text: str) -> list[str]:
    try:
        names, old = _read(text)
        steps = old["step"]
    except (UserError, KeyError) as error:
        return [f"{trace.device}: the stored trace cannot be read ({error})"]
    columns = trace.inputs | trace.outputs
    kind = {n: "input" if n in trace.inputs else "output" for n in columns}
    found = [f"{trace.device}: {kind[n]} {n} added" for n in columns if n not in names]
    found += [
        f"{trace.device}: column {n} removed" for n in names if n != "step" and n not in columns
    ]
    if not np.array_equal(steps, trace.steps):
        return [
            *found,
            f"{trace.device}: the stream is another one: {len(old['step'])} rows to step "
            f"{old['step'][-1]:.0f}, now {len(trace.steps)} to {trace.steps[-1]}",
        ]
    for name, new in columns.items():
        if name in old:
            found += _column(trace, name, old[name], new)
    return found


def _column(trace: Trace, name: str, old: Array, new: Array) -> list[str]:
    if name in trace.flags:
        changed = np.flatnonzero(old != new)
    else:
        scale = trace.full_scale.get(name, 0.0)
        with np.errstate(invalid="ignore"):
            near = np.abs(new - old) <= TOLERANCE * (scale + np.abs(old))
        changed = np.flatnonzero(~(near | (new == old) | (np.isnan(new) & np.isnan(old))))
    if not len(changed):
        return []
    first = changed[0]
    rows = f"{len(changed)} of {len(new)} rows differ"
    where = f"from {_where(trace, first)} on" if len(changed) > 1 else f"at {_where(trace, first)}"
    if name in trace.flags:
        a, b = (_bits(int(v), trace.flags[name]) for v in (old[first], new[first]))
        return [f"{trace.device}: {name} {where}: {a} -> {b}; {rows}"]
    text = (
        f"{trace.device}: {name} {where}: {_number(old[first], False)} -> "
        f"{_number(new[first], False)}; {rows}"
    )
    if name in trace.full_scale:
        change = np.abs(new - old)
        worst = changed[np.argmax(np.nan_to_num(change[changed], nan=np.inf))]
        share = 100 * change[worst] / trace.full_scale[name]
        text += f"; largest change {share:.3g} % of full scale, {_where(trace, worst)}"
    return [text]


def _where(trace: Trace, row: int) -> str:
    step = int(trace.steps[row])
    end = 0
    for part in PARTS:
        end += max(1, round(part.duration_s / trace.period_s))
        if step < end:
            return f"step {step} ({part.name})"
    return f"step {step}"


def _bits(word: int, names: tuple[str, ...]) -> str:
    present = [n for i, n in enumerate(names) if word >> i & 1]
    return "|".join(present) or "0"


def _compared(
    folder: Path, devices: Mapping[str, Device] | None
) -> Iterator[tuple[Path, Trace | None, list[str]]]:
    # Per file: what it should hold, None for nothing, and what differs.
    shipped = sorted(shipped_devices()) if devices is None else ()
    chosen = devices or {name: load_device(name) for name in shipped}
    for name, device in chosen.items():
        path, trace = folder / f"{name}.csv", run_trace(device)
        found = [f"{name}: no trace is stored yet"]
        if path.is_file():
            found = differences(trace, path.read_text(encoding="utf-8"))
        yield path, trace, found
    for path in sorted(folder.glob("*.csv")) if devices is None else ():
        if path.stem not in chosen and path.read_text(encoding="utf-8").startswith(MARK):
            yield path, None, [f"{path.stem}: a trace is stored, but there is no such device"]


def check_traces(folder: Path, devices: Mapping[str, Device] | None = None) -> list[str]:
    return [line for _, _, lines in _compared(folder, devices) for line in lines]


def accept_traces(folder: Path, devices: Mapping[str, Device] | None = None) -> list[str]:
    found = []
    for path, trace, lines in _compared(folder, devices):
        if trace is None:
            path.unlink()
        elif lines:
            write_whole(path, trace.text())
        found += lines
    return found


# From here on the drive stands where it was, and the joint is put where the deflection wants it.
LET_GO_S = 5.2
MIDDLE_RAD, MOVED_RAD, MOVED_HZ = 0.8, 0.25, 0.4


def scalars(externals: Iterable[External]) -> list[tuple[str, External, int]]:
    """Name, external and element of every column: a vector takes one an element."""
    return [
        (x.name if x.port.size == 1 else f"{x.name}[{i}]", x, i)
        for x in externals
        for i in range(x.port.size)
    ]


TaskRun = tuple[int, str, Mapping[str, Any]]
"""Its tick, the task, its outputs."""


def play(
    system: System, stream: Mapping[str, Array], before: Callable[[int], None] = lambda k: None
) -> Iterator[TaskRun]:
    """Run a symbolic System over a stream; ``before`` may set a tick's measurements."""
    simulator = system.simulator(zeros_missing(system))
    inputs = {t.name: system.task_inputs(t) for t in system.tasks}
    for k in range(len(next(iter(stream.values())))):
        before(k)
        simulator.release(k)
        for task in system.tasks:
            if k >= task.phase and (k - task.phase) % task.every == 0:
                given = {
                    x.name: stream[x.name][k]
                    if x.port.size == 1
                    else np.array([stream[f"{x.name}[{i}]"][k] for i in range(x.port.size)])
                    for x in inputs[task.name]
                }
                yield k, task.name, simulator.step(task.name, **given)


def drive_stream(device: Device, deflection_rad: Array) -> tuple[dict[str, Array], list[TaskRun]]:
    """Every external input of a drive, a row a tick; and the outputs of its tasks."""
    system, a = device.system, device.file.actuator
    assert a is not None
    rate_Hz = 1.0 / system.base_period_s
    full = 2.0**device.file.encoder.resolution_bits.value
    time_s = np.arange(len(deflection_rad)) / rate_Hz
    signals = _told(device, time_s)
    load = MIDDLE_RAD + MOVED_RAD * (1 - np.cos(2 * np.pi * MOVED_HZ * time_s))
    stream = {
        name: signals.get(_without_axis(name, device.axes), np.zeros(len(time_s)))
        for name, _, _ in scalars(system.inputs)
    }
    numbers = {c.name: c.value for c in device.constants("actuator")}
    drive = NominalDrive(numbers, system.base_period_s, float(load[0]))
    command, torque = (
        next(x.name for x in system.outputs if _without_axis(x.name, device.axes) == name)
        for name in ("u_Nm", "tau_Nm")
    )
    counts = {n: _without_axis(n, device.axes) for n in stream if n.startswith("count_")}
    stream |= {n: np.zeros(len(time_s)) for n in counts}

    def measure(k: int) -> None:
        side, held = drive.theta_rad, time_s[k] >= LET_GO_S
        angles = {
            "count_motor": (side, 1.0, full),
            "count_load": (side - deflection_rad[k] if held else load[k], 1.0, full),
            "count_gear": (side, a.gear_ratio.value, 2.0**a.encoder_bits.value),
        }
        for name, kind in counts.items():
            stream[name][k] = _count(*angles[kind])

    runs = []
    for k, task, out in play(system, stream, measure):
        runs.append((k, task, out))
        if command in out and time_s[k] < LET_GO_S:
            drive.move(float(out[command]), float(out[torque]))
    return stream, runs


def _count(angle_rad: float, turns: float, full: float) -> float:
    raw = np.floor(angle_rad * turns / (2 * np.pi) * full)
    return float(raw % full if np.isfinite(raw) else raw)


def _told(device: Device, time_s: Array) -> dict[str, Array]:
    # Laws change while torque is wanted; a device with one law has no such input.
    def between(start_s: float, end_s: float) -> Array:
        return ((time_s >= start_s) & (time_s < end_s)).astype(float)

    n = len(time_s)
    desired = 0.5 * np.sin(2 * np.pi * 0.7 * time_s)
    signals = {
        "frame_error_load": 2.0 * between(2.6, 2.602),
        "frame_error_gear": 1.0 * between(1.1, 1.102),
        "mode": 1.0 * between(0.06, 1.6) + 2.0 * between(1.6, 2.9) + between(3.4, 9.0),
        "stop": between(2.9, 2.92),
        "rearm": 1.0 * between(0.03, 3.2) + 2.0 * between(3.2, 9.0),
        "tau_desired_Nm": np.round(desired * 2**12) / 2**12,
        "theta_desired_rad": MIDDLE_RAD * np.ones(n),
        "omega_desired_rad_s": np.zeros(n),
        "law": 1.0 * between(0.7, 1.3) + between(2.0, 2.5),
    }
    ahead = np.rint(np.array(device_horizon(device).ends_s) / device.system.base_period_s)
    for name in ("tau", "theta", "omega"):
        unit = "Nm" if name == "tau" else "rad" if name == "theta" else "rad_s"
        wanted = signals[f"{name}_desired_{unit}"]
        for i, ticks in enumerate(ahead.astype(int)):
            at = np.minimum(np.arange(n) + ticks, n - 1)
            signals[f"{name}_preview_{unit}[{i}]"] = wanted[at]
    return signals


def _without_axis(name: str, axes: Iterable[str]) -> str:
    for axis in filter(None, axes):
        name = re.sub(rf"_{axis}(?=_|$)", "", name)
    return name
