"""A fitted member of the family as section ``[family]`` of a device file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from esea_gen.device import Device, parse_device
from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity, Series
from esea_gen.devices.rubber import Family, FamilyTemperature, FamilyTerm
from esea_gen.devices.writing import render_toml
from esea_gen.identify.drafting import draft, files_of, origin_of, round_up
from esea_gen.identify.recording.mapping import MappingFile
from esea_gen.identify.recording.reading import MAX_TAU_NM
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.temperatures import at_edge, temperatures_of
from esea_gen.model.family import FittedMember, Start, Term
from esea_gen.model.family_step import ROOM
from esea_gen.model.rubber import POWERS
from esea_gen.model.temperature import TemperatureFactor

# What a comparison chooses between is fixed before any recording is seen.
FIXED = "fixed before the fit, not searched"
TEMPERATURE_KEYS = tuple(FamilyTemperature.model_fields)
Status = Literal["identified", "assumed"]


def family_section(
    fitted: FittedMember,
    source: str,
    start: Start = "virgin",
    sigma: Mapping[int, float] | None = None,
    warmth: FamilyTemperature | None = None,
) -> Family:
    """The section of a device file; terms of weight 0 are left out."""
    if warmth is None and fitted.temperature is not None:
        warmth = temperature_section(fitted.temperature, dict.fromkeys(TEMPERATURE_KEYS, source))
    told = {i: _sureness(source, s) for i, s in (sigma or {}).items()}
    pairs = zip(fitted.weights_Nm, fitted.member.terms, strict=True)
    return Family(
        member=fitted.member.name,
        title=fitted.member.title,
        start=start,
        scale_rad=Quantity(value=fitted.scale_rad, status="identified", source=source),
        temperature=warmth,
        terms=tuple(
            _term(t, w, *told.get(i, (source, "identified"))) for i, (w, t) in enumerate(pairs) if w
        ),
    )


def temperature_section(
    factor: TemperatureFactor, sources: Mapping[str, str], status: Status = "identified"
) -> FamilyTemperature:
    """The factor of temperature in a device file."""
    found = {
        k: Quantity(value=getattr(factor, k), status=status, source=sources[k])
        for k in TEMPERATURE_KEYS
    }
    return FamilyTemperature(**found)


def _sureness(source: str, sigma: float) -> tuple[str, Status]:
    # Source and status of a number that was fitted.
    if math.isfinite(sigma):
        return f"{source}; standard deviation {sigma:.2g}", "identified"
    return f"{source}; not determined by it, others give the same torque", "assumed"


def _term(t: Term, weight_Nm: float, source: str, status: Status) -> FamilyTerm:
    def fixed(value: float) -> Quantity:
        return Quantity(value=value, status="assumed", source=FIXED)

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
    start: Start = "virgin",
    sigma: Mapping[int, float] | None = None,
    warmth: FamilyTemperature | None = None,
) -> Device:
    """A device whose torque model is a fitted member; checked as one that is read."""
    file = template.file
    reach = ROOM * fitted.most_Nm(file.limits.theta_rad.value)
    limit = file.limits.tau_Nm
    if reach > limit.value:
        text = "what the model's terms can reach at the deflection limit"
        most = min(2 * MAX_TAU_NM, round_up(reach))
        limit = Quantity(value=most, status="assumed", source=text)
    update = {
        "elastomer": None,
        "family": family_section(fitted, source, start, sigma, warmth),
        "limits": file.limits.model_copy(update={"tau_Nm": limit}),
    }
    return parse_device(render_toml(file.model_copy(update=update)), f"{file.name}.toml")


def drafted_member(
    source: MappingFile,
    recordings: list[Recording],
    fitted: FittedMember,
    sigma: Mapping[int, float] | None = None,
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
    assumed = any(q.status == "assumed" for q in given)
    trained = temperatures_of(recordings, training=True)
    where += "; temperatures assumed" if assumed else ""
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
    return temperature_section(factor, sources, "assumed" if assumed else "identified")
