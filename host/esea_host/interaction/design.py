"""Design of the cross-over: elements, groups and their order."""

from __future__ import annotations

SPRING, ELASTOMER = "spring", "elastomer"
ELEMENTS = (SPRING, ELASTOMER)
# Group A has the spring first.
FIRST = {"A": SPRING, "B": ELASTOMER}


def element_of(group: str, block: int) -> str:
    return FIRST[group] if block == 1 else ELEMENTS[1 - ELEMENTS.index(FIRST[group])]
