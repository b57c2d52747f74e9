"""Conditions of recordings (rates, amplitudes, temperatures), and splits that leave one out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from esea_gen.errors import UserError, nearest
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.tables import Cycles
from esea_gen.identify.recording.temperatures import temperature_name

# With fewer, leaving one out leaves too little, or one on one side only.
LEAST_CONDITIONS = 3


@dataclass(frozen=True)
class Split:
    """Recordings, divided into what trains and what judges."""

    condition: str  # what judges; of the file's own division "last cycles" or "as declared"
    recordings: tuple[Recording, ...]
    declared: bool  # whether it is the file's own division
    whole: bool  # whether a whole condition is left out


def conditions_of(recording: Recording, data: DataSet) -> tuple[str, ...]:
    """The conditions of a data set: the mapping's, else its own label."""
    return recording.conditions or (data.label,)


def _names_of(recording: Recording, data: DataSet) -> tuple[str, ...]:
    # With its temperature, which is a condition too.
    own = conditions_of(recording, data)
    return own if recording.temperature_C is None else (temperature_name(recording), *own)


def splits_of(recordings: Sequence[Recording]) -> tuple[Split, ...]:
    """The file's own division, and one split for each condition left out as a whole."""
    # A condition that is just what the file holds out stands for both; one that has the same files
    # as another, as where a temperature has one file, is tried once.
    used = [(r, s) for r in recordings for s in r.sets if len(s.training) or len(s.held_out)]
    warm = [temperature_name(r) for r, _ in used if r.temperature_C is not None]
    known = list(dict.fromkeys([*warm, *(c for r, s in used for c in conditions_of(r, s))]))
    mixed = any(len(s.training) and len(s.held_out) for _, s in used)
    judged = {s.label for _, s in used if len(s.held_out)}
    splits: list[Split] = []
    tried: list[set[str]] = []
    for c in known:
        inside = {s.label for r, s in used if c in _names_of(r, s)}
        if len(inside) == len(used):  # nothing would be left to train on
            continue
        if warm and inside in tried:
            continue
        tried.append(inside)
        same = not mixed and inside == judged
        splits.append(Split(c, tuple(_without(r, c) for r in recordings), same, True))
    if not any(s.declared for s in splits):
        name = "last cycles" if mixed else "as declared"
        splits.insert(0, Split(name, tuple(recordings), True, False))
    return tuple(splits)


def divided(recordings: list[Recording], rules: Cycles) -> list[Recording]:
    """Recordings as their mapping divides them: with ``hold_out``, a whole condition judges."""
    # Where the mapping says neither which condition nor how many cycles to hold out, and every file
    # is used by cycles, the condition of middle amplitude is held out: what lies inside.
    used = [(r, s) for r in recordings for s in r.sets if len(s.training) or len(s.held_out)]
    known = list(dict.fromkeys(c for r, s in used for c in conditions_of(r, s)))
    asked = rules.hold_out
    if asked is not None:
        every = list(dict.fromkeys(c for r, s in used for c in _names_of(r, s)))
        if asked not in every or len(every) < 2:
            raise UserError(
                f"cycles.hold_out = '{asked}' is no condition that could be left out.",
                f"{nearest(asked, every)}There are: {', '.join(every)}; two at least are needed.",
            )
    elif rules.hold_out_last is None and len(known) >= LEAST_CONDITIONS:
        mixed = all(len(s.training) and len(s.held_out) for _, s in used)
        if mixed and all(len(conditions_of(r, s)) == 1 for r, s in used):
            sizes = {
                c: float(np.mean([s.amplitude_rad for r, s in used if c in conditions_of(r, s)]))
                for c in known
            }
            asked = sorted(known, key=lambda c: sizes[c])[len(known) // 2]
    return recordings if asked is None else [_without(r, asked) for r in recordings]


def _without(recording: Recording, condition: str) -> Recording:
    sets = []
    for s in recording.sets:
        every = np.union1d(s.training, s.held_out).astype(np.intp)
        out = condition in _names_of(recording, s)
        training, held_out = (every[:0], every) if out else (every, every[:0])
        sets.append(replace(s, training=training, held_out=held_out))
    return replace(recording, sets=tuple(sets))
