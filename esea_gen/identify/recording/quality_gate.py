"""The gate before ``status = identified``: what the recordings must be free of."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from esea_gen.device import Device, parse_device
from esea_gen.devices.numbers import Quantity, Section
from esea_gen.devices.writing import render_toml
from esea_gen.identify.recording.recorded import Recording


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

    def doubted(section: Section) -> Section:
        update: dict[str, Any] = {}
        for key in type(section).model_fields:
            value = getattr(section, key)
            if isinstance(value, Quantity) and value.status == "identified":
                update[key] = value.model_copy(
                    update={"status": "assumed", "source": why + value.source}
                )
            elif isinstance(value, Section):
                update[key] = doubted(value)
            elif isinstance(value, tuple):
                update[key] = tuple(doubted(v) if isinstance(v, Section) else v for v in value)
        return section.model_copy(update=update)

    file = device.file
    models = {k: getattr(file, k) for k in ("elastomer", "family")}
    update = {k: doubted(v) for k, v in models.items() if v is not None}
    return parse_device(render_toml(file.model_copy(update=update)), device.origin)


def gate_notes(recordings: Sequence[Recording], excused: Collection[str] = ()) -> tuple[str, ...]:
    """What was found, recording by recording, and whether the gate is shut."""
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
