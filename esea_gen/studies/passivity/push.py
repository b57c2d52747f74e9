"""One run of a passive hand that is pushed while the controller renders a spring and damper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from esea_gen.analysis.passivity import Hand, energy_balance
from esea_gen.device import Device
from esea_gen.twin.case import IMPEDANCE, Case, Setting
from esea_gen.twin.controllers import controller_device, largest_torque_Nm
from esea_gen.twin.loop_run import ClosedLoopRun, RanAwayError
from esea_gen.twin.run import ON_S, run_case
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

GAIN_TUNABLES = ("Kp_Nm_rad", "Kd_Nms_rad")
PUSH_RAD_S = 0.5
PUSH_AT_S, PUSH_S, DURATION_S = 1.0, 0.1, 4.0
# A hand that nothing holds coasts for seconds from one of the gear's ripples to the next.  So what
# seems to grow runs again for longer: the last third, of 4 s, holds whole swings.
LONG_S = 13.0
WALL_RAD = 0.02  # how far a wall is ahead of the hand
# A motion counts from this share of the push's energy on (a fifth of its speed): encoder counts and
# backlash make smaller ones.  It grows when it gains a tenth in size, a fifth in energy.
NOTICE, GROWTH = 0.04, 1.21


@dataclass(frozen=True)
class PushRun:
    generated_J: float = 0.0
    absorbed_J: float = 0.0
    # Of hand, springs and wall: mean over the second second after the push and over the last third.
    held_J: float = 0.0
    held_end_J: float = 0.0
    moving_J: float = 0.0  # the same about its mean over the last third: 0 of a hand that rests
    limited_share: float = 0.0
    fault: float = 0.0
    tripped: float = 0.0
    ran_away: float = 0.0

    @property
    def stopped(self) -> bool:
        return self.fault > 0 or self.tripped > 0

    def swings_up(self, push_J: float) -> bool:
        """Whether the motion grows, or ends larger than the push made it."""
        grows = self.held_end_J > GROWTH * self.held_J and self.moving_J > NOTICE * push_J
        return bool(self.ran_away > 0 or grows or self.held_end_J > GROWTH * push_J)


def push_case(
    device: Device,
    hand: Hand,
    kp_Nm_rad: float,
    kd_Nms_rad: float,
    push_rad_s: float = PUSH_RAD_S,
    mode: int = IMPEDANCE,
    wall_Nm_rad: float = 0.0,
    duration_s: float = DURATION_S,
) -> Case:
    """A hand that is pushed once while the controller renders a spring and damper."""
    safety, joint = device.file.safety, device.file.joint
    assert safety is not None
    assert joint is not None
    n = round(duration_s * RATE_HZ)
    t, rest = np.arange(n) / RATE_HZ, np.zeros(n)
    # A quarter up the range of motion, or down it where a wall throws the hand back: what the push
    # moves stays clear of both ends.
    low, high = safety.rom_min_rad.value, safety.rom_max_rad.value
    place = low + (high - low) * (0.75 if wall_Nm_rad else 0.25)
    theta = np.full(n, place)
    # A hand on two axes has nothing of its own beside, all along the device's travel: what couples
    # it to the other axis would be active without a stiffness of its own.
    free = {
        "passive_Nm_rad": 0.0,
        "passive_cross_Nm_rad": 0.0,
        "damping_cross_Nms_rad": 0.0,
        "inertia_cross_kgm2": 0.0,
        "joint_min_rad": joint.theta_min_rad.value,
        "joint_max_rad": joint.theta_max_rad.value,
    }
    # The plant's end of travel, moved to the hand.
    wall = {
        "joint_max_rad": place + WALL_RAD,
        "joint_stop_Nm_rad": wall_Nm_rad,
        "joint_stop_Nms_rad": 0.0,
    }
    phase = np.pi * (t - PUSH_AT_S) / PUSH_S
    inside = (phase >= 0) & (phase < np.pi)
    # Half a sine; its sum over the samples is exactly what it is to give.
    shape = np.where(inside, np.sin(phase), 0.0)
    alpha = push_rad_s * RATE_HZ * shape / shape.sum()
    start = round((PUSH_AT_S + PUSH_S) * RATE_HZ)
    gains = dict(zip(GAIN_TUNABLES, (kp_Nm_rad, kd_Nms_rad), strict=True))
    return Case(
        f"{hand.name}: Kp {kp_Nm_rad:g}, Kd {kd_Nms_rad:g}",
        Trajectory("push", theta, rest, alpha, rest, start, n),
        mode,
        {"reference": gains} if mode == IMPEDANCE else {},
        {
            "Jh_kgm2": hand.inertia_kgm2,
            "own_damping_Nms_rad": hand.damping_Nms_rad,
            "spring_Nm_rad": hand.stiffness_Nm_rad,
            "damping_Nms_rad": 0.0,
            # The push: the inertia times the acceleration above.  The path itself never moves.
            "feedforward": 1.0,
            "gravity_Nm": 0.0,
            "torque_noise_Nm": 0.0,
        }
        | (free if len(device.axes) > 1 else {})
        | (wall if wall_Nm_rad else {}),
    )


def judge_push(
    run: ClosedLoopRun, hand: Hand, kp_Nm_rad: float, u_max_Nm: float, wall_Nm_rad: float = 0.0
) -> PushRun:
    theta, omega = run.plant["theta_l_rad"], run.plant["omega_l_rad_s"]
    # From the push on: before it, the torque's error of 10 mNm may move a soft hand by 4 mrad.
    pushed = slice(round(PUSH_AT_S * RATE_HZ), None)
    balance = energy_balance(theta[pushed], run.plant["tau_e_Nm"][pushed])
    spring = hand.stiffness_Nm_rad + kp_Nm_rad
    held = 0.5 * (hand.inertia_kgm2 * omega**2 + spring * (theta - theta[0]) ** 2)
    held += 0.5 * wall_Nm_rad * np.maximum(theta - theta[0] - WALL_RAD, 0) ** 2
    after = held[round((PUSH_AT_S + PUSH_S) * RATE_HZ) :]
    last = slice(-(len(after) // 3), None)
    moving = hand.inertia_kgm2 * omega[last] ** 2 + spring * (theta[last] - theta[last].mean()) ** 2
    second = round((DURATION_S - PUSH_AT_S - PUSH_S) * RATE_HZ) // 3
    on = slice(round(ON_S * RATE_HZ), None)
    faults = run.controller["fault"][on]
    latched = faults[faults > 0]
    return PushRun(
        balance.generated_J,
        float(balance.absorbed_J[-1]),
        float(np.mean(after[second : 2 * second])),
        float(np.mean(held[last])),
        0.5 * float(np.mean(moving)),
        float(np.mean(np.abs(run.controller["u_Nm"][on]) >= 0.999 * u_max_Nm)),
        float(latched[0]) if len(latched) else 0.0,
        float(np.max(run.plant["tripped"]) > 0),
    )


def run_push(
    kp_Nm_rad: float,
    kd_Nms_rad: float,
    hand: Mapping[str, Any],
    controller: str,
    plant: str,
    push_rad_s: float,
    seed: int,
    wall_Nm_rad: float = 0.0,
    axis: str = "",
) -> dict[str, float]:
    device = controller_device(controller)
    who = Hand(**hand)
    setting = Setting(controller, plant, "ideal", axis=axis)
    u_max_Nm, push_J = largest_torque_Nm(device), 0.5 * who.inertia_kgm2 * push_rad_s**2
    for duration_s in (DURATION_S, LONG_S):
        asked = push_rad_s, IMPEDANCE, wall_Nm_rad, duration_s
        try:
            run = run_case(push_case(device, who, kp_Nm_rad, kd_Nms_rad, *asked), setting, seed)
        except RanAwayError:
            return asdict(PushRun(ran_away=1.0))
        judged = judge_push(run, who, kp_Nm_rad, u_max_Nm, wall_Nm_rad)
        if judged.stopped or not judged.swings_up(push_J):
            break
    return asdict(judged)
