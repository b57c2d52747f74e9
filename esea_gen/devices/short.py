"""A short device file: a dozen numbers that a maker knows, the others scaled from a base."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from esea_gen.devices.fields import field_facts
from esea_gen.devices.motors import MotorKit
from esea_gen.devices.numbers import Quantity, beyond, toml_entry
from esea_gen.errors import UserError, choose
from esea_gen.language.ports import unit_of
from esea_gen.typed import read_number


@dataclass(frozen=True)
class DeviceQuestion:
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

    @property
    def unit(self) -> str:
        unit = unit_of(self.name)
        return "" if unit == "1" else f" in {unit}"

    def __str__(self) -> str:
        f, named = self.facts, f"{self.name}{self.unit}"
        return f"{self.text}: {named}, {f['low']:g} to {f['high']:g}, such as {self.typical:g}"


# Key, typical value, what it is, and why it is asked.
_ROWS = """
joint.Jh_kgm2 | 0.22 | Inertia of limb and load side | Forearm: 0.05 to 0.1. A hand's: times 3.
safety.rom_min_rad | -0.15 | Lower end of the range of motion | Nothing pushes below.
safety.rom_max_rad | 2.5 | Upper end of the range of motion | Nothing pushes above.
safety.tau_max_Nm | 8 | Torque on the person that trips the drive | Less than what may hurt.
elastomer.k1_Nm_rad | 9.39 | Stiffness of the rubber at small angles | A guess will do at first.
actuator.gear_ratio | 74 | Gear ratio from motor shaft to joint | In 74:1 it is 74.
actuator.u_max_Nm | 0.221 | Largest torque of the motor, at its shaft | What the amplifier gives.
actuator.rotor_kgm2 | 1.21e-4 | Inertia of the rotor, at its shaft | Its data sheet; 1 gcm2 is 1e-7.
actuator.tau_c_s | 0.005 | Lag of the motor's torque | A current loop has 1 to 5 ms.
encoder.resolution_bits | 14 | Bits of both joint encoders | 12 bits: 4096 counts.
actuator.encoder_bits | 17 | Bits of the motor's encoder | 1024 lines: 4096 counts, 12 bits.
timing.control_rate_Hz | 200 | Rate of the control task | It divides 1000; a light joint needs 500.
"""
QUESTIONS = tuple(
    DeviceQuestion(key, text, float(typical), why)
    for key, typical, text, why in (r.split(" | ") for r in _ROWS.strip().splitlines())
)


def read_answer(question: DeviceQuestion, text: str) -> float:
    """A typed answer, inside the number's bounds."""
    try:
        value = read_number(text)
    except UserError:
        value = math.nan
    facts = question.facts
    if not math.isfinite(value) or (facts["whole"] and value != round(value)):
        kind = "whole number" if facts["whole"] else "number"
        raise UserError(
            f"{question.name} = {text!r} is not a {kind}.",
            f"Give a {kind}{question.unit}, such as {question.typical:g}.",
        )
    if value == 0 and facts["low"] == 0:
        raise UserError(f"{question.name} = 0 is invalid.", f"Give about {question.typical:g}.")
    if problem := beyond(question.name, value, dict(facts)):
        raise problem
    return value


def read_given(words: list[str]) -> dict[str, float]:
    """Answers by key, from ``KEY=VALUE``."""
    known = {q.name: q for q in QUESTIONS}
    pairs = [w.partition("=")[::2] for w in words]
    for i, (name, _) in enumerate(pairs):
        choose("number to --give", name, known)
        if name in dict(pairs[:i]):
            raise UserError(f"--give {name} is given twice.", "Give it once.")
    return {name: read_answer(known[name], value) for name, value in pairs}


def questions(motor: MotorKit | None) -> tuple[DeviceQuestion, ...]:
    """All of them; of a motor that is named, the gear is an example that suits it."""
    if motor is None:
        return QUESTIONS
    fits = {"gear_ratio": motor.gear_ratio}
    return tuple(replace(q, typical=fits.get(q.name, q.typical)) for q in QUESTIONS)


def refuse_missing(given: Mapping[str, float], motor: MotorKit | None = None) -> None:
    """Reject an incomplete set of answers; the error lists what is missing."""
    if missing := [q for q in questions(motor) if q.name not in given]:
        rows = "\n".join(f"  --give {q.name}={q.typical:g}   {q}" for q in missing)
        raise UserError(
            f"{len(missing)} of {len(QUESTIONS)} numbers are missing; the input is not a terminal.",
            f"Give them, or run this in a terminal:\n{rows}",
        )


def short_text(
    name: str, base: str, given: Mapping[str, float], motor: MotorKit | None = None
) -> str:
    """The device file; a motor's own numbers have its source, and the drive's settings follow."""
    sources = {}
    if motor is not None:
        sources = {k: s for k, value, s in motor.numbers() if given[k] == value}
    lines = [
        f"# Device file of esea-gen. These {len(QUESTIONS)} numbers are yours; every other one is "
        f"scaled from {base} to fit them,",
        f"# unless you give it here. To see all: esea-gen new whole --from {name}.toml",
        "# The encoders have no zero: the board arms once they are zeroed, esea-host zero ADDRESS.",
        f'schema = 1\nextends = "{base}"\nscaled = true',
        f'name = "{name}"\ntitle = "{name}: own drive, scaled from {base}"',
    ]
    section = ""
    for q in sorted(QUESTIONS, key=lambda q: q.key.partition(".")[0]):
        if section != (section := q.key.partition(".")[0]):
            lines.append(f"\n[{section}]")
        source = sources.get(q.name, "yours; write here where it comes from")
        known = "published" if q.name in sources else "assumed"
        quantity = Quantity.model_validate(
            {"value": given[q.name], "status": known, "source": source}
        )
        lines += [f"# {q.text}. {q.why}", toml_entry(q.name, quantity, whole=q.facts["whole"])]
    if motor is not None:
        lines += ["", f"# Settings of the {motor.name} that go with these numbers:"]
        lines += [f"#   {line}" for line in motor.settings(given)]
    return "\n".join(lines) + "\n"
