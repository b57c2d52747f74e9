"""Blocks that differ in words only become one Block behind several instances, emitted once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from difflib import SequenceMatcher
from typing import Any

import casadi as ca

from esea_gen.language.block import Block
from esea_gen.language.component import Component

WORDS = {"meaning", "source", "title", "status"}  # what no number depends on
PORTS = ("constants", "tunables", "coefficients", "state", "inputs", "outputs")


def _bytes(f: ca.Function) -> Any:
    # Without the function's own name.
    symbols = f.sx_in()
    return ca.Function("f", symbols, f.call(symbols), f.name_in(), f.name_out()).serialize()


def _plain(item: Any) -> tuple[Any, ...]:
    return tuple(repr(getattr(item, f.name)) for f in fields(item) if f.name not in WORDS)


def alike(one: Block, other: Block) -> bool:
    """Whether two Blocks compute the same bits from the same numbers."""
    if one.period_s != other.period_s or one.labels != other.labels:
        return False
    for group in PORTS:
        mine, theirs = getattr(one, group), getattr(other, group)
        if [_plain(p) for p in mine] != [_plain(p) for p in theirs]:
            return False
    return all(
        _bytes(getattr(one, f)) == _bytes(getattr(other, f)) for f in ("prepare", "init", "step")
    )


def joined(texts: Sequence[str]) -> str:
    """Merge several texts into one, with the differing words side by side.

    >>> joined(["angle, motor side of it", "angle, load side of it"])
    'angle, motor or load side of it'
    """
    text = texts[0]
    for other in dict.fromkeys(texts[1:]):
        a, b = text.split(" "), other.split(" ")
        if SequenceMatcher(None, a, b, autojunk=False).ratio() < 0.5:
            text = f"{text}; or: {other}"
            continue
        words = []
        for kind, i, j, m, n in SequenceMatcher(None, a, b, autojunk=False).get_opcodes():
            if kind == "equal":
                words += a[i:j]
            elif kind == "replace":
                words += [*a[i:j], "or", *b[m:n]]
            else:
                words += [*a[i:j], *b[m:n]]
        text = " ".join(words)
    return text


def _common(names: Sequence[str]) -> str:
    first, *others = (name.split("_") for name in names)
    return "_".join(w for w in first if all(w in other for other in others))


def _merged(name: str, blocks: Sequence[Block]) -> Block:
    def words(group: str) -> tuple[Any, ...]:
        return tuple(
            replace(
                items[0],
                **{
                    f.name: joined([getattr(i, f.name) for i in items])
                    for f in fields(items[0])
                    if f.name in WORDS - {"status"}
                },
            )
            for items in zip(*(getattr(b, group) for b in blocks), strict=True)
        )

    changed: dict[str, Any] = {group: words(group) for group in PORTS}
    return replace(blocks[0], name=name, title=joined([b.title for b in blocks]), **changed)


def emitted_once(blocks: Mapping[str, Component]) -> dict[str, Component]:
    """The same instances, with one Block behind those that are alike."""
    groups: list[list[Block]] = []
    for block in {id(b): b for b in blocks.values()}.values():
        if isinstance(block, Block):
            found = next((g for g in groups if alike(g[0], block)), None)
            if found:
                found.append(block)
            else:
                groups.append([block])
    shared: dict[int, Component] = {}
    names = {b.name for b in blocks.values()}
    for group in groups:
        if len(group) > 1:
            name = _common([b.name for b in group])
            one = _merged(name if name and name not in names else group[0].name, group)
            shared |= {id(b): one for b in group}
    return {i: shared.get(id(b), b) for i, b in blocks.items()}
