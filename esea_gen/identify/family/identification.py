"""From a mapping file to a device file whose torque model is a member of the family."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from esea_gen.device import Device, parse_device
from esea_gen.devices.file import DeviceData, render_toml
from esea_gen.devices.numbers import Quantity, Series
from esea_gen.devices.rubber import Family, FamilyTemperature, FamilyTerm
from esea_gen.errors import UserError, nearest
from esea_gen.identify.drafting import (
    Status,
    assumed,
    determined,
    draft,
    files_of,
    grid_rate,
    identified,
    origin_of,
    round_up,
)
from esea_gen.identify.family.fit import (
    MemberChannels,
    UnitTerms,
    fit_member,
    member_spread,
    members,
    not_seen,
    term_rows,
)
from esea_gen.identify.identified import Identified, excused_of, gate_notes, gated
from esea_gen.identify.notes import (
    band_notes,
    recording_notes,
    specimen_notes,
    temperature_notes,
    told_apart_notes,
)
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.recording.channels import settled
from esea_gen.identify.recording.conditions import at_edge, temperatures_of
from esea_gen.identify.recording.mapping import MappingFile, load_mapping
from esea_gen.identify.recording.reading import MAX_TAU_NM
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.resampling import LeftOut
from esea_gen.identify.verdict import Verdict, judge, worth_of
from esea_gen.model.family import FittedMember, Member, Term
from esea_gen.model.family_step import ROOM
from esea_gen.model.rubber import POWERS
from esea_gen.model.temperature import TemperatureFactor

# What a comparison chooses between is fixed before any recording is seen.
FIXED = "fixed before the fit, not searched"
TEMPERATURE_KEYS = tuple(FamilyTemperature.model_fields)


def family_section(
    fitted: FittedMember,
    source: str,
    sigma: Mapping[int, float | None] | None = None,
    warmth: FamilyTemperature | None = None,
) -> Family:
    """The section of a device file; terms of weight 0 are left out."""
    if warmth is None and fitted.temperature is not None:
        warmth = temperature_section(fitted.temperature, dict.fromkeys(TEMPERATURE_KEYS, source))
    told = {i: _sureness(source, fitted.weights_Nm[i], s) for i, s in (sigma or {}).items()}
    pairs = zip(fitted.weights_Nm, fitted.member.terms, strict=True)
    return Family(
        member=fitted.member.name,
        title=fitted.member.title,
        start="virgin",
        scale_rad=identified(fitted.scale_rad, source),
        temperature=warmth,
        terms=tuple(
            _term(t, w, *told.get(i, (source, "identified"))) for i, (w, t) in enumerate(pairs) if w
        ),
    )


def temperature_section(
    factor: TemperatureFactor, sources: Mapping[str, str], status: Status = "identified"
) -> FamilyTemperature:
    found = {
        k: Quantity(value=getattr(factor, k), status=status, source=sources[k])
        for k in TEMPERATURE_KEYS
    }
    return FamilyTemperature(**found)


def _sureness(source: str, weight_Nm: float, sigma: float | None) -> tuple[str, Status]:
    # Source and status of a number that was fitted.
    if sigma is None:
        return f"{source}; at its lower bound", "assumed"
    if math.isfinite(sigma):
        status: Status = "identified" if determined(weight_Nm, sigma) else "assumed"
        return f"{source}; standard deviation {sigma:.2g}", status
    return f"{source}; not determined by it, others give the same torque", "assumed"


def _term(t: Term, weight_Nm: float, source: str, status: Status) -> FamilyTerm:
    fixed = partial(assumed, source=FIXED)
    powers = {n: text for text, n in POWERS.items()}
    bent = t.rise.kind == "bend"
    row: dict[str, Any] = {
        "kind": t.kind,
        "weight_Nm": Quantity(value=weight_Nm, status=status, source=source),
        "rise": "bend" if bent else powers[t.rise.number],
        "side": t.rise.side,
    }
    if bent:
        row["bend"] = fixed(t.rise.number)
    if t.kind == "maxwell":
        row["times_s"] = Series(values=t.numbers, status="assumed", source=FIXED)
        if t.exponent:
            row["exponent"] = fixed(t.exponent)
    elif t.numbers:
        row["threshold" if t.kind == "stop" else "path"] = fixed(t.numbers[0])
    if t.softening:
        row[f"{t.softening.kind}_softening"] = fixed(t.softening.number)
    return FamilyTerm(**row)


def family_device(
    template: DeviceData,
    fitted: FittedMember,
    source: str,
    sigma: Mapping[int, float | None] | None = None,
    warmth: FamilyTemperature | None = None,
) -> Device:
    """A device whose torque model is a fitted member; checked as one that is read."""
    file = template.file
    reach = ROOM * fitted.most_Nm(file.limits.theta_rad.value)
    limit = file.limits.tau_Nm
    if reach > limit.value:
        text = "what the model's terms can reach at the deflection limit"
        most = min(2 * MAX_TAU_NM, round_up(reach))
        limit = assumed(most, text)
    update = {
        "elastomer": None,
        "family": family_section(fitted, source, sigma, warmth),
        "limits": file.limits.model_copy(update={"tau_Nm": limit}),
    }
    return parse_device(render_toml(file.model_copy(update=update)), f"{file.name}.toml")


def drafted_member(
    source: MappingFile,
    recordings: list[Recording],
    fitted: FittedMember,
    sigma: Mapping[int, float | None] | None = None,
    sigma_per_K: float | None = None,
) -> Device:
    """A device that holds the recordings, with a member that was fitted to them."""
    template = draft(source, recordings, False)
    where = origin_of(source, files_of(recordings))
    warmth = None
    if fitted.temperature is not None:
        warmth = _recorded_warmth(source, recordings, fitted.temperature, where, sigma_per_K)
    return family_device(template, fitted, where, sigma=sigma, warmth=warmth)


def _recorded_warmth(
    source: MappingFile,
    recordings: list[Recording],
    factor: TemperatureFactor,
    where: str,
    sigma_per_K: float | None,
) -> FamilyTemperature:
    given = [t.temperature_C for t in source.mapping.recording if t.temperature_C is not None]
    unsure = any(q.status == "assumed" for q in given)
    trained = temperatures_of(recordings, training=True)
    where += "; temperatures assumed" if unsure else ""
    beyond = f", {where}; trained from {trained[0]:g} to {trained[-1]:g} degC"
    told = "" if sigma_per_K is None else f"; standard deviation {sigma_per_K:.2g}"
    edge = at_edge(factor)
    told = told if edge is None else f"; at the {edge} end of its search"
    sources = {
        "reference_C": f"mean of the temperatures in training, {where}",
        "per_K": where + told,
        "low_C": f"lowest temperature recorded{beyond}",
        "high_C": f"highest temperature recorded{beyond}",
    }
    return temperature_section(factor, sources, "assumed" if unsure or edge else "identified")


@dataclass(frozen=True, kw_only=True)
class FamilyIdentification(Identified):
    fitted: FittedMember
    # Standard deviations of the weights above 0, by place among the terms; None: at its bound.
    sigma: dict[int, float | None]
    spread: LeftOut  # last parameter: per_K, where fitted

    @property
    def sigma_per_K(self) -> float | None:
        """Standard deviation of the change a kelvin; None where it was not fitted."""
        return None if self.fitted.temperature is None else float(self.spread.sigma[-1])

    def to_dict(self) -> dict[str, Any]:
        family, limits = self.device.file.family, self.device.file.limits
        assert family is not None
        model: dict[str, Any] = {
            "member": family.member,
            "title": family.title,
            "start": family.start,
            "scale_rad": self.fitted.scale_rad,
            "least_slope_Nm_rad": self.fitted.least_slope_Nm_rad(limits.theta_rad.value),
            "terms": term_rows(self.fitted),
        }
        if self.fitted.temperature is not None:
            model["temperature"] = asdict(self.fitted.temperature) | {
                "sigma_per_K": self.sigma_per_K
            }
        for row, sigma in zip(model["terms"], self.sigma.values(), strict=True):
            row["sigma_Nm"] = None if sigma is None or not math.isfinite(sigma) else sigma
        return super().to_dict() | {"model": model, "uncertainty": self.spread.to_dict()}


def _member_named(name: str) -> Member:
    known = {m.name: m for m in members()}
    if name not in known:
        raise UserError(
            f"There is no model '{name}'.",
            f"{nearest(name, known)}Known: published, {', '.join(repr(k) for k in known)}.",
        )
    return known[name]


def identify_member(
    mapping_path: str | Path,
    name: str,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
) -> FamilyIdentification:
    tell: Progress = progress or (lambda share, text: None)
    tell(0.0, "reading")
    member = _member_named(name)
    source = load_mapping(mapping_path, data_folder)
    if source.mapping.deflection.dead_zone_rad is not None:
        raise UserError(
            f"{source.origin}: deflection.dead_zone_rad: the model '{name}' has no dead zone.",
            "Remove it, or use the published model, which has one.",
        )
    source, recordings, channels = settled(source, lambda s, r: _channel_model(member, s, r))
    tell(0.2, "weights")
    full_scale = draft(source, recordings, False).tau_full_scale_Nm
    terms = UnitTerms(member, recordings, grid_rate(source))
    fitted = fit_member(terms, recordings, full_scale)
    sigma, spread = member_spread(terms, recordings, fitted, full_scale)
    per_K = None if fitted.temperature is None else float(spread.sigma[-1])
    device = gated(drafted_member(source, recordings, fitted, sigma, per_K), recordings)
    tell(0.7, "the device's C")
    verdict = judge(device, recordings)
    notes = (
        *gate_notes(recordings, excused_of(device)),
        *(n.note for n in channels),
        *_notes(source, recordings, fitted, verdict),
        *told_apart_notes(fitted, not_seen(terms, recordings, fitted), sigma),
        *temperature_notes(recordings, fitted.temperature, per_K),
        *band_notes(recordings, verdict, spread, device.tau_full_scale_Nm),
    )
    tell(1.0, "done")
    return FamilyIdentification(
        device=device,
        source=source,
        recordings=tuple(recordings),
        verdict=verdict,
        notes=notes,
        worth=worth_of(device, recordings, verdict, spread),
        channels=channels,
        fitted=fitted,
        sigma=sigma,
        spread=spread,
    )


def _channel_model(
    member: Member, source: MappingFile, recordings: list[Recording]
) -> MemberChannels:
    full_scale = draft(source, recordings, False).tau_full_scale_Nm
    return MemberChannels(UnitTerms(member, recordings, grid_rate(source)), full_scale)


def _notes(
    source: MappingFile, recordings: Sequence[Recording], fitted: FittedMember, verdict: Verdict
) -> tuple[str, ...]:
    softens = any(t.softening for _, t in fitted.used)
    notes = [
        f"Model: {fitted.member.title}; {len(fitted.used)} of its {len(fitted.member.terms)} terms "
        "carry torque. Times and thresholds are on a fixed grid.",
        *recording_notes(source, list(recordings)),
        *specimen_notes(verdict, softens),
    ]
    if fitted.member.timed and not all(r.timed for r in recordings):
        notes.append("The relaxation times assume a sampling period; they scale with it.")
    if softens:
        notes.append(
            'The model softens and does not recover while it runs. start = "virgin" in the device '
            "file is the specimen at the recording's start; a coupling that has been worked needs "
            'start = "conditioned".'
        )
    return tuple(notes)
