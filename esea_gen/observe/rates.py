"""Angular rate of one side of the coupling: fourth-order Butterworth filter, then difference.

They commute, so the difference comes first: a large angle costs no precision.  The sections are
state-variable filters by the trapezoidal rule, in which no rounding of a coefficient changes the
gain at rest; at 2 Hz and 1 kHz in float32 a direct form misses it by more than 1e-4.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, around, clip, status_port, threshold
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

# Damping 1/Q of the two sections: twice the cosine of the poles' angles, pi/8 and 3 pi/8.
DAMPING = (2 * math.cos(math.pi / 8), 2 * math.cos(3 * math.pi / 8))
# The cut-off may be tuned by this factor either way: what depends on the filter's delay (the
# bandwidth of the disturbance observers) is checked for the whole of that range.
TUNING_FACTOR = 2.0
HIGHEST_SHARE = 0.4  # of the sampling rate; the field's own limit, 400 Hz at 1 kHz
LEVELS = 8
# The filter's states stay below this many times the largest |difference|: the sums of the
# magnitudes of their impulse responses are below 4.2 for every cut-off (test_observers).
STATE_ROOM = 5.0


EQUATIONS = """
    [rate 1] | H | 1 / (((s / omega_c)**2 + k_1 * s / omega_c + 1) \
        * ((s / omega_c)**2 + k_2 * s / omega_c + 1)) | \
        Butterworth filter of fourth order; bilinear transform, prewarped at the cut-off
    [rate 2] | k_1 | 2 * cos(pi / 8) | damping of the first section
    [rate 3] | k_2 | 2 * cos(3 * pi / 8) | damping of the second section
    [rate 4] | d | (theta_k - theta{k-1}) / h | difference, taken before the filter
    [rate 5] | tan(x) | x / (1 - x**2 / (3 - x**2 / 5)) | \
        prewarping: Lambert's continued fraction, eight levels of which three are shown
"""


def cutoff_range(device: DeviceData, cutoff: Quantity) -> tuple[float, float]:
    """Range in which the cut-off of a velocity filter may be tuned."""
    top = HIGHEST_SHARE / device.period_s
    if cutoff.value > top:
        raise UserError(
            f"{device.origin}: a velocity filter's cut-off {cutoff.value:g} Hz is above "
            f"{top:g} Hz, 0.4 of timing.sense_rate_Hz.",
            "Lower the cut-off in [joint] or raise the rate.",
        )
    return cutoff.value / TUNING_FACTOR, min(TUNING_FACTOR * cutoff.value, top)


def filter_delay_s(cutoff_Hz: float) -> float:
    """Delay of the filter at low frequency."""
    return sum(DAMPING) / (2 * math.pi * cutoff_Hz)


def tangent(x: Any) -> Any:
    """Tangent by Lambert's continued fraction, eight levels, for 0 <= x <= 0.4 pi."""
    square = x * x
    below: Any = 2 * LEVELS - 1
    for odd in range(2 * LEVELS - 3, 0, -2):
        below = odd - square / below
    return x / below


# While the input is invalid the rate is held; the sample after a gap stands for the held rate too,
# so that what was moved meanwhile makes no spike.
def butterworth_rate(device: DeviceData, name: str, cutoff: Quantity) -> Block:
    """Rate of a joint angle behind a Butterworth filter of fourth order (Zavalishin 2012)."""
    return Block.of(_Butterworth(device, name, cutoff))


class _Butterworth:
    def __init__(self, device: DeviceData, name: str, cutoff: Quantity) -> None:
        self.cutoff = cutoff
        self.drive = drive_of(device)
        self.h = device.period_s
        self.low, self.high = cutoff_range(device, cutoff)
        self.limit = self.drive.omega_rad_s
        # A twentieth of the range within a period is no motion, whatever the encoder's resolution.
        # A narrower clip would take counts away from the rate's integral, and would act on states
        # that the error analysis has to take as linear.
        low, high = self.angles = self.drive.theta_low_rad, self.drive.theta_high_rad
        self.reach = threshold(0.05 * (high - low) / self.h)
        self.room = STATE_ROOM * self.reach
        self.name = name
        self.title = "Angular rate: difference behind a fourth-order Butterworth filter"
        self.constants = device.constants("timing")
        self.equations = equations(EQUATIONS)
        self.coefficients = tuple(
            Port(f"gain_{i}", 0.0, 1.0, f"gains of section {i}", 3) for i in (1, 2)
        )
        text = "cut-off: higher follows faster and passes more noise"
        self.tunables = (self.cutoff.tunable("cutoff_Hz", self.low, self.high, text),)
        self.state = (
            Port.flag("primed", "1 when the last sample was valid"),
            Port("theta_last_rad", *self.angles, "angle, last step"),
            around("omega_held_rad_s", self.room, "filtered rate of the last step"),
            around("first_rad_s", self.room, "integrators of the first section", 2),
            around("second_rad_s", self.room, "integrators of the second section", 2),
        )
        self.inputs = (Port("theta_rad", *self.angles, "joint angle", on_invalid="theta_last_rad"),)
        fast = "the filtered rate was clipped at its physical range"
        jumped = "the angle jumped by more than a twentieth of its range; clipped"
        self.outputs = (
            around("omega_rad_s", self.limit, "filtered rate of the angle"),
            status_port(
                "status of this sample",
                "the angle was NaN or outside its range; the rate is held",
                "the state was corrupt; the filter was restarted",
                Flag("STEP_CLIPPED", jumped, True),
                Flag("RATE_CLIPPED", fast, True, ("omega_rad_s",), self.limit),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        g = tangent(math.pi * self.h * t.cutoff_Hz)
        out = {}
        for i, k in enumerate(DAMPING, 1):
            first = 1 / (1 + g * (g + k))
            out[f"gain_{i}"] = [first, g * first, g * g * first]
        return out

    def section(self, gain: ca.SX, state: ca.SX, value: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
        driven = value - state[1]
        band = gain[0] * state[0] + gain[1] * driven
        low_pass = state[1] + gain[1] * state[0] + gain[2] * driven
        return low_pass, [2 * band - state[0], 2 * low_pass - state[1]]

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        # After a gap, or at the start, there is no difference yet: the rate goes on as it was.
        difference = (u.theta_rad - s.theta_last_rad) * (1 / self.h)
        raw = ca.if_else(s.primed, difference, s.omega_held_rad_s)
        label("raw_rad_s", raw, "difference of the angle over the period")
        middle, first = self.section(c.gain_1, s.first_rad_s, clip(raw, -self.reach, self.reach))
        filtered, second = self.section(c.gain_2, s.second_rad_s, middle)
        ok = guard.inputs_ok
        held = ca.if_else(ok, filtered, s.omega_held_rad_s)
        held = label("held_rad_s", held, "filtered rate; held while the input is invalid")
        omega = clip(held, -self.limit, self.limit)
        next_state = {
            "primed": ok,
            "theta_last_rad": u.theta_rad,
            "omega_held_rad_s": held,
            "first_rad_s": [ca.if_else(ok, first[i], s.first_rad_s[i]) for i in range(2)],
            "second_rad_s": [ca.if_else(ok, second[i], s.second_rad_s[i]) for i in range(2)],
        }
        outputs = {
            "omega_rad_s": omega,
            "status": guard.status(
                ca.logic_and(ok, ca.fabs(raw) > self.reach), ca.fabs(held) > self.limit
            ),
        }
        return next_state, outputs


def motor_rate(device: DeviceData) -> Block:
    """Rate of the motor side, cut-off ``joint.motor_velocity_Hz``."""
    return butterworth_rate(device, "motor_rate", drive_of(device).joint.motor_velocity_Hz)


def load_rate(device: DeviceData) -> Block:
    return butterworth_rate(device, "load_rate", drive_of(device).joint.load_velocity_Hz)
