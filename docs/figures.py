"""Write the tables of measured figures into the pages: `make figures [TABLES="name ..."]`.

A table, or a figure within a sentence, is between two marks of its page; `figures.toml` has its
commands and columns.  One with unchanged inputs is skipped, a command that has run is not repeated,
and an interrupted campaign is continued.  `--check` reports blocks that were edited by hand, and
numbers outside a block that only a measurement, a simulation or a count gives.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import re
import shlex
import statistics
import string
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen.files import write_whole

DOCS = Path(__file__).parent
ROOT = DOCS.parent
KEPT = ROOT / "out" / "figures"
BLOCK = re.compile(
    r"<!-- figures:(?P<name>[\w-]+)(?::(?P<date>[\d-]+):(?P<inputs>\w+):(?P<text>\w+))? -->\n?"
    r"(?P<inner>.*?)<!-- /figures -->",
    re.DOTALL,
)
# What is no text of a page, and what only a measurement, a simulation or a count gives.
ASIDE = re.compile(BLOCK.pattern + r"|```.*?```|`[^`\n]*`", re.DOTALL)
MEASURED = re.compile(
    r"\d[\d.e-]*\s?(?:mNm|µs|ns|ULP|[kKMG]B|bytes|instructions|hours)\b"
    r"|\d+ of \d+|\d\d+ (?:\w+ )?runs\b"
    r"|(?:[Ee]rror|RMS|[Mm]edian|[Mm]easured|[Ss]imulated|[Ww]orst)\b[^.|:()]{0,40}?"
    r"\d+\.\d+(?:e-?\d+)?\s?(?:Nm|rad|ms|%|J)"
    r"|^\|.*(?:\| ?[-−]?\d*\.\d[^|\n]*|\| ?\de-\d[^|\n]*){3}\|",
    re.MULTILINE,
)
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
ENDED = ("unstable", "tripped", "fault", "failure")
WORDS = {"True": "yes", "False": "no"}
PROGRAMS = {"esea-gen": ["-m", "esea_gen.cli"], "esea-host": ["-m", "esea_host.cli"], "python": []}
CONTINUED = ("esea-gen simulate", "esea-gen faults")


@dataclass(frozen=True)
class FigureColumn:
    head: str
    show: str  # a template for an entry; or `median`, of the RMS errors, or `largest KEY`
    of: Sequence[int] = ()  # results of these commands only
    where: Mapping[str, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class FigureTable:
    name: str
    commands: Sequence[str]
    inputs: Sequence[str]  # files and folders that the commands read
    cpu_s: float
    how: str = "Simulated"
    scatter: float = 0.02  # share by which a figure may differ; one unit of the last digit always
    sample: bool = False  # regenerated in CI
    rows: str = ""  # path of the entries in a result; `*`: of all keys
    where: Mapping[str, Sequence[str]] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    columns: Sequence[FigureColumn] = ()
    most: int | None = None  # rows
    text: str = ""  # instead, of one figure: a template for the results, by their place

    @property
    def by_hand(self) -> bool:
        return not (self.columns or self.text)


@cache
def registry() -> dict[str, Any]:
    return tomllib.loads((DOCS / "figures.toml").read_text(encoding="utf-8"))


@cache
def tables() -> dict[str, FigureTable]:
    content = registry()
    found = {}
    for name, row in content["table"].items():
        columns = tuple(FigureColumn(*c[:2], *c[2:]) for c in row.pop("columns", ()))
        inputs = [p for i in row.pop("inputs", ["loop"]) for p in content["inputs"].get(i, [i])]
        listed = row.pop("commands")
        commands = [" ".join(c.format(**content["laws"]).split()) for c in listed]
        found[name] = FigureTable(name, commands, inputs, columns=columns, **row)
    for name, (how, minutes, command) in content["by_hand"].items():
        found[name] = FigureTable(name, [command], [], 60 * minutes, how)
    return found


# -- drawing a table ------------------------------------------------------------------------------


class Entry(dict[Any, Any]):
    """A dictionary that templates may ask by a number too."""

    def __missing__(self, key: Any) -> Any:
        if isinstance(key, int):
            return self[str(key)]
        raise KeyError(key)


class Cells(string.Formatter):
    """`{x:.1f}`, a dash for what is missing; `{x!n}` counts what is true in lists of lists."""

    def format_field(self, value: Any, format_spec: str) -> str:
        return "–" if value is None else str(super().format_field(value, format_spec))

    def convert_field(self, value: Any, conversion: Any) -> Any:
        return counted(value) if conversion == "n" else super().convert_field(value, conversion)


def counted(value: Any) -> int:
    return sum(map(counted, value)) if isinstance(value, list) else int(bool(value))


def filled(template: str, entry: Mapping[str, Any]) -> str:
    return Cells().vformat(template, (), entry)


def entries(result: Any, path: Sequence[str], key: str = "") -> Iterator[Entry]:
    if isinstance(result, list) and path and path[0].isdigit():
        yield from entries(result[int(path[0])], path[1:], key)
    elif isinstance(result, list) and not (result and isinstance(result[0], float)):
        for one in result:
            yield from entries(one, path, key)
    elif path and path[0] == "*":
        for name, one in result.items():
            yield from entries(one, path[1:], f"{key}, {name}" if key else name)
    elif path:
        yield from entries(result[path[0]], path[1:], key)
    else:
        yield Entry({"key": key, **(result if isinstance(result, dict) else {"value": result})})


def fits(entry: Mapping[str, Any], where: Mapping[str, Sequence[str]]) -> bool:
    return all(str(entry[k]) in allowed for k, allowed in where.items())


def errors(runs: Sequence[Mapping[str, Any]]) -> str:
    """Median over the seeds of the mean over the cases; how many runs ended early."""
    by_seed: dict[int, list[float]] = {}
    for e in runs:
        if e["rms_true_Nm"] is not None:
            by_seed.setdefault(e["seed"], []).append(e["rms_true_Nm"])
    means = [statistics.fmean(v) for v in by_seed.values()] or [float("nan")]
    ended = sum(any(e.get(k) for k in ENDED) for e in runs)
    more = f" ({ended} of {len(runs)} ended)" if ended else ""
    return f"{statistics.median(means):.3f}{more}"


def draw(table: FigureTable, found: Sequence[Any]) -> list[str]:
    path = table.rows.split(".") if table.rows else []
    every = [(k, e) for k, result in enumerate(found) for e in entries(result, path)]
    every = [(k, e) for k, e in every if fits(e, table.where)]
    label = table.columns[0].show
    rows = []
    for name in dict.fromkeys(filled(label, e) for _, e in every):
        cells = []
        for c in table.columns:
            mine = [
                e
                for k, e in every
                if filled(label, e) == name and (not c.of or k in c.of) and fits(e, c.where)
            ]
            text = filled(c.show, mine[0])
            if c.show == "median":
                text = errors(mine)
            elif c.show.startswith("largest "):
                text = f"{max(e[c.show.split()[1]] for e in mine):.3f}"
            cells.append(" ".join(WORDS.get(w, w) for w in text.split()))
        rows.append(reworded(f"| {' | '.join(cells)} |", table))
    heads = [c.head for c in table.columns]
    return [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads), *rows[: table.most]]


def reworded(line: str, table: FigureTable) -> str:
    for old, new in table.words.items():
        line = line.replace(old, new)
    return line


# -- running the commands -------------------------------------------------------------------------


def digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:12]


@cache
def place_digest(place: str) -> str:
    path = ROOT / place
    files = [path] if path.is_file() else [p for p in sorted(path.rglob("*")) if p.is_file()]
    kept = [p for p in files if "__pycache__" not in p.parts]
    return digest(*[f"{p.relative_to(ROOT)} {content(p)}" for p in kept])


def content(path: Path) -> str:
    """Digest of a file; of Python without comments and docstrings, which decide no figure."""
    if path.suffix != ".py":
        return hashlib.sha256(path.read_bytes()).hexdigest()
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        match body:
            case [ast.Expr(ast.Constant(str())), *_]:
                vars(node)["body"] = body[1:]
    return digest(ast.dump(tree))


def inputs_of(table: FigureTable) -> str:
    drawn_as = table.text or repr((table.rows, table.where, table.words, table.columns))
    return digest(*map(place_digest, table.inputs), *map(with_files, table.commands), drawn_as)


def with_files(command: str) -> str:
    """A command, and what its device files of the registry hold."""
    return command + "".join(t for n, t in registry()["files"].items() if n in command)


def result_of(command: str, table: FigureTable, jobs: int) -> Any:
    """What a command writes as JSON; of an earlier run if nothing has changed since."""
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"{digest(*map(place_digest, table.inputs), with_files(command))}.json"
    if not path.exists():
        for name, text in registry()["files"].items():
            (KEPT / name).write_text(text, encoding="utf-8")
        program, *words = shlex.split(command)
        call = [sys.executable, *PROGRAMS[program], *words]
        if command.startswith(CONTINUED):
            call += ["--resume", str(path.with_suffix("")), "--jobs", str(jobs)]
        part = path.with_suffix(".part")
        call += ["--json", str(part)]
        done = subprocess.run(call, cwd=ROOT, check=False, stdout=subprocess.DEVNULL)
        if done.returncode > 1 or not part.exists():
            raise SystemExit(f"{table.name}: `{command}` ended with code {done.returncode}.")
        part.rename(path)
    return json.loads(path.read_text(encoding="utf-8"), object_hook=Entry)


def computed(table: FigureTable, jobs: int = -1) -> list[str]:
    found = [result_of(command, table, jobs) for command in table.commands]
    if table.text:
        return [reworded(Cells().vformat(table.text, found, {}), table)]
    return draw(table, found)


# -- the pages ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FigureBlock:
    page: Path
    name: str
    date: str
    inputs: str
    text: str  # hash of what is between the marks
    inner: str


def blocks(folder: Path) -> dict[str, FigureBlock]:
    """Every block of the pages by its name."""
    found: dict[str, FigureBlock] = {}
    for page in sorted(folder.glob("*.md")):
        content = page.read_text(encoding="utf-8")
        here = [FigureBlock(page, **m.groupdict(default="")) for m in BLOCK.finditer(content)]
        if content.count("<!-- figures:") != len(here):
            raise SystemExit(f"{page}: a block of figures without its end.")
        if twice := [b.name for b in here if b.name in found]:
            raise SystemExit(f"{page}: {', '.join(twice)} is on another page too.")
        found |= {b.name: b for b in here}
    return found


def write(block: FigureBlock, lines: Sequence[str], when: object) -> None:
    table = tables()[block.name]
    one = len(table.commands) == 1
    what = table.commands[0] if one else f"make figures TABLES={table.name}"
    by_hand = ", by hand" if table.by_hand else ""
    inner = "\n".join(["", *lines, "", f"*{table.how}{by_hand}; {when}: `{what}`*", "", ""])
    if table.text:
        (inner,) = lines
    head = ":".join((block.name, str(when), inputs_of(table), digest(inner)))
    content = block.page.read_text(encoding="utf-8")
    mark = BLOCK.pattern.replace(r"(?P<name>[\w-]+)", f"(?P<name>{block.name})")
    new = f"<!-- figures:{head} -->{'' if table.text else chr(10)}{inner}<!-- /figures -->"
    new = re.sub(mark, lambda _: new, content, flags=re.DOTALL)
    write_whole(block.page, new)


def problems(folder: Path) -> Iterator[str]:
    found = blocks(folder)
    for name in sorted({*found} ^ {*tables()}):
        yield f"{name}: in a page or in figures.toml, but not in both"
    for name, block in found.items():
        if digest(block.inner) != block.text:
            run = f"make figures TABLES={name}"
            if name in tables() and tables()[name].by_hand:
                run = f"python docs/figures.py --record {name}"
            yield f"{block.page.name}, {name}: edited by hand; run `{run}`"
    for page in [*sorted(folder.glob("*.md")), *folder.parent.glob("README.md")]:
        text = ASIDE.sub("", page.read_text(encoding="utf-8"))
        for number in {*MEASURED.findall(text)} - {*registry()["stated"]}:
            yield f"{page.name}: `{number}` is typed by hand; write it by a table of figures.toml"


def differences(old: str, new: str, scatter: float) -> list[str]:
    """Lines of two tables that differ by more than a share and one unit of the last digit."""
    before, after = ([x for x in t.splitlines() if x.startswith("|")] for t in (old, new))
    if len(before) != len(after):
        return [f"{len(before)} lines, now {len(after)}"]
    return [f"{a}\n  now {b}" for a, b in zip(before, after, strict=True) if apart(a, b, scatter)]


def apart(a: str, b: str, scatter: float) -> bool:
    if NUMBER.sub("#", a) != NUMBER.sub("#", b):
        return True
    pairs = zip(NUMBER.findall(a), NUMBER.findall(b), strict=True)
    return any(abs(float(x) - float(y)) > max(scatter * float(x), digit(x)) for x, y in pairs)


def digit(text: str) -> float:
    """One unit of the last printed digit, with some room for rounding."""
    mantissa, _, power = text.partition("e")
    return float(1.01 * 10 ** (int(power or 0) - len(mantissa.partition(".")[2])))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="tables; default: all that are not current")
    parser.add_argument("--check", action="store_true", help="report blocks edited by hand")
    parser.add_argument("--record", action="store_true", help="date blocks that were run by hand")
    parser.add_argument("--date", type=date.fromisoformat, default=datetime.now(UTC).date())
    parser.add_argument("--jobs", type=int, default=-1, help="parallel processes of a simulation")
    chosen = parser.parse_args()
    found = blocks(DOCS)
    if unknown := sorted({*chosen.names} - {*found}):
        parser.error(f"no such table: {', '.join(unknown)}; there are {', '.join(sorted(found))}")
    if chosen.check:
        wrong = list(problems(DOCS))
        print(
            "\n".join(wrong or ["No block was edited by hand, no measured number is outside one."])
        )
        return bool(wrong)
    for name in chosen.names or sorted(found, key=lambda n: tables()[n].cpu_s):
        block, table = found[name], tables()[name]
        if chosen.record:
            write(block, [x for x in block.inner.splitlines() if x[:1] == "|"], chosen.date)
        elif table.by_hand:
            print(f"{name}: run by hand, {table.cpu_s / 60:.0f} min: {'; '.join(table.commands)}")
        elif block.inputs == inputs_of(table) and digest(block.inner) == block.text:
            print(f"{name}: current")
        else:
            print(f"{name}: about {table.cpu_s:.0f} s of processor time", flush=True)
            write(block, computed(table, chosen.jobs), chosen.date)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("\nStopped. What was computed is kept; the same command goes on.", file=sys.stderr)
        sys.exit(130)
