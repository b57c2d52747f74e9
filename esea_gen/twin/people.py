"""Plants and people to run: the standard ones, and draws from their families."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.errors import choose
from esea_gen.twin.parameters import CABLE_KEYS, STEP_S
from esea_gen.twin.published import PEOPLE, PLANTS, Person

PLANT_NAMES = ("ideal", "real", "random")


def random_person(seed: int) -> Person:
    rng = np.random.default_rng([seed, 2])
    family = vars(PLANTS.random)
    keys = [f.name for f in dataclasses.fields(Person) if f.name in family]
    drawn = {k: float(rng.uniform(*family[k])) for k in keys}
    return dataclasses.replace(PEOPLE["uncertain"], **drawn)  # type: ignore[arg-type]


# Of a person, what goes with the limb's inertia; the rest are frequencies and choices.
_OF_LIMB = [k for k in Person.__annotations__ if k.endswith(("kgm2", "_Nm", "_Nm_rad", "_Nms_rad"))]
# Of the cable, what goes with its stiffness; the rest are angles, speeds and shares.
OF_CABLE = [k for k in CABLE_KEYS if k.startswith("motor_side_")]
OF_CABLE += ["cable_stiffness_Nm_rad", "cable_damping_Nms_rad"]


def limb_of(device: DeviceData, person: Person) -> Person:
    """A person whose limb has the inertia that goes with a device's joint, not with the elbow's."""
    joint = device.file.joint
    share = joint.Jh_kgm2.value / PEOPLE["ideal"].Jh_kgm2 if joint else 1.0
    return dataclasses.replace(person, **{k: share * getattr(person, k) for k in _OF_LIMB})


@dataclass(frozen=True)
class PlantVariant:
    """A plant: how it is built, and the tunables that differ from the Blocks' defaults."""

    device: DeviceData
    cable: bool  # compliant; else rigid, by construction
    values: Mapping[str, float] = field(default_factory=dict)
    step_s: float = STEP_S

    def having(self, person: Person | None = None, **values: float) -> PlantVariant:
        more = (person.values() if person else {}) | values
        return dataclasses.replace(self, values={**self.values, **more})


def ideal_plant(device: DeviceData, person: str = "ideal") -> PlantVariant:
    """The nominal plant: device file's drive, rigid cable, no disturbance, full encoders."""
    return PlantVariant(device, False).having(PEOPLE[person])


def gear_disturbance(rms_rad_s2: float, seed: int) -> dict[str, float]:
    rng = np.random.default_rng([seed, 1])
    out = {"gear_disturbance_rms_rad_s2": rms_rad_s2}
    for i, band in enumerate(PLANTS.disturbance.bands_1_rad, 1):
        out[f"wave_{i}_1_rad"] = float(rng.uniform(*band))
        out[f"phase_{i}_rad"] = float(rng.uniform(0, 2 * math.pi))
    return out


def _bits(device: DeviceData) -> dict[str, float]:
    # The device's own joint encoders: coarser ones would look like ones with a bit that is stuck.
    assert device.file.actuator is not None
    joint, motor = device.file.encoder.resolution_bits, device.file.actuator.encoder_bits
    return {
        "joint_encoder_bits": joint.value,
        "motor_encoder_bits": min(float(PLANTS.real.motor_encoder_bits), motor.value),
    }


def stiffer(device: DeviceData) -> float:
    """Stiffness of a device's cable over the elbow's."""
    redundancy = device.file.redundancy
    own = redundancy.cable_Nm_rad.value if redundancy else PLANTS.real.cable_stiffness_Nm_rad
    return float(own / PLANTS.real.cable_stiffness_Nm_rad)


def real_plant(device: DeviceData, person: str = "uncertain", seed: int = 0) -> PlantVariant:
    """The standard plant: more friction, cable with backlash and loss, disturbance, encoders."""
    r, a = PLANTS.real, device.file.actuator
    assert a is not None
    values = {k: float(getattr(r, k)) for k in CABLE_KEYS} | _bits(device)
    values |= {k: stiffer(device) * values[k] for k in OF_CABLE}
    values |= {
        "fv_Nms_rad": r.friction_scale * a.fv_Nms_rad.value,
        "fc_Nm": r.friction_scale * a.fc_Nm.value,
    }
    values |= gear_disturbance(r.gear_disturbance_rms_rad_s2, seed)
    return PlantVariant(device, True, values).having(PEOPLE[person])


def named_plant(name: str, device: DeviceData, seed: int) -> PlantVariant:
    choose("plant", name, PLANT_NAMES)
    if name == "random":
        return random_plant(device, seed)
    return ideal_plant(device) if name == "ideal" else real_plant(device, seed=seed)


def random_plant(device: DeviceData, seed: int) -> PlantVariant:
    a, family = device.file.actuator, PLANTS.random
    assert a is not None
    rng = np.random.default_rng([seed, 0])
    draw = {
        "fv_Nms_rad": a.fv_Nms_rad.value * rng.uniform(*family.friction_scale),
        "fc_Nm": a.fc_Nm.value * rng.uniform(*family.friction_scale),
        "J_kgm2": a.J_kgm2.value * rng.uniform(*family.inertia_scale),
        "tau_c_s": a.tau_c_s.value * rng.uniform(*family.lag_scale),
        "cable_stiffness_Nm_rad": stiffer(device) * rng.uniform(*family.cable_stiffness_Nm_rad),
        "cable_backlash_rad": rng.uniform(*family.cable_backlash_rad),
        "cable_loss": rng.uniform(*family.cable_loss),
    }
    rms = float(rng.uniform(*family.gear_disturbance_rms_rad_s2))
    values = {k: float(v) for k, v in draw.items()} | gear_disturbance(rms, seed)
    return real_plant(device).having(random_person(seed), **values)
