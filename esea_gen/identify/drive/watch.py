"""Recording of one procedure of a bring-up."""

from __future__ import annotations

from dataclasses import dataclass

from esea_gen.language.ports import Array


@dataclass(frozen=True)
class DriveRecording:
    """What one procedure recorded, a row a tick; ``u_Nm[k]`` is held from tick k to k + 1."""

    tick_s: float
    u_Nm: Array
    gear_rad: Array  # at the joint, whole turns of the shaft found by the joint's encoder
    motor_rad: Array
    load_rad: Array

    def __len__(self) -> int:
        return len(self.u_Nm)
