"""A passive joint that is moved, as its two encoders see it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.model.sensing import of_axis
from esea_gen.twin.passive import ENCODER_NOISE_RAD
from esea_host.simulated.motion import JointMotion

NOISE_TICKS = 1000
TURN_RAD = 2 * math.pi


class MovedJoint:
    """Counts of the encoders on both sides of every axis' coupling, in the board's order."""

    def __init__(self, device: DeviceData, motion: JointMotion, seed: int) -> None:
        self.axes, self.motion, self._seed = device.axes, motion, seed
        encoders = device.file.encoder
        self._steps = 2 ** int(encoders.resolution_bits.value)
        rng = np.random.default_rng([seed, 4])
        self._mounted = []  # direction and offset of each
        for _ in device.axes:
            for side in (encoders.motor, encoders.load):
                assert side is not None  # a board's device has both
                anywhere = rng.uniform(0, TURN_RAD)
                zero = anywhere if side.zero_rad is None else side.zero_rad.value
                turned = 1.0 if side.direction is None else side.direction.value
                self._mounted.append((turned, zero))

    def start(self) -> list[int]:
        self._noise = np.random.default_rng([self._seed, 3])
        self._ticks = 0
        self._moved = self.motion.step()
        return self._counts((0.0,) * len(self.axes))

    def step(self, moves: bool, pushes_rad: Sequence[float]) -> list[int]:
        """A tick on, in which the motion goes on or rests; somebody pushes each joint so far."""
        if moves:
            self._moved = self.motion.step()
        return self._counts(pushes_rad)

    def truth(self) -> dict[str, float]:
        """Angles of motor side and load side of each axis, by the names of a driven plant."""
        sides = "theta_m_rad", "theta_l_rad"
        moved = self._moved.items()
        return {of_axis(n, a): x for a, both in moved for n, x in zip(sides, both, strict=True)}

    def _counts(self, pushes_rad: Sequence[float]) -> list[int]:
        at = self._ticks % NOISE_TICKS
        if at == 0:
            shape = NOISE_TICKS, 2 * len(self.axes)
            self._blurs = self._noise.normal(0, ENCODER_NOISE_RAD, shape).tolist()
        self._ticks += 1
        angles = [
            side + pushed
            for axis, pushed in zip(self.axes, pushes_rad, strict=True)
            for side in self._moved[axis]
        ]
        return [
            math.floor((turned * (angle + zero) + blur) * (self._steps / TURN_RAD)) % self._steps
            for angle, (turned, zero), blur in zip(
                angles, self._mounted, self._blurs[at], strict=True
            )
        ]
