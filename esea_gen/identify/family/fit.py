"""The members of the family that are compared, from simple to rich.

Their outer numbers are fixed: spaced evenly on a logarithmic axis, in units of the largest trained
deflection and in seconds.  Only weights are fitted.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from esea_gen.hostlib.library import compile_block
from esea_gen.identify.published.plant import equal_weights
from esea_gen.identify.published.search_problem import solve_linear
from esea_gen.identify.recording.conditions import (
    at_temperature,
    scaled_terms,
    searched_factor,
    tells_none,
)
from esea_gen.identify.recording.reading import resample
from esea_gen.identify.recording.recorded import Misfits, Recording, training_sets
from esea_gen.identify.recording.resampling import (
    FitRows,
    LeftOut,
    resampled,
    rests_on_one,
    rows_of,
    whole_conditions,
)
from esea_gen.language.ports import Array
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term, softened
from esea_gen.model.family_sensor import unit_terms

# Of the members: spaced evenly on a logarithmic axis, in units of the largest trained deflection
# and in seconds; only weights are fitted.
LINEAR, CUBIC = Rise("power", 1), Rise("power", 3)
STEEP, BENT = Rise("bend", 0.08), Rise("bend", 0.4)

THRESHOLDS = (0.02, 0.07, 0.15, 0.3, 0.6, 1.1)
PATHS = (0.03, 0.1, 0.3, 1.0, 3.0)
TIMES_s = (3.0, 30.0, 300.0)
QUICK_s = (0.1, 0.3, 1.0, 3.0, 30.0)
TURNING_s = (0.03, 0.1, 0.3, 1.0)
# Slower motion sees a viscosity in these times, and dry friction in these paths.
VISCOUS_s, DRY = (0.003, 0.01, *TURNING_s), (0.003, 0.01, *PATHS)
FRACTIONAL_s = tuple(10 ** (-1 + 4 * k / 7) for k in range(8))
EXPONENT = 0.2

STRAIN = Softening("strain", 0.3)
WORN = (STRAIN, Softening("path", 8.0), Softening("path", 40.0))


def _springs(*rises: Rise) -> list[Term]:
    return [Term("spring", r) for r in rises]


def members() -> tuple[Member, ...]:
    odd = _springs(LINEAR, CUBIC)
    stops = odd + [Term("stop", q, (r,)) for q in (LINEAR, CUBIC) for r in THRESHOLDS]
    slips = odd + [Term("slip", q, (p,)) for q in (LINEAR, CUBIC) for p in PATHS]
    bent = _springs(STEEP, BENT, LINEAR, CUBIC)
    rises = (STEEP, BENT, LINEAR)
    maxwell = bent + [Term("maxwell", q, (t,)) for q in rises for t in TIMES_s]
    element = [Term("maxwell", q, FRACTIONAL_s, EXPONENT) for q in (STEEP, BENT, LINEAR, CUBIC)]
    fractional = bent + element
    offset = Term("offset")
    quick = [Term("maxwell", q, (t,)) for q in (LINEAR, CUBIC) for t in QUICK_s]
    friction = [*bent, *stops[len(odd) :], *quick, offset]
    dry = odd + [Term("slip", LINEAR, (p,)) for p in DRY]
    viscous = dry + [Term("maxwell", LINEAR, (t,)) for t in VISCOUS_s]
    # Friction that turns back otherwise at the two ends of a stroke.
    ends = [Rise("power", 1, "positive"), Rise("power", 1, "negative")]
    turning = [Term("maxwell", q, (t,)) for q in ends for t in TURNING_s]
    return (
        Member("stops", "springs and stop operators", tuple(stops)),
        Member("slips", "springs and slip operators", tuple(slips)),
        Member("stops, strain", "stops, softened by strain", softened(stops, STRAIN)),
        Member("slips, strain", "slips, softened by strain", softened(slips, STRAIN)),
        Member("stops, worn", "stops, softened by strain and path", softened(stops, *WORN)),
        Member("slips, worn", "slips, softened by strain and path", softened(slips, *WORN)),
        Member(
            "slips, worn, offset",
            "slips, softened by strain and path, and an offset",
            softened([*slips, offset], *WORN),
        ),
        Member("stops, Maxwell, offset", "bent springs, stops, Maxwell, offset", tuple(friction)),
        Member(
            "stops, sides, offset", "stops, Maxwell each side, offset", (*stops, *turning, offset)
        ),
        Member("slips, viscous", "fine slips and quick Maxwell branches", tuple(viscous)),
        Member("Maxwell", "bent springs and Maxwell branches", tuple(maxwell)),
        Member("fractional", "bent springs and a fractional element", tuple(fractional)),
        Member("Maxwell, strain", "Maxwell, softened by strain", softened(maxwell, STRAIN)),
        Member(
            "fractional, strain", "fractional, softened by strain", softened(fractional, STRAIN)
        ),
    )


# A term whose RMS torque is below this share of full scale is left out.
LEAST_SHARE = 1e-3
# Of the secant stiffness that the linear spring keeps at least, so that the inverse is unique.
LEAST_STIFFNESS = 0.01


class UnitTerms:
    """A member's terms over recordings, each with weight 1."""

    def __init__(self, member: Member, recordings: Sequence[Recording], rate_Hz: float) -> None:
        self.member, self.recordings = member, tuple(recordings)
        self.rate_Hz = rate_Hz
        self._runner = compile_block(unit_terms(member, 1 / rate_Hz))
        self._known: dict[float, list[Array]] = {}

    def over(self, scale_rad: float) -> list[Array]:
        """Terms at each recording's samples, shape (samples, terms)."""
        if scale_rad not in self._known:
            self._known[scale_rad] = [self._run(r, scale_rad) for r in self.recordings]
        return self._known[scale_rad]

    def having(self, recordings: Sequence[Recording]) -> UnitTerms:
        other = copy.copy(self)
        other.recordings, other._known = tuple(recordings), {}
        return other

    def _run(self, r: Recording, scale_rad: float) -> Array:
        x, grid = r.theta_rad, None
        if self.member.timed:
            grid = np.arange(math.ceil(r.time_s[-1] * self.rate_Hz) + 1) / self.rate_Hz
            x = resample(r.time_s, r.theta_rad, grid)
        self._runner.reset()
        terms = self._runner.run({"theta_rad": x / scale_rad}, trace=False)[0]["terms_Nm"]
        terms = np.asarray(terms, dtype=np.float64).reshape(len(x), -1)
        if grid is None:
            return terms
        return np.stack([resample(grid, c, r.time_s) for c in terms.T], axis=1)


def trained_scale(recordings: Sequence[Recording]) -> float:
    """Largest deflection in training."""
    return max(float(np.abs(r.theta_rad[s.training]).max()) for r, s in training_sets(recordings))


def solve_weights(basis: Array, target: Array, free: Sequence[bool], floor: Array) -> Array:
    """Weights of least square error, each at its floor or above, a free one of either sign."""
    both = np.flatnonzero(free)
    low = np.where(free, 0.0, floor)
    wide = np.concatenate([basis, -basis[:, both]], axis=1)
    high = np.full(wide.shape[1], np.inf)
    found = solve_linear(wide, target - basis @ low, np.zeros(wide.shape[1]), high)
    weights = low + found[: basis.shape[1]]
    weights[both] -= found[basis.shape[1] :]
    return np.asarray(weights)


def fit_member(
    terms: UnitTerms,
    recordings: Sequence[Recording],
    full_scale_Nm: float,
    least_share: float = LEAST_SHARE,
) -> FittedMember:
    member, scale = terms.member, trained_scale(recordings)
    basis, target = _weighted(terms, recordings, scale)
    free = [t.kind == "offset" for t in member.terms]
    twins = list(alike(member, basis))
    basis[:, twins] = 0.0
    floor = np.array([_floor(member, i, full_scale_Nm) for i in range(len(member.terms))])
    at_C = _temperatures(recordings)

    def solve(b: Array, y: Array) -> Array:
        return solve_weights(b, y, free, floor)

    factor = searched_factor(member, recordings, at_C, basis, target, solve)
    basis = at_temperature(member, factor, at_C, basis)
    weights = solve(basis, target)
    # The rows' squares sum to 1: these are root mean squares over the data sets.
    size = np.abs(weights) * np.sqrt(np.einsum("ij,ij->j", basis, basis))
    kept = (size >= least_share * full_scale_Nm) | (floor > 0)
    final = np.zeros(len(weights))
    where = np.flatnonzero(kept)
    final[where] = solve_weights(basis[:, where], target, [free[i] for i in where], floor[where])
    return FittedMember(member, scale, tuple(float(w) for w in final), factor)


def _weighted(
    terms: UnitTerms, recordings: Sequence[Recording], scale_rad: float
) -> tuple[Array, Array]:
    # As `_trained`, such that every data set counts the same.
    every, target = _trained(terms, recordings, scale_rad)
    rows = equal_weights([s.training for _, s in training_sets(recordings)])
    return every * rows[:, None], target * rows


def _trained(
    terms: UnitTerms, recordings: Sequence[Recording], scale_rad: float
) -> tuple[Array, Array]:
    # Terms and torque of the rows that train.
    pairs = zip(recordings, terms.over(scale_rad), strict=True)
    every = [c[s.training] for r, c in pairs for s in r.sets]
    target = [r.tau_Nm[s.training] for r, s in training_sets(recordings)]
    return np.concatenate(every), np.concatenate(target)


def alike(member: Member, basis: Array) -> dict[int, int]:
    """Terms that rows do not distinguish from simpler ones, with the substitutes, by place."""
    # Any split between two such terms is as good a fit, and says something else elsewhere: so the
    # simpler one carries the torque, an unsoftened one and a spring before others. Alike are
    # columns that, once scaled to each other, differ by less than :data:`LEAST_SHARE`: with all of
    # full scale on one of them, the difference would still be a torque that is left out as too
    # small.
    size = np.sqrt(np.einsum("ij,ij->j", basis, basis))
    scaled = basis / np.where(size > 0, size, 1.0)
    near = scaled.T @ scaled
    kept: list[int] = []
    out: dict[int, int] = {}
    plain = sorted(
        np.flatnonzero(size).tolist(),
        key=lambda i: (member.terms[i].softening is not None, member.terms[i].kind != "spring"),
    )
    for i in plain:
        # The same to the sign too, as no weight is below 0.
        same = [k for k in kept if near[i, k] > 0 and 1 - near[i, k] ** 2 < LEAST_SHARE**2]
        if same:
            out[i] = same[0]
        else:
            kept.append(i)
    return out


def not_seen(
    terms: UnitTerms, recordings: Sequence[Recording], fitted: FittedMember
) -> dict[int, int]:
    """As :func:`alike`, for terms whose substitute carries torque."""
    basis, _ = _weighted(terms, recordings, fitted.scale_rad)
    found = alike(fitted.member, basis)
    return {i: k for i, k in found.items() if fitted.weights_Nm[k]}


def _temperatures(recordings: Sequence[Recording]) -> Array:
    # Of each row that trains; NaN where it is not known.
    known = training_sets(recordings)
    at_C = [math.nan if r.temperature_C is None else r.temperature_C for r, _ in known]
    return np.repeat(at_C, [len(s.training) for _, s in known])


def member_spread(
    terms: UnitTerms, recordings: Sequence[Recording], fitted: FittedMember, full_scale_Nm: float
) -> tuple[dict[int, float | None], LeftOut]:
    """Standard deviations of the weights above 0, by place among the terms; None: at its bound."""
    # Which terms carry torque is taken as it was found. With a factor of temperature its ``per_K``
    # is the last parameter of what leaving out says.
    used, basis, residual, weight, rows = _fitted_rows(terms, recordings, fitted)
    # An offset may change its sign, and the change a kelvin; no other weight.
    low = np.full(basis.shape[1], -np.inf)
    for place, i in enumerate(used):
        if fitted.member.terms[i].kind != "offset":
            low[place] = -fitted.weights_Nm[i]
    room = low, np.full(len(low), np.inf)
    found = resampled(basis, residual, weight, rows, whole_conditions(recordings), room)
    sigma: dict[int, float | None] = {}
    for i, one in zip(used, found.sigma[: len(used)].tolist(), strict=True):
        floor = _floor(fitted.member, i, full_scale_Nm)
        sigma[i] = None if 0 < fitted.weights_Nm[i] <= floor * (1 + 1e-9) else one
    return sigma, found


def _fitted_rows(
    terms: UnitTerms, recordings: Sequence[Recording], fitted: FittedMember
) -> tuple[list[int], Array, Array, Array, FitRows]:
    # Terms that carry torque, their torque at weight 1 and where there is a factor of temperature
    # what a change of it by 1/K gives, residuals, weights, and the rows' blocks.
    used = [i for i, w in enumerate(fitted.weights_Nm) if w]
    sets = training_sets(recordings)
    ways = [np.sign(np.gradient(r.theta_rad))[s.training] for r, s in sets]
    every, target = _trained(terms, recordings, fitted.scale_rad)
    at_C, weights = _temperatures(recordings), np.array(fitted.weights_Nm)
    basis = at_temperature(fitted.member, fitted.temperature, at_C, every)[:, used]
    weight = equal_weights(ways) * np.sqrt(len(target))
    residual = target - basis @ weights[used]
    rows = rows_of(sets, ways)
    if fitted.temperature is not None:
        if rests_on_one(recordings, tells_none):
            rows = replace(rows, alone=True)
        warmed = every @ (weights * scaled_terms(fitted.member))
        basis = np.column_stack([basis, warmed * (at_C - fitted.temperature.reference_C)])
    return used, basis, residual, weight, rows


@dataclass
class MemberChannels:
    """A member as a ``ChannelModel`` of ``recording.channels``: nothing in it is searched."""

    terms: UnitTerms
    full_scale_Nm: float
    _fitted: FittedMember = field(init=False)

    def start(self, recordings: list[Recording]) -> None:
        """Nothing: weights have one best solution."""

    def solve(self, recordings: list[Recording]) -> float:
        """Solve the weights, small ones too: dropping some would make the cost jump."""
        self.terms = self.terms.having(recordings)
        self._fitted = fit_member(self.terms, recordings, self.full_scale_Nm, 0.0)
        _, _, residual, weight, _ = _fitted_rows(self.terms, recordings, self._fitted)
        return float(np.mean((residual * weight) ** 2))

    def torque_Nm(self, recordings: list[Recording]) -> Array:
        """With the weights of the last solution."""
        terms = self.terms.having(recordings)
        used, basis, _, _, _ = _fitted_rows(terms, recordings, self._fitted)
        weights = np.array([self._fitted.weights_Nm[i] for i in used])
        return np.asarray(basis[:, : len(used)] @ weights)

    def linearised(self) -> tuple[Array, Array, Array, FitRows]:
        """In the weights above 0, and the change a kelvin."""
        return _fitted_rows(self.terms, self.terms.recordings, self._fitted)[1:]


def misfits_of(terms: UnitTerms, recordings: Sequence[Recording], fitted: FittedMember) -> Misfits:
    """Errors of a fitted member on the recordings that its terms were run over."""
    weights = np.array(fitted.weights_Nm)
    pairs = zip(recordings, terms.over(fitted.scale_rad), strict=True)
    warmed = (
        (r, at_temperature(fitted.member, fitted.temperature, r.temperature_C, c)) for r, c in pairs
    )
    errors = ((r, c @ weights - r.tau_Nm) for r, c in warmed)
    return Misfits.of("Nm", errors)


def term_rows(fitted: FittedMember) -> list[dict[str, Any]]:
    return [
        {
            "term": t.text,
            "kind": t.kind,
            "rise": [t.rise.kind, t.rise.number, t.rise.side],
            "numbers": list(t.numbers),
            "exponent": t.exponent,
            "softening": None if t.softening is None else [t.softening.kind, t.softening.number],
            "weight_Nm": w,
        }
        for w, t in fitted.used
    ]


def _floor(member: Member, i: int, full_scale_Nm: float) -> float:
    # The unsoftened linear spring of a member keeps a little.
    term = member.terms[i]
    linear = term.kind == "spring" and term.softening is None and term.rise.least_slope(1.0) == 1.0
    return LEAST_STIFFNESS * full_scale_Nm if linear else 0.0
