"""Compare models on conditions left out of their training, and identify with the chosen one.

Every model is fitted again for every split; :mod:`esea_gen.identify.family.choice` chooses.

Two models from the literature are fitted by SciPy for comparison: Bouc-Wen [1]_ (springs x and x^3
and one hysteretic variable) and the generalised Maxwell model with Coulomb friction (the same
springs, three branches, one narrow stop operator for the friction).  Their weights may have either
sign, and their shape is searched from several starts.

References
----------
.. [1] M. Ismail, F. Ikhouane, J. Rodellar, "The hysteresis Bouc-Wen model, a survey", Archives of
   Computational Methods in Engineering 16, 2009.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import qmc

from esea_gen.device import Device
from esea_gen.emit.walker import LONG, walk
from esea_gen.files import plain
from esea_gen.identify.drafting import draft, fit_split, grid_rate, published_channels
from esea_gen.identify.family.choice import THESIS, CompareRow, ModelChoice, choose
from esea_gen.identify.family.fit import (
    UnitTerms,
    fit_member,
    members,
    misfits_of,
    term_rows,
    trained_scale,
)
from esea_gen.identify.family.identification import drafted_member, identify_member
from esea_gen.identify.identification import identify
from esea_gen.identify.identified import Identified, excused_of, gate_notes
from esea_gen.identify.notes import temperature_notes
from esea_gen.identify.published.fit import Progress, part_of
from esea_gen.identify.published.plant import equal_weights
from esea_gen.identify.published.search_problem import Searching
from esea_gen.identify.recording.channels import settled
from esea_gen.identify.recording.conditions import Split, splits_of
from esea_gen.identify.recording.mapping import MappingFile, load_mapping
from esea_gen.identify.recording.reading import followed_rad, resample
from esea_gen.identify.recording.recorded import Misfits, Recording, recording_rows, training_sets
from esea_gen.language.ports import Array
from esea_gen.model.family import Member
from esea_gen.model.rubber import fitted_of

STARTS, STEPS = 4, 20
MOST_SAMPLES = 2000  # of a recording: the loops are Python's
COULOMB_BAND = 0.01  # of the largest trained deflection

Columns = Callable[[Array, Array, Array], Array]


def _springs(x: Array) -> list[Array]:
    # With x^5 too they train better, and are far worse where the largest amplitude is left out.
    return [x, x**3]


def bouc_wen(shape: Array, _t: Array, x: Array) -> Array:
    """Columns for ln(yield), exponent and share of the path's direction."""
    yielded, power, beta = math.exp(shape[0]), shape[1], shape[2]
    u, out = 0.0, [0.0]
    for dx in (np.diff(x) / yielded).tolist():
        turn = 1.0 if dx * u > 0 else -1.0
        u += dx * (1 - abs(u) ** power * (beta * turn + 1 - beta))
        u = min(1.0, max(-1.0, u))
        out.append(u)
    return np.stack([*_springs(x), np.array(out)], axis=1)


def maxwell_coulomb(shape: Array, t: Array, x: Array) -> Array:
    """Columns for the logarithms of three relaxation times."""
    step = t[1] - t[0]
    branches = []
    for time in np.exp(shape):
        decay = math.exp(-step / time)
        mean = (1 - decay) * time / step
        branches.append(np.concatenate([[0.0], lfilter([mean], [1, -decay], np.diff(x))]))
    friction = x - followed_rad(x, 2 * COULOMB_BAND)
    return np.stack([*_springs(x), *branches, friction], axis=1)


PEERS: dict[str, tuple[Columns, Array, Array]] = {
    "Bouc-Wen (SciPy)": (
        bouc_wen,
        np.array([math.log(0.01), 0.3, 0.0]),
        np.array([math.log(3.0), 4.0, 1.0]),
    ),
    "Maxwell + Coulomb (SciPy)": (
        maxwell_coulomb,
        np.log([0.03, 0.3, 3.0]),
        np.log([3.0, 30.0, 1000.0]),
    ),
}


def fit_peer(name: str, recordings: Sequence[Recording], seed: int) -> list[Array]:
    columns, low, high = PEERS[name]
    scale = trained_scale(recordings)
    grids = [np.linspace(0, r.time_s[-1], min(len(r.time_s), MOST_SAMPLES)) for r in recordings]
    paths = [
        resample(r.time_s, r.theta_rad, g) / scale for r, g in zip(recordings, grids, strict=True)
    ]
    at = [
        [np.clip(np.searchsorted(g, r.time_s[s.training]), 0, len(g) - 1) for s in r.sets]
        for r, g in zip(recordings, grids, strict=True)
    ]
    sets = [r.tau_Nm[s.training] for r, s in training_sets(recordings)]
    weight = equal_weights(sets)
    target = np.concatenate(sets) * weight

    def solved(shape: Array) -> tuple[Array, Array, list[Array]]:
        every = [columns(shape, g, x) for g, x in zip(grids, paths, strict=True)]
        rows = np.concatenate(
            [c[i] for c, places in zip(every, at, strict=True) for i in places if len(i)]
        )
        basis = rows * weight[:, None]
        linear: Array = np.asarray(np.linalg.lstsq(basis, target, rcond=None)[0], np.float64)
        return basis @ linear - target, linear, every

    starts = qmc.scale(qmc.Sobol(len(low), seed=seed).random(STARTS), low, high)
    ends = [
        least_squares(
            lambda p: solved(p)[0], x0, bounds=(low, high), diff_step=1e-3, max_nfev=STEPS
        )
        for x0 in starts
    ]
    _, linear, every = solved(min(ends, key=lambda e: float(e.cost)).x)
    return [
        resample(g, c @ linear, r.time_s) for r, g, c in zip(recordings, grids, every, strict=True)
    ]


LONG_COST = 100  # operations that a power, an exponential or a logarithm counts as


def operations(device: Device) -> int:
    """Operations of a step of the torque sensor, the same on every machine."""
    cost = walk(device.sensor.step).cost()
    return sum(n * (LONG_COST if op in LONG else 1) for op, n in cost.items())


@dataclass(frozen=True)
class ModelComparison:
    source: MappingFile
    full_scale_Nm: float  # 100 % of errors
    rows: tuple[CompareRow, ...]  # model by model, split by split
    choice: ModelChoice
    devices: dict[str, Device]  # by model: the device fitted on the file's own division
    notes: tuple[str, ...]
    recordings: tuple[Recording, ...] = ()

    @property
    def chosen(self) -> str:
        return self.choice.chosen

    def to_dict(self) -> dict[str, Any]:
        device = self.devices[self.chosen]
        return {
            "mapping": self.source.origin,
            "recordings": recording_rows(self.recordings),
            "simulated": any(r.simulated for r in self.recordings),
            "full_scale_Nm": self.full_scale_Nm,
            "compare": plain(self.rows),
            **self.choice.to_dict(),
            "terms": term_rows(fitted_of(device)) if device.file.family is not None else [],
            "notes": list(self.notes),
        }

    def table(self) -> list[str]:
        """Lines for the terminal: a model a line, its errors by condition."""
        models = list(dict.fromkeys(r.model for r in self.rows))
        conditions = list(dict.fromkeys(r.condition for r in self.rows))
        cells = {(r.model, r.condition): r for r in self.rows}
        first = max(len(m) for m in models) + 2
        width = max(16, *(len(c) + 2 for c in conditions))
        lines = [
            f"{self.source.mapping.device.title}: held out / training, RMS in % of full scale "
            f"({self.full_scale_Nm:g} Nm)",
            " " * first + "".join(f"{c:>{width}}" for c in (*conditions, "operations")),
        ]
        for m in models:
            found = [cells[m, c] for c in conditions]
            errors = "".join(
                f"  {f'{r.held_out:.2f} / {r.training:.2f}':>{width - 2}}" for r in found
            )
            errors += f"{found[0].operations or '-':>{width}}"
            lines.append(f"{'* ' if m == self.chosen else '  '}{m:{first - 2}}{errors}")
        return [*lines, *self.choice.reasons, *(f"note: {n}" for n in self.notes)]


# Errors of a split, and the device that was fitted to it; None where a model gives none.
Fitter = Callable[[Split], tuple[Misfits, Device | None]]


def compare(
    mapping_path: str | Path,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
    *,
    peers: bool = True,
    how: Searching | None = None,
) -> ModelComparison:
    tell: Progress = progress or (lambda share, text: None)
    source = load_mapping(mapping_path, data_folder)
    # A lag or a gap that is left to the fit is the published model's for all.
    source, recordings, _ = settled(source, lambda s, r: published_channels(s, r, how))
    splits = splits_of(recordings)
    timed = all(r.timed for r in recordings)
    able = [m for m in members() if timed or not m.timed]
    others = list(PEERS) if peers else []
    total = len(splits) * (1 + len(able) + len(others))
    full_scale_Nm = draft(source, recordings, False).tau_full_scale_Nm
    rows: list[CompareRow] = []
    devices: dict[str, Device] = {}

    def searched(share: float, text: str) -> None:
        tell((len(rows) + share) / total, f"{THESIS}: {text}")

    for name, fit in _models(source, recordings, able, others, full_scale_Nm, how, searched):
        count: int | None = None
        # The file's own division first: what its fit costs stands for the model.
        for split in sorted(splits, key=lambda s: not s.declared):
            tell(len(rows) / total, f"{name}, {split.condition}")
            errors, device = fit(split)
            if split.declared and device is not None:
                count, devices[name] = operations(device), device
            trained, held_out = (
                100 * errors.mean_rms(held) / full_scale_Nm for held in (False, True)
            )
            rows.append(CompareRow(name, split.condition, trained, held_out, count))
    costs = {r.model: r.operations for r in rows if r.operations is not None}
    choice = choose(rows, {s.condition for s in splits if s.whole}, costs)
    notes = (
        *gate_notes(recordings, excused_of(devices[choice.chosen])),
        *_notes(timed, splits, able),
        *temperature_notes(recordings),
    )
    found = source, full_scale_Nm, tuple(rows), choice, devices
    return ModelComparison(*found, notes, tuple(recordings))


def _models(
    source: MappingFile,
    recordings: list[Recording],
    able: Sequence[Member],
    others: Sequence[str],
    full_scale_Nm: float,
    how: Searching | None,
    tell: Progress,
) -> Iterator[tuple[str, Fitter]]:
    def thesis(split: Split) -> tuple[Misfits, Device | None]:
        some = list(split.recordings)
        template = draft(source, some, source.mapping.device.rate_terms)
        # Watched is the file's own division: what the other splits find is no one's result.
        watched = how if how is None or split.declared else replace(how, watch=None)
        fit = fit_split(source, some, template, tell, watched)
        return fit[3].misfits, fit[2]

    yield THESIS, thesis
    for m in able:
        terms = UnitTerms(m, recordings, grid_rate(source))

        def member(split: Split, terms: UnitTerms = terms) -> tuple[Misfits, Device | None]:
            some, device = list(split.recordings), None
            fitted = fit_member(terms, some, full_scale_Nm)
            if split.declared:
                device = drafted_member(source, some, fitted)
            return misfits_of(terms, some, fitted), device

        yield m.name, member
    for n in others:

        def peer(split: Split, name: str = n) -> tuple[Misfits, Device | None]:
            torque = fit_peer(name, split.recordings, source.mapping.search.seed)
            pairs = zip(split.recordings, torque, strict=True)
            return Misfits.of("Nm", ((r, y - r.tau_Nm) for r, y in pairs)), None

        yield n, peer


def _notes(timed: bool, splits: Sequence[Split], able: Sequence[Any]) -> tuple[str, ...]:
    notes = [
        f"{len(able)} members of the family were tried with fixed outer numbers; the best of "
        "several carries selection."
    ]
    if not timed:
        notes.append("Time was not recorded: members with Maxwell branches are left out.")
    if not any(s.whole for s in splits):
        notes.append(
            "There is only one condition: none could be left out. Add [[condition]] tables."
        )
    return tuple(notes)


CHOSEN = "chosen"
COMPARING = 0.85  # share of the time
ZONED = "Model: published. No other has a dead zone, for which the mapping asks."


def identify_chosen(
    mapping: str | Path,
    data: str | Path | None = None,
    progress: Progress | None = None,
    how: Searching | None = None,
    model: str = CHOSEN,
    compared: ModelComparison | None = None,
) -> tuple[Identified, ModelComparison | None]:
    """Identify the chosen model, comparing first unless that was done; or the one of that name."""
    tell: Progress = progress or (lambda share, text: None)
    notes: tuple[str, ...] = ()
    begun, zone = 0.0, load_mapping(mapping, data).mapping.deflection.dead_zone_rad
    if model == CHOSEN and zone is not None:
        model, compared, notes = THESIS, None, (ZONED,)
    elif model == CHOSEN:
        if compared is None:
            begun, first = COMPARING, part_of(tell, 0.0, COMPARING)
            compared = compare(mapping, data, first, peers=False, how=how)
        model, notes = compared.chosen, compared.choice.reasons
    result: Identified
    if model == THESIS:
        result = identify(mapping, data, part_of(tell, begun, 1.0), how)
    else:
        result = identify_member(mapping, model, data, part_of(tell, begun, 1.0))
    return replace(result, notes=(*notes, *result.notes)), compared
