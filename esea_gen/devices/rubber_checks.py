"""Checks of the coupling's torque model: the published one, or a member of the family."""

from __future__ import annotations

from collections.abc import Iterator

from esea_gen.devices.fields import DeviceFile
from esea_gen.devices.rubber import LEAST_FACTOR, FamilyTemperature, FamilyTerm
from esea_gen.errors import UserError

# By kind of a term: the key that it needs, and no other of these.
OWN_KEY = {"maxwell": "times_s", "stop": "threshold", "slip": "path"}


def check_rubber(file: DeviceFile) -> Iterator[UserError]:
    """Exactly one torque model, whose numbers go together."""
    if file.elastomer is not None and file.family is not None:
        yield UserError(
            "there are both [elastomer] and [family]: a coupling has one torque model.",
            "Take one of them out.",
        )
    if file.elastomer is not None:
        yield from _check_published(file)
    elif file.family is not None:
        yield from _check_family(file)
    else:
        yield UserError(
            "section elastomer is missing: the coupling has no torque model.",
            "Add [elastomer], as the shipped elbow.toml has it, or a member of the family, "
            "[family] (docs/identify.md).",
        )


def _check_published(file: DeviceFile) -> Iterator[UserError]:
    e = file.elastomer
    assert e is not None
    zone, reach = e.dead_zone_rad, file.domain.theta_max_rad
    if zone is not None and zone.value >= reach.value:
        yield UserError(
            f"elastomer.dead_zone_rad = {zone.value:g} is not below "
            f"domain.theta_max_rad = {reach.value:g}: no torque in the whole domain.",
            "Narrow the dead zone or widen the domain.",
        )
    if e.k1_Nm_rad.value == 0 and e.k3_Nm_rad3.value == 0 and e.alpha_Nm_rad.value == 0:
        yield UserError(
            "elastomer.k1_Nm_rad, k3_Nm_rad3 and alpha_Nm_rad are all 0: no torque.",
            "Give at least one stiffness.",
        )


def _check_family(file: DeviceFile) -> Iterator[UserError]:
    family = file.family
    assert family is not None
    for i, term in enumerate(family.terms):
        yield from _check_term(f"family.terms[{i}]", term)
    if family.temperature is not None:
        yield from _check_temperature(family.temperature)
    if not any(_keeps_rising(t) for t in family.terms):
        yield UserError(
            "family.terms: the torque need not rise with the deflection: a spring of "
            'rise "x" or "bend", of both sides and without path_softening, is missing, or its '
            "weight_Nm is 0.",
            "Add one, however small its weight: only then has a torque one deflection.",
        )


def _check_temperature(t: FamilyTemperature) -> Iterator[UserError]:
    low, high, reference = t.low_C.value, t.high_C.value, t.reference_C.value
    at = "family.temperature"
    if not low < high:
        yield UserError(
            f"{at}.high_C = {high:g} degC is not above {at}.low_C = {low:g} degC: the factor holds "
            "nowhere.",
            "Give the range of temperatures that was recorded.",
        )
    elif not low <= reference <= high:
        yield UserError(
            f"{at}.reference_C = {reference:g} degC is outside {at}.low_C = {low:g} to high_C = "
            f"{high:g} degC.",
            "Give a temperature of that range, and the weights at it.",
        )
    else:
        least, worst = min((1 + t.per_K.value * (c - reference), c) for c in (low, high))
        if least < LEAST_FACTOR:
            yield UserError(
                f"{at}.per_K = {t.per_K.value:g} 1/K makes the factor {least:.3g} at {worst:g} "
                f"degC, below its limit {LEAST_FACTOR:g}: next to no torque would be left.",
                "Narrow the range, or correct per_K.",
            )


def _check_term(at: str, term: FamilyTerm) -> Iterator[UserError]:
    own = OWN_KEY.get(term.kind)
    for kind, key in OWN_KEY.items():
        given = getattr(term, key) is not None
        if given and key != own:
            yield UserError(
                f"{at}.{key} has no meaning: the term's kind is '{term.kind}', not '{kind}'.",
                "Take it out, or correct the kind.",
            )
        if not given and key == own:
            yield UserError(
                f"{at}.{key} is missing: a {term.kind} needs it.",
                f"Add {key}, with status and source.",
            )
    if term.exponent is not None and term.kind != "maxwell":
        yield UserError(
            f"{at}.exponent has no meaning: only a maxwell term has shares.", "Take it out."
        )
    if (term.bend is None) == (term.rise == "bend"):
        missing = term.bend is None
        yield UserError(
            f"{at}.bend {'is missing' if missing else 'has no meaning'}: the rise is "
            f"'{term.rise}'.",
            "Add bend, with status and source." if missing else 'Take it out, or write "bend".',
        )
    if term.strain_softening is not None and term.path_softening is not None:
        yield UserError(
            f"{at} has both strain_softening and path_softening.",
            "Give two terms, each with one of them.",
        )
    if term.kind == "offset":
        shaped = [k for k in ("strain_softening", "path_softening") if getattr(term, k) is not None]
        shaped += [k for k, usual in (("rise", "x"), ("side", "both")) if getattr(term, k) != usual]
        if shaped:
            yield UserError(f"{at}.{shaped[0]} has no meaning: an offset is constant.", "Take out.")
    elif term.weight_Nm.value < 0:
        yield UserError(
            f"{at}.weight_Nm = {term.weight_Nm.value:g} is below its limit 0: such a {term.kind} "
            "would give energy away.",
            "Give 0 or above; only an offset may be negative.",
        )


def _keeps_rising(term: FamilyTerm) -> bool:
    shape = term.kind == "spring" and term.rise in ("x", "bend") and term.side == "both"
    return shape and term.path_softening is None and term.weight_Nm.value > 0
