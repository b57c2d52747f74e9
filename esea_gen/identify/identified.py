"""Result of an identification: a device, its errors, its file.

The gate: what recordings must be free of before a device's torque model is called ``identified``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from esea_gen.device import Device, parse_device
from esea_gen.devices.file import render_toml
from esea_gen.devices.numbers import Quantity, Series, changed
from esea_gen.errors import UserError
from esea_gen.files import plain, write_whole
from esea_gen.identify.recording.channels import ChannelNumber
from esea_gen.identify.recording.mapping import MappingFile
from esea_gen.identify.recording.recorded import Recording, recording_rows
from esea_gen.identify.verdict import TorqueWorth, Verdict


def _stopping(recordings: Sequence[Recording], excused: Collection[str]) -> list[str]:
    kinds = [f.kind for r in recordings for f in r.findings if f.stops and f.kind not in excused]
    return list(dict.fromkeys(kinds))


def excused_of(device: Device) -> set[str]:
    """Kinds of findings that a device's model has a term for."""
    family, elastomer = device.file.family, device.file.elastomer
    zone = None if elastomer is None else elastomer.dead_zone_rad
    # A dead zone is what the gate would otherwise take for backlash, too.
    found = {"backlash"} if zone is not None and zone.value else set()
    if family is not None and any(t.kind == "offset" for t in family.terms):
        found.add("offset")
    return found


def gated(device: Device, recordings: Sequence[Recording]) -> Device:
    """The device; where a recording is not sound, its torque model is assumed, not identified."""
    kinds = _stopping(recordings, excused_of(device))
    if not kinds:
        return device
    why = f"not identified, the recording has: {', '.join(kinds)}; "

    def doubted(number: Quantity | Series) -> Quantity | Series:
        if isinstance(number, Series) or number.status != "identified":
            return number
        return number.model_copy(update={"status": "assumed", "source": why + number.source})

    file = device.file
    models = {k: getattr(file, k) for k in ("elastomer", "family", "inverse")}
    update = {k: changed(v, doubted) for k, v in models.items() if v is not None}
    return parse_device(render_toml(file.model_copy(update=update)), device.origin)


def gate_notes(recordings: Sequence[Recording], excused: Collection[str] = ()) -> tuple[str, ...]:
    """Findings, recording by recording, and whether the gate is closed."""
    labels: dict[str, list[str]] = {}
    for r in recordings:
        for f in r.findings:
            text = f.text if f.kind in excused else f.text + f.advice
            labels.setdefault(text, []).append(r.label)
    notes = [
        f"Quality, {'all' if 1 < len(recordings) == len(at) else ', '.join(at)}: {text}."
        for text, at in labels.items()
    ]
    kinds = _stopping(recordings, excused)
    if kinds:
        notes.insert(
            0,
            f"Quality gate: {', '.join(kinds)}. The torque model's numbers are marked assumed, not "
            "identified.",
        )
    return tuple(notes)


# Of a data set, beside its errors.
KEPT = "label", "amplitude_rad", "asymmetry", "work_first_J", "work_last_J", "softening"
MARK = "# Written by esea-gen"


def marked(body: str, command: str) -> str:
    """A device file with a first line that says that it is ours and unchanged."""
    said = f"Content {_digest(body)}; once changed by hand it is not overwritten."
    return f"{MARK} {command}.  {said}\n{body}"


def write_device(path: Path, text: str, overwrite: bool = False) -> None:
    """Write a marked device file atomically, and never over a file edited by hand."""
    if path.exists() and not overwrite and not _ours(path):
        raise UserError(
            f"'{path}' exists and was not written by esea-gen, or was changed by hand since.",
            "Choose another folder or device.name, or move the file away.",
        )
    write_whole(path, text)


@dataclass(frozen=True, kw_only=True)
class Identified:
    device: Device  # identified device, its parameters of status identified
    source: MappingFile
    recordings: tuple[Recording, ...]
    verdict: Verdict
    notes: tuple[str, ...]
    worth: tuple[TorqueWorth, ...] = ()
    channels: tuple[ChannelNumber, ...] = ()

    @property
    def full_scale_Nm(self) -> float:
        return self.device.tau_full_scale_Nm

    def to_dict(self) -> dict[str, Any]:
        q = dict(self.device.quantities())
        channels = {"channels": [n.to_dict() for n in self.channels]} if self.channels else {}
        return channels | {
            "device": {"name": self.device.name, "title": self.device.title},
            "mapping": self.source.origin,
            "full_scale_Nm": self.full_scale_Nm,
            "rate_terms": self.device.rate_terms,
            "domain": {
                k: q[f"domain.{k}"].value for k in type(self.device.file.domain).model_fields
            },
            "recordings": recording_rows(self.recordings),
            "simulated": any(r.simulated for r in self.recordings),
            **self.errors(self.verdict),
            "worth": plain(self.worth),
            "notes": list(self.notes),
        }

    def errors(self, verdict: Verdict) -> dict[str, Any]:
        sets = [
            {k: getattr(s, k) for k in KEPT} | {"cycles": dict(sorted(s.cycles.items()))} | errors
            for s, errors in verdict.misfits.rows(self.full_scale_Nm)
        ]
        return {"sets": sets, "mean_rms": verdict.misfits.means(self.full_scale_Nm)}

    def summary(self) -> list[str]:
        """A few lines for the terminal: fit on training and held-out cycles, notes."""
        lines = [f"{self.device.title}: fit in % of full scale ({self.full_scale_Nm:g} Nm), RMS"]
        misfits = self.verdict.misfits
        width = max(len(s.label) for s, _, _ in misfits.sets)
        for s, trained, held in misfits.sets:
            cells = [
                f"{what} {100 * e.rms / self.full_scale_Nm:5.2f} %"
                for what, e in (("training", trained), ("held out", held))
                if e
            ]
            lines.append(f"  {s.label:{width}}  {', '.join(cells)}")
        means = misfits.means(self.full_scale_Nm)
        lines.append(
            f"  {'mean':{width}}  training {means['training_percent']:5.2f} %, "
            f"held out {means['held_out_percent']:5.2f} %"
        )
        return lines + [f"note: {note}" for note in self.notes]

    def toml(self) -> str:
        """The device file, marked."""
        return marked(self.device.toml(), "identify")

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write ``<name>.toml``, as :func:`write_device` does."""
        path, text = Path(folder) / f"{self.device.name}.toml", self.toml()
        if parse_device(text, path.name).canonical() != self.device.canonical():
            raise RuntimeError(f"{path.name} does not read back to what was identified")
        write_device(path, text, overwrite)
        return path


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]


def _ours(path: Path) -> bool:
    try:
        first, _, body = path.read_text(encoding="utf-8").partition("\n")
    except (UnicodeDecodeError, OSError):
        return False
    return first.startswith(MARK) and _digest(body) in first
