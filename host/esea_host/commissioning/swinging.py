"""Gain, loss and offset of the adaptation, from two known masses that the drive swings.

One least-squares fit covers both swings, with a term for each possible wrong statement: a weight
that both have in common, a tilt, a damping.  The motor's torque is compared separately.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import fftconvolve

from esea_gen.device import Device
from esea_gen.devices.fields import ADAPTATION_STOP_NM as STOP_NM
from esea_gen.errors import UserError
from esea_gen.identify.drive.regression import LeastSquares, fit_linear
from esea_gen.studies.torque_check.procedure import ZERO_LIMIT, KnownLoad
from esea_host.commissioning.drive import gear_torque_Nm, window
from esea_host.commissioning.startup import DriveRecording, StartupCheck, travel
from esea_host.recording.layout import Array

LENGTH_S, FADE_S, SHARE = 40.0, 5.0, 0.6
"""Of a swing; the share of the mass's torque that is wanted at most."""
RATES_HZ, SWELL_S, LEAST_SWELL = (0.2, 0.1), 20.0, 0.4
"""Two rates tell damping from hysteresis; swelling and fading averages the gear's disturbance."""
SWING_TURN_S = 0.01  # from one wish to the next: coarser steps drive the motor to its limits
LEAST_STOP_SHARE = 1.2  # wanted at most, over the stop operator's threshold: else it is no loss
SECOND_SHARES = (0.3, 0.7)  # second mass over the first
ROOM_RAD, LEAST_RAD = 0.8, 0.2  # beside the hanging arm; that it must have moved either way
WIDTH_S, EVERY, BLOCK_S, END_S = 0.25, 10, 2.0, 0.3

LEFT_SHARE, WEIGHT_SHARE = 0.008, 0.03  # of full scale; of the first mass
TILT_DEG, DAMPING_NMS_RAD, GAIN_PCT, MOTOR_PCT = 2.0, 0.25, 2.0, 12.0


@dataclass(frozen=True)
class SwungMass:
    mass_Nm: float  # its weight times its arm, with the arm's own as stated
    recording: DriveRecording
    tau_Nm: Array  # as the sensor shows it


@dataclass(frozen=True)
class JudgedSwings:
    checks: tuple[StartupCheck, ...]
    found: dict[str, Any]
    tunables: dict[str, float]  # of the Block, if all passed
    known_Nm: tuple[Array, ...]  # of each mass as stated, its inertia as identified; as shown
    shown_Nm: tuple[Array, ...]
    time_s: Array  # of what is left
    left_Nm: Array
    left_limit_Nm: float


def require_masses(device: Device, first: KnownLoad, second: KnownLoad) -> None:
    """Refuse masses that leave the loss or the arm's own weight unknown."""
    least, most = LEAST_STOP_SHARE * STOP_NM / SHARE, device.tau_full_scale_Nm
    g_per_Nm = 1000 * first.mass_kg / first.weight_Nm
    if not least <= first.weight_Nm <= most:
        raise UserError(
            f"The mass gives {first.weight_Nm:.3g} Nm; the adaptation needs {least:.3g} to "
            f"{most:.3g} Nm.",
            f"Take {math.ceil(least * g_per_Nm) / 1000:g} to "
            f"{math.floor(most * g_per_Nm) / 1000:g} kg there.",
        )
    low, high = (s * first.weight_Nm for s in SECOND_SHARES)
    if not low <= second.weight_Nm <= high:
        raise UserError(
            f"The second mass gives {second.weight_Nm:.3g} Nm, not {low:.3g} to {high:.3g} Nm "
            "(30 to 70 % of the first).",
            f"Take about {0.5 * first.mass_kg:.2g} kg there.",
        )


def hangs_within(device: Device, hangs_rad: float | None) -> float:
    """Where the arm hangs straight down, with room to swing; default: middle of the travel."""
    low, high = travel(device)
    chosen = 0.5 * (low + high) if hangs_rad is None else hangs_rad
    if not low + ROOM_RAD <= chosen <= high - ROOM_RAD:
        ends = f"{math.degrees(low + ROOM_RAD):.0f} to {math.degrees(high - ROOM_RAD):.0f} deg"
        raise UserError(
            f"Hanging at {math.degrees(chosen):.0f} deg, not at {ends}, the arm would swing "
            "against the end of the travel.",
            "Mount it at another angle: --hangs.",
        )
    return chosen


def wanted_Nm(at_s: float, mass_Nm: float) -> float:
    """Desired torque while the drive swings a mass."""
    fast, slow = RATES_HZ
    half = 0.5 * LENGTH_S
    turns = fast * min(at_s, half) + slow * max(at_s - half, 0.0)
    swell = LEAST_SWELL + (1 - LEAST_SWELL) * math.cos(math.pi * at_s / (0.5 * SWELL_S)) ** 2
    size = SHARE * mass_Nm * min(at_s / FADE_S, (LENGTH_S - at_s) / END_S, 1.0)
    return max(size, 0.0) * swell * math.sin(2 * math.pi * turns)


def _stop(x: Array) -> Array:
    # The Block's stop operator, in play form.
    play, out = float(x[0]), np.empty_like(x)
    for k, value in enumerate(x.tolist()):
        play = min(max(play, value - STOP_NM), value + STOP_NM)
        out[k] = value - play
    return out


@dataclass(frozen=True)
class _Rows:
    """One swing, thinned; everything through one symmetric filter."""

    mass_Nm: float
    angle: Array
    rate: Array
    acceleration: Array
    shown: Array
    motor: Array
    drive: Array  # columns: acceleration, rate, Coulomb's sign of the gear

    @classmethod
    def of(cls, device: Device, swing: SwungMass, hangs_rad: float) -> _Rows:
        r = swing.recording
        h = r.tick_s
        w = window(WIDTH_S, h)
        used = slice(round(2 * WIDTH_S / h), -round(2 * WIDTH_S / h), EVERY)

        def smooth(x: Array) -> Array:
            return np.asarray(fftconvolve(x, w, "same"))

        angle, gear = smooth(r.load_rad - hangs_rad), smooth(r.gear_rad)
        rate, turning = np.gradient(angle, h), np.gradient(gear, h)
        a = device.file.actuator
        assert a is not None
        sign = smooth(np.tanh(np.gradient(r.gear_rad, h) / a.coulomb_width_rad_s.value))
        drive = np.column_stack([np.gradient(turning, h), turning, sign])
        alpha, shown = np.gradient(rate, h), smooth(swing.tau_Nm)
        angle, rate, alpha, shown = (x[used] for x in (angle, rate, alpha, shown))
        motor = smooth(gear_torque_Nm(device, r))[used]
        return cls(swing.mass_Nm, angle, rate, alpha, shown, motor, drive[used])


def _fitted(rows: Sequence[_Rows], tick_s: float) -> tuple[LeastSquares, LeastSquares, float]:
    # Of the sensor's torque, and of the motor's on what the first makes of the masses; the gain.
    counts = [len(r.angle) for r in rows]
    each = EVERY * tick_s
    blocks = np.concatenate(
        [1000 * i + np.arange(n) * each // BLOCK_S for i, n in enumerate(counts)]
    )
    bodies = []
    for i, r in enumerate(rows):
        own = np.zeros((len(r.angle), len(rows)))
        own[:, i] = r.acceleration
        sine, cosine = np.sin(r.angle), np.cos(r.angle)
        bodies.append(np.column_stack([r.mass_Nm * sine, r.mass_Nm * cosine, sine, r.rate, own]))
    shown = np.concatenate([r.shown for r in rows])
    gain = 1.0
    for _ in range(2):
        loss = np.concatenate([_stop(r.shown / gain) for r in rows])
        sensor = fit_linear(
            np.column_stack([loss, np.ones(len(loss)), np.vstack(bodies)]), shown, blocks
        )
        gain = float(np.hypot(*sensor.values[2:4]))
    drive = np.vstack([r.drive for r in rows])
    motor = fit_linear(
        np.column_stack([np.vstack(bodies) @ sensor.values[2:] / gain, drive, np.ones(len(shown))]),
        np.concatenate([r.motor for r in rows]),
        blocks,
    )
    return sensor, motor, gain


def judged_swings(device: Device, swings: Sequence[SwungMass], hangs_rad: float) -> JudgedSwings:
    """Modelled torque for a true torque, and whether the masses were as stated."""
    rows = [_Rows.of(device, s, hangs_rad) for s in swings]
    least = min(0.5 * float(np.ptp(r.angle)) for r in rows)
    if not least >= LEAST_RAD:
        raise UserError(
            f"The arm swung by {least:.2f} rad either way, below {LEAST_RAD:g} rad.",
            "Check that the drive is enabled and the arm is free.",
        )
    sensor, motor, gain = _fitted(rows, swings[0].recording.tick_s)
    loss, offset, along, across, common, rate = (float(x) for x in sensor.values[:6])
    tilt_deg = math.degrees(math.atan2(across, along))
    weight_Nm, damping = common / gain, rate / gain
    per_known = float(motor.values[0])
    found = {
        "gain": gain,
        "gain_half_interval": sensor.estimates()[2].half,
        "loss": loss,
        "offset_Nm": offset,
        "weight_not_stated_Nm": weight_Nm,
        "hangs_deg": math.degrees(hangs_rad) - tilt_deg,
        "damping_Nms_rad": damping,
        "motor_over_known": per_known,
        "motor_over_sensor": per_known / gain,
        "left_rms_Nm": sensor.rms,
    }
    moved = zip(rows, sensor.values[6:] / gain, strict=True)
    return JudgedSwings(
        _checks(device, found, tilt_deg, max(s.mass_Nm for s in swings)),
        found,
        {"gain": gain, "loss": loss, "offset_Nm": offset},
        tuple(
            r.mass_Nm * np.sin(r.angle) + J * r.acceleration + damping * r.rate for r, J in moved
        ),
        tuple(r.shown for r in rows),
        EVERY * swings[0].recording.tick_s * np.arange(len(sensor.residual)),
        sensor.residual,
        LEFT_SHARE * device.tau_full_scale_Nm,
    )


def _checks(
    device: Device, found: dict[str, Any], tilt_deg: float, mass_Nm: float
) -> tuple[StartupCheck, ...]:
    weight, gain, own = found["weight_not_stated_Nm"], found["gain"], device.file.adaptation
    assert own is not None
    bound = 1 / own.scale_least.value if gain > 1 else 1 / own.scale_most.value
    # What is sensed with nothing on the joint has passed the step 'zero' with this limit.
    zero_Nm = ZERO_LIMIT.torque_Nm(device.tau_full_scale_Nm, 0.0)
    touched = "Check that no hand or cable touches the arm."
    rows = (
        (
            "torque that no hanging mass explains, effective", found["left_rms_Nm"],
            LEFT_SHARE * device.tau_full_scale_Nm, "Nm",
            f"{touched}  Fix the mass, and repeat the step.  If the error remains: "
            "check the joint encoders (step 'encoders').",
        ),
        (
            "half the interval of the gain", 100 * found["gain_half_interval"], GAIN_PCT, "%",
            f"The swings do not determine it.  {touched}",
        ),
        (
            "weight not stated, by the difference of the masses", abs(weight),
            WEIGHT_SHARE * mass_Nm, "Nm",
            f"The arm's own weight is missing or wrong (add {weight:+.3g} Nm to --arm-weight), or "
            "a hand rests on the arm, or a stated mass is wrong.",
        ),
        (
            "angle at which it hangs, off the one stated", abs(tilt_deg), TILT_DEG, "deg",
            "The device is tilted, or the joint's zero is off: level it and do the step 'zero', "
            f"or give --hangs {found['hangs_deg']:.1f}.",
        ),
        (
            "damping of the joint that bears the mass", abs(found["damping_Nms_rad"]),
            DAMPING_NMS_RAD, "Nms/rad",
            f"Check for a tight bearing.  {touched}",
        ),
        (
            "gain, of its bound", 100 * math.log(gain) / math.log(bound), 99.0, "%",
            "The rubber differs too much from its model: identify it, or exchange it.",
        ),
        (
            "loss, of its bound", 100 * abs(found["loss"]) / own.loss_most.value, 99.0, "%",
            "Check the coupling for wear and slip.",
        ),
        (
            "offset", abs(found["offset_Nm"]), min(own.offset_Nm.value, zero_Nm), "Nm",
            f"{touched}  If it is free, do the step 'zero' again, with nothing on the joint.",
        ),
        (
            "error of the motor's torque, of the known one",
            100 * abs(found["motor_over_known"] - 1), MOTOR_PCT, "%", _suspects(found),
        ),
    )  # fmt: skip
    return tuple(StartupCheck("adaptation", *row) for row in rows)


def _suspects(found: dict[str, Any]) -> str:
    # Sensor, motor and load are three: whichever two agree accuse the third.
    def off(x: float) -> bool:
        return 100 * abs(x - 1) > MOTOR_PCT

    if not off(found["motor_over_sensor"]):
        return (
            f"Sensor (gain {found['gain']:.3f}) and motor agree with each other and not with the "
            "load: weigh the masses, measure the arm.  If both are right, rubber and torque "
            "constant are off alike: the step 'torque', with a fixed motor, shows it."
        )
    constant = "the motor's torque constant or its friction"
    if not off(found["gain"]):
        return f"The sensor agrees with the load: check {constant}; the rubber is not the cause."
    return (
        f"Suspects are the rubber (gain {found['gain']:.3f}), {constant}, and the load.  The step "
        "'torque' separates them: with a fixed motor the torque constant has no effect."
    )
