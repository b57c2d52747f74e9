"""Standard plants, people and trajectories: the numbers of ``plants.toml``."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass
from importlib import resources
from types import SimpleNamespace
from typing import Any


@dataclass(frozen=True)
class Person:
    """A person: limb, and how it is moved along the intended path."""

    Jh_kgm2: float
    spring_Nm_rad: float  # pull towards the intended path
    damping_Nms_rad: float
    feedforward: bool  # also gives the torque that the intended path needs
    own_damping_Nms_rad: float
    gravity_Nm: float  # times the sine of the angle, towards full extension
    torque_noise_Nm: float  # effective value, first order with the next bandwidth
    torque_noise_Hz: float
    clamped: bool = False  # no person: the load is held where it starts

    def values(self) -> dict[str, float]:
        return {k: float(v) for k, v in vars(self).items()}


def _table(held: Any) -> Any:
    # Keys that are no names, such as angles, stay keys.
    if not isinstance(held, dict):
        return tuple(map(_table, held)) if isinstance(held, list) else held
    inner = {k: _table(v) for k, v in held.items()}
    return SimpleNamespace(**inner) if all(k.isidentifier() for k in inner) else inner


_TEXT = (resources.files("esea_gen") / "twin" / "plants.toml").read_text(encoding="utf-8")
PLANTS: Any = _table(tomllib.loads(_TEXT))
"""The whole file, a table by its name; ``PLANTS.twist`` by the cable's angle in degrees."""
PEOPLE = {name: Person(**person) for name, person in tomllib.loads(_TEXT)["person"].items()}
PEOPLE["none"] = dataclasses.replace(PEOPLE["ideal"], clamped=True)
"""The people that have names: ``ideal``, ``uncertain``, and ``none`` (the load is clamped)."""
