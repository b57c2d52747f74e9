"""Reference plants, people and trajectories: the numbers of ``plants.toml``."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from types import UnionType
from typing import Any, get_args, get_type_hints

from esea_gen.errors import UserError

FILE = "plants.toml"
Interval = tuple[float, float]


@dataclass(frozen=True)
class Nominal:
    """What the nominal plant has besides the device file.

    Parameters
    ----------
    coulomb_width_rad_s : float
        Width of the plant's Coulomb friction.
    """

    coulomb_width_rad_s: float


@dataclass(frozen=True)
class Real:
    """The reference plant with everything that the nominal one leaves out.

    Parameters
    ----------
    friction_scale : float
        Friction over the device file's, viscous and Coulomb.
    cable_stiffness_Nm_rad, cable_damping_Nms_rad : float
        Cable between gear and motor-side part.
    cable_backlash_rad : float
        Whole gap before the cable pulls.
    cable_loss, cable_loss_width_rad_s : float
        Share of the cable's torque lost on the motor-side part, and the speed that smooths it.
    motor_side_inertia_kgm2, motor_side_damping_Nms_rad : float
        The motor-side part.
    gear_disturbance_rms_rad_s2 : float
        Effective value of d4.
    joint_encoder_bits, motor_encoder_bits : int
        Encoders.
    velocity_filter_Hz : float
        The velocity filter that the trials' controllers had.
    """

    friction_scale: float
    cable_stiffness_Nm_rad: float
    cable_damping_Nms_rad: float
    cable_backlash_rad: float
    cable_loss: float
    cable_loss_width_rad_s: float
    motor_side_inertia_kgm2: float
    motor_side_damping_Nms_rad: float
    gear_disturbance_rms_rad_s2: float
    joint_encoder_bits: int
    motor_encoder_bits: int
    velocity_filter_Hz: float


@dataclass(frozen=True)
class Disturbance:
    """Bands from which the wave numbers of the gear's disturbance are drawn.

    Parameters
    ----------
    bands_1_rad : tuple of (float, float)
        One band a sine.
    """

    bands_1_rad: tuple[Interval, ...]


@dataclass(frozen=True)
class Stops:
    """Mechanical stops of coupling and joint.

    Parameters
    ----------
    coupling_rad : float
        Deflection at which the coupling's jaws meet.
    coupling_stiffness_Nm_rad, coupling_damping_Nms_rad : float
        How hard they are.
    joint_stiffness_Nm_rad, joint_damping_Nms_rad : float
        How hard the ends of the joint's travel are.
    """

    coupling_rad: float
    coupling_stiffness_Nm_rad: float
    coupling_damping_Nms_rad: float
    joint_stiffness_Nm_rad: float
    joint_damping_Nms_rad: float


@dataclass(frozen=True)
class Twist:
    """A way to lead the cable.

    Parameters
    ----------
    cable_loss : float
        Share of the cable's torque lost on the motor-side part.
    cable_stiffness_Nm_rad : float
        Cable between gear and motor-side part.
    """

    cable_loss: float
    cable_stiffness_Nm_rad: float


@dataclass(frozen=True)
class Trip:
    """Thresholds at which the drive switches itself off.

    Parameters
    ----------
    speed_rad_s : float
        Speed at the joint.
    torque_rms_Nm : float
        Effective torque at the motor's shaft.
    torque_window_s : float
        Time constant of that value.
    """

    speed_rad_s: float
    torque_rms_Nm: float
    torque_window_s: float


@dataclass(frozen=True)
class Person:
    """A person: limb, and how it is moved along the intended path.

    Parameters
    ----------
    Jh_kgm2 : float
        Inertia of limb and load side.
    spring_Nm_rad, damping_Nms_rad : float
        Pull towards the intended path.
    feedforward : bool
        Whether the person also gives the torque that the intended path needs.
    own_damping_Nms_rad : float
        Damping of the limb itself.
    gravity_Nm : float
        Times the sine of the angle, towards full extension.
    torque_noise_Nm, torque_noise_Hz : float
        Effective value and bandwidth (first order) of the torque noise.
    load_velocity_filter_Hz : float, optional
        The load-side velocity filter that the reference trials used with this person.
    clamped : bool
        No person: the load is held where it starts.
    """

    Jh_kgm2: float
    spring_Nm_rad: float
    damping_Nms_rad: float
    feedforward: bool
    own_damping_Nms_rad: float
    gravity_Nm: float
    torque_noise_Nm: float
    torque_noise_Hz: float
    load_velocity_filter_Hz: float | None = None
    clamped: bool = False

    def values(self) -> dict[str, float]:
        """As tunables of the Block ``plant``.

        Returns
        -------
        dict of str to float
            One value a tunable of :func:`person_tunables`.
        """
        return {k: float(v) for k, v in vars(self).items() if k != "load_velocity_filter_Hz"}


@dataclass(frozen=True)
class Fixed:
    """Sinusoidal torque with the output fixed.

    Parameters
    ----------
    settle_cycles, cycles : int
        Cycles before the analysis, and in all.
    slow_below_Hz : float
        Below this frequency the next two hold.
    slow_settle_cycles, slow_cycles : int
        Cycles of a slow sinusoid.
    """

    settle_cycles: int
    cycles: int
    slow_below_Hz: float
    slow_settle_cycles: int
    slow_cycles: int


@dataclass(frozen=True)
class Backdriven:
    """Slow sinusoids from full extension.

    Parameters
    ----------
    amplitude_deg : float
        Half of the range of motion.
    frequencies_Hz : tuple of float
        Those of the trials.
    duration_s, settle_s : float
        Length, and start of the analysis.
    """

    amplitude_deg: float
    frequencies_Hz: tuple[float, ...]
    duration_s: float
    settle_s: float


@dataclass(frozen=True)
class Bread:
    """Cutting bread: a rise, then slices.

    Parameters
    ----------
    rise_s, middle_rad : float
        How long the rise takes, and where it ends.
    amplitude_rad, frequency_Hz : float
        The slices.
    fade_s : float
        Time constant with which they begin.
    duration_s, settle_s : float
        Length, and start of the analysis.
    """

    rise_s: float
    middle_rad: float
    amplitude_rad: float
    frequency_Hz: float
    fade_s: float
    duration_s: float
    settle_s: float


@dataclass(frozen=True)
class Reach:
    """Reaching there and back for impedance control.

    Parameters
    ----------
    reach_deg, half_s : float
        How far, and how long one way takes.
    duration_s, settle_s, end_s : float
        Length, and the analysed window.
    """

    reach_deg: float
    half_s: float
    duration_s: float
    settle_s: float
    end_s: float


@dataclass(frozen=True)
class Trajectories:
    """Numbers of the trajectories.

    Parameters
    ----------
    fixed : Fixed
        Output fixed.
    backdriven : Backdriven
        Slow sinusoids.
    bread : Bread
        Cutting bread.
    impedance : Reach
        Reaching.
    """

    fixed: Fixed
    backdriven: Backdriven
    bread: Bread
    impedance: Reach


@dataclass(frozen=True)
class Random:
    """Ends of the uniform distributions of a Monte-Carlo family.

    Parameters
    ----------
    friction_scale, inertia_scale, lag_scale : (float, float)
        Over the device file's numbers; the two frictions are drawn apart.
    cable_stiffness_Nm_rad, cable_backlash_rad, cable_loss : (float, float)
        The cable.
    gear_disturbance_rms_rad_s2 : (float, float)
        The gear's disturbance.
    Jh_kgm2, gravity_Nm, spring_Nm_rad, damping_Nms_rad, torque_noise_Nm : (float, float)
        The person.
    """

    friction_scale: Interval
    inertia_scale: Interval
    lag_scale: Interval
    cable_stiffness_Nm_rad: Interval
    cable_backlash_rad: Interval
    cable_loss: Interval
    gear_disturbance_rms_rad_s2: Interval
    Jh_kgm2: Interval
    gravity_Nm: Interval
    spring_Nm_rad: Interval
    damping_Nms_rad: Interval
    torque_noise_Nm: Interval


@dataclass(frozen=True)
class Unstable:
    """When a run counts as unstable.

    Parameters
    ----------
    max_true_error_Nm : float
        Largest true torque error after the settling time.
    max_gear_speed_rad_s : float
        Largest speed of the gear.
    """

    max_true_error_Nm: float
    max_gear_speed_rad_s: float


@dataclass(frozen=True)
class Plants:
    """The whole file.

    Parameters
    ----------
    nominal : Nominal
        The nominal plant.
    real : Real
        The reference plant.
    disturbance : Disturbance
        Bands of its sines.
    stops : Stops
        Mechanical stops.
    twist : mapping of str to Twist
        Ways to lead the cable, by angle in degrees.
    trip : Trip
        The drive's own protection.
    person : mapping of str to Person
        People by name.
    trajectory : Trajectories
        Trajectories.
    random : Random
        Monte-Carlo families.
    unstable : Unstable
        When a run counts as unstable.
    """

    nominal: Nominal
    real: Real
    disturbance: Disturbance
    stops: Stops
    twist: Mapping[str, Twist]
    trip: Trip
    person: Mapping[str, Person]
    trajectory: Trajectories
    random: Random
    unstable: Unstable


def _built(kind: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        fields = {f.name: f for f in dataclasses.fields(kind)}
        needed = {n for n, f in fields.items() if f.default is dataclasses.MISSING}
        wrong = sorted(set(value) - set(fields)) or sorted(needed - set(value))
        if wrong:
            state = "unknown" if wrong[0] in value else "missing"
            raise UserError(
                f"{FILE}: key {where}{wrong[0]} is {state}.", f"Keys here: {', '.join(fields)}."
            )
        made = {k: _built(hints[k], v, f"{where}{k}.") for k, v in value.items()}
        return kind(**made)  # type: ignore[operator]
    if isinstance(kind, UnionType):
        kind = get_args(kind)[0]
    inner = get_args(kind)
    if isinstance(value, dict):
        return {k: _built(inner[1], v, f"{where}{k}.") for k, v in value.items()}
    if isinstance(value, list):
        return tuple(_built(inner[0], v, where) for v in value)
    bad = isinstance(value, bool) != (kind is bool) or not isinstance(value, (int, float))
    if bad or (kind is int and not isinstance(value, int)) or not math.isfinite(value):
        raise UserError(
            f"{FILE}: {where.rstrip('.')} = {value!r} is not a {kind.__name__}.", "Give one."
        )
    return kind(value)


def parse_plants(text: str) -> Plants:
    """Read the text of a ``plants.toml``.

    Parameters
    ----------
    text : str
        TOML.

    Returns
    -------
    Plants
        The numbers.

    Raises
    ------
    UserError
        When it is not TOML, or a key is missing, unknown or of another type.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{FILE}: not valid TOML ({error}).", "Correct that line.") from None
    plants: Plants = _built(Plants, document, "")
    return plants


PLANTS = parse_plants((resources.files("esea_gen") / "twin" / FILE).read_text(encoding="utf-8"))
PEOPLE: dict[str, Person] = {
    **PLANTS.person,
    "none": dataclasses.replace(PLANTS.person["ideal"], clamped=True),
}
"""The people that have names: ``ideal``, ``uncertain``, and ``none`` (the load is clamped)."""
