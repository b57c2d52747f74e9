"""Plan of all trials, built before the first one from a private generator."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.study.edge import longest_trial_s
from esea_host.study.protocol import (
    GROUP,
    Protocol,
    TrialBlock,
    TrialRows,
    block_sizes,
    parameters_of,
)
from esea_host.study.task import StudyTask, task_named


@dataclass(frozen=True)
class PlannedTrial:
    number: int
    block: str
    task: str
    version: str
    condition: str
    parameters: Mapping[str, Any]
    catch: bool
    familiarisation: bool
    rest_before_s: float
    seed: int

    def asked(self) -> tuple[StudyTask, Any]:
        task = task_named(self.task, "plan")
        return task, task.Parameters(**self.parameters)


@dataclass(frozen=True)
class Plan:
    protocol: str
    session: int
    session_name: str
    group: str
    trials: tuple[PlannedTrial, ...]

    def digest(self) -> str:
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()


def plan_from(data: Mapping[str, Any]) -> Plan:
    trials = tuple(PlannedTrial(**t) for t in data["trials"])
    return Plan(**{**data, "trials": trials})


def generator(*words: int) -> np.random.Generator:
    """A private generator: a draw elsewhere shifts nothing here."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(list(words))))


def group_of(protocol: Protocol, index: int) -> str:
    """Group by the protocol's seed, for simulated people: anyone with the seed can predict it."""
    groups = sorted(protocol.file.groups)
    if not groups:
        return ""
    block, place = divmod(index, len(groups))
    order = generator(protocol.file.seed, 1, block).permutation(len(groups))
    return groups[int(order[place])]


def build_plan(protocol: Protocol, index: int, session: int, group: str | None = None) -> Plan:
    """index: of the participant, for the orders; without a group that of the protocol's seed."""
    file = protocol.file
    if not 0 <= session < len(file.session):
        raise UserError(
            f"{protocol.origin} has {len(file.session)} sessions, not a session {session + 1}.",
            "Name one of them.",
        )
    group = group_of(protocol, index) if group is None else group
    chosen = file.session[session]
    trials: list[PlannedTrial] = []
    for b, block in enumerate(chosen.block):
        condition = block.condition
        if condition == GROUP:
            condition = file.groups[group][session]
        for copy in range(block.copies):
            rng = generator(file.seed, 2, index, session, b, copy)
            name = f"{block.name} {copy + 1}" if block.copies > 1 else block.name
            for k, row in enumerate(_ordered(block, rng)):
                task = task_named(block.task, protocol.origin)
                given = parameters_of(protocol, task, condition, block.parameters, row.parameters)
                # With the defaults: the log says all that the trial ran with.
                values = task.Parameters.model_validate_json(json.dumps(given))
                trials.append(
                    PlannedTrial(
                        number=len(trials) + 1,
                        block=name,
                        task=task.name,
                        version=task.version,
                        condition=condition,
                        parameters=dict(values.model_dump(mode="json")),
                        catch=row.catch,
                        familiarisation=block.familiarisation,
                        rest_before_s=block.between_s if k else block.rest_s,
                        seed=int(rng.integers(2**31)),
                    )
                )
    return Plan(file.name, session, chosen.name, group, tuple(trials))


def _ordered(block: TrialBlock, rng: np.random.Generator) -> Iterator[TrialRows]:
    def each(rows: tuple[TrialRows, ...]) -> list[TrialRows]:
        return [row for row in rows for _ in range(row.repeat)]

    middle = each(block.trials)
    if block.order == "shuffled":
        middle = [middle[i] for i in rng.permutation(len(middle))]
    yield from (*each(block.first), *middle, *each(block.last))


def explain(protocol: Protocol) -> str:
    file, lines = protocol.file, []
    lines.append(f"{file.name}: {file.title}")
    for name, table in file.conditions.items():
        lines.append(f"  condition {name}: {table.title or 'no words given'}")
    for group, order in sorted(file.groups.items()):
        lines.append(f"  group {group}: " + ", then ".join(order))
    if file.groups:
        sizes = ", ".join(map(str, block_sizes(file)))
        lines.append(
            f"  groups come from a sealed list of permuted blocks of random size ({sizes}), "
            "disclosed at the first session"
        )
        for factor, levels in file.allocation.strata.items():
            lines.append(f"  stratified by {factor}: {', '.join(levels)}")
    if file.blinded:
        lines.append(f"  the group is not shown to: {', '.join(file.blinded)}")
    for k, session in enumerate(file.session):
        plan = build_plan(protocol, 0, k)
        longest, rests = durations_s(plan)
        wait = f", {session.after_days:g} days or more after the last" if k else ""
        lines.append(
            f"  session {k + 1}, {session.name}{wait}: {len(plan.trials)} trials, at most "
            f"{_lasts(longest + rests)} ({_lasts(rests)} of them rests)"
        )
        for block in session.block:
            lines.append("    " + _block_in_words(block))
    stop = file.stopping
    lines.append(
        f"  a session ends early after {stop.longest_min:g} min, or when {stop.failed_in_a_row} "
        "trials in a row fail"
    )
    return "\n".join(lines)


def _lasts(time_s: float) -> str:
    return f"{time_s:.0f} s" if time_s < 60 else f"{time_s / 60:.0f} min"


def durations_s(plan: Plan) -> tuple[float, float]:
    longest = 0.0
    for trial in plan.trials:
        task, parameters = trial.asked()
        longest += longest_trial_s(task, parameters)
    return longest, sum(t.rest_before_s for t in plan.trials)


def _block_in_words(block: TrialBlock) -> str:
    rows = (*block.first, *block.trials, *block.last)
    count, catch = sum(r.repeat for r in rows), sum(r.repeat for r in rows if r.catch)
    words = [f"{block.name}: {count} x {block.task}"]
    if block.copies > 1:
        words.append(f"{block.copies} blocks of these")
    if block.condition:
        of = "the condition of the group" if block.condition == GROUP else block.condition
        words.append(f"condition: {of}")
    words.append("in random order" if block.order == "shuffled" else "in the order written")
    if catch:
        words.append(f"{catch} of them catch trials")
    if block.familiarisation:
        words.append("familiarisation, not analysed")
    if block.rest_s:
        words.append(f"after {block.rest_s:g} s of rest")
    return ", ".join(words)
