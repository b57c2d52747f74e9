"""Standard plants, people and trajectories: the numbers of ``plants.toml``."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from importlib import resources

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from esea_gen.toml_file import checked, parse_toml

FILE = "plants.toml"
Interval = tuple[float, float]
STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True, config=STRICT)
class Nominal:
    """What the nominal plant has besides the device file."""

    coulomb_width_rad_s: float


@dataclass(frozen=True, config=STRICT)
class Real:
    """The standard plant with everything that the nominal one leaves out."""

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


@dataclass(frozen=True, config=STRICT)
class PublishedDisturbance:
    """Bands from which the wave numbers of the gear's disturbance are drawn."""

    bands_1_rad: tuple[Interval, ...]


@dataclass(frozen=True, config=STRICT)
class PublishedStops:
    """Mechanical stops of coupling and joint."""

    coupling_rad: float
    coupling_stiffness_Nm_rad: float
    coupling_damping_Nms_rad: float
    joint_stiffness_Nm_rad: float
    joint_damping_Nms_rad: float


@dataclass(frozen=True, config=STRICT)
class Twist:
    """A way to lead the cable."""

    cable_loss: float
    cable_stiffness_Nm_rad: float


@dataclass(frozen=True, config=STRICT)
class Trip:
    """Thresholds at which the drive switches itself off."""

    speed_rad_s: float
    torque_rms_Nm: float
    torque_window_s: float


@dataclass(frozen=True, config=STRICT)
class Person:
    """A person: limb, and how it is moved along the intended path."""

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
        return {k: float(v) for k, v in vars(self).items() if k != "load_velocity_filter_Hz"}


@dataclass(frozen=True, config=STRICT)
class Fixed:
    """Sinusoidal torque with the output fixed."""

    settle_cycles: int
    cycles: int
    slow_below_Hz: float
    slow_settle_cycles: int
    slow_cycles: int


@dataclass(frozen=True, config=STRICT)
class PublishedBackdriven:
    """Slow sinusoids from full extension."""

    amplitude_deg: float
    frequencies_Hz: tuple[float, ...]
    duration_s: float
    settle_s: float


@dataclass(frozen=True, config=STRICT)
class PublishedBread:
    """Cutting bread: a rise, then slices."""

    rise_s: float
    middle_rad: float
    amplitude_rad: float
    frequency_Hz: float
    fade_s: float
    duration_s: float
    settle_s: float


@dataclass(frozen=True, config=STRICT)
class Reach:
    """Reaching there and back for impedance control."""

    reach_deg: float
    half_s: float
    duration_s: float
    settle_s: float
    end_s: float


@dataclass(frozen=True, config=STRICT)
class Trajectories:
    """Numbers of the trajectories."""

    fixed: Fixed
    backdriven: PublishedBackdriven
    bread: PublishedBread
    impedance: Reach


@dataclass(frozen=True, config=STRICT)
class Random:
    """Ends of the uniform distributions of a Monte-Carlo family."""

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


@dataclass(frozen=True, config=STRICT)
class OffRandom:
    """Ends of the distributions when everything is off at once."""

    rubber_scale: Interval
    hysteresis_scale: Interval
    relaxation_Nm_rad: Interval
    encoder_deg: Interval
    friction_scale: Interval
    inertia_scale: Interval
    lag_scale: Interval
    delay_ms: tuple[int, int]
    backlash_rad: Interval
    missed_share: Interval


@dataclass(frozen=True, config=STRICT)
class OffFamilies:
    """Families of plants that differ from the model that a controller was built from."""

    rubber_scale: tuple[float, ...]
    hysteresis_scale: float
    relaxation_Nm_rad: float
    relaxation_s: float
    encoder_deg: tuple[float, ...]
    friction_scale: tuple[float, ...]
    inertia_scale: tuple[float, ...]
    lag_scale: tuple[float, ...]
    delay_ms: tuple[int, ...]
    backlash_rad: float
    missed_share: tuple[float, ...]
    missed_from_s: float
    random: OffRandom


@dataclass(frozen=True, config=STRICT)
class Unstable:
    """When a run counts as unstable."""

    max_true_error_Nm: float
    max_gear_speed_rad_s: float


@dataclass(frozen=True, config=STRICT)
class Plants:
    """The whole file."""

    nominal: Nominal
    real: Real
    disturbance: PublishedDisturbance
    stops: PublishedStops
    twist: Mapping[str, Twist]
    trip: Trip
    person: Mapping[str, Person]
    trajectory: Trajectories
    random: Random
    off: OffFamilies
    unstable: Unstable


def parse_plants(text: str) -> Plants:
    """Read the text of a ``plants.toml``."""
    document = parse_toml(text, FILE, "the shipped one")
    return checked(Plants, document, FILE, lambda _: None, text)


PLANTS = parse_plants((resources.files("esea_gen") / "twin" / FILE).read_text(encoding="utf-8"))
PEOPLE: dict[str, Person] = {
    **PLANTS.person,
    "none": dataclasses.replace(PLANTS.person["ideal"], clamped=True),
}
"""The people that have names: ``ideal``, ``uncertain``, and ``none`` (the load is clamped)."""
