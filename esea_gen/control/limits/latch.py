"""Equations of the limits: input checks, causes of a trip, the latch, the command."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.limits.faults import DOUBTS, Fault, Key
from esea_gen.control.limits.safety import LimitNumbers
from esea_gen.language.block import Guard, Labels, StepResult
from esea_gen.language.ports import Port, clip, flag_word, in_range
from esea_gen.language.watch import LATE_MOST
from esea_gen.model.mode import Mode

LAST_REARM = 7  # rearm counts up to it and wraps
UNKNOWN = 8  # rearm_last before a request was seen: the first one is not an edge
MIRROR = 255  # less a number is its mirror


def _any(conditions: Iterable[ca.SX]) -> ca.SX:
    return reduce(ca.logic_or, conditions)


def _all(conditions: Iterable[ca.SX]) -> ca.SX:
    return reduce(ca.logic_and, conditions)


def limit_step(
    n: LimitNumbers,
    coefficients: Sequence[Port],
    c: Any,
    s: Any,
    u: Any,
    guard: Guard,
    label: Labels,
) -> StepResult:
    m = _memory(coefficients, c, s, u, guard, label)
    age = _control_age(n, s, u, label)
    energy = _energy(n, s, u, label)
    causes = _causes(n, c, u, guard, m, age, energy.window)
    latch = _latch(s, u, m, causes, label)
    push = _command(n, c, s, u, label)
    u_out = ca.if_else(latch.run, push.followed, 0.0)
    next_state = {
        "key": ca.if_else(latch.run, Key.RELEASED, Key.LATCHED),
        "fault_stored": latch.fault,
        "fault_mirror": MIRROR - latch.fault,
        "rearm_last": latch.rearm,
        "rearm_mirror": MIRROR - latch.rearm,
        "u_last_Nm": u_out,
        "u_mirror_Nm": -u_out,
        "beat_last": u.control_beat,
        "age": age,
        **energy.next_state,
    }
    bits = [causes[Fault.INPUT_INVALID], causes[Fault.STATE_CORRUPT]]
    bits += [causes[Fault(k)] for k in (3, 4, 6, 7, 8, 9, 10, 11, 12)]
    acts = ca.logic_and(latch.run, push.on)
    bits += [
        ca.logic_and(acts, ca.fabs(u.u_command_Nm) > _most(c, u)),
        ca.logic_and(latch.run, ca.logic_not(push.followed == push.shaped)),
        *(ca.logic_and(acts, held) for held in push.held_back),
        latch.refused,
        ca.logic_not(latch.run),
        *(causes[Fault(k)] for k in range(13, 19)),
    ]
    outputs = {
        "u_Nm": u_out,
        "u_cut_Nm": ca.if_else(latch.run, push.clipped - push.shaped, 0.0),
        "u_lag_Nm": ca.if_else(latch.run, push.shaped - u_out, 0.0),
        "energy_J": energy.window,
        "fault": latch.fault,
        "status": flag_word(bits),
    }
    return next_state, outputs


def _memory(
    coefficients: Sequence[Port], c: Any, s: Any, u: Any, guard: Guard, label: Labels
) -> SimpleNamespace:
    """Whom to believe: the memory, the inputs, the tunables."""
    released = s.key == Key.RELEASED
    closed = s.key == Key.LATCHED
    trusted = label(
        "trusted",
        _all(
            [
                guard.state_ok,
                s.fault_stored + s.fault_mirror == MIRROR,
                s.rearm_last + s.rearm_mirror == MIRROR,
                s.u_last_Nm + s.u_mirror_Nm == 0,
                ca.logic_or(
                    ca.logic_and(released, s.fault_stored == Fault.NONE),
                    _all([closed, s.fault_stored != Fault.NONE, s.u_last_Nm == 0]),
                ),
            ]
        ),
        "1 when no part of the memory contradicts another",
    )
    was_released = label("was_released", ca.logic_and(trusted, released))
    inputs_ok = label(
        "inputs_valid", ca.logic_and(guard.inputs_ok, u.request_ok), "and what is wanted is"
    )
    tunables_ok = label(
        "tunables_valid",
        _all(
            [in_range(getattr(c, p.name), p.low, p.high) for p in coefficients]
            + [c.rom_min_rad < c.rom_max_rad]
        ),
        "no limit is wider than compiled in",
    )
    return SimpleNamespace(
        closed=closed,
        trusted=trusted,
        was_released=was_released,
        inputs_ok=inputs_ok,
        tunables_ok=tunables_ok,
    )


def _control_age(n: LimitNumbers, s: Any, u: Any, label: Labels) -> ca.SX:
    older = ca.if_else(s.age >= n.stale_ticks, s.age, s.age + 1)
    delivered = ca.logic_and(u.control_beat >= 1, ca.logic_not(u.control_beat == s.beat_last))
    return label(
        "age_ticks",
        ca.if_else(u.control_beat >= 1, ca.if_else(delivered, 0.0, older), n.stale_ticks),
        "periods since the control task delivered",
    )


def _energy(n: LimitNumbers, s: Any, u: Any, label: Labels) -> SimpleNamespace:
    """[lim 3]: energy given to the limb within the window, in slots."""
    given = label(
        "given_J", n.h * ca.fmax(u.tau_Nm * u.omega_load_rad_s, 0), "[lim 3] in this period"
    )
    slots = ca.vertsplit(s.slots_J)
    slot = ca.fmin(s.slot_J + given, n.slot_lim)
    energy = slot
    for part in slots:
        energy = energy + ca.fabs(part)  # a flipped sign gives no credit
    label("window_J", energy, "[lim 3] present slot and the ten before it")
    full = s.ticks >= n.slot_ticks - 1
    next_state = {
        "ticks": ca.if_else(full, 0.0, s.ticks + 1),
        "slot_J": ca.if_else(full, 0.0, slot),
        "slots_J": [
            ca.if_else(full, new, old) for new, old in zip([slot, *slots], slots, strict=False)
        ],
    }
    return SimpleNamespace(window=energy, next_state=next_state)


def _causes(
    n: LimitNumbers, c: Any, u: Any, guard: Guard, m: SimpleNamespace, age: ca.SX, energy: ca.SX
) -> dict[Fault, ca.SX]:
    """Causes that forbid a motor command, in order of precedence."""
    lowest = ca.fmax(c.trip_low_rad, n.trip_low)
    highest = ca.fmin(c.trip_high_rad, n.trip_high)
    apart = u.theta_motor_rad - u.theta_load_rad
    speed = ca.fmax(ca.fabs(u.omega_load_rad_s), ca.fabs(u.omega_motor_rad_s))

    def measured(*beyond: ca.SX) -> ca.SX:
        # What stands in for an invalid input must not raise a flag of its own.
        return ca.logic_and(guard.inputs_ok, _any(beyond))

    causes = {
        Fault.STATE_CORRUPT: ca.logic_not(m.trusted),
        Fault.TUNABLE_INVALID: ca.logic_not(m.tunables_ok),
        Fault.STOP: u.stop,
        Fault.INPUT_INVALID: ca.logic_not(m.inputs_ok),
        Fault.SENSING: ca.logic_not(u.sensing_ok),
        Fault.CONTROL_STALE: age >= n.stale_ticks,
        Fault.DEFLECTION: measured(
            ca.fabs(u.theta_rad) > c.theta_max_rad, ca.fabs(apart) > c.theta_max_rad
        ),
        Fault.TORQUE: measured(ca.fabs(u.tau_Nm) > c.tau_max_Nm),
        Fault.SPEED: measured(speed > c.omega_max_rad_s),
        Fault.RANGE_OF_MOTION: measured(u.theta_load_rad > highest, u.theta_load_rad < lowest),
        Fault.ENERGY: energy > c.energy_max_J,
        Fault.CLOCK: ca.logic_not(u.clock_ok),
        Fault.LATE: u.late_level > LATE_MOST,
        Fault.COEFFICIENTS: ca.logic_not(u.coeffs_ok),
        **{fault: u.doubt == d for fault, d in DOUBTS.items()},
    }
    hot = {} if u.u_thermal_Nm is None else {Fault.MOTOR_HOT: ca.logic_not(u.u_thermal_Nm > 0)}
    return causes | hot


def _latch(
    s: Any, u: Any, m: SimpleNamespace, causes: Mapping[Fault, ca.SX], label: Labels
) -> SimpleNamespace:
    """Opens with one more ``rearm`` and no cause left; closes with a cause and keeps the first."""
    cause = label("cause", _any(causes.values()), "anything that forbids a motor command")
    reason: Any = Fault.NONE
    for code, found in reversed(list(causes.items())):
        reason = ca.if_else(found, code, reason)

    known = ca.logic_and(m.trusted, s.rearm_last <= LAST_REARM)
    following = ca.if_else(s.rearm_last >= LAST_REARM, 0.0, s.rearm_last + 1)
    request = label("rearm_edge", ca.logic_and(known, u.rearm == following), "one more")
    changed = ca.logic_and(known, ca.logic_not(u.rearm == s.rearm_last))
    release = label(
        "release",
        _all([request, m.closed, ca.logic_not(cause), u.mode == Mode.OFF, u.u_command_Nm == 0]),
        "off, asked for, no cause left, and the controller itself has let go",
    )
    run = label("run", ca.logic_and(ca.logic_not(cause), ca.logic_or(m.was_released, release)))
    kept = ca.logic_and(m.trusted, m.closed)
    fault = label(
        "fault_next",
        ca.if_else(run, Fault.NONE, ca.if_else(kept, s.fault_stored, reason)),
        "the first reason stays",
    )
    # What a corrupt memory says of the last request is no ground for an edge.
    rearm = ca.if_else(m.trusted, u.rearm, UNKNOWN)
    refused = ca.logic_and(changed, ca.logic_and(m.closed, ca.logic_not(release)))
    return SimpleNamespace(run=run, fault=fault, rearm=rearm, refused=refused)


def _most(c: Any, u: Any) -> Any:
    return c.u_max_Nm if u.u_thermal_Nm is None else ca.fmin(c.u_max_Nm, u.u_thermal_Nm)


def _command(n: LimitNumbers, c: Any, s: Any, u: Any, label: Labels) -> SimpleNamespace:
    """[lim 1, lim 2]: the command clipped, faded out towards the ends, and rate-limited."""
    on = ca.logic_not(u.mode == Mode.OFF)
    wanted = ca.if_else(on, u.u_command_Nm, 0.0)
    most = _most(c, u)
    clipped = label("u_clipped_Nm", clip(wanted, -most, most), "torque")
    fastest_up = ca.fmax(u.omega_load_rad_s, u.omega_motor_rad_s)
    fastest_down = ca.fmin(u.omega_load_rad_s, u.omega_motor_rad_s)
    rom_up = ca.fmax(c.rom_gain_Nm_rad * (c.rom_max_rad - u.theta_load_rad), 0)
    rom_down = ca.fmax(c.rom_gain_Nm_rad * (u.theta_load_rad - c.rom_min_rad), 0)
    speed_up = ca.fmax(c.speed_gain_Nms_rad * (c.brake_rad_s - fastest_up), 0)
    speed_down = ca.fmax(c.speed_gain_Nms_rad * (c.brake_rad_s + fastest_down), 0)
    up = label("most_up_Nm", ca.fmin(rom_up, speed_up), "[lim 1] push towards larger angles")
    down = label("most_down_Nm", ca.fmin(rom_down, speed_down), "[lim 2] towards smaller ones")
    shaped = label("u_shaped_Nm", clip(clipped, -down, up), "range of motion and speed")
    u_step = ca.fmin(c.u_step_Nm, n.step_max)
    followed = label(
        "u_followed_Nm", clip(shaped, s.u_last_Nm - u_step, s.u_last_Nm + u_step), "rate"
    )
    held_back = (
        clipped < -rom_down,
        clipped > rom_up,
        ca.logic_or(clipped < -speed_down, clipped > speed_up),
    )
    return SimpleNamespace(
        on=on, clipped=clipped, shaped=shaped, followed=followed, held_back=held_back
    )
