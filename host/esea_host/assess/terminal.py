"""An assessment as a conversation in the terminal: lines in, lines out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TextIO

from esea_gen.errors import UserError
from esea_host.assess.patients import (
    DEG,
    MEAN_HEIGHT_M,
    MEAN_MASS_KG,
    leg_weight_Nm,
)
from esea_host.assess.probing import Comfort, ProbingMovement, next_movement
from esea_host.assess.responses import (
    SENSOR_ERROR_NM,
    LegRecording,
    Location,
    nearest_reading,
    passage,
)
from esea_host.assess.session import WORDS, Assessment
from esea_host.assess.words import conclusion, long_name

HELP = (
    "A number: torque of your hands in Nm at that moment, bending positive, as the sensor shows.",
    f"A word: {', '.join(WORDS)}: how the leg resists, without a sensor.",
    "skip | undo | set S3=0.5 D2=0.3 (your own probabilities) | show | done",
)


def describe(m: ProbingMovement) -> str:
    """A movement as an instruction."""
    way = "Bend" if m.end_rad > m.start_rad else "Straighten"
    return (
        f"{way} the knee from {m.start_rad / DEG:.0f}° to {m.end_rad / DEG:.0f}° in "
        f"{m.duration_s:.1f} s (looked at: {m.location.text()})."
    )


def add_recording(session: Assessment, recording: LegRecording, name: str) -> str:
    """The most informative location that a recorded movement passed."""
    p = passage(recording)
    from esea_host.assess.probing import informative

    value = informative(session)
    order = sorted(range(len(value)), key=lambda c: -value[c])
    for cell in order:
        wanted = session.hypotheses.grid.location(cell)
        if not session.hypotheses.known[cell]:
            continue
        found = nearest_reading(p, wanted, 0.5)
        if found and session.observe(found.location, found.response_Nm, found.spread_Nm):
            return f"{name}: {found.response_Nm:.1f} Nm at {found.location.text()}"
    session.skip(f"{name}: no location of the map was passed")
    return f"{name}: no location of the map was passed"


def converse(
    session: Assessment,
    comfort: Comfort,
    height_m: float,
    mass_kg: float,
    lines: TextIO,
    say: Callable[[str], None],
) -> None:
    """Propose, ask, take in, until done or the lines end."""
    for line in HELP:
        say(line)
    while True:
        move = next_movement(session, comfort)
        say("")
        say(describe(move))
        typed = lines.readline()
        if not typed or typed.strip() in ("done", "quit", "q"):
            break
        try:
            _take(session, move.location, typed.strip(), height_m, mass_kg, say)
        except UserError as error:
            say(str(error))
    say("")
    for line in conclusion(session):
        say(line)


def _take(
    session: Assessment,
    where: Location,
    typed: str,
    height_m: float,
    mass_kg: float,
    say: Callable[[str], None],
) -> None:
    head, _, rest = typed.partition(" ")
    if typed in WORDS:
        session.feel(where, typed)
    elif head == "skip":
        session.skip(rest)
    elif head == "undo":
        if not session.undo():
            say("Nothing to take back.")
    elif head == "set":
        session.override(_probabilities(rest), "typed by the clinician")
    elif head == "show":
        for name, p in sorted(session.by_name().items(), key=lambda x: -x[1])[:6]:
            say(f"  {p:6.1%}  {long_name(name)}")
        return
    else:
        try:
            torque = float(typed.replace(",", "."))
        except ValueError:
            raise UserError(f"{typed!r} is no number and no word.", HELP[1]) from None
        if not abs(torque) <= 100:
            raise UserError(f"torque: {torque} Nm.", "Give -100 to 100 Nm.")
        size = height_m * mass_kg / (MEAN_HEIGHT_M * MEAN_MASS_KG)
        response = extra_torque_Nm(torque, where, height_m, mass_kg)
        session.observe(where, response, SENSOR_ERROR_NM / size)
    best = max(session.by_name().items(), key=lambda x: x[1])
    say(f"Now: {long_name(best[0])} {best[1]:.0%}" + ("; settled" if session.settled else ""))


def extra_torque_Nm(torque_Nm: float, where: Location, height_m: float, mass_kg: float) -> float:
    """A torque read at the midpoint, where nothing accelerates, as a response: weight off."""
    import math

    carried = -leg_weight_Nm(height_m, mass_kg) * math.cos(where.angle_rad)
    return (torque_Nm - carried) / (height_m * mass_kg / (MEAN_HEIGHT_M * MEAN_MASS_KG))


def _probabilities(text: str) -> dict[str, float]:
    out = {}
    for part in text.split():
        name, _, value = part.partition("=")
        try:
            out[name] = float(value)
        except ValueError:
            raise UserError(f"{part!r}.", "Write S3=0.5 D2=0.3.") from None
    if not out:
        raise UserError("set: nothing given.", "Write S3=0.5 D2=0.3.")
    return out
