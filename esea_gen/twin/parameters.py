"""Parameters that vary between virtual exoskeletons, and derived values."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.ports import Port, Tunable
from esea_gen.model.sections import section_of
from esea_gen.twin.published import PEOPLE, PLANTS

SINES = 6
MOTOR_NM = 0.221  # largest torque of the standard plants' motor
STEP_S = 2e-4  # docs/benchmarks.md has the evidence


def assumed(name: str, default: float, low: float, high: float, meaning: str) -> Tunable:
    """A tunable whose default is one of the standard plants' numbers."""
    return Tunable(name, default, low, high, meaning, "standard plants, plants.toml", "assumed")


# Name, least, largest, meaning; defaults: the device file's, or the standard plants'.
_DRIVE = (
    ("J_kgm2", 1e-4, 100, "inertia of motor and drive at the joint, eq. 5.2"),
    ("fv_Nms_rad", 0, 100, "viscous friction, eq. 5.2"),
    ("fc_Nm", 0, 100, "Coulomb friction, eq. 5.2"),
    ("tau_c_s", 1e-4, 1, "lag of the motor's torque, eq. 5.1"),
    ("u_max_Nm", 1e-3, 100, "largest |motor torque| that the drive follows"),
)
_TRAVEL = (
    ("theta_min_rad", -10, 10, "lower end of the joint's travel"),
    ("theta_max_rad", -10, 10, "upper end of the joint's travel"),
)
_CABLE = (
    ("cable_stiffness_Nm_rad", 0, 1e4, "stiffness of the cable"),
    ("cable_damping_Nms_rad", 0, 100, "damping of the cable"),
    ("cable_backlash_rad", 0, 1, "whole gap between gear and cable end"),
    ("cable_loss", 0, 0.9, "share of |cable torque| lost to friction"),
    ("cable_loss_width_rad_s", 1e-3, 10, "width of that friction, tanh(omega/width)"),
    ("motor_side_inertia_kgm2", 1e-4, 10, "inertia of the coupling's motor-side part"),
    ("motor_side_damping_Nms_rad", 0, 10, "damping of the coupling's motor-side part"),
)
CABLE_KEYS = tuple(row[0] for row in _CABLE)
_PERSON = (
    ("Jh_kgm2", 1e-3, 100, "inertia of limb and load side"),
    ("spring_Nm_rad", 0, 1e4, "pull towards the intended path"),
    ("damping_Nms_rad", 0, 1e3, "pull towards the intended speed"),
    ("feedforward", 0, 1, "share of the torque that the intended path needs"),
    ("own_damping_Nms_rad", 0, 100, "damping of the limb itself"),
    ("gravity_Nm", 0, 100, "gravity, times the sine of the angle"),
    ("torque_noise_Nm", 0, 100, "effective value of the torque noise"),
    ("torque_noise_Hz", 0.01, 100, "bandwidth of the torque noise"),
    ("clamped", 0, 1, "1: no person, the load is held where it is"),
)


def _given(section: Any, rows: Iterable[tuple[str, float, float, str]]) -> list[Tunable]:
    # As the device file has them.
    held = [(getattr(section, key), key, low, high, text) for key, low, high, text in rows]
    return [Tunable(k, q.value, low, high, t, q.source, q.status) for q, k, low, high, t in held]


def _disturbance() -> list[Tunable]:
    middles = [sum(band) / 2 for band in PLANTS.disturbance.bands_1_rad]
    return [
        *(
            assumed(f"wave_{i}_1_rad", k, 0, 1000, f"wave number of sine {i} of d4")
            for i, k in enumerate(middles, 1)
        ),
        *(
            assumed(f"phase_{i}_rad", 0, -7, 7, f"phase of sine {i} of d4")
            for i in range(1, SINES + 1)
        ),
    ]


def _bounds(device: DeviceData) -> list[Tunable]:
    # The disturbance's size and the elastomer's scale, then what ends a motion: stops and trip.
    travel = _given(device.file.joint, _TRAVEL)
    stops, trip = PLANTS.stops, PLANTS.trip
    jaw_Nm_rad, jaw_Nms_rad = stops.coupling_stiffness_Nm_rad, stops.coupling_damping_Nms_rad
    end_Nm_rad, end_Nms_rad = stops.joint_stiffness_Nm_rad, stops.joint_damping_Nms_rad
    speed, window = trip.speed_rad_s, trip.torque_window_s
    # What heats the windings of the standard motor, or of the device's own by its largest torque.
    share = device.file.actuator.u_max_Nm.value / MOTOR_NM if device.file.actuator else 1.0
    torque = trip.torque_rms_Nm * share
    return [
        assumed("gear_disturbance_rms_rad_s2", 0, 0, 100, "effective value of d4, eq. 5.2"),
        assumed("elastomer_scale", 1, 0.1, 10, "true torque over the model's torque"),
        assumed("hysteresis_scale", 1, 0, 10, "torque of the stop operators over the model's"),
        assumed("relaxation_Nm_rad", 0, 0, 1000, "stiffness of a second Maxwell branch"),
        assumed("relaxation_s", PLANTS.off.relaxation_s, 1e-2, 1e4, "time constant of that branch"),
        assumed("coupling_stop_rad", stops.coupling_rad, 0.01, 1.4, "deflection at the stop"),
        assumed("coupling_stop_Nm_rad", jaw_Nm_rad, 0, 1e5, "stiffness of the coupling's stop"),
        assumed("coupling_stop_Nms_rad", jaw_Nms_rad, 0, 100, "damping of the coupling's stop"),
        *(replace(t, name=t.name.replace("theta", "joint")) for t in travel),
        assumed("joint_stop_Nm_rad", end_Nm_rad, 0, 1e5, "stiffness of the joint's stops"),
        assumed("joint_stop_Nms_rad", end_Nms_rad, 0, 1000, "damping of those stops"),
        assumed("trip_speed_rad_s", speed, 0, 400, "speed at the joint that trips the drive"),
        assumed("trip_torque_Nm", torque, 0, 100, "effective motor torque that trips the drive"),
        assumed("trip_window_s", window, 1e-2, 100, "time constant of that value"),
    ]


def plant_tunables(device: DeviceData, cable: bool) -> tuple[Tunable, ...]:
    """Tunables that vary between plants without a new compilation."""
    for key in ("actuator", "joint"):
        section_of(device, key, "the virtual exoskeleton needs it")
    drive = _given(device.file.actuator, _DRIVE)
    soft = PLANTS.nominal.coulomb_width_rad_s
    width = assumed(
        "coulomb_width_rad_s",
        soft,
        1e-3,
        10,
        "width of the Coulomb friction, tanh(omega/width): larger is softer",
    )
    real = vars(PLANTS.real)
    cables = [assumed(k, real[k], low, high, text) for k, low, high, text in _CABLE if cable]
    who, source = PEOPLE["ideal"].values(), "standard people, plants.toml"
    person = [Tunable(k, who[k], low, high, t, source, "assumed") for k, low, high, t in _PERSON]
    return (*drive[:3], width, *drive[3:], *cables, *_disturbance(), *_bounds(device), *person)


# What prepare computes rather than hands on, and which tunables it replaces by that.
_DERIVED = {
    "lag_decay": "exp(-h / tau_c)",
    "heat_share": "1 - exp(-h / trip window)",
    "d4_amplitude_rad_s2": "amplitude of each sine of d4",
    "wave_turns": "turns of each sine of d4 per radian of the gear",
    "phase_turns": "phase of each sine of d4 in turns",
    "relaxation_decay": "exp(-h / relaxation)",
    "relaxation_gain_Nms_rad": "torque of the second Maxwell branch from a rate held for one step",
    "noise_decay": "decay of the person's torque noise in one step",
    "noise_gain_Nm": "gain of the person's torque noise in one step",
    "free": "1 for a load that moves, 0 for a clamped one",
}
_REPLACED = {
    "tau_c_s",
    "trip_window_s",
    "gear_disturbance_rms_rad_s2",
    "relaxation_Nm_rad",
    "relaxation_s",
    "torque_noise_Nm",
    "torque_noise_Hz",
    "clamped",
}


def passed_on(tunables: tuple[Tunable, ...]) -> list[str]:
    """Names of the tunables that are coefficients as they are."""
    waves = ("wave_", "phase_")
    return [t.name for t in tunables if t.name not in _REPLACED and not t.name.startswith(waves)]


def plant_coefficients(tunables: tuple[Tunable, ...]) -> tuple[Port, ...]:
    by_name = {t.name: t for t in tunables}
    direct = [by_name[n] for n in passed_on(tunables)]
    vectors = ("wave_turns", "phase_turns")
    return (
        *(t.port for t in direct),
        *(
            Port(n, -200.0 if n in vectors else 0.0, 200.0, text, SINES if n in vectors else 1)
            for n, text in _DERIVED.items()
        ),
    )


def prepare_plant(t: SimpleNamespace, names: list[str], h: float, tick: float) -> dict[str, Any]:
    values = {n: getattr(t, n) for n in names}
    decay = ca.exp(-2 * math.pi * h * t.torque_noise_Hz)
    # White numbers of variance 1, each held for a tick, through this first-order filter must come
    # out with the wanted effective value: over a tick the filter's pole is decay ** substeps.
    over_tick = ca.exp(-2 * math.pi * tick * t.torque_noise_Hz)
    gain = (1 - decay) * ca.sqrt((1 + over_tick) / (1 - over_tick))
    relaxed = ca.exp(-h / t.relaxation_s)
    return values | {
        "lag_decay": ca.exp(-h / t.tau_c_s),
        "heat_share": 1 - ca.exp(-h / t.trip_window_s),
        "d4_amplitude_rad_s2": math.sqrt(2 / SINES) * t.gear_disturbance_rms_rad_s2,
        "wave_turns": [getattr(t, f"wave_{i + 1}_1_rad") / (2 * math.pi) for i in range(SINES)],
        "phase_turns": [getattr(t, f"phase_{i + 1}_rad") / (2 * math.pi) for i in range(SINES)],
        "relaxation_decay": relaxed,
        "relaxation_gain_Nms_rad": t.relaxation_Nm_rad * t.relaxation_s * (1 - relaxed),
        "noise_decay": decay,
        "noise_gain_Nm": t.torque_noise_Nm * gain,
        "free": t.clamped < 0.5,
    }
