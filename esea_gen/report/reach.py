"""Reach of a drive: sines over its torque range, output fixed, within a stated error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.report.findings import Findings, Say
from esea_gen.twin.case import Case, Scale, Setting
from esea_gen.twin.controllers import largest_torque_Nm
from esea_gen.twin.judge import ENDED, ROUGHNESS, judge, rough_cells
from esea_gen.twin.loop_run import RanAwayError
from esea_gen.twin.run import run_case
from esea_gen.twin.trajectories import RATE_HZ, fixed_output

SHARES = 0.25, 0.5, 0.75, 1.0
FREQUENCIES_HZ = 0.25, 0.5, 1.0, 1.5
FOLLOWED = 0.1  # largest RMS error of a torque that counts as reached, over the torque's own RMS
CYCLES, SETTLING = 6, 2
FIGURES = "rms_true_Nm", *ROUGHNESS


def tried(device: Device, controller: str, plant: str, say: Say) -> tuple[dict[str, Any], ...]:
    """A run for each share of the torque range and each frequency."""
    full, found = device.tau_full_scale_Nm, []
    for frequency_Hz in FREQUENCIES_HZ:
        say(f"reach: {frequency_Hz:g} Hz")
        samples = round(CYCLES / frequency_Hz * RATE_HZ)
        sine = np.sin(2 * np.pi * frequency_Hz * np.arange(samples) / RATE_HZ)
        for share in SHARES:
            path = fixed_output("reach", share * full * sine, samples * SETTLING // CYCLES)
            point: dict[str, Any] = {"torque_Nm": share * full, "frequency_Hz": frequency_Hz}
            point |= dict.fromkeys(FIGURES)
            case = Case("reach", path)
            try:
                run = run_case(case, Setting(controller, plant), 0)
            except RanAwayError:
                found.append(point | {"followed": False})
                continue
            figures = judge(case, run, largest_torque_Nm(device), Scale.of(device).torque)
            small = figures["rms_true_Nm"] <= FOLLOWED * share * full / np.sqrt(2)
            followed = bool(small and not any(figures[k] for k in ENDED))
            found.append(point | {k: figures[k] for k in FIGURES} | {"followed": followed})
    return tuple(found)


def frontier(points: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """From the largest torque down, the points with all that is smaller and slower followed."""
    best: list[dict[str, Any]] = []
    for p in sorted(points, key=lambda p: (-p["torque_Nm"], -p["frequency_Hz"])):
        below = [
            q["followed"]
            for q in points
            if q["torque_Nm"] <= p["torque_Nm"] and q["frequency_Hz"] <= p["frequency_Hz"]
        ]
        if all(below) and (not best or p["frequency_Hz"] > best[-1]["frequency_Hz"]):
            best.append(p)
    return best


def verdict(found: Findings) -> dict[str, Any]:
    """The second verdict on a drive: how far it reaches, and how well there."""
    full = found.device.tau_full_scale_Nm
    reached = frontier(found.reach)
    several = f", axis {found.device.axes[0]}" if len(found.device.axes) > 1 else ""
    how = f"simulated, output fixed{several}; followed: RMS error at most {FOLLOWED:.0%} of "
    how += "the torque's RMS"
    if not reached:
        slowest = min(p["frequency_Hz"] for p in found.reach)
        text = f"The drive follows no torque of its {full:.3g} Nm at {slowest:g} Hz"
    else:
        first, *others = reached
        text = (
            f"The drive reaches {first['torque_Nm']:.3g} of {full:.3g} Nm "
            f"up to {first['frequency_Hz']:g} Hz (RMS error {first['rms_true_Nm']:.2g} Nm, "
            f"noise above 5 Hz {rough_cells(first)[1]})"
        )
        command, _, limited = rough_cells(first)
        how += (
            f"; there the command above 20 Hz is {command}, at its rate limit {limited} of the time"
        )
        text += "".join(f", {p['torque_Nm']:.3g} Nm up to {p['frequency_Hz']:g} Hz" for p in others)
    whole = bool(reached) and reached[0]["torque_Nm"] == max(p["torque_Nm"] for p in found.reach)
    content = {"range_Nm": full, "reached": reached, "tried": list(found.reach)}
    return {"text": text, "how": how, "whole": whole} | content
