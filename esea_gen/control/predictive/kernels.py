"""Kernels that more than one Program calls."""

from __future__ import annotations

from typing import Any

import casadi as ca

from esea_gen.language.ports import flag_word


def same(x: Any) -> Any:
    """A copy."""
    return x


def zero() -> Any:
    """0, for what is summed or counted."""
    return ca.SX(0)


def one() -> Any:
    """1, for what is true until found otherwise."""
    return ca.SX(1)


def plus(total: Any, a: Any, b: Any) -> Any:
    """A product added."""
    return total + a * b


def take_from(total: Any, a: Any, b: Any) -> Any:
    """A product taken away."""
    return total - a * b


def flags_of(*conditions: Any) -> ca.SX:
    """A status word from conditions."""
    return flag_word(ca.SX(c) for c in conditions)
