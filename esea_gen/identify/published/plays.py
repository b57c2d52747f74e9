"""The emitted C of the play operators over recordings, and how well it determines them.

The set-point is kappa times something that depends on phi and chi alone.  So only these two are
searched, and kappa follows in closed form.

With small thresholds the weights ``kappa exp(-phi chi j)`` are nearly equal, and phi then does
little that kappa does not do as well.  The result says how well each is known: standard deviations
with their correlation, and the range of phi over which the error hardly changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy  # its parts are read on first use

from esea_gen.device import Device
from esea_gen.devices.fields import field_facts
from esea_gen.hostlib.library import CRunner, compile_system
from esea_gen.identify.published.parameters import with_values
from esea_gen.identify.published.plant import equal_weights, thinned
from esea_gen.identify.published.uncertainty import relative_jacobian
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.resampling import autocorrelation
from esea_gen.language.ports import Array
from esea_gen.model.inverse import inverse_system
from esea_gen.model.published_inverse import published_inverse

KEYS = ("kappa_rad", "phi_1_rad", "chi_rad")
# A rise of the RMS error by this share is hardly seen: phi's range is given for it.
SEEN = 0.01
PROFILE = 11


def play_bounds(key: str) -> tuple[float, float]:
    """Bounds of a play operator's parameter, those of the device file."""
    facts = field_facts(f"inverse.{key}")
    return float(facts["low"]), float(facts["high"])


def play_at_bound(key: str, value: float) -> str | None:
    """Whether a parameter sits at a bound."""
    low, high = play_bounds(key)
    margin = 1e-4 * (high - low) if key != "chi_rad" else 1e-9
    if value <= low + margin:
        return "lower"
    return "upper" if value >= high - margin else None


class PlayPlant:
    """The compiled play operators over all recordings."""

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
        """Set-point at the training rows."""
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
    """Bounds of what is searched: phi and the logarithm of chi."""
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
    jacobian = relative_jacobian(run, values, free, 1e-4)
    _, singular, v = np.linalg.svd(jacobian, full_matrices=False)
    if singular[-1] < 1e-9 * singular[0]:
        return sigma, {}
    rho = autocorrelation(error)
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
