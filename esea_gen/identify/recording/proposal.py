"""Propose a mapping for a recording: columns, units, sign and zero, each with its reason."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_gen.identify.recording.tables import ANGLE, FORCE, LENGTH, TIME, TORQUE, VOLTAGE
from esea_gen.language.ports import Array
from esea_gen.tables import FileTable, TableFormat, read_table

# Words of a column's name, by quantity; the first ones are the surer.
WORDS = {
    "time": "t time zeit temps timestamp elapsed",
    "deflection": "theta deflection twist angle winkel phi displacement disp extension stroke "
    "travel weg position pos strain encoder x",
    "torque": "tau torque moment drehmoment force kraft load cell loadcell bridge signal f m",
}
UNITS = {
    "time": dict.fromkeys(TIME),
    "deflection": dict.fromkeys([*ANGLE, *LENGTH]),
    "torque": dict.fromkeys([*TORQUE, *FORCE, *VOLTAGE]),
}
ALIASES = {
    "°": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "radians": "rad", "sec": "s",
    "seconds": "s", "msec": "ms", "µs": "us", "µm": "um", "µv": "uV", "n·m": "Nm", "n*m": "Nm",
    "n.m": "Nm", "n m": "Nm", "mn·m": "mNm", "newton": "N", "volt": "V", "volts": "V",
}  # fmt: skip
USUAL = {
    "delimiter": ",", "quote": '"', "decimal": ".", "encoding": "utf-8", "header_line": 1,
    "first_data_line": None,
}  # fmt: skip
PREAMBLE = 30  # lines above a header that are tried
STILL = 0.02  # of its range: a signal that begins so near 0 has its zero
TURN = 1.6  # rad; a coupling turns less
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
    """Inspect a recording; what no name and no number shows is left out, and named."""
    table, units = _read(recording)
    named = [n for n in table.names if n in table.cells]
    found = _columns(table, named, units)
    columns = {what: table.numbers(name) for what, (name, _, _) in found.items()}
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
    for what in ("deflection", "torque"):
        rows += _table_rows(proposal, what, found[what], columns[what], falls)
    rows += ["", "[sampling]"]
    if "time" in found:
        name, unit, why = found["time"]
        unit = unit or "s"
        step = float(np.median(np.diff(columns["time"]))) * TIME[unit]
        proposal.lines.append(f"time: column '{name}' ({why}), {unit}; usual step {step:.4g} s")
        rows += [f"time_column = {_quoted(name)}", f'time_unit = "{unit}"']
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
            if len(_numeric(table)) > 1:
                return table, {}
            units = {n: table.texts(n)[0] for n in table.cells if len(table)}
            if len(table) > 1 and any(_unit(u) for u in units.values()):
                under = form.model_copy(update={"first_data_line": int(table.lines[1])})
                table = read_table(recording, None, under, name=recording.name)
                if len(_numeric(table)) > 1:
                    return table, units
        except UserError as error:
            first = error if form is forms[0] else first
    raise first or UserError(
        f"{recording.name}: has fewer than two columns of numbers.",
        "Give a table with deflection and torque.",
    )


def _numeric(table: FileTable) -> list[str]:
    # By the first rows; a NaN or an empty cell does not make a column of text.
    few = table.kept(np.arange(len(table)) < 20, "more") if len(table) else table
    return [n for n in table.cells if _is_numeric(few, n)]


def _is_numeric(table: FileTable, name: str) -> bool:
    try:
        return bool(np.isfinite(table.numbers(name, holes=True)).any())
    except UserError:
        return False


def _unit(text: str) -> str:
    """The unit that a word means, or nothing."""
    known = {u for units in UNITS.values() for u in units}
    return text if text in known else ALIASES.get(text.lower(), "")


def _words(name: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", name)
    return [w for w in re.split(r"[\s_\[\](){},;:/\\-]+", spaced) if w]


def _columns(
    table: FileTable, named: Sequence[str], units: dict[str, str]
) -> dict[str, tuple[str, str, str]]:
    # Quantity: column, its unit or nothing, why.
    numeric = _numeric(table)
    found: dict[str, tuple[str, str, str]] = {}
    ranked = []
    for place, name in enumerate(named):
        words = _words(name)
        unit = _unit(units.get(name, "")) or next((u for w in words[::-1] if (u := _unit(w))), "")
        for what, known in WORDS.items():
            hits = [known.split().index(w.lower()) for w in words if w.lower() in known.split()]
            if unit and unit not in UNITS[what] and what != "time":
                continue
            if hits or (unit in UNITS[what] and len(words) > 1):
                why = "by its name" if hits else "by its unit"
                rank = min(hits, default=99) - 50 * (unit in UNITS[what])
                ranked.append((rank, place, what, (name, unit if unit in UNITS[what] else "", why)))
    for _, _, what, row in sorted(ranked):
        if what not in found and row[0] not in {r[0] for r in found.values()}:
            found[what] = row
    if "time" not in found:
        rest = [n for n in numeric if n not in {r[0] for r in found.values()}]
        if len(rest) > 1 and len(found) < 2 and np.all(np.diff(table.numbers(rest[0])) > 0):
            found["time"] = rest[0], "", "it only rises"
    missing = [what for what in ("deflection", "torque") if what not in found]
    rest = [n for n in numeric if n not in {r[0] for r in found.values()}]
    if len(rest) == len(missing):
        found |= {w: (n, "", "the one left") for w, n in zip(missing, rest, strict=True)}
    elif missing:
        raise UserError(
            f"{table.name}: no column's name shows which is {' and which is '.join(missing)}; its "
            f"columns of numbers are {', '.join(map(repr, numeric)) or 'none'}.",
            "Rename them in the file, such as theta_rad and tau_Nm, or write the mapping by hand: "
            "docs/identify.md.",
        )
    return found


def _table_rows(
    proposal: MappingProposal, what: str, column: tuple[str, str, str], values: Array, falls: bool
) -> list[str]:
    name, unit, why = column
    how = "by the column's name" if unit else "guessed"
    if not unit and what == "deflection":
        unit = "rad" if float(np.ptp(values)) < 2 * TURN else "deg"
        how = f"guessed from its range, {values.min():.4g} to {values.max():.4g}"
    unit = unit or "Nm"
    rows = ["", f"[{what}]", f"column = {_quoted(name)} # {why}", f'unit = "{unit}" # {how}']
    said = f"{what}: column '{name}' ({why}), unit {unit} ({how})"
    if what == "torque" and falls:
        rows.append("sign = -1 # the torque falls with the deflection")
        said += ", sign -1: it falls with the deflection"
    still, start = STILL * float(np.ptp(values)), float(np.median(values[:5]))
    if abs(start) > still:
        at_rest = float(np.ptp(values[:5])) <= still
        zero = "first" if at_rest else "middle"
        reason = f"it begins {'at rest' if at_rest else 'in motion'} at {start:.4g}"
        rows.append(f'zero = "{zero}" # {reason}')
        said += f", zero: {zero} ({reason})"
    proposal.lines.append(said)
    for key, units in SCALED.items():
        rows += _needed(proposal, what, key) if unit in units else []
    return rows


def _needed(proposal: MappingProposal, table: str, key: str) -> list[str]:
    proposal.missing.append(f"{table}.{key}: {NEEDED[key]}")
    return [
        f"# Fill in: {NEEDED[key]}",
        f'# {key} = {{ value = , status = "assumed", source = "" }}',
    ]
