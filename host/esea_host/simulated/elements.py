"""A linear spring in the elastomer's place, for the virtual plant; the board keeps its law."""

from __future__ import annotations

from typing import Any

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError


def with_spring(device: DeviceData, stiffness_Nm_rad: float) -> DeviceData:
    """The device with an ideal spring in its coupling."""
    if not 0.1 <= stiffness_Nm_rad <= 1000:
        raise UserError(f"A spring of {stiffness_Nm_rad:g} Nm/rad.", "Give 0.1 to 1000 Nm/rad.")
    rubber = device.file.elastomer
    if rubber is None or rubber.maxwell is None:
        raise UserError(
            f"{device.name}: only a device with [elastomer.maxwell] can carry a spring.",
            "Take one such as elbow_drive.",
        )

    def to(quantity: Any, value: float) -> Any:
        return quantity.model_copy(update={"value": value})

    spring = {
        "k1_Nm_rad": to(rubber.k1_Nm_rad, stiffness_Nm_rad),
        "k3_Nm_rad3": to(rubber.k3_Nm_rad3, 0.0),
        "alpha_Nm_rad": to(rubber.alpha_Nm_rad, 0.0),
        "maxwell": rubber.maxwell.model_copy(
            update={"kv_Nm_rad": to(rubber.maxwell.kv_Nm_rad, 0.0)}
        ),
    }
    element = rubber.model_copy(update=spring)
    file = device.file.model_copy(update={"elastomer": element})
    return DeviceData(file, device.origin)
