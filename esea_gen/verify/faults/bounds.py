"""Guarantees for a fault on the board: detection time, and load on the limb."""

from __future__ import annotations

from dataclasses import dataclass

from esea_gen.board.driven import CURRENT_TICKS
from esea_gen.control.limits.safety import STALE_PERIODS
from esea_gen.device import Device
from esea_gen.emit.states import TIMES_MS
from esea_gen.errors import UserError
from esea_gen.model.encoder import HELD_MAX
from esea_gen.verify.faults.kinds import BoardFault
from esea_gen.verify.faults.rig import WANTED_EVERY
from esea_gen.verify.faults.subjects import CLAMPED, COMMON, LIMP


@dataclass(frozen=True)
class LimbEnvelope:
    """Load on a limb of 12 Nm/rad after any single fault, until the motor is off and after."""

    torque_Nm: float
    run_out_Nm: float
    energy_J: float


# Shares of the trip, by person, above what a search for the worst fault found: a load-side encoder
# that drifts at 1 to 4 rad/s while the person turns back and moves on (clamped: a controller stuck
# at full torque, docs/fault-injection.md).  Until the motor is off, and after.
FOLLOWS = {LIMP: 1.0, COMMON: 1.0, "30 Nm/rad": 1.2, "60 Nm/rad": 1.2, CLAMPED: 1.2}
FOLLOWS |= {"120 Nm/rad": 1.4, "250 Nm/rad": 1.4}
RUN_OUT = {LIMP: 1.65, COMMON: 1.65, "30 Nm/rad": 2.2, "60 Nm/rad": 3.0, "120 Nm/rad": 3.6}
RUN_OUT |= {"250 Nm/rad": 4.5, CLAMPED: 4.5}


def envelope(device: Device) -> LimbEnvelope:
    safety = device.file.safety
    if safety is None:
        raise UserError(f"{device.origin}: no section [safety].", "Give a device with limits.")
    trip_Nm = safety.tau_max_Nm.value
    return LimbEnvelope(trip_Nm, RUN_OUT[COMMON] * trip_Nm, safety.energy_J.value)


def bound_ticks(device: Device, fault: BoardFault) -> int | None:
    """Ticks from a fault to the drive's end of following, where one is stated."""
    control = device.system.tasks[-1]
    across = control.every + control.release_ticks  # from a measurement to the limits by control
    if fault.place == "stop line":
        return 0  # looked at in every tick
    if fault.place == "operator":
        return TIMES_MS["STOP_OFF"][0]
    if fault.place == "link" or (fault.place == "mode" and fault.kind == "NaN"):
        # A frame with such a mode is none: nothing else comes until the deadline.
        return TIMES_MS["DEADLINE"][0]
    if fault.place == "current":
        return CURRENT_TICKS
    if fault.place.startswith("encoder "):
        return _frame_bound(fault, across)
    if fault.place == "coefficients":
        return across  # the checksum, at each control run
    if fault.place == "clock":
        if fault.kind == "lost ticks":
            return 0  # the tick after the gap
        # From the last release, which may come after the last run.
        stale = STALE_PERIODS * control.every + control.release_ticks - 1
        return stale if fault.amount >= stale else None
    unreadable = fault.kind == "NaN" or (
        fault.place.startswith("frame_error") and fault.kind == "jump" and fault.amount > 0
    )
    if fault.place.startswith(("count_", "frame_error_")) and unreadable:
        gear = "_gear" in fault.place
        return HELD_MAX + (across if gear else 0)
    if fault.kind == "NaN":
        return WANTED_EVERY  # in the step that reads it
    return None


def _frame_bound(fault: BoardFault, across: int) -> int | None:
    # It breaks when the tick's frames have been read, so the first bad ones are the next tick's.
    gear = fault.place.endswith(" gear")
    by_chance = ("one wrong bit", "swapped bytes") if gear else ("swapped bytes",)
    if fault.kind in by_chance:
        return None  # a parity that fits; one frame in 64 whose six bits of checksum do
    # What only the chip knows of its magnet comes with its diagnostics, every other tick.
    told = 3 if fault.kind.startswith("magnet") else 0
    return 1 + HELD_MAX + told + (across if gear else 0)
