"""Simulated knee patients: legs, disorders at five severities, people of no category; in motion.

    J a = hands + weight cos(angle) + passive - damping rate + muscles

The stretch reflex has a static threshold angle, a dynamic threshold speed and a gain [He1997]; its
stiffness grows with speed [McPherson2018]; delay, then two lags.  An active muscle resists being
stretched more than it pulls while it shortens [Zajac1989]; without that, reflexes this late keep a
leg swinging.

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
[Zajac1989] F. E. Zajac, "Muscle and tendon: properties, models, scaling, and application to
    biomechanics and motor control", Crit. Rev. Biomed. Eng. 17(4):359-411, 1989.  Force over
    velocity: a moment arm of 4 cm, fibres of 8.4 cm, 10 fibre lengths a second at most, and Hill's
    curve give 0.17 s/rad as the mean slope up to 2 rad/s, and at most 1.4 times the force.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from esea_gen.errors import UserError

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
STEP_S = 2e-3
# Hands that follow a path, assumed; limited to the pull.
HANDS_Nm_rad, HANDS_Nms_rad = 300.0, 14.0
EDGE_rad_s = 3 * DEG  # over which the reflex sets in
FRICTION_rad_s = 8 * DEG  # over which friction and help set in
TREMOR_Hz = 5.0  # assumed
TONE_SPREAD, TONE_S = 0.05, 1.0  # how the tone wanders, and how fast; assumed
# Share by which an active muscle resists a stretch of 1 rad/s more, and the most [Zajac1989]; the
# slope rounded down, for a muscle of several joints has longer fibres.
STRETCHED_s, STRETCHED_MOST = 0.12, 1.4


@dataclass(frozen=True)
class KneePatient:
    """One simulated person: leg, passive knee, and its disorder."""

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
    # Of no category.
    friction_Nm: float = 0.0
    helping_Nm: float = 0.0
    contracture_Nm_rad: float = 0.0
    contracture_rad: float = 0.0
    tremor_Nm: float = 0.0


def body_size(height_m: float, mass_kg: float) -> float:
    """Body size against the mean one: torques of muscles go with height times mass."""
    return height_m * mass_kg / (MEAN_HEIGHT_M * MEAN_MASS_KG)


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
    """The person at two severities, 0 (none) to 5; values assumed, their direction [He1997]."""
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
    """A patient of given severities, every parameter jittered; spread assumed."""
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


def severities(name: str) -> tuple[float, float]:
    """Spastic and dystonic severity of a category (``S3``), of two (``S2+D4``), or relaxed."""
    levels = {"S": 0.0, "D": 0.0}
    for part in name.split("+") if name != RELAXED else ():
        try:
            what, level = part[:1], float(part[1:])
        except ValueError:
            what, level = "", 0.0
        if levels.get(what) != 0 or not 0 < level <= 5:  # each once
            raise UserError(
                f"no simulated patient {name!r}.",
                f"S1 to S5, D1 to D5, two such as S2+D4, {', '.join(OUTSIDE_KINDS)}, or any.",
            )
        levels[what] = level
    return levels["S"], levels["D"]


def draw_category(category: str, rng: np.random.Generator) -> KneePatient:
    """A patient of a category: ``S1`` to ``S5``, ``D1`` to ``D5``, or relaxed."""
    return draw(*severities(category), rng, category)


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


def nominal(category: str) -> KneePatient:
    return afflicted(KneePatient(category), *severities(category))


def columns(patients: Sequence[KneePatient]) -> dict[str, Array]:
    """Their numbers as arrays, shape (patients,); pairs as (patients, 2)."""
    names = [f.name for f in dataclasses.fields(KneePatient) if f.name != "category"]
    return {n: np.array([getattr(p, n) for p in patients], dtype=np.float64) for n in names}


def stretched(rate_rad_s: Array) -> Array:
    """Force of an active muscle that is stretched at a rate, over its force at rest."""
    return np.asarray(np.clip(1 + STRETCHED_s * rate_rad_s, 0, STRETCHED_MOST))


@dataclass(frozen=True)
class KneeMotion:
    """Recording of the motion: arrays of shape (steps, patients)."""

    time_s: Array
    angle_rad: Array
    rate_rad_s: Array
    torque_Nm: Array  # of the hands on the leg, positive towards flexion


class Knees:
    def __init__(self, patients: Sequence[KneePatient]) -> None:
        self.patients = tuple(patients)
        c = self.columns = columns(patients)
        mass = LEG_MASS * c["mass_kg"] * c["leg_scale"]
        length = LEG_LENGTH * c["height_m"]
        self.inertia = mass * (LEG_RADIUS * length) ** 2
        self.weight = mass * GRAVITY_M_S2 * LEG_CENTRE * length
        self.size = np.array([body_size(p.height_m, p.mass_kg) for p in patients])
        self.pull_Nm = PULL_N * np.asarray(shank_length_m(c["height_m"]))

    def reflex_Nm(self, angle: Array, rate: Array) -> Array:
        """Reflex drive of extensors and flexors, shape (2, patients), both positive."""
        c = self.columns
        stretch = np.stack([angle, RANGE_RAD - angle])
        speed = np.stack([rate, -rate])
        over = speed - c["dynamic_threshold_rad_s"]
        moving = 0.5 * (1 + np.tanh(over / EDGE_rad_s))
        threshold = c["threshold_rad"].T - c["threshold_rate_s"] * np.maximum(speed, 0)
        stiffness = c["gain_Nms_rad2"] * np.maximum(over, 0)
        drive = moving * stiffness * np.maximum(stretch - threshold, 0)
        most = c["reflex_max_Nm"].T
        return np.asarray(most * -np.expm1(-drive / most))

    def still_Nm(self, angle: Array, rate: Array, tone: Array | float = 1.0) -> Array:
        """Torque on the leg of all but hands and reflex, positive towards flexion."""
        c = self.columns
        # Both groups are active, the one that pulls towards the posture the more.
        away = 0.5 * np.tanh((angle - c["posture_rad"]) / c["posture_width_rad"])
        pulls = (0.5 + away) * stretched(rate) - (0.5 - away) * stretched(-rate)
        muscles = -c["tone_Nm"] * tone * pulls
        muscles = muscles + (c["helping_Nm"] - c["friction_Nm"]) * np.tanh(rate / FRICTION_rad_s)
        short = np.maximum(angle - c["contracture_rad"], 0)
        own = c["passive_scale"] * passive_torque_Nm(angle) - c["damping_Nms_rad"] * rate
        held = own + muscles - c["contracture_Nm_rad"] * short
        return np.asarray(self.size * held + self.weight * np.cos(angle))

    def move(self, path: Array, rate: Array, seeds: Sequence[Sequence[int]]) -> KneeMotion:
        """Follow a path with the hands; without hands: see :meth:`release`."""
        return self._run(len(path), path[0], path, rate, seeds)

    def release(
        self, start_rad: float, duration_s: float, seeds: Sequence[Sequence[int]]
    ) -> KneeMotion:
        """Let the leg fall from an angle, as in the pendulum test."""
        start = np.full(len(self.patients), start_rad)
        return self._run(round(duration_s / STEP_S), start, None, None, seeds)

    def _tone(self, steps: int, seeds: Sequence[Sequence[int]]) -> tuple[Array, Array]:
        n = len(self.patients)
        tone, tremor = np.ones((steps, n)), np.zeros((steps, n))
        keep = float(np.exp(-STEP_S / TONE_S))
        t = np.arange(steps) * STEP_S
        for i, seed in enumerate(seeds):
            rng = np.random.default_rng(list(seed))
            wander = rng.normal(0, TONE_SPREAD)
            phase = rng.uniform(0, 2 * np.pi)
            if self.patients[i].tone_Nm > 0:
                new = rng.normal(0, TONE_SPREAD * np.sqrt(1 - keep**2), steps)
                tone[:, i] += lfilter([1.0], [1.0, -keep], new, zi=[keep * wander])[0]
            if self.patients[i].tremor_Nm > 0:
                tremor[:, i] = self.patients[i].tremor_Nm * np.sin(
                    2 * np.pi * TREMOR_Hz * t + phase
                )
        return tone, tremor

    def _run(
        self,
        steps: int,
        start: Array,
        path: Array | None,
        path_rate: Array | None,
        seeds: Sequence[Sequence[int]],
    ) -> KneeMotion:
        n = len(self.patients)
        tone, tremor = self._tone(steps, seeds)
        angle, rate = np.empty((steps, n)), np.empty((steps, n))
        torque = np.zeros((steps, n))
        legs = MovedLegs(self, start)
        most = self.pull_Nm
        for k in range(steps):
            x, v = legs.angle_rad, legs.rate_rad_s
            angle[k], rate[k] = x, v
            own = legs.own_Nm(tone[k]) + tremor[k]
            if path is not None and path_rate is not None:
                # Hands carry what the leg weighs, as far as they are strong enough.
                wanted = HANDS_Nm_rad * (path[k] - x) + HANDS_Nms_rad * (path_rate[k] - v)
                held = np.clip(wanted - self.weight * np.cos(x), -most, most)
                torque[k] = held
                own = own + held
            legs.move(own)
        time_s = np.asarray(np.arange(steps) * STEP_S, dtype=np.float64)
        return KneeMotion(time_s, angle, rate, torque)


class MovedLegs:
    """Several legs and their reflexes, a step at a time; arrays have shape (patients,)."""

    def __init__(self, knees: Knees, start_rad: Array, step_s: float = STEP_S) -> None:
        self._knees, self._step_s = knees, step_s
        late = np.rint(knees.columns["delay_s"] / step_s).astype(int)
        self._late, self._who = late, np.arange(len(late))
        self._lag = -np.expm1(-step_s / knees.columns["activation_s"])
        self._size = int(late.max(initial=0)) + 1
        self.angle_rad = np.array(start_rad, dtype=np.float64)
        self.rate_rad_s = np.zeros(len(late))
        self._seen = np.stack([np.repeat(x[None], self._size, 0) for x in self._now])
        self._first = self._second = np.zeros((2, len(late)))
        self._steps = 0

    @property
    def _now(self) -> tuple[Array, Array]:
        return self.angle_rad, self.rate_rad_s

    def own_Nm(self, tone: Array | float = 1.0) -> Array:
        """Torque on the leg of all but hands, positive towards flexion; the reflex goes on."""
        x, v = self._now
        self._seen[:, self._steps % self._size] = x, v
        then = np.maximum(self._steps - self._late, 0) % self._size
        drive = self._knees.size * self._knees.reflex_Nm(*self._seen[:, then, self._who])
        self._first = self._first + self._lag * (drive - self._first)
        self._second = self._second + self._lag * (self._first - self._second)
        reflex = self._second[1] * stretched(-v) - self._second[0] * stretched(v)
        return np.asarray(self._knees.still_Nm(x, v, tone) + reflex)

    def move(self, torque_Nm: Array) -> None:
        """On by a step under all torques."""
        self._steps += 1
        self.rate_rad_s = self.rate_rad_s + self._step_s / self._knees.inertia * torque_Nm
        self.angle_rad = self.angle_rad + self._step_s * self.rate_rad_s


def sweep(duration_s: float = 36.0, top_Hz: float = 0.3) -> tuple[Array, Array]:
    """Excitation of the database: a sine swept 0 to 0.3 Hz at 0.5 Hz/min, 130 deg peak to peak."""
    t = np.arange(round(duration_s / STEP_S)) * STEP_S
    slope = top_Hz / duration_s
    phase, speed = np.pi * slope * t**2, 2 * np.pi * slope * t
    return RANGE_RAD / 2 * (1 - np.cos(phase)), RANGE_RAD / 2 * np.sin(phase) * speed
