"""The virtual exoskeleton a tick at a time: what a board has, command in and encoder counts out.

Beside the plant stand the ways in which a real drive's torque may not be the one commanded: wrong
sign, wrong gain, late.  Delays are whole steps of the plant, finer than a tick.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand_plant import grouped, prepared, twin_system
from esea_gen.twin.parameters import STEP_S
from esea_gen.twin.people import PlantVariant
from esea_gen.twin.plant import TICK_S, start_state
from esea_gen.twin.published import Person

# A joint with nobody in it: the load side's own parts, its axis not quite upright.
EMPTY = Person(
    Jh_kgm2=0.05,
    spring_Nm_rad=0.0,
    damping_Nms_rad=0.0,
    feedforward=False,
    own_damping_Nms_rad=0.05,
    gravity_Nm=0.3,
    torque_noise_Nm=0.0,
    torque_noise_Hz=2.0,
)
MOST_DELAY_S = 0.1


@lru_cache(maxsize=4)
def compiled_plant(device: DeviceData, cable: bool, step_s: float) -> HostLibrary:
    """The plant of a device, compiled once in a process."""
    return compile_system(twin_system(device, cable, step_s, TICK_S), "f64")


class SteppedTwin:
    """A plant driven tick by tick: motor commands in, encoder counts by the board's input out."""

    def __init__(self, variant: PlantVariant) -> None:
        self.variant, self.axes = variant, variant.device.axes
        self.library = compiled_plant(variant.device, variant.cable, variant.step_s)
        self.system = self.library.system
        steps = round(TICK_S / variant.step_s)
        self._times_s = [j * variant.step_s for j in range(1, steps + 1)]
        self._late: deque[float] = deque()  # commands under way to the first axis' motor
        names = ("u_Nm", "theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "noise", "tau_muscle_Nm")
        self._inputs = [tuple(of_axis(n, a) for n in names) for a in self.axes]
        self._muscles = len(self.axes) > 1
        move, encode = self.system.task("move"), self.system.task("encode")
        self._outputs = [x.name for x in self.system.task_outputs(move)]
        self._angles_read = [x.name for x in self.system.task_inputs(encode)]
        self._counts_read = [x.name for x in self.system.task_outputs(encode)]

    def prepare(self, values: Mapping[str, float]) -> None:
        """Put other tunables in force; everything stays where it is."""
        library, groups = self.library, grouped(self.system, values)
        self._coeffs = prepared(library.ffi, library.function, library.prefix, self.system, groups)

    def begin(self, angles_rad: Sequence[float], values: Mapping[str, float]) -> dict[str, int]:
        """Start at rest at one angle an axis, with these tunables; the counts there."""
        library, prefix = self.library, self.library.prefix
        ffi = library.ffi
        self._state = ffi.new(f"{prefix}_state_t *")
        self.prepare(values)
        library.function(f"{prefix}_init")(self._coeffs, self._state)
        sampled: dict[str, float] = {}
        for axis, angle in zip(self.axes, angles_rad, strict=True):
            first, shown = start_state(self.system.blocks["plant"], angle, {}, axis=axis)
            sampled |= shown
            for key, vector in first.items():
                getattr(self._state.plant, key)[0 : len(vector)] = vector
        self._push = ffi.new(f"{prefix}_move_in_t *")
        self._plant = ffi.new(f"{prefix}_move_out_t *", sampled)
        self._encoded = ffi.new(f"{prefix}_encode_in_t *")
        self._counts = ffi.new(f"{prefix}_encode_out_t *")
        self._move = library.function(f"{prefix}_move_step")
        self._encode = library.function(f"{prefix}_encode_step")
        self.follow([{"theta_p_rad": float(x)} for x in angles_rad])
        return self._read()

    def follow(self, paths: Sequence[Mapping[str, float]]) -> None:
        """What is intended from the start of the next tick on; within it the path goes on.

        Of each axis ``theta_p_rad``, and what is not 0 of ``omega_p_rad_s``, ``alpha_p_rad_s2``,
        ``noise`` (of variance 1) and, of a hand, ``tau_Nm`` of the muscles beside the pull.
        """
        push = self._push
        self._moving: list[tuple[str, str, float, float, float]] = []
        for names, path in zip(self._inputs, paths, strict=True):
            _, theta, omega, alpha, noise, muscle = names
            at, speed = path["theta_p_rad"], path.get("omega_p_rad_s", 0.0)
            gain = path.get("alpha_p_rad_s2", 0.0)
            setattr(push, theta, at)
            setattr(push, omega, speed)
            setattr(push, alpha, gain)
            setattr(push, noise, path.get("noise", 0.0))
            if self._muscles:
                setattr(push, muscle, path.get("tau_Nm", 0.0))
            if speed or gain:
                self._moving.append((theta, omega, at, speed, gain))

    def advance(self, u_Nm: Sequence[float]) -> dict[str, int]:
        """Hold one command an axis for a tick; the counts at its end."""
        push, move, late = self._push, self._move, self._late
        for names, u in zip(self._inputs, u_Nm, strict=True):
            setattr(push, names[0], u)
        for t in self._times_s:
            for theta, omega, at, speed, gain in self._moving:
                setattr(push, omega, speed + t * gain)
                setattr(push, theta, at + t * (speed + 0.5 * t * gain))
            if late:
                late.append(u_Nm[0])
                push.u_Nm = late.popleft()
            move(self._coeffs, self._state, push, self._plant)
        return self._read()

    def truth(self) -> dict[str, float]:
        """The plant's own outputs at this moment, such as ``tau_e_Nm``."""
        return {n: float(getattr(self._plant, n)) for n in self._outputs}

    def _read(self) -> dict[str, int]:
        encoded, plant = self._encoded, self._plant
        for name in self._angles_read:
            setattr(encoded, name, getattr(plant, name))
        self._encode(self._coeffs, self._state, encoded, self._counts)
        return {n: int(getattr(self._counts, n)) for n in self._counts_read}


class SteppedPlant(SteppedTwin):
    """A plant whose output is clamped or free, with a person in the joint or nobody.

    Its drive may be wrong: ``motor_gain`` is true over commanded torque, ``delay_s`` the time to
    the torque's first change, and the encoders named count the other way.
    """

    def __init__(
        self,
        variant: PlantVariant,
        *,
        motor_gain: float = 1.0,
        delay_s: float = 0.0,
        reversed_encoders: Collection[str] = (),
    ) -> None:
        if not (math.isfinite(motor_gain) and 0 < abs(motor_gain) <= 10):
            raise UserError(f"A motor gain of {motor_gain:g}.", "Give -10 to 10, and not 0.")
        if not 0 <= delay_s <= MOST_DELAY_S:
            raise UserError(
                f"A delay of {delay_s:g} s.", f"Give 0 to {MOST_DELAY_S:g} s, in whole 0.2 ms."
            )
        super().__init__(variant)
        self.gain, self.delay_steps = motor_gain, round(delay_s / STEP_S)
        self.delay_s = self.delay_steps * STEP_S
        full = {p.name: round(p.high) + 1 for p in self.system.blocks["encoders"].outputs}
        self._turned = {n: full[n] for n in (f"count_{side}" for side in reversed_encoders)}

    def start(
        self, start_rad: float, *, clamped: bool, person: Person = EMPTY
    ) -> tuple[int, int, int]:
        """From rest at an angle; the counts there, of motor side, load side and motor's shaft."""
        self._late = deque([0.0] * self.delay_steps)
        return self._seen(self.begin([start_rad], self._values(clamped, person)))

    def change(self, *, clamped: bool, person: Person = EMPTY, **more: float) -> None:
        """Somebody comes, goes, clamps the output or lets it go; everything stays where it is."""
        self.prepare(self._values(clamped, person) | more)

    def _values(self, clamped: bool, person: Person) -> dict[str, float]:
        return {**self.variant.values, **person.values(), "clamped": float(clamped)}

    def step(self, u_Nm: float) -> tuple[int, int, int]:
        """Hold a command for a tick; the counts at its end."""
        return self._seen(self.advance((self.gain * u_Nm,)))

    def intend(self, path: Mapping[str, float]) -> None:
        """What the person intends: as :meth:`SteppedTwin.follow`."""
        self.follow((path,))

    def torque_and_speed(self) -> tuple[float, float]:
        """Of :meth:`truth` what a run needs every tick: torque on the limb, the limb's speed."""
        return float(self._plant.tau_e_Nm), float(self._plant.omega_l_rad_s)

    def angle_rad(self) -> float:
        """Of :meth:`truth` the limb's angle."""
        return float(self._plant.theta_l_rad)

    def _seen(self, counts: Mapping[str, int]) -> tuple[int, int, int]:
        turned = self._turned
        motor, load, gear = (-x % turned[n] if n in turned else x for n, x in counts.items())
        return motor, load, gear
