"""Long lines of finished C, broken where a reader would break them; no other character changes."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

WIDTH = 100
_INDENT = 8  # of what continues a line
_LAST = 99  # where a line is broken only when nothing else helps
_TRAILING = re.compile(r"^(?P<code>.*\S)\s*/\*\s*(?P<text>((?!\*/).)*?)\s*\*/$")
# A prefix of a line inside a comment: spaces, a star, and what indents its text.
_INSIDE = re.compile(r"^(?P<lead>\s*/\*\s*|\s*\*?\s*)(?P<text>.*)$")
# Looser first: where two stand equally deep, a line is broken at the looser one.
_OPERATORS = (("?", ":"), ("||",), ("&&",), ("|",), ("<", "<=", "==", "!=", ">", ">="))
_TIGHT = (("+", "-"), ("*", "/", "%"))
_LOOSENESS = {op: k for k, group in enumerate((*_OPERATORS, *_TIGHT), 2) for op in group}


@dataclass(frozen=True)
class _Break:
    """A place where a line of code may break, and the start of the next part."""

    at: int
    after: int
    depth: int
    looseness: int


def wrap(text: str, width: int = WIDTH) -> str:
    """C text with its lines broken at ``width``.

    A comment behind code that does not fit goes above it. What cannot be broken (a long name, a
    string) stays.
    """
    if all(len(line) <= width for line in text.splitlines()):
        return text
    lines: list[str] = []
    inside = False
    for line in text.splitlines():
        opens = line.rfind("/*") > line.rfind("*/")
        if len(line) <= width:
            lines.append(line)
        elif inside or line.lstrip().startswith("/*"):
            lines += _comment(line, width, inside)
        else:
            lines += _code(line, width)
        inside = opens or (inside and "*/" not in line)
    return "\n".join(lines) + ("\n" if text.endswith("\n") else "")


def _comment(line: str, width: int, inside: bool) -> list[str]:
    found = _INSIDE.match(line)
    assert found is not None
    lead, text = found["lead"], found["text"]
    # Columns of a table, set apart by several blanks, continue under the last of them.
    column = max((m.end() for m in re.finditer(r"\S {2,}(?=\S)", line)), default=0)
    start = len(lead) - len(lead.lstrip()) + (0 if inside else 1)
    blank = " " * start + "*"
    indent = column if len(lead) < column <= width // 2 else len(lead)
    return textwrap.wrap(
        text,
        width,
        initial_indent=lead,
        subsequent_indent=blank.ljust(indent),
        break_long_words=False,
        break_on_hyphens=False,
        drop_whitespace=True,
        replace_whitespace=False,
    )


@lru_cache(maxsize=1 << 14)  # most lines are rendered more than once
def _code(line: str, width: int) -> list[str]:
    indent = len(line) - len(line.lstrip())
    trailing = _TRAILING.match(line)
    if trailing and trailing["text"]:
        above = f"{' ' * indent}/* {trailing['text']} */"
        return wrap(f"{above}\n{trailing['code']}", width).splitlines()
    macro = line.startswith("#")
    return list(_broken(line, indent, width - 2 if macro else width, " \\" if macro else ""))


def _broken(line: str, indent: int, width: int, end: str) -> Iterator[str]:
    breaks = list(_breaks(line))
    shallowest = min((b.depth for b in breaks if b.looseness < _LAST), default=0)
    start, pad = 0, ""
    while len(pad) + len(line) - start > width:
        most = start + width - len(pad)
        fits = [b for b in breaks if start < b.at <= most]
        # Not so early that the line is hardly begun, unless there is no other place.
        late = [b for b in fits if b.at - start > (width - indent) // 3] or fits
        if not late:
            late = [b for b in breaks if b.at > start][:1]
            if not late:
                break
        best = min(late, key=lambda b: (b.depth, b.looseness, -b.at))
        yield pad + line[start : best.at].rstrip() + end
        deeper = max(best.depth - shallowest, 0) if best.looseness < _LAST else 0
        start, pad = best.after, " " * (indent + _INDENT + 4 * min(deeper, 3))
    yield pad + line[start:]


def _breaks(line: str) -> Iterator[_Break]:
    depth, quote, i = 0, "", len(line) - len(line.lstrip())
    while i < len(line):
        c = line[i]
        if quote:
            i += c == "\\"
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c in "([{":
            depth += 1
            if c == "(" and line[i - 1].isidentifier():
                yield _Break(i + 1, i + 1, depth + _LAST, _LAST)
        elif c in ")]}":
            depth -= 1
        elif c == " ":
            word = line[i + 1 :].split(" ", 1)[0]
            before = line[:i].rsplit(" ", 1)[-1]
            if before[-1:] in ",;":
                yield _Break(i, i + 1, depth, 1)
            elif before in ("=", "+=", "|="):
                yield _Break(i, i + 1, depth + _LAST, _LAST)
            elif word in _LOOSENESS and before not in _LOOSENESS:
                yield _Break(i, i + 1, depth, _LOOSENESS[word])
        i += 1
