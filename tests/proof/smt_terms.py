"""What a formula in SMT-LIB says for given numbers: words as whole numbers, floats as float32."""

from __future__ import annotations

import operator
import re
from functools import cache
from typing import Any

import numpy as np

SIGNED = {"bvslt": operator.lt, "bvsle": operator.le, "bvsgt": operator.gt, "bvsge": operator.ge}
PLAIN = {"bvult": operator.lt, "bvule": operator.le, "bvugt": operator.gt, "bvuge": operator.ge}
WORDS = {
    **{"bvadd": operator.add, "bvsub": operator.sub, "bvmul": operator.mul},
    **{"bvand": operator.and_, "bvor": operator.or_, "bvxor": operator.xor},
}
FLOATS = {
    **{"fp.add": operator.add, "fp.sub": operator.sub},
    **{"fp.mul": operator.mul, "fp.div": operator.truediv},
}
ORDER = {
    **{"fp.lt": operator.lt, "fp.leq": operator.le, "fp.gt": operator.gt, "fp.geq": operator.ge},
    **{"fp.eq": operator.eq},
}


@cache
def parsed(text: str) -> Any:
    """Nested lists of atoms."""
    stack: list[list[Any]] = [[]]
    for token in re.findall(r"\(|\)|\|[^|]*\||[^\s()|]+", text):
        if token == "(":
            stack.append([])
        elif token == ")":
            last = stack.pop()
            stack[-1].append(last)
        else:
            stack[-1].append(token)
    (only,) = stack[0]
    return only


def signed(word: tuple[int, int]) -> int:
    value, bits = word
    return value - 2**bits if value >> bits - 1 else value


def value_of(e: Any, known: dict[str, Any]) -> Any:
    """A parsed term: a truth value, (word, bits), or a float32 number."""
    if isinstance(e, str):
        if e.startswith("#b"):
            return int(e[2:], 2), len(e) - 2
        return {"true": True, "false": False}[e] if e in ("true", "false") else known[e]
    head = e[0]
    if head == "_":
        if e[1] == "+zero":
            return np.float32(0)
        return int(e[1][2:]), int(e[2])
    if head == "fp":
        raw = int("".join(b[2:] for b in e[1:]), 2)
        return np.uint32(raw).view(np.float32)
    if isinstance(head, list):
        return indexed(head[1:], e[1:], known)
    if head == "ite":
        return value_of(e[2] if value_of(e[1], known) else e[3], known)
    args = [value_of(a, known) for a in e[1:] if a != "RNE"]
    if head in ("and", "or"):
        return (all if head == "and" else any)(args)
    if head == "not":
        return not args[0]
    if head == "=>":
        return not args[0] or args[1]
    if head == "=":
        if isinstance(args[0], np.float32):
            return args[0].tobytes() == args[1].tobytes()
        return args[0] == args[1]
    return computed(head, args)


def computed(head: str, args: list[Any]) -> Any:
    if head.startswith("fp."):
        with np.errstate(all="ignore"):
            if head in FLOATS:
                return np.float32(FLOATS[head](*args))
            if head in ORDER:
                return bool(ORDER[head](*args))
            return {
                "fp.neg": lambda x: -x,
                "fp.abs": np.abs,
                "fp.isZero": lambda x: bool(x == 0),
                "fp.isNaN": lambda x: bool(np.isnan(x)),
                "fp.isInfinite": lambda x: bool(np.isinf(x)),
            }[head](args[0])
    value, bits = args[0]
    assert all(b == bits for _, b in args)
    if head in SIGNED:
        return SIGNED[head](*map(signed, args))
    if head in PLAIN:
        return PLAIN[head](value, args[1][0])
    if head in ("bvneg", "bvnot"):
        return (-value - (head == "bvnot")) % 2**bits, bits
    if head in WORDS:
        return WORDS[head](value, args[1][0]) % 2**bits, bits
    count = min(args[1][0], bits)
    moved = {"bvshl": value << count, "bvlshr": value >> count, "bvashr": signed(args[0]) >> count}
    return moved[head] % 2**bits, bits


def indexed(index: list[str], rest: list[Any], known: dict[str, Any]) -> Any:
    x = value_of(rest[-1], known)
    if index[0] == "extract":
        high, low = int(index[1]), int(index[2])
        return (x[0] >> low) % 2 ** (high - low + 1), high - low + 1
    if index[0] == "sign_extend":
        bits = x[1] + int(index[1])
        return signed(x) % 2**bits, bits
    if index[0] == "zero_extend":
        return x[0], x[1] + int(index[1])
    whole = signed(x) if index[0] == "to_fp" else x[0]
    # Through no other format: nearest of the neighbours, ties to even.
    near = np.float32(whole)
    around = [np.nextafter(near, np.float32(s * np.inf)) for s in (-1, 1)] + [near]
    return min(
        (f for f in around if np.isfinite(f)),
        key=lambda f: (abs(int(f) - whole) if abs(whole) > 2**24 else abs(f - whole),
                       int(f.view(np.uint32)) & 1),
    )  # fmt: skip


class Terms:
    """A script's definitions, for given numbers of what is unknown."""

    def __init__(self, lines: list[str], given: dict[str, Any]) -> None:
        self.known = {f"|{n}|": v for n, v in given.items()}
        self.facts: list[bool] = []
        for line in lines:
            head, *rest = parsed(line)
            if head == "define-fun":
                self.known[rest[0]] = value_of(rest[-1], self.known)
            elif head == "assert":
                self.facts.append(value_of(rest[0], self.known))

    def __call__(self, term: str) -> Any:
        if not term.startswith("("):
            return value_of(term, self.known)
        return value_of(parsed(term), self.known)
