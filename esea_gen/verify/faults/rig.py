"""The board ``sim`` in lockstep with the virtual exoskeleton and a person: one run, one fault.

The people are from limp to stiff, some with a reflex.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from esea_gen.board.sim import SimBoard
from esea_gen.control.laws.predictive import device_horizon
from esea_gen.device import Device
from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_gen.model.mode import Mode
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import hand_variant
from esea_gen.twin.people import real_plant
from esea_gen.twin.published import PEOPLE, Person
from esea_gen.twin.stepped import SteppedTwin
from esea_gen.verify.faults.kinds import BoardFault, Distortion, input_ports, measured_and_wanted

# Of the stretch reflex, all assumed: share of the arm's own stiffness, conduction, muscle.
REFLEX_SHARE, REFLEX_DELAY_S, MUSCLE_S = 0.3, 0.05, 0.03
DAMPING_RATIO = 0.4  # of a stiff arm, without which its own late reflex would swing it; assumed


@dataclass(frozen=True)
class Subject:
    person: Person
    reflex: bool = False


def _stiff(spring_Nm_rad: float) -> Subject:
    at = PEOPLE["uncertain"]
    damping = 2 * DAMPING_RATIO * math.sqrt(spring_Nm_rad * at.Jh_kgm2)
    return Subject(replace(at, spring_Nm_rad=spring_Nm_rad, damping_Nms_rad=damping), reflex=True)


# Desired of a drive in their hands, where not 2: more throws a limp arm out of its range.
LIMP, CLAMPED, COMMON = "limp", "clamped", "12 Nm/rad"
SUBJECTS: Mapping[str, Subject] = {
    LIMP: Subject(
        replace(PEOPLE["uncertain"], spring_Nm_rad=0.0, damping_Nms_rad=0.0, feedforward=False)
    ),
    COMMON: Subject(PEOPLE["uncertain"]),
    **{f"{k} Nm/rad": _stiff(k) for k in (30, 60, 120, 250)},
    CLAMPED: Subject(PEOPLE["none"]),
}
MOST_NM = {LIMP: 0.2, CLAMPED: 1.7}


class StretchReflex:
    """Delayed pull against stretch, as a shift of the intended angle."""

    def __init__(self, tick_s: float) -> None:
        self._late = deque([0.0] * round(REFLEX_DELAY_S / tick_s))
        self._keep = math.exp(-tick_s / MUSCLE_S)
        self._pull_rad = 0.0

    def moved(self, intended_rad: float, theta_rad: float) -> float:
        self._late.append(intended_rad - theta_rad)
        self._pull_rad += (1 - self._keep) * (self._late.popleft() - self._pull_rad)
        return intended_rad + REFLEX_SHARE * self._pull_rad


def subject_of(name: str) -> Subject:
    return SUBJECTS[name] if name in SUBJECTS else Subject(PEOPLE[name])


WANTED_EVERY = 10  # ticks from one of the host's commands to the next
ZERO_AT, ARM_AT, ACTIVE_AT = 20, 260, 264
EARLIEST, LATEST = 900, 2900  # of the fault: a period of the slower motion
LIMP_LATEST = 1200  # later on a limp arm may have swung out of its range
AFTER = 800  # ticks
_, TORQUE, IMPEDANCE = map(float, Mode)
STOP_LINE, OPERATOR = "stop line", "operator"  # who stops: category 0, category 1
MOTIONS = ((0.5, 0.5), (0.26, 0.9))  # amplitude in rad and frequency in Hz: slow reaches, slices
REST = 0.3  # what a second axis moves of that: deviation has a third of flexion's range


@dataclass(frozen=True)
class FaultScene:
    name: str
    person: str
    mode: float
    torque_Nm: float
    motion: int = 0
    halts: bool = False  # the person comes to rest, REACTS ticks after it happened


SCENES = (
    FaultScene("moved at 0 Nm", COMMON, TORQUE, 0.0),
    FaultScene("moved at 2 Nm", COMMON, TORQUE, 2.0),
    FaultScene("held at 1.7 Nm", CLAMPED, TORQUE, 1.7),
    FaultScene("moved, impedance", COMMON, IMPEDANCE, 0.0),
)
REACTS, HALT_S = 450, 0.3


def scene_of(case: Mapping[str, Any]) -> FaultScene:
    """Of a case: one of :data:`SCENES`, of the drawn person and to the drawn side."""
    base = next(s for s in SCENES if s.name == case["scene"])
    torque_Nm = case["sign"] * MOST_NM.get(case["person"], base.torque_Nm)
    return replace(base, person=case["person"], torque_Nm=torque_Nm if base.torque_Nm else 0.0)


def drawn_moment(draw: random.Random, person: str) -> int:
    return draw.randrange(EARLIEST, LIMP_LATEST if person == LIMP else LATEST)


def desired_Nm(scene: FaultScene, t_s: float) -> float:
    return scene.torque_Nm * 0.5 * (1 - math.cos(2 * math.pi * 0.6 * t_s))


def intended(k: int, motion: int = 0, halt: int | None = None) -> dict[str, float]:
    """Angle, speed and acceleration that the person means to have: there and back, or a halt."""
    if k < ACTIVE_AT:
        return {"theta_p_rad": 0.0, "omega_p_rad_s": 0.0, "alpha_p_rad_s2": 0.0}
    if halt is not None and k > halt:
        before, t = intended(halt, motion), min((k - halt) * 1e-3, HALT_S)
        speed = before["omega_p_rad_s"]
        return {
            "theta_p_rad": before["theta_p_rad"] + speed * t * (1 - 0.5 * t / HALT_S),
            "omega_p_rad_s": speed * (1 - t / HALT_S),
            "alpha_p_rad_s2": -speed / HALT_S if t < HALT_S else 0.0,
        }
    rad, hertz = MOTIONS[motion]
    w, t = 2 * math.pi * hertz, (k - ACTIVE_AT) * 1e-3
    c, s = math.cos(w * t), math.sin(w * t)
    return {
        "theta_p_rad": rad * (1 - c),
        "omega_p_rad_s": rad * w * s,
        "alpha_p_rad_s2": rad * w * w * c,
    }


class RigPlant:
    """Plant and person, of one axis or of two: counts in the order of the board's encoders."""

    def __init__(self, device: Device, scene: FaultScene, seed: int, counts: Sequence[str]) -> None:
        self.axes, self.names = device.axes, counts
        clamped, subject = scene.person == CLAMPED, subject_of(scene.person)
        self.reflex: StretchReflex | None = None
        self.who: dict[str, Any] = {}
        if len(self.axes) == 1:
            self.twin = SteppedTwin(real_plant(device, seed=seed))
            self.who = {"clamped": clamped, "person": subject.person}
            self.reflex = StretchReflex(1e-3) if subject.reflex else None
        else:
            hand = "none" if clamped else "uncertain"
            self.twin = SteppedTwin(hand_variant(device, "real", hand, seed))

    def start(self) -> list[int]:
        """Counts at rest."""
        return self._ordered(self.twin.start([0.0] * len(self.axes), **self.who))

    def step(self, u_Nm: Sequence[float], path: Mapping[str, float]) -> list[int]:
        """One tick, every axis moved alike; the counts at its end."""
        if self.reflex is not None:
            pulled = self.reflex.moved(path["theta_p_rad"], self.twin.felt()[0][2])
            path = {**path, "theta_p_rad": pulled}
        rest = [{n: REST * x for n, x in path.items()} for _ in self.axes[1:]]
        self.twin.intend([path, *rest])
        return self._ordered(self.twin.step(u_Nm))

    def _ordered(self, counts: Mapping[str, int]) -> list[int]:
        return [counts[n] for n in self.names]


@dataclass(frozen=True)
class Felt:
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
        self.inputs = input_ports(device)
        wanted = {x.name for x in board_roles(device.system).wanted}
        # Of a controller with a given future; from each interval's end on.
        self.ends_s = device_horizon(device).ends_s if "tau_preview_Nm" in wanted else ()
        self._encoders = [k for k, n in enumerate(self.measured) if n.startswith("count_")]

    def close(self) -> None:
        self.board.close()

    def _distortions(self, fault: BoardFault | None) -> dict[str, Distortion]:
        places = fault.place.split("+") if fault is not None else []
        i = self.inputs
        return {
            p: Distortion(fault, i[p].low, i[p].high, p.startswith("count_"), i[p].whole)
            for p in places
            if fault is not None and p in i
        }

    def run(
        self,
        scene: FaultScene,
        fault: BoardFault | None,
        at: int,
        seed: int,
        ticks: Sequence[int] = (AFTER, AFTER),
    ) -> Felt:
        """One run, for so many ticks after the fault, and at most so many after it was found."""
        board, (after, run_out) = self.board, ticks
        board.restart()
        plant = RigPlant(self.device, scene, seed, [self.measured[k] for k in self._encoders])
        counts = plant.start()
        noise = np.random.default_rng([seed, 3]).standard_normal(at + after)
        noise[:ACTIVE_AT] = 0.0  # a joint that is zeroed stands still
        wrong = self._distortions(fault)
        of_link = fault is not None and fault.place in self.wanted
        halt = at + REACTS if scene.halts else None
        cut, found, reason = False, None, 0
        tau, power = [], []
        for k in range(at + after):
            if found is not None and k > at + found + run_out:
                break
            now = fault is not None and k >= at
            cut = now and fault is not None and fault.place == "link"
            board.show(counts)
            for name in wrong if not of_link else ():
                place = self.measured.index(name)
                read = float(board.drivers[place]) if place in self._encoders else 0.0
                board.drivers[place] = wrong[name](k - at, read)
            self._measure(dict(zip(self.measured, map(float, board.drivers), strict=False)))
            if k == at and fault is not None:
                self._strike(fault)
            if not cut:
                self._tell(scene, k, wrong if of_link else {}, at)
            self._tick(fault if now else None, k - at)
            u_Nm = board.motors_Nm if board.motor_on else (0.0,) * len(self.device.axes)
            path = intended(k, scene.motion, halt) | {"noise": float(noise[k])}
            counts = plant.step(u_Nm, path)
            if k >= at:
                felt = plant.twin.felt()
                tau.append(max(abs(torque) for torque, *_ in felt))
                power.append(sum(torque * speed for torque, speed, _ in felt))
                if found is None and board.state_now not in ("ACTIVE", "ARMED", "STOPPING"):
                    found, reason = k - at, int(board.lib.sim_fault())
            elif k == at - 1 and board.state_now != "ACTIVE":
                raise UserError(
                    f"{scene.name}, seed {seed}: the board is {board.state_now} before the fault.",
                    "Correct the device until esea-gen simulate runs without a fault.",
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

    def _tell(self, scene: FaultScene, k: int, wrong: dict[str, Distortion], at: int) -> None:
        # The host: zero, arm, then a command every 10 ms, of which one value may be wrong.
        board = self.board
        if k == ZERO_AT:
            board.zero()
        elif k == ARM_AT:
            board.arm()
        elif k >= ACTIVE_AT and (k - ACTIVE_AT) % WANTED_EVERY == 0:
            t = (k - ACTIVE_AT) * 1e-3
            torque = desired_Nm(scene, t)
            wanted: dict[str, Any] = {"mode": scene.mode}
            wanted |= {of_axis("tau_desired_Nm", a): torque for a in self.device.axes}
            if self.ends_s:
                wanted["tau_preview_Nm"] = [desired_Nm(scene, t + end) for end in self.ends_s]
            wanted |= {n: w(k - at, wanted.get(n, 0.0)) for n, w in wrong.items()}
            board.want(**wanted)

    def _measure(self, readings: dict[str, float]) -> None:
        self.board.measure(**readings)

    def _strike(self, fault: BoardFault) -> None:
        lib = self.board.lib
        if fault.place in ("state", "coefficients"):
            bit = int(fault.amount)
            lib.sim_flip(fault.place == "coefficients", fault.byte + bit // 8, 1 << bit % 8)
        elif fault.place == STOP_LINE:
            lib.sim_stop_line(True)
        elif fault.place == OPERATOR:
            self.board.stop()

    def _tick(self, fault: BoardFault | None, age: int) -> None:
        lib, count, controls = self.board.lib, 1, True
        if fault is not None and fault.place == "clock":
            count += int(fault.amount) if fault.kind == "lost ticks" and age == 0 else 0
            controls = fault.kind != "control starved" or age >= fault.amount
        lib.sim_measure(self.board.drivers)
        lib.sim_tick(count, controls)
        lib.sim_poll()


@lru_cache(maxsize=3)
def rig_of(device: Device, kind: type[FaultRig] = FaultRig) -> FaultRig:
    """A rig of a device, built once in a process."""
    return kind(device)
