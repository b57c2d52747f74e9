"""One page a specimen: what was measured, how well the model knows it, how far its life is used.

What an earlier command found is taken from the file that it wrote; a file of another specimen is
refused.  What no file says is not known, and the page names the command that would tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import esea_gen
from esea_gen.device import Device
from esea_gen.devices.fields import field_facts
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError
from esea_gen.files import read_result
from esea_gen.identify import MappingFile, Recording, identify, judge, load_mapping, load_recordings
from esea_gen.identify.compare import THESIS
from esea_gen.identify.family_identification import identify_member
from esea_gen.identify.fit import Progress
from esea_gen.identify.verdict import Verdict
from esea_gen.identify.worth import RATE_EDGES, TORQUE_EDGES
from esea_gen.report import figures
from esea_gen.report.identification import dotted
from esea_gen.report.page import PageSection, finite, render

IDENTIFIED, COMPARED, AGREED, LIFE = "identify", "identify-compare", "reliability", "host-life"
# What the page takes, and what each must hold for it.
KINDS = {
    IDENTIFIED: ("device", "mapping", "recordings", "sets", "mean_rms", "uncertainty", "worth"),
    COMPARED: ("recordings", "full_scale_Nm", "compare", "chosen", "best", "standard_error"),
    AGREED: ("specimens", "rows", "absolute", "consistent", "agreements", "apart_pct"),
    LIFE: ("device", "simulated", "fatigue", "couplings"),
}
NAMES = {COMPARED: "model choice", AGREED: "reliability", LIFE: "life used"}
LIKELY = 1.959964  # deviations that hold 95 % of a normal distribution


@dataclass(frozen=True)
class SpecimenResults:
    """All that is known of a specimen.

    identified: content of the identification's JSON.
    verdict: what the device's C makes of the recordings.
    others: content of the other results, by kind.
    files: name of the file that each result came from, by kind.
    coupling: this specimen's, of the lives; None where no board told of any.
    """

    source: MappingFile
    recordings: tuple[Recording, ...]
    device: Device
    identified: dict[str, Any]
    verdict: Verdict
    others: Mapping[str, dict[str, Any]]
    files: Mapping[str, str]
    coupling: dict[str, Any] | None

    def summary(self) -> list[str]:
        """A few lines for the terminal: the error, and what is not known yet."""
        errors, wanted = self.identified["mean_rms"], self.wanted()
        lines = [f"{self.device.title}: held out {errors['held_out_percent']:.2f} % of full scale"]
        return lines + [f"not known: {NAMES[k]}; {c}" for k, c in wanted.items()]

    def wanted(self) -> dict[str, str]:
        """What is not known yet, by kind, and the command that would tell."""
        commands = {
            COMPARED: f"esea-gen identify {self.source.origin} --compare --json compared.json",
            AGREED: "esea-gen reliability SPECIMENS.toml --json reliability.json",
            LIFE: "esea-host life ADDRESS --json life.json",
        }
        return {k: c for k, c in commands.items() if k not in self.others}


def gather_specimen(
    mapping: Path, results: Sequence[Path], data: Path | None, tell: Progress
) -> SpecimenResults:
    """Read what is known of a specimen; identify it where no result says how.

    Raises
    ------
    UserError
        For a file that is missing, no result, of another specimen, or there twice.
    """
    source = load_mapping(mapping, data)
    given: dict[str, tuple[Path, dict[str, Any]]] = {}
    for path in results:
        content = read_result(path, tuple(KINDS))
        kind = content["schema"]
        missing = [k for k in KINDS[kind] if k not in content]
        if missing:
            raise UserError(f"{path}: has no '{missing[0]}'.", "Make it again with this version.")
        if kind in given:
            raise UserError(f"{path}: {given[kind][0]} is a result of '{kind}' too.", "Give one.")
        given[kind] = path, content
    for kind, check in ((AGREED, _check_agreed), (LIFE, _check_life)):
        if kind in given:
            check(*given[kind], source)
    others = {k: c for k, (_, c) in given.items() if k != IDENTIFIED}
    recordings = tuple(load_recordings(source))
    for kind in {IDENTIFIED, COMPARED} & given.keys():
        _check_recordings(*given[kind], source, recordings)
    if IDENTIFIED in given:
        tell(0.5, "the device's C over the recordings")
        identified = given[IDENTIFIED][1]
        device = _device_of(*given[IDENTIFIED])
        verdict = judge(device, recordings)
        _check_device(given[IDENTIFIED][0], identified, verdict)
    else:
        model = others[COMPARED]["chosen"] if COMPARED in others else THESIS
        result = (
            identify(mapping, data, tell)
            if model == THESIS
            else identify_member(mapping, model, data, tell)
        )
        identified, device, verdict = finite(result.to_dict()), result.device, result.verdict
    if COMPARED in given:
        _check_scale(*given[COMPARED], identified)
    serial = source.mapping.specimen.serial
    mine = [c for c in others.get(LIFE, {}).get("couplings", ()) if c["serial"] == serial]
    files = {k: str(p) for k, (p, _) in given.items()}
    return SpecimenResults(
        source, recordings, device, identified, verdict, others, files, mine[0] if mine else None
    )


def _check_recordings(
    path: Path, content: dict[str, Any], source: MappingFile, recordings: Sequence[Recording]
) -> None:
    theirs = {r["file"]: r["sha256"] for r in content["recordings"]}
    ours = {r.file: r.digest for r in recordings}
    if theirs != ours:
        apart = sorted(f for f in theirs.keys() | ours.keys() if theirs.get(f) != ours.get(f))
        more = f" and {len(apart) - 1} more" if len(apart) > 1 else ""
        raise UserError(
            f"{path}: is of other recordings than {source.origin}; apart: {apart[0]}{more}.",
            "Give this specimen's result, or make it again from these recordings.",
        )


def _check_scale(path: Path, content: dict[str, Any], identified: dict[str, Any]) -> None:
    theirs, ours = content["full_scale_Nm"], identified["full_scale_Nm"]
    if not math.isclose(theirs, ours, rel_tol=1e-9):
        raise UserError(
            f"{path}: its full scale is {theirs:.6g} Nm, the identification's {ours:.6g} Nm: the "
            "mapping file has changed between them.",
            "Make both again.",
        )


def _device_of(path: Path, content: dict[str, Any]) -> Device:
    file = path.parent / f"{Path(content['device']['name']).name}.toml"
    if not file.is_file():
        raise UserError(
            f"{path}: its device file {file.name} is not beside it.",
            "Give the JSON in the folder that esea-gen identify wrote.",
        )
    return esea_gen.load_device(str(file))


def _check_device(path: Path, content: dict[str, Any], verdict: Verdict) -> None:
    said, found = content["mean_rms"], verdict.misfits.means(content["full_scale_Nm"])
    apart = [
        k
        for k in ("training_Nm", "held_out_Nm")
        if (said[k] is None) != (found[k] is None)
        or not math.isclose(said[k] or 0.0, found[k] or 0.0, rel_tol=1e-6)
    ]
    if apart:
        raise UserError(
            f"{path}: says {apart[0]} = {said[apart[0]]:.6g} of these recordings, the device file "
            f"beside it gives {found[apart[0]]:.6g}.",
            "Device file or mapping file have changed since: identify again.",
        )


def _check_agreed(path: Path, content: dict[str, Any], source: MappingFile) -> None:
    name, known = source.mapping.specimen.name, content["specimens"]
    if name not in known:
        which = "no [specimen] name" if name is None else f"specimen '{name}'"
        raise UserError(
            f"{path}: is of the specimens {', '.join(known)}; {source.origin} has {which}.",
            "Give a result that it is part of, or its name there: [specimen] name in the mapping.",
        )


def _check_life(path: Path, content: dict[str, Any], source: MappingFile) -> None:
    serial, known = source.mapping.specimen.serial, [c["serial"] for c in content["couplings"]]
    if not known:
        raise UserError(
            f"{path}: tells of no coupling.", "Name the coupling: esea-host life --coupling."
        )
    if serial not in known:
        which = "no [specimen] serial" if serial is None else f"serial = {serial}"
        raise UserError(
            f"{path}: tells of coupling {', '.join(map(str, known))}; {source.origin} has {which}.",
            "Give the lives of the board that counts it, or its number: [specimen] serial in the "
            "mapping.",
        )


def specimen_page(found: SpecimenResults, command: str) -> str:
    """The page, one self-contained file.

    command: that makes it again.
    """
    content = found.identified | {"command": command, "content_hash": device_hash(found.device)}
    model = content["model"]["member"] if "model" in content else THESIS
    shown = {
        "title": f"Specimen: {found.device.title}",
        "f": content,
        "facts": found.source.mapping.specimen,
        "scales": _scales(found.source),
        "model": model,
        "compared": found.others.get(COMPARED),
        "agreed": found.others.get(AGREED),
        "lives": found.others.get(LIFE),
        "names": NAMES,
        "wanted": found.wanted(),
    }
    return render(PageSection("specimen/head"), SECTIONS, found, **shown)


def _scales(source: MappingFile) -> list[dict[str, Any]]:
    m = source.mapping
    found = (
        ("deflection", "rad/m", m.deflection.scale_rad_per_m),
        ("torque", "Nm/N", m.torque.scale_Nm_per_N),
        ("sampling period", "s", m.sampling.period_s),
    )
    return [{"what": w, "unit": u} | q.model_dump() for w, u, q in found if q is not None]


def _loops(found: SpecimenResults) -> dict[str, Any]:
    traces = []
    for r in found.recordings:
        held = np.zeros(len(r.time_s), dtype=bool)
        parts = []
        for s in r.sets:
            held[s.held_out] = True
            used = np.sort(np.concatenate([s.training, s.held_out]))
            if len(used):
                parts.append((f"{s.label}, {np.degrees(s.amplitude_rad):.3g}°", used))
        model = found.verdict.torque_Nm[r.label]
        traces.append(
            figures.Curve(
                r.label, r.time_s, r.theta_rad, model, r.tau_Nm, tuple(parts), held, "model"
            )
        )
    whole = figures.joined(traces)
    drawn = figures.loops(whole, "loops", figures.POINTS_PER_PAGE // 2)
    return {"loops": drawn, "panels": len(whole.parts), "most": figures.MOST_PANELS}


def _parameters(found: SpecimenResults) -> dict[str, Any]:
    """Each number of the model with its interval and where it comes from."""
    known, content = dict(found.device.quantities()), found.identified
    rows = []
    for key, p in content.get("parameters", {}).items():
        place = dotted(key)
        row = {"name": key, "meaning": field_facts(place)["text"], "unit": p["unit"]}
        rows.append(row | _interval(p["value"], p["sigma"], p["low"], p["high"], known[place]))
    for i, t in enumerate(content["model"]["terms"] if "model" in content else ()):
        least = -math.inf if t["kind"] == "offset" else 0.0
        q = known[f"family.terms[{i}].weight_Nm"]
        row = {"name": t["kind"], "meaning": t["term"], "unit": "Nm"}
        rows.append(row | _interval(t["weight_Nm"], t["sigma_Nm"], least, math.inf, q))
    return {"parameters": rows}


def _interval(
    value: float, sigma: float | None, low: float, high: float, quantity: Any
) -> dict[str, Any]:
    ends = None
    if sigma is not None:
        ends = max(value - LIKELY * sigma, low), min(value + LIKELY * sigma, high)
    source = quantity.source.partition("; standard deviation")[0]
    return {"value": value, "interval": ends, "status": quantity.status, "source": source}


def _models(found: SpecimenResults) -> dict[str, Any]:
    if COMPARED not in found.others:
        return {}
    rows = found.others[COMPARED]["compare"]
    cells = {(r["model"], r["condition"]): r for r in rows}
    models = list(dict.fromkeys(r["model"] for r in rows))
    conditions = list(dict.fromkeys(r["condition"] for r in rows))
    return {"cells": cells, "models": models, "conditions": conditions}


def _worth(found: SpecimenResults) -> dict[str, Any]:
    content = found.identified
    cells = {(w["torque"], w["rate"]): w for w in content["worth"]}
    torques = list(dict.fromkeys(w["torque"] for w in content["worth"]))
    rates = list(dict.fromkeys(w["rate"] for w in content["worth"]))

    def seen(torque: str | None, rate: str | None) -> bool:
        cell = cells[torque, rate]
        return bool(cell["samples"] or cell["held_out"])

    # Classes above what was measured at all are left out; an empty one between stays.
    torques = _till_last(torques, [seen(t, None) for t in torques])
    rates = _till_last(rates, [seen(None, r) for r in rates])
    widest = max((w["band_Nm"] or 0.0 for w in content["worth"]), default=0.0)
    scale, most = content["full_scale_Nm"], content["domain"]["omega_max_rad_s"]
    return {
        "classes": cells,
        "torques": list(zip(torques, [None, *_spans(TORQUE_EDGES, scale)], strict=False)),
        "rates": list(zip(rates, [None, *_spans(RATE_EDGES, most)], strict=False)),
        "widest": widest,
    }


def _till_last(names: list[Any], seen: list[bool]) -> list[Any]:
    return names[: max((i + 1 for i, x in enumerate(seen) if x), default=0)]


def _spans(edges: Sequence[float], scale: float) -> list[tuple[float, float | None]]:
    ends = [scale * e if math.isfinite(e) else None for e in edges[1:]]
    return [(scale * a, b) for a, b in zip(edges[:-1], ends, strict=True)]


def _lived(found: SpecimenResults) -> dict[str, Any]:
    one = found.coupling
    if one is None:
        return {"one": None}
    width = one["width_rad"]
    classes = [(k * width, (k + 1) * width, h / 2) for k, h in enumerate(one["halves"]) if h]
    return {"one": one, "ranges": classes, "cycles": sum(one["halves"]) / 2}


SECTIONS = (
    PageSection("identification/notes", "Notes"),
    PageSection("specimen/loops", "Loops", shown=_loops),
    PageSection("identification/errors", "Errors"),
    PageSection("specimen/parameters", "Parameters", shown=_parameters),
    PageSection("specimen/models", "Model choice", shown=_models),
    PageSection("specimen/worth", "What the torque is worth", shown=_worth),
    PageSection("specimen/reliability", "Reliability"),
    PageSection("specimen/life", "Life used", shown=_lived),
    PageSection("specimen/files", "Files"),
)

__all__ = ["SpecimenResults", "gather_specimen", "specimen_page"]
