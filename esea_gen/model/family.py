"""Family of elastomer models: the parts of a member, and properties that all members have.

With x the deflection over the largest trained one, a member's torque is a sum of w d(m, s)
op[q(x)], w >= 0: ``q`` rises through the origin, ``op`` is a spring (q itself), a Maxwell branch, a
stop or a slip operator driven by q, and ``d`` a softening that only falls with the largest |x| (m)
or the path travelled (s).  At most an offset is added.  Whatever the numbers are:

* No closed path gives energy.  Each operator is q(x) - F with an F that only moves towards q(x):
  in time (Maxwell, Tschoegl 1989), where |q - F| would exceed a threshold (stop), or with the
  path of q (slip, Dahl 1968).  With Q the integral of q and Q* its conjugate, F moving towards
  q(x) can only lower the stored Q(x) - F x + Q*(F) >= 0; multiplied by a d that only falls, it
  falls faster.
* The torque rises with the deflection, by at least the springs' slope: the inverse is unique.

A factor for temperature multiplies every term but the offset; where it changes under load by dg,
the stored energy changes by dg times that at the reference.  Softening recovers where the coupling
rests unloaded, which for the model is its start: ``virgin`` or ``conditioned``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from esea_gen.model.temperature import TemperatureFactor

Kind = Literal["spring", "maxwell", "stop", "slip", "offset"]
Start = Literal["virgin", "conditioned"]

# The path counts once the deflection has left a band of this half width, so that an encoder that
# flickers between two counts does not soften the rubber.  Of the largest trained deflection.
PATH_BAND = 0.02


@dataclass(frozen=True)
class Rise:
    kind: Literal["power", "bend"]
    number: float
    side: Literal["both", "positive", "negative"] = "both"

    def __post_init__(self) -> None:
        if self.kind == "power" and self.number not in (1, 3, 5):
            raise ValueError(f"x^{self.number:g} is not an odd power up to 5")
        if not self.number > 0:
            raise ValueError(f"the number of a rise must be above 0, not {self.number:g}")

    @property
    def text(self) -> str:
        formula = "x" if self.number == 1 else f"x^{self.number:g}"
        if self.kind == "bend":
            formula = f"x/(1+|x|/{self.number:g})"
        return formula if self.side == "both" else f"{formula}, {self.side} side"

    def __call__(self, x: ca.SX) -> ca.SX:
        if self.kind == "bend":
            value = x / (1 + ca.fabs(x) * (1 / self.number))
        else:
            value = x
            for _ in range(int(self.number) // 2):
                value = value * (x * x)
        if self.side == "both":
            return value
        return ca.fmax(value, 0) if self.side == "positive" else ca.fmin(value, 0)

    def slope(self, x: ca.SX) -> ca.SX:
        if self.kind == "bend":
            bent = 1 + ca.fabs(x) * (1 / self.number)
            value = 1 / (bent * bent)
        else:
            value = ca.SX(self.number)
            for _ in range(int(self.number) // 2):
                value = value * (x * x)
        if self.side == "both":
            return value
        return ca.if_else(x >= 0 if self.side == "positive" else x <= 0, value, 0)

    def most(self, reach: float) -> float:
        power = reach ** int(self.number) if self.kind == "power" else 0.0
        return power or reach / (1 + reach / self.number)

    def least_slope(self, reach: float) -> float:
        if self.side != "both" or (self.kind == "power" and self.number > 1):
            return 0.0
        return 1.0 if self.kind == "power" else (1 + reach / self.number) ** -2

    def most_slope(self, reach: float) -> float:
        return 1.0 if self.kind == "bend" else self.number * reach ** (int(self.number) - 1)


@dataclass(frozen=True)
class Softening:
    kind: Literal["strain", "path"]
    number: float

    def __post_init__(self) -> None:
        if not self.number > 0:
            raise ValueError(f"a softening's number must be above 0, not {self.number:g}")

    @property
    def text(self) -> str:
        n = f"{self.number:g}"
        return f"1/(1+m/{n})" if self.kind == "strain" else f"exp(-s/{n})"

    def least(self, reach: float) -> float:
        return 1 / (1 + reach / self.number) if self.kind == "strain" else 0.0


@dataclass(frozen=True)
class Term:
    kind: Kind
    rise: Rise = Rise("power", 1)
    numbers: tuple[float, ...] = ()
    exponent: float = 0.0
    softening: Softening | None = None

    def __post_init__(self) -> None:
        wanted = {"spring": 0, "offset": 0, "stop": 1, "slip": 1}.get(self.kind)
        count = len(self.numbers)
        if (count != wanted if wanted is not None else count < 1) or min(
            self.numbers, default=1
        ) <= 0:
            raise ValueError(f"a {self.kind} cannot have the numbers {self.numbers}")

    @property
    def text(self) -> str:
        if self.kind == "offset":
            return "offset"
        words = {"maxwell": "time, s", "stop": "threshold", "slip": "path"}.get(self.kind)
        text = f"{self.kind} of {self.rise.text}"
        if words:
            text += f", {words} " + " ".join(f"{n:.4g}" for n in self.numbers)
        if self.exponent:
            text += f", shares T^-{self.exponent:g}"
        return f"{text}, times {self.softening.text}" if self.softening else text

    @property
    def shares(self) -> tuple[tuple[float, float], ...]:
        return tuple((n, n**-self.exponent) for n in self.numbers)


@dataclass(frozen=True)
class Member:
    name: str
    title: str
    terms: tuple[Term, ...]

    @property
    def timed(self) -> bool:
        return any(t.kind == "maxwell" for t in self.terms)


# weights_Nm: one a term, 0 or above except an offset's.  Slopes and torques here are those at the
# temperature of the range at which they are least or largest.
@dataclass(frozen=True)
class FittedMember:
    """A member with its weights."""

    member: Member
    scale_rad: float
    weights_Nm: tuple[float, ...]
    temperature: TemperatureFactor | None = None

    def __post_init__(self) -> None:
        if len(self.weights_Nm) != len(self.member.terms) or not self.scale_rad > 0:
            raise ValueError(f"{self.member.name}: not one weight a term, or no scale")
        for term, weight in zip(self.member.terms, self.weights_Nm, strict=True):
            if term.kind != "offset" and not weight >= 0:
                raise ValueError(
                    f"{self.member.name}: a {term.kind} of weight {weight:g} would generate energy"
                )

    @property
    def used(self) -> tuple[tuple[float, Term], ...]:
        """Weights above 0, with their terms: the others cost nothing."""
        pairs = zip(self.weights_Nm, self.member.terms, strict=True)
        return tuple((w, t) for w, t in pairs if w)

    @property
    def factors(self) -> tuple[float, float]:
        """Least and largest factor of temperature; 1 for a member without one."""
        return (1.0, 1.0) if self.temperature is None else self.temperature.ends

    def least_slope_Nm_rad(self, theta_rad: float) -> float:
        reach = theta_rad / self.scale_rad
        total = 0.0
        for weight, term in self.used:
            if term.kind == "spring":
                left = term.softening.least(reach) if term.softening else 1.0
                total += weight * term.rise.least_slope(reach) * left
        return self.factors[0] * total / self.scale_rad

    def first_slope_Nm_rad(self, theta_rad: float) -> float:
        """Least slope of the torque at the first sample, which softens itself by its own strain."""
        reach, total = theta_rad / self.scale_rad, 0.0
        for weight, term in self.used:
            if term.kind != "spring":
                continue
            soft, rise = term.softening, term.rise
            steep = rise.least_slope(reach) * (soft.least(reach) if soft else 1.0)
            if soft and soft.kind == "strain" and rise.kind == "power":
                steep *= soft.least(reach)
            elif soft and soft.kind == "strain":
                a, b = soft.number, rise.number
                steep = -a * b / (math.sqrt(a) + math.sqrt(b)) ** 4
                if reach**2 <= a * b:
                    steep = a * b * (a * b - reach**2) / ((a + reach) * (b + reach)) ** 2
                if rise.side != "both":
                    steep = min(steep, 0.0)
            total += weight * steep
        return min(f * total for f in self.factors) / self.scale_rad

    def most_slope_Nm_rad(self, theta_rad: float) -> float:
        reach, total = theta_rad / self.scale_rad, 0.0
        for weight, term in self.used:
            if term.kind != "offset":
                steep = weight * term.rise.most_slope(reach)
                shares = sum(share for _, share in term.shares) if term.kind == "maxwell" else 1.0
                total += steep * shares * (2 if term.kind == "slip" else 1)
        return self.factors[1] * total / self.scale_rad

    def most_Nm(self, theta_rad: float) -> float:
        reach, total = theta_rad / self.scale_rad, 0.0
        for weight, term in self.used:
            size = 1.0 if term.kind == "offset" else self.factors[1] * term.rise.most(reach)
            if term.kind == "maxwell":
                size *= 2 * sum(share for _, share in term.shares)
            elif term.numbers:
                size = min(2 * size, self.factors[1] * term.numbers[0])
            total += abs(weight) * size
        return total


def softened(terms: Sequence[Term], *softenings: Softening) -> tuple[Term, ...]:
    """Every term as it is, and once for each softening."""
    return tuple(
        Term(t.kind, t.rise, t.numbers, t.exponent, s)
        for t in terms
        for s in ((None,) if t.kind == "offset" else (None, *softenings))
    )
