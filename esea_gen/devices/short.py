"""A short device file: a dozen numbers that a maker knows, the others scaled from a base."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from esea_gen.devices.fields import field_facts
from esea_gen.devices.numbers import Quantity, beyond, toml_entry
from esea_gen.errors import UserError, nearest
from esea_gen.language.ports import unit_of


@dataclass(frozen=True)
class Question:
    key: str  # dotted
    text: str
    typical: float
    why: str

    @property
    def name(self) -> str:
        return self.key.rpartition(".")[2]

    @property
    def facts(self) -> Mapping[str, Any]:
        return field_facts(self.key)

    def __str__(self) -> str:
        unit, f = unit_of(self.name), self.facts
        named = self.name if unit == "1" else f"{self.name} in {unit}"
        return f"{self.text}: {named}, {f['low']:g} to {f['high']:g}, such as {self.typical:g}"


QUESTIONS = tuple(
    Question(*row)
    for row in (
        (
            "joint.Jh_kgm2", "Inertia of limb and load side about the joint", 0.22,
            "An observer finds the person's torque by it. Forearm: 0.05 to 0.1; hand: 0.003.",
        ),
        ("safety.rom_min_rad", "Lower end of the range of motion", -0.15, "Nothing pushes below."),
        ("safety.rom_max_rad", "Upper end of the range of motion", 2.5, "Nothing pushes above."),
        (
            "safety.tau_max_Nm", "Torque on the person that trips the drive", 8.0,
            "Twice the largest torque that you want, and less than what may hurt.",
        ),
        (
            "elastomer.k1_Nm_rad", "Stiffness of the rubber coupling at small angles", 9.39,
            "Torque is measured by it. A first guess will do until esea-gen identify.",
        ),
        ("actuator.gear_ratio", "Gear ratio from motor shaft to joint", 74.0, "In 74:1 it is 74."),
        (
            "actuator.u_max_Nm", "Largest torque of the motor, at its shaft", 0.221,
            "What motor and amplifier give for a second or more.",
        ),
        (
            "actuator.rotor_kgm2", "Inertia of the rotor, at its shaft", 1.21e-4,
            "From the data sheet; 1 gcm2 is 1e-7. Times the ratio squared it is the drive's.",
        ),
        (
            "actuator.tau_c_s", "Lag of the motor's torque behind its command", 0.005,
            "A current loop has 1 to 5 ms, a drive with its own filter up to 35 ms.",
        ),
        (
            "encoder.resolution_bits", "Bits of a turn of both joint encoders", 14,
            "Counts per turn are 2 to this power: 12 bits are 4096.",
        ),
        (
            "actuator.encoder_bits", "Bits of a turn of the motor's encoder", 17,
            "An encoder of 1024 lines has 4096 counts: 12.",
        ),
        (
            "timing.control_rate_Hz", "Rate of the control task", 200.0,
            "It divides 1000 Hz; a light joint needs 500.",
        ),
    )
)  # fmt: skip
GIVEN = "yours; write here where it comes from"


def read_answer(question: Question, text: str) -> float:
    """A typed answer, inside the number's bounds."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    facts = question.facts
    if not math.isfinite(value) or (facts["whole"] and value != round(value)):
        kind = "whole number" if facts["whole"] else "number"
        raise UserError(f"{question.name} = {text!r} is no {kind}.", f"Give {question.typical:g}.")
    if problem := beyond(question.name, value, dict(facts)):
        raise problem
    return value


def read_given(words: list[str]) -> dict[str, float]:
    """Answers by key, from ``KEY=VALUE``."""
    known = {q.name: q for q in QUESTIONS}
    found = {}
    for word in words:
        name, _, value = word.partition("=")
        if name not in known:
            raise UserError(
                f"--give {word}: '{name}' is not asked for.",
                f"{nearest(name, known)}Write KEY=VALUE; keys: {', '.join(known)}.",
            )
        if name in found:
            raise UserError(f"--give {word}: {name} is given twice.", "Give it once.")
        found[name] = read_answer(known[name], value)
    return found


def refuse_missing(given: Mapping[str, float]) -> None:
    """Reject an incomplete set of answers; the error lists what is missing."""
    if missing := [q for q in QUESTIONS if q.name not in given]:
        rows = "\n".join(f"  --give {q.name}={q.typical:g}   {q}" for q in missing)
        raise UserError(
            f"{len(missing)} of {len(QUESTIONS)} numbers are missing, and nobody is there to ask.",
            f"Give them, or run this on a terminal:\n{rows}",
        )


def short_text(name: str, base: str, given: Mapping[str, float]) -> str:
    """The device file."""
    refuse_missing(given)
    lines = [
        f"# Device file of esea-gen. These {len(QUESTIONS)} numbers are yours; every other one is "
        f"scaled from {base}",
        "# to fit them, unless you give it here. To see all of them: esea-gen new whole --from "
        f"{name}.toml",
        "# The encoders have no zero: the board does not arm before they are zeroed "
        "(esea-host zero ADDRESS).",
        "schema = 1",
        f'extends = "{base}"',
        "scaled = true",
        f'name = "{name}"',
        f'title = "{name}: own drive, scaled from {base}"',
    ]
    sections = dict.fromkeys(q.key.partition(".")[0] for q in QUESTIONS)
    for section in sections:
        lines += ["", f"[{section}]"]
        for q in QUESTIONS:
            if q.key.startswith(f"{section}."):
                quantity = Quantity(value=given[q.name], status="assumed", source=GIVEN)
                lines.append(f"# {q.text}. {q.why}")
                lines.append(toml_entry(q.name, quantity, whole=q.facts["whole"]))
    return "\n".join(lines) + "\n"
