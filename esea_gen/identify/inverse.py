"""Refit of the published inverse's play operators to recordings (4.14).

Measured torque in, measured deflection out: kappa, phi and chi of table 4.2 are chosen so that the
RMS difference between the inverse's set-point and the measured deflection is least.  The fit runs
the emitted C of the published inverse without its observer, with the three as tunables; it does not
depend on time, so it runs on the recording's own samples.  The set-point is kappa times something
that depends on phi and chi alone: only these two are searched, and kappa follows in closed form.

With small thresholds the weights ``kappa exp(-phi chi j)`` are nearly equal, and phi then does
little that kappa does not do as well: the result has the uncertainty of each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy  # its parts are read on first use

from esea_gen.device import Device, parse_device, with_numbers
from esea_gen.devices.fields import Inverse, field_facts
from esea_gen.devices.file import render_toml
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_block
from esea_gen.identify.drafting import assumed, determined, files_of, identified
from esea_gen.identify.identification import Identification
from esea_gen.identify.identified import gated
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.published.plant import (
    ROWS_REFINE,
    ROWS_SEARCH,
    equal_weights,
    relative_jacobian,
    thinned,
)
from esea_gen.identify.published.search_problem import (
    Residual,
    finalists,
    polished,
    runner_up,
    sobol_points,
)
from esea_gen.identify.recording.recorded import Misfits, Recording, training_sets
from esea_gen.identify.recording.resampling import Determined
from esea_gen.language.ports import Array
from esea_gen.model.inverse import chosen_inverse
from esea_gen.model.published_inverse import PLAY_DEFAULTS, PLAYS, published_inverse

KEYS = ("kappa_rad", "phi_1_rad", "chi_rad")
# A rise of the RMS error by this share is hardly seen: phi's range is given for it.
SEEN = 0.01
PROFILE = 11


def play_bounds(key: str) -> tuple[float, float]:
    facts = field_facts(f"inverse.{key}")
    return float(facts["low"]), float(facts["high"])


def _sure(key: str, value: float, sigma: float | None) -> str:
    if sigma is not None:
        return f"standard deviation {sigma:.2g}"
    bound = play_at_bound(key, value)
    return f"at its {bound} bound" if bound else "not determined"


def play_at_bound(key: str, value: float) -> str | None:
    low, high = play_bounds(key)
    margin = 1e-4 * (high - low) if key != "chi_rad" else 1e-9
    if value <= low + margin:
        return "lower"
    return "upper" if value >= high - margin else None


class PlayPlant:
    def __init__(
        self, device: Device, recordings: Sequence[Recording], rows: int | None = None
    ) -> None:
        # A trial's set-point may be far off: nothing may clip it.
        wide = with_numbers(device, {"limits.theta_rad": 1e3})
        self.runner = compile_block(published_inverse(wide, tunable=True))
        self.evaluations = 0
        self._torque: list[Array] = []
        self._at: list[npt.NDArray[np.intp]] = []
        measured: list[Array] = []
        for r in recordings:
            sets = [thinned(s.training, rows) for s in r.sets if len(s.training)]
            if sets:
                self._torque.append(r.tau_Nm)
                self._at.append(np.concatenate(sets))
                measured += [r.theta_rad[x] for x in sets]
        self.weight = equal_weights(measured)
        self.measured = np.concatenate(measured)

    def set_point(self, kappa: float, phi: float, chi: float) -> Array:
        self.evaluations += 1
        out = []
        for torque, at in zip(self._torque, self._at, strict=True):
            self.runner.prepare({"kappa_rad": kappa, "phi_1_rad": phi, "chi_rad": chi})
            y, _ = self.runner.run({"tau_Nm": torque}, trace=False)
            out.append(y["theta_rad"][at])
        return np.concatenate(out)

    def solve(self, phi: float, chi: float) -> tuple[float, Array]:
        """Best weight for given decay and spacing."""
        unit = self.weight * self.set_point(1.0, phi, chi)
        wanted = self.weight * self.measured
        size = float(unit @ unit)
        low, high = play_bounds("kappa_rad")
        kappa = min(max(float(unit @ wanted) / size, low), high) if size > 0 else low
        return kappa, kappa * unit - wanted


def play_space(device: Device, recordings: Sequence[Recording]) -> tuple[Array, Array]:
    """Bounds of the searched numbers: phi and the logarithm of chi."""
    # Thresholds beyond the envelope's range never let go; far below it they do nothing.
    k1, k3 = device.elastomer.k1_Nm_rad.value, device.elastomer.k3_Nm_rad3.value
    torque = max(float(np.abs(r.tau_Nm).max()) for r in recordings)
    roots = np.roots([k3, 0.0, k1, -torque]) if k3 > 0 else np.array([torque / max(k1, 1e-12)])
    reach = float(min(r.real for r in roots if abs(r.imag) < 1e-9 * max(1.0, abs(r))))
    chi_low, chi_high = play_bounds("chi_rad")
    phi_low, phi_high = play_bounds("phi_1_rad")
    least = max(chi_low, reach / 5000)
    return (
        np.array([phi_low, math.log(least)]),
        np.array([phi_high, math.log(max(min(chi_high, reach), 2 * least))]),
    )


def play_spread(
    plant: PlayPlant, values: dict[str, float]
) -> tuple[dict[str, float | None], dict[str, float]]:
    """Standard deviations and correlations from the Jacobian, as the forward model's are."""
    sigma: dict[str, float | None] = dict.fromkeys(values)
    free = [k for k in KEYS if play_at_bound(k, values[k]) is None]

    def run(v: dict[str, float]) -> Array:
        out: Array = plant.weight * plant.set_point(v["kappa_rad"], v["phi_1_rad"], v["chi_rad"])
        return out

    error = run(values) - plant.weight * plant.measured
    if not free or not error @ error > 0:
        return sigma, {}
    fit = Determined.of(relative_jacobian(run, values, free, 1e-4), error, np.ones(len(error)))
    if np.any(fit.unknown):
        return sigma, {}
    covariance = fit.plain()
    relative = np.sqrt(np.diag(covariance))
    for k, s in zip(free, relative, strict=True):
        sigma[k] = float(s) * values[k]
    correlation = {
        f"{free[i]} {free[j]}": float(covariance[i, j] / (relative[i] * relative[j]))
        for i in range(len(free))
        for j in range(i)
    }
    return sigma, correlation


def phi_range(plant: PlayPlant, best: Array, low: Array, high: Array) -> tuple[float, float]:
    """Where the RMS error stays within ``SEEN`` of the least one, kappa and chi refitted."""
    (own, own_chi), (least_phi, least_chi), (most_phi, most_chi) = map(
        np.ndarray.tolist, (best, low, high)
    )

    def rms(phi: float, log_chi: float) -> float:
        _, error = plant.solve(phi, math.exp(log_chi))
        return float(np.linalg.norm(error))

    def refitted(phi: float) -> float:
        done = scipy.optimize.minimize_scalar(
            lambda s: rms(phi, s),
            bounds=(max(least_chi, own_chi - 1.5), min(most_chi, own_chi + 1.5)),
            method="bounded",
            options={"maxiter": 25, "xatol": 1e-4},
        )
        return float(done.fun)

    most = (1 + SEEN) * rms(own, own_chi)
    grid = np.linspace(least_phi, most_phi, PROFILE).tolist()
    inside = [own, *(p for p in grid if refitted(p) <= most)]
    return min(inside), max(inside)


SEED = 20240229
POPULATION = 64
FINALISTS = 4
POLISH = {"diff_step": 1e-5, "max_nfev": 60, "ftol": 1e-10, "xtol": 1e-10, "gtol": 1e-15}
SHARP = 0.5  # a standard deviation above this share of the value is called out
ALIKE = 0.95  # a correlation beyond this is called out


def judge_inverse(device: Device, recordings: Sequence[Recording]) -> Misfits:
    """Run a device's published inverse, as it ships, on measured torque."""
    runner = compile_block(chosen_inverse(device))
    errors = []
    for r in recordings:
        runner.reset()
        y, _ = runner.run({"tau_Nm": r.tau_Nm}, trace=False)
        errors.append((r, np.asarray(y["theta_rad"], dtype=np.float64) - r.theta_rad))
    return Misfits.of("rad", errors)


@dataclass(frozen=True)
class InverseFit:
    device: Device  # the device with [inverse] of kind published and the parameters found
    values: dict[str, float]  # kappa_rad, phi_1_rad, chi_rad
    sigma: dict[str, float | None]  # None: at a bound, or without effect
    correlation: dict[str, float]
    phi_range_1_rad: tuple[float, float]  # over it the RMS error rises by less than 1 %
    sets: Misfits  # errors of the parameters found, and of table 4.2's on the same data
    published: Misfits
    seed: int  # of the search; runs of the C over all training data
    population: int
    evaluations: int
    runner_up: float  # second finalist's cost over the best's
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        full = self.device.file.domain.theta_max_rad.value
        parameters = {}
        for key, value in self.values.items():
            low, high = play_bounds(key)
            parameters[key] = {"value": value, "sigma": self.sigma[key], "low": low, "high": high}
            parameters[key]["published"] = PLAY_DEFAULTS[key]
        return {
            "parameters": parameters,
            "correlation": self.correlation,
            "phi_range_1_rad": list(self.phi_range_1_rad),
            "full_scale_rad": full,
            "sets": [{"label": s.label} | errors for s, errors in self.sets.rows(full)],
            "mean_rms": self.sets.means(full),
            "mean_rms_published": self.published.means(full),
            "search": {
                "fitness": "mean over data sets of the mean square deflection error (4.14)",
                **{k: getattr(self, k) for k in ("seed", "population", "evaluations")},
                "runner_up": self.runner_up if math.isfinite(self.runner_up) else None,
            },
            "notes": list(self.notes),
        }

    def summary(self) -> list[str]:
        lines = ["inverse, play operators refitted (table 4.2 in brackets):"]
        for key, value in self.values.items():
            sure = _sure(key, value, self.sigma[key])
            lines.append(f"  {key:10} {value:.5g} ({PLAY_DEFAULTS[key]:g}), {sure}")
        for what, sets in (("refitted", self.sets), ("table 4.2", self.published)):
            found = sets.means(self.device.file.domain.theta_max_rad.value)
            cells = [
                f"{name.replace('_', ' ')} {found[f'{name}_percent']:5.2f} %"
                for name in ("training", "held_out")
                if found[f"{name}_percent"] is not None
            ]
            lines.append(f"  {what:10} {', '.join(cells)} of the largest deflection, RMS")
        return lines + [f"note: {note}" for note in self.notes]


def refit_inverse(
    device: Device,
    recordings: Sequence[Recording],
    source: str,
    *,
    seed: int = SEED,
    population: int = POPULATION,
    progress: Progress | None = None,
) -> InverseFit:
    tell: Progress = progress or (lambda share, text: None)
    _check(device, recordings)
    coarse = PlayPlant(device, recordings, ROWS_SEARCH)
    low, high = play_space(device, recordings)

    points = sobol_points(low, high, population, seed)
    costs = np.empty(population)
    for i, place in enumerate(points):
        error = _residual(coarse)(place)
        costs[i] = error @ error
        best = math.sqrt(costs[: i + 1].min())
        tell(0.4 * i / population, f"inverse, population: best {best:.4g} rad")
    chosen = finalists(points, costs, low, high, FINALISTS)
    ends = []
    for number, start in enumerate(chosen, 1):
        ends.append(polished(_residual(coarse), start, low, high, **POLISH))
        tell(0.4 + 0.2 * number / len(chosen), f"inverse, refinement {number}")
    ends.sort(key=lambda e: e[0])
    fine = PlayPlant(device, recordings, ROWS_REFINE)
    _, x = polished(_residual(fine), ends[0][1], low, high, **POLISH)
    phi, chi = float(x[0]), math.exp(x[1])
    values = {"kappa_rad": fine.solve(phi, chi)[0], "phi_1_rad": phi, "chi_rad": chi}
    tell(0.7, "inverse, how well it is known")
    sigma, correlation = play_spread(fine, values)
    reach = phi_range(coarse, x, low, high)
    fitted = _with_inverse(device, values, sigma, source)
    sets = judge_inverse(fitted, recordings)
    published = judge_inverse(_with_inverse(device, PLAY_DEFAULTS, {}, "table 4.2"), recordings)
    count, second = coarse.evaluations + fine.evaluations, runner_up([e[0] for e in ends])
    found = fitted, values, sigma, correlation, reach, sets, published
    fit = InverseFit(*found, seed, population, count, second)
    tell(1.0, "inverse, done")
    return replace(fit, notes=tuple(_notes(fit, x[1], low[1], high[1])))


def refit_identified(
    result: Identification, progress: Progress | None = None
) -> tuple[Identification, InverseFit]:
    """Refit the inverse of a device that has just been identified, on the same recordings."""
    source = f"{files_of(result.recordings)} ({result.source.origin})"
    seed = result.source.mapping.search.seed
    fit = refit_inverse(result.device, result.recordings, source, seed=seed, progress=progress)
    return replace(result, device=gated(fit.device, result.recordings)), fit


def _residual(plant: PlayPlant) -> Residual:
    return lambda x: plant.solve(float(x[0]), math.exp(x[1]))[1]


def _check(device: Device, recordings: Sequence[Recording]) -> None:
    zone = device.elastomer.dead_zone_rad
    if zone is not None and zone.value > 0:
        raise UserError(
            f"{device.origin}: elastomer.dead_zone_rad = {zone.value:g}: the published inverse has "
            "no dead zone.",
            "Use the exact inverse for this device.",
        )
    if not training_sets(recordings):
        raise UserError("No recording trains the inverse.", "Give one with training cycles.")
    limit = device.file.limits.tau_Nm.value
    for r in recordings:
        reach = float(np.abs(r.tau_Nm).max())
        if reach > limit:
            raise UserError(
                f"{r.label}: a torque of {reach:.3g} Nm is above {device.name}'s limits.tau_Nm = "
                f"{limit:g} Nm: the inverse would clamp it.",
                "Change the mapping's torque scale, or use a device with a wider limit.",
            )


def _with_inverse(
    device: Device, values: dict[str, float], sigma: dict[str, float | None], source: str
) -> Device:
    found = {}
    for key, v in values.items():
        s = sigma.get(key)
        kind = identified if s is not None and determined(v, s) else assumed
        found[key] = kind(float(v), f"{source}; {_sure(key, v, s)}")
    section = Inverse(kind="published", **found)
    file = device.file.model_copy(update={"inverse": section})
    return parse_device(render_toml(file), f"{file.name}.toml")


def _notes(fit: InverseFit, log_chi: float, least: float, most: float) -> Iterator[str]:
    margin = 1e-3 * (most - least)
    if log_chi <= least + margin:
        yield (
            "Inverse: the thresholds are as small as allowed: the data show no hysteresis for the "
            "play operators, and chi and phi mean nothing."
        )
    elif log_chi >= most - margin:
        yield "Inverse: the thresholds are as large as the recorded range allows."
    for key, value in fit.values.items():
        bound, s = play_at_bound(key, value), fit.sigma[key]
        if bound:
            yield f"Inverse: {key} = {value:.4g} is at its {bound} bound."
        elif s is not None and s > SHARP * abs(value):
            yield f"Inverse: {key} = {value:.4g} is poorly determined (standard deviation {s:.2g})."
    low, high = play_bounds("phi_1_rad")
    reach = fit.phi_range_1_rad
    if reach[1] - reach[0] > 0.5 * (high - low):
        yield (
            "Inverse: phi is not identifiable: from "
            f"{reach[0]:.3g} to {reach[1]:.3g} 1/rad the RMS error rises by less than "
            f"{100 * SEEN:g} %, kappa and chi making up for it."
        )
    for pair, c in fit.correlation.items():
        if abs(c) > ALIKE:
            a, b = pair.split()
            yield f"Inverse: {a} and {b} are correlated by {c:+.3f}."
    ours, theirs = fit.sets.mean_rms(True), fit.published.mean_rms(True)
    if math.isfinite(ours) and theirs < ours:
        yield (
            f"Inverse: on held-out cycles table 4.2 does better ({theirs:.3g} rad) than the refit "
            f"({ours:.3g} rad)."
        )
    trained = fit.sets.mean_rms(False)
    if math.isfinite(ours) and ours > 1.5 * trained:
        yield (
            f"Inverse: held out {ours:.3g} rad against {trained:.3g} rad in training: the fit does "
            "not carry over well."
        )
    yield (
        f"Inverse: {PLAYS} play operators, rate neglected as published; the observer's filter is "
        'chosen with inverse.filter, and kind = "exact" needs none of these numbers.'
    )
