"""Search space of a fit, and its map to the device file's parameters.

The viscosity eta = (A |theta|^m + eps1) / (B |rate|^n + eps2) does not change when A, eps1, B and
eps2 are multiplied by one number.  Searched is what torque can show: the time constant
T0 = eps1 / (kv eps2), the gains A theta_max^m / eps1 and B omega_max^n / eps2, and m, n.  At the
end eps2 is set to a stated value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from esea_gen.devices.fields import field_facts
from esea_gen.language.ports import Array
from esea_gen.model.elastomer import RATE_KEYS

EPS2_DEFAULT = 0.013  # the published elbow's value; any other gives the same torque


def place_of(key: str) -> str:
    """A parameter's place in the device file."""
    return f"elastomer.maxwell.{key}" if key in RATE_KEYS else f"elastomer.{key}"


@cache
def bounds_of(key: str) -> tuple[float, float]:
    extra = field_facts(place_of(key))
    return float(extra["low"]), float(extra["high"])


def at_bound(key: str, value: float) -> str | None:
    low, high = bounds_of(key)
    # The viscosity's numbers have no scale of their own: only 0 itself is a lower bound of 0.
    if value <= low * (1 + 1e-6):
        return "lower"
    return "upper" if value >= high * (1 - 1e-6) else None


NEGLIGIBLE = 1e-4  # share of the torque below which the Maxwell element is left out
TIME_CONSTANT_S = (1e-3, 1e4)
GAIN = (1e-3, 1e5)


@dataclass(frozen=True)
class Space:
    rate_terms: bool
    theta_rad: float  # largest deflection and rate in the training data
    omega_rad_s: float
    duration_s: float  # of the longest recording
    low: Array = field(init=False)
    high: Array = field(init=False)

    def __post_init__(self) -> None:
        omega = bounds_of("omega_rad")
        beta = bounds_of("beta_1_rad")
        low = [math.log(max(omega[0], self.theta_rad / 500)), 0.0]
        high = [math.log(min(omega[1], 2 * self.theta_rad)), math.log1p(beta[1] * self.theta_rad)]
        if self.rate_terms:
            slow = min(TIME_CONSTANT_S[1], 10 * self.duration_s)
            low += [math.log(TIME_CONSTANT_S[0]), math.log(GAIN[0]), 0.0, math.log(GAIN[0]), 0.0]
            high += [math.log(slow), math.log(GAIN[1]), 4.0, math.log(GAIN[1]), 1.0]
        object.__setattr__(self, "low", np.array(low))
        object.__setattr__(self, "high", np.array(high))

    def shape(self, x: Array) -> dict[str, float]:
        """Parameters of the basis: stops' thresholds and decay, viscosity over kv."""
        out = {"omega_rad": math.exp(x[0]), "beta_1_rad": math.expm1(x[1]) / self.theta_rad}
        if self.rate_terms:
            m, n, eps1 = float(x[4]), float(x[6]), math.exp(x[2])
            out |= {
                "m": m,
                "n": n,
                "eps2": 1.0,
                "eps1_Nms_rad": eps1,
                "A_Nms_rad": math.exp(x[3]) * eps1 / self.theta_rad**m,
                "B": math.exp(x[5]) / self.omega_rad_s**n,
            }
        return out

    def shape_slopes(self, x: Array) -> dict[str, dict[int, float]]:
        """Derivative of each of :meth:`shape` by the searched numbers that it depends on."""
        s = self.shape(x)
        out = {
            "omega_rad": {0: s["omega_rad"]},
            "beta_1_rad": {1: s["beta_1_rad"] + 1 / self.theta_rad},
        }
        if self.rate_terms:
            gain, drag = s["A_Nms_rad"], s["B"]
            out |= {
                "eps1_Nms_rad": {2: s["eps1_Nms_rad"]},
                "A_Nms_rad": {2: gain, 3: gain, 4: -gain * math.log(self.theta_rad)},
                "m": {4: 1.0},
                "B": {5: drag, 6: -drag * math.log(self.omega_rad_s)},
                "n": {6: 1.0},
            }
        return out


def linear_bounds(rate_terms: bool) -> tuple[Array, Array]:
    keys = ["k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad"] + (["kv_Nm_rad"] if rate_terms else [])
    pairs = [bounds_of(k) for k in keys]
    return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])


def parameters_of(
    space: Space, x: Array, linear: Array, rate_share: float
) -> tuple[dict[str, float], bool]:
    """Turn searched numbers and linear coefficients into the device file's parameters."""
    shape = space.shape(x)
    values = {
        "k1_Nm_rad": float(linear[0]),
        "k3_Nm_rad3": float(linear[1]),
        "alpha_Nm_rad": float(linear[2]),
        "beta_1_rad": shape["beta_1_rad"],
        "omega_rad": shape["omega_rad"],
    }
    if space.rate_terms:
        kv = float(linear[3])
        if kv <= 0 or rate_share < NEGLIGIBLE:
            return _inside(values), True
        values["kv_Nm_rad"] = kv
        values |= _viscosity(shape, kv)
    return _inside(values), False


def _viscosity(shape: Mapping[str, float], kv: float) -> dict[str, float]:
    """Viscosity in the device file's bounds: the free common factor is chosen here."""
    per_eps2 = {
        "A_Nms_rad": kv * shape["A_Nms_rad"],
        "eps1_Nms_rad": kv * shape["eps1_Nms_rad"],
        "B": shape["B"],
        "eps2": 1.0,
    }
    smallest = max(bounds_of(k)[0] / v for k, v in per_eps2.items() if v > 0)
    largest = min(bounds_of(k)[1] / v for k, v in per_eps2.items() if v > 0)
    # Well inside the bounds, so that none is reported as reached which only this choice reaches.
    inside = 2 * smallest < EPS2_DEFAULT < 0.5 * largest
    factor = EPS2_DEFAULT if inside else math.sqrt(smallest * largest)
    return {k: v * factor for k, v in per_eps2.items()} | {"m": shape["m"], "n": shape["n"]}


def _inside(values: Mapping[str, float]) -> dict[str, float]:
    return {k: float(np.clip(v, *bounds_of(k))) for k, v in values.items()}


# What each searched number stands for, in the order of :class:`Space`.
SEARCHED = ("omega_rad", "beta_1_rad", "eps1_Nms_rad", "A_Nms_rad", "m", "B", "n")


def edges_of(space: Space, x: Array) -> dict[str, str]:
    """Parameters at the edge of the search space, and the meaning of that."""
    names = (
        ("the stops are as close as the search allows", "the stops are as far apart as allowed"),
        ("the stops' weight does not decay", "the stops' weight decays as fast as allowed"),
        ("the time constant is as short as allowed", "the time constant is as long as allowed"),
        (
            "the viscosity does not depend on deflection (A, m mean nothing)",
            "the viscosity at zero deflection is as small as allowed",
        ),
        ("the exponent m is at its lower bound", "the exponent m is at its upper bound"),
        (
            "the viscosity does not depend on rate (B, n mean nothing)",
            "the viscosity depends on rate as strongly as allowed",
        ),
        ("the exponent n is at its lower bound", "the exponent n is at its upper bound"),
    )
    margin = 1e-3 * (space.high - space.low)
    found = {}
    ends = zip(x, space.low, space.high, margin, SEARCHED, names, strict=False)
    for value, low, high, m, key, text in ends:
        if value <= low + m:
            found[key] = text[0]
        elif value >= high - m:
            found[key] = text[1]
    return found
