"""Exact inverse of a member of the elastomer family: desired torque in, deflection set-point out.

From any memory the torque rises with the present deflection, so that a bracket never loses the
set-point.  A fixed number of Newton steps is taken from the last one; a step that leaves the
bracket is replaced by its middle.  ``NOT_CONVERGED`` says when the steps did not suffice; the
next period goes on from there.  (Secant steps cost half as much and miss by 20 times as much
where the motion turns back, because the slope of a slip operator jumps there.)
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, Solved, StepResult
from esea_gen.language.ports import Flag, around, clip, status_port, threshold
from esea_gen.model.family import FittedMember, Start
from esea_gen.model.family_sensor import factor_in, family_step, temperature_parts, torque_limit
from esea_gen.model.forward import REQUEST_ROOM, request_port

# A twentieth of a millinewton-metre in 10 Nm, and far above float32 rounding.
RESIDUAL_SHARE = 5e-6
# Below this share of it a Newton step would only chase rounding.
AT_REST = 0.1
# With 8 a jump over the whole range leaves up to 0.04 Nm, with 5 some Nm.
STEPS = 12


class _FamilyInverse:
    def __init__(self, device: DeviceData, fitted: FittedMember, start: Start, steps: int) -> None:
        file = device.file
        self.model = family_step(device, fitted, start)
        self.steps, self.h = steps, device.period_s
        self.theta_lim = threshold(file.limits.theta_rad.value)
        self.tau_lim = torque_limit(device, fitted)
        self.omega_lim = threshold(2 * self.theta_lim / self.h)
        self.good = threshold(RESIDUAL_SHARE * self.tau_lim)
        self.far = threshold(2 * self.theta_lim)
        self.longest = threshold(2 * self.far)
        self.least = threshold(0.5 * fitted.least_slope_Nm_rad(self.far))
        self.domain = {
            "theta": threshold(file.domain.theta_max_rad.value),
            "omega": threshold(file.domain.omega_max_rad_s.value),
            "tau": threshold(file.domain.tau_full_scale_Nm.value),
        }
        self.name = "inverse"
        self.title = f"Exact inverse: {fitted.member.title}"
        self.state = self.model.state()
        self.inputs = (request_port(self.tau_lim),)
        self.solved = self._solved_by(fitted)
        # What algebra knows: the set-point is clipped, and no step is longer than the bracket.
        most = 1.001 * self.longest
        moves = {f"move_{k}_rad": (-most, most) for k in range(1, self.steps + 1)}
        self.facts = moves | {"set_point_rad": (-self.theta_lim, self.theta_lim)}
        room = 2 * REQUEST_ROOM * self.tau_lim
        d = self.domain
        theta = "|set-point| is outside the identified domain"
        rate = "|rate of the set-point| is outside the identified domain"
        short = "the request cannot be reached; the set-point stands at its limit"
        far = "|residual| is above its limit; the next period goes on from here"
        self.outputs = (
            around("theta_rad", self.theta_lim, "deflection set-point"),
            around("omega_mid_rad_s", self.omega_lim, "rate of the set-point over this step"),
            around("tau_model_Nm", self.tau_lim, "the model's torque at the set-point"),
            around("residual_Nm", room, "request minus the model's torque"),
            status_port(
                "status of this set-point",
                "an input was NaN or outside its range; the set-point is held",
                "the state was corrupt; the model was restarted",
                Flag("THETA_OUTSIDE", theta, False, ("theta_rad",), d["theta"]),
                Flag("RATE_OUTSIDE", rate, False, ("omega_mid_rad_s",), d["omega"]),
                Flag("TORQUE_OUTSIDE", "|request| is above full scale"),
                Flag("REQUEST_CLAMPED", short, True, ("theta_rad",), self.theta_lim),
                Flag("NOT_CONVERGED", far, True, ("residual_Nm",), self.good),
            ),
        )

    def at(
        self, s: Any, theta: Any, state_ok: ca.SX, factor: Any
    ) -> tuple[dict[str, Any], ca.SX, ca.SX]:
        """The model's next state, torque and slope at a deflection, from this step's memory."""
        guard = Guard(inputs_ok=ca.SX(1), state_ok=state_ok)
        state, sums, slope = self.model.torque_and_slope(s, theta, guard, Labels(), factor)
        return state, sums["spring"] + sums["rate"] + sums["hysteresis"], slope

    def solve(
        self, s: Any, wanted: ca.SX, last: ca.SX, state_ok: ca.SX, label: Labels, factor: Any
    ) -> ca.SX:
        # The bracket is wider than the limits: a request beyond them ends at a limit.
        low, high, theta = ca.SX(-self.far), ca.SX(self.far), last
        for k in range(1, self.steps + 1):
            _, value, rise = self.at(s, theta, state_ok, factor)
            missing = label(f"missing_{k}_Nm", wanted - value, f"request less torque, step {k}")
            # No step is longer than the bracket: one that is would be refused, and its range with
            # it would cost the others their last bits.
            floor = ca.fmax(self.least, ca.fabs(missing) * (1 / self.longest))
            rise = label(f"rise_{k}_Nm_rad", ca.fmax(rise, floor), "slope, of the springs at least")
            move = label(f"move_{k}_rad", missing / rise, "Newton's step")
            low = ca.if_else(missing > 0, theta, low)
            high = ca.if_else(missing > 0, high, theta)
            newton = theta + move
            # A step too small for the number format stays where it is.
            inside = ca.logic_and(newton >= low, newton <= high)
            safe = clip(ca.if_else(inside, newton, 0.5 * (low + high)), -self.far, self.far)
            done = ca.fabs(missing) <= threshold(AT_REST * self.good)
            theta = label(f"theta_{k}_rad", ca.if_else(done, theta, safe), "safeguarded step")
        return clip(theta, -self.theta_lim, self.theta_lim)

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        primed = label("ready", s.primed, "there is a last set-point")
        last = label("theta_from_rad", ca.if_else(primed, s.theta_prev_rad, 0), "theta(k-1)")
        wanted = label("request_Nm", clip(u.tau_Nm, -self.tau_lim, self.tau_lim), "clamped request")
        factor = factor_in(c)
        solved = self.solve(s, wanted, last, guard.state_ok, label, factor)
        theta = ca.if_else(guard.inputs_ok, solved, last)
        theta = label("set_point_rad", theta, "invalid input: hold")
        state, torque, _ = self.at(s, theta, guard.state_ok, factor)
        state["primed"] = ca.logic_or(primed, guard.inputs_ok)
        residual = label("residual_Nm", u.tau_Nm - torque, "request minus the model's torque")
        moved = label("moved_rad", ca.if_else(primed, theta - last, 0), "move of the set-point")
        omega = moved * (1 / self.h)
        at_limit = ca.fabs(theta) >= self.theta_lim
        clamped = ca.logic_or(ca.fabs(u.tau_Nm) > self.tau_lim, at_limit)
        missed = ca.logic_and(ca.fabs(residual) > self.good, ca.logic_not(clamped))
        status = guard.status(
            ca.fabs(theta) > self.domain["theta"],
            ca.fabs(omega) > self.domain["omega"],
            ca.fabs(u.tau_Nm) > self.domain["tau"],
            ca.logic_and(guard.inputs_ok, clamped),
            ca.logic_and(guard.inputs_ok, missed),
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

    def _solved_by(self, fitted: FittedMember) -> dict[str, Solved]:
        """A small residual means a set-point near the exact one, as the torque rises with it."""
        reach = self.theta_lim
        slope = min(fitted.least_slope_Nm_rad(reach), fitted.first_slope_Nm_rad(reach))
        if slope <= 0:
            return {}
        # What is missing is below the flag's threshold in exact arithmetic and in any other; so
        # the torque is off by no more than that twice, however stiff the rubber is.
        follows = {"omega_mid_rad_s": 1 / self.h, "tau_model_Nm": slope, "residual_Nm": slope}
        follows |= self.model.state_slopes()
        return {"set_point_rad": Solved("residual_Nm", 2 * self.good, slope, follows=follows)}


def family_inverse(
    device: DeviceData, fitted: FittedMember, start: Start = "virgin", steps: int = STEPS
) -> Block:
    return Block.of(
        _FamilyInverse(device, fitted, start, steps), **temperature_parts(device, fitted)
    )
