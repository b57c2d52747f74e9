"""What was found as a device file: it goes on from the device, and says how sure each number is."""

from __future__ import annotations

import json

from esea_gen.device import Device, parse_device
from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import shipped_devices
from esea_gen.devices.numbers import Quantity
from esea_gen.errors import UserError
from esea_gen.studies.startup.drive_model import DriveModel
from esea_gen.studies.startup.regression import CONFIDENCE, Estimate

WRITTEN = ("J_kgm2", "fv_Nms_rad", "fc_Nm", "tau_c_s")
"""Keys of ``[actuator]`` that a start-up finds."""
LONGEST_NAME = 15


def updated_name(device: Device) -> str:
    """Name of the device with what was found."""
    return device.name if device.name.endswith("_id") else f"{device.name[: LONGEST_NAME - 3]}_id"


def _quantity(e: Estimate, source: str, key: str) -> Quantity:
    facts = field_facts(f"actuator.{key}")
    value = float(f"{e.value:.6g}")
    if not facts["low"] <= value <= facts["high"]:
        raise UserError(
            f"The start-up found actuator.{key} = {value:g}, outside {facts['low']:g} to "
            f"{facts['high']:g}.",
            "Look at the machine: a drive cannot be like that.",
        )
    text = f"{source}; {100 * CONFIDENCE:.0f} % interval {e.low:.4g} to {e.high:.4g}"
    return Quantity(value=value, status="identified", source=text)


def updated_device(device: Device, model: DriveModel, source: str) -> Device:
    """The device with what was found in it."""
    found = {k: _quantity(getattr(model, k), source, k) for k in WRITTEN}
    a = device.file.actuator
    assert a is not None
    file = device.file.model_copy(
        update={
            "name": updated_name(device),
            "title": f"{device.title}, as started up"[:200],
            "actuator": a.model_copy(update=found),
        }
    )
    return Device(file, f"{file.name}.toml")


def device_text(base: Device, updated: Device, model: DriveModel, said: list[str]) -> str:
    """The device file: as ``extends`` where the base is a shipped one, else whole.

    said: the verdict and its reasons, for the head.
    """
    head = [f"# {line}" for line in said] + _beside(model)
    file = updated.file
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
        for key in WRITTEN:
            q = getattr(file.actuator, key)
            lines.append(
                f'{key} = {{ value = {q.value!r}, status = "{q.status}", '
                f"source = {json.dumps(q.source, ensure_ascii=False)} }}"
            )
        text = "\n".join([*head, *lines]) + "\n"
    else:
        text = "\n".join(head) + "\n" + updated.toml()
    if parse_device(text, updated.origin).canonical() != updated.canonical():
        raise RuntimeError(f"{updated.origin} does not read back to what was found")
    return text


def _beside(m: DriveModel) -> list[str]:
    # What no key of a device file holds.
    rows = [
        ("motor's torque over its command", m.gain, ""),
        ("delay from command to encoder", m.delay_s, " s"),
        ("share of the cable's torque that is lost", m.cable_loss, ""),
        ("give of the cable", m.cable_give_rad_Nm, " rad/Nm"),
        ("whole backlash of the cable", m.backlash_rad, " rad"),
    ]
    lines = ["# Found as well, without a key of its own:"]
    lines += [f"#   {text}: {e.value:.4g}{u} ({e.low:.4g} to {e.high:.4g})" for text, e, u in rows]
    d = m.disturbance
    lines.append(
        f"#   gear's disturbance: {d.rms_Nm:.3g} Nm effective, {d.peak_Nm:.3g} Nm at most; its map "
        "is in the JSON"
    )
    return lines


__all__ = ["WRITTEN", "device_text", "updated_device", "updated_name"]
