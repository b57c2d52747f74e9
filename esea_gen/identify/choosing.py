"""Identify a device with the torque model that held-out data select."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from esea_gen.identify.family.choice import THESIS
from esea_gen.identify.family.compare import ModelComparison, compare
from esea_gen.identify.family.identification import identify_member
from esea_gen.identify.identification import identify
from esea_gen.identify.identified import Identified
from esea_gen.identify.published.fit import Progress, part_of
from esea_gen.identify.published.search_problem import Searching
from esea_gen.identify.recording.mapping import load_mapping

CHOSEN = "chosen"
COMPARING = 0.85  # share of the time
ZONED = "Model: published. No other has a dead zone, for which the mapping asks."


def identify_chosen(
    mapping: str | Path,
    data: str | Path | None = None,
    progress: Progress | None = None,
    how: Searching | None = None,
    model: str = CHOSEN,
    compared: ModelComparison | None = None,
) -> tuple[Identified, ModelComparison | None]:
    """Identify the chosen model, comparing first unless that was done; or the one of that name."""
    tell: Progress = progress or (lambda share, text: None)
    notes: tuple[str, ...] = ()
    begun, zone = 0.0, load_mapping(mapping, data).mapping.deflection.dead_zone_rad
    if model == CHOSEN and zone is not None:
        model, compared, notes = THESIS, None, (ZONED,)
    elif model == CHOSEN:
        if compared is None:
            begun, first = COMPARING, part_of(tell, 0.0, COMPARING)
            compared = compare(mapping, data, first, peers=False, how=how)
        model, notes = compared.chosen, compared.choice.reasons
    result: Identified
    if model == THESIS:
        result = identify(mapping, data, part_of(tell, begun, 1.0), how)
    else:
        result = identify_member(mapping, model, data, part_of(tell, begun, 1.0))
    return replace(result, notes=(*notes, *result.notes)), compared
