"""Exact inverse of a member of the elastomer family: desired torque in, deflection set-point out.

From any memory the torque rises with the present deflection, with a slope of at least that of the
springs (:mod:`esea_gen.model.family`), so that one set-point gives the request, and a bracket that
holds it never loses it.  A fixed number of Newton steps is taken from the last set-point; one that
leaves the bracket is replaced by the bracket's middle.  What is left is computed and reported: the
flag ``NOT_CONVERGED`` says when a request jumped so far that the steps did not suffice, and the
next period goes on from there.  (Secant steps cost half as much and miss by 20 times as much where
the motion turns back, because the slope of a slip operator jumps there.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca

from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Flag, Port, around, clip, flag_word, threshold
from esea_gen.model.family import FittedMember, Start
from esea_gen.model.family_sensor import (
    factor_in,
    family_step,
    temperature_parts,
    torque_limit,
)
from esea_gen.model.forward import REQUEST_ROOM, request_port

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

# A twentieth of a millinewton-metre in 10 Nm, and far above float32 rounding.
RESIDUAL_SHARE = 5e-6
# Below this share of it a Newton step would only chase rounding.
AT_REST = 0.1
# With 8 a jump over the whole range leaves up to 0.04 Nm, with 5 some Nm (docs/identify.md).
STEPS = 12


class _FamilyInverse:
    """The equation of one step, its solution and the ports."""

    def __init__(self, device: DeviceData, fitted: FittedMember, start: Start, steps: int) -> None:
        file = device.file
        self.model = family_step(device, fitted, start, derived=True)
        self.steps, self.h = steps, device.period_s
        self.theta_lim = threshold(file.limits.theta_rad.value)
        self.tau_lim = torque_limit(device, fitted)
        self.omega_lim = threshold(2 * self.theta_lim / self.h)
        self.good = threshold(RESIDUAL_SHARE * self.tau_lim)
        self.least = threshold(0.5 * fitted.least_slope_Nm_rad(2 * self.theta_lim))
        self.domain = {
            "theta": threshold(file.domain.theta_max_rad.value),
            "omega": threshold(file.domain.omega_max_rad_s.value),
            "tau": threshold(file.domain.tau_full_scale_Nm.value),
        }

    def at(self, s: Any, theta: Any, state_ok: ca.SX, factor: Any) -> tuple[dict[str, Any], ca.SX]:
        """The model's next state and torque at a deflection, from this step's memory."""
        guard = Guard(inputs_ok=ca.SX(1), state_ok=state_ok)
        state, sums = self.model.torque(s, theta, guard, Labels(), factor)
        return state, sums["spring"] + sums["rate"] + sums["hysteresis"]

    def solve(
        self, s: Any, wanted: ca.SX, last: ca.SX, state_ok: ca.SX, label: Labels, factor: Any
    ) -> ca.SX:
        symbol = ca.SX.sym("theta")
        torque = self.at(s, symbol, state_ok, factor)[1]
        # The bracket is wider than the limits: a request beyond them ends at a limit.
        low, high, theta = ca.SX(-2 * self.theta_lim), ca.SX(2 * self.theta_lim), last
        slope = ca.jacobian(torque, symbol)
        for k in range(1, self.steps + 1):
            value, rise = ca.substitute([torque, slope], [symbol], [theta])
            missing = label(f"missing_{k}_Nm", wanted - value, f"request less torque, step {k}")
            text = "slope, of the springs at least"
            rise = label(f"rise_{k}_Nm_rad", ca.fmax(rise, self.least), text)
            low = ca.if_else(missing > 0, ca.fmax(low, theta), low)
            high = ca.if_else(missing > 0, high, ca.fmin(high, theta))
            newton = theta + missing / rise
            inside = ca.logic_and(newton > low, newton < high)
            safe = ca.if_else(inside, newton, 0.5 * (low + high))
            done = ca.fabs(missing) <= threshold(AT_REST * self.good)
            theta = label(f"theta_{k}_rad", ca.if_else(done, theta, safe), "safeguarded step")
        return clip(theta, -self.theta_lim, self.theta_lim)

    def step(
        self, c: Any, s: Any, u: Any, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        primed = label("ready", ca.logic_and(s.primed, guard.state_ok), "there is a last set-point")
        last = label("theta_from_rad", ca.if_else(primed, s.theta_prev_rad, 0), "theta(k-1)")
        wanted = label("request_Nm", clip(u.tau_Nm, -self.tau_lim, self.tau_lim), "clamped request")
        factor = factor_in(c)
        solved = self.solve(s, wanted, last, guard.state_ok, label, factor)
        theta = ca.if_else(guard.inputs_ok, solved, last)
        theta = label("set_point_rad", theta, "invalid input: hold")
        state, torque = self.at(s, theta, guard.state_ok, factor)
        state["primed"] = ca.logic_or(primed, guard.inputs_ok)
        residual = label("residual_Nm", u.tau_Nm - torque, "request less the model's torque")
        moved = label("moved_rad", ca.if_else(primed, theta - last, 0), "move of the set-point")
        omega = moved * (1 / self.h)
        at_limit = ca.fabs(theta) >= self.theta_lim
        clamped = ca.logic_or(ca.fabs(u.tau_Nm) > self.tau_lim, at_limit)
        missed = ca.logic_and(ca.fabs(residual) > self.good, ca.logic_not(clamped))
        status = flag_word(
            [
                ca.logic_not(guard.inputs_ok),
                ca.logic_not(guard.state_ok),
                ca.fabs(theta) > self.domain["theta"],
                ca.fabs(omega) > self.domain["omega"],
                ca.fabs(u.tau_Nm) > self.domain["tau"],
                ca.logic_and(guard.inputs_ok, clamped),
                ca.logic_and(guard.inputs_ok, missed),
            ]
        )
        room = 2 * REQUEST_ROOM * self.tau_lim
        outputs = {
            "theta_rad": theta,
            "omega_mid_rad_s": clip(omega, -self.omega_lim, self.omega_lim),
            "tau_model_Nm": clip(torque, -self.tau_lim, self.tau_lim),
            "residual_Nm": clip(residual, -room, room),
            "status": status,
        }
        return state, outputs

    def outputs(self) -> tuple[Port, ...]:
        room = 2 * REQUEST_ROOM * self.tau_lim
        d, held = self.domain, "an input was NaN or outside its range; the set-point is held"
        theta = "|set-point| is outside the identified domain"
        rate = "|rate of the set-point| is outside the identified domain"
        short = "the request cannot be reached; the set-point stands at its limit"
        far = "|residual| is above its limit; the next period goes on from here"
        flags = (
            Flag("INPUT_INVALID", held, True),
            Flag("STATE_REPAIRED", "the state was corrupt; the model was started afresh", True),
            Flag("THETA_OUTSIDE", theta, False, ("theta_rad",), d["theta"]),
            Flag("RATE_OUTSIDE", rate, False, ("omega_mid_rad_s",), d["omega"]),
            Flag("TORQUE_OUTSIDE", "|request| is above full scale"),
            Flag("REQUEST_CLAMPED", short, True, ("theta_rad",), self.theta_lim),
            Flag("NOT_CONVERGED", far, True, ("residual_Nm",), self.good),
        )
        return (
            around("theta_rad", self.theta_lim, "deflection set-point"),
            around("omega_mid_rad_s", self.omega_lim, "rate of the set-point over this step"),
            around("tau_model_Nm", self.tau_lim, "the model's torque at the set-point"),
            around("residual_Nm", room, "request less the model's torque"),
            Port("status", 0, 2 ** len(flags) - 1, "what is known of this set-point", flags=flags),
        )


def family_inverse(
    device: DeviceData, fitted: FittedMember, start: Start = "virgin", steps: int = STEPS
) -> Block:
    """The exact inverse of a fitted member as a Block.

    Parameters
    ----------
    device : DeviceData
        Domain, limits and rate.
    fitted : FittedMember
        The model; its slope must be above 0 (:attr:`FittedMember.least_slope_Nm_rad`).
    start : {"virgin", "conditioned"}
        As in :func:`esea_gen.model.family_sensor.family_sensor`.
    steps : int
        Newton steps a period.

    Returns
    -------
    Block
        Input ``tau_Nm``; outputs the set-point, its rate, the model's torque there, the residual
        and a status word.
    """
    inverse = _FamilyInverse(device, fitted, start, steps)
    return Block.define(
        "inverse",
        f"Exact inverse: {fitted.member.title}",
        period_s=device.period_s,
        state=inverse.model.state(),
        inputs=(request_port(inverse.tau_lim),),
        outputs=inverse.outputs(),
        step=inverse.step,
        **temperature_parts(device, fitted),
    )


__all__ = ["family_inverse"]
