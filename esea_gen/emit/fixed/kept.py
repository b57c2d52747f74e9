"""Stored results of the plan search: lowering from them takes a fiftieth of the time.

Only the choice is stored: which values are wide, and why.  The plan is lowered from it and its
bound derived again, so that a wrong entry cannot make a wrong plan.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from contextlib import suppress
from pathlib import Path

import casadi as ca
import numpy as np

from esea_gen.cache import cache_folder, code_digest
from esea_gen.emit.fixed.plan import BlockPlan, Planner
from esea_gen.emit.fixed.search import search
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.language.block import Block

ROOMS = ("emit", "language")  # a test holds that what plans reads no code but theirs
NOT_READ = frozenset({"equations", "streams"})
"""Fields of a Block on which no plan depends."""


def content_digest(planner: Planner) -> str | None:
    """Digest of all that a plan depends on: the Block's content, the code, the libraries."""
    code = code_digest(ROOMS)
    if code is None:
        return None
    parts = [
        code,
        ca.CasadiMeta.version(),
        np.__version__,
        repr(planner.kernel),
        repr(planner.fields),
    ]
    for f in dataclasses.fields(planner.block):
        if f.name not in NOT_READ:
            value = getattr(planner.block, f.name)
            parts += [f.name, value.serialize() if isinstance(value, ca.Function) else repr(value)]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _read(path: Path, nodes: int) -> dict[int, str] | None:
    try:
        why = json.loads(path.read_text(encoding="utf-8"))
        found = {int(i): str(reason) for i, reason in why.items()}
    except (OSError, ValueError, AttributeError):
        return None
    return found if all(0 <= i < nodes for i in found) else None


def _plan(block: Block) -> BlockPlan:
    planner = Planner(block)
    digest = content_digest(planner)
    if digest is None:
        return search(planner)
    path = cache_folder() / f"plan-{digest[:32]}.json"
    why = _read(path, len(planner.kernel.nodes))
    if why is not None:
        return planner.plan(why)
    plan = search(planner)
    with suppress(UserError):  # a full disk costs the next process its time and no more
        write_whole(path, json.dumps(dict(plan.why_wide)))
    return plan


_PLANS: dict[int, tuple[Block, BlockPlan]] = {}


def plan_block(block: Block) -> BlockPlan:
    found = _PLANS.get(id(block))
    if found is None or found[0] is not block:
        found = _PLANS[id(block)] = (block, _plan(block))
    return found[1]
