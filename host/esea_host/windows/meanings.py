"""Texts for a board's numbers: flags of limits, faults and remedies, states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.model.mode import Mode
from esea_gen.model.sensing import of_axis
from esea_host.recording.layout import Array

# Words whose flags say that something holds the drive back.
LIMIT_WORDS = ("limits_status", "passivity_status", "motor_temperature_status")
# Of the limits' word: the latch is closed whenever the motor is off, and then a stop is asked for.
LATCH, STOP_ASKED, MOTOR_OFF = "FAULT_LATCHED", "STOPPED", "motor off"
BOARD_FAULTS = 100  # from here on no command clears them
MOTOR_ON = ("ARMED", "ACTIVE", "LETTING_GO")
ROLES = dict.fromkeys(MOTOR_ON, "moving") | {
    "FAULT": "alarm",
    "STOPPED": "alarm",
    "STOPPING": "alarm",
    "UNREFERENCED": "caution",
    "ZEROING": "caution",
    "READY": "good",
}
NEXT = {
    "UNKNOWN": "Waiting for the board's heartbeat.",
    "UNREFERENCED": "Next: unload the joint, hold it still at its zero, then Zero.",
    "READY": "Next: Arm switches the motor on.",
    "STOPPING": "STOP again switches the motor off at once.",
    "STOPPED": "Next: Release, when it is safe to continue.",
    "FAULT": "Next: remove the cause, then Acknowledge fault.",
}
ZERO, ARM, DISARM, RELEASE, CLEAR = "Zero", "Arm", "Disarm", "Release", "Acknowledge fault"
NO_ZERO = {"no zero": "An encoder has no zero: angles and torque are not valid."}
GENERAL = 4  # the last bit of a status word that means the same in every block


@dataclass(frozen=True)
class LimitFlag:
    """A bit of a status word, in the column ``word``."""

    word: str
    bit: int
    name: str
    meaning: str

    def held(self, rows: Array) -> Array:
        """In which rows it is set."""
        return np.asarray((rows[self.word] & self.bit) != 0)


def limit_flags(device: Device, axis: str = "") -> list[LimitFlag]:
    """All flags of an axis' limits; of a device without a drive, of its sensing."""
    found: dict[str, LimitFlag] = {}
    limits = [of_axis(word, axis) for word in LIMIT_WORDS]
    for output in sorted(device.system.outputs, key=lambda x: x.name):
        if output.name in limits or (
            not device.laws and output.name.endswith(of_axis("_status", axis))
        ):
            for i, flag in enumerate(output.port.flags):
                if flag.name == STOP_ASKED:
                    continue
                name = MOTOR_OFF if flag.name == LATCH else flag.name.lower().replace("_", " ")
                if name in found:
                    word = output.name.removesuffix(of_axis("_status", axis)).replace("_", " ")
                    name = f"{word} {name}"
                found[name] = LimitFlag(output.name, 1 << i, name, flag.meaning)
    return list(found.values())


def lacks_zero(device: Device, rows: Mapping[str, Any]) -> dict[str, str]:
    """``NO_ZERO`` if the newest row of a stream has an encoder without a zero, in any state."""
    for output in device.system.outputs:
        for i, flag in enumerate(output.port.flags):
            own = [r for r in rows.values() if output.name in (r.dtype.names or ())]
            if flag.name == "NOT_ZEROED" and any(int(r[output.name]) >> i & 1 for r in own):
                return NO_ZERO
    return {}


@dataclass(frozen=True)
class FaultText:
    number: int
    name: str
    meaning: str
    cure: str


def fault_text(dialect: Any, number: int) -> FaultText:
    entry = dialect.enums["ESEA_FAULT"].get(number)
    if entry is None or entry.name.endswith("_ENUM_END"):
        return FaultText(number, f"FAULT {number}", "not in this dialect", "service")
    said, _, _ = str(entry.description).partition("Found:")
    meaning, _, cure = said.partition("Cure:")
    name = str(entry.name).removeprefix("ESEA_FAULT_")
    return FaultText(number, name, meaning.strip(), cure.strip().rstrip("."))


def state_text(dialect: Any, name: str) -> str:
    for entry in dialect.enums["ESEA_STATE"].values():
        if entry.name == f"ESEA_STATE_{name}":
            return str(entry.description)
    return ""


def refusals(state: str, moves: bool = False, fault: int = 0) -> dict[str, str]:
    """Why a board in this state would refuse a command; moves: whether the joint does."""
    first = {
        "UNREFERENCED": "zero first",
        "STOPPED": "release first",
        "STOPPING": "stopping",
        "FAULT": "fault active",
        "ZEROING": "zeroing",
        "UNKNOWN": "no heartbeat",
    }.get(state, "")
    on = state in MOTOR_ON
    still = "the joint moves" if moves else ""
    zero = "" if state == "UNREFERENCED" else "disarm first" if on else first
    return {
        ZERO: zero or still,
        ARM: "is armed" if on else first,
        DISARM: "",  # what is known of the state may be old
        RELEASE: "" if state == "STOPPED" else "not stopped",
        CLEAR: "no fault" if state != "FAULT" else "restart it" if fault >= BOARD_FAULTS else "",
    }


def mode_text(mode: float) -> str:
    """A mode by its name; a number that is no mode as it is."""
    return Mode(int(mode)).name.lower() if mode in [*Mode] else f"{mode:g}"
