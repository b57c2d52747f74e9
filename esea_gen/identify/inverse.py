"""Refit of the published inverse's play operators to recordings (4.14).

Measured torque in, measured deflection out: kappa, phi and chi of table 4.2 are chosen so that the
RMS difference between the inverse's set-point and the measured deflection is least.  What runs is
the emitted C of the published inverse without its observer, the three made tunable; nothing in it
depends on time, so it runs on the recording's own samples.

The set-point is kappa times something that depends on phi and chi alone.  So only these two are
searched, and kappa follows in closed form.  The thesis took a genetic algorithm and an interior
point method for all three; the optimum is the same one, found in seconds.

With small thresholds the weights ``kappa exp(-phi chi j)`` are nearly equal, and phi then does
little that kappa does not do as well.  The result says how well each is known: standard deviations
with their correlation, and the range of phi over which the error hardly changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares, minimize_scalar
from scipy.stats import qmc

from esea_gen.device import Device, parse_device
from esea_gen.devices.fields import Inverse, Quantity, field_facts
from esea_gen.devices.writing import render_toml
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.hostlib.runner import CRunner
from esea_gen.identify.fit import ROWS_REFINE, ROWS_SEARCH, Progress, with_values
from esea_gen.identify.identification import Identification
from esea_gen.identify.recording import DataSet, Recording
from esea_gen.model.inverse import chosen_inverse, inverse_system
from esea_gen.model.published_inverse import PLAY_DEFAULTS, PLAYS, published_inverse

Array = npt.NDArray[np.float64]

SEED = 20240229
POPULATION = 64
FINALISTS = 4
KEYS = ("kappa_rad", "phi_1_rad", "chi_rad")
# A rise of the RMS error by this share is hardly seen: phi's range is given for it.
SEEN = 0.01
PROFILE = 11
SHARP = 0.5  # a standard deviation above this share of the value is called out
ALIKE = 0.95  # a correlation beyond this is called out


def play_bounds(key: str) -> tuple[float, float]:
    """Bounds of a play operator's parameter, those of the device file."""
    facts = field_facts(f"inverse.{key}")
    return float(facts["low"]), float(facts["high"])


class PlayPlant:
    """The compiled play operators over all recordings.

    device: gives the envelope's k1 and k3.
    rows: most training samples of a data set to compare with, evenly spread; all when not given.
        The C runs over all samples in any case.
    """

    def __init__(
        self, device: Device, recordings: Sequence[Recording], rows: int | None = None
    ) -> None:
        # A trial's set-point may be far off: nothing may clip it.
        wide = with_values(device, {}, limits={"theta_rad": 1e3})
        block = published_inverse(wide, tunable=True)
        self.runner: CRunner = compile_system(inverse_system(wide, block), "f64").block(block.name)
        self.evaluations = 0
        self._torque: list[Array] = []
        self._at: list[npt.NDArray[np.intp]] = []
        weights, values = [], []
        for r in recordings:
            sets = [s.training for s in r.sets if len(s.training)]
            if not sets:
                continue
            thin = [x if rows is None else x[:: math.ceil(len(x) / rows)] for x in sets]
            self._torque.append(r.tau_Nm)
            self._at.append(np.concatenate(thin))
            weights += [np.full(len(x), 1.0 / len(x)) for x in thin]
            values += [r.theta_rad[x] for x in thin]
        # Every data set counts the same, however long it is.
        w = np.concatenate(weights)
        self.weight = np.sqrt(w / w.sum())
        self.measured = np.concatenate(values)

    def set_point(self, kappa: float, phi: float, chi: float) -> Array:
        """Set-point at the training rows."""
        self.evaluations += 1
        out = []
        for torque, at in zip(self._torque, self._at, strict=True):
            self.runner.prepare({"kappa_rad": kappa, "phi_1_rad": phi, "chi_rad": chi})
            y, _ = self.runner.run({"tau_Nm": torque}, trace=False)
            out.append(y["theta_rad"][at])
        return np.concatenate(out)

    def solve(self, phi: float, chi: float) -> tuple[float, Array]:
        """Best weight for given decay and spacing.

        return: weighted deflection error at the training rows, its square sum the mean square
            error.
        """
        unit = self.weight * self.set_point(1.0, phi, chi)
        wanted = self.weight * self.measured
        size = float(unit @ unit)
        low, high = play_bounds("kappa_rad")
        kappa = min(max(float(unit @ wanted) / size, low), high) if size > 0 else low
        return kappa, kappa * unit - wanted


@dataclass(frozen=True)
class Misfit:
    """Deflection errors of one data set.

    rms_rad, max_rad: root mean square and largest magnitude.
    """

    rms_rad: float
    max_rad: float

    @classmethod
    def of(cls, error_rad: Array) -> Misfit | None:
        """Of an error signal; None for an empty one."""
        if not len(error_rad):
            return None
        return cls(float(np.sqrt(np.mean(error_rad**2))), float(np.abs(error_rad).max()))

    def to_dict(self, theta_max_rad: float) -> dict[str, float]:
        """In rad and in % of the largest identified deflection."""
        return {
            "rms_rad": self.rms_rad,
            "rms_percent": 100 * self.rms_rad / theta_max_rad,
            "max_rad": self.max_rad,
            "max_percent": 100 * self.max_rad / theta_max_rad,
        }


SetMisfits = tuple[tuple[DataSet, Misfit | None, Misfit | None], ...]


def judge_inverse(device: Device, recordings: Sequence[Recording]) -> SetMisfits:
    """Run a device's published inverse, as it ships, on measured torque.

    return: (data set, errors in training, errors held out), in order.
    """
    block = chosen_inverse(device)
    runner = compile_system(inverse_system(device, block), "f64").block(block.name)
    out = []
    for r in recordings:
        runner.reset()
        y, _ = runner.run({"tau_Nm": r.tau_Nm}, trace=False)
        error = np.asarray(y["theta_rad"], dtype=np.float64) - r.theta_rad
        out += [(s, Misfit.of(error[s.training]), Misfit.of(error[s.held_out])) for s in r.sets]
    return tuple(out)


def mean_rms_rad(sets: SetMisfits, held_out: bool) -> float:
    """Mean over data sets of the RMS deflection error."""
    found = [e[2] if held_out else e[1] for e in sets]
    sizes = [e.rms_rad for e in found if e is not None]
    return float(np.mean(sizes)) if sizes else math.nan


@dataclass(frozen=True)
class InverseFit:
    """A refitted inverse.

    device: the device with ``[inverse]`` of kind ``published`` and the parameters found.
    values: ``kappa_rad``, ``phi_1_rad``, ``chi_rad``.
    sigma: standard deviation of each; None for one at a bound or without effect.
    correlation: of each pair that has standard deviations, ``"kappa_rad phi_1_rad"``.
    phi_range_1_rad: range of phi over which the RMS error, kappa and chi refitted, rises by less
        than 1 %.
    sets, published: errors of the parameters found, and of table 4.2's on the same data.
    seed, population, evaluations: of the search; runs of the C over all training data.
    runner_up: cost of the second best finalist over the best's: 1 when the optimum was found
        repeatedly.
    """

    device: Device
    values: dict[str, float]
    sigma: dict[str, float | None]
    correlation: dict[str, float]
    phi_range_1_rad: tuple[float, float]
    sets: SetMisfits
    published: SetMisfits
    seed: int
    population: int
    evaluations: int
    runner_up: float
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content, the same for the same input.

        return: parameters with standard deviation and bounds, errors per data set in rad and in %
            of the largest identified deflection, notes.
        """
        full = self.device.file.domain.theta_max_rad.value
        parameters = {}
        for key, value in self.values.items():
            low, high = play_bounds(key)
            parameters[key] = {
                "value": value,
                "sigma": self.sigma[key],
                "low": low,
                "high": high,
                "published": PLAY_DEFAULTS[key],
            }
        return {
            "parameters": parameters,
            "correlation": self.correlation,
            "phi_range_1_rad": list(self.phi_range_1_rad),
            "full_scale_rad": full,
            "sets": [
                {
                    "label": s.label,
                    "training": None if a is None else a.to_dict(full),
                    "held_out": None if b is None else b.to_dict(full),
                }
                for s, a, b in self.sets
            ],
            "mean_rms": self._means(self.sets),
            "mean_rms_published": self._means(self.published),
            "search": {
                "fitness": "mean over data sets of the mean square deflection error (4.14)",
                "seed": self.seed,
                "population": self.population,
                "evaluations": self.evaluations,
                "runner_up": self.runner_up if math.isfinite(self.runner_up) else None,
            },
            "notes": list(self.notes),
        }

    def _means(self, sets: SetMisfits) -> dict[str, float | None]:
        full = self.device.file.domain.theta_max_rad.value
        out: dict[str, float | None] = {}
        for name, held in (("training", False), ("held_out", True)):
            rms = mean_rms_rad(sets, held)
            known = math.isfinite(rms)
            out[f"{name}_rad"] = rms if known else None
            out[f"{name}_percent"] = 100 * rms / full if known else None
        return out

    def summary(self) -> list[str]:
        """A few lines for the terminal: parameters, error on held-out cycles, notes."""
        lines = ["inverse, play operators refitted (table 4.2 in brackets):"]
        for key, value in self.values.items():
            sigma, bound = self.sigma[key], _at_bound(key, value)
            sure = f"at its {bound} bound" if bound else "not determined"
            if sigma is not None:
                sure = f"standard deviation {sigma:.2g}"
            lines.append(f"  {key:10} {value:.5g} ({PLAY_DEFAULTS[key]:g}), {sure}")
        for what, sets in (("refitted", self.sets), ("table 4.2", self.published)):
            found = self._means(sets)
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
    """Refit kappa, phi and chi to recordings.

    device: forward model: k1 and k3 of the envelope. It must have no dead zone.
    source: what the device file shall name as the parameters' source.
    progress: ``progress(share, text)``.
    """
    tell: Progress = progress or (lambda share, text: None)
    _check(device, recordings)
    coarse = PlayPlant(device, recordings, ROWS_SEARCH)
    low, high = _space(device, recordings)

    def residual(plant: PlayPlant, x: Array) -> Array:
        return plant.solve(float(x[0]), math.exp(x[1]))[1]

    sampler = qmc.Sobol(2, seed=seed)
    points = qmc.scale(sampler.random(population), low, high)
    costs = np.empty(population)
    for i, x in enumerate(points):
        e = residual(coarse, x)
        costs[i] = e @ e
        if i % 8 == 0:
            best = math.sqrt(float(costs[: i + 1].min()))
            tell(0.4 * i / population, f"inverse, population: best {best:.4g} rad")
    unit = (points - low) / (high - low)
    chosen: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        # The best ones that are not neighbours of a better one.
        if all(np.abs(unit[i] - unit[j]).max() > 0.1 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == FINALISTS:
            break
    ends = []
    for place, i in enumerate(chosen):
        ends.append(_polish(coarse, residual, points[i], low, high))
        tell(0.4 + 0.2 * (place + 1) / len(chosen), f"inverse, refinement {place + 1}")
    ends.sort(key=lambda e: e[0])
    fine = PlayPlant(device, recordings, ROWS_REFINE)
    _, x = _polish(fine, residual, ends[0][1], low, high)
    phi, chi = float(x[0]), math.exp(x[1])
    values = {"kappa_rad": fine.solve(phi, chi)[0], "phi_1_rad": phi, "chi_rad": chi}
    tell(0.7, "inverse, how well it is known")
    sigma, correlation = _spread(fine, values)
    phi_range = _phi_range(coarse, x, low, high)
    fitted = _with_inverse(device, values, sigma, source)
    sets = judge_inverse(fitted, recordings)
    published = judge_inverse(_with_inverse(device, PLAY_DEFAULTS, {}, "table 4.2"), recordings)
    notes = _notes(values, sigma, correlation, phi_range, (low, high), x, sets, published)
    tell(1.0, "inverse, done")
    return InverseFit(
        device=fitted,
        values=values,
        sigma=sigma,
        correlation=correlation,
        phi_range_1_rad=phi_range,
        sets=sets,
        published=published,
        seed=seed,
        population=population,
        evaluations=coarse.evaluations + fine.evaluations,
        runner_up=ends[1][0] / ends[0][0] if len(ends) > 1 and ends[0][0] > 0 else math.inf,
        notes=notes,
    )


def refit_identified(
    result: Identification, progress: Progress | None = None
) -> tuple[Identification, InverseFit]:
    """Refit the inverse of a device that has just been identified, on the same recordings.

    result: its device is the forward model; the mapping's search seed is used.
    progress: ``progress(share, text)``.
    return: the same, its device with ``[inverse]``, so that :meth:`Identification.write` writes it.
    """
    names = [r.file for r in result.recordings if any(len(s.training) for s in r.sets)]
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    source = f"{names[0]}{more} ({result.source.origin})"
    seed = result.source.mapping.search.seed
    fit = refit_inverse(result.device, result.recordings, source, seed=seed, progress=progress)
    return replace(result, device=fit.device), fit


def _check(device: Device, recordings: Sequence[Recording]) -> None:
    zone = device.file.elastomer.dead_zone_rad
    if zone is not None and zone.value > 0:
        raise UserError(
            f"{device.origin}: elastomer.dead_zone_rad = {zone.value:g}: the published inverse has "
            "no dead zone.",
            "Use the exact inverse for this device.",
        )
    if not any(len(s.training) for r in recordings for s in r.sets):
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


def _space(device: Device, recordings: Sequence[Recording]) -> tuple[Array, Array]:
    # Thresholds beyond the envelope's range never let go; far below it they do nothing.
    k1, k3 = device.file.elastomer.k1_Nm_rad.value, device.file.elastomer.k3_Nm_rad3.value
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


def _polish(
    plant: PlayPlant, residual: Any, start: Array, low: Array, high: Array
) -> tuple[float, Array]:
    width = high - low
    done = least_squares(
        lambda x: residual(plant, x),
        np.clip(start, low + 1e-6 * width, high - 1e-6 * width),
        bounds=(low, high),
        x_scale=width,
        diff_step=1e-5,
        max_nfev=60,
        ftol=1e-10,
        xtol=1e-10,
        gtol=1e-15,
    )
    return 2 * float(done.cost), np.asarray(done.x, dtype=np.float64)


def _at_bound(key: str, value: float) -> str | None:
    low, high = play_bounds(key)
    margin = 1e-4 * (high - low) if key != "chi_rad" else 1e-9
    if value <= low + margin:
        return "lower"
    return "upper" if value >= high - margin else None


def _spread(
    plant: PlayPlant, values: dict[str, float]
) -> tuple[dict[str, float | None], dict[str, float]]:
    """Standard deviations and correlations from the Jacobian, as the forward model's are.

    Assumed: the model form is right, the residuals a first-order autoregressive noise.
    """
    sigma: dict[str, float | None] = dict.fromkeys(values)
    free = [k for k in KEYS if _at_bound(k, values[k]) is None]
    scale = plant.weight * math.sqrt(len(plant.measured))

    def run(v: dict[str, float]) -> Array:
        out: Array = scale * plant.set_point(v["kappa_rad"], v["phi_1_rad"], v["chi_rad"])
        return out

    error = run(values) - scale * plant.measured
    if not free or not error @ error > 0:
        return sigma, {}
    columns = []
    for k in free:
        step = 1e-4 * values[k]
        up, down = (run({**values, k: values[k] + s}) for s in (step, -step))
        columns.append((up - down) / (2 * step) * values[k])
    _, singular, v = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    if singular[-1] < 1e-9 * singular[0]:
        return sigma, {}
    rho = float(error[1:] @ error[:-1] / (error @ error))
    rho = min(max(rho, 0.0), 1 - 2.0 / len(error))
    noise = float(error @ error) / max(1, len(error) - len(free)) * (1 + rho) / (1 - rho)
    covariance: Array = noise * (v.T / singular**2) @ v
    relative = np.sqrt(np.diag(covariance))
    for k, s in zip(free, relative, strict=True):
        sigma[k] = float(s) * values[k]
    correlation = {
        f"{free[i]} {free[j]}": float(covariance[i, j] / (relative[i] * relative[j]))
        for i in range(len(free))
        for j in range(i)
    }
    return sigma, correlation


def _phi_range(plant: PlayPlant, best: Array, low: Array, high: Array) -> tuple[float, float]:
    """Where the RMS error stays within ``SEEN`` of the least one, kappa and chi refitted."""

    def rms(phi: float) -> float:
        done = minimize_scalar(
            lambda s: float(np.linalg.norm(plant.solve(phi, math.exp(s))[1])),
            bounds=(max(low[1], best[1] - 1.5), min(high[1], best[1] + 1.5)),
            method="bounded",
            options={"maxiter": 25, "xatol": 1e-4},
        )
        return float(done.fun)

    grid = np.linspace(low[0], high[0], PROFILE)
    least = float(np.linalg.norm(plant.solve(float(best[0]), math.exp(best[1]))[1]))
    inside = [float(p) for p in grid if rms(float(p)) <= (1 + SEEN) * least]
    return min([float(best[0]), *inside]), max([float(best[0]), *inside])


def _with_inverse(
    device: Device, values: dict[str, float], sigma: dict[str, float | None], source: str
) -> Device:
    def describe(key: str) -> str:
        bound = _at_bound(key, values[key])
        if bound:
            return f"{source}; at its {bound} bound"
        s = sigma.get(key)
        return source if s is None else f"{source}; standard deviation {s:.2g}"

    section = Inverse(
        kind="published",
        **{
            k: Quantity(value=float(v), status="identified", source=describe(k))
            for k, v in values.items()
        },
    )
    file = device.file.model_copy(update={"inverse": section})
    return parse_device(render_toml(file), f"{file.name}.toml")


def _notes(
    values: dict[str, float],
    sigma: dict[str, float | None],
    correlation: dict[str, float],
    phi_range: tuple[float, float],
    space: tuple[Array, Array],
    x: Array,
    sets: SetMisfits,
    published: SetMisfits,
) -> tuple[str, ...]:
    notes = []
    margin = 1e-3 * (space[1][1] - space[0][1])
    if x[1] <= space[0][1] + margin:
        notes.append(
            "Inverse: the thresholds are as small as allowed: the data show no hysteresis for the "
            "play operators, and chi and phi mean nothing."
        )
    elif x[1] >= space[1][1] - margin:
        notes.append("Inverse: the thresholds are as large as the recorded range allows.")
    for key, value in values.items():
        bound, s = _at_bound(key, value), sigma[key]
        if bound:
            notes.append(f"Inverse: {key} = {value:.4g} is at its {bound} bound.")
        elif s is not None and s > SHARP * abs(value):
            notes.append(
                f"Inverse: {key} = {value:.4g} is poorly determined (standard deviation {s:.2g})."
            )
    low, high = play_bounds("phi_1_rad")
    if phi_range[1] - phi_range[0] > 0.5 * (high - low):
        notes.append(
            "Inverse: phi is not identifiable: from "
            f"{phi_range[0]:.3g} to {phi_range[1]:.3g} 1/rad the RMS error rises by less than "
            f"{100 * SEEN:g} %, kappa and chi making up for it."
        )
    for pair, c in correlation.items():
        if abs(c) > ALIKE:
            a, b = pair.split()
            notes.append(f"Inverse: {a} and {b} are correlated by {c:+.3f}.")
    ours, theirs = mean_rms_rad(sets, True), mean_rms_rad(published, True)
    if math.isfinite(ours) and theirs < ours:
        notes.append(
            f"Inverse: on held-out cycles table 4.2 does better ({theirs:.3g} rad) than the refit "
            f"({ours:.3g} rad)."
        )
    trained = mean_rms_rad(sets, False)
    if math.isfinite(ours) and ours > 1.5 * trained:
        notes.append(
            f"Inverse: held out {ours:.3g} rad against {trained:.3g} rad in training: the fit does "
            "not carry over well."
        )
    notes.append(
        f"Inverse: {PLAYS} play operators, rate neglected as published; the observer's filter is "
        'chosen with inverse.filter, and kind = "exact" needs none of these numbers.'
    )
    return tuple(notes)


__all__ = ["InverseFit", "judge_inverse", "refit_identified", "refit_inverse"]
