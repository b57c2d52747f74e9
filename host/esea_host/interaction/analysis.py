"""Analysis of the cross-over: effects, intervals, detectable differences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host import statistics
from esea_host.interaction.design import ELEMENTS, FIRST
from esea_host.interaction.metrics import FAMILY, Chains, Metric, settings_grid
from esea_host.interaction.published import (
    CANNOT,
    METRICS,
    TABLE_6_2,
    TABLE_6_3,
    TASKS,
    could_have_seen,
    published,
    reread,
)
from esea_host.interaction.recordings import Recordings, TaskRecordings, read_recordings
from esea_host.interaction.survey import Comments, Survey, read_comments, read_survey
from esea_host.smoothness import NoAnswerError, SmoothnessResult
from esea_host.statistics.checks import StatisticResult
from esea_host.study.records import gone_from

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sensitivity:
    """How the settings move a comparison: medians and p over the grid, lowest and highest."""

    spring: tuple[float, float]
    elastomer: tuple[float, float]
    p: tuple[float, float]
    settings: int
    refused: tuple[str, ...]


@dataclass(frozen=True)
class ElementComparison(StatisticResult):
    """One metric of one task.

    values: of people, shape (people, 2): spring, elastomer.  device: signed ranks of spring minus
    elastomer; block: of the first block minus the second.  device_holm, block_holm: over all
    metrics and tasks.  medians: by element and block; thesis_medians in the thesis' convention.
    family_power: at the first step of Holm's procedure.
    """

    task: str
    metric: str
    made: SmoothnessResult
    people: tuple[str, ...]
    values: Array
    medians: dict[str, float]
    thesis_medians: dict[str, float]
    device: statistics.SignedRank
    block: statistics.SignedRank
    effect: statistics.PairedEffect
    crossover: statistics.Crossover | None
    mixed: statistics.MixedModel | None
    bayes: statistics.BayesPaired
    power: statistics.PowerStatement
    family_power: statistics.PowerStatement
    band: Sensitivity
    device_holm: float = float("nan")
    block_holm: float = float("nan")
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        out = super().to_dict() | {"published": printed(self.task, self.metric)}
        del out["made"]["value"]  # of every recording; the values are by person
        return out


@dataclass(frozen=True)
class InteractionAnalysis(StatisticResult):
    """A folder's answer.  read: how its recordings were read, and what was left out of them."""

    folder: str
    simulated: bool
    people: tuple[str, ...]
    left_out: tuple[str, ...]
    read: tuple[str, ...]
    comparisons: tuple[ElementComparison, ...]
    survey: Survey | None
    comments: Comments | None

    def to_dict(self) -> dict[str, Any]:
        return super().to_dict() | {
            "published": {
                "table_6_2": reread(TABLE_6_2),
                "table_6_3": reread(TABLE_6_3),
                "ten_people_could_have_seen_dz": could_have_seen(),
                "cannot_be_recomputed": list(CANNOT),
            }
        }


def printed(task: str, metric: str) -> dict[str, Any] | None:
    if task not in TASKS or metric not in METRICS:
        return None
    return {
        "inter_block": vars(published(TABLE_6_2, task, metric)),
        "inter_device": vars(published(TABLE_6_3, task, metric)),
    }


def analyse_interaction(
    folder: Path, blinded: bool = False, swapped: bool = False
) -> InteractionAnalysis:
    """Everything that a folder of recordings answers.

    blinded: survey and comments would tell the elements, and stay out; swapped: as of
    :func:`read_recordings`.
    """
    found = read_recordings(folder, swapped)
    comparisons = [c for t in found.tasks for c in _comparisons(found, t)]
    device = statistics.holm([c.device.p for c in comparisons])
    block = statistics.holm([c.block.p for c in comparisons])
    manifest = found.manifest
    known = gone_from(folder), {e.participant: e.group for e in manifest.recording}
    return InteractionAnalysis(
        folder.name,
        manifest.simulated,
        tuple(sorted({p for t in found.tasks for p in t.people})),
        found.left_out,
        found.read,
        tuple(
            replace(c, device_holm=float(d), block_holm=float(b))
            for c, d, b in zip(comparisons, device, block, strict=True)
        ),
        read_survey(folder / manifest.survey, *known) if manifest.survey and not blinded else None,
        read_comments(folder / manifest.comments) if manifest.comments and not blinded else None,
    )


def _comparisons(found: Recordings, task: TaskRecordings) -> Iterator[ElementComparison]:
    if len(task.people) < 2:
        raise UserError(
            f"{task.task}: people with both elements: {len(task.people)}.", "Record at least 2."
        )
    chains = Chains(task.theta_deg, task.fs_Hz, found.manifest.last_s)
    family = len(FAMILY) * len(found.tasks)
    for metric in FAMILY:
        try:
            yield _compare(task, chains, metric, found.manifest.stop_Hz, family)
        except (NoAnswerError, statistics.NoStatisticError) as error:
            where = f"{found.folder.name}: {task.task}, {metric.name}"
            raise UserError(f"{where}: {error.what}", error.fix) from None


def _compare(
    task: TaskRecordings, chains: Chains, metric: Metric, stop_Hz: float, family: int
) -> ElementComparison:
    made = chains.result(metric, stop_Hz)
    values = chains.values(metric, stop_Hz)
    as_published = chains.values(replace(metric, convention="thesis"), stop_Hz)
    sides = _sides(values, task.groups)
    spring, elastomer, one, two = sides.values()
    effect = statistics.standardised_difference(spring, elastomer)
    n, firsts = len(task.people), [FIRST[g] for g in task.groups]
    by_block = np.concatenate([one, two]), task.people * 2
    elements = [*firsts, *(ELEMENTS[1 - ELEMENTS.index(e)] for e in firsts)]
    models: list[tuple[str, Callable[..., Any], tuple[Any, ...]]] = [
        ("cross-over", statistics.crossover, (one, two, firsts)),
        ("mixed model", statistics.mixed_model, (*by_block, elements, [1] * n + [2] * n)),
    ]
    notes, parts = [], []
    for name, run, given in models:
        try:
            parts.append(run(*given, ELEMENTS))
        except statistics.NoStatisticError as error:
            parts.append(None)
            notes.append(f"{name}: {error}")
    return ElementComparison(
        task.task,
        metric.name,
        made,
        task.people,
        values,
        _medians(sides),
        _medians(_sides(as_published, task.groups)),
        statistics.signed_rank(spring, elastomer),
        statistics.signed_rank(one, two),
        effect,
        parts[0],
        parts[1],
        statistics.bayes_paired(spring, elastomer),
        statistics.power_statement(n, effect.sd),
        statistics.power_statement(n, effect.sd, alpha=0.05 / family),
        _sensitivity(chains, metric),
        notes=tuple(notes),
    )


def _sides(values: Array, groups: Sequence[str]) -> dict[str, Array]:
    # By element and by block.
    spring, elastomer = values.T
    springs_first = np.array([FIRST[g] == ELEMENTS[0] for g in groups])
    one = np.where(springs_first, spring, elastomer)
    two = np.where(springs_first, elastomer, spring)
    return {"spring": spring, "elastomer": elastomer, "block_1": one, "block_2": two}


def _medians(sides: Mapping[str, Array]) -> dict[str, float]:
    return {k: float(np.median(v)) for k, v in sides.items()}


def _sensitivity(chains: Chains, metric: Metric) -> Sensitivity:
    seen, refused = [], []
    for settings in settings_grid(metric):
        try:
            spring, elastomer = chains.values(metric, **settings).T
            p = statistics.signed_rank(spring, elastomer).p
        except (NoAnswerError, statistics.NoStatisticError) as error:
            refused.append(f"{', '.join(f'{k} {v:g}' for k, v in settings.items())}: {error}")
            continue
        seen.append((float(np.median(spring)), float(np.median(elastomer)), p))
    if not seen:
        raise UserError(f"{metric.name}: {refused[0]}", "Check the recordings.")
    ends = [(min(column), max(column)) for column in zip(*seen, strict=True)]
    return Sensitivity(ends[0], ends[1], ends[2], len(seen), tuple(refused))
