"""Limits: the last Block before the motor, and the stamp that shows that control is alive.

Nothing reaches the motor that has not passed here.  The semantics are stated, limit by limit and
with their detection bounds, in ``docs/limits.md``.  In short: a command is clipped, faded out
towards the ends of the range of motion and towards the largest speed, and rate-limited; any cause
of :class:`Fault` puts the motor command to zero in the same step and latches; the latch opens only
at ``mode`` 0, with a new ``rearm``, the cause gone and the controller's own command at zero.

How the latch resists a corrupt memory, and why:

* It is closed by default.  The Block starts latched, and what the guard puts in place of a corrupt
  state is that start.  Memory filled with zeros is latched too.
* The one value of ``key`` that means released differs from 0, the value of latched, in 16 bits, as
  float32 and as float64; every other value is corrupt.
* ``fault``, ``rearm_last`` and ``u_last_Nm`` are stored twice, once negated, and must agree: one
  flipped bit cannot make up an edge of ``rearm``, another reason or an old set-point.
* Coefficients are read from memory as well: each is held against its compiled range at every step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import IntEnum
from functools import reduce
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.control.limits_streams import STREAMS
from esea_gen.control.reference import IMPEDANCE, OFF, TORQUE
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import (
    Constant,
    Flag,
    Port,
    Tunable,
    clip,
    f32_inside,
    flag_word,
    in_range,
    threshold,
)
from esea_gen.model.symbolic import equation

if TYPE_CHECKING:
    from esea_gen.devices.fields import Actuator, Joint, Safety
    from esea_gen.devices.file import DeviceData

RELEASED_KEY = 5592405.5  # 16 bits set as float32 (0x4AAAAAAB) and as float64; latched is 0
UNKNOWN = -1.0  # rearm_last before a request was seen: the first one is no edge
MODES = (OFF, TORQUE, IMPEDANCE)
REARMS = tuple(range(8))  # rearm counts in these and wraps
BEATS = 255  # the stamp counts 1 to 255; 0 is what a latch holds before anything was delivered
SLOTS = 10  # parts of the energy window
STALE_PERIODS = 2  # control periods without a new stamp that count as a fault
COMMAND_RANGE = 4.0  # times the motor's largest torque: beyond is no command but a fault
FADE, BRAKE = 0.8, 0.9  # shares of the largest speed: pushing on fades from the first to the second


class Fault(IntEnum):
    """Reason of the latch; where several causes meet in one step, the smallest number is kept."""

    NONE = 0
    NOT_ARMED = 1
    STATE_CORRUPT = 2
    TUNABLE_INVALID = 3
    STOP = 4
    INPUT_INVALID = 5
    SENSING = 6
    CONTROL_STALE = 7
    DEFLECTION = 8
    TORQUE = 9
    SPEED = 10
    RANGE_OF_MOTION = 11
    ENERGY = 12


FAULT_TEXT = {
    Fault.NONE: "released",
    Fault.NOT_ARMED: "not armed since power-up or reset",
    Fault.STATE_CORRUPT: "the memory of the limits was corrupt",
    Fault.TUNABLE_INVALID: "a limit was not within its compiled bounds, or the range of motion "
    "was turned round",
    Fault.STOP: "stop was requested",
    Fault.INPUT_INVALID: "an input was NaN, outside its physical range or not a whole number, or "
    "what was wanted was",
    Fault.SENSING: "the sensing task could not vouch for its measurements",
    Fault.CONTROL_STALE: "the control task delivered no new command",
    Fault.DEFLECTION: "the coupling was deflected too far",
    Fault.TORQUE: "the interaction torque was too large",
    Fault.SPEED: "joint or drive were too fast",
    Fault.RANGE_OF_MOTION: "the joint was beyond its range of motion and the margin",
    Fault.ENERGY: "too much energy was given to the limb within the window",
}


def _flags(energy_max: float) -> tuple[Flag, ...]:
    return (
        Flag("INPUT_INVALID", FAULT_TEXT[Fault.INPUT_INVALID], True),
        Flag("STATE_REPAIRED", "the state was corrupt; the latch was closed afresh", True),
        Flag("TUNABLE_INVALID", FAULT_TEXT[Fault.TUNABLE_INVALID]),
        Flag("STOPPED", "stop is requested now"),
        Flag("SENSING_LOST", FAULT_TEXT[Fault.SENSING], True),
        Flag("CONTROL_STALE", "the control task has delivered no new command for too long"),
        Flag("DEFLECTION", "the deflection is beyond its limit"),
        Flag("INTERACTION_TORQUE", "the interaction torque is beyond its limit"),
        Flag("SPEED", "joint or drive are faster than their limit"),
        Flag("RANGE_OF_MOTION", "the joint is beyond its range of motion and the margin"),
        Flag(
            "ENERGY",
            "the energy given to the limb within the window is beyond its limit",
            False,
            ("energy_J",),
            energy_max,
        ),
        Flag("TORQUE_CLIPPED", "the command was clipped at the largest motor torque", True),
        Flag("RATE_LIMITED", "the command changed faster than allowed", True, ("u_lag_Nm",)),
        Flag("ROM_LOW", "pushing towards the lower end was held back", True, ("u_cut_Nm",)),
        Flag("ROM_HIGH", "pushing towards the upper end was held back", True, ("u_cut_Nm",)),
        Flag("SPEED_LIMITED", "pushing on at high speed was held back", True, ("u_cut_Nm",)),
        Flag("REARM_REFUSED", "a rearm request came, but not all its conditions were met", True),
        Flag("FAULT_LATCHED", "the motor command is held at zero; fault tells the first reason"),
    )


def _any(conditions: Iterable[ca.SX]) -> ca.SX:
    return reduce(ca.logic_or, conditions)


def _all(conditions: Iterable[ca.SX]) -> ca.SX:
    return reduce(ca.logic_and, conditions)


def _one_of(x: ca.SX, values: Iterable[float]) -> ca.SX:
    return _any([x == k for k in values])


def _sections(device: DeviceData) -> tuple[Safety, Actuator, Joint, int]:
    # The sections that the limits need, and the control task's period in sensing periods.
    file = device.file
    rate = file.timing.control_rate_Hz
    for name in ("safety", "actuator", "joint", "timing.control_rate_Hz"):
        if reduce(getattr, name.split("."), file) is None:
            raise UserError(
                f"{device.origin}: {name} is missing: the limits before the motor need it.",
                'Add it, or write extends = "elbow_drive" and give what differs.',
            )
    assert file.safety is not None
    assert file.actuator is not None
    assert file.joint is not None
    assert rate is not None
    every = round(file.timing.sense_rate_Hz.value / rate.value)
    return file.safety, file.actuator, file.joint, every


def _check(device: DeviceData) -> None:
    # A limit beyond its port's range would show as an invalid input: the wrong reason.
    value = {k: q.value for k, q in device.quantities()}
    margin = value["safety.rom_margin_rad"]
    for low, less, high, more in (
        ("safety.rom_min_rad", 0.0, "safety.rom_max_rad", 0.0),
        ("joint.theta_min_rad", 0.0, "safety.rom_min_rad", -margin),
        ("safety.rom_max_rad", margin, "joint.theta_max_rad", 0.0),
        ("safety.omega_max_rad_s", 0.0, "joint.omega_max_rad_s", 0.0),
        ("safety.omega_max_rad_s", 0.0, "actuator.omega_max_rad_s", 0.0),
    ):
        if value[low] + less >= value[high] + more:
            room = f" with safety.rom_margin_rad = {margin:g}" if less or more else ""
            raise UserError(
                f"{device.origin}: {low} = {value[low]:g} is not below {high} = "
                f"{value[high]:g}{room}: the limit would never act as what it is.",
                f"Lower {low} or raise {high}{', or narrow the margin' if room else ''}.",
            )


def _command_range(device: DeviceData) -> float:
    safety, actuator, _, _ = _sections(device)
    return threshold(COMMAND_RANGE * max(safety.u_max_Nm.value, actuator.u_max_Nm.value))


def command_stamp(device: DeviceData, *, checked: bool = False) -> Block:
    """The last Block of the control task: stamps the command, so that a dead task shows.

    The stamp goes through the same latch release as the command and changes with every run.  A
    command that is NaN or no command is replaced by 0 and stamped 0, which the limits take as
    never delivered.

    Parameters
    ----------
    device : DeviceData
        Needs ``[safety]``, ``[actuator]``, ``[joint]`` and ``timing.control_rate_Hz``.
    checked : bool
        Whether an input ``request_ok`` says that what the control task itself was asked for is
        sound: anything but 1 is stamped 0 as well.

    Returns
    -------
    Block
        Input ``u_command_Nm``; outputs ``u_command_Nm`` and ``control_beat`` (1 to 255, then 1
        again) for :func:`limits`, and a status word.

    Raises
    ------
    UserError
        When a section is missing.
    """
    _, _, _, every = _sections(device)
    reach = _command_range(device)

    def step(
        _c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        beat = label("beat_next", ca.if_else(s.beats >= BEATS, 1.0, s.beats + 1), "1 to 255")
        sound = ca.logic_and(guard.inputs_ok, u.request_ok == 1) if checked else guard.inputs_ok
        bad = [ca.logic_not(sound), ca.logic_not(guard.state_ok)]
        return {"beats": beat}, {
            "u_command_Nm": ca.if_else(sound, u.u_command_Nm, 0.0) if checked else u.u_command_Nm,
            "control_beat": ca.if_else(sound, beat, 0.0),
            "status": flag_word(bad),
        }

    flags = (
        Flag("INPUT_INVALID", "the command was NaN or outside its range; 0 is passed on", True),
        Flag("STATE_REPAIRED", "the count was corrupt; it starts again", True),
    )
    return Block.define(
        "stamp",
        "Command stamp: shows the limits that the control task is alive",
        period_s=every * device.period_s,
        state=(Port("beats", 0, BEATS, "last stamp"),),
        inputs=(
            Port("u_command_Nm", -reach, reach, "the controller's motor torque"),
            *((Port("request_ok", 0, 1, "1 while what is wanted is sound"),) if checked else ()),
        ),
        outputs=(
            Port("u_command_Nm", -reach, reach, "the same, 0 where it was invalid"),
            Port("control_beat", 0, BEATS, "changes with every run; 0 with an invalid command"),
            Port("status", 0, 3, "what is known of this command", flags=flags),
        ),
        step=step,
    )


def limits(device: DeviceData) -> Block:
    r"""The limits before the motor, with the fault latch.

    Every maximum of ``[safety]`` is compiled in; the tunables of the same names only narrow it.
    Positive motor torque turns the joint towards larger angles.

    Parameters
    ----------
    device : DeviceData
        Needs ``[safety]``, ``[actuator]``, ``[joint]`` and ``timing.control_rate_Hz``.

    Returns
    -------
    Block
        Inputs: the stamped command, ``mode``, ``stop``, ``rearm``, ``request_ok``, ``sensing_ok``,
        angles, speeds and torque.  Outputs: ``u_Nm`` for the motor, ``u_cut_Nm`` and ``u_lag_Nm``
        (what was taken from the command), ``energy_J``, ``fault`` (a :class:`Fault`) and a status
        word.

    Raises
    ------
    UserError
        When a section is missing, or a limit lies outside the range of the port that it watches.

    Notes
    -----
    With the joint angle :math:`\theta_l`, the larger of both speeds :math:`\omega`, largest
    torque U, upper end b, margin m and largest speed W, a push towards larger angles is at most

    .. math:: \min(U, \max(0, U (b - \theta_l)/m), \max(0, U (0.9 W - \omega)/(0.1 W)))

    and likewise towards smaller ones.  Energy counts in slots of a tenth of the window T,
    :math:`E = h \sum \max(0, \tau\,\omega_l)` over the present slot and the ten before it:
    everything given within the last T is in it, and nothing older than eleven slots.
    """
    safety, actuator, joint, every = _sections(device)
    _check(device)
    h = device.period_s

    # As the ports hold them: float32 numbers, so that all formats decide alike.
    u_max, tau_max, theta_max, omega_max, energy_max, margin = (
        threshold(x.value)
        for x in (
            safety.u_max_Nm,
            safety.tau_max_Nm,
            safety.theta_max_rad,
            safety.omega_max_rad_s,
            safety.energy_J,
            safety.rom_margin_rad,
        )
    )
    u_rate = threshold(safety.u_rate_Nm_s.value)
    step_max = threshold(u_rate * h)
    rom_min, rom_max = f32_inside(safety.rom_min_rad.value, safety.rom_max_rad.value)
    trip_low, trip_high = f32_inside(rom_min - margin, rom_max + margin)
    theta_lim = threshold(device.file.limits.theta_rad.value)
    tau_lim = threshold(device.file.limits.tau_Nm.value)
    load_low, load_high = joint.theta_min_rad.value, joint.theta_max_rad.value
    omega_load_lim, omega_motor_lim = joint.omega_max_rad_s.value, actuator.omega_max_rad_s.value
    command_lim = _command_range(device)
    stale_ticks = float(STALE_PERIODS * every)
    slot_ticks = max(1, math.ceil(safety.energy_window_s.value / (SLOTS * h) - 1e-9))
    slot_lim = threshold(1.01 * slot_ticks * h * tau_lim * omega_load_lim)

    def narrowed(name: str, most: float, least_share: float, meaning: str) -> Tunable:
        q = getattr(safety, "energy_J" if name == "energy_max_J" else name)
        return Tunable(name, most, least_share * most, most, meaning, q.source, q.status)

    def end(name: str, most: float, meaning: str) -> Tunable:
        q = getattr(safety, name)
        return Tunable(name, most, rom_min, rom_max, meaning, q.source, q.status)

    tunables = (
        narrowed("u_max_Nm", u_max, 0.01, "largest |motor command|: lower is weaker"),
        narrowed("u_rate_Nm_s", u_rate, 0.01, "fastest change of the command: lower is softer"),
        narrowed("tau_max_Nm", tau_max, 0.05, "interaction torque that trips"),
        narrowed("theta_max_rad", theta_max, 0.05, "deflection that trips"),
        end("rom_min_rad", rom_min, "joint angle below which nothing pushes further: up narrows"),
        end("rom_max_rad", rom_max, "joint angle above which nothing pushes further: down narrows"),
        narrowed("omega_max_rad_s", omega_max, 0.05, "joint or drive speed that trips"),
        narrowed("energy_max_J", energy_max, 0.01, "energy within the window that trips"),
    )
    slowest = 0.05 * omega_max
    # What prepare computes is rounded differently in each format: a little room here, and after
    # the check (a clip before it would let NaN through) a clip at the compiled ends.
    room = 1e-5
    coefficients = (
        *(Port(t.name, t.low, t.high, t.meaning) for t in tunables if t.name != "u_rate_Nm_s"),
        Port("u_step_Nm", 0.0099 * step_max, 1.01 * step_max, "largest change in a period"),
        Port("trip_low_rad", trip_low - room, rom_max, "joint angle below which it trips"),
        Port("trip_high_rad", rom_min, trip_high + room, "joint angle above which it trips"),
        Port(
            "rom_gain_Nm_rad", 0.0099 * u_max / margin, 1.01 * u_max / margin, "slope of the fade"
        ),
        Port("brake_rad_s", 0.99 * BRAKE * slowest, 1.01 * BRAKE * omega_max, "only braking above"),
        Port(
            "speed_gain_Nms_rad",
            0.0099 * u_max / ((BRAKE - FADE) * omega_max),
            1.01 * u_max / ((BRAKE - FADE) * slowest),
            "slope of the fade towards high speed",
        ),
    )

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        direct = {k: v for k, v in vars(t).items() if k != "u_rate_Nm_s"}
        return direct | {
            "u_step_Nm": t.u_rate_Nm_s * h,
            "trip_low_rad": t.rom_min_rad - margin,
            "trip_high_rad": t.rom_max_rad + margin,
            "rom_gain_Nm_rad": t.u_max_Nm / margin,
            "brake_rad_s": BRAKE * t.omega_max_rad_s,
            "speed_gain_Nms_rad": t.u_max_Nm / ((BRAKE - FADE) * t.omega_max_rad_s),
        }

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        # -- whom to believe ----------------------------------------------------------------------
        released = s.key == RELEASED_KEY
        closed = s.key == 0
        trusted = label(
            "trusted",
            _all(
                [
                    guard.state_ok,
                    s.fault_stored + s.fault_mirror == 0,
                    s.rearm_last + s.rearm_mirror == 0,
                    s.u_last_Nm + s.u_mirror_Nm == 0,
                    ca.logic_or(
                        ca.logic_and(released, s.fault_stored == 0),
                        ca.logic_and(closed, ca.logic_and(s.fault_stored >= 1, s.u_last_Nm == 0)),
                    ),
                ]
            ),
            "1 when no part of the memory contradicts another",
        )
        was_released = label("was_released", ca.logic_and(trusted, released))
        rearm_whole = _one_of(u.rearm, REARMS)
        inputs_ok = label(
            "inputs_valid",
            _all([guard.inputs_ok, _one_of(u.mode, MODES), rearm_whole, u.request_ok == 1]),
            "and whole, and what is wanted is",
        )
        tunables_ok = label(
            "tunables_valid",
            _all(
                [in_range(getattr(c, p.name), p.low, p.high) for p in coefficients]
                + [c.rom_min_rad < c.rom_max_rad]
            ),
            "no limit is wider than compiled in",
        )

        u_step = ca.fmin(c.u_step_Nm, step_max)
        lowest, highest = ca.fmax(c.trip_low_rad, trip_low), ca.fmin(c.trip_high_rad, trip_high)

        # -- causes -------------------------------------------------------------------------------
        stop = ca.logic_not(u.stop == 0)
        delivered = ca.logic_and(u.control_beat >= 1, ca.logic_not(u.control_beat == s.beat_last))
        age = label(
            "age_ticks",
            ca.if_else(
                u.control_beat >= 1,
                ca.if_else(delivered, 0.0, ca.fmin(s.age + 1, stale_ticks)),
                stale_ticks,
            ),
            "periods since the control task delivered",
        )
        given = label(
            "given_J", h * ca.fmax(u.tau_Nm * u.omega_load_rad_s, 0), "[lim 3] in this period"
        )
        slots = ca.vertsplit(s.slots_J)
        slot = ca.fmin(s.slot_J + given, slot_lim)
        energy = slot
        for part in slots:
            energy = energy + ca.fabs(part)  # a flipped sign gives no credit
        label("window_J", energy, "[lim 3] present slot and the ten before it")
        full = s.ticks >= slot_ticks - 1
        apart = u.theta_motor_rad - u.theta_load_rad
        speed = ca.fmax(ca.fabs(u.omega_load_rad_s), ca.fabs(u.omega_motor_rad_s))

        def measured(*beyond: ca.SX) -> ca.SX:
            # What stands in for an invalid input must not raise a flag of its own.
            return ca.logic_and(guard.inputs_ok, _any(beyond))

        causes = {
            Fault.STATE_CORRUPT: ca.logic_not(trusted),
            Fault.TUNABLE_INVALID: ca.logic_not(tunables_ok),
            Fault.STOP: stop,
            Fault.INPUT_INVALID: ca.logic_not(inputs_ok),
            Fault.SENSING: ca.logic_not(u.sensing_ok == 1),
            Fault.CONTROL_STALE: age >= stale_ticks,
            Fault.DEFLECTION: measured(
                ca.fabs(u.theta_rad) > c.theta_max_rad, ca.fabs(apart) > c.theta_max_rad
            ),
            Fault.TORQUE: measured(ca.fabs(u.tau_Nm) > c.tau_max_Nm),
            Fault.SPEED: measured(speed > c.omega_max_rad_s),
            Fault.RANGE_OF_MOTION: measured(u.theta_load_rad > highest, u.theta_load_rad < lowest),
            Fault.ENERGY: energy > c.energy_max_J,
        }
        cause = label("cause", _any(causes.values()), "anything that forbids a motor command")
        reason: Any = 0.0
        for code, found in reversed(causes.items()):
            reason = ca.if_else(found, float(code), reason)

        # -- the latch ----------------------------------------------------------------------------
        known = ca.logic_and(trusted, s.rearm_last >= 0)
        following = ca.if_else(s.rearm_last >= REARMS[-1], 0.0, s.rearm_last + 1)
        request = label("rearm_edge", ca.logic_and(known, u.rearm == following), "one more")
        changed = _all([known, rearm_whole, ca.logic_not(u.rearm == s.rearm_last)])
        release = label(
            "release",
            _all([request, closed, ca.logic_not(cause), u.mode == OFF, u.u_command_Nm == 0]),
            "off, asked for, no cause left, and the controller itself has let go",
        )
        run = label("run", ca.logic_and(ca.logic_not(cause), ca.logic_or(was_released, release)))
        kept = ca.logic_and(trusted, closed)
        fault = label(
            "fault_next",
            ca.if_else(run, 0.0, ca.if_else(kept, s.fault_stored, reason)),
            "the first reason stays",
        )
        # What a corrupt memory says of the last request is no ground for an edge.
        rearm = ca.if_else(trusted, ca.if_else(rearm_whole, u.rearm, s.rearm_last), UNKNOWN)

        # -- the command --------------------------------------------------------------------------
        on = ca.logic_not(u.mode == OFF)
        wanted = ca.if_else(on, u.u_command_Nm, 0.0)
        clipped = label("u_clipped_Nm", clip(wanted, -c.u_max_Nm, c.u_max_Nm), "torque")
        fastest_up = ca.fmax(u.omega_load_rad_s, u.omega_motor_rad_s)
        fastest_down = ca.fmin(u.omega_load_rad_s, u.omega_motor_rad_s)
        rom_up = ca.fmax(c.rom_gain_Nm_rad * (c.rom_max_rad - u.theta_load_rad), 0)
        rom_down = ca.fmax(c.rom_gain_Nm_rad * (u.theta_load_rad - c.rom_min_rad), 0)
        speed_up = ca.fmax(c.speed_gain_Nms_rad * (c.brake_rad_s - fastest_up), 0)
        speed_down = ca.fmax(c.speed_gain_Nms_rad * (c.brake_rad_s + fastest_down), 0)
        up = label("most_up_Nm", ca.fmin(rom_up, speed_up), "[lim 1] push towards larger angles")
        down = label("most_down_Nm", ca.fmin(rom_down, speed_down), "[lim 2] towards smaller ones")
        shaped = label("u_shaped_Nm", clip(clipped, -down, up), "range of motion and speed")
        followed = label(
            "u_followed_Nm", clip(shaped, s.u_last_Nm - u_step, s.u_last_Nm + u_step), "rate"
        )
        u_out = ca.if_else(run, followed, 0.0)
        acts = ca.logic_and(run, on)
        bits = [causes[Fault.INPUT_INVALID], causes[Fault.STATE_CORRUPT]]
        bits += [causes[Fault(k)] for k in (3, 4, 6, 7, 8, 9, 10, 11, 12)]
        bits += [
            ca.logic_and(acts, ca.fabs(u.u_command_Nm) > c.u_max_Nm),
            ca.logic_and(run, ca.logic_not(followed == shaped)),
            ca.logic_and(acts, clipped < -rom_down),
            ca.logic_and(acts, clipped > rom_up),
            ca.logic_and(acts, ca.logic_or(clipped < -speed_down, clipped > speed_up)),
            ca.logic_and(changed, ca.logic_and(closed, ca.logic_not(release))),
            ca.logic_not(run),
        ]
        next_state = {
            "key": ca.if_else(run, RELEASED_KEY, 0.0),
            "fault_stored": fault,
            "fault_mirror": -fault,
            "rearm_last": rearm,
            "rearm_mirror": -rearm,
            "u_last_Nm": u_out,
            "u_mirror_Nm": -u_out,
            "beat_last": u.control_beat,
            "age": age,
            "ticks": ca.if_else(full, 0.0, s.ticks + 1),
            "slot_J": ca.if_else(full, 0.0, slot),
            "slots_J": [
                ca.if_else(full, new, old) for new, old in zip([slot, *slots], slots, strict=False)
            ],
        }
        outputs = {
            "u_Nm": u_out,
            "u_cut_Nm": ca.if_else(run, clipped - shaped, 0.0),
            "u_lag_Nm": ca.if_else(run, shaped - u_out, 0.0),
            "energy_J": energy,
            "fault": fault,
            "status": flag_word(bits),
        }
        return next_state, outputs

    def derived(name: str, value: float, source: str) -> Constant:
        return Constant(name, value, source, "derived")

    last_code = float(max(Fault))
    motor_low, motor_high = load_low - theta_lim, load_high + theta_lim
    return Block.define(
        "limits",
        "Limits before the motor, with the fault latch",
        period_s=h,
        constants=(
            *device.constants("safety"),
            derived("stale_ticks", stale_ticks, f"{STALE_PERIODS} control periods"),
            derived("slot_ticks", float(slot_ticks), f"1/{SLOTS} of energy_window_s, rounded up"),
            derived("fade", FADE, "share of the largest speed where pushing on begins to fade"),
            derived(
                "brake", BRAKE, "share of the largest speed above which only braking is let by"
            ),
        ),
        tunables=tunables,
        coefficients=coefficients,
        prepare=prepare,
        state=(
            Port("key", 0.0, RELEASED_KEY, "0 latched, one odd number released, else corrupt"),
            Port("fault_stored", 0, last_code, "reason of the latch, 0 released", init=1.0),
            Port("fault_mirror", -last_code, 0, "the same, negated", init=-1.0),
            Port("rearm_last", UNKNOWN, REARMS[-1], "last rearm; -1 unknown", init=UNKNOWN),
            Port("rearm_mirror", -REARMS[-1], -UNKNOWN, "the same, negated", init=-UNKNOWN),
            Port("u_last_Nm", -u_max, u_max, "last motor command"),
            Port("u_mirror_Nm", -u_max, u_max, "the same, negated"),
            Port("beat_last", 0, BEATS, "last stamp seen"),
            Port("age", 0, stale_ticks, "periods since it changed", init=stale_ticks),
            Port("ticks", 0, slot_ticks, "periods in the present slot"),
            Port("slot_J", 0.0, slot_lim, "energy given in the present slot"),
            Port("slots_J", 0.0, slot_lim, "energy given in the slots before, newest first", SLOTS),
        ),
        inputs=(
            Port("u_command_Nm", -command_lim, command_lim, "stamped command, at the motor shaft"),
            Port(
                "control_beat",
                0,
                BEATS,
                "stamp of that command; 0 none delivered",
                on_invalid="beat_last",
            ),
            Port("mode", OFF, IMPEDANCE, "0 off, 1 torque, 2 impedance; nothing between"),
            Port("stop", 0, 1, "0 no, anything else stops", on_invalid=1.0),
            Port(
                "rearm",
                0,
                REARMS[-1],
                "whole number, one more for each request; 0 follows 7",
                on_invalid="rearm_last",
            ),
            Port("request_ok", 0, 1, "1 while what is wanted is sound"),
            Port("sensing_ok", 0, 1, "1 while the measurements are good"),
            Port("theta_rad", -theta_lim, theta_lim, "deflection of the coupling"),
            Port("theta_motor_rad", motor_low, motor_high, "motor side's joint angle"),
            Port("omega_motor_rad_s", -omega_motor_lim, omega_motor_lim, "motor side's speed"),
            Port("theta_load_rad", load_low, load_high, "load side's joint angle"),
            Port("omega_load_rad_s", -omega_load_lim, omega_load_lim, "load side's speed"),
            Port("tau_Nm", -tau_lim, tau_lim, "interaction torque, + on the load"),
        ),
        outputs=(
            Port("u_Nm", -u_max, u_max, "motor torque, at the motor shaft"),
            Port("u_cut_Nm", -u_max, u_max, "taken off by range of motion and speed"),
            Port("u_lag_Nm", -2 * u_max, 2 * u_max, "still missing because of the rate limit"),
            Port(
                "energy_J",
                0.0,
                float(np.float32(1.01 * (SLOTS + 1) * slot_lim)),
                "energy given to the limb within the window",
            ),
            Port("fault", 0, last_code, "first reason of the latch (a Fault), 0 when released"),
            Port(
                "status",
                0,
                2 ** len(_flags(energy_max)) - 1,
                "which limits act, and what holds the latch",
                flags=_flags(energy_max),
            ),
        ),
        equations=_equations(),
        step=step,
        streams=STREAMS,
    )


def _equations() -> tuple[Any, ...]:
    u, b, a, m, w, v, th = sp.symbols("U b a m W omega theta_l")
    h, tau, omega_l = sp.symbols("h tau omega_l")
    speed = u * (sp.Rational(9, 10) * w - v) / (w / 10)
    return (
        equation(
            "[lim 1]",
            "u_+",
            sp.Min(u, sp.Max(0, u * (b - th) / m), sp.Max(0, speed)),
            "largest push towards larger angles",
        ),
        equation(
            "[lim 2]",
            "u_-",
            sp.Min(u, sp.Max(0, u * (th - a) / m), sp.Max(0, speed.subs(v, -v))),
            "largest push towards smaller angles",
        ),
        equation(
            "[lim 3]",
            "E",
            sp.Function("sum")(h * sp.Max(0, tau * omega_l)),
            "energy given to the limb, over the present slot and the ten before it",
        ),
    )


__all__ = ["FAULT_TEXT", "RELEASED_KEY", "Fault", "command_stamp", "limits"]
