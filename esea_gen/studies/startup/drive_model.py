"""From recordings to the drive's numbers, with intervals.

All procedures share one equation, (5.2) with (5.1) in it, in commanded torque::

    n u_a(t - delay) = (J a + fv w + fc sign(w) + tau_cable) / g + D(theta_g) / g

with the motor's gain g: only against the rubber, whose torque is known, can it be told from the
rest.  The gear's disturbance D is a Fourier series over the travel.  Each procedure excites what it
is for; what it cannot tell it takes from the others, so all are gone through a few times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from esea_gen.device import Device
from esea_gen.identify.regression import (
    Estimate,
    LeastSquares,
    fit_linear,
    fit_separable,
)
from esea_gen.language.ports import Array
from esea_gen.studies.startup.reaction import JumpResponse, jump_response
from esea_gen.studies.startup.signals import Signals
from esea_gen.studies.startup.watch import DriveRecording

MOST_ROUNDS, SETTLED = 8, 1e-3  # shares of lag and gain, from one round to the next
MOST_WAVE_1_RAD = 90.0
STRETCH = 1.08  # of the travel: the series' own period, so that its ends need not meet
LAG_S = (0.002, 0.3)
DELAY_S = (-0.0009, 0.05)
MAP_POINTS = 256
CABLE_NM = 0.5  # below, the cable may lie in its gap
# What the equation leaves out (the cable's swing, a load that bounces in its gap) is the same every
# time, so no spread of blocks shows it.  Half widths that cover it on plants whose truth is known
# (docs/startup.md), added by squares: shares of the value, and what is absolute.
FLOOR_SHARE = {"J_kgm2": 0.005, "fv_Nms_rad": 0.01, "fc_Nm": 0.005, "tau_c_s": 0.005}
FLOOR_SHARE |= {"cable_give_rad_Nm": 0.04}
MAP_FLOOR_SHARE = 0.03  # of its effective value
FLOOR = {"backlash_rad": 5e-4, "delay_s": 5e-5, "delay_again_s": 5e-5, "joint_ratio": 0.002}


@dataclass(frozen=True)
class DisturbanceMap:
    """Torque that turns the gear against nothing else, over its angle.

    torque_Nm, half_Nm: at the joint, and half the width of its interval, shape (n,).
    """

    gear_rad: Array
    torque_Nm: Array
    half_Nm: Array

    @property
    def rms_Nm(self) -> float:
        """Effective value over the travel, the mean taken off."""
        return float(np.std(self.torque_Nm))

    @property
    def peak_Nm(self) -> float:
        """Largest magnitude, the mean taken off."""
        return float(np.max(np.abs(self.torque_Nm - np.mean(self.torque_Nm))))


@dataclass(frozen=True)
class DriveModel:
    """What the procedures found.

    gain: motor's torque over its command, as far as the rubber's torque is right.
    cable_loss: share of the cable's torque that is lost.
    cable_give_rad_Nm: one over the cable's stiffness, which a rigid cable has too.
    delay_again_s: delay as the procedure for the inertia saw it.
    jump: mean reaction to the command's jumps.
    joint_ratio: motion of the motor side over that of the gear; 1 where the ratio is right.
    left_Nm: effective value of what each procedure's model leaves, at the joint.
    moved_Nm: effective value of the torque that it explains.
    """

    gain: Estimate
    cable_loss: Estimate
    cable_give_rad_Nm: Estimate
    backlash_rad: Estimate
    fv_Nms_rad: Estimate
    fc_Nm: Estimate
    J_kgm2: Estimate
    tau_c_s: Estimate
    delay_s: Estimate
    delay_again_s: Estimate
    joint_ratio: Estimate
    disturbance: DisturbanceMap
    jump: JumpResponse
    left_Nm: Mapping[str, float]
    moved_Nm: Mapping[str, float]


class _Series:
    """Fourier series over the travel."""

    def __init__(self, *signals: Signals) -> None:
        angles = np.concatenate([s.gear_rad for s in signals])
        self.low, self.high = float(angles.min()), float(angles.max())
        period = STRETCH * (self.high - self.low)
        count = max(int(MOST_WAVE_1_RAD * period / (2 * math.pi)), 1)
        self.waves_1_rad = 2 * math.pi * np.arange(1, count + 1) / period

    def __call__(self, gear_rad: Array) -> Array:
        phase = np.outer(gear_rad - self.low, self.waves_1_rad)
        return np.hstack([np.cos(phase), np.sin(phase)])


class _Fit:
    """What is known so far; each method brings one procedure's part up to date."""

    def __init__(self, device: Device, recordings: Mapping[str, DriveRecording]) -> None:
        a = device.file.actuator
        assert a is not None
        first = recordings["gain"]
        rest = float(first.motor_rad[0] - first.load_rad[0])
        self.of = {k: Signals(device, r, rest) for k, r in recordings.items() if k != "sign"}
        self.series = _Series(self.of["friction"], self.of["disturbance"])
        self.waves = {k: s.term(self.series(s.gear_rad)) for k, s in self.of.items()}
        self.lag_s, self.delay_s = a.tau_c_s.value, 0.0
        self.gain, self.loss = 1.0, 0.0
        self.moved: dict[str, float] = {}
        self.left: dict[str, float] = {}

    def _noted(self, name: str, fit: LeastSquares, wanted: Array) -> LeastSquares:
        self.left[name] = self.gain * fit.rms
        self.moved[name] = self.gain * float(np.sqrt(np.mean(wanted**2)))
        return fit

    def turns(self) -> LeastSquares:
        """Friction, inertia and the disturbance, from turning at many speeds."""
        terms, wanted, blocks, count = [], [], [], 0
        for name in ("friction", "disturbance"):
            s = self.of[name]
            motion = [s.term(x) for x in (s.alpha_rad_s2, s.omega_rad_s, s.way)]
            terms.append(np.column_stack([*motion, np.ones(len(s.used)), self.waves[name]]))
            wanted.append(s.drive_Nm(self.lag_s, self.delay_s) - self._cable(s))
            blocks.append(s.blocks + count)
            count += int(s.blocks.max()) + 1
        found = fit_linear(np.vstack(terms), np.concatenate(wanted), np.concatenate(blocks))
        for name in ("friction", "disturbance"):
            self._noted(name, found, np.concatenate(wanted))
        self.map = found
        return found

    def against_rubber(self) -> LeastSquares:
        """The rubber's torque over the command: coefficients of it, of its magnitude, of friction.

        (1 + loss sign) torque of the rubber is in the cable where the drive winds it up, less where
        it gives way.
        """
        s, m = self.of["gain"], self.map.values
        known = m[0] * s.term(s.alpha_rad_s2) + m[1] * s.term(s.omega_rad_s) + m[3]
        known = known + self.waves["gain"] @ m[4:]
        y = s.drive_Nm(self.lag_s, self.delay_s)
        terms = [s.term(x) for x in (s.rubber_Nm, s.way * np.abs(s.rubber_Nm), s.way)]
        found = self._noted("gain", fit_linear(np.column_stack(terms), y - known, s.blocks), y)
        straight, bent = found.values[:2]
        self.loss = float(np.clip(bent / straight, 0.0, 0.9))
        self.gain = float(1 / (straight * (1 - self.loss**2)))
        return found

    def shaken(self, name: str) -> LeastSquares:
        """Lag and delay, then inertia and friction."""
        s = self.of[name]
        terms = [s.term(x) for x in (s.alpha_rad_s2, s.omega_rad_s, s.way)]
        terms.append(np.ones(len(s.used)))
        known = self.waves[name] @ self.map.values[4:] + self._cable(s)
        low, high = (np.array([a, b]) for a, b in zip(LAG_S, DELAY_S, strict=True))
        return self._noted(
            name,
            fit_separable(
                np.column_stack(terms),
                lambda p: s.drive_Nm(float(p[0]), float(p[1])) - known,
                np.array([self.lag_s, max(self.delay_s, 0.0005)]),
                low,
                high,
                s.blocks,
            ),
            s.drive_Nm(self.lag_s, self.delay_s),
        )

    def accelerating(self, found: LeastSquares) -> Array:
        """What the motor's torque alone does to the gear in the procedure for the delay."""
        s = self.of["delay"]
        lag, late, inertia = (float(x) for x in found.values[:3])
        return s.motor_Nm(lag, late) / inertia

    def _cable(self, s: Signals) -> Array:
        return s.term(s.cable_Nm(self.loss)) / self.gain


def _scaled(share: Estimate, fit: LeastSquares, k: int) -> Estimate:
    """A coefficient in commanded torque times the motor's gain, both uncertain."""
    plain = Estimate.of(fit.values[k], fit.deviation(k), fit.blocks)
    value = share.value * plain.value
    half = math.hypot(share.half * plain.value, share.value * plain.half)
    return Estimate(value, value - half, value + half)


def _widened(name: str, e: Estimate) -> Estimate:
    floor = FLOOR.get(name, FLOOR_SHARE.get(name, 0.0) * abs(e.value))
    half = math.hypot(e.half, floor)
    return Estimate(e.value, e.value - half, e.value + half)


def gain_and_loss(fit: LeastSquares) -> tuple[Estimate, Estimate]:
    """Of the motor and of the cable, from the coefficients of the rubber's torque and its size."""
    a, b = (float(x) for x in fit.values[:2])
    loss = b / a
    gain = 1 / (a * (1 - loss**2))
    # g = a / (a^2 - b^2)
    under = (a * a - b * b) ** 2
    of_gain = np.array([-(a * a + b * b) / under, 2 * a * b / under, 0.0])
    of_loss = np.array([-b / a**2, 1 / a, 0.0])
    return fit.estimate(of_gain, gain), fit.estimate(of_loss, loss)


def _cable_of(
    recording: DriveRecording, signals: Signals, loss: float
) -> tuple[Estimate, Estimate]:
    # Wound up by tau / k, and half the gap on either side.
    s, r = signals, recording
    torque = s.term(s.cable_Nm(loss))
    wound = s.term(r.gear_rad - r.motor_rad)
    pulled = np.abs(torque) > CABLE_NM
    terms = np.column_stack([torque, np.sign(torque), np.ones(len(torque))])
    fit = fit_linear(terms[pulled], wound[pulled], s.blocks[pulled])
    give, half_gap = (float(x) for x in fit.values[:2])
    return (
        fit.estimate(np.array([1.0, 0, 0]), give),
        fit.estimate(np.array([0, 2.0, 0]), 2 * half_gap),
    )


def _map_of(fit: _Fit, gain: float) -> DisturbanceMap:
    seen = np.concatenate([s.gear_rad[s.used] for s in (fit.of["friction"], fit.of["disturbance"])])
    angles = np.linspace(float(seen.min()), float(seen.max()), MAP_POINTS)
    waves = fit.series(angles)
    waves = waves - waves.mean(axis=0)
    spread = np.sqrt(np.einsum("ij,jk,ik->i", waves, fit.map.covariance[4:, 4:], waves))
    unit = Estimate.of(0.0, 1.0, fit.map.blocks).half
    torque = gain * waves @ fit.map.values[4:]
    half = np.hypot(gain * unit * spread, MAP_FLOOR_SHARE * np.std(torque))
    return DisturbanceMap(angles, torque, half)


def identify_drive(device: Device, recordings: Mapping[str, DriveRecording]) -> DriveModel:
    """The drive's numbers from the recordings of all procedures."""
    fit = _Fit(device, recordings)
    for _ in range(MOST_ROUNDS):
        before = np.array([fit.gain, fit.lag_s])
        turns = fit.turns()
        rubber = fit.against_rubber()
        inertia, delay = fit.shaken("inertia"), fit.shaken("delay")
        fit.lag_s, fit.delay_s = float(inertia.values[0]), float(delay.values[1])
        if np.max(np.abs(np.array([fit.gain, fit.lag_s]) / before - 1)) < SETTLED:
            break
    gain, loss = gain_and_loss(rubber)
    give, gap = _cable_of(recordings["gain"], fit.of["gain"], fit.loss)
    s, r = fit.of["friction"], recordings["friction"]
    follows = fit_linear(
        np.column_stack([s.term(r.gear_rad), s.term(s.way), np.ones(len(s.used))]),
        s.term(r.motor_rad),
        s.blocks,
    )

    def own(found: LeastSquares, k: int) -> Estimate:
        return Estimate.of(found.values[k], found.deviation(k), found.blocks)

    found = {
        "gain": gain,
        "cable_loss": loss,
        "cable_give_rad_Nm": give,
        "backlash_rad": gap,
        "fv_Nms_rad": _scaled(gain, turns, 1),
        "fc_Nm": _scaled(gain, turns, 2),
        "J_kgm2": _scaled(gain, inertia, 2),
        "tau_c_s": own(inertia, 0),
        "delay_s": own(delay, 1),
        "delay_again_s": own(inertia, 1),
        "joint_ratio": own(follows, 0),
    }
    return DriveModel(
        **{k: _widened(k, e) for k, e in found.items()},
        disturbance=_map_of(fit, gain.value),
        jump=jump_response(recordings["delay"], fit.accelerating(delay)),
        left_Nm=dict(fit.left),
        moved_Nm=dict(fit.moved),
    )


UNITS = {
    "gain": "1",
    "cable_loss": "1",
    "cable_give_rad_Nm": "rad_Nm",
    "backlash_rad": "rad",
    "fv_Nms_rad": "Nms_rad",
    "fc_Nm": "Nm",
    "J_kgm2": "kgm2",
    "tau_c_s": "s",
    "delay_s": "s",
    "delay_again_s": "s",
    "joint_ratio": "1",
}
"""Unit of each estimate, by name."""


__all__ = ["UNITS", "DisturbanceMap", "DriveModel", "gain_and_loss", "identify_drive"]
