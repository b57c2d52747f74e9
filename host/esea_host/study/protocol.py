"""Protocol files: a study without code."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from esea_gen.errors import UserError, nearest
from esea_gen.toml_file import checked, judged, line_of, parse_toml, read_text
from esea_gen.trust import TaskCode, allow, inside, read_code
from esea_host.study.task import StudyTask, load_tasks, task_named
from esea_host.study.words import Words, language_of, words_of

GROUP = "group"
SEE = "docs/first-study.md"


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class TrialRows(_Table):
    """One line of trials of a block."""

    repeat: int = Field(1, ge=1, le=10000, description="how often")
    catch: bool = Field(False, description="whether it is a catch trial")
    parameters: dict[str, Any] = Field({}, description="the task's, for these trials")


class TrialBlock(_Table):
    """A block: trials of one task."""

    name: str = Field(description="name, for the log")
    task: str = Field(description="name of the task")
    condition: str = Field(
        "", description=f"a condition's name, or \"{GROUP}\": the group's of this session"
    )
    familiarisation: bool = Field(False, description="its data is not analysed")
    copies: int = Field(1, ge=1, le=1000, description="this block so often, each in its own order")
    order: Literal["fixed", "shuffled"] = Field("fixed", description="order of the trials")
    rest_s: float = Field(0.0, ge=0, le=7200, description="rest before the block")
    between_s: float = Field(0.0, ge=0, le=600, description="rest between its trials")
    parameters: dict[str, Any] = Field({}, description="the task's, for all trials")
    first: tuple[TrialRows, ...] = Field((), description="before the others, as written")
    trials: tuple[TrialRows, ...] = Field((), description="the trials")
    last: tuple[TrialRows, ...] = Field((), description="after the others, as written")


class SessionPlan(_Table):
    """A session: blocks in order."""

    name: str = Field(description="name, for the log")
    after_days: float = Field(0.0, ge=0, le=3650, description="washout since the last session")
    block: tuple[TrialBlock, ...] = Field(min_length=1, description="its blocks")


class Stopping(_Table):
    """When a session ends early."""

    longest_min: float = Field(120.0, gt=0, le=1440, description="a session takes no longer")
    failed_in_a_row: int = Field(3, ge=1, description="so many failed trials in a row end it")


class StudyCondition(_Table):
    """A condition: parameters for every task that has them."""

    title: str = Field("", description="in words")
    parameters: dict[str, Any] = Field({}, description="for tasks that have them")


class GroupAllocation(_Table):
    """How the list of ``study allocate`` is drawn."""

    blocks: tuple[int, ...] = Field(
        (),
        description="sizes of the permuted blocks, drawn at random; without them 2, 3 and 4 times "
        "the number of groups",
    )
    strata: dict[str, tuple[str, ...]] = Field(
        {}, description="factors and their levels: a list for each combination of levels"
    )


class ProtocolFile(_Table):
    """A complete study."""

    schema_: Literal[1] = Field(alias="schema", description="1")
    name: str = Field(pattern=r"^[a-z][a-z0-9_-]*$", description="short name")
    title: str = Field(description="one line")
    seed: int = Field(ge=0, le=2**31 - 1, description="of every random order of the study")
    tasks: tuple[str, ...] = Field((), description="files with tasks, beside this one")
    language: str = Field("en", pattern="^[a-z]{2,3}$", description="of both windows")
    texts: tuple[str, ...] = Field(
        (), description="files with texts, beside this one, such as own.de.toml"
    )
    blinded: tuple[Literal["operator", "participant", "analyst"], ...] = Field(
        (), description="who does not see the group"
    )
    conditions: dict[str, StudyCondition] = Field({}, description="conditions by name")
    groups: dict[str, tuple[str, ...]] = Field(
        {}, description="cross-over: per group, the condition of each session"
    )
    allocation: GroupAllocation = Field(GroupAllocation(), description="of participants to groups")
    stopping: Stopping = Field(Stopping(), description="when a session ends early")
    session: tuple[SessionPlan, ...] = Field(min_length=1, description="the sessions")


@dataclass(frozen=True)
class Protocol:
    file: ProtocolFile
    text: str
    origin: str
    code: tuple[TaskCode, ...] = ()
    texts: tuple[TaskCode, ...] = ()

    def words(self, language: str = "") -> Words:
        """Texts of a language, or of the protocol's own; the study's files go over the shipped."""
        language = language or self.file.language
        for own in self.texts:
            if language_of(own.path) == language:
                return words_of(language, own.content, own.path.name)
        return words_of(language)

    def line(self, *loc: str | int) -> str:
        """Place of an entry: ``protocol.toml, line 12``."""
        found = line_of(self.text, loc)
        return f"{self.origin}, line {found}" if found else self.origin


def load_protocol(path: Path, task_files: Sequence[Path] = ()) -> Protocol:
    """Read a protocol, and run the files with tasks that it names, if they are trusted."""
    text = read_text(path, "Name a protocol file.")
    named = [read_code(f) for f in task_files]
    allow(c.sha256 for c in named)
    return parse_protocol(text, path.name, [path.parent], named)


def parse_protocol(
    text: str,
    origin: str,
    folders: Sequence[Path] = (),
    codes: Sequence[TaskCode] = (),
    runs: bool = True,
    texts: Sequence[TaskCode] = (),
) -> Protocol:
    """Parse from text; runs=False: no code is run, and checks that need a task are omitted."""
    document = parse_toml(text, origin, SEE)
    file = checked(ProtocolFile, document, origin, lambda _: "", text)
    bare = Protocol(file, text, origin)

    def beside(key: str, names: Sequence[str]) -> list[TaskCode]:
        return [read_code(inside(f, Path(n), bare.line(key))) for f in folders for n in names]

    own, own_texts = beside("tasks", file.tasks), beside("texts", file.texts)
    protocol = Protocol(file, text, origin, (*own, *codes), (*own_texts, *texts))
    for key, names in (
        ("tasks", [c.path.name for c in protocol.code]),
        ("texts", [language_of(t.path) for t in protocol.texts]),
    ):
        if twice := sorted({n for n in names if names.count(n) > 1}):
            where = f"{bare.line(key)}: several files {', '.join(twice)}."
            raise UserError(where, "Give each another name.")
    for language in {file.language, *(language_of(t.path) for t in protocol.texts)}:
        protocol.words(language)
    if runs:
        load_tasks(protocol.code)
        _check(protocol)
    return protocol


def parameters_of(
    protocol: Protocol, task: StudyTask, condition: str, *levels: Mapping[str, Any]
) -> dict[str, Any]:
    """Parameters of a trial: its own over the block's over the condition's (those it has)."""
    table = protocol.file.conditions.get(condition)
    known = task.Parameters.model_fields
    found = {k: v for k, v in (table.parameters if table else {}).items() if k in known}
    for level in levels:
        found |= level
    return found


def block_sizes(file: ProtocolFile) -> tuple[int, ...]:
    return file.allocation.blocks or tuple(k * len(file.groups) for k in (2, 3, 4))


def group_decides(file: ProtocolFile, session: int, block: str) -> bool:
    """Whether the group decides the condition of a block, by its name in the log."""
    by_group = {b.name for b in file.session[session].block if b.condition == GROUP}
    return block in by_group or block.rpartition(" ")[0] in by_group


def _check_allocation(protocol: Protocol) -> None:
    file, where = protocol.file, protocol.line("allocation")
    if file.allocation != GroupAllocation() and not file.groups:
        raise UserError(f"{where}: there are no groups.", "Add [groups].")
    sizes, groups = file.allocation.blocks, len(file.groups)
    if sizes and (len(set(sizes)) < 2 or any(s <= 0 or s % groups or s > 100 for s in sizes)):
        raise UserError(
            f"{where}: blocks = {list(sizes)}; at least two different sizes are needed, each a "
            f"multiple of the {groups} groups and at most 100.",
            f"Write for example: blocks = {[k * groups for k in (2, 3, 4)]}.",
        )
    for factor, levels in file.allocation.strata.items():
        if not levels or len(set(levels)) < len(levels) or any(c in "=,|" for c in factor):
            raise UserError(
                f"{protocol.line('allocation', 'strata', factor)}: factor {factor!r} has the "
                f"levels {list(levels)}.",
                "Name each level once; a factor's name has no '=', ',' or '|'.",
            )


def _check(protocol: Protocol) -> None:
    file = protocol.file
    _check_allocation(protocol)
    for group, order in file.groups.items():
        where = protocol.line("groups", group)
        if len(order) != len(file.session):
            raise UserError(
                f"{where}: group {group} has {len(order)} conditions, the study "
                f"{len(file.session)} sessions.",
                "Give one a session.",
            )
        for condition in order:
            _condition(protocol, condition, where)
    used: set[str] = set()
    for s, session in enumerate(file.session):
        for b, block in enumerate(session.block):
            used |= _check_block(protocol, (s, b), block)
    for name, table in file.conditions.items():
        for key in table.parameters:
            if key not in used:
                raise UserError(
                    f"{protocol.line('conditions', name, 'parameters', key)}: no task of this "
                    f"protocol has a parameter {key!r}.",
                    f"{nearest(key, used)}They have: {', '.join(sorted(used))}.",
                )


def _check_block(protocol: Protocol, place: tuple[int, int], block: TrialBlock) -> set[str]:
    file, text, loc = protocol.file, protocol.text, ("session", place[0], "block", place[1])
    task = task_named(block.task, protocol.line(*loc, "task"))
    rows = (*block.first, *block.trials, *block.last)
    if not rows:
        raise UserError(f"{protocol.line(*loc, 'name')}: {block.name} has no trials.", "Add one.")
    if block.condition == GROUP and not file.groups:
        raise UserError(
            f"{protocol.line(*loc, 'condition')}: there are no groups.", "Add [groups]."
        )
    conditions = [block.condition]
    if block.condition == GROUP:
        conditions = sorted({order[place[0]] for order in file.groups.values()})
    for condition in conditions:
        if condition:
            _condition(protocol, condition, protocol.line(*loc, "condition"))
        for row in rows:
            given = parameters_of(protocol, task, condition, block.parameters, row.parameters)
            for key, error in judged(task.Parameters, given, lambda _: None)[1]:
                first, at = line_of(text, (*loc, "name")), ("conditions", condition, "parameters")
                line = _next_line(text, first, key) or line_of(text, (*at, *key)) or first
                where = f"parameters of {task.name} in block {block.name}"
                raise UserError(f"{protocol.origin}, line {line}: {where}: {error.what}", error.fix)
    return set(task.Parameters.model_fields)


def _condition(protocol: Protocol, name: str, where: str) -> None:
    known = protocol.file.conditions
    if name not in known:
        fix = f"{nearest(name, known)}There are: {', '.join(known)}."
        raise UserError(f"{where}: there is no condition {name!r}.", fix)


def _next_line(text: str, start: int, loc: Sequence[str | int]) -> int:
    # Where block or row gives a parameter, in an inline table too; 0: the condition gives it.
    key = re.compile(rf"\b{re.escape(str(loc[0]))}\s*=") if loc else None
    lines = enumerate(text.splitlines(), 1)
    return next((k for k, line in lines if k >= start and key and key.search(line)), 0)
