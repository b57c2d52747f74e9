"""Sections of the coupling's torque model: the published one, or a member of the family."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from esea_gen.devices.numbers import Quantity, Section, Series, number, optional, series, table

MAX_DEAD_ZONE_RAD = math.radians(6)
# Of a rubber.
COLDEST_C, HOTTEST_C = -60.0, 200.0
# A factor of temperature is at least this over its range: far from 0, where no torque is left.
LEAST_FACTOR = 0.2
MOST_TERMS = 64
MOST_TIMES = 16


class Maxwell(Section):
    """Rate terms: one Maxwell element whose viscosity depends on deflection and rate."""

    kv_Nm_rad: Quantity = number(0, 1000, "Stiffness kv of the Maxwell element, eq. 3.3.")
    A_Nms_rad: Quantity = number(0, 1000, "Deflection gain A of the viscosity, eq. 3.4.")
    m: Quantity = number(0, 4, "Deflection exponent m of the viscosity, eq. 3.4.")
    eps1_Nms_rad: Quantity = number(1e-6, 1, "Viscosity offset eps1 at zero deflection, eq. 3.4.")
    B: Quantity = number(0, 1000, "Rate gain B of the viscosity, eq. 3.4.")
    n: Quantity = number(0, 1, "Rate exponent n of the viscosity, eq. 3.4.")
    eps2: Quantity = number(1e-6, 12, "Viscosity offset eps2 at zero rate, eq. 3.4.")


class Elastomer(Section):
    """Torque model of the rubber coupling, equations 3.1 to 3.11."""

    k1_Nm_rad: Quantity = number(0, 1000, "Linear stiffness k1, eq. 3.2.")
    k3_Nm_rad3: Quantity = number(0, 2500, "Cubic stiffness k3, eq. 3.2.")
    alpha_Nm_rad: Quantity = number(0, 1000, "Stop weight alpha, eq. 3.10.")
    beta_1_rad: Quantity = number(0, 1000, "Decay beta of the stop weight, eq. 3.10.")
    omega_rad: Quantity = number(1e-6, 0.1, "Spacing omega of the stop thresholds, eq. 3.11.")
    stops: Quantity = number(1, 32, "Number N of stop operators, eq. 3.9.", whole=True)
    dead_zone_rad: Quantity | None = optional(
        0,
        MAX_DEAD_ZONE_RAD,
        "Half-width of the dead zone, eq. 8.7/8.8; leave the key out where there is none.",
    )
    maxwell: Maxwell | None = table(
        "Rate terms; leave the table out where they are not identified."
    )


class FamilyTerm(Section):
    """One term: its weight, its drive, its memory, its softening."""

    kind: Literal["spring", "maxwell", "stop", "slip", "offset"] = Field(
        description="spring: the rise itself; maxwell: it relaxes in time; stop: up to a "
        "threshold; slip: it forgets along its path; offset: a constant."
    )
    weight_Nm: Quantity = number(-2000, 2000, "Weight w; 0 or above, but for an offset.")
    rise: Literal["x", "x^3", "x^5", "bend"] = Field(
        default="x",
        description="Function of x, the deflection over scale_rad; bend: x/(1+|x|/bend).",
    )
    bend: Quantity | None = optional(1e-3, 100, "Where rise 'bend' bends, in x.")
    side: Literal["both", "positive", "negative"] = Field(
        default="both", description="Of an asymmetric coupling each side has terms of its own."
    )
    times_s: Series | None = series(
        1e-4, 1e7, tuple(range(1, MOST_TIMES + 1)), "Of a maxwell term: relaxation times."
    )
    exponent: Quantity | None = optional(
        0, 2, "Of several times T: their shares are T^-exponent; equal when left out."
    )
    threshold: Quantity | None = optional(
        1e-4, 1000, "Of a stop: its threshold, in units of the rise."
    )
    path: Quantity | None = optional(
        1e-4, 1000, "Of a slip: path over which it forgets, in units of the rise."
    )
    strain_softening: Quantity | None = optional(
        1e-3, 1000, "a of the factor 1/(1+m/a), m the largest |x| so far."
    )
    path_softening: Quantity | None = optional(
        1e-2, 1e6, "L of the factor exp(-s/L), s the path that x has travelled."
    )


class FamilyTemperature(Section):
    """Effect of the rubber's temperature: one factor on all weights but the offset's."""

    reference_C: Quantity = number(COLDEST_C, HOTTEST_C, "Temperature for which the weights hold.")
    per_K: Quantity = number(
        -0.05, 0.05, "Relative change a kelvin: the factor is 1 + per_K (T - reference_C)."
    )
    low_C: Quantity = number(COLDEST_C, HOTTEST_C, "Lowest temperature for which this holds.")
    high_C: Quantity = number(COLDEST_C, HOTTEST_C, "Highest temperature for which this holds.")


class Family(Section):
    """Torque model of the rubber coupling: a member of the family, in place of [elastomer]."""

    member: str = Field(min_length=1, description="Name of the member, as comparisons print it.")
    title: str = Field(min_length=1, description="One line for reports.")
    start: Literal["virgin", "conditioned"] = Field(
        default="virgin",
        description="What softening remembers at the start: nothing, or a long time at the largest "
        "trained deflection.",
    )
    scale_rad: Quantity = number(1e-4, 3.2, "Deflection for which x is 1: the largest trained one.")
    temperature: FamilyTemperature | None = table(
        "Factor of temperature; leave the table out where it was not identified."
    )
    terms: Annotated[tuple[FamilyTerm, ...], Field(strict=False)] = Field(
        min_length=1, max_length=MOST_TERMS, description="Terms, whose sum is the torque."
    )
