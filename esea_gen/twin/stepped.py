"""The virtual exoskeleton a tick at a time: what a board has, command in and encoder counts out.

Beside the plant stand the ways in which a real drive's torque may not be the one commanded: wrong
sign, wrong gain, late.  Delays are whole steps of the plant, finer than a tick.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Any

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.twin.encoders import ENCODERS
from esea_gen.twin.hand_plant import tunable_places, twin_system
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


def prepare_plant(library: HostLibrary, coeffs: Any, values: Mapping[str, float]) -> None:
    """Coefficients of a plant with these tunables, and the defaults of the others."""
    prefix, places = library.prefix, tunable_places(library.system)
    params = library.ffi.new(f"{prefix}_params_t *")
    library.function(f"{prefix}_default_params")(params)
    for key, value in values.items():
        if key not in places:
            raise UserError(f"The plant has no tunable {key}.", f"It has: {', '.join(places)}.")
        instance, name = places[key]
        setattr(getattr(params, instance), name, value)
    refused = int(library.function(f"{prefix}_prepare")(params, coeffs))
    if refused:
        instance, tunable = library.system.tunables[refused - 1]
        value = getattr(getattr(params, instance), tunable.name)
        raise UserError(
            f"{instance}.{tunable.name} = {value:g} is outside {tunable.low:g} to "
            f"{tunable.high:g}.",
            f"Give a value inside ({tunable.meaning}).",
        )


class SteppedPlant:
    """A plant whose output is clamped or free, with a person in the joint or nobody."""

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
        self.variant, self.gain = variant, motor_gain
        self.delay_steps = round(delay_s / STEP_S)
        self.delay_s = self.delay_steps * STEP_S
        self.turned = frozenset(reversed_encoders)
        self.library = compiled_plant(variant.device, variant.cable, STEP_S)
        self.system = self.library.system
        self._times_s = [j * STEP_S for j in range(1, round(TICK_S / STEP_S) + 1)]
        full = {p.name: round(p.high) + 1 for p in self.system.blocks["encoders"].outputs}
        # Angle, count, and of an encoder that counts the other way its counts a turn.
        self._read_out = [
            (angle, f"count_{side}", full[f"count_{side}"] if side in self.turned else 0)
            for side, angle in ENCODERS.items()
        ]

    def start(
        self, start_rad: float, *, clamped: bool, person: Person = EMPTY
    ) -> tuple[int, int, int]:
        """From rest at an angle; the counts there, of motor side, load side and motor's shaft."""
        library, prefix = self.library, self.library.prefix
        ffi = library.ffi
        self._coeffs = ffi.new(f"{prefix}_coeffs_t *")
        self.change(clamped=clamped, person=person)
        self._state = ffi.new(f"{prefix}_state_t *")
        library.function(f"{prefix}_init")(self._coeffs, self._state)
        first, shown = start_state(self.system.blocks["plant"], start_rad, {})
        for key, vector in first.items():
            getattr(self._state.plant, key)[0 : len(vector)] = vector
        self._push = ffi.new(f"{prefix}_move_in_t *", {"theta_p_rad": start_rad})
        self._intended = (start_rad, 0.0, 0.0)
        self._plant = ffi.new(f"{prefix}_move_out_t *", shown)
        self._angles = ffi.new(f"{prefix}_encode_in_t *")
        self._counts = ffi.new(f"{prefix}_encode_out_t *")
        self._move = library.function(f"{prefix}_move_step")
        self._encode = library.function(f"{prefix}_encode_step")
        self._under_way: deque[float] = deque([0.0] * self.delay_steps)
        return self._read()

    def change(self, *, clamped: bool, person: Person = EMPTY, **more: float) -> None:
        """Somebody comes, goes, clamps the output or lets it go; everything stays where it is."""
        values = {**self.variant.values, **person.values(), "clamped": float(clamped)} | more
        prepare_plant(self.library, self._coeffs, values)

    def step(self, u_Nm: float) -> tuple[int, int, int]:
        """Hold a command for a tick; the counts at its end."""
        wanted = self.gain * u_Nm
        push, plant, line = self._push, self._plant, self._under_way
        coeffs, state, move = self._coeffs, self._state, self._move
        theta, omega, alpha = self._intended
        # Written once where neither an intent moves nor a command waits.
        moves = omega != 0 or alpha != 0
        push.omega_p_rad_s, push.theta_p_rad, push.u_Nm = omega, theta, wanted
        for t in self._times_s:
            if moves:
                push.omega_p_rad_s = omega + t * alpha
                push.theta_p_rad = theta + t * (omega + 0.5 * t * alpha)
            if line:
                line.append(wanted)
                push.u_Nm = line.popleft()
            move(coeffs, state, push, plant)
        return self._read()

    def intend(self, path: Mapping[str, float]) -> None:
        """What the person intends from the start of the next tick on."""
        self._intended = path["theta_p_rad"], path["omega_p_rad_s"], path["alpha_p_rad_s2"]
        self._push.alpha_p_rad_s2 = path["alpha_p_rad_s2"]
        self._push.noise = path["noise"]

    def truth(self) -> dict[str, float]:
        """The plant's own outputs at this moment."""
        return {p.name: float(getattr(self._plant, p.name)) for p in self._outputs}

    def torque_and_speed(self) -> tuple[float, float]:
        """Of :meth:`truth` what a run needs every tick: torque on the limb, the limb's speed."""
        return float(self._plant.tau_e_Nm), float(self._plant.omega_l_rad_s)

    @property
    def _outputs(self) -> Any:
        return self.system.blocks["plant"].outputs

    def _read(self) -> tuple[int, int, int]:
        angles, plant, counts = self._angles, self._plant, self._counts
        for angle, _, _ in self._read_out:
            setattr(angles, angle, getattr(plant, angle))
        self._encode(self._coeffs, self._state, angles, counts)
        motor, load, gear = [
            -int(getattr(counts, name)) % turned if turned else int(getattr(counts, name))
            for _, name, turned in self._read_out
        ]
        return motor, load, gear


__all__ = ["EMPTY", "MOST_DELAY_S", "SteppedPlant", "compiled_plant", "prepare_plant"]
