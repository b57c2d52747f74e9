"""Identify the installed compliant element from encoders under a known load.

The board's torque is that of the elastomer's model, for any installed element.  Independent of it
are the deflection, from the encoders on either side of the coupling, and the torque of a hanging
mass. Five phases (unloaded, loaded one way, unloaded, the other way, unloaded) give two numbers::

    stiffness = 2 T / |d_plus - d_minus|
    memory    = (d_after_plus - d_after_minus) / (d_plus - d_minus)

The memory is the share of the deflection that stays after the mass is taken off: nothing with an
ideal spring, 7 to 12 % with the elastomer of table 3.2.  It separates elements of equal stiffness.

Limitations: springs within the limit on stiffness are not distinguished; friction between mass and
coupling counts as memory; an encoder's error within the deflection counts as stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.model.rubber import rubber_sensor
from esea_gen.studies.torque_check.procedure import KnownLoad
from esea_host.interaction.design import ELASTOMER, SPRING
from esea_host.interaction.loading import Array
from esea_host.interaction.rig import PUBLISHED_NM_DEG, simulated_loading

EQUAL = "equal"
COVERAGE = 2.0  # of an expanded uncertainty, 95 %
STIFFNESS_LIMIT = 0.10  # an elastomer's own spread over temperature and age; assumed
MEMORY_LIMIT = 0.05  # half of the least memory of an elastomer under a load of use
PHASES = ("unloaded", "loaded one way", "unloaded", "loaded the other way", "unloaded")


def spring_Nm_rad(device: Device, element: str, stiffness_Nm_deg: float = 0.0) -> float:
    """Stiffness of a spring for a device; 0 for its own elastomer."""
    if element == ELASTOMER:
        return 0.0
    if stiffness_Nm_deg:
        return math.degrees(stiffness_Nm_deg)
    ratio = PUBLISHED_NM_DEG[SPRING] / PUBLISHED_NM_DEG[ELASTOMER] if element == SPRING else 1.0
    return ratio * simulated_loading(device).stiffness_Nm_rad


@dataclass(frozen=True)
class CouplingNumbers:
    """Stiffness under a load, and the share of the deflection that stays when it is taken off."""

    stiffness_Nm_rad: float
    memory: float


def expected(device: Device, element: str, load_Nm: float, spring: float) -> CouplingNumbers:
    """Expected values of an element under a load; the elastomer by the device's static law."""
    if element != ELASTOMER:
        return CouplingNumbers(spring, 0.0)
    most = float(device.sensor.inputs[0].high)
    theta = np.linspace(0.0, most, 4000)
    tau = _static_Nm(device, theta)
    reached = int(np.searchsorted(tau, load_Nm))
    if reached == len(tau):
        raise UserError(
            f"The mass makes {load_Nm:.3g} Nm; the law of {device.name} ends at {tau[-1]:.3g} Nm.",
            "Hang a lighter mass, or on a shorter arm.",
        )
    bent = float(np.interp(load_Nm, tau[: reached + 1], theta[: reached + 1]))
    there = np.linspace(0.0, bent, 2000)
    tau = _static_Nm(device, np.concatenate([there, there[::-1]]))[2000:]
    stays = float(np.interp(0.0, tau[::-1], there))
    return CouplingNumbers(load_Nm / bent, stays / bent)


@lru_cache(maxsize=4)
def _static_law(device: Device) -> Block:
    # Without the Maxwell element, which has relaxed within a second.
    rubber = device.elastomer
    if rubber.maxwell is None:
        return device.sensor
    still = rubber.maxwell.kv_Nm_rad.model_copy(update={"value": 0.0})
    maxwell = rubber.maxwell.model_copy(update={"kv_Nm_rad": still})
    element = rubber.model_copy(update={"maxwell": maxwell})
    file = device.file.model_copy(update={"elastomer": element})
    return rubber_sensor(DeviceData(file, device.origin))


def _static_Nm(device: Device, theta_rad: Array) -> Array:
    given = {"theta_rad": theta_rad, "omega_rad_s": np.zeros_like(theta_rad)}
    found, _ = _static_law(device).simulator().run(given)
    return np.asarray(np.ravel(found["tau_Nm"]), np.float64)


@dataclass(frozen=True)
class ElementFinding:
    element: str
    load_Nm: float
    deflections_rad: tuple[float, ...]
    measured: CouplingNumbers
    u_stiffness: float  # expanded (95 %), a share of the stiffness
    u_memory: float  # expanded (95 %)
    expected: Mapping[str, CouplingNumbers]
    fits: tuple[str, ...]

    @property
    def problem(self) -> str:
        """Why the element is not confirmed: value, limit, remedy; empty where it is."""
        if self.element in self.fits:
            return ""
        m, wanted = self.measured, self.expected[self.element]
        off, stays = m.stiffness_Nm_rad / wanted.stiffness_Nm_rad - 1, m.memory - wanted.memory
        like = f"It measures as: {', '.join(self.fits)}." if self.fits else "It is neither."
        return (
            f"The coupling has {math.radians(m.stiffness_Nm_rad):.4f} Nm/deg at "
            f"{self.load_Nm:.3g} Nm, {100 * off:+.1f} % off the {self.element} of the protocol, "
            f"allowed {100 * (STIFFNESS_LIMIT - self.u_stiffness):.1f} %; {100 * m.memory:.1f} % "
            f"of the deflection stays after unloading, {100 * stays:+.1f} % off, allowed "
            f"{100 * (MEMORY_LIMIT - self.u_memory):.1f} %. {like} Build in the {self.element}, "
            "unload and zero the joint, then continue"
        )

    def to_dict(self) -> dict[str, Any]:
        limits = {"stiffness_limit": STIFFNESS_LIMIT, "memory_limit": MEMORY_LIMIT}
        return {**asdict(self), **limits, "confirmed": not self.problem}


def judge(
    device: Device,
    element: str,
    known: KnownLoad,
    deflections_rad: Sequence[float],
    stiffness_Nm_deg: float = 0.0,
) -> ElementFinding:
    """Judge the means of the five phases."""
    _, plus, between, minus, last = deflections_rad
    count = 2 * math.pi / 2 ** round(device.file.encoder.resolution_bits.value)
    u_rad = count / math.sqrt(6)  # two encoders, each within half a count
    width = plus - minus
    zero = float(np.mean(deflections_rad[::2]))
    if (plus - zero) * (minus - zero) >= 0 or abs(width) < 40 * count:
        raise UserError(
            f"The mass bent the coupling by {math.degrees(plus - zero):.2f} and "
            f"{math.degrees(minus - zero):.2f} deg; {math.degrees(20 * count):.2f} deg are needed, "
            "one way and the other.",
            "Hang it on one side and then on the other, or take a heavier one.",
        )
    load_Nm = known.torque_Nm
    measured = CouplingNumbers(2 * load_Nm / abs(width), (between - last) / width)
    relative = known.u_torque_Nm / load_Nm, math.sqrt(2) * u_rad / abs(width)
    u_stiffness, u_memory = COVERAGE * math.hypot(*relative), COVERAGE * relative[1]
    for what, u, limit in (
        ("stiffness", u_stiffness, STIFFNESS_LIMIT),
        ("memory", u_memory, MEMORY_LIMIT),
    ):
        if u > limit / 2:
            raise UserError(
                f"With this mass the {what} is uncertain by {100 * u:.1f} % (95 %), at most "
                f"{50 * limit:.1f} % is needed.",
                "Take a heavier mass or a longer lever, and measure both well.",
            )
    given = {e: stiffness_Nm_deg if e == element else 0.0 for e in (SPRING, ELASTOMER, EQUAL)}
    shown = {e: expected(device, e, load_Nm, spring_Nm_rad(device, e, k)) for e, k in given.items()}
    fits = tuple(
        e
        for e, x in shown.items()
        if abs(measured.stiffness_Nm_rad / x.stiffness_Nm_rad - 1) <= STIFFNESS_LIMIT - u_stiffness
        and abs(measured.memory - x.memory) <= MEMORY_LIMIT - u_memory
    )
    given_rad = tuple(float(x) for x in deflections_rad)
    return ElementFinding(element, load_Nm, given_rad, measured, u_stiffness, u_memory, shown, fits)
