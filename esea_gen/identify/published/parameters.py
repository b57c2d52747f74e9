"""The elastomer's parameters: their bounds, and devices that have others."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from esea_gen.device import Device
from esea_gen.devices.fields import field_facts
from esea_gen.devices.numbers import Quantity, Section
from esea_gen.devices.rubber import Elastomer
from esea_gen.model.elastomer import RATE_KEYS

EPS2_DEFAULT = 0.013  # the published elbow's value; any other gives the same torque


@cache
def bounds_of(key: str) -> tuple[float, float]:
    """Bounds of an elastomer parameter, those of the device file."""
    dotted = f"elastomer.maxwell.{key}" if key in RATE_KEYS else f"elastomer.{key}"
    extra = field_facts(dotted)
    return float(extra["low"]), float(extra["high"])


def at_bound(key: str, value: float) -> str | None:
    """Whether a parameter sits at a bound."""
    low, high = bounds_of(key)
    # The viscosity's numbers have no scale of their own: only 0 itself is a lower bound of 0.
    if value <= low * (1 + 1e-6):
        return "lower"
    return "upper" if value >= high * (1 - 1e-6) else None


def with_parameters(elastomer: Elastomer, values: Mapping[str, Quantity]) -> Elastomer:
    """An elastomer with other numbers by key, those of its Maxwell element included."""
    put = elastomer.model_copy(update=_known(elastomer, values))
    if put.maxwell is None:
        return put
    maxwell = put.maxwell.model_copy(update=_known(put.maxwell, values))
    return put.model_copy(update={"maxwell": maxwell})


def with_values(
    device: Device, values: Mapping[str, float], **sections: Mapping[str, float]
) -> Device:
    """A device with other numbers, for simulation."""

    def trial(numbers: Mapping[str, float]) -> dict[str, Quantity]:
        return {
            k: Quantity(value=float(v), status="identified", source="trial")
            for k, v in numbers.items()
        }

    update: dict[str, Section] = {"elastomer": with_parameters(device.elastomer, trial(values))}
    for key, numbers in sections.items():
        section = getattr(device.file, key)
        update[key] = section.model_copy(update=_known(section, trial(numbers)))
    return Device(device.file.model_copy(update=update), device.origin)


def _known(section: Section, values: Mapping[str, Quantity]) -> dict[str, Quantity]:
    return {k: q for k, q in values.items() if k in type(section).model_fields}
