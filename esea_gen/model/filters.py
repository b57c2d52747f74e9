"""Velocity estimate: one Block, shared by all that need a rate."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, around, clip, status_port, threshold
from esea_gen.model.symbolic import equations

BANDWIDTH_MIN_HZ, BANDWIDTH_MAX_HZ = 2.0, 100.0
# The viscosity is steepest at rate zero: with the general aim q31's rate comes to rest 3e-5 rad/s
# off and its torque errs by 0.06 % of full scale, with this one by 0.02 %.
FINER = 25.0


def triple_pole_gains(bandwidth_Hz: Any, h: float) -> dict[str, Any]:
    """Gains of a third-order tracking observer whose errors have one pole, three times."""
    pole = ca.exp(-2 * math.pi * h * bandwidth_Hz)
    q = 1 - pole
    return {
        "alpha": 1 - pole * pole * pole,
        "beta_1_s": 1.5 * q * q * (1 + pole) / h,
        "gamma_1_s2": q * q * q / (h * h),
    }


def triple_pole_ports(h: float) -> tuple[Port, ...]:
    return (
        Port("alpha", 0.0, 1.0, "position gain"),
        Port("beta_1_s", 0.0, 3.0 / h, "velocity gain"),
        Port("gamma_1_s2", 0.0, 1.0 / h**2, "acceleration gain"),
    )


EQUATIONS = """
    [obs 1] | v_k | v + h * a + beta * e | rate
    [obs 2] | omega_m | v + h * a / 2 | rate in the middle of the step
    [obs 3] | beta | 3/2 * q**2 * (1 + p) / h | velocity gain
"""


# A constant acceleration leaves no steady error.  The rate for the middle of the coming step is
# from past samples only: the viscosity then holds nothing of theta(k), which keeps the sensor's
# inverse unique.
def tracking_observer(
    device: DeviceData, joint_rad: float | None = None, bandwidth_Hz: Quantity | None = None
) -> Block:
    """Third-order tracking observer (Kalata 1984) with a triple real pole."""
    return Block.of(_TrackingObserver(device, joint_rad, bandwidth_Hz))


class _TrackingObserver:
    def __init__(
        self, device: DeviceData, joint_rad: float | None, bandwidth_Hz: Quantity | None
    ) -> None:
        file = device.file
        self.h = device.period_s
        self.what = "deflection" if joint_rad is None else "joint angle"
        # As the ports hold them: a state clipped at a limit must pass its own guard in every
        # format.
        self.theta_lim = threshold(joint_rad or file.limits.theta_rad.value)
        self.omega_lim = threshold(file.limits.omega_rad_s.value)
        # A step of twice the deflection range moves the states by at most the gains times it;
        # clipping them at the rate's range (with room for the transient) also unwinds a corrupt
        # start.
        self.v_lim, self.a_lim = 4 * self.omega_lim, threshold(4 * self.omega_lim / self.h)
        self.bandwidth = bandwidth_Hz or file.velocity.bandwidth_Hz
        self.high = min(BANDWIDTH_MAX_HZ, 0.1 / self.h)
        self.name = "velocity" if joint_rad is None else "joint_rate"
        self.title = f"{self.what.capitalize()} rate: third-order tracking observer"
        self.constants = device.constants("timing")
        self.coefficients = triple_pole_ports(self.h)
        self.equations = equations(EQUATIONS)
        text = "bandwidth of the triple pole: higher follows faster and passes more noise"
        self.tunables = (self.bandwidth.tunable("bandwidth_Hz", BANDWIDTH_MIN_HZ, self.high, text),)
        self.state = (
            Port.flag("primed", "1 once a valid sample has been seen"),
            around("theta_hat_rad", 2 * self.theta_lim, f"estimated {self.what}"),
            around("v_rad_s", self.v_lim, "estimated rate"),
            around("a_rad_s2", self.a_lim, "estimated acceleration"),
        )
        text = "deflection: motor-side minus load-side angle"
        text = text if self.what == "deflection" else "angle of the joint"
        self.inputs = (around("theta_rad", self.theta_lim, text, on_invalid="theta_hat_rad"),)
        both = ("omega_rad_s", "omega_mid_rad_s")
        mid = f"{self.what} rate predicted for the middle of this step from past samples"
        clipped = "the estimate was clipped at the rate's physical range"
        self.outputs = (
            around(both[0], self.omega_lim, f"{self.what} rate at this sample"),
            around(both[1], self.omega_lim, mid, finer=FINER),
            status_port(
                "status of this sample",
                f"the {self.what} was NaN or outside its range; the last estimate is held",
                "the state was corrupt; the observer was restarted",
                Flag("RATE_CLIPPED", clipped, True, both, self.omega_lim),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return triple_pole_gains(t.bandwidth_Hz, self.h)

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        expected = s.theta_hat_rad + self.h * (s.v_rad_s + 0.5 * self.h * s.a_rad_s2)
        expected = ca.if_else(s.primed, expected, u.theta_rad)
        predicted = label("theta_predicted_rad", expected, "[1] prediction")
        error = label("innovation_rad", u.theta_rad - predicted, "[1] innovation")
        mid = s.v_rad_s + 0.5 * self.h * s.a_rad_s2
        v = label("rate_raw_rad_s", s.v_rad_s + self.h * s.a_rad_s2 + c.beta_1_s * error, "[obs 1]")
        theta_hat, a = predicted + c.alpha * error, s.a_rad_s2 + c.gamma_1_s2 * error
        clipped = ca.logic_or(ca.fabs(theta_hat) > 2 * self.theta_lim, ca.fabs(a) > self.a_lim)
        text = f"{self.what} or acceleration is clipped for the next step"
        label("memory_clipped", clipped, text)
        next_state = {
            "primed": ca.logic_or(s.primed, guard.inputs_ok),
            "theta_hat_rad": clip(theta_hat, -2 * self.theta_lim, 2 * self.theta_lim),
            "v_rad_s": clip(v, -self.v_lim, self.v_lim),
            "a_rad_s2": clip(a, -self.a_lim, self.a_lim),
        }
        limit = self.omega_lim
        outputs = {
            "omega_rad_s": clip(v, -limit, limit),
            "omega_mid_rad_s": clip(mid, -limit, limit),
            # A clip of the memory takes a rate beyond its range (test_clips).
            "status": guard.status(ca.logic_or(ca.fabs(v) > limit, ca.fabs(mid) > limit)),
        }
        return next_state, outputs
