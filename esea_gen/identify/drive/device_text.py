"""Identified numbers of a drive as a device file, each with its interval."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from esea_gen.device import Device, parse_device
from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import shipped_devices
from esea_gen.devices.numbers import Quantity, toml_entry
from esea_gen.errors import UserError
from esea_gen.identify.drive.regression import CONFIDENCE, Estimate

LONGEST_NAME = 15


def _quantity(e: Estimate, source: str, key: str) -> Quantity:
    facts = field_facts(f"actuator.{key}")
    value = float(f"{e.value:.6g}")
    # An estimate of a missing gap or ripple scatters about 0.
    value = 0.0 if e.low <= 0 <= e.high and facts["low"] == 0 else value
    if not facts["low"] <= value <= facts["high"]:
        raise UserError(
            f"The recording gives actuator.{key} = {value:g}, outside {facts['low']:g} to "
            f"{facts['high']:g}.",
            "Check the recording and the machine: no drive has such a value.",
        )
    text = f"{source}; {100 * CONFIDENCE:.0f} % interval {e.low:.4g} to {e.high:.4g}"
    return Quantity(value=value, status="identified", source=text)


def with_actuator(device: Device, found: Mapping[str, Estimate], source: str) -> Device:
    a = device.file.actuator
    assert a is not None
    numbers = {k: _quantity(e, source, k) for k, e in found.items()}
    encoder, name = device.file.encoder, device.name
    # Written as an extension, which takes no zeros over.
    encoder = encoder.unzeroed() if device.given[0] in shipped_devices() else encoder
    file = device.file.model_copy(
        update={
            "name": name if name.endswith("_id") else f"{name[: LONGEST_NAME - 3]}_id",
            "title": f"{device.title}, friction identified"[:200],
            "encoder": encoder,
            "actuator": a.model_copy(update=numbers),
        }
    )
    return Device(file, f"{file.name}.toml")


def actuator_text(base: Device, updated: Device, head: Sequence[str]) -> str:
    """A device file: as ``extends`` where the base is a shipped one, else whole."""
    file, before = updated.file, base.file.actuator
    if base.given[0] in shipped_devices():
        assert file.actuator is not None
        lines = [
            "schema = 1",
            f"extends = {json.dumps(base.given[0])}",
            f"name = {json.dumps(file.name)}",
            f"title = {json.dumps(file.title, ensure_ascii=False)}",
            "",
            "[actuator]",
        ]
        every = ((k, getattr(file.actuator, k)) for k in type(file.actuator).model_fields)
        lines += [toml_entry(k, q) for k, q in every if q != getattr(before, k)]
        text = "\n".join([*head, *lines]) + "\n"
    else:
        text = "\n".join(head) + "\n" + updated.toml()
    if parse_device(text, updated.origin).canonical() != updated.canonical():
        raise RuntimeError(f"{updated.origin} does not read back to what was found")
    return text
