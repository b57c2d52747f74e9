"""From a mapping file to a device file whose torque model is a member of the family."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError, nearest
from esea_gen.identify.drafting import draft, grid_rate
from esea_gen.identify.family.file import drafted_member
from esea_gen.identify.family.fit import (
    MemberChannels,
    UnitTerms,
    fit_member,
    member_spread,
    not_seen,
    term_rows,
)
from esea_gen.identify.family.members import members
from esea_gen.identify.identified import Identified
from esea_gen.identify.notes import (
    band_notes,
    recording_notes,
    specimen_notes,
    temperature_notes,
    told_apart_notes,
)
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.recording.channels import settled
from esea_gen.identify.recording.mapping import MappingFile, load_mapping
from esea_gen.identify.recording.quality_gate import excused_of, gate_notes, gated
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.resampling import LeftOut
from esea_gen.identify.verdict import Verdict, judge
from esea_gen.identify.worth import worth_of
from esea_gen.model.family import FittedMember, Member


@dataclass(frozen=True, kw_only=True)
class FamilyIdentification(Identified):
    """Result of an identification of a member of the family."""

    fitted: FittedMember
    sigma: dict[int, float]  # standard deviations of the weights above 0, by place among the terms
    spread: LeftOut  # last parameter: per_K, where fitted

    @property
    def sigma_per_K(self) -> float | None:
        """Standard deviation of the change a kelvin; None where it was not fitted."""
        return None if self.fitted.temperature is None else float(self.spread.sigma[-1])

    def to_dict(self) -> dict[str, Any]:
        """Report, JSON-ready and the same for the same input."""
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
            row["sigma_Nm"] = sigma if math.isfinite(sigma) else None
        return super().to_dict() | {"model": model, "uncertainty": self.spread.to_dict()}


def _member_named(name: str) -> Member:
    """A member by its name, as comparisons print it."""
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
    """Identify a device whose torque model is a member of the family."""
    begun = time.monotonic()
    tell: Progress = progress or (lambda share, text: None)
    tell(0.0, "reading")
    member = _member_named(name)
    source = load_mapping(mapping_path, data_folder)
    if source.mapping.deflection.dead_zone_rad is not None:
        raise UserError(
            f"{source.origin}: deflection.dead_zone_rad: the model '{name}' has no dead zone.",
            "Take it out, or take the published model, which has one.",
        )
    source, recordings, channels = settled(source, lambda s, r: _channel_model(member, s, r))
    tell(0.2, "weights")
    full_scale = draft(source, recordings, False).tau_full_scale_Nm
    terms = UnitTerms(member, recordings, grid_rate(source))
    fitted = fit_member(terms, recordings, full_scale)
    sigma, spread = member_spread(terms, recordings, fitted)
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
        seconds=time.monotonic() - begun,
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
    source: MappingFile,
    recordings: Sequence[Recording],
    fitted: FittedMember,
    verdict: Verdict,
) -> tuple[str, ...]:
    softens = any(t.softening for _, t in fitted.used)
    notes = [
        f"Model: {fitted.member.title}; {len(fitted.used)} of its {len(fitted.member.terms)} terms "
        "carry torque. Its outer numbers were fixed beforehand.",
        *recording_notes(source, list(recordings)),
        *specimen_notes(verdict, softens),
    ]
    if fitted.member.timed and not all(r.timed for r in recordings):
        notes.append(
            "The relaxation times count an assumed sampling period: with another one they are "
            "others."
        )
    if softens:
        notes.append(
            'The model softens and does not recover while it runs. start = "virgin" in the device '
            "file is the specimen at the recording's start; a coupling that has been worked wants "
            'start = "conditioned".'
        )
    return tuple(notes)
