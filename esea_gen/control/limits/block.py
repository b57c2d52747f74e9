"""Limits: the last Block before the motor, and the stamp that shows that control is alive.

Explained in ``docs/limits.md``; bounds are in ``docs/limit-checks.md``.  A command is clipped,
faded out towards the ends of the range and the largest speed, and rate-limited; any cause of
:class:`Fault` puts it to zero in the same step and latches; the latch opens only at ``mode`` 0,
with a new ``rearm``, the cause gone and the controller's own command at zero.

The latch is closed by default: at the start, of a corrupt state, of memory filled with zeros.  The
one ``key`` that means released differs from 0 in 16 bits.  ``fault``, ``rearm_last`` and
``u_last_Nm`` are stored twice, once as a complement, and must agree.  Coefficients are memory as
well: each is checked against its compiled range at every step.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal

import casadi as ca
import numpy as np

from esea_gen.control.limits.faults import FAULT_CODES, OPTIONAL, Doubt, Fault, Key, limit_status
from esea_gen.control.limits.latch import LAST_REARM, MIRROR, UNKNOWN, limit_step
from esea_gen.control.limits.safety import (
    SLOTS,
    STALE_PERIODS,
    LimitNumbers,
    command_range,
    safety_sections,
)
from esea_gen.control.limits.streams import STREAMS
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Constant, Port, Tunable, around, flag_word, status_port
from esea_gen.language.watch import CLOCK_OK, COEFFS_OK, LATE_LEVEL
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations

BEATS = 255  # the stamp counts 1 to 255; 0 is what a latch holds before anything was delivered
FADE, BRAKE = 0.8, 0.9  # shares of the largest speed: pushing on fades from the first to the second


# The stamp goes through the same latch release as the command and changes with every run.  A
# command that is NaN or none is replaced by 0 and stamped 0, which the limits take as never
# delivered.
def command_stamp(device: DeviceData, *, checked: bool = False) -> Block:
    """The last Block of the control task: stamps the command, so that a dead task shows."""
    _, _, _, every = safety_sections(device)
    reach = command_range(device)

    def step(_c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        beat = label("beat_next", ca.if_else(s.beats >= BEATS, 1.0, s.beats + 1), "1 to 255")
        sound = ca.logic_and(guard.inputs_ok, u.request_ok) if checked else guard.inputs_ok
        return {"beats": beat}, {
            "u_command_Nm": ca.if_else(sound, u.u_command_Nm, 0.0) if checked else u.u_command_Nm,
            "control_beat": ca.if_else(sound, beat, 0.0),
            "status": flag_word([ca.logic_not(sound), ca.logic_not(guard.state_ok)]),
        }

    return Block.define(
        "stamp",
        "Command stamp: shows the limits that the control task is alive",
        period_s=every * device.period_s,
        state=(Port.count("beats", BEATS, "last stamp"),),
        inputs=(
            around("u_command_Nm", reach, "the controller's motor torque"),
            *((Port.flag("request_ok", "1 while the request is valid"),) if checked else ()),
        ),
        outputs=(
            around("u_command_Nm", reach, "the controller's motor torque; 0 where it was invalid"),
            Port.count("control_beat", BEATS, "changes with every run; 0 with an invalid command"),
            status_port(
                "status of this command",
                "the command was NaN or outside its range; 0 is passed on",
                "the count was corrupt and restarts",
            ),
        ),
        step=step,
    )


def limits(device: DeviceData) -> Block:
    """The limits before the motor, with the fault latch; tunables only narrow ``[safety]``."""
    return Block.of(_Limits(device))


class _Limits:
    name = "limits"
    title = "Limits before the motor, with the fault latch"
    streams = STREAMS
    starts_latched = True

    def __init__(self, device: DeviceData) -> None:
        n = self.n = LimitNumbers(device)
        self.watched = device.file.monitor is not None
        self.warms = device.file.motor_thermal is not None
        self.h = n.h
        self.equations = equations(EQUATIONS)

        def derived(name: str, value: float, source: str) -> Constant:
            return Constant(name, value, source, "derived")

        self.constants = (
            *device.constants("safety"),
            derived("stale_ticks", n.stale_ticks, f"{STALE_PERIODS} control periods"),
            derived("slot_ticks", float(n.slot_ticks), f"1/{SLOTS} of energy_window_s, rounded up"),
            derived("fade", FADE, "share of the largest speed where pushing on begins to fade"),
            derived(
                "brake", BRAKE, "share of the largest speed above which only braking is let by"
            ),
        )
        self._gains(n)
        self._ports(n)

    def _gains(self, n: LimitNumbers) -> None:
        def narrowed(name: str, most: float, least_share: float, meaning: str) -> Tunable:
            q = getattr(n.safety, "energy_J" if name == "energy_max_J" else name)
            return Tunable(name, most, least_share * most, most, meaning, q.source, q.status, "low")

        def end(name: str, most: float, meaning: str, narrower: Literal["low", "high"]) -> Tunable:
            q = getattr(n.safety, name)
            return Tunable(name, most, n.rom_min, n.rom_max, meaning, q.source, q.status, narrower)

        softer, beyond = "of the command: lower is softer", "which nothing pushes further"
        self.tunables = (
            narrowed("u_max_Nm", n.u_max, 0.01, "largest |motor command|: lower is weaker"),
            narrowed("u_rate_Nm_s", n.u_rate, n.least_rate_share, f"fastest change {softer}"),
            narrowed("tau_max_Nm", n.tau_max, 0.05, "interaction torque that trips"),
            narrowed("theta_max_rad", n.theta_max, 0.05, "deflection that trips"),
            end("rom_min_rad", n.rom_min, f"joint angle below {beyond}: up narrows", "high"),
            end("rom_max_rad", n.rom_max, f"joint angle above {beyond}: down narrows", "low"),
            narrowed("omega_max_rad_s", n.omega_max, 0.05, "joint or drive speed that trips"),
            narrowed("energy_max_J", n.energy_max, 0.01, "energy within the window that trips"),
        )

        # What prepare computes is rounded differently in each format: a little room here, and after
        # the check (a clip before it would let NaN through) a clip at the compiled ends.
        room, least, most = 1e-5, 0.0099, 1.01
        slowest, fade = 0.05 * n.omega_max, BRAKE - FADE
        rom, speed = n.u_max / n.margin, n.u_max / (fade * n.omega_max)
        steep = most * n.u_max / (fade * slowest)
        only_brakes = 0.99 * BRAKE * slowest, most * BRAKE * n.omega_max
        self.coefficients = (
            *(t.port for t in self.tunables if t.name != "u_rate_Nm_s"),
            Port("u_step_Nm", least * n.step_max, most * n.step_max, "largest change in a period"),
            Port("trip_low_rad", n.trip_low - room, n.rom_max, "joint angle below which it trips"),
            Port(
                "trip_high_rad", n.rom_min, n.trip_high + room, "joint angle above which it trips"
            ),
            Port("rom_gain_Nm_rad", least * rom, most * rom, "slope of the fade"),
            Port("brake_rad_s", *only_brakes, "only braking above"),
            Port(
                "speed_gain_Nms_rad", least * speed, steep, "slope of the fade towards high speed"
            ),
        )

    def _ports(self, n: LimitNumbers) -> None:
        codes = FAULT_CODES if self.warms else FAULT_CODES[: -len(OPTIONAL)]
        last_code = float(codes[-1].value)
        self.state = (
            Port.choice("key", Key, "state of the latch; any other number is corrupt"),
            Port.choice("fault_stored", Fault, "reason of the latch", high=last_code, init=1.0),
            Port.count("fault_mirror", MIRROR, "255 minus it", low=MIRROR - last_code, init=254),
            Port.count("rearm_last", UNKNOWN, "last rearm request; 8: unknown", init=UNKNOWN),
            Port.count("rearm_mirror", MIRROR, "255 minus it", low=MIRROR - UNKNOWN, init=247),
            around("u_last_Nm", n.u_max, "last motor command"),
            around("u_mirror_Nm", n.u_max, "the last motor command, negated"),
            Port.count("beat_last", BEATS, "last stamp seen"),
            Port.count("age", n.stale_ticks, "periods since it changed", init=n.stale_ticks),
            Port.count("ticks", n.slot_ticks, "periods in the present slot"),
            Port("slot_J", 0.0, n.slot_lim, "energy given in the present slot"),
            Port(
                "slots_J", 0.0, n.slot_lim, "energy given in the slots before, newest first", SLOTS
            ),
        )
        delivered = "stamp of that command; 0 none delivered"
        left = "motor torque that the motor's temperature leaves; 0 latches"
        counted = "counter, increased by one for each request; 0 follows 7"
        motor_low, motor_high = n.load_low - n.theta_lim, n.load_high + n.theta_lim
        self.inputs = (
            around("u_command_Nm", n.command_lim, "command with stamp, at the motor shaft"),
            Port.count("control_beat", BEATS, delivered, on_invalid="beat_last"),
            Port.choice("mode", Mode, "active mode"),
            Port.flag("stop", "0: no stop; any other number stops", on_invalid=1.0),
            Port.count("rearm", LAST_REARM, counted, on_invalid="rearm_last"),
            Port.flag("request_ok", "1 while the request is valid"),
            Port.flag("sensing_ok", "1 while the measurements are valid"),
            around("theta_rad", n.theta_lim, "deflection of the coupling"),
            Port("theta_motor_rad", motor_low, motor_high, "motor side's joint angle"),
            around("omega_motor_rad_s", n.omega_motor_lim, "motor side's speed"),
            Port("theta_load_rad", n.load_low, n.load_high, "load side's joint angle"),
            around("omega_load_rad_s", n.omega_load_lim, "load side's speed"),
            around("tau_Nm", n.tau_lim, "interaction torque, + on the load"),
            CLOCK_OK,
            LATE_LEVEL,
            COEFFS_OK,
            *((Port.choice("doubt", Doubt, "suspected fault"),) if self.watched else ()),
            *((Port("u_thermal_Nm", 0.0, n.u_max, left),) if self.warms else ()),
        )
        most_J = float(np.float32(1.01 * (SLOTS + 1) * n.slot_lim))
        reason = "first reason of the latch, one of the FAULT numbers; 0 when released"
        self.outputs = (
            around("u_Nm", n.u_max, "motor torque, at the motor shaft"),
            around("u_cut_Nm", n.u_max, "reduction by the limits of motion and speed"),
            around("u_lag_Nm", 2 * n.u_max, "command minus output, because of the rate limit"),
            Port("energy_J", 0.0, most_J, "energy given to the limb within the window"),
            Port.choice("fault", Fault, reason, high=last_code, codes=codes),
            limit_status(n.energy_max),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        direct = {k: v for k, v in vars(t).items() if k != "u_rate_Nm_s"}
        return direct | {
            "u_step_Nm": t.u_rate_Nm_s * self.n.h,
            "trip_low_rad": t.rom_min_rad - self.n.margin,
            "trip_high_rad": t.rom_max_rad + self.n.margin,
            "rom_gain_Nm_rad": t.u_max_Nm / self.n.margin,
            "brake_rad_s": BRAKE * t.omega_max_rad_s,
            "speed_gain_Nms_rad": t.u_max_Nm / ((BRAKE - FADE) * t.omega_max_rad_s),
        }

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        u.doubt = u.doubt if self.watched else ca.SX(0)
        u.u_thermal_Nm = u.u_thermal_Nm if self.warms else None
        return limit_step(self.n, self.coefficients, c, s, u, guard, label)


EQUATIONS = """
    [lim 1] | u_+ | Min(U, Max(0, U * (b - theta_l) / m), Max(0, U * (9/10 * W - omega) / (W/10))) \
        | largest push towards larger angles
    [lim 2] | u_- | Min(U, Max(0, U * (theta_l - a) / m), Max(0, U * (9/10 * W + omega) / (W/10))) \
        | largest push towards smaller angles
    [lim 3] | E | sum(h * Max(0, tau * omega_l)) | \
        energy given to the limb, over the present slot and the ten before it
"""
