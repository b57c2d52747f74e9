"""Numbers that people type: the same in every locale, or a reason."""

from __future__ import annotations

import math
import re
from decimal import Decimal

from esea_gen.errors import UserError

# Nothing here asks the locale: "2.5" and "2,5" are the same number on every desktop.
_NUMBER = re.compile(r"[+\-\u2212]?(\d+[.,]?\d*|[.,]\d+)([eE][+\-]?\d{1,3})?", re.ASCII)
_GROUPED = re.compile(r"[+\-\u2212]?\d+([\s.,'\u2019_\u066c]+\d+)+")
_TWOFOLD = re.compile(r"[+\-\u2212]?[1-9]\d{0,2},\d{3}", re.ASCII)  # 1,000 in English and German
_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
_WHOLE = re.compile(r"[+-]?\d{1,18}", re.ASCII)
_LONGEST = 40


def shown_number(value: float) -> str:
    """A number with a decimal point and all its digits, without exponent and grouping."""
    text = format(Decimal(repr(value)), "f")
    return text if "." in text else f"{text}.0"


def read_number(text: str, low: float = -math.inf, high: float = math.inf, unit: str = "") -> float:
    """The number that was typed; point and comma are both decimal separators."""
    of = f" {unit}" if unit else ""
    limits = f"{shown_number(low)} to {shown_number(high)}{of}"
    typed = text.strip(" \t\r\n")
    shown = typed if len(typed) <= _LONGEST else f"{typed[:_LONGEST]}..."
    if not typed:
        raise UserError("The field is empty.", f"Enter {limits}.")
    if not _NUMBER.fullmatch(typed):
        fix = f"Enter digits and at most one decimal point: {limits}."
        if _GROUPED.fullmatch(typed):
            fix = f"Write it without digit grouping, such as 1234.5; enter {limits}."
        raise UserError(f"'{shown}' is not a number.", fix)
    if _TWOFOLD.fullmatch(typed):
        point, whole = typed.replace(",", "."), typed.replace(",", "")
        fix = f"Write {point}, or {whole} without grouping; enter {limits}."
        raise UserError(f"'{shown}' may be {point} or {whole}.", fix)
    value = float(typed.replace(",", ".").replace("\u2212", "-"))
    if not low <= value <= high or math.isinf(value):
        raise UserError(f"{shown}{of} is outside the limits.", f"Enter {limits}.")
    return value + 0.0  # -0 is 0


def refuse_unplain_number(name: str, text: str, whole: bool) -> None:
    """Reject a word of the command line that is not a finite decimal number."""
    if not (_WHOLE if whole else _PLAIN).fullmatch(text) or math.isinf(float(text)):
        kind, example = ("a whole", "10") if whole else ("a finite", "2.5 or 1e-3")
        shown = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
        raise UserError(
            f"{name} {shown}: not {kind} number.",
            f"Write it with digits 0 to 9, no grouping and no decimal comma, such as {example}.",
        )
