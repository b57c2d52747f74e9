"""Faults of the virtual exoskeleton's encoders: false readings from a given time on."""

from __future__ import annotations

import re
from dataclasses import dataclass

from esea_gen.errors import UserError, nearest
from esea_gen.twin.encoders import ENCODERS
from esea_gen.typed import read_number

# What an encoder may do, with the amount that is taken where none is given and its unit.
KINDS = {
    "freeze": (0.0, "", "the reading stays where it is"),
    "slip": (0.0838, "rad", "the reading jumps once"),
    "drift": (0.05, "rad/s", "the reading moves away at a steady rate"),
    "gain": (0.8, "", "what is moved from now on is read times this"),
    "zero": (3.0, "", "this bit of the count, from 0 on, is 0"),
    "one": (3.0, "", "this bit of the count, from 0 on, is 1"),
    "noise": (0.008, "rad", "white noise of this effective value is added"),
}
BITS = ("zero", "one")
SIDES = {"load": ("load",), "motor": ("motor",), "both": ("motor", "load"), "gear": ("gear",)}
_FORM = re.compile(r"(?P<kind>[a-z]+):(?P<side>[a-z]+)@(?P<at>[^=]+)(=(?P<amount>.+))?")


@dataclass(frozen=True)
class EncoderFault:
    kind: str
    side: str
    at_s: float
    amount: float

    def __str__(self) -> str:
        amount = f"={self.amount:g}" if self.kind != "freeze" else ""
        return f"{self.kind}:{self.side}@{self.at_s:g}{amount}"

    @property
    def sides(self) -> tuple[bool, ...]:
        """Which encoders, in the order of the twin's counts."""
        return tuple(name in SIDES[self.side] for name in ENCODERS)


def parse_fault(text: str) -> EncoderFault:
    """From ``freeze:load@4`` or ``drift:gear@4=0.1``."""
    found = _FORM.fullmatch(text)
    if found is None:
        raise UserError(
            f"'{text}' is not a fault.",
            "Write KIND:ENCODER@SECONDS, such as freeze:load@4, or with an amount slip:gear@4=0.1.",
        )
    kind, side = found["kind"], found["side"]
    for name, known, wrong in (
        (kind, KINDS, f"'{kind}' is not a fault of an encoder"),
        (side, SIDES, f"there is no encoder '{side}'"),
    ):
        if name not in known:
            fix = f"{nearest(name, known)}Choose from {', '.join(known)}."
            raise UserError(f"'{text}': {wrong}.", fix)
    at_s = _number(text, "time", found["at"], 0.0, 1e4)
    amount = KINDS[kind][0]
    if found["amount"] is not None:
        if kind == "freeze":
            raise UserError(f"'{text}': a frozen encoder has no amount.", "Leave it out.")
        low, high = (0.0, 23.0) if kind in BITS else (-10.0, 10.0)
        amount = _number(text, "amount", found["amount"], low, high)
        if kind in BITS and amount % 1:
            raise UserError(f"'{text}': a bit's number is whole.", "Give one from 0 on.")
    return EncoderFault(kind, side, at_s, amount)


def _number(text: str, what: str, given: str, low: float, high: float) -> float:
    try:
        value = read_number(given, low, high)
    except UserError:
        value = float("nan")
    if not low <= value <= high:
        raise UserError(
            f"'{text}': the {what} '{given}' is not a number from {low:g} to {high:g}.", "Give one."
        )
    return value
