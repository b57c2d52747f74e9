"""Recordings: load, check and convert; replay at a device's rate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.devices.numbers import Quantity
from esea_gen.devices.rubber import COLDEST_C, HOTTEST_C
from esea_gen.errors import UserError
from esea_gen.identify.recording.conditions import LEAST_APART_K, divided
from esea_gen.identify.recording.cycles import data_sets, divide
from esea_gen.identify.recording.mapping import MappingFile, load_mapping
from esea_gen.identify.recording.proposal import named
from esea_gen.identify.recording.quality import (
    MOST_SPIKES,
    Finding,
    Mask,
    bridged,
    examined,
    jumps,
    runs,
    spikes,
)
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.tables import KINDS, TIME, Mapping, RecordingTable, ToFit
from esea_gen.language.ports import Array
from esea_gen.tables import MARK, FileTable, read_table
from esea_gen.tables.table import held_rows

MIN_SAMPLES = 50
MAX_DROPPED = 0.01  # share of samples that the glitch rule may drop
MOST_STEPS = 2e7  # of the sensing task over a recording: 5.5 h at 1 kHz
LEAST_STEP = 0.02  # a recording's usual step, over the sensing period
HELD_BAND = 0.02  # of its range: a deflection that stays within it is held
MAX_STIFFNESS_NM_RAD = 1000.0  # bound of k1
TURNED = Finding("sign", "the torque fell with the deflection; its sign was reversed", False)
KELVIN_AT_0_C = 273.15
MAX_THETA_RAD, MAX_TAU_NM = 3.2, 1000.0  # bounds of the device file's ranges


def load_recordings(source: MappingFile) -> list[Recording]:
    """Load every recording of a mapping that leaves no number to the fit."""
    for key, q in source.fittable().items():
        if isinstance(q, ToFit):
            raise UserError(
                f"{source.origin}: {key} = 'fit' works with esea-gen identify only.",
                "Write its result here, from its notes or from channels in its JSON.",
            )
    files = source.paths()
    labels = _labels(source.origin, [(name, table) for _, name, table in files])
    loaded = [
        _load(source, path, name, table, label)
        for (path, name, table), label in zip(files, labels, strict=True)
    ]
    _check_conditions(source, loaded)
    _check_turned(source, loaded)
    loaded = divided(loaded, source.mapping.cycles)
    for what, role in (("train on", "training"), ("hold out", "held_out")):
        if not any(len(getattr(s, role)) for r in loaded for s in r.sets):
            found = ", ".join(f"{r.file}: {len(r.cycles)}" for r in loaded)
            c = source.mapping.cycles
            raise UserError(
                f"{source.origin}: no cycle is left to {what} (cycles found - {found}; "
                f"cycles.skip_first = {c.skip_first}, cycles.hold_out_last = {c.held_out_last})"
                + "".join(f"; {r.label}: {f.text}" for r in loaded for f in r.findings)
                + ".",
                "Lower these, or give whole files use = 'train' and use = 'held_out'.",
            )
    return loaded


def _check_turned(source: MappingFile, loaded: list[Recording]) -> None:
    turned = [r.file for r in loaded if TURNED in r.findings]
    if turned and len(turned) < len(loaded):
        straight = next(r.file for r in loaded if r.file not in turned)
        raise UserError(
            f"{source.origin}: torque.sign = 'fit' turns {turned[0]} round and {straight} not.",
            "One rig has one sign: leave out the wrong file.",
        )


def _check_conditions(source: MappingFile, loaded: list[Recording]) -> None:
    for c in source.mapping.condition:
        if not any(c.name in r.conditions for r in loaded):
            raise UserError(
                f"{source.origin}: condition '{c.name}': none of the recordings is named "
                f"{' or '.join(c.files)}.",
                "Give names or patterns of files that [[recording]] has.",
            )


def _labels(origin: str, files: list[tuple[str, RecordingTable]]) -> list[str]:
    """Give every file a label of its own."""
    stems = [Path(name).stem for name, _ in files]
    labels: list[str] = []
    for (name, table), stem in zip(files, stems, strict=True):
        own = stem if stems.count(stem) == 1 else str(Path(name).with_suffix("").as_posix())
        label = own
        if table.label:
            several = sum(t is table for _, t in files) > 1
            label = f"{table.label} {own}" if several else table.label
        if label in labels:
            raise UserError(
                f"{origin}: the label '{label}' of '{name}' is used by another recording.",
                "Give every recording its own label.",
            )
        labels.append(label)
    return labels


def _load(
    source: MappingFile, path: Path, name: str, table: RecordingTable, label: str
) -> Recording:
    m = source.mapping
    thermometer = m.temperature and m.temperature.column
    more = (m.sampling.time_column, thermometer)
    wanted = [m.deflection.column, m.torque.column, *(c for c in more if c)]
    form = table.format or m.format
    read = read_table(path, wanted, form, name=name, settings="[format] of the mapping")
    label += MARK * read.simulated
    columns, rows = {w: read.numbers(w) for w in wanted}, read.lines
    if len(rows) < MIN_SAMPLES:
        raise UserError(
            f"{name}: has {len(rows)} samples, below the limit of {MIN_SAMPLES}.",
            "Record some cycles, or check first_data_line in the mapping's format.",
        )
    theta = columns[m.deflection.column] * source.rad_per_unit
    tau = columns[m.torque.column] * source.Nm_per_unit
    dropped = 0
    if m.sampling.time_column:
        unit = m.sampling.time_unit
        time = columns[m.sampling.time_column] * TIME[unit]
        keep = _keep(time, m.sampling.min_step_s)
        dropped = len(time) - len(keep)
        if dropped > MAX_DROPPED * len(time):
            raise UserError(
                f"{name}: sampling.min_step_s = {m.sampling.min_step_s:g} s would drop {dropped} "
                f"of {len(time)} samples, above the limit of {MAX_DROPPED:.0%}: which is too many "
                "for glitches.",
                f"Lower it; the median step is {np.median(np.diff(time)):g} s.",
            )
        time, theta, tau, rows = time[keep], theta[keep], tau[keep], rows[keep]
        _check_time(time, rows, name, m.sampling.time_column, unit, read.unit_of_rows)
        time = time - time[0]
    else:
        assert m.sampling.period_s is not None
        time = np.arange(len(theta), dtype=np.float64) * m.sampling.period_s.value
    theta, tau = _zeroed(theta, m.deflection.zero), _zeroed(tau, m.torque.zero)
    _check_length(source, name, time)
    if m.torque.lag_s is not None:
        time, theta, tau = _without_lag(name, m.torque.lag_s.value, time, theta, tau)
    time, theta, tau, stale, held = _updated(time, theta, tau)
    jumped = jumps(theta)
    theta = bridged(theta, jumped)
    gap = m.deflection.backlash_rad
    theta = followed_rad(theta, gap.value) if gap else theta
    if np.ptp(theta) <= 1e-9:
        raise UserError(
            f"{name}: the deflection is constant (column '{m.deflection.column}').",
            "Check the column, unit and scale in the mapping file.",
        )
    spiky = spikes(theta, tau)
    recorded, tau = tau, bridged(tau, spiky)
    turned = m.torque.sign == "fit" and _stiffness(theta, tau) < 0
    tau = -tau if turned else tau
    _check_physics(source, name, theta, tau)
    cycles = divide(theta, m.cycles, table.use)
    timed = m.sampling.period_s is None or m.sampling.period_s.status != "assumed"
    spoilt, worse = examined(time, theta, tau, cycles, timed)
    return Recording(
        label=label,
        file=name,
        digest=read.digest,
        time_s=time,
        theta_rad=theta,
        tau_Nm=tau,
        timed=timed,
        dropped=dropped,
        cycles=cycles,
        sets=data_sets(label, theta, tau, cycles, table.use, spoilt | spiky | jumped | stale),
        conditions=tuple(c.name for c in m.condition if any(fnmatch(name, p) for p in c.files)),
        findings=(
            *_unlike_names(m),
            *held,
            *_findings(read, jumped, spiky, recorded, turned, gap),
            *worse,
        ),
        temperature_C=_temperature(m, table, name, columns),
        simulated=read.simulated,
    )


def _updated(
    time: Array, theta: Array, tau: Array
) -> tuple[Array, Array, Array, Mask, tuple[Finding, ...]]:
    # A channel of a lower rate than the rows': drawn straight between its own values, the torque's
    # if both are, which alone train and judge. A deflection may have turned between two.
    channels, findings, end = {"deflection": theta, "torque": tau}, [], len(time)
    stale, rate_Hz = np.zeros(len(time), dtype=bool), 1 / float(np.median(np.diff(time)))
    for what, x in channels.items():
        if (rows := held_rows(x)) > 1:
            stale = np.diff(x, prepend=np.nan) == 0
            channels[what], end = bridged(x, stale), min(end, 1 + int(np.flatnonzero(~stale)[-1]))
            text = (
                f"the {what} has a new value in every {rows}. row only ({rate_Hz / rows:.3g} Hz, "
                f"the rows {rate_Hz:.3g} Hz): the rows between are interpolated and neither train "
                "nor judge; record it at the rows' rate"
            )
            findings.append(Finding(f"{what} held", text, what == "deflection"))
    theta, tau = channels.values()
    return time[:end], theta[:end], tau[:end], stale[:end], tuple(findings)


def _without_lag(
    name: str, lag_s: float, time: Array, theta: Array, tau: Array
) -> tuple[Array, Array, Array]:
    # The torque that was recorded later, interpolated; the ends that have none are dropped.
    later = time + lag_s
    known = (later >= time[0]) & (later <= time[-1])
    if np.count_nonzero(known) < MIN_SAMPLES:
        raise UserError(
            f"{name}: torque.lag_s = {lag_s:g} s leaves {np.count_nonzero(known)} samples, below "
            f"the limit of {MIN_SAMPLES}.",
            "Correct it; the unit is seconds.",
        )
    tau = resample(time, tau, later)[known]
    return time[known] - time[known][0], theta[known], tau


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count > 1 else ''}"


def _unlike_names(m: Mapping) -> Iterator[Finding]:
    # A column's name that states another unit of the same kind: one of the two is wrong.
    pairs = [(t.column, t.unit) for t in (m.deflection, m.torque)]
    for column, unit in (*pairs, (m.sampling.time_column or "", m.sampling.time_unit)):
        stated = named(column)[1]
        if stated != unit and any({stated, unit} <= {*kind} for kind in KINDS):
            text = f"the name of column '{column}' states {stated}, the mapping {unit}"
            yield Finding("unit", text, True)


def _findings(
    read: FileTable, jumped: Mask, spiky: Mask, tau: Array, turned: bool, gap: Quantity | None
) -> Iterator[Finding]:
    # In the order in which the file was worked on; tau still has its spikes.
    if not read.usual:
        yield Finding("read as", f"read as {read.how()}", False)
    if read.simulated:
        yield Finding("simulated", "the recording is simulated, by its column of that name", True)
    if np.any(jumped):
        many = _counted(int(np.count_nonzero(jumped)), "sample")
        text = f"{many} at which the deflection jumps and comes back, bridged; they neither train"
        yield Finding("jumps", f"{text} nor judge", False)
    if np.any(spiky):
        count, found = int(np.count_nonzero(spiky)), len(runs(spiky))
        wide = f" ({count} samples)" if count > found else ""
        largest = float(np.abs(tau[spiky]).max())
        text = f"{_counted(found, 'spike')}{wide} in the torque, up to {largest:.4g} Nm"
        if found > MOST_SPIKES * len(tau):
            yield Finding("noise", f"{text}: more than {MOST_SPIKES:.0%} of all samples", True)
        else:
            yield Finding("spikes", f"{text}, neither train nor judge", False)
    if turned:
        yield TURNED
    if gap is not None and gap.value:
        # The encoders of a device stand where the recording's did, before the gap.
        text = (
            f"a backlash of {gap.value:.3g} rad is taken out of the deflection: the model is of "
            "the rubber behind it, and a device whose encoders see the gap too has no term for it"
        )
        yield Finding("backlash taken out", text, True)


def _temperature(
    m: Mapping, table: RecordingTable, name: str, columns: dict[str, Array]
) -> float | None:
    # One a recording: the mean of its column.
    if m.temperature is None:
        return None if table.temperature_C is None else table.temperature_C.value
    values = columns[m.temperature.column] - (KELVIN_AT_0_C if m.temperature.unit == "K" else 0.0)
    low, high = float(values.min()), float(values.max())
    if low < COLDEST_C or high > HOTTEST_C:
        raise UserError(
            f"{name}: column '{m.temperature.column}' goes from {low:.4g} to {high:.4g} degC, "
            f"outside {COLDEST_C:g} to {HOTTEST_C:g} degC.",
            'Check temperature.unit: "C" or "K".',
        )
    if high - low > LEAST_APART_K:
        raise UserError(
            f"{name}: the temperature goes from {low:.4g} to {high:.4g} degC, by more than "
            f"{LEAST_APART_K:g} K: a recording has one temperature.",
            "Cut it into files that are each within that.",
        )
    return float(values.mean())


def _check_length(source: MappingFile, name: str, time: Array) -> None:
    rate, s = source.mapping.device.sense_rate_Hz.value, source.mapping.sampling
    where = "sampling.period_s" if s.period_s else f"sampling.time_unit = '{s.time_unit}'"
    steps = np.diff(time)
    jump = int(np.argmax(steps))
    if time[-1] * rate > MOST_STEPS:
        raise UserError(
            f"{name}: lasts {time[-1]:.4g} s, {time[-1] * rate:.3g} steps at "
            f"device.sense_rate_Hz = {rate:g} Hz, above the limit of {MOST_STEPS:g}; its longest "
            f"step between samples is {steps[jump]:.4g} s, after sample {jump + 1} of {len(time)}.",
            f"Check {where}, mend the clock's jump, or give the recording in parts.",
        )
    usual = float(np.median(steps))
    if usual * rate < LEAST_STEP:
        raise UserError(
            f"{name}: its usual step between samples is {usual:.3g} s, below the limit of "
            f"{LEAST_STEP:g} of the sensing period {1 / rate:g} s.",
            f"Check {where}; thin the recording if it was that fast.",
        )


def _keep(time: Array, min_step_s: float | None) -> npt.NDArray[np.intp]:
    """Samples that the glitch rule keeps: at least ``min_step_s`` after the last kept one."""
    if min_step_s is None:
        return np.arange(len(time), dtype=np.intp)
    kept, last = [], -math.inf
    for i, t in enumerate(time.tolist()):
        if t - last >= min_step_s:
            kept.append(i)
            last = t
    return np.array(kept, dtype=np.intp)


def _check_time(
    time: Array, rows: npt.NDArray[np.intp], name: str, column: str, unit: str, row: str = "row"
) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i = int(back[0])
        a, b = time[i] / TIME[unit], time[i + 1] / TIME[unit]
        verb = "stands still" if a == b else "goes backwards"
        raise UserError(
            f"{name}: time {verb} in column '{column}': {a:.10g} {unit} in {row} {rows[i]}, "
            f"then {b:.10g} {unit} in {row} {rows[i + 1]} ({len(back)} such step"
            f"{'s' if len(back) > 1 else ''}).",
            "Repair the recording, or drop single bad samples with sampling.min_step_s (they are "
            "counted and reported).",
        )


def _check_physics(source: MappingFile, name: str, theta: Array, tau: Array) -> None:
    factor = source.mapping.device.limit_factor
    for what, value, unit, limit in (
        ("deflection", np.abs(theta).max(), "rad", MAX_THETA_RAD / factor),
        ("torque", np.abs(tau).max(), "Nm", MAX_TAU_NM),
    ):
        if value > limit:
            raise UserError(
                f"{name}: the largest |{what}| is {value:.4g} {unit} after scaling, above the "
                f"limit of {limit:.4g} {unit}.",
                f"Check {what}.unit and {what}.scale in {source.origin}.",
            )
    slope = _stiffness(theta, tau)
    if slope <= 0:
        raise UserError(
            f"{name}: {'negative' if slope < 0 else 'no'} stiffness: torque against deflection has "
            f"the slope {slope:.4g} Nm/rad, not above its limit 0 Nm/rad.",
            f"Set sign = -1 in [deflection] or [torque] of {source.origin}, or correct the "
            "columns.",
        )
    if slope > MAX_STIFFNESS_NM_RAD:
        raise UserError(
            f"{name}: the stiffness is {slope:.4g} Nm/rad after scaling, above the limit of "
            f"{MAX_STIFFNESS_NM_RAD:g} Nm/rad.",
            f"Check units and scales in {source.origin}.",
        )


def _stiffness(theta: Array, tau: Array) -> float:
    # Most of a test of relaxation holds one deflection, where the torque relaxes: what counts is
    # how it rose before.
    way = np.abs(theta - theta[0])
    at_end = way >= (1 - HELD_BAND) * way.max()  # farthest from the first sample
    end = int(np.flatnonzero(at_end)[0]) + 1 if np.mean(at_end) > 0.5 else len(theta)
    theta, tau = theta[:end], tau[:end]
    x, y = theta - theta.mean(), tau - tau.mean()
    return float(x @ y / (x @ x)) if np.any(x) else 0.0


def _zeroed(x: Array, zero: str) -> Array:
    offset = {
        "none": 0.0,
        "first": float(x[0]),
        "mean": float(x.mean()),
        "middle": 0.5 * float(x.max() + x.min()),
    }[zero]
    return np.asarray(x - offset, dtype=np.float64)


def beyond_rad(theta_rad: Array, half_width_rad: float) -> Array:
    """Deflection beyond a dead zone, as the device's sensor takes it; 0 inside."""
    return np.asarray(theta_rad - np.clip(theta_rad, -half_width_rad, half_width_rad))


def followed_rad(theta_rad: Array, gap_rad: float) -> Array:
    """Deflection behind a gap: constant until the gap has been crossed."""
    half, at = 0.5 * gap_rad, float(theta_rad[0])
    out = []
    for x in theta_rad.tolist():
        at = min(max(at, x - half), x + half)
        out.append(at)
    return np.array(out)


def resample(time_s: Array, values: Array, grid_s: Array) -> Array:
    out: Any = np.interp(grid_s, time_s, values)
    return np.asarray(out, dtype=np.float64)


def recorded_deflections(
    device: Device, mapping: Path, data: Path | None = None
) -> dict[str, Array]:
    """Deflections of a mapping's recordings at a device's sensing rate, by label."""
    source, found = load_mapping(mapping, data), {}
    limit = device.file.limits.theta_rad.value
    for r in load_recordings(source):
        reach = float(np.max(np.abs(r.theta_rad)))
        if reach > limit:
            raise UserError(
                f"{source.origin}: {r.label} reaches {reach:.3g} rad, above {device.name}'s "
                f"limits.theta_rad = {limit:g} rad: every sample beyond it would be an invalid "
                "input.",
                "Change the mapping's deflection scale, or use a device with a wider limit.",
            )
        grid = np.arange(r.time_s[0], r.time_s[-1], device.period_s)
        found[r.label] = resample(r.time_s, r.theta_rad, grid)
    return found
