"""Sections of a device file that a Block cannot do without."""

from __future__ import annotations

from typing import Any

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError

FIX = 'Add it, or write extends = "elbow_drive" and give what differs.'


def section_of(device: DeviceData, name: str, needed: str = "", fix: str = FIX) -> Any:
    found = getattr(device.file, name)
    if found is None:
        why = f": {needed}" if needed else ""
        raise UserError(f"{device.origin}: section [{name}] is missing{why}.", fix)
    return found
