"""Recordings for the torque check: read a CSV file and find its phases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.studies.torque_check.check import Measurement, TorqueCheck
from esea_gen.tables import MARK, read_table

# Without labels: the share of the known load above which a sample counts as loaded, and the
# shortest phase; anything shorter is the mass being hung up or taken off.
LOADED_SHARE = 0.3
SHORTEST_S = 2.0


@dataclass(frozen=True)
class CheckRecording:
    name: str
    time_s: Array
    tau_Nm: Array
    step: tuple[str, ...] | None
    read_as: str = ""


def read_recording(path: Path) -> CheckRecording:
    """Read a table with the columns ``time_s``, ``tau_Nm`` and, if labelled, ``step``."""
    table = read_table(path, ("time_s", "tau_Nm"), optional=("step",))
    time_s, tau_Nm = table.numbers("time_s"), table.numbers("tau_Nm")
    if not len(table):
        raise UserError(f"{path}: no samples.", "Record again.")
    step = table.texts("step") if "step" in table.cells else None
    name = f"{path.name}{MARK * table.simulated}"
    return CheckRecording(name, time_s, tau_Nm, step, table.report())


Phase = tuple[str, int, int]  # a step's name, its first and its last sample


def _runs(names: Sequence[str]) -> list[Phase]:
    found, at = [], 0
    for name, group in groupby(names):
        count = sum(1 for _ in group)
        found.append((name, at, at + count - 1))
        at += count
    return found


def _kinds(recording: CheckRecording, torque_Nm: float) -> list[Phase]:
    # Loaded one way, the other way, or not at all; short runs are handling, not phases.
    t, level = recording.time_s, recording.tau_Nm / (LOADED_SHARE * torque_Nm)
    names = np.select([level > 1, level < -1], ["plus", "minus"], "zero")
    long = [p for p in _runs(names.tolist()) if t[p[2]] - t[p[1]] >= SHORTEST_S]
    merged = (list(group) for _, group in groupby(long, lambda p: p[0]))
    return [(g[0][0], g[0][1], g[-1][2]) for g in merged]


def apply_recording(check: TorqueCheck, recording: CheckRecording) -> tuple[Measurement, ...]:
    t = recording.time_s
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        raise UserError(
            f"{recording.name}: the time does not rise from {t[back[0]]:g} s to "
            f"{t[back[0] + 1]:g} s.",
            "Give one recording with rising times.",
        )
    missing = check.missing
    if recording.step is not None:
        phases = [p for p in _runs(recording.step) if p[0]]
        expected = [s.label for s in missing]
    else:
        phases = _kinds(recording, check.known.torque_Nm)
        expected = [s.kind for s in missing]
    before = list(check.measurements)
    try:
        out = _record_all(check, recording, phases, expected)
    except UserError:
        check.measurements[:] = before  # all of a recording, or nothing
        raise
    if not out:
        raise UserError(f"{recording.name}: no phase was found.", "Label the steps.")
    return tuple(out)


def _record_all(
    check: TorqueCheck, recording: CheckRecording, phases: list[Phase], expected: list[str]
) -> list[Measurement]:
    t, missing = recording.time_s, check.missing
    out = []
    for i, (name, first, last) in enumerate(phases):
        if i >= len(expected) or name != expected[i]:
            wanted = f"{missing[i].label} comes there" if i < len(missing) else "no step is left"
            hint = (
                f"Labels, in order: {', '.join(s.label for s in missing[i:]) or 'none'}."
                if recording.step is not None
                else "Record in the order of the procedure, or add a column step with its labels."
            )
            raise UserError(
                f"{recording.name}: the phase from {t[first]:.3g} to {t[last]:.3g} s is "
                f"'{name}', but {wanted}.",
                hint,
            )
        part = slice(first, last + 1)
        out.append(check.record(missing[i].label, t[part], recording.tau_Nm[part], recording.name))
    return out
