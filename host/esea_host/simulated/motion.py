"""Simulated movements of a passive joint, and its encoder counts, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, count, cycle, repeat
from pathlib import Path

import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.model.sensing import of_axis
from esea_gen.tables import read_table
from esea_gen.twin.parameters import STEP_S
from esea_gen.twin.passive import ENCODER_NOISE_RAD, passive_system
from esea_gen.twin.trajectories import minimum_jerk
from esea_host.recording.export import column_of

TICK_S = 1e-3
MOTIONS = ("person", "therapist")
EFFORT = 0.15  # of the coupling's largest torque
BOUT_S, REST_S = 10.0, 2.0
SWINGS_HZ = (0.4, 0.27, 0.33)  # of each axis its own
MOVE_S, PAUSE_S = (3.0, 2.0, 1.5), 1.5
REACH = 0.6  # of the joint's range
DAMPING_S = 0.1  # of a limb that is moved, times its stiffness
MOST_GAP_S = 0.1


# Of each axis the angles of motor side and load side in rad.
Angles = Mapping[str, tuple[float, float]]
JointMotion = Callable[[], Angles]  # called once a base tick


class SteppedCoupling:
    """A coupling whose one side is moved along a path while a torque acts on the other."""

    def __init__(self, device: DeviceData, inertia_kgm2: float | None = None) -> None:
        library = compile_system(passive_system(device, STEP_S, TICK_S), "f64")
        ffi, prefix = library.ffi, library.prefix
        params = ffi.new(f"{prefix}_params_t *")
        library.function(f"{prefix}_default_params")(params)
        if inertia_kgm2 is not None:
            params.plant.cuff_inertia_kgm2 = inertia_kgm2
        self._coeffs = ffi.new(f"{prefix}_coeffs_t *")
        library.function(f"{prefix}_prepare")(params, self._coeffs)
        self._state = ffi.new(f"{prefix}_state_t *")
        library.function(f"{prefix}_init")(self._coeffs, self._state)
        self._in = ffi.new(f"{prefix}_move_in_t *")
        self._out = ffi.new(f"{prefix}_move_out_t *")
        self._move = library.function(f"{prefix}_move_step")
        self._library = library
        self._path_rad = 0.0

    def step(self, torque_Nm: float, path_rad: float) -> tuple[float, float]:
        """A tick on, to this angle of the moved side: the other's angle, torque of the coupling."""
        push, steps = self._in, round(TICK_S / STEP_S)
        push.tau_hand_Nm = torque_Nm
        push.omega_l_rad_s = (path_rad - self._path_rad) / TICK_S
        for i in range(1, steps + 1):
            push.theta_l_rad = self._path_rad + i / steps * (path_rad - self._path_rad)
            self._move(self._coeffs, self._state, push, self._out)
        self._path_rad = path_rad
        return float(self._out.theta_m_rad), float(self._out.tau_e_Nm)


def effort_Nm(device: DeviceData) -> float:
    """A torque that the coupling bears for long."""
    return EFFORT * device.file.limits.tau_Nm.value


def swinging_person(device: DeviceData) -> Iterator[Angles]:
    """A person who pushes the load side to and fro while the motor side is fixed; then rests."""
    joint = device.file.joint
    assert joint is not None  # a board's device has one
    couplings = {a: SteppedCoupling(device, joint.Jh_kgm2.value) for a in device.axes}
    for tick in count(1):
        t_s = tick * TICK_S % (BOUT_S + REST_S) - REST_S
        grown = math.sin(math.pi * t_s / BOUT_S) ** 2 if t_s > 0 else 0.0
        moved = {}
        for k, (axis, coupling) in enumerate(couplings.items()):
            swing = math.sin(2 * math.pi * SWINGS_HZ[k % len(SWINGS_HZ)] * t_s)
            moved[axis] = 0.0, coupling.step(effort_Nm(device) * grown * swing, 0.0)[0]
        yield moved


def therapist_hand(device: DeviceData) -> Iterator[Angles]:
    """Hands on the motor side that move a limp limb slowly, pause, and move it back."""
    joint = device.file.joint
    assert joint is not None  # a board's device has one
    couplings = {a: SteppedCoupling(device) for a in device.axes}
    reach_rad = REACH * joint.theta_max_rad.value
    stiffness_Nm_rad = effort_Nm(device) / reach_rad
    for move_s, moving in cycle((s, axis) for s in MOVE_S for axis in device.axes):
        for tick in count(1):
            t_s, moved = tick * TICK_S, {}
            for axis, coupling in couplings.items():
                share, speed, acceleration = _there_and_back(t_s - PAUSE_S, move_s)
                x, v, a = (
                    (q * reach_rad if axis == moving else 0.0) for q in (share, speed, acceleration)
                )
                torque_Nm = stiffness_Nm_rad * (x + DAMPING_S * v) + joint.Jh_kgm2.value * a
                moved[axis] = coupling.step(torque_Nm, x)[0], x
            yield moved
            if t_s >= 2 * (move_s + PAUSE_S):
                break


def _there_and_back(t_s: float, move_s: float) -> tuple[float, float, float]:
    # Minimum jerk to 1, a pause there, and back to 0; with speed and acceleration.
    back = t_s > move_s + 0.5 * PAUSE_S
    if back:
        t_s -= move_s + PAUSE_S
    way, speed, rise = map(float, minimum_jerk(t_s / move_s))
    x, v, a = way, speed / move_s, rise / move_s**2
    return (1 - x, -v, -a) if back else (x, v, a)


def recorded_motion(device: DeviceData, path: Path) -> Iterator[Angles]:
    """Both angles from a table with ``time_s``, ``theta_motor_rad`` and ``theta_load_rad``.

    Linear between its rows; at the end they stay; axes that it does not have rest.
    """
    table = read_table(path)
    names = {
        a: tuple(of_axis(f"theta_{side}_rad", a) for side in ("motor", "load")) for a in device.axes
    }
    columns = {n: column_of(table, n) for n in ("time_s", *(n for p in names.values() for n in p))}
    there = {n for n, c in columns.items() if c in table.names}
    names = {a: pair for a, pair in names.items() if there.issuperset(pair)}
    if "time_s" not in there or not names:
        raise UserError(
            f"{path} has the columns {', '.join(table.names)}.",
            f"A motion of {device.name} has {', '.join(columns)}.",
        )
    needed = ["time_s", *(n for pair in names.values() for n in pair)]
    columns = {n: columns[n] for n in needed}
    values = {n: table.numbers(c) for n, c in columns.items()}
    time_s = values["time_s"]
    if len(time_s) < 2:
        raise UserError(f"{path} has {len(time_s)} rows.", "Give at least 2 rows.")
    steps_s = np.diff(time_s)
    bad = np.flatnonzero((steps_s <= 0) | (steps_s > MOST_GAP_S))
    if len(bad):
        raise UserError(
            f"{table.at(int(bad[0]) + 1, 'time_s')}: {steps_s[bad[0]]:.6g} s after the row "
            f"before; allowed is above 0 and at most {MOST_GAP_S:g} s.",
            "Use a part without gaps, with rising times.",
        )
    joint = device.file.joint
    assert joint is not None  # a board's device has one
    most = joint.omega_max_rad_s.value
    for name in needed[1:]:
        speeds = np.abs(np.diff(values[name])) / steps_s
        k = int(np.argmax(speeds))
        if speeds[k] > most:
            raise UserError(
                f"{table.at(k + 1, name)}: moves by {speeds[k]:.3g} rad/s; the joint's limit "
                f"is {most:g} rad/s.",
                "Angles are in rad; from a recording use the part after its zeroing.",
            )
    at_s = np.arange(time_s[0], time_s[-1], TICK_S)
    paths = {n: np.interp(at_s, time_s, values[n]).tolist() for n in needed[1:]}
    axes = {a: zip(paths[m], paths[load], strict=True) for a, (m, load) in names.items()}
    rest = dict.fromkeys(device.axes, (0.0, 0.0))
    steps = [rest | dict(zip(axes, now, strict=True)) for now in zip(*axes.values(), strict=True)]
    return chain(steps, repeat(steps[-1]))


def make_motion(name: str, device: DeviceData) -> JointMotion:
    """A motion by name, ``person`` or ``therapist``, or from a table."""
    if name == "person":
        return swinging_person(device).__next__
    if name == "therapist":
        return therapist_hand(device).__next__
    if Path(name).suffix or Path(name).is_file():
        return recorded_motion(device, Path(name)).__next__
    raise UserError(
        f"There is no motion '{name}'.",
        f"Choose from {', '.join(MOTIONS)}, or give a table (.csv).",
    )


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
        self._moved = self.motion()
        return self._counts((0.0,) * len(self.axes))

    def step(self, moves: bool, pushes_rad: Sequence[float]) -> list[int]:
        """A tick on, in which the motion goes on or rests; somebody pushes each joint so far."""
        if moves:
            self._moved = self.motion()
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
