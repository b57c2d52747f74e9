"""A device with the torque model that held-out data choose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from esea_gen.identify.family.choice import THESIS
from esea_gen.identify.family.compare import ModelComparison, compare
from esea_gen.identify.family.identification import identify_member
from esea_gen.identify.identification import identify
from esea_gen.identify.identified import Identified
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.published.search_problem import Searching
from esea_gen.identify.recording.mapping import load_mapping

COMPARING = 0.85  # share of the time
ZONED = "Model: published. No other has a dead zone, for which the mapping asks."


def identify_chosen(
    mapping_path: str | Path,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
    how: Searching | None = None,
    compared: ModelComparison | None = None,
) -> tuple[Identified, ModelComparison | None]:
    """Identify the chosen model; compare first, unless that was done already."""
    tell: Progress = progress or (lambda share, text: None)
    done = 0.0 if compared else COMPARING

    def rest(share: float, text: str) -> None:
        tell(done + (1 - done) * share, text)

    if load_mapping(mapping_path, data_folder).mapping.deflection.dead_zone_rad is not None:
        found = identify(mapping_path, data_folder, tell, how)
        return replace(found, notes=(ZONED, *found.notes)), None
    if compared is None:
        compared = compare(
            mapping_path,
            data_folder,
            None,
            lambda share, text: tell(COMPARING * share, text),
            peers=False,
            how=how,
        )
    result: Identified
    if compared.chosen == THESIS:
        result = identify(mapping_path, data_folder, rest, how)
    else:
        result = identify_member(mapping_path, compared.chosen, data_folder, rest)
    return replace(result, notes=(*compared.choice.reasons, *result.notes)), compared
