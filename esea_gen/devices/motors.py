"""Motors with a moteus drive: the numbers that a device file and the drive's settings need.

Source: mjbots/moteus at commit db1a7623, Apache-2.0.  Motor: docs/mpat.html, mj5208.  Torque
constant: 8.3 over Kv, fw/bldc_servo.cc.  Currents: README.md and docs/reference/hardware.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from esea_gen.errors import UserError

_AT = "mjbots/moteus, commit db1a7623"
KV_RPM_V = 304.0
LINEAR_A = 22.5  # above, the mj5208's iron saturates: mpat.html, rotationCurrentCutoff


@dataclass(frozen=True)
class MotorKit:
    """A drive and its motor; the gear is the reader's, and ``gear_ratio`` only an example."""

    name: str
    peak_A: float  # of a phase
    continuous_A: float  # without cooling
    motor: str = "mj5208"
    torque_constant_Nm_A: float = 8.3 / KV_RPM_V
    rotor_kgm2: float = 5.6e-5
    lag_s: float = 0.005  # docs/guides/calibration.md: 1 / 200 Hz, the default bandwidth
    encoder_bits: int = 14  # on board, AS5047P
    gear_ratio: float = 30.0  # with 20 A the torque of elbow_drive

    @property
    def u_max_Nm(self) -> float:
        return float(f"{self.torque_constant_Nm_A * self.peak_A:.4g}")

    def numbers(self) -> Iterator[tuple[str, float, str]]:
        """Numbers of a motor for a device file: key, value and source."""
        torque = f"{self.peak_A:g} A times {self.torque_constant_Nm_A:.4g} Nm/A"
        yield "u_max_Nm", self.u_max_Nm, f"{self.motor}, {torque}, {_AT}"
        yield "rotor_kgm2", self.rotor_kgm2, f"{self.motor}, docs/mpat.html, {_AT}"
        yield "tau_c_s", self.lag_s, f"default bandwidth, docs/guides/calibration.md, {_AT}"
        yield "encoder_bits", self.encoder_bits, f"on-board AS5047P, docs/reference, {_AT}"

    def check(self, given: Mapping[str, float]) -> None:
        """Reject more torque than the drive's peak current gives."""
        if (wanted := given.get("u_max_Nm", 0.0)) > self.u_max_Nm:
            raise UserError(
                f"u_max_Nm = {wanted:g} is above {self.name}'s limit {self.u_max_Nm:g}: "
                f"{self.peak_A:g} A times {self.torque_constant_Nm_A:.4g} Nm/A.",
                "Give less, or a larger drive with --motor.",
            )

    def settings(self, given: Mapping[str, float]) -> list[str]:
        """The drive's settings that go with a device file's numbers, as its console takes them."""
        lasting_Nm = self.torque_constant_Nm_A * self.continuous_A
        return [
            f"# {self.continuous_A:g} A last without cooling: {lasting_Nm:.3g} Nm at the motor.",
            "conf set servo.timeout_mode 0",
            f"conf set servo.max_current_A {given['u_max_Nm'] / self.torque_constant_Nm_A:.4g}",
            f"conf set motor_position.rotor_to_output_ratio {1 / given['gear_ratio']:.7g}",
            "conf write",
        ]


MOTORS = {
    m.name: m
    for m in (
        MotorKit("moteus-c1", 20.0, 5.0),
        MotorKit("moteus-n1", LINEAR_A, 9.0),  # the drive: 100 A
        MotorKit("moteus-r4", LINEAR_A, 12.0),  # the drive: 100 A
    )
}
