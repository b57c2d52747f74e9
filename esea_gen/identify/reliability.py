"""Agreement between specimens of one coupling: reliability, limits of agreement, a joint fit.

Rows are conditions (a deflection, rate and instant each), columns are specimens; each cell is the
torque of that specimen there.  Specimens are a sample of all possible ones: ICC(2,1), absolute
agreement, shows whether one device file suits any of them; ICC(3,1), consistency, ignores what a
constant offset of each would correct.  From recordings, where each ``[[condition]]`` of the mapping
is a specimen, the published model is fitted to all together and to each by itself.

References
----------
.. [1] P. E. Shrout, J. L. Fleiss, "Intraclass correlations: uses in assessing rater reliability",
   Psychological Bulletin 86(2), 1979.
.. [2] J. M. Bland, D. G. Altman, Lancet 327 (1986) 307: limits of agreement, and their errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.identify.drafting import draft, fit_split
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.proposal import named
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.identify.recording.recorded import Recording
from esea_gen.language.ports import Array
from esea_gen.tables import MARK, SIMULATED, FileTable, read_table

CONFIDENCE = 0.95
LEAST_ROWS, LEAST_COLUMNS = 5, 2
# Chapter 3, RMS error of one model on other specimens, % of full scale: table 3.4's worst, and
# session 1 of the three of the two-day test (table 3.7).
PUBLISHED = "thesis, one model on other elastomers: RMS 2.93 % (worst of two), 3.30 to 3.72 %"


@dataclass(frozen=True)
class Coefficient:
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class PairAgreement:
    """Two specimens, Bland and Altman: torque of the first less that of the second, Nm."""

    first: str
    second: str
    bias_Nm: float
    low_Nm: float  # between them lie 95 % of the differences, were they normal
    high_Nm: float
    limit_error_Nm: float  # half width of the 95 % interval of either limit


@dataclass(frozen=True)
class Reliability:
    specimens: tuple[str, ...]
    rows: int
    absolute: Coefficient
    consistent: Coefficient
    agreements: tuple[PairAgreement, ...]
    apart_pct: dict[str, float]  # RMS of each less the mean of the others, of the largest

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {"published": PUBLISHED}

    def table(self) -> list[str]:
        both = (("2,1), absolute agreement", self.absolute), ("3,1), consistency", self.consistent))
        return [
            f"{len(self.specimens)} specimens at {self.rows} conditions",
            *(f"{f'ICC({n}':30} {c.value:.4f}, 95 % {c.low:.4f} to {c.high:.4f}" for n, c in both),
            "limits of agreement, Nm (each limit +- its 95 % error)",
            *(
                f"{a.first + ' - ' + a.second:30} {a.bias_Nm:+.4f}, {a.low_Nm:+.4f} to "
                f"{a.high_Nm:+.4f} (+-{a.limit_error_Nm:.4f})"
                for a in self.agreements
            ),
            "each against the mean of the others, RMS in % of the largest torque",
            *(f"{name:30} {x:.2f}" for name, x in self.apart_pct.items()),
            PUBLISHED,
            "The intervals take conditions for independent: samples of one loop are not. Give one "
            "row a condition, not a whole recording.",
        ]


def mean_squares(table: Array) -> tuple[float, float, float]:
    """Two-way analysis of variance without replication: rows, columns, residual [1]_."""
    n, k = table.shape
    grand, rows, columns = table.mean(), table.mean(axis=1), table.mean(axis=0)
    left = table - rows[:, None] - columns + grand
    return (
        float(k * np.sum((rows - grand) ** 2) / (n - 1)),
        float(n * np.sum((columns - grand) ** 2) / (k - 1)),
        float(np.sum(left**2) / ((n - 1) * (k - 1))),
    )


def coefficients(table: Array) -> tuple[Coefficient, Coefficient]:
    """ICC(2,1) and ICC(3,1) with their 95 % intervals [1]_."""
    from scipy.stats import f

    n, k = table.shape
    bms, jms, ems = mean_squares(table)
    upper, d1, d2 = 1 - (1 - CONFIDENCE) / 2, n - 1, (n - 1) * (k - 1)
    spread = bms + (k - 1) * ems
    two = (bms - ems) / (spread + k * (jms - ems) / n)
    f0 = bms / ems
    low, high = f0 / f.ppf(upper, d1, d2), f0 * f.ppf(upper, d2, d1)
    three = Coefficient(
        (bms - ems) / spread, float((low - 1) / (low + k - 1)), float((high - 1) / (high + k - 1))
    )
    fj, rest = jms / ems, n * (1 + (k - 1) * two) - k * two
    # Satterthwaite's degrees of freedom.
    v = d2 * (k * two * fj + rest) ** 2 / ((n - 1) * (k * two * fj) ** 2 + rest**2)
    f1, f2 = f.ppf(upper, d1, v), f.ppf(upper, v, d1)
    among = k * jms + (k * n - k - n) * ems
    return (
        Coefficient(
            two,
            float(n * (bms - f1 * ems) / (f1 * among + n * bms)),
            float(n * (f2 * bms - ems) / (among + n * f2 * bms)),
        ),
        three,
    )


def agreement(first: Array, second: Array) -> tuple[float, float, float, float]:
    """Bias, both limits of agreement, and the half width of either limit's 95 % interval [2]_."""
    from scipy.stats import norm, t

    d = np.asarray(first - second, float)
    n, bias, sd = len(d), float(np.mean(d)), float(np.std(d, ddof=1))
    z = float(norm.ppf(1 - (1 - CONFIDENCE) / 2))
    error = sd * np.sqrt(1 / n + z * z / (2 * (n - 1))) * t.ppf(1 - (1 - CONFIDENCE) / 2, n - 1)
    return bias, bias - z * sd, bias + z * sd, float(error)


def reliability(torques_Nm: Mapping[str, Array]) -> Reliability:
    names = tuple(torques_Nm)
    lengths = {len(x) for x in torques_Nm.values()}
    if len(names) < LEAST_COLUMNS or len(lengths) != 1 or min(lengths) < LEAST_ROWS:
        raise UserError(
            f"{len(names)} specimens at {sorted(lengths)} conditions: reliability needs "
            f"{LEAST_COLUMNS} or more at the same {LEAST_ROWS} or more.",
            "Give one column a specimen and one row a condition.",
        )
    table = np.column_stack([np.asarray(torques_Nm[n], float) for n in names])
    if not np.all(np.isfinite(table)):
        row, column = np.argwhere(~np.isfinite(table))[0]
        raise UserError(
            f"specimen {names[column]}, condition {row + 1}: no finite number.",
            "Leave out conditions that not every specimen was measured at.",
        )
    bms, jms, ems = mean_squares(table)
    if ems <= 1e-24 * max(bms, jms) or bms <= 0:
        raise UserError(
            "The specimens differ only by a constant, or the conditions do not differ: there "
            "is no variance to judge by.",
            "Give measured torques, and conditions that differ.",
        )
    absolute, consistent = coefficients(table)
    largest = float(np.max(np.abs(table.mean(axis=1))))
    others = [np.delete(table, i, axis=1).mean(axis=1) for i in range(len(names))]
    apart = {
        n: 100 * float(np.sqrt(np.mean((table[:, i] - others[i]) ** 2))) / largest
        for i, n in enumerate(names)
    }
    pairs = tuple(
        PairAgreement(a, b, *agreement(table[:, i], table[:, j]))
        for (i, a), (j, b) in combinations(enumerate(names), 2)
    )
    return Reliability(names, len(table), absolute, consistent, pairs, apart)


def read_specimens(path: Path) -> tuple[FileTable, dict[str, Array]]:
    """A table, and its torques: a column a specimen under its name, a row a condition, in Nm."""
    # A first column named ``condition`` is a label and left out.
    table = read_table(path)
    labelled = table.names[0].lower() == "condition"
    names = [n for n in table.names[labelled:] if n != SIMULATED]
    for n in names:
        if len(unit := named(n)[1]) > 1 and unit != "Nm":
            raise UserError(
                f"{path}: column '{n}' states the unit {unit}; each column is a specimen's torque "
                "in Nm.",
                "Convert or remove the column; the name 'condition' marks a first one of labels.",
            )
    if not all(names):
        raise UserError(
            f"{path}: {list(table.names)} does not name each specimen.",
            "Give one name a column, and 'condition' over the labels.",
        )
    torques = {n: table.numbers(n) for n in names}
    for n, x in torques.items():
        if len(x) >= LEAST_ROWS and np.all(np.diff(x) == 1):
            text = f"{path}: column '{n}' counts the rows, from {x[0]:g} to {x[-1]:g}: no torque."
            raise UserError(text, "Remove it, or put it first under the name 'condition'.")
    return table, torques


NODES = 9  # deflections at which specimens are compared, each way
INSIDE = 0.9  # of the deflection that all of them reach


@dataclass(frozen=True)
class JointFit:
    """One model for all specimens against one each."""

    title: str
    full_scale_Nm: float
    joint_pct: dict[str, float]  # held-out RMS error of each specimen, % of full scale
    own_pct: dict[str, float]
    agreement: Reliability
    simulated: bool

    def to_dict(self) -> dict[str, Any]:
        fits = {k: getattr(self, k) for k in ("joint_pct", "own_pct", "simulated")}
        return self.agreement.to_dict() | fits | {"full_scale_Nm": self.full_scale_Nm}

    def table(self) -> list[str]:
        lines = [
            f"{self.title}: held out, RMS in % of full scale ({self.full_scale_Nm:g} Nm)"
            + MARK * self.simulated,
            f"{'specimen':30} one model for all   its own",
        ]
        for name, joint in self.joint_pct.items():
            lines.append(f"{name:30} {joint:17.2f} {self.own_pct[name]:9.2f}")
        return lines + self.agreement.table()


def joint_fit(
    mapping_path: str | Path,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
) -> JointFit:
    """Fit all specimens of a mapping together and each by itself, and compare their torques."""
    tell: Progress = progress or (lambda share, text: None)
    source = load_mapping(mapping_path, data_folder)
    recordings = load_recordings(source)
    specimens: dict[str, list[Recording]] = {}
    for r in recordings:
        if len(r.conditions) != 1:
            raise UserError(
                f"{source.origin}: {r.file} belongs to {len(r.conditions)} conditions; here each "
                "is a specimen.",
                "Give every specimen one [[condition]] with its files, and no other.",
            )
        specimens.setdefault(r.conditions[0], []).append(r)
    for name, some in specimens.items():
        for what, role in (("train on", "training"), ("hold out", "held_out")):
            if not any(len(getattr(s, role)) for r in some for s in r.sets):
                raise UserError(
                    f"{source.origin}: specimen '{name}' has nothing to {what}.",
                    "Set cycles.hold_out_last = 1, or use = 'train' and 'held_out' for its files.",
                )
    agreement = reliability(torque_table(specimens))
    rate_terms = source.mapping.device.rate_terms
    errors = {}
    for number, (name, some) in enumerate([("", recordings), *specimens.items()]):
        tell(number / (1 + len(specimens)), f"fit of {name or 'all together'}")
        template = draft(source, some, rate_terms)
        _, _, device, verdict = fit_split(source, some, template, lambda share, text: None)
        errors[name] = {s.label: b.rms for s, _, b in verdict.misfits.sets if b is not None}
        if not name:
            full_scale = device.tau_full_scale_Nm
    joint, own = {}, {}
    for name, some in specimens.items():
        labels = [s.label for r in some for s in r.sets if s.label in errors[name]]
        joint[name] = 100 * float(np.mean([errors[""][x] for x in labels])) / full_scale
        own[name] = 100 * float(np.mean([errors[name][x] for x in labels])) / full_scale
    simulated = any(r.simulated for r in recordings)
    return JointFit(source.mapping.device.title, full_scale, joint, own, agreement, simulated)


def torque_table(specimens: dict[str, list[Recording]]) -> dict[str, Array]:
    """Torques of each specimen where all were: by test, way and deflection."""
    counts = {len(some) for some in specimens.values()}
    if len(counts) != 1:
        said = ", ".join(f"{n}: {len(some)}" for n, some in specimens.items())
        raise UserError(
            f"Specimens have different numbers of files ({said}).",
            "Give each the same tests in the same order.",
        )
    rows: dict[str, list[Array]] = {n: [] for n in specimens}
    for test in zip(*specimens.values(), strict=True):
        used = [_used(r) for r in test]
        low = INSIDE * max(float(r.theta_rad[i].min()) for r, i in zip(test, used, strict=True))
        high = INSIDE * min(float(r.theta_rad[i].max()) for r, i in zip(test, used, strict=True))
        edges = np.linspace(low, high, NODES + 1)
        for name, r, i in zip(specimens, test, used, strict=True):
            rows[name].append(_means(r, i, edges))
    table = np.stack([np.concatenate(x) for x in rows.values()])
    kept = table[:, np.all(np.isfinite(table), axis=0)]
    return dict(zip(rows, kept, strict=True))


def _used(r: Recording) -> npt.NDArray[np.intp]:
    every = [i for s in r.sets for i in (s.training, s.held_out)]
    return np.sort(np.concatenate(every)).astype(np.intp)


def _means(r: Recording, used: npt.NDArray[np.intp], edges: Array) -> Array:
    # Mean torque between neighbouring edges, on the way up and on the way down.
    way = np.sign(np.gradient(r.theta_rad))[used]
    theta, tau = r.theta_rad[used], r.tau_Nm[used]
    place = np.digitize(theta, edges) - 1
    out = np.full(2 * NODES, np.nan)
    for k, sign in enumerate((1, -1)):
        for node in range(NODES):
            inside = (way == sign) & (place == node)
            if np.any(inside):
                out[k * NODES + node] = tau[inside].mean()
    return out
