"""Which way motor and encoders count, and what to swap where they disagree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_host.commissioning.startup import DriveRecording

FOLLOWS = 0.25  # of the gear's motion, at least, where a side is to have moved with it
STANDS = 0.1  # of it, at most, where a side is clamped


@dataclass(frozen=True)
class SignCheck:
    """Motions between a command one way and the other."""

    command_Nm: float
    gear_rad: float
    motor_rad: float
    load_rad: float

    @classmethod
    def of(cls, recording: DriveRecording) -> SignCheck:
        """From the recording of the procedure."""
        u = recording.u_Nm
        held = np.abs(np.gradient(u)) < 1e-9
        ahead = np.flatnonzero(held & (u > 0.9 * u.max()))
        back = np.flatnonzero(held & (u < 0.9 * u.min()))
        # Less the zero after each: where friction left the drive must not count.
        first, second = ahead[len(ahead) // 2 :], back[len(back) // 2 :]

        def moved(x: np.ndarray) -> float:
            return float(np.mean(x[first]) - np.mean(x[second]))

        return cls(
            moved(u), moved(recording.gear_rad), moved(recording.motor_rad),
            moved(recording.load_rad),
        )  # fmt: skip

    @property
    def motor_sign(self) -> int:
        """1 where the motor's encoder rises with the command, -1 where it falls."""
        return 1 if self.gear_rad > 0 else -1

    def problem(self) -> tuple[str, str] | None:
        """What is wrong and what to swap; None where all agree."""
        scale = abs(self.gear_rad)
        seen = (
            f"with the command from {-0.5 * self.command_Nm:+.3f} to "
            f"{0.5 * self.command_Nm:+.3f} Nm the motor's encoder moved by {self.gear_rad:+.4f} "
            f"rad at the joint, the motor side's by {self.motor_rad:+.4f} rad, the load side's by "
            f"{self.load_rad:+.4f} rad"
        )
        if abs(self.load_rad) > FOLLOWS * scale and abs(self.motor_rad) < STANDS * scale:
            return seen, "The joint's two encoders are swapped: exchange their connectors."
        if abs(self.load_rad) > STANDS * scale:
            return seen, "The output moved: clamp it."
        if abs(self.motor_rad) < FOLLOWS * scale:
            return seen, (
                "The motor turns and the coupling does not follow: check cable, its tension and "
                "the motor-side encoder."
            )
        if self.gear_rad > 0 > self.motor_rad:
            return seen, (
                "The motor-side encoder counts the other way: set encoder.motor.direction to its "
                "opposite and calibrate its zero again."
            )
        if self.gear_rad < 0 < self.motor_rad:
            return seen, "The motor's own encoder counts the other way: swap its A and B channels."
        if self.gear_rad < 0:
            return seen, (
                "The motor turns against its command: swap two of its phases, or the sign of the "
                "torque in the drive's settings, never both."
            )
        return None

    def to_dict(self) -> dict[str, float | int]:
        """JSON-ready."""
        return {
            "motor_sign": self.motor_sign,
            "command_change_Nm": self.command_Nm,
            "gear_moved_rad": self.gear_rad,
            "motor_side_moved_rad": self.motor_rad,
            "load_side_moved_rad": self.load_rad,
        }
