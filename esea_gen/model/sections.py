"""Access to a device file for Blocks: required sections, numbers as tunables."""

from __future__ import annotations

from typing import Any

from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.ports import Constant, Tunable

FIX = 'Add it, or write extends = "elbow_drive" and give what differs.'


def section_of(device: DeviceData, name: str, needed: str = "", fix: str = FIX) -> Any:
    found = getattr(device.file, name)
    if found is None:
        why = f": {needed}" if needed else ""
        raise UserError(f"{device.origin}: section [{name}] is missing{why}.", fix)
    return found


def file_tunable(dotted: str, c: Constant) -> Tunable:
    """A number of a device file as a tunable, within the bounds of its field."""
    facts = field_facts(dotted)
    bounds = facts["low"], facts["high"], facts["text"]
    return Tunable(c.name, c.value, *bounds, c.source, c.status)
