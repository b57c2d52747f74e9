"""What a bring-up asks of a device: one drive, and room to turn."""

from __future__ import annotations

from esea_gen.device import Device
from esea_gen.errors import UserError

MARGIN_RAD, LEAST_SPAN_RAD = 0.1, 1.0


def require_drive(device: Device) -> None:
    """Refuse a device without a drive, or with several."""
    if device.drive is None:
        raise UserError(
            f"{device.origin}: the device has no drive to start up.",
            'Write extends = "elbow_drive" in it.',
        )
    if len(device.axes) > 1:
        raise UserError(
            f"{device.origin}: it has {len(device.axes)} axes; a start-up is of one drive.",
            "Give a device file of one axis alone.",
        )


def travel(device: Device) -> tuple[float, float]:
    """Within what the joint is turned, ends included."""
    s = device.file.safety
    assert s is not None
    low, high = s.rom_min_rad.value + MARGIN_RAD, s.rom_max_rad.value - MARGIN_RAD
    if high - low < LEAST_SPAN_RAD:
        raise UserError(
            f"{device.origin}: the joint may turn by {high - low:.2f} rad between "
            f"safety.rom_min_rad and rom_max_rad less {MARGIN_RAD:g} rad at either end; "
            f"{LEAST_SPAN_RAD:g} rad are needed to tell friction from the gear's disturbance.",
            "Widen the range for the start-up, with the joint empty.",
        )
    return low, high
