"""Reasons of the latch before the motor, and the bits of its status word."""

from __future__ import annotations

from enum import IntEnum

from esea_gen.language.ports import Code, Flag


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
    CLOCK = 13
    LATE = 14
    COEFFICIENTS = 15


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
    Fault.CLOCK: "base ticks were lost, repeated or went backward, or an old state was put back",
    Fault.LATE: "too many runs of a task ended after the tick at which they are released",
    Fault.COEFFICIENTS: "the coefficients are not those that were prepared, or no control run has "
    "checked them yet",
}

FAULT_CURE = {
    Fault.NONE: "nothing to do",
    Fault.NOT_ARMED: "rearm",
    Fault.STATE_CORRUPT: "rearm; if it comes again, memory or stack is at fault: service",
    Fault.TUNABLE_INVALID: "prepare the coefficients again from params that are in range",
    Fault.STOP: "take back every stop, then rearm",
    Fault.INPUT_INVALID: "give finite inputs within their ranges; look at the status words of the "
    "Blocks before",
    Fault.SENSING: "look at the encoders' status words: wiring, magnet, zero",
    Fault.CONTROL_STALE: "see that the control task runs and gives finite commands",
    Fault.DEFLECTION: "unload the coupling; look for a blocked joint or a slipped encoder",
    Fault.TORQUE: "unload the joint; a smaller wanted torque",
    Fault.SPEED: "let the joint come to rest; a slower movement or smaller gains",
    Fault.RANGE_OF_MOTION: "move the joint back by hand",
    Fault.ENERGY: "wait until the window has forgotten; slower or weaker movement",
    Fault.CLOCK: "call release once for every base tick, in order; resume a state that was put "
    "back",
    Fault.LATE: "free time for the late task: see the watch's counters",
    Fault.COEFFICIENTS: "run the control task; if it stays, prepare again: memory was overwritten",
}

# From the measurement, as the limits get it, to a motor command of zero; docs/limits.md tells how.
FAULT_BOUND = {
    Fault.NONE: "",
    Fault.NOT_ARMED: "from the first step on",
    Fault.STATE_CORRUPT: "the same step",
    Fault.TUNABLE_INVALID: "the same step",
    Fault.STOP: "the same step",
    Fault.INPUT_INVALID: "the same step",
    Fault.SENSING: "the same step; what only contradicts, as the page on limits tells",
    Fault.CONTROL_STALE: "5 control periods after the last new command",
    Fault.DEFLECTION: "the same step",
    Fault.TORQUE: "the same step",
    Fault.SPEED: "the same step",
    Fault.RANGE_OF_MOTION: "the same step",
    Fault.ENERGY: "the same step",
    Fault.CLOCK: "the same step",
    Fault.LATE: "the twelfth late run in a row",
    Fault.COEFFICIENTS: "the next control run and its release",
}

FAULT_CODES = tuple(
    Code(f.name, int(f), FAULT_TEXT[f], FAULT_CURE[f], FAULT_BOUND[f]) for f in Fault
)


def limit_flags(energy_max: float) -> tuple[Flag, ...]:
    """Bits of the status word of the limits."""
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
        Flag("CLOCK", "base ticks were lost, repeated or went backward", True),
        Flag("LATE", FAULT_TEXT[Fault.LATE], True),
        Flag("COEFFICIENTS", FAULT_TEXT[Fault.COEFFICIENTS]),
    )
