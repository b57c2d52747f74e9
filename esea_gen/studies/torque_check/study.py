"""What to do in a torque check, before anything is recorded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from esea_gen.studies.registry import Study
from esea_gen.studies.torque_check.check import COVERAGE, RECORD_S, SETTLE_S, TorqueCheck
from esea_gen.studies.torque_check.procedure import LIMITS, load_range_Nm, procedure

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData


class TorqueCheckStudy(Study):
    """Check the torque sensor with a hanging mass: procedure, limits, a recording's verdict."""

    name = "torque-check"
    title = "Check of the torque sensor"


def instructions(device: DeviceData, check: TorqueCheck | None = None) -> list[str]:
    """The procedure and its limits as lines of text; ``check`` once the load is known."""
    low, high = load_range_Nm(device)
    full = device.tau_full_scale_Nm
    settle, record = (check.settle_s, check.record_s) if check else (SETTLE_S, RECORD_S)
    lines = [f"Torque check of {device.name} ({device.title}), full scale {full:g} Nm"]
    if check is None:
        lines.append(
            f"Choose a mass and an arm that give {low:.3g} to {high:.3g} Nm: at 0.2 m "
            f"{math.ceil(1000 * low / 9.81 / 0.2) / 1000:g} to "
            f"{math.floor(1000 * high / 9.81 / 0.2) / 1000:g} kg."
        )
    else:
        r = check.known
        lines.append(
            f"Known load: {r.torque_Nm:.4g} Nm, known to {COVERAGE * r.u_torque_Nm:.2g} Nm (95 %)"
        )
    lines.append(
        f"Hold the motor still.  Each step: do it, wait {settle:g} s, record {record:g} s, both in "
        "one recording."
    )
    steps = check.steps if check else procedure()
    lines += [f"{i:3d}. {s.label:9}{s.text}" for i, s in enumerate(steps, 1)]
    lines.append("Limits:")
    lines += [
        f"  {x.name}: {x.percent:g} % of full scale, {x.percent / 100 * full:.3g} Nm"
        + (f", and {x.load_percent:g} % of the load" if x.load_percent else "")
        + f"; {x.what}.  Why: {x.reason}."
        for x in LIMITS
    ]
    return lines
