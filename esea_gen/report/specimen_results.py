"""Results about one specimen, from the files of earlier commands.

A file of another specimen is refused: recordings are compared by their digests, the device by the
errors that it gives, reliability and life by the specimen's name and number in the mapping file.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import esea_gen
from esea_gen.device import Device
from esea_gen.devices.fatigue import LifeUsed
from esea_gen.devices.fields import Fatigue
from esea_gen.errors import UserError
from esea_gen.files import plain, read_result
from esea_gen.identify import MappingFile, Recording, judge, load_mapping, load_recordings
from esea_gen.identify.family.choice import CompareRow
from esea_gen.identify.family.compare import CHOSEN, identify_chosen
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.reliability import Reliability
from esea_gen.identify.verdict import TorqueWorth, Verdict
from esea_gen.toml_file import checked

IDENTIFIED, COMPARED, AGREED, LIFE = "identify", "identify-compare", "reliability", "host-life"
NAMES = {COMPARED: "model choice", AGREED: "reliability", LIFE: "life used"}
AGAIN = "Write it again with this version."


@dataclass(frozen=True)
class _Recorded:
    file: str
    sha256: str


@dataclass(frozen=True)
class _Identified:
    device: dict[str, str]
    mapping: str
    full_scale_Nm: float
    domain: dict[str, float]
    recordings: list[_Recorded]
    sets: list[dict[str, Any]]
    mean_rms: dict[str, float | None]
    uncertainty: dict[str, Any]
    worth: list[TorqueWorth]
    notes: list[str]


@dataclass(frozen=True)
class _Compared:
    recordings: list[_Recorded]
    full_scale_Nm: float
    compare: list[CompareRow]
    chosen: str
    notes: list[str]
    reasons: list[str] = field(default_factory=list)  # an older file has none


@dataclass(frozen=True)
class _Coupling:
    serial: int
    seconds: float
    energy_J: float
    full: int
    halves: list[int]
    width_rad: float
    life_used: LifeUsed | None
    warns: bool


@dataclass(frozen=True)
class _Lives:
    device: str
    simulated: bool
    fatigue: Fatigue | None
    couplings: list[_Coupling]


# What is taken, and what of it must be there.
KINDS: dict[str, Any] = {
    IDENTIFIED: _Identified,
    COMPARED: _Compared,
    AGREED: Reliability,
    LIFE: _Lives,
}


@dataclass(frozen=True)
class SpecimenResults:
    asked: str  # mapping file and folder of the data, as they are typed
    source: MappingFile
    recordings: tuple[Recording, ...]
    device: Device
    identified: dict[str, Any]  # content of the identification's JSON
    verdict: Verdict  # what the device's C makes of the recordings
    others: Mapping[str, dict[str, Any]]  # content of the other results, by kind
    files: Mapping[str, str]  # name of the file that each result came from, by kind
    coupling: dict[str, Any] | None

    def summary(self) -> list[str]:
        """A few lines for the terminal: the error, and missing results."""
        errors, wanted = self.identified["mean_rms"], self.wanted()
        lines = [f"{self.device.title}: held out {errors['held_out_percent']:.2f} % of full scale"]
        return lines + [f"not known: {NAMES[k]}; {c}" for k, c in wanted.items()]

    def wanted(self) -> dict[str, str]:
        commands = {
            COMPARED: f"esea-gen identify {self.asked} --compare --json compared.json",
            AGREED: "esea-gen reliability SPECIMENS.toml --json reliability.json",
            LIFE: "esea-host life ADDRESS --json life.json",
        }
        return {k: c for k, c in commands.items() if k not in self.others}


def gather_specimen(
    mapping: Path, results: Sequence[Path], data: Path | None, tell: Progress
) -> SpecimenResults:
    """Read the results of a specimen; identify it if there is no identification."""
    source = load_mapping(mapping, data)
    given: dict[str, tuple[Path, dict[str, Any]]] = {}
    for path in results:
        content = read_result(path, tuple(KINDS))
        kind = content["schema"]
        checked(KINDS[kind], content, str(path), lambda problem: AGAIN)
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
        model = others[COMPARED]["chosen"] if COMPARED in others else CHOSEN
        result, _ = identify_chosen(mapping, data, tell, model=model)
        identified = plain(result.to_dict(), null=True)
        device, verdict = result.device, result.verdict
    if COMPARED in given:
        _check_scale(*given[COMPARED], identified)
    serial = source.mapping.specimen.serial
    lives = others.get(LIFE, {}).get("couplings", ())
    one = next((c for c in lives if c["serial"] == serial), None)
    files = {k: str(p) for k, (p, _) in given.items()}
    asked = shlex.join([str(mapping), *([] if data is None else ["--data", str(data)])])
    fitted = device, identified, verdict
    return SpecimenResults(asked, source, recordings, *fitted, others, files, one)


def _check_recordings(
    path: Path, content: dict[str, Any], source: MappingFile, recordings: Sequence[Recording]
) -> None:
    theirs = {r["file"]: r["sha256"] for r in content["recordings"]}
    ours = {r.file: r.digest for r in recordings}
    if theirs != ours:
        apart = sorted(f for f in theirs.keys() | ours.keys() if theirs.get(f) != ours.get(f))
        more = f" and {len(apart) - 1} more" if len(apart) > 1 else ""
        raise UserError(
            f"{path} and {source.origin} have different recordings: {apart[0]}{more}.",
            "Give this specimen's result, or make it again from these recordings.",
        )


def _check_scale(path: Path, content: dict[str, Any], identified: dict[str, Any]) -> None:
    theirs, ours = content["full_scale_Nm"], identified["full_scale_Nm"]
    if not math.isclose(theirs, ours, rel_tol=1e-9):
        raise UserError(
            f"{path}: its full scale is {theirs:.6g} Nm, the identification's {ours:.6g} Nm: the "
            "mapping file has changed between them.",
            "Generate both again.",
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
            f"{path} has {apart[0]} = {_number(said[apart[0]])} for these recordings, the device "
            f"file beside it gives {_number(found[apart[0]])}.",
            "The device or mapping file has changed since: identify again.",
        )


def _number(x: float | None) -> str:
    return "none" if x is None else f"{x:.6g}"


def _check_agreed(path: Path, content: dict[str, Any], source: MappingFile) -> None:
    name, known = source.mapping.specimen.name, content["specimens"]
    if name not in known:
        which = "no [specimen] name" if name is None else f"specimen '{name}'"
        raise UserError(
            f"{path}: describes the specimens {', '.join(known)}; {source.origin} has {which}.",
            "Give a result that includes it, or its name there: [specimen] name in the mapping.",
        )


def _check_life(path: Path, content: dict[str, Any], source: MappingFile) -> None:
    serial, known = source.mapping.specimen.serial, [c["serial"] for c in content["couplings"]]
    if not known:
        raise UserError(
            f"{path}: contains no coupling.", "Name the coupling: esea-host life --coupling."
        )
    if serial not in known:
        which = "no [specimen] serial" if serial is None else f"serial = {serial}"
        raise UserError(
            f"{path}: contains coupling {', '.join(map(str, known))}; {source.origin} has {which}.",
            "Give the lives of the board that counts it, or its number: [specimen] serial in the "
            "mapping.",
        )
