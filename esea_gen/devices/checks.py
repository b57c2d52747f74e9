"""Checks of a device file's content: bounds, and relations between numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator

from esea_gen.devices.drive_relations import check_drive
from esea_gen.devices.fields import LAW_SECTIONS, DeviceFile
from esea_gen.devices.numbers import Facts, Quantity, Series, beyond, numbers_of
from esea_gen.devices.rubber import LEAST_FACTOR, FamilyTemperature, FamilyTerm
from esea_gen.errors import UserError
from esea_gen.language.ports import unit_of
from esea_gen.toml_file import together

# By kind of a term: the key that it needs, and no other of these.
OWN_KEY = {"maxwell": "times_s", "stop": "threshold", "slip": "path"}


def check_rubber(file: DeviceFile) -> Iterator[UserError]:
    """Exactly one torque model, whose numbers go together."""
    if file.elastomer is not None and file.family is not None:
        yield UserError(
            "there are both [elastomer] and [family]: a coupling has one torque model.",
            "Remove one of them.",
        )
    if file.elastomer is not None:
        yield from _check_published(file)
    elif file.family is not None:
        yield from _check_family(file)
    else:
        yield UserError(
            "section elastomer is missing: the coupling has no torque model.",
            "Add [elastomer], as the shipped elbow.toml has it, or a member of the family, "
            "[family] (docs/torque-models.md).",
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
            "Add one, however small its weight: only then does each torque have one deflection.",
        )


def _check_temperature(t: FamilyTemperature) -> Iterator[UserError]:
    low, high, reference = t.low_C.value, t.high_C.value, t.reference_C.value
    at = "family.temperature"
    if not low < high:
        yield UserError(
            f"{at}.high_C = {high:g} degC is not above {at}.low_C = {low:g} degC: the range is "
            "empty.",
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
                f"degC, below its limit {LEAST_FACTOR:g}: almost no torque would remain.",
                "Narrow the range, or correct per_K.",
            )


def _check_term(at: str, term: FamilyTerm) -> Iterator[UserError]:
    own = OWN_KEY.get(term.kind)
    for kind, key in OWN_KEY.items():
        given = getattr(term, key) is not None
        if given and key != own:
            yield UserError(
                f"{at}.{key} has no meaning: the term's kind is '{term.kind}', not '{kind}'.",
                "Remove it, or correct the kind.",
            )
        if not given and key == own:
            yield UserError(
                f"{at}.{key} is missing: a {term.kind} needs it.",
                f"Add {key}, with status and source.",
            )
    if term.exponent is not None and term.kind != "maxwell":
        yield UserError(
            f"{at}.exponent has no meaning: only a maxwell term has shares.", "Remove it."
        )
    if (term.bend is None) == (term.rise == "bend"):
        missing = term.bend is None
        yield UserError(
            f"{at}.bend {'is missing' if missing else 'has no meaning'}: the rise is "
            f"'{term.rise}'.",
            "Add bend, with status and source." if missing else 'Remove it, or write "bend".',
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
            yield UserError(f"{at}.{shaped[0]} has no meaning: an offset is constant.", "Omit it.")
    elif term.weight_Nm.value < 0:
        yield UserError(
            f"{at}.weight_Nm = {term.weight_Nm.value:g} is below its limit 0: such a {term.kind} "
            "would generate energy.",
            "Give 0 or above; only an offset may be negative.",
        )


def _keeps_rising(term: FamilyTerm) -> bool:
    shape = term.kind == "spring" and term.rise in ("x", "bend") and term.side == "both"
    return shape and term.path_softening is None and term.weight_Nm.value > 0


SAME_ORIENTATION_RAD = 0.02  # about 1 deg: an encoder's error moves little within that
MOST_CORRECTION_SLOPE = 0.25  # 1 deg with four periods a turn: 0.07
MOST_PERIODS = 2000  # of sensing in one of control, when a rate is looked for that divides
WHOLE_PERIOD = 1e-6  # of a period: far below what a crystal holds
FILTER_RATE_HZ = 1000.0  # the published observers' filters were printed for this rate


def check_content(origin: str, text: str, file: DeviceFile) -> None:
    """Check bounds of every number, then relations between numbers."""
    found = [p for number in numbers_of(file) for p in _check_number(*number)]
    found += _check_texts(file)
    # Relations of numbers that are wrong themselves say nothing more.
    found = found or [p for check in RELATIONS for p in check(file)]
    together(((_first_key(p.what), p) for p in found), origin, text)


def _first_key(what: str) -> list[str]:
    # A problem begins with the key that it is about.
    return re.findall(r"\w+", what.split(maxsplit=1)[0])


def _check_number(key: str, number: Quantity | Series, facts: Facts) -> Iterator[UserError]:
    unit = unit_of(key)
    if isinstance(number, Quantity):
        problem = beyond(key, number.value, facts, "" if unit == "1" else f" {unit}")
        if problem is not None:
            yield problem
        if facts["whole"] and number.value != math.floor(number.value):
            yield UserError(f"{key} = {number.value:g} is not a whole number.", "Give a whole one.")
        return
    sizes = ", ".join(map(str, facts["sizes"]))
    if len(number.values) not in facts["sizes"]:
        yield UserError(
            f"{key} has {len(number.values)} values; it takes {sizes}. ({facts['text']})",
            "Give one of these numbers of values, at equal steps.",
        )
    for i, value in enumerate(number.values):
        if not facts["low"] <= value <= facts["high"]:
            yield UserError(
                f"{key}: value {i} (counted from 0) is {value:g} {unit}, outside "
                f"{facts['low']:g} to {facts['high']:g} {unit}.",
                "Check its unit and sign.",
            )


def _check_texts(file: DeviceFile) -> Iterator[UserError]:
    # These words stand in comments of the generated C.
    texts = [("title", file.title)]
    if file.family is not None:
        texts += [(f"family.{k}", getattr(file.family, k)) for k in ("member", "title")]
    texts += [(f"{key}.source", number.source) for key, number, _ in numbers_of(file)]
    for key, text in texts:
        bad = next((b for b in ("*/", "/*", "\\") if b in text), None)
        if bad is None and not text.isprintable():
            bad = "a line break or other control character"
        if bad is not None:
            yield UserError(
                f"{key} holds {bad}, which would end or break a comment of the C.", "Remove it."
            )


def _check_relations(file: DeviceFile) -> Iterator[UserError]:
    values = {k: q for k, q, _ in numbers_of(file) if isinstance(q, Quantity)}
    rate = values["timing.sense_rate_Hz"].value
    period = round(1e6 / rate)
    if abs(1e6 / rate - period) > WHOLE_PERIOD * period:
        yield UserError(
            f"timing.sense_rate_Hz = {rate:g} Hz is a period of {1e6 / rate:.6g} us, not a "
            f"whole number of microseconds: the board would run with {period} us, the model would "
            "not.",
            f"Give {1e6 / period:.9g} Hz.",
        )
    if len(set(file.axes)) != len(file.axes):
        yield UserError(f"axes = {list(file.axes)} names an axis twice.", "Give each its own name.")
    walls = file.impairment.wall_axes if file.impairment else ()
    if unknown := [a for a in walls if a not in file.axes]:
        yield UserError(
            f"impairment.wall_axes names '{unknown[0]}', which is not an axis.",
            f"Choose from {', '.join(file.axes)}." if file.axes else "Leave it out: there is one.",
        )
    for key in ("velocity.bandwidth_Hz", "impairment.bandwidth_Hz"):
        if key in values and values[key].value > 0.1 * rate:
            yield UserError(
                f"{key} = {values[key].value:g} Hz is above its limit, a tenth of "
                f"timing.sense_rate_Hz ({0.1 * rate:g} Hz).",
                "Lower the bandwidth or raise the rate.",
            )


DRIVE = ("actuator", "joint", "disturbance", "impedance", "safety")
EXTEND = 'Add it, or write extends = "elbow_drive" and give what differs.'
# What a section does, and which others it does it with.
NEEDS = {
    "redundancy": ("compares the drive with the joint", ("actuator", "joint")),
    "monitor": ("watches a drive's encoders and command", DRIVE),
    "motor_thermal": ("limits a drive's torque", DRIVE),
    "passivity": ("bounds a drive's energy", DRIVE),
    "adaptation": ("adapts a drive's desired torque", DRIVE),
    "cable": ("requires the motor's own encoder", ("redundancy",)),
}
# Numbers of which the first may not be above the second.
ORDERED = (
    ("domain.theta_max_rad", "limits.theta_rad"),
    ("domain.omega_max_rad_s", "limits.omega_rad_s"),
    ("domain.tau_full_scale_Nm", "limits.tau_Nm"),
    ("joint.theta_min_rad", "joint.theta_max_rad"),
    ("safety.rom_min_rad", "safety.rom_max_rad"),
    ("safety.u_max_Nm", "actuator.u_max_Nm"),
    ("safety.theta_max_rad", "limits.theta_rad"),
    ("safety.tau_max_Nm", "limits.tau_Nm"),
    ("safety.rom_max_rad", "joint.theta_max_rad"),
    ("joint.theta_min_rad", "safety.rom_min_rad"),
    ("redundancy.cable_least_Nm_rad", "redundancy.cable_Nm_rad"),
    ("passivity.least_Nms_rad", "passivity.damping_Nms_rad"),
    ("cable.backlash_rad", "cable.backlash_most_rad"),
    ("motor_thermal.ambient_C", "motor_thermal.derate_C"),
    ("motor_thermal.start_C", "motor_thermal.max_C"),
    ("motor_thermal.ambient_C", "motor_thermal.start_C"),
)


def _check_sections(file: DeviceFile) -> Iterator[UserError]:
    def missing(names: Iterable[str]) -> str:
        return next((n for n in names if getattr(file, n) is None), "")

    for name, (does, needed) in NEEDS.items():
        if getattr(file, name) is not None and (lost := missing(needed)):
            yield UserError(f"[{name}] {does}, but section [{lost}] is missing.", EXTEND)
    for law, more in LAW_SECTIONS.items():
        if getattr(file, law) is not None and (lost := missing((*DRIVE, *more))):
            needs = ", ".join((*DRIVE, *more))
            yield UserError(
                f"section [{lost}] is missing: torque control by [{law}] needs {needs}.", EXTEND
            )


def _check_control(file: DeviceFile) -> Iterator[UserError]:
    yield from _check_sections(file)
    values = {k: q.value for k, q, _ in numbers_of(file) if isinstance(q, Quantity)}
    for low, high in ORDERED:
        if low in values and high in values and values[low] > values[high]:
            yield UserError(
                f"{low} = {values[low]:g} is above {high} = {values[high]:g}.",
                f"Lower {low} or raise {high}.",
            )
    for gain, most in (("Kp_Nm_rad", "Kp_max_Nm_rad"), ("Kd_Nms_rad", "Kd_max_Nms_rad")):
        own, limit = values.get(f"impedance.{gain}"), values.get(f"passivity.{most}")
        if own is not None and limit is not None and own > limit:
            yield UserError(
                f"impedance.{gain} = {own:g} is above passivity.{most} = {limit:g}: not every hand "
                "would be stable with it.",
                f"Lower it; raise passivity.{most} only after esea-gen passivity has shown that "
                "gains up to there are passive.",
            )
    derate_C, max_C = (values.get(f"motor_thermal.{n}_C") for n in ("derate", "max"))
    if derate_C is not None and max_C is not None and derate_C > max_C - 1:
        yield UserError(
            f"motor_thermal.derate_C = {derate_C:g} is not 1 K below max_C = {max_C:g}.",
            "Lower derate_C, so that the torque falls over some kelvin.",
        )
    sense = values["timing.sense_rate_Hz"]
    rate = values.get("timing.control_rate_Hz")
    if rate is None:
        if any(getattr(file, n) is not None for n in LAW_SECTIONS):
            yield UserError(
                "timing.control_rate_Hz is missing: torque control needs its rate.",
                "Give one that divides timing.sense_rate_Hz.",
            )
        return
    every = sense / rate
    if abs(every - round(every)) > 1e-9 or every < 1:
        yield UserError(
            f"timing.control_rate_Hz = {rate:g} Hz does not divide "
            f"timing.sense_rate_Hz = {sense:g} Hz: {every:g} periods.",
            f"Give {_dividing(sense, every):.12g} Hz, or another rate that divides it.",
        )
        return
    release = values.get("timing.control_release_s")
    if release is not None and not (
        abs(release * sense - round(release * sense)) < 1e-9 and 1 <= release * sense <= every
    ):
        yield UserError(
            f"timing.control_release_s = {release:g} s is not a whole number of sensing "
            f"periods ({1 / sense:g} s) up to the control period ({1 / rate:g} s).",
            "Give such a multiple, or leave it out.",
        )


def _dividing(sense: float, every: float) -> float:
    # The nearest rate that divides as it is printed: a third of 1000 Hz would be refused again.
    near = [n for n in range(1, MOST_PERIODS) if float(f"{sense / n:g}") * n == sense]
    return sense / min(near or [max(1, round(every))], key=lambda n: abs(n - every))


def _check_inverse(file: DeviceFile) -> Iterator[UserError]:
    asked = file.inverse
    if asked is None:
        return
    if asked.kind == "exact" and asked.filter != "none":
        yield UserError(
            f"inverse.filter = '{asked.filter}' has no meaning with inverse.kind = "
            "'exact': the exact inverse has no disturbance observer.",
            'Write filter = "none", or kind = "published".',
        )
    e = file.elastomer
    if e is None:  # a member of the family always has an exact one
        if asked.kind == "published":
            yield UserError(
                "inverse.kind = 'published' with [family]: the published inverse is of "
                "the published model, [elastomer].",
                'Write kind = "exact".',
            )
        return
    if e.k1_Nm_rad.value == 0:
        yield UserError(
            "[inverse] with elastomer.k1_Nm_rad = 0: the torque has no unique inverse.",
            "Give a positive linear stiffness, or leave the section out.",
        )
    if asked.kind == "exact":
        return
    zone, rate = e.dead_zone_rad, file.timing.sense_rate_Hz.value
    if zone is not None and zone.value > 0:
        yield UserError(
            f"inverse.kind = 'published' with elastomer.dead_zone_rad = {zone.value:g}: "
            "the published envelope (4.13) has no dead zone.",
            'Write kind = "exact".',
        )
    if asked.filter != "none" and rate != FILTER_RATE_HZ:
        yield UserError(
            f"inverse.filter = '{asked.filter}' is made for {FILTER_RATE_HZ:g} Hz, but "
            f"timing.sense_rate_Hz = {rate:g} Hz.",
            'Write filter = "none", or sense at that rate.',
        )
    if asked.kappa_rad is not None and asked.kappa_rad.value == 0:
        yield UserError(
            "inverse.kappa_rad = 0: the set-point would be 0 for every torque.",
            "Give a positive weight, or leave the key out for the published one.",
        )


def _check_encoder(file: DeviceFile) -> Iterator[UserError]:
    for side in ("motor", "load"):
        e = getattr(file.encoder, side)
        if e is None:
            continue
        at = f"encoder.{side}"
        if e.direction is not None and e.direction.value == 0:
            yield UserError(f"{at}.direction = 0 is neither 1 nor -1.", "Give 1 or -1.")
        table, there = e.correction_rad, e.correction_orientation_rad
        if (table is None) != (there is None):
            given, other = ("correction_rad", "correction_orientation_rad")[:: 1 if table else -1]
            yield UserError(
                f"{at}.{given} is given without {other}: a correction holds for the angle at which "
                "the encoder was mounted.",
                "Give both, or leave both out.",
            )
        if table is None or there is None:
            continue
        now = e.orientation_rad.value if e.orientation_rad else 0.0
        moved = abs(math.remainder(there.value - now, 2 * math.pi))
        if moved > SAME_ORIENTATION_RAD:
            yield UserError(
                f"{at}.correction_rad was characterised at {there.value:g} rad, but the encoder is "
                f"mounted at orientation_rad = {now:g} rad, {moved:g} rad away (limit "
                f"{SAME_ORIENTATION_RAD:g}).",
                "Characterise it again as it is mounted, or leave the correction out.",
            )
        cell = 2 * math.pi / len(table.values)
        for i, value in enumerate(table.values):
            after = table.values[(i + 1) % len(table.values)]
            if abs(after - value) > MOST_CORRECTION_SLOPE * cell:
                yield UserError(
                    f"{at}.correction_rad changes by {after - value:g} rad from value {i} to the "
                    f"next, above {MOST_CORRECTION_SLOPE:g} of their distance "
                    f"({MOST_CORRECTION_SLOPE * cell:g} rad): no encoder's error is as steep.",
                    "Check the values' unit and order.",
                )


RELATIONS = (
    check_rubber, _check_relations, _check_control, _check_inverse, _check_encoder, check_drive,
)  # fmt: skip
