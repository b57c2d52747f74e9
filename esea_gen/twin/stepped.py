"""Virtual exoskeleton stepped by ticks: command in, encoder counts out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

from esea_gen.devices.file import DeviceData
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import CoupledHand
from esea_gen.twin.hand_plant import grouped, prepared, twin_system
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


@lru_cache(maxsize=4)
def compiled_plant(device: DeviceData, cable: bool, step_s: float) -> HostLibrary:
    """The plant of a device, compiled once in a process."""
    return compile_system(twin_system(device, cable, step_s, TICK_S), "f64")


class SteppedTwin:
    """A plant driven tick by tick: motor commands in, encoder counts by the board's input out.

    Who is in it is a person, of a plant with two axes a hand.
    """

    def __init__(self, variant: PlantVariant) -> None:
        self.variant, self.axes = variant, variant.device.axes
        self.library = compiled_plant(variant.device, variant.cable, variant.step_s)
        self.system = self.library.system
        steps = round(TICK_S / variant.step_s)
        self._times_s = [j * variant.step_s for j in range(1, steps + 1)]
        names = ("u_Nm", "theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "noise", "tau_muscle_Nm")
        self._inputs = [tuple(of_axis(n, a) for n in names) for a in self.axes]
        self._muscles = len(self.axes) > 1
        felt = ("tau_e_Nm", "omega_l_rad_s", "theta_l_rad")
        self._felt = [tuple(of_axis(n, a) for n in felt) for a in self.axes]
        move, encode = self.system.task("move"), self.system.task("encode")
        self._outputs = [x.name for x in self.system.task_outputs(move)]
        self._angles_read = [x.name for x in self.system.task_inputs(encode)]
        self._counts_read = [x.name for x in self.system.task_outputs(encode)]

    def change(
        self,
        *,
        person: Person | CoupledHand | None = None,
        clamped: bool | Sequence[bool] | None = None,
        **more: float,
    ) -> None:
        """Somebody comes, goes, clamps the output or lets it go; everything stays where it is.

        Default: the variant's own, and what of it is clamped; ``clamped`` is for all axes or each.
        """
        values = dict(self.variant.values)
        if person is not None:
            own = person.values(self.axes) if isinstance(person, CoupledHand) else person.values()
            held = {of_axis("clamped", a) for a in self.axes}
            values |= {n: x for n, x in own.items() if n not in held}
        if clamped is not None:
            fixed = [clamped] * len(self.axes) if isinstance(clamped, bool) else clamped
            for axis, one in zip(self.axes, fixed, strict=True):
                values[of_axis("clamped", axis)] = float(one)
        library, groups = self.library, grouped(self.system, values | more)
        self._coeffs = prepared(library.ffi, library.function, library, groups)

    def start(
        self,
        angles_rad: Sequence[float],
        *,
        person: Person | CoupledHand | None = None,
        clamped: bool | Sequence[bool] | None = None,
    ) -> dict[str, int]:
        """Start at rest at one angle an axis, as :meth:`change` has it; the counts there."""
        library, prefix = self.library, self.library.prefix
        ffi = library.ffi
        self._state = ffi.new(f"{prefix}_state_t *")
        self.change(person=person, clamped=clamped)
        library.function(f"{prefix}_init")(self._coeffs, self._state)
        sampled: dict[str, float] = {}
        for axis, angle in zip(self.axes, angles_rad, strict=True):
            first, shown = start_state(self.system.blocks["plant"], angle, axis)
            sampled |= shown
            for key, vector in first.items():
                getattr(self._state.plant, key)[0 : len(vector)] = vector
        self._push = ffi.new(f"{prefix}_move_in_t *")
        self._plant = ffi.new(f"{prefix}_move_out_t *", sampled)
        self._encoded = ffi.new(f"{prefix}_encode_in_t *")
        self._counts = ffi.new(f"{prefix}_encode_out_t *")
        self._move = library.function(f"{prefix}_move_step")
        self._encode = library.function(f"{prefix}_encode_step")
        self.intend([{"theta_p_rad": float(x)} for x in angles_rad])
        return self._read()

    def intend(self, paths: Sequence[Mapping[str, float]]) -> None:
        """Set the intention from the start of the next tick on; within it the path continues.

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

    def step(self, u_Nm: Sequence[float]) -> dict[str, int]:
        """Hold one command an axis for a tick; the counts at its end."""
        push, move = self._push, self._move
        for names, u in zip(self._inputs, u_Nm, strict=True):
            setattr(push, names[0], u)
        for t in self._times_s:
            for theta, omega, at, speed, gain in self._moving:
                setattr(push, omega, speed + t * gain)
                setattr(push, theta, at + t * (speed + 0.5 * t * gain))
            move(self._coeffs, self._state, push, self._plant)
        return self._read()

    def truth(self) -> dict[str, float]:
        """The plant's own outputs at this moment, such as ``tau_e_Nm``."""
        return {n: float(getattr(self._plant, n)) for n in self._outputs}

    def felt(self) -> list[list[float]]:
        """Part of :meth:`truth` that a run needs at every tick: limb torques, speeds and angles."""
        return [[float(getattr(self._plant, n)) for n in names] for names in self._felt]

    def _read(self) -> dict[str, int]:
        encoded, plant = self._encoded, self._plant
        for name in self._angles_read:
            setattr(encoded, name, getattr(plant, name))
        self._encode(self._coeffs, self._state, encoded, self._counts)
        return {n: int(getattr(self._counts, n)) for n in self._counts_read}
