"""Recordings: load, check, convert, and divide into cycles."""

from __future__ import annotations

import csv
import difflib
import hashlib
import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.io

from esea_gen.errors import UserError
from esea_gen.identify.mapping import TIME, Cycles, FileFormat, MappingFile, RecordingTable

Array = npt.NDArray[np.float64]
Role = Literal["lead_in", "transition", "conditioning", "training", "held_out", "rest"]

MIN_SAMPLES = 50
MAX_DROPPED = 0.01  # share of samples that the glitch rule may drop
MAX_STIFFNESS_NM_RAD = 1000.0  # bound of k1
MAX_THETA_RAD, MAX_TAU_NM = 3.2, 1000.0  # bounds of the device file's ranges
ASYMMETRY_LIMIT = 0.05  # share of stiffness; ours, no figure is published
# How MATLAB files of version 5 and 7.3 begin.
MAT_MAGIC = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n")


@dataclass(frozen=True)
class Cycle:
    """One cycle, from a reversal to the next one of the same kind.

    amplitude_rad: half of the deflection's range.
    block: number of the block of equal amplitude, from 0.
    """

    start: int
    stop: int
    amplitude_rad: float
    block: int
    role: Role


@dataclass(frozen=True)
class DataSet:
    """What one error figure is given for: a block of equal amplitude, or a whole file.

    amplitude_rad: median amplitude of its cycles.
    asymmetry: stiffness to the positive extreme minus that to the negative one, over their mean;
        None when the deflection does not change sign.
    work_first_J, work_last_J: loss of the block's first full cycle and of its last; None with fewer
        than two cycles, without loss, or for a whole file.
    """

    label: str
    amplitude_rad: float
    training: npt.NDArray[np.intp]
    held_out: npt.NDArray[np.intp]
    cycles: dict[str, int]
    asymmetry: float | None
    work_first_J: float | None
    work_last_J: float | None

    @property
    def softening(self) -> float | None:
        """Share of the first cycle's loss that the last one no longer has (Mullins, scragging)."""
        if self.work_first_J is None or self.work_last_J is None or self.work_first_J <= 0:
            return None
        return 1 - self.work_last_J / self.work_first_J


@dataclass(frozen=True)
class Recording:
    """A recording in SI units, at its own samples.

    file: file name as the mapping gives it.
    digest: first 16 hexadecimal digits of the file's SHA-256.
    time_s, theta_rad, tau_Nm: shape (n,).
    timed: whether the time was recorded (or a period is published), not assumed.
    dropped: samples dropped by the glitch rule.
    """

    label: str
    file: str
    digest: str
    time_s: Array
    theta_rad: Array
    tau_Nm: Array
    timed: bool
    dropped: int
    cycles: tuple[Cycle, ...]
    sets: tuple[DataSet, ...]


def load_recordings(source: MappingFile) -> list[Recording]:
    """Load every recording of a mapping."""
    files = list(source.paths())
    labels = _labels(source.origin, [(name, table) for _, name, table in files])
    loaded = [
        _load(source, path, name, table, label)
        for (path, name, table), label in zip(files, labels, strict=True)
    ]
    for what, role in (("train on", "training"), ("hold out", "held_out")):
        if not any(len(getattr(s, role)) for r in loaded for s in r.sets):
            found = ", ".join(f"{r.file}: {len(r.cycles)}" for r in loaded)
            c = source.mapping.cycles
            raise UserError(
                f"{source.origin}: no cycle is left to {what} (cycles found - {found}; "
                f"cycles.skip_first = {c.skip_first}, cycles.hold_out_last = {c.hold_out_last}).",
                "Lower these, or give whole files use = 'train' and use = 'held_out'.",
            )
    return loaded


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
    form = table.format or m.format
    wanted = [m.deflection.column, m.torque.column]
    if m.sampling.time_column:
        wanted.append(m.sampling.time_column)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise UserError(f"{name}: cannot be read ({error.strerror}).", "Check the file.") from None
    read = _read_mat if form.kind == "mat" else _read_csv
    columns, rows = read(raw, name, form, wanted)
    _check_finite(columns, rows, name, form)
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
                f"of {len(time)} samples, above the limit of {MAX_DROPPED:.0%}: that is no glitch "
                "rule.",
                f"Lower it; the median step is {np.median(np.diff(time)):g} s.",
            )
        time, theta, tau, rows = time[keep], theta[keep], tau[keep], rows[keep]
        _check_time(time, rows, name, m.sampling.time_column, unit)
        time = time - time[0]
    else:
        assert m.sampling.period_s is not None
        time = np.arange(len(theta), dtype=np.float64) * m.sampling.period_s.value
    theta, tau = _zeroed(theta, m.deflection.zero), _zeroed(tau, m.torque.zero)
    _check_physics(source, name, theta, tau)
    cycles = divide(theta, m.cycles, table.use)
    return Recording(
        label=label,
        file=name,
        digest=hashlib.sha256(raw).hexdigest()[:16],
        time_s=time,
        theta_rad=theta,
        tau_Nm=tau,
        timed=m.sampling.period_s is None or m.sampling.period_s.status != "assumed",
        dropped=dropped,
        cycles=cycles,
        sets=_sets(label, theta, tau, cycles, table.use),
    )


# -- reading -------------------------------------------------------------------------------------


def _missing_column(name: str, wanted: str, known: Sequence[str], kind: str) -> UserError:
    close = difflib.get_close_matches(wanted, known, n=1)
    hint = f"Did you mean '{close[0]}'? " if close else ""
    there = ", ".join(f"'{k}'" for k in known) or "none"
    return UserError(
        f"{name}: there is no {kind} '{wanted}'; there are {there}.",
        f"{hint}Correct the column in the mapping file.",
    )


def _read_csv(
    raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]
) -> tuple[dict[str, Array], npt.NDArray[np.intp]]:
    if raw.startswith(MAT_MAGIC):
        raise UserError(
            f"{name}: is a MATLAB file, but the mapping reads it as text.",
            "Set kind = 'mat' in the mapping's format.",
        )
    try:
        text = raw.decode(form.encoding)
    except (UnicodeDecodeError, UnicodeError) as error:
        raise UserError(
            f"{name}: is not text in the encoding '{form.encoding}' ({error}).",
            "Set encoding in the mapping's format: latin-1, utf-16 or gb18030, for example.",
        ) from None
    reader = csv.reader(
        io.StringIO(text.removeprefix("\ufeff"), newline=""),
        delimiter=form.delimiter,
        quotechar=form.quote,
    )
    first = form.first_data_line or form.header_line + 1
    header: list[str] | None = None
    index: list[int] = []
    values: list[list[float]] = []
    rows: list[int] = []
    last = 0
    try:
        for cells in reader:
            line, last = last + 1, reader.line_num
            if line == form.header_line:
                header = [c.strip() for c in cells]
                index = _columns(name, header, wanted)
            if line < first or not any(c.strip() for c in cells):
                continue
            if not index:
                header = [str(i + 1) for i in range(len(cells))]
                index = _columns(name, header, wanted)
            if header is not None and any(c.strip() for c in cells[len(header) :]):
                raise UserError(
                    f"{name}: line {line} has {len(cells)} cells, but there are {len(header)} "
                    "columns.",
                    "Mend the line; a decimal comma among comma-separated cells does this: set "
                    "delimiter in the mapping's format.",
                )
            values.append(_numbers(name, line, cells, wanted, index, form))
            rows.append(line)
    except csv.Error as error:
        raise UserError(
            f"{name}: line {last + 1} is not a row of cells ({error}).",
            "Check delimiter and quote in the mapping's format.",
        ) from None
    if form.header_line and header is None:
        raise UserError(
            f"{name}: has no line {form.header_line} with column names.",
            "Correct header_line in the mapping's format.",
        )
    table = np.array(values, dtype=np.float64).reshape(len(values), len(wanted))
    return {w: table[:, i] for i, w in enumerate(wanted)}, np.array(rows, dtype=np.intp)


def _columns(name: str, header: list[str], wanted: Sequence[str]) -> list[int]:
    for w in wanted:
        if w not in header:
            raise _missing_column(name, w, header, "column")
        if header.count(w) > 1:
            raise UserError(
                f"{name}: the column name '{w}' occurs {header.count(w)} times.",
                "Use header_line = 0 and number the columns '1', '2', ... in the mapping file.",
            )
    return [header.index(w) for w in wanted]


def _numbers(
    name: str,
    line: int,
    cells: list[str],
    wanted: Sequence[str],
    index: list[int],
    form: FileFormat,
) -> list[float]:
    out = []
    for w, i in zip(wanted, index, strict=True):
        if i >= len(cells):
            raise UserError(
                f"{name}: line {line} has {len(cells)} cells, too few for column '{w}' "
                f"(cell {i + 1}).",
                "Complete the row, or check delimiter and first_data_line in the mapping's format.",
            )
        cell = cells[i].strip()
        try:
            out.append(float(cell.replace(",", ".") if form.decimal == "," else cell))
        except ValueError:
            raise UserError(
                f"{name}: line {line}, column '{w}': '{cell}' is not a number.",
                "Correct the cell, or check first_data_line and decimal in the mapping's format.",
            ) from None
    return out


def _read_mat(
    raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]
) -> tuple[dict[str, Array], npt.NDArray[np.intp]]:
    try:
        content = scipy.io.loadmat(io.BytesIO(raw))
    except NotImplementedError:
        raise UserError(
            f"{name}: is a MATLAB 7.3 file (HDF5), which is not read.",
            "Save it again with save(..., '-v7'), or export CSV.",
        ) from None
    except Exception as error:
        raise UserError(
            f"{name}: is not a MATLAB file ({error}).", "Check the file, or set kind = 'csv'."
        ) from None
    known = [k for k, v in content.items() if not k.startswith("__") and np.size(v) > 1]
    out: dict[str, Array] = {}
    for w in wanted:
        if w not in known:
            raise _missing_column(name, w, known, "variable")
        value = content[w]
        if value.dtype.kind not in "fiu" or np.squeeze(value).ndim != 1:
            raise UserError(
                f"{name}: variable '{w}' has shape {value.shape} and type {value.dtype}, it is not "
                "a vector of real numbers.",
                "Name a variable that is one.",
            )
        out[w] = np.asarray(np.squeeze(value), dtype=np.float64)
    lengths = {w: len(v) for w, v in out.items()}
    if len(set(lengths.values())) > 1:
        raise UserError(
            f"{name}: the variables have different lengths {lengths}.", "Name equally long ones."
        )
    return out, np.arange(1, min(lengths.values()) + 1, dtype=np.intp)


# -- checks --------------------------------------------------------------------------------------


def _check_finite(
    columns: dict[str, Array], rows: npt.NDArray[np.intp], name: str, form: FileFormat
) -> None:
    where = "element" if form.kind == "mat" else "line"
    for column, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise UserError(
                f"{name}: {where} {rows[bad[0]]}, column '{column}' is {values[bad[0]]:g} "
                f"({len(bad)} such value{'s' if len(bad) > 1 else ''} in the column).",
                "Cut these rows out of the recording or repair them; nothing is filled in here.",
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


def _check_time(time: Array, rows: npt.NDArray[np.intp], name: str, column: str, unit: str) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i = int(back[0])
        a, b = time[i] / TIME[unit], time[i + 1] / TIME[unit]
        verb = "stands still" if a == b else "goes backwards"
        raise UserError(
            f"{name}: time {verb} in column '{column}': {a:.10g} {unit} in row {rows[i]}, then "
            f"{b:.10g} {unit} in row {rows[i + 1]} ({len(back)} such step"
            f"{'s' if len(back) > 1 else ''}).",
            "Repair the recording, or drop single bad samples with sampling.min_step_s (they are "
            "counted and reported).",
        )


def _check_physics(source: MappingFile, name: str, theta: Array, tau: Array) -> None:
    m = source.mapping
    column = m.deflection.column
    if np.ptp(theta) <= 1e-9:
        raise UserError(
            f"{name}: the deflection is constant (column '{column}').",
            "Check the column, unit and scale in the mapping file.",
        )
    factor = m.device.limit_factor
    for key, what, value, unit, limit in (
        ("deflection", "deflection", np.abs(theta).max(), "rad", MAX_THETA_RAD / factor),
        ("torque", "torque", np.abs(tau).max(), "Nm", MAX_TAU_NM),
    ):
        if value > limit:
            raise UserError(
                f"{name}: the largest |{what}| is {value:.4g} {unit} after scaling, above the "
                f"limit of {limit:.4g} {unit}.",
                f"Check {key}.unit and {key}.scale in {source.origin}.",
            )
    x, y = theta - theta.mean(), tau - tau.mean()
    slope = float(x @ y / (x @ x))
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


def _zeroed(x: Array, zero: str) -> Array:
    offset = {
        "none": 0.0,
        "first": float(x[0]),
        "mean": float(x.mean()),
        "middle": 0.5 * float(x.max() + x.min()),
    }[zero]
    return np.asarray(x - offset, dtype=np.float64)


# -- cycles --------------------------------------------------------------------------------------


def reversals(theta: Array, threshold: float) -> list[int]:
    """Find the turning points of a deflection, first and last sample included.

    theta: deflection, shape (n,).
    threshold: a reversal counts when the deflection has come back by this much, so that noise makes
        none.
    """
    points = [0]
    direction, best = 0, 0
    low = high = 0
    values = theta.tolist()
    for i, x in enumerate(values):
        if direction == 0:
            low = i if x < values[low] else low
            high = i if x > values[high] else high
            if x > values[low] + threshold:
                direction, best = 1, i
                if low > 0:
                    points.append(low)
            elif x < values[high] - threshold:
                direction, best = -1, i
                if high > 0:
                    points.append(high)
        elif direction * x > direction * values[best]:
            best = i
        elif direction * x < direction * values[best] - threshold:
            points.append(best)
            direction, best = -direction, i
    if points[-1] != len(values) - 1:
        points.append(len(values) - 1)
    return points


def divide(theta: Array, rules: Cycles, use: str) -> tuple[Cycle, ...]:
    """Divide a recording into cycles and give each its role.

    A cycle runs from one reversal to the next of the same kind.  Before the first reversal is the
    lead-in; a cycle that no neighbour equals in amplitude leads from one block to the next.

    theta: deflection, shape (n,).
    use: whether the rules apply, or the whole file serves one purpose.
    """
    points = reversals(theta, rules.hysteresis * float(np.ptp(theta)))
    # Loaded to one side, a specimen rests at the recording's ends: they are reversals.
    one_sided = theta.min() > -0.1 * theta.max() or theta.max() < -0.1 * theta.min()
    starts = points[::2] if one_sided else points[1:-1:2]
    spans = list(itertools.pairwise(starts))
    amplitude = [0.5 * float(np.ptp(theta[a : b + 1])) for a, b in spans]
    block, blocks = 0, []
    reference = 0.0
    for i, x in enumerate(amplitude):
        if i == 0:
            reference = x
        elif abs(x - reference) > rules.block_tolerance * reference:
            block, reference = block + 1, x
        blocks.append(block)
    roles: list[Role] = []
    for i, b in enumerate(blocks):
        size, place = blocks.count(b), i - blocks.index(b)
        if use != "cycles":
            roles.append("training" if use == "train" else "held_out")
        elif size == 1 and len(blocks) > 1:
            roles.append("transition")
        elif place < rules.skip_first:
            roles.append("conditioning")
        elif place >= size - rules.hold_out_last:
            roles.append("held_out")
        else:
            roles.append("training")
    return tuple(
        Cycle(a, b, x, n, role)
        for (a, b), x, n, role in zip(spans, amplitude, blocks, roles, strict=True)
    )


def _stiffness_asymmetry(theta: Array, tau: Array) -> float | None:
    high, low = int(theta.argmax()), int(theta.argmin())
    if (
        theta[high] <= 0
        or theta[low] >= 0
        or min(theta[high], -theta[low]) < 0.2 * max(theta[high], -theta[low])
    ):
        return None
    positive, negative = tau[high] / theta[high], tau[low] / theta[low]
    return float(2 * (positive - negative) / (positive + negative))


def _work(theta: Array, tau: Array, cycle: Cycle) -> float:
    x, y = theta[cycle.start : cycle.stop + 1], tau[cycle.start : cycle.stop + 1]
    return float(np.trapezoid(y, x))


def _one_set(
    label: str, theta: Array, tau: Array, cycles: Sequence[Cycle], use: str, whole: bool
) -> DataSet:
    if whole:
        every = np.arange(len(theta), dtype=np.intp)
        none = every[:0]
        training, held_out = (every, none) if use == "train" else (none, every)
    else:
        training, held_out = (
            np.concatenate(
                [np.arange(c.start, c.stop, dtype=np.intp) for c in cycles if c.role == role]
                or [np.zeros(0, dtype=np.intp)]
            )
            for role in ("training", "held_out")
        )
    used = [c for c in cycles if c.role in ("training", "held_out")]
    asymmetries = [
        a
        for c in used
        if (a := _stiffness_asymmetry(theta[c.start : c.stop], tau[c.start : c.stop])) is not None
    ]
    amplitudes = [c.amplitude_rad for c in cycles] or [0.5 * float(np.ptp(theta))]
    counts: dict[str, int] = {}
    for c in cycles:
        counts[c.role] = counts.get(c.role, 0) + 1
    # In a whole file (a sweep, say) cycles differ by more than their age.
    several = len(cycles) > 1 and not whole
    work = [_work(theta, tau, c) for c in cycles]
    # Of a loss that is rounding, no share can be told.
    several = several and work[0] > 1e-3 * float(np.ptp(theta)) * float(np.ptp(tau))
    return DataSet(
        label=label,
        amplitude_rad=float(np.median(amplitudes)),
        training=training,
        held_out=held_out,
        cycles=counts,
        asymmetry=float(np.mean(asymmetries)) if asymmetries else None,
        work_first_J=work[0] if several else None,
        work_last_J=work[-1] if several else None,
    )


def _sets(
    label: str, theta: Array, tau: Array, cycles: tuple[Cycle, ...], use: str
) -> tuple[DataSet, ...]:
    if use != "cycles":
        return (_one_set(label, theta, tau, cycles, use, True),)
    blocks = sorted({c.block for c in cycles if c.role in ("training", "held_out")})
    out = []
    for n, b in enumerate(blocks):
        name = f"{label} block {n + 1}" if len(blocks) > 1 else label
        own = [c for c in cycles if c.block == b]
        out.append(_one_set(name, theta, tau, own, use, False))
    return tuple(out)


def resample(time_s: Array, values: Array, grid_s: Array) -> Array:
    """Linear interpolation onto a grid.

    time_s, values: recording, shape (n,).
    grid_s: new times, shape (m,).
    """
    out: Any = np.interp(grid_s, time_s, values)
    return np.asarray(out, dtype=np.float64)
