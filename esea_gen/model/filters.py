"""Velocity estimate: one Block, shared by all that need a rate."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import casadi as ca
import sympy as sp

from esea_gen.block import Block, Flag, Guard, Labels, Port, Tunable, clip, flag_word
from esea_gen.device import threshold
from esea_gen.model.symbolic import equation

if TYPE_CHECKING:
    from esea_gen.device import Device


def _status(omega_lim: float) -> tuple[Flag, ...]:
    held = "the deflection was NaN or outside its range; the last estimate is held"
    return (
        Flag("INPUT_INVALID", held, True),
        Flag("STATE_REPAIRED", "the state was corrupt; the observer was started afresh", True),
        Flag(
            "RATE_CLIPPED",
            "the estimate was clipped at the rate's physical range",
            True,
            ("omega_rad_s", "omega_mid_rad_s"),
            omega_lim,
        ),
    )


BANDWIDTH_MIN_HZ, BANDWIDTH_MAX_HZ = 2.0, 100.0


def tracking_observer(device: Device) -> Block:
    """Third-order tracking observer (alpha-beta-gamma filter) with a triple real pole.

    It follows position, velocity and acceleration, so that a constant acceleration leaves no
    steady error and the rate has no group delay at low frequency.  Besides the present rate it
    gives the rate predicted for the middle of the coming step, from past samples only: the
    viscosity then holds nothing of theta(k), which keeps the sensor's inverse unique.

    Parameters
    ----------
    device : Device
        Rate, limits, default bandwidth.

    Returns
    -------
    Block
        Input ``theta_rad``; outputs ``omega_rad_s``, ``omega_mid_rad_s`` and a status word.

    References
    ----------
    .. [1] P. R. Kalata, "The tracking index: a generalized parameter for alpha-beta and
       alpha-beta-gamma target trackers", IEEE Trans. AES 20(2), 1984 (the gains are the
       critically damped, fading-memory ones).
    """
    file = device.file
    h = device.period_s
    # As the ports hold them: a state clipped at a limit must pass its own guard in every format.
    theta_lim = threshold(file.limits.theta_rad.value)
    omega_lim = threshold(file.limits.omega_rad_s.value)
    # A step of twice the deflection range moves the states by at most the gains times it; clipping
    # them at the rate's range (with room for the transient) also unwinds a corrupt start.
    v_lim, a_lim = 4 * omega_lim, threshold(4 * omega_lim / h)
    bandwidth = file.velocity.bandwidth_Hz
    high = min(BANDWIDTH_MAX_HZ, 0.1 / h)

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        pole = ca.exp(-2 * math.pi * h * t.bandwidth_Hz)
        q = 1 - pole
        return {
            "alpha": 1 - pole * pole * pole,
            "beta_1_s": 1.5 * q * q * (1 + pole) / h,
            "gamma_1_s2": q * q * q / (h * h),
        }

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        predicted = label(
            "theta_predicted_rad",
            ca.if_else(
                s.primed, s.theta_hat_rad + h * (s.v_rad_s + 0.5 * h * s.a_rad_s2), u.theta_rad
            ),
            "[1] prediction",
        )
        error = label("innovation_rad", u.theta_rad - predicted, "[1] innovation")
        mid = s.v_rad_s + 0.5 * h * s.a_rad_s2
        v = s.v_rad_s + h * s.a_rad_s2 + c.beta_1_s * error
        next_state = {
            "primed": ca.logic_or(s.primed, guard.inputs_ok),
            "theta_hat_rad": clip(predicted + c.alpha * error, -2 * theta_lim, 2 * theta_lim),
            "v_rad_s": clip(v, -v_lim, v_lim),
            "a_rad_s2": clip(s.a_rad_s2 + c.gamma_1_s2 * error, -a_lim, a_lim),
        }
        limit = omega_lim
        outputs = {
            "omega_rad_s": clip(v, -limit, limit),
            "omega_mid_rad_s": clip(mid, -limit, limit),
            "status": flag_word(
                [
                    ca.logic_not(guard.inputs_ok),
                    ca.logic_not(guard.state_ok),
                    ca.logic_or(ca.fabs(v) > limit, ca.fabs(mid) > limit),
                ]
            ),
        }
        return next_state, outputs

    p, q, hs, e, v, a = sp.symbols("p q h e v a")
    return Block.define(
        "velocity",
        "Deflection rate: third-order tracking observer",
        period_s=h,
        constants=device.constants("timing"),
        tunables=(
            Tunable(
                "bandwidth_Hz",
                bandwidth.value,
                BANDWIDTH_MIN_HZ,
                high,
                "bandwidth of the triple pole: higher follows faster and passes more noise",
                bandwidth.source,
                bandwidth.status,
            ),
        ),
        coefficients=(
            Port("alpha", 0.0, 1.0, "position gain"),
            Port("beta_1_s", 0.0, 3.0 / h, "velocity gain"),
            Port("gamma_1_s2", 0.0, 1.0 / h**2, "acceleration gain"),
        ),
        prepare=prepare,
        state=(
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
            Port("theta_hat_rad", -2 * theta_lim, 2 * theta_lim, "estimated deflection"),
            Port("v_rad_s", -v_lim, v_lim, "estimated rate"),
            Port("a_rad_s2", -a_lim, a_lim, "estimated acceleration"),
        ),
        inputs=(
            Port(
                "theta_rad",
                -theta_lim,
                theta_lim,
                "deflection: motor-side minus load-side angle",
                on_invalid="theta_hat_rad",
            ),
        ),
        outputs=(
            Port("omega_rad_s", -omega_lim, omega_lim, "deflection rate at this sample"),
            Port(
                "omega_mid_rad_s",
                -omega_lim,
                omega_lim,
                "deflection rate predicted for the middle of this step from past samples",
            ),
            Port("status", 0, 7, "what is known of this sample", flags=_status(omega_lim)),
        ),
        equations=(
            equation("[obs 1]", "v_k", v + hs * a + sp.Symbol("beta") * e, "rate"),
            equation("[obs 2]", "omega_m", v + hs * a / 2, "rate in the middle of the step"),
            equation("[obs 3]", "beta", sp.Rational(3, 2) * q**2 * (1 + p) / hs, "velocity gain"),
        ),
        step=step,
    )
