"""The board ``sim`` in lockstep with the virtual exoskeleton and a person: one run, one fault."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from esea_gen.board.sim import SimBoard
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import SteppedHand, hand_variant
from esea_gen.twin.people import real_plant
from esea_gen.twin.published import PEOPLE
from esea_gen.twin.stepped import SteppedPlant
from esea_gen.verify.faults.kinds import BoardFault, Distortion, measured_and_wanted, ranges

WANTED_EVERY = 10  # ticks from one of the host's commands to the next
ZERO_AT, ARM_AT, ACTIVE_AT = 20, 260, 264
EARLIEST, LATEST = 900, 1700  # of the fault: in motion, in any phase
AFTER = 800  # ticks
TORQUE, IMPEDANCE = 1.0, 2.0
AMPLITUDE_RAD, HERTZ = 0.5, 0.5
REST = 0.3  # what a second axis moves of that: deviation has a third of flexion's range


@dataclass(frozen=True)
class FaultScene:
    """What drive and person do when it happens."""

    name: str
    person: str
    mode: float
    torque_Nm: float


SCENES = (
    FaultScene("moved at 0 Nm", "uncertain", TORQUE, 0.0),
    FaultScene("moved at 2 Nm", "uncertain", TORQUE, 2.0),
    FaultScene("held at 1.7 Nm", "none", TORQUE, 1.7),
    FaultScene("moved, impedance", "uncertain", IMPEDANCE, 0.0),
)


def intended(k: int) -> dict[str, float]:
    """Angle, speed and acceleration that the person means to have at a tick: there and back."""
    if k < ACTIVE_AT:
        return {"theta_p_rad": 0.0, "omega_p_rad_s": 0.0, "alpha_p_rad_s2": 0.0}
    w, t = 2 * math.pi * HERTZ, (k - ACTIVE_AT) * 1e-3
    c, s = math.cos(w * t), math.sin(w * t)
    return {
        "theta_p_rad": AMPLITUDE_RAD * (1 - c),
        "omega_p_rad_s": AMPLITUDE_RAD * w * s,
        "alpha_p_rad_s2": AMPLITUDE_RAD * w * w * c,
    }


class RigPlant:
    """Plant and person, of one axis or of two: counts in the order of the board's encoders."""

    def __init__(self, device: Device, scene: FaultScene, seed: int, counts: Sequence[str]) -> None:
        self.axes, self.names = device.axes, counts
        self.clamped = scene.person == "none"
        if len(self.axes) == 1:
            self.one: SteppedPlant | None = SteppedPlant(real_plant(device, seed=seed))
            self.person = PEOPLE[scene.person]
        else:
            self.one = None
            self.two = SteppedHand(hand_variant(device, "real", scene.person, seed))

    def start(self) -> Sequence[int]:
        """Counts at rest."""
        if self.one is not None:
            return self.one.start(0.0, clamped=self.clamped, person=self.person)
        return self._ordered(self.two.start([0.0] * len(self.axes)))

    def step(self, u_Nm: Sequence[float], path: Mapping[str, float]) -> Sequence[int]:
        """One tick, every axis moved alike; the counts at its end."""
        if self.one is not None:
            self.one.intend(path)
            return self.one.step(*u_Nm)
        share = [dict(path)] + [{n: REST * x for n, x in path.items()} for _ in self.axes[1:]]
        self.two.intend(share)
        return self._ordered(self.two.step(u_Nm))

    def felt(self) -> list[tuple[float, float]]:
        """Torque on the limb and its speed, of each axis."""
        if self.one is not None:
            return [self.one.torque_and_speed()]
        truth, names = self.two.truth(), ("tau_e_Nm", "omega_l_rad_s")
        return [(truth[of_axis(names[0], a)], truth[of_axis(names[1], a)]) for a in self.axes]

    def _ordered(self, counts: Mapping[str, int]) -> list[int]:
        return [counts[n] for n in self.names]


@dataclass(frozen=True)
class Felt:
    """What one fault did."""

    found_ticks: int | None
    reason: int
    torque_then_Nm: float
    peak_torque_Nm: float
    energy_J: float


class FaultRig:
    """A board and a plant, built once; every run starts from power on."""

    def __init__(self, device: Device) -> None:
        if not device.laws or device.file.timing.sense_rate_Hz.value != 1000:
            raise UserError(
                f"{device.origin}: no drive that senses at 1 kHz.",
                "Give a device with a drive, such as elbow_drive.",
            )
        self.device = device
        self.board = SimBoard(device)
        self.measured, self.wanted = measured_and_wanted(device)
        self.ranges = ranges(device)
        self._encoders = [k for k, n in enumerate(self.measured) if n.startswith("count_")]

    def close(self) -> None:
        """Let go of the board."""
        self.board.close()

    def run(self, scene: FaultScene, fault: BoardFault | None, at: int, seed: int) -> Felt:
        """One run."""
        board = self.board
        board.restart()
        plant = RigPlant(self.device, scene, seed, [self.measured[k] for k in self._encoders])
        counts = plant.start()
        noise = np.random.default_rng([seed, 3]).standard_normal(at + AFTER)
        noise[:ACTIVE_AT] = 0.0  # a joint that is zeroed stands still
        wrong = None
        if fault is not None and fault.place in self.ranges:
            wraps = fault.place.startswith("count_")
            wrong = Distortion(fault, *self.ranges[fault.place], wraps)
        of_link = fault is not None and fault.place in self.wanted
        cut, found, reason = False, None, 0
        tau, power = [], []
        for k in range(at + AFTER):
            now = fault is not None and k >= at
            cut = now and fault is not None and fault.place == "link"
            board.show(counts)
            if wrong is not None and not of_link:
                assert fault is not None
                place = self.measured.index(fault.place)
                read = float(board.drivers[place]) if place in self._encoders else 0.0
                board.drivers[place] = wrong(k - at, read)
            self._measure(dict(zip(self.measured, map(float, board.drivers), strict=False)))
            if k == at and fault is not None:
                self._strike(fault)
            if not cut:
                self._tell(scene, k, wrong if of_link else None, fault, at)
            self._tick(fault if now else None, k - at)
            u_Nm = board.motors_Nm if board.motor_on else (0.0,) * len(self.device.axes)
            counts = plant.step(u_Nm, intended(k) | {"noise": float(noise[k])})
            if k >= at:
                truth = plant.felt()
                tau.append(max(abs(torque) for torque, _ in truth))
                power.append(sum(torque * speed for torque, speed in truth))
                if found is None and board.state_now not in ("ACTIVE", "ARMED"):
                    found, reason = k - at, int(board.lib.sim_fault())
            elif k == at - 1 and board.state_now != "ACTIVE":
                raise UserError(
                    f"{scene.name}, seed {seed}: the board is {board.state_now} before the fault.",
                    "A sound run must be able to go on; see esea-gen simulate.",
                )
        board.pending()
        work = np.concatenate([[0.0], np.cumsum(power) * 1e-3])
        return Felt(
            found,
            reason,
            float(np.max(tau[: None if found is None else found + 1])),
            float(np.max(tau)),
            float(np.max(work - np.minimum.accumulate(work))),
        )

    def _tell(
        self, scene: FaultScene, k: int, wrong: Distortion | None, fault: BoardFault | None, at: int
    ) -> None:
        # The host: zero, arm, then a command every 10 ms, of which one value may be wrong.
        board = self.board
        if k == ZERO_AT:
            board.zero()
        elif k == ARM_AT:
            board.arm()
        elif k >= ACTIVE_AT and (k - ACTIVE_AT) % WANTED_EVERY == 0:
            t = (k - ACTIVE_AT) * 1e-3
            torque = scene.torque_Nm * 0.5 * (1 - math.cos(2 * math.pi * 0.6 * t))
            wanted: dict[str, Any] = {"mode": scene.mode}
            wanted |= {of_axis("tau_desired_Nm", a): torque for a in self.device.axes}
            if wrong is not None and fault is not None:
                place = fault.place
                wanted[place] = wrong(k - at, wanted.get(place, 0.0))
            board.want(**wanted)

    def _measure(self, readings: dict[str, float]) -> None:
        self.board.measure(**readings)

    def _strike(self, fault: BoardFault) -> None:
        lib = self.board.lib
        if fault.place in ("state", "coefficients"):
            bit = int(fault.amount)
            lib.sim_flip(fault.place == "coefficients", fault.byte + bit // 8, 1 << bit % 8)
        elif fault.place == "stop line":
            lib.sim_stop_line(True)

    def _tick(self, fault: BoardFault | None, age: int) -> None:
        lib, count, controls = self.board.lib, 1, True
        if fault is not None and fault.place == "clock":
            count += int(fault.amount) if fault.kind == "lost ticks" and age == 0 else 0
            controls = fault.kind != "control starved" or age >= fault.amount
        lib.sim_measure(self.board.drivers)
        lib.sim_tick(count, controls)
        lib.sim_poll()


@lru_cache(maxsize=1)
def rig_of(device: Device) -> FaultRig:
    """A rig of a device, built once in a process."""
    return FaultRig(device)
