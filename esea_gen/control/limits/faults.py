"""Reasons of the latch before the motor, and the bits of its status word."""

from __future__ import annotations

from enum import IntEnum

from esea_gen.language.ports import Code, Flag, Port, status_port


class Key(IntEnum):
    """State of the latch: the one number that releases it differs from 0 in 16 bits."""

    LATCHED = 0
    RELEASED = 0xFFAA55  # exact as float32


class Doubt(IntEnum):
    """Conditions that the monitor detects, named by their faults."""

    NONE = 0
    SWINGS = 1
    ROUGH = 2
    STUCK_BIT = 3


class Fault(IntEnum):
    """Reason of the latch; if several causes occur in one step, the smallest number is stored."""

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
    SWINGS = 16
    ROUGH = 17
    STUCK_BIT = 18
    MOTOR_HOT = 19


SAME = "the same step"
# What happened, what the person at the machine should do, and how long it may take from the
# measurement, as the limits get it, to a motor command of zero; docs/limits.md describes how.
FAULTS = {
    Fault.NONE: ("released", "nothing to do", ""),
    Fault.NOT_ARMED: ("not armed since power-up or reset", "rearm", "from the first step on"),
    Fault.STATE_CORRUPT: (
        "the limits' memory was corrupt",
        "rearm; if it recurs, service: memory or stack is faulty",
        SAME,
    ),
    Fault.TUNABLE_INVALID: (
        "a limit was outside its compiled bounds, or the range of motion was reversed",
        "prepare the coefficients again, with parameters in range",
        SAME,
    ),
    Fault.STOP: ("stop was requested", "release every stop, then rearm", SAME),
    Fault.INPUT_INVALID: (
        "an input or desired value was NaN, outside its physical range or not a whole number",
        "give finite inputs within their ranges; check the status words of the Blocks before",
        SAME,
    ),
    Fault.SENSING: (
        "the measurements could not be used",
        "check the status words: an encoder's wiring, magnet, zero; with CONTRADICTED also "
        "whether the motor's amplifier is off or has tripped, or an obstacle blocks the drive",
        "the same step; a contradiction: see the page on monitors",
    ),
    Fault.CONTROL_STALE: (
        "the control task delivered no new command",
        "check that the control task runs and gives finite commands",
        "5 control periods after the last new command",
    ),
    Fault.DEFLECTION: (
        "the coupling was deflected too far",
        "unload the coupling; check for a blocked joint or a slipped encoder",
        SAME,
    ),
    Fault.TORQUE: (
        "the interaction torque was too large",
        "unload the joint; reduce the desired torque",
        SAME,
    ),
    Fault.SPEED: (
        "joint or drive was too fast",
        "let the joint come to rest; move slower or reduce the gains",
        SAME,
    ),
    Fault.RANGE_OF_MOTION: (
        "the joint was beyond its range of motion and margin",
        "move the joint back by hand",
        SAME,
    ),
    Fault.ENERGY: (
        "too much energy was given to the limb within the window",
        "wait until the window is empty; move slower or with less torque",
        SAME,
    ),
    Fault.CLOCK: (
        "base ticks were lost, repeated or backward, or an old state was restored",
        "call release once for every base tick, in order; call resume after restoring a state",
        SAME,
    ),
    Fault.LATE: (
        "too many runs of a task ended after the tick at which they are released",
        "reduce the load of the late task: see the watch's counters",
        "the twelfth late run in a row",
    ),
    Fault.COEFFICIENTS: (
        "the coefficients are not those that were prepared, or no control run has checked them yet",
        "run the control task; if the fault stays, prepare again: memory was overwritten",
        "the next control run and its release",
    ),
    Fault.SWINGS: (
        "the command swung repeatedly between the motor's limits, and the torque was wrong",
        "check for a loose encoder or cable and encoder noise; then reduce the gains",
        "1 s of full swings at 20 Hz, or 3 s at 13 Hz",
    ),
    Fault.ROUGH: (
        "an encoder's noise was above that of a sound encoder",
        "check the cable, shield, supply and magnet of the encoder in the monitor's status word",
        "0.1 s of white noise, four times a sound encoder's",
    ),
    Fault.STUCK_BIT: (
        "a bit of a joint encoder's count did not change while the joint moved",
        "check the wiring, then the encoder, of the side in the monitor's status word",
        "a slow motion of twice the bit's weight, or 32 times the noise if that is more",
    ),
    Fault.MOTOR_HOT: (
        "the motor's winding is too hot",
        "let it cool; reduce the torque or rest longer",
        "the next control run and its release",
    ),
}
DOUBTS = {Fault[d.name]: d for d in Doubt if d}
FAULT_TEXT = {f: text for f, (text, _, _) in FAULTS.items()}
FAULT_CODES = tuple(Code(f.name, int(f), *row) for f, row in FAULTS.items())
OPTIONAL = (Fault.MOTOR_HOT,)  # of devices whose file has its section, at the end


def limit_status(energy_max: float) -> Port:
    given = "the energy given to the limb within the window is beyond its limit"
    cut, word = ("u_cut_Nm",), FAULT_TEXT
    return status_port(
        "active limits, and the reason of the latch",
        word[Fault.INPUT_INVALID],
        "the state was corrupt; the latch was closed",
        Flag("TUNABLE_INVALID", word[Fault.TUNABLE_INVALID]),
        Flag("STOPPED", "stop is requested now"),
        Flag("SENSING_LOST", word[Fault.SENSING], True),
        Flag("CONTROL_STALE", "the control task has delivered no new command for too long"),
        Flag("DEFLECTION", "the deflection is beyond its limit"),
        Flag("INTERACTION_TORQUE", "the interaction torque is beyond its limit"),
        Flag("SPEED", "joint or drive is faster than its limit"),
        Flag("RANGE_OF_MOTION", "the joint is beyond its range of motion and the margin"),
        Flag("ENERGY", given, False, ("energy_J",), energy_max),
        Flag("TORQUE_CLIPPED", "the command was clipped at the largest motor torque", True),
        Flag("RATE_LIMITED", "the command changed faster than allowed", True, ("u_lag_Nm",)),
        Flag("ROM_LOW", "the command towards the lower end was reduced", True, cut),
        Flag("ROM_HIGH", "the command towards the upper end was reduced", True, cut),
        Flag("SPEED_LIMITED", "the command was reduced at high speed", True, cut),
        Flag("REARM_REFUSED", "a rearm request came, but not all its conditions were met", True),
        Flag("FAULT_LATCHED", "the motor command is held at zero; fault holds the first reason"),
        Flag("CLOCK", "base ticks were lost, repeated or went backward", True),
        Flag("LATE", word[Fault.LATE], True),
        Flag("COEFFICIENTS", word[Fault.COEFFICIENTS]),
        *(Flag(f.name, word[f]) for f in DOUBTS),
    )
