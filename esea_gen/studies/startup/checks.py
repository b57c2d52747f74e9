"""What is asked of each procedure's result, and the fix where it is not met."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from esea_gen.device import Device
from esea_gen.studies.startup.drive_model import DriveModel
from esea_gen.studies.startup.procedures import FRICTION_RAD_S

GAIN_OFF, GAIN_HALF = 0.10, 0.05
RATIO_OFF = 0.03
FRICTION_SHARE, DISTURBANCE_SHARE = 0.5, 0.25
SHARP_SHARE, LAG_SHARP_SHARE = 0.05, 0.10
DELAY_HALF_S, DELAY_APART_S = 2e-4, 5e-4
BEND_S = 0.003
LEFT_SHARE = 0.10


@dataclass(frozen=True)
class StartupCheck:
    """One comparison with a limit.

    value, limit: in ``unit``; the value must not be above.
    fix: what to do otherwise.
    """

    procedure: str
    what: str
    value: float
    limit: float
    unit: str
    fix: str

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return self.value <= self.limit

    def line(self) -> str:
        """For people."""
        word = "within" if self.passed else "ABOVE"
        return f"{self.what}: {self.value:.3g}, {word} {self.limit:.3g} {self.unit}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, units in the keys."""
        unit = (self.unit or "1").replace("%", "pct")
        finite = math.isfinite(self.value)
        return {
            "procedure": self.procedure,
            "what": self.what,
            f"value_{unit}": self.value if finite else None,
            f"limit_{unit}": self.limit,
            "passed": self.passed,
            "fix": "" if self.passed else self.fix,
        }


AGAIN = "Do the procedure again; look for what is loose, or touched the joint."


def _share(part: float, of: float) -> float:
    return 100 * part / abs(of) if of else math.inf


def _steady(m: DriveModel, full_Nm: float) -> list[StartupCheck]:
    fastest = max(FRICTION_RAD_S)
    lost = m.fc_Nm.value + m.fv_Nms_rad.value * fastest
    set_to = f"multiply the torque constant that is set in the drive by {m.gain.value:.3g}"
    return [
        StartupCheck(
            "gain",
            "motor's torque off its command, interval included",
            100 * (abs(m.gain.value - 1) + m.gain.half),
            100 * GAIN_OFF,
            "%",
            "Do the torque check with a hanging mass first, for the gain is told by the rubber's "
            f"torque.  If that passes, {set_to}, and start again.",
        ),
        StartupCheck(
            "gain", "half the gain's interval", 100 * m.gain.half, 100 * GAIN_HALF, "%", AGAIN
        ),
        StartupCheck(
            "friction",
            f"friction at {fastest:g} rad/s over the motor's largest torque",
            _share(lost, full_Nm),
            100 * FRICTION_SHARE,
            "%",
            "Look for a cable that rubs, a tight bearing, too much tension.",
        ),
        StartupCheck(
            "friction",
            "motion of the joint over that of the gear, off 1",
            100 * abs(m.joint_ratio.value - 1),
            100 * RATIO_OFF,
            "%",
            "Correct actuator.gear_ratio or actuator.encoder_bits in the device file, or the "
            "joint encoders' correction.",
        ),
    ]


def _moving(m: DriveModel, full_Nm: float) -> list[StartupCheck]:
    return [
        StartupCheck(
            "inertia",
            "half the inertia's interval",
            _share(m.J_kgm2.half, m.J_kgm2.value),
            100 * SHARP_SHARE,
            "%",
            AGAIN,
        ),
        StartupCheck(
            "inertia",
            "half the lag's interval",
            _share(m.tau_c_s.half, m.tau_c_s.value),
            100 * LAG_SHARP_SHARE,
            "%",
            AGAIN,
        ),
        StartupCheck(
            "delay", "half the delay's interval", m.delay_s.half, DELAY_HALF_S, "s", AGAIN
        ),
        StartupCheck(
            "delay",
            "delay apart from what the inertia's procedure saw",
            abs(m.delay_s.value - m.delay_again_s.value),
            DELAY_APART_S,
            "s",
            "The delay changes from command to command: look at the bus and the scheduling.",
        ),
        StartupCheck(
            "delay",
            "delay apart from the bend that the counts show",
            abs(m.delay_s.value - m.jump.bend_s),
            BEND_S,
            "s",
            "The lag is not one of first order: look at the drive's current control.",
        ),
        StartupCheck(
            "disturbance",
            "largest disturbance over the motor's largest torque",
            _share(m.disturbance.peak_Nm, full_Nm),
            100 * DISTURBANCE_SHARE,
            "%",
            "Look for a cable that climbs on its drum, a damaged gear, cogging.",
        ),
    ]


def checks_of(device: Device, m: DriveModel) -> tuple[StartupCheck, ...]:
    """Every comparison that the identified drive allows."""
    a = device.file.actuator
    assert a is not None
    full_Nm = a.gear_ratio.value * a.u_max_Nm.value
    found = _steady(m, full_Nm) + _moving(m, full_Nm)
    found += [
        StartupCheck(
            name,
            "torque that the model leaves over what it explains",
            _share(left, m.moved_Nm[name]),
            100 * LEFT_SHARE,
            "%",
            "Something moves the drive that is not in the model: look for a loose part, a second "
            "backlash, a slipping cable.",
        )
        for name, left in m.left_Nm.items()
    ]
    return tuple(found)


__all__ = ["StartupCheck", "checks_of"]
