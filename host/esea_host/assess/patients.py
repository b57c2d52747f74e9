"""Simulated knee patients: legs, disorders at five severities, and people of no category.

Sources, where a number is not marked as assumed:

[He1997] J. He, W. R. Norling, Y. Wang, "A dynamic neuromuscular model for describing the pendulum
    test of spasticity", IEEE Trans. Biomed. Eng. 44(3):175-184, 1997.  The structure: static
    threshold, dynamic threshold and gain of the stretch reflex; severity is both thresholds
    falling together with a small change of the gain.
[McPherson2018] J. G. McPherson, A. H. A. Stienen, B. D. Schmit, J. P. A. Dewald, "Biomechanical
    parameters of the elbow stretch reflex in chronic hemiparetic stroke", Exp. Brain Res.
    237(1):121-135, 2018.  The reflex's stiffness grows with the speed of stretch much more than
    its threshold angle falls.
[Riener1999] R. Riener, T. Edrich, "Identification of passive elastic joint moments in the lower
    extremities", J. Biomech. 32:539-544, 1999.  Passive torque of the knee.
[Lebiedowska1999] M. K. Lebiedowska, J. R. Fisk, "Passive dynamics of the knee joint in healthy
    children and children affected by spastic paresis", Clin. Biomech. 14(9):653-660, 1999.
    Passive properties are those of healthy people.
[Lebiedowska2004] M. K. Lebiedowska, D. Gaebler-Spira, R. S. Burns, J. R. Fisk, "Biomechanic
    characteristics of patients with spastic and dystonic hypertonia in cerebral palsy", Arch.
    Phys. Med. Rehabil. 85(6):875-880, 2004.  Activation grows with speed in spasticity, not in
    dystonia.
[Winter2009] D. A. Winter, "Biomechanics and Motor Control of Human Movement", 4th ed., 2009.
    Shares of body height and weight of shank and foot.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

GRAVITY_M_S2 = 9.81
# [Winter2009]: shank and foot as one segment, from the knee.
LEG_MASS, LEG_LENGTH, LEG_CENTRE, LEG_RADIUS = 0.061, 0.246, 0.606, 0.735
MEAN_HEIGHT_M, MEAN_MASS_KG = 1.70, 70.0  # assumed
RANGE_RAD = math.radians(130.0)  # thesis chapter 8
PULL_N = 10 * GRAVITY_M_S2  # thesis chapter 8: a safe pull of 10 kgf
HIP_RAD, ANKLE_RAD = math.radians(60), math.radians(-15)  # half reclined, foot hangs; assumed
SEVERITIES = (1, 2, 3, 4, 5)
DISORDERS = {"S": "spastic-like", "D": "dystonic-like"}
CATEGORIES = tuple(f"{d}{s}" for d in DISORDERS for s in SEVERITIES)
RELAXED = "relaxed"
OUTSIDE_KINDS = ("rigid", "contracture", "helping", "tremor", RELAXED)
DEG = math.pi / 180


@dataclass(frozen=True)
class KneePatient:
    """One simulated person: leg, passive knee, and what is wrong with it.

    Angles are flexion from full extension; the thigh is level, so the shank hangs at 90 deg.
    """

    category: str
    spastic: float = 0.0
    dystonic: float = 0.0
    height_m: float = MEAN_HEIGHT_M
    mass_kg: float = MEAN_MASS_KG
    leg_scale: float = 1.0  # how this leg's mass differs from the tables' share
    passive_scale: float = 1.0
    damping_Nms_rad: float = 0.35  # assumed; gives the published relaxation index
    # Stretch reflex of both muscle groups: knee extensors, then flexors.
    threshold_rad: tuple[float, float] = (10.0, 10.0)  # 10 rad: never
    dynamic_threshold_rad_s: float = 10.0
    threshold_rate_s: float = 0.03  # [McPherson2018] small; value assumed
    gain_Nms_rad2: float = 0.0
    reflex_max_Nm: tuple[float, float] = (25.0, 16.0)  # assumed: thrice the elbow's 7.2 Nm
    delay_s: float = 0.03  # spinal, assumed
    activation_s: float = 0.02  # each of two lags from drive to torque, assumed
    # Tone that depends on posture, hardly on speed.
    tone_Nm: float = 0.0
    posture_rad: float = 30 * DEG  # assumed: pulls towards extension
    posture_width_rad: float = 25 * DEG  # assumed
    tone_damping_s: float = 0.02  # share of the tone that resists a rad/s, assumed
    # Of no category.
    friction_Nm: float = 0.0
    helping_Nm: float = 0.0
    contracture_Nm_rad: float = 0.0
    contracture_rad: float = 0.0
    tremor_Nm: float = 0.0

    @property
    def size(self) -> float:
        """Body size against the mean one: torques of muscles go with height times mass."""
        return self.height_m * self.mass_kg / (MEAN_HEIGHT_M * MEAN_MASS_KG)


def shank_length_m(height_m: float | Array) -> Array:
    """Knee to ankle [Winter2009]."""
    return np.asarray(LEG_LENGTH * height_m)


def leg_inertia_kgm2(height_m: float, mass_kg: float) -> float:
    """Shank and foot about the knee [Winter2009]."""
    return LEG_MASS * mass_kg * (LEG_RADIUS * LEG_LENGTH * height_m) ** 2


def leg_weight_Nm(height_m: float, mass_kg: float) -> float:
    """Torque of shank and foot held level [Winter2009]."""
    return LEG_MASS * mass_kg * GRAVITY_M_S2 * LEG_CENTRE * LEG_LENGTH * height_m


def passive_torque_Nm(angle_rad: Array | float) -> Array:
    """Passive torque of the knee, positive towards flexion [Riener1999]."""
    knee = np.asarray(angle_rad) / DEG
    ankle, hip = ANKLE_RAD / DEG, HIP_RAD / DEG
    return np.asarray(
        np.exp(1.8 + 0.046 * ankle - 0.0352 * knee + 0.0217 * hip)
        - np.exp(-3.971 - 0.0004 * ankle + 0.0495 * knee - 0.0128 * hip)
        - 4.82
        + np.exp(2.22 - 0.15 * knee)
    )


def afflicted(person: KneePatient, spastic: float, dystonic: float) -> KneePatient:
    """The person at two severities, 0 (none) to 5; values assumed, their direction [He1997].

    Tone grows by the same factor from severity to severity.
    """
    found = dataclasses.replace(person, spastic=spastic, dystonic=dystonic)
    if spastic > 0:
        threshold = (100 - 15 * spastic) * DEG
        found = dataclasses.replace(
            found,
            threshold_rad=(threshold, threshold),
            dynamic_threshold_rad_s=(65 - 6 * spastic) * DEG,
            gain_Nms_rad2=25 + 5 * spastic,
        )
    if dystonic > 0:
        found = dataclasses.replace(found, tone_Nm=3.0 * 1.6 ** (dystonic - 1))
    return found


def someone(rng: np.random.Generator, category: str) -> KneePatient:
    """Another leg: height, mass, and how far it is from the tables."""
    height = float(np.clip(rng.normal(MEAN_HEIGHT_M, 0.09), 1.45, 1.98))
    index = float(np.clip(rng.normal(24.2, 3.0), 17, 34))
    return KneePatient(
        category,
        height_m=height,
        mass_kg=index * height**2,
        leg_scale=float(np.exp(rng.normal(0, 0.04))),
        passive_scale=float(np.exp(rng.normal(0, 0.12))),
        damping_Nms_rad=0.35 * float(np.exp(rng.normal(0, 0.15))),
    )


def draw(
    spastic: float, dystonic: float, rng: np.random.Generator, category: str = ""
) -> KneePatient:
    """A patient of given severities, every parameter jittered; spread assumed.

    10 % on strength, as in (8.4); thresholds by 3 deg and 3 deg/s; delay by 3 ms.
    """
    p = afflicted(someone(rng, category), spastic, dystonic)
    gain, tone = np.exp(rng.normal(0, 0.1, 2))
    shift = rng.normal(0, 3 * DEG, 2)
    speed, delay, posture = rng.normal(0, 1, 3)
    extensors, flexors = (float(t + d) for t, d in zip(p.threshold_rad, shift, strict=True))
    return dataclasses.replace(
        p,
        threshold_rad=(extensors, flexors),
        dynamic_threshold_rad_s=max(2 * DEG, p.dynamic_threshold_rad_s + 3 * DEG * float(speed)),
        gain_Nms_rad2=p.gain_Nms_rad2 * float(gain),
        delay_s=float(np.clip(p.delay_s + 0.003 * delay, 0.02, 0.045)),
        tone_Nm=p.tone_Nm * float(tone),
        posture_rad=p.posture_rad + 4 * DEG * float(posture),
    )


def draw_category(category: str, rng: np.random.Generator) -> KneePatient:
    """A patient of a category: ``S1`` to ``S5``, ``D1`` to ``D5``, or relaxed."""
    if category == RELAXED:
        return draw(0, 0, rng, category)
    level = float(category[1:])
    spastic = category[0] == "S"
    return draw(level if spastic else 0.0, 0.0 if spastic else level, rng, category)


def draw_outside(kind: str, rng: np.random.Generator) -> KneePatient:
    """A person of no category: rigid, contracture, helping, tremor, or relaxed; values assumed."""
    p = draw(0, 0, rng, kind)
    u, v = rng.uniform(size=2)
    more = {
        "rigid": {"friction_Nm": 5 + 7 * u},
        "contracture": {"contracture_Nm_rad": 15 + 15 * u, "contracture_rad": (50 + 20 * v) * DEG},
        "helping": {"helping_Nm": 5 + 7 * u},
        "tremor": {"tremor_Nm": 8 + 8 * u},
        RELAXED: {},
    }[kind]
    return dataclasses.replace(p, **more)


def columns(patients: Sequence[KneePatient]) -> dict[str, Array]:
    """Their numbers as arrays, shape (patients,); pairs as (patients, 2)."""
    names = [f.name for f in dataclasses.fields(KneePatient) if f.name != "category"]
    return {n: np.array([getattr(p, n) for p in patients], dtype=np.float64) for n in names}
