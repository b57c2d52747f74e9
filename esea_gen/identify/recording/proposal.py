"""Propose a mapping for a recording: columns, units, sign and zero, each with its reason."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_gen.identify.recording.tables import ANGLE, FORCE, LENGTH, TIME, TORQUE, VOLTAGE
from esea_gen.language.ports import Array
from esea_gen.tables import FileTable, TableFormat, read_table
from esea_gen.tables.table import COMMA, POINT, listed

# Words of a column's name, by quantity.
WORDS = {
    "time": "t time zeit temps timestamp elapsed",
    "deflection": "theta deflection twist angle winkel phi displacement disp extension stroke "
    "travel weg position pos strain encoder x",
    "torque": "tau torque moment drehmoment force kraft load cell loadcell bridge signal f m",
}
UNITS = {"time": [*TIME], "deflection": [*ANGLE, *LENGTH], "torque": [*TORQUE, *FORCE, *VOLTAGE]}
# Units as people spell them, in exactly these letters: mNm is not MNm, nor nm Nm.
SPELT = {u: u for units in UNITS.values() for u in units} | {
    "°": "deg", "degree": "deg", "degrees": "deg", "Deg": "deg", "radian": "rad", "radians": "rad",
    "sec": "s", "seconds": "s", "msec": "ms", "µs": "us", "μs": "us", "µm": "um", "μm": "um",
    "inch": "in", "newton": "N", "Newton": "N", "volt": "V", "Volt": "V", "volts": "V",
    "µV": "uV", "μV": "uV",
}  # fmt: skip
SPELT |= {f"{p}N{dot}m": f"{p}Nm" for p in ("", "m", "k") for dot in "·⋅*. -"}
SPELT |= {f"N{dot}cm": "Ncm" for dot in "·⋅*. -"}
RATE = "rate"  # of none of the quantities
SPELT |= {f"{u}{per}s": RATE for u in ("rad", "deg", "°", "m", "mm") for per in "/ "}
PARTS = {*SPELT, "ft", "lb", "lbs", "oz", "kg", "g"}  # of a unit in several words
USUAL = {
    "delimiter": ",", "quote": '"', "decimal": ".", "encoding": "utf-8", "header_line": 1,
    "first_data_line": None,
}  # fmt: skip
PREAMBLE = 30  # lines above a header that are tried
STILL = 0.02  # of its range: what lies so near 0 lies there
STEPS_S = (1e-5, 0.2)  # usual; beyond, the unit is asked for
SCALED = {
    "scale_rad_per_m": [*LENGTH],
    "scale_Nm_per_N": [*FORCE, *VOLTAGE],
    "sensitivity_mV_per_N": [*VOLTAGE],
}
NEEDED = {  # what a unit needs besides, and how to get it
    "scale_rad_per_m": "1 / radius at which the length was measured (m)",
    "scale_Nm_per_N": "lever arm of the force (m)",
    "sensitivity_mV_per_N": "rated output (mV/V) x excitation (V) / capacity (N), of the load "
    "cell's data sheet; of a torque sensor, mV per Nm and scale_Nm_per_N = 1",
    "period_s": "sampling period (s); the file has no time column",
}


@dataclass
class MappingProposal:
    text: str
    lines: list[str]  # for people: what was proposed, and why
    missing: list[str] = field(default_factory=list)  # keys to fill in by hand

    def write(self, path: Path) -> None:
        with new_whole(path) as scratch:
            scratch.write_text(self.text, encoding="utf-8")


def propose_mapping(recording: Path) -> MappingProposal:
    """Inspect a recording; settings that neither names nor numbers show are omitted and listed."""
    table, units = _read(recording)
    found = _columns(table, units)
    columns = {what: table.numbers(name) for what, (name, _) in found.items()}
    proposal = MappingProposal("", [table.report()])
    if "time" in found and not found["time"][1] and np.all(np.diff(columns["time"]) == 1):
        proposal.lines.append(f"column '{found.pop('time')[0]}' counts samples")
    title = re.sub(r"[^a-z0-9_]+", "_", recording.stem.lower()).strip("_")
    rows = [
        f"# Proposed from {_quoted(recording.name)}. Check every line; see docs/identify.md.",
        "schema = 1\n\n[device]",
        f'name = "{(title if title[:1].isalpha() else f"d_{title}")[:15]}"',
        f"title = {_quoted(recording.stem)}",
        "rate_terms = false # true: also fit the published Maxwell element; needs time",
    ]
    theta, tau = columns["deflection"], columns["torque"]
    for what in ("deflection", "torque"):
        if not np.ptp(columns[what]):
            raise UserError(
                f"{recording.name}: column '{found[what][0]}', taken for the {what}, is constant.",
                "Rename the columns, such as theta_rad and tau_Nm, or record a motion.",
            )
    with np.errstate(all="ignore"):
        falls = bool(np.sum((theta - theta.mean()) * (tau - tau.mean())) < 0)
    zeros = _zeros(theta, tau)
    for what in ("deflection", "torque"):
        rows += _table_rows(proposal, what, found[what], columns[what], falls, zeros[what])
    rows += ["", "[sampling]"]
    if "time" in found:
        name, unit = found["time"]
        step = float(np.median(np.diff(columns["time"])))
        if step <= 0:
            raise UserError(
                f"{recording.name}: column '{name}', taken for the time, does not rise: its usual "
                f"step is {step:.4g}.",
                "Put its rows in the order in which they were recorded.",
            )
        step_s = step * TIME.get(unit, math.nan)
        if step_s < STEPS_S[0] or step_s > STEPS_S[1]:
            unit = f"{unit} (a usual step of {step_s:.4g} s)"
        said = f"time: column '{name}', usual step {step:.4g}"
        rows.append(f"time_column = {_quoted(name)}")
        rows += _unit_row(proposal, "sampling", "time_unit", unit, "time", said)
    else:
        proposal.lines.append("time: no column of time")
        rows += _needed(proposal, "sampling", "period_s")
    form = {k: getattr(table.form, k) for k in USUAL}
    form = {k: v for k, v in form.items() if v is not None and v != USUAL[k]}
    if form:
        rows += ["", "[format]", *(f"{k} = {_quoted(v)}" for k, v in form.items())]
    rows += ["", "[[recording]]", f"files = [{_quoted(recording.name)}]", ""]
    proposal.text = "\n".join(rows)
    return proposal


def _quoted(text: str | int) -> str:
    return json.dumps(text, ensure_ascii=False)


def _read(recording: Path) -> tuple[FileTable, dict[str, str]]:
    # As it is; with quotes as text; from Windows; without a header; below a preamble.  Each also
    # with a line of units under the header.
    forms = [TableFormat(), TableFormat(quote=""), TableFormat(encoding="cp1252")]
    forms += [TableFormat(header_line=0)]
    forms += [TableFormat(header_line=k) for k in range(2, PREAMBLE)]
    first: UserError | None = None
    for form in forms:
        try:
            table = read_table(recording, None, form, name=recording.name)
            if form.header_line != 0 and _no_names(table):
                continue
            top = table.kept(np.arange(len(table)) < 1, "more")
            units = {n: top.texts(n)[0] for n in table.cells if len(table)}
            if len(table) > 1 and any(u.strip("[](){} ") in SPELT for u in units.values()):
                under = form.model_copy(update={"first_data_line": int(table.lines[1])})
                table = read_table(recording, None, under, name=recording.name)
                if len(_numeric(table)) > 1:
                    return table, units
            elif len(_numeric(table)) > 1:
                return table, {}
        except UserError as error:
            first = error if form is forms[0] else first
    raise first or UserError(
        f"{recording.name}: has fewer than two columns of numbers under a line of names.",
        "Give a table with deflection and torque.",
    )


def _no_names(table: FileTable) -> bool:
    # A line of numbers or of units that is not the header.
    names = [n.strip("[](){} ") for n in table.names if n]
    number = any(POINT.fullmatch(n) or COMMA.fullmatch(n) for n in names)
    return number or {*names} <= {*SPELT}


def _numeric(table: FileTable) -> list[str]:
    # By the first rows; a NaN or an empty cell does not make a column of text.
    few = table.kept(np.arange(len(table)) < 20, "more") if len(table) else table
    return [n for n in table.cells if _is_numeric(few, n)]


def _is_numeric(table: FileTable, name: str) -> bool:
    try:
        return bool(np.isfinite(table.numbers(name, holes=True)).any())
    except UserError:
        return False


def named(name: str, row: str = "") -> tuple[set[str], str]:
    """Possible meanings of a column, by its words and the unit in its name or a line of units."""
    name = re.sub(r"\s*/\s*", "/", name)
    inside = re.findall(r"[\[({]([^\[\](){}]*)[\])}]", name)
    words = re.split(r"[\s_,;:\"-]+", re.sub(r"[\[({].*?[\])}]", " ", name).strip(' "'))
    run = [*takewhile(PARTS.__contains__, words[:0:-1])][::-1]
    stated = (*inside[-1:], " ".join(run), row.strip("[](){} "))
    unit = " and ".join(sorted({SPELT.get(u, u) for t in stated if (u := t.strip())}))
    head = " ".join(words[: len(words) - len(run)])
    head = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", head).lower()
    by_word = {q for q, known in WORDS.items() if {*re.split(r"\W+", head)} & {*known.split()}}
    by_unit = {q for q, known in UNITS.items() if unit in known}
    return set() if unit == RATE else by_word & by_unit or by_word | by_unit, unit


def _columns(table: FileTable, units: dict[str, str]) -> dict[str, tuple[str, str]]:
    """Each quantity's column, the only one that may be it, and the unit as stated."""
    may = {n: named(n, units.get(n, "")) for n in _numeric(table)}
    found: dict[str, tuple[str, str]] = {}
    for what in WORDS:
        names = [n for n, (kinds, _) in may.items() if what in kinds]
        if len(names) == 1 and len(may[names[0]][0]) == 1:
            found[what] = names[0], may[names[0]][1]
        elif names or what != "time":
            raise UserError(
                f"{table.name}: the names do not show which column of numbers is the {what}: "
                f"{listed(names or [*may])}.",
                "Name them in a copy of the file, such as time_s, theta_rad and tau_Nm, and only "
                "one for each; or write the mapping by hand: docs/identify.md.",
            )
    return found


def _zeros(theta: Array, tau: Array) -> dict[str, tuple[str, str]]:
    """Offsets of both to subtract, if the numbers show them; and the reason."""
    both = {"deflection": theta, "torque": tau}
    near = {w: STILL * float(np.ptp(x)) for w, x in both.items()}
    if all(abs(x[0]) <= near[w] for w, x in both.items()):
        return dict.fromkeys(both, ("none", "both begin at 0"))
    found = {}
    for what, x in both.items():
        low, high = float(x.min()), float(x.max())
        middle, said = (low + high) / 2, f"begins at {x[0]:.4g}, {low:.4g} to {high:.4g}"
        away = np.abs(x - x[0])
        left, far = (int(np.argmax(away > a)) for a in (near[what], (high - low) / 4))
        found[what] = "", said
        if abs(middle) <= near[what]:
            found[what] = "none", f"as far to both sides, {low:.4g} to {high:.4g}"
        elif abs(x[0] - middle) <= near[what] and 2 * left >= far:  # longer than a reversal takes
            found[what] = "first", f"at rest at {x[0]:.4g}, then as far to both sides"
    if all(abs(x[0]) > near[w] for w, x in both.items()):  # it may rest under load
        found |= {w: ("", said) for w, (zero, said) in found.items() if zero == "first"}
    return found


def _table_rows(
    proposal: MappingProposal,
    what: str,
    column: tuple[str, str],
    values: Array,
    falls: bool,
    zero: tuple[str, str],
) -> list[str]:
    name, unit = column
    said = f"{what}: column '{name}', {values.min():.4g} to {values.max():.4g}"
    rows = ["", f"[{what}]", f"column = {_quoted(name)}"]
    rows += _unit_row(proposal, what, "unit", unit, what, said)
    if what == "torque" and falls:
        rows.append("sign = -1 # the torque falls with the deflection")
        proposal.lines.append("torque: sign -1, it falls with the deflection")
    if zero[0]:
        rows.append(f'zero = "{zero[0]}" # {zero[1]}')
        proposal.lines.append(f"{what}: zero {zero[0]} ({zero[1]})")
    else:
        rows += _asked(proposal, what, "zero", f"none, first, mean or middle; it {zero[1]}")
    for key, units in SCALED.items():
        rows += _needed(proposal, what, key) if unit in units else []
    return rows


def _unit_row(
    proposal: MappingProposal, table: str, key: str, unit: str, what: str, said: str
) -> list[str]:
    known = unit in UNITS[what]
    proposal.lines.append(f"{said}{f', unit {unit}' if known else ''}")
    if known:
        return [f'{key} = "{unit}"']
    stated = _quoted(unit) if unit else "nothing"
    return _asked(proposal, table, key, f"stated is {stated}; known: {', '.join(UNITS[what])}")


def _asked(proposal: MappingProposal, table: str, key: str, text: str) -> list[str]:
    proposal.missing.append(f"{table}.{key}: {text}")
    return [f'{key} = "" # Fill in: {text}']


def _needed(proposal: MappingProposal, table: str, key: str) -> list[str]:
    proposal.missing.append(f"{table}.{key}: {NEEDED[key]}")
    return [
        f"# Fill in: {NEEDED[key]}",
        f'# {key} = {{ value = , status = "assumed", source = "" }}',
    ]
