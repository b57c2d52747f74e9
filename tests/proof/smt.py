"""Formulas for z3: shared definitions, a question, an answer."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass, field

from esea_gen.hostlib.compiler import find_compiler

FLOAT = "(_ FloatingPoint 8 24)"
RESOURCES_A_SECOND = 700_000  # z3's own measure, the same on a busy machine
TRUE, FALSE = "true", "false"


def word(bits: int) -> str:
    """Sort of a word."""
    return f"(_ BitVec {bits})"


def whole(value: int, bits: int) -> str:
    """A whole number, modulo 2**bits."""
    return f"(_ bv{value % 2**bits} {bits})"


def every(*terms: str) -> str:
    """Conjunction; of nothing: true."""
    if FALSE in terms:
        return FALSE
    found = [t for t in terms if t != TRUE]
    return f"(and {' '.join(found)})" if len(found) > 1 else (found or [TRUE])[0]


def some(*terms: str) -> str:
    """Disjunction; of nothing: false."""
    if TRUE in terms:
        return TRUE
    found = [t for t in terms if t != FALSE]
    return f"(or {' '.join(found)})" if len(found) > 1 else (found or [FALSE])[0]


def negated(term: str) -> str:
    """The other truth value."""
    return {TRUE: FALSE, FALSE: TRUE}.get(term, f"(not {term})")


def implied(condition: str, result: str) -> str:
    """The result, where the condition holds."""
    return f"(=> {condition} {result})"


@dataclass
class Script:
    """Declarations and definitions; an expression that comes twice is defined once."""

    declared: dict[str, str] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    known: dict[str, str] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)

    def unknown(self, name: str, sort: str) -> str:
        """A value that may be anything of its sort."""
        quoted = f"|{name}|"
        if quoted not in self.declared:
            self.declared[quoted] = sort
            self.lines.append(f"(declare-const {quoted} {sort})")
        return quoted

    def define(self, sort: str, text: str) -> str:
        """A name for an expression."""
        if not text.startswith("("):
            return text
        name = self.known.get(text)
        if name is None:
            name = self.known[text] = f"n{len(self.known)}"
            self.texts[name] = text
            self.lines.append(f"(define-fun {name} () {sort} {text})")
        return name

    def fact(self, text: str) -> None:
        """What is known of the unknown."""
        self.lines.append(f"(assert {text})")


@dataclass(frozen=True)
class Answer:
    """What z3 said."""

    said: str
    example: dict[str, str]


def ask(script: Script, question: str, limit_s: int) -> Answer:
    """Whether any values satisfy the question."""
    logic = "QF_FPBV" if FLOAT in script.declared.values() else "QF_BV"
    text = "\n".join(
        [
            f"(set-option :rlimit {RESOURCES_A_SECOND * limit_s})",
            f"(set-logic {logic})",
            *script.lines,
            f"(assert {question})",
            "(check-sat)",
        ]
    )
    names = sorted(script.declared)
    done = subprocess.run(
        [find_compiler("z3", "z3"), "-in"],
        input=f"{text}\n(get-value ({' '.join(names)}))\n",
        capture_output=True,
        text=True,
        check=False,
        timeout=20 * limit_s + 60,
    )
    first, _, rest = done.stdout.partition("\n")
    said = "unknown" if first == "timeout" else first
    # Without a model get-value is an error; before check-sat none may stand.
    if said not in ("sat", "unsat", "unknown") or done.stderr:
        raise RuntimeError(f"z3 did not understand:\n{(done.stdout + done.stderr)[:2000]}")
    # A value is an atom, or one pair of brackets: (fp #b0 #x7f #b0...).
    pairs = re.findall(r"\((\|[^|]+\|)\s+(\([^()]*\)|[^\s()]+)\)", rest) if said == "sat" else []
    return Answer(said, {name.strip("|"): value for name, value in pairs})
