"""One assessment as it is worked on, in the terminal or the window, and its words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import write_json
from esea_gen.typed import read_number
from esea_host.assess.board import FRAME_S, KneeBoard
from esea_host.assess.hypotheses import NONE, disorder_of
from esea_host.assess.patients import (
    DEG,
    DISORDERS,
    MEAN_HEIGHT_M,
    MEAN_MASS_KG,
    RELAXED,
    Array,
    KneePatient,
    body_size,
    leg_weight_Nm,
)
from esea_host.assess.probing import (
    MEASURES,
    Comfort,
    ProbingMovement,
    informative,
    next_movement,
    plans,
)
from esea_host.assess.responses import (
    LATENCY_S,
    SENSOR_ERROR_NM,
    LegRecording,
    Location,
    Passage,
    along,
    check_body,
    nearest,
    passage,
)
from esea_host.assess.segments import MovementVerdict, Segment, judge
from esea_host.assess.session import WORDS, Assessment, take

GRADES = {1: "very mild", 2: "mild", 3: "moderate", 4: "marked", 5: "severe"}
HELP = (
    "A number: torque of your hands in Nm at that moment, bending positive, as the sensor shows.",
    f"A word: {', '.join(WORDS)}: how the leg resists, without a sensor.",
    "skip | undo | set S3=0.5 D2=0.3 (your own probabilities) | show | done",
)
MOVE_HELP = "move: the simulated patient's leg is moved."
BOARD_HELP = "move: make the movement at the board, then keep or repeat it; zero: zero the board."
TRIES, PATIENCE_S = 3, 60.0  # of one movement that nobody is asked about
READ_MOST = 60  # readings of a whole recording


def long_name(name: str) -> str:
    """Name of a category for people."""
    if "+" in name:
        return " with ".join(long_name(n) for n in sorted(name.split("+"), reverse=True))
    if name == RELAXED:
        return "no sign of either"
    what = disorder_of(name)
    if what is None or what[0] not in DISORDERS:
        return name
    grade = GRADES.get(round(what[1]), f"{what[1]:g}")
    return f"{grade} {DISORDERS[what[0]]}"


def unit_of(measure: str) -> str:
    return "nats" if measure == "expected" else "Nm"


def strength(p: float) -> str:
    words = ((0.95, "very likely"), (0.8, "likely"), (0.5, "more likely than not"))
    return next((w for least, w in words if p >= least), "possible")


def conclusion(session: Assessment) -> list[str]:
    ranked = sorted(session.by_name().items(), key=lambda x: -x[1])
    (first, p), (second, q) = ranked[0], ranked[1]
    made = len(session.evidence)
    out = []
    if not (made or session.by_hand):
        out.append("Nothing is measured yet: every known category is equally likely.")
    elif first == NONE:
        out.append(f"The leg responds like none of the known categories ({strength(p)}, {p:.0%}).")
        causes = "contracture, rigidity, tremor, a leg that is not relaxed"
        out.append(f"Look for another cause: {causes}.")
    else:
        out.append(f"Most like: {long_name(first)} ({strength(p)}, {p:.0%}).")
        out.append(f"Second: {long_name(second)} ({q:.0%}).")
    names = session.severity() if made else {}
    for what, s in names.items():
        if s["probability"] >= 0.1:
            how = f"{s['mean']:.1f} of 5, between {s['low']:g} and {s['high']:g} with 90 %."
            who = f"{DISORDERS.get(what, what)} ({s['probability']:.0%})"
            out.append(f"If {who}: severity {how}")
    movements = "movement" if made == 1 else "movements"
    now = "have stopped" if session.settled else "are still"
    out.append(f"{made} {movements}; the probabilities {now} changing.")
    if session.by_hand:
        out.append("The clinician set probabilities by hand; see the steps.")
    return out


class ClinicDesk:
    """Proposes, takes in, remembers; after every step the session is in its file."""

    def __init__(
        self,
        session: Assessment,
        comfort: Comfort | None = None,
        height_m: float = MEAN_HEIGHT_M,
        mass_kg: float = MEAN_MASS_KG,
        patient: KneePatient | None = None,
        file: Path | None = None,
        seed: int = 1,
        measure: str = MEASURES[0],
        board: KneeBoard | None = None,
    ) -> None:
        check_body(height_m, mass_kg)
        self.board, self._simulated = board, False  # of its recordings: some are simulated
        self.attempt: MovementVerdict | None = None  # that is to be kept or repeated
        self._source: dict[str, float | str] = {}
        self.session, self._comfort, self.measure = session, comfort or Comfort(), measure
        self.height_m, self.mass_kg = height_m, mass_kg
        self.patient, self.file, self.seed = patient, file, seed
        plans(session.hypotheses, self._comfort)  # refused now, not at the first step
        self._value: Array | None = None
        self._proposed: ProbingMovement | None = None
        self.moved: tuple[ProbingMovement, Passage] | None = None
        self._count = 0
        self._keep()

    def _keep(self) -> None:
        self._value = self._proposed = None
        self.attempt = None
        about: dict[str, object] = {"simulated": self.simulated, "measure": self.measure}
        about |= {"height_m": self.height_m, "mass_kg": self.mass_kg}
        if self.board is not None:
            about["recording"] = self.board.recorded
        write_json(self.file, "host-assess-run", about | self.session.to_dict())

    @property
    def simulated(self) -> bool:
        board = self.board is not None and self.board.simulated
        return self._simulated or self.patient is not None or board

    @property
    def comfort(self) -> Comfort:
        return self._comfort

    @comfort.setter
    def comfort(self, limits: Comfort) -> None:
        plans(self.session.hypotheses, limits)
        self._comfort = limits
        if self.board is not None:
            self.board.watch.comfort = limits
        self._keep()

    @property
    def value(self) -> Array:
        """Expected information of a movement through each cell, NaN out of reach or comfort."""
        if self._value is None:
            self._value = informative(self.session, self._comfort, self.measure)
        return self._value

    @property
    def proposed(self) -> ProbingMovement:
        if self._proposed is None:
            self._proposed = next_movement(self.session, self._comfort, self.value)
        return self._proposed

    @property
    def answered(self) -> Location:
        """Position of the leg at the cause of the midpoint's reading: 60 ms before."""
        m = self.proposed
        angle, rate = m.at(0.5 * m.duration_s - LATENCY_S)
        return Location(float(angle), float(rate))

    def torque(self, torque_Nm: float) -> None:
        """Read off a sensor at the midpoint of the movement, where nothing accelerates."""
        size = body_size(self.height_m, self.mass_kg)
        middle_rad = self.proposed.location.angle_rad
        carried = -leg_weight_Nm(self.height_m, self.mass_kg) * math.cos(middle_rad)
        response = (torque_Nm - carried) / size
        self.session.observe(self.answered, response, SENSOR_ERROR_NM / size)
        self._keep()

    def word(self, word: str) -> None:
        """Felt by the hands at the midpoint, without a sensor."""
        self.session.feel(self.answered, word)
        self._keep()

    def move(self) -> str:
        """Make the proposed movement with the simulated patient; return its result."""
        if self.patient is None:
            raise UserError("There is no simulated patient.", "Start with --patient.")
        # What simulates takes seconds to load: only where it is needed.
        from esea_host.assess.simulated import probed

        wanted, self._count = self.proposed, self._count + 1
        (passed,) = probed([self.patient], [wanted], [[self.seed, 9, self._count]])
        self.moved = wanted, passed
        since = len(self.session.trail)
        hit = take(self.session, passed, wanted.location)
        self._keep()
        return f"Simulated: {self._read(since, hit)}"

    # -- from a board ------------------------------------------------------------------------------

    def ask_therapist(self) -> str:
        assert self.board is not None
        self.board.show(self.proposed)
        return "Simulated: the therapist takes the leg to the start, and makes the movement."

    def judge(self, segment: Segment) -> MovementVerdict:
        """Compare the measured movement with the proposed one; the attempt waits for a decision."""
        verdict = judge(segment, self.proposed, self.height_m, self.mass_kg)
        if verdict.tried and self.board is not None:
            self.attempt = verdict
            self._source = {"begin_s": segment.begin_s, "end_s": segment.end_s}
            if self.board.recorded is not None:
                self._source["recording"] = self.board.recorded
            facts = {"asked": self.proposed.location.text(), "passed": verdict.passed}
            self.board.note("movement", said=verdict.text, **self._source, **facts)
        return verdict

    def keep(self) -> str:
        """Accept the attempt; its usable part counts even if it missed."""
        verdict, wanted = self._attempted(), self.proposed
        since = len(self.session.trail)
        if verdict.passage is None:
            self.session.missed(wanted.location)
        else:
            self.moved = wanted, verdict.passage
            take(self.session, verdict.passage, wanted.location, self._source)
        self._keep()
        return self._read(since, verdict.passed)

    def repeat(self) -> str:
        """Forget the attempt; the recording has it."""
        self._attempted()
        self.attempt = None
        return "Repeat the movement."

    def broken(self, reason: str) -> str:
        """A movement ended before its end; the trail tells why."""
        self.skip(f"the movement was cut off: {reason}")
        return f"The movement was cut off: {reason}. Repeat it."

    def _attempted(self) -> MovementVerdict:
        if self.attempt is None:
            raise UserError("There is no movement to keep or repeat.", "Make the movement first.")
        return self.attempt

    def _read(self, since: int, passed: bool) -> str:
        made = [e.details for e in self.session.trail[since:] if e.what == "measured"]
        if not made:
            return "nothing could be read: your hands were at the limit of their pull"
        d = made[0]
        told = f"{d['readings']} places read, {d['response_Nm']:.1f} Nm at {d['location']}"
        return told if passed else f"{told}; the requested location was missed"

    def recording(self, recording: LegRecording, name: str) -> str:
        """A recorded movement, read from the most informative place that it passed."""
        p, value = passage(recording), np.nan_to_num(self.value, nan=-1.0)
        self._simulated |= recording.simulated
        for cell in np.argsort(-value):
            wanted = self.session.hypotheses.grid.location(int(cell))
            found = along(p, wanted, READ_MOST) if nearest(p, wanted)[1] <= 1 else None
            if found is not None and self.session.observe_movement(found):
                self._keep()
                where, first = found.locations[0], found.responses_Nm[0]
                count = len(found.locations)
                return f"{name}: {count} places read, {first:.1f} Nm at {where.text()}"
        self.skip(f"{name}: no location of the map was passed")
        return f"{name}: no location of the map was passed"

    def skip(self, why: str) -> None:
        self.session.skip(why)
        self._keep()

    def leave_out(self) -> None:
        """Propose another movement from now on: this one cannot be made."""
        self.session.leave_out(self.proposed.location)
        self._keep()

    def undo(self) -> bool:
        done = self.session.undo()
        self._keep()
        return done

    def override(self, probabilities: Mapping[str, float], why: str) -> None:
        self.session.override(probabilities, why)
        self._keep()

    def about(self, who: str) -> str:
        """Whose page it is; nobody is to take a simulated one for a person's."""
        return f"SIMULATED PATIENT {who}".strip() if self.simulated else who

    def now(self) -> str:
        name, p = max(self.session.by_name().items(), key=lambda x: x[1])
        settled = "; probabilities have stopped changing" if self.session.settled else ""
        return f"Now: {long_name(name)} {p:.0%}{settled}"


def describe(m: ProbingMovement) -> str:
    way = "Bend" if m.end_rad > m.start_rad else "Straighten"
    return (
        f"{way} the knee from {m.start_rad / DEG:.0f}° to {m.end_rad / DEG:.0f}° in "
        f"{m.duration_s:.1f} s (looked at: {m.location.text()})."
    )


def converse(desk: ClinicDesk, lines: TextIO, say: Callable[[str], None]) -> None:
    """Propose, ask, take in, until done or the lines end."""
    help_ = (BOARD_HELP,) if desk.board else (MOVE_HELP,) if desk.patient else ()
    for line in HELP + help_:
        say(line)
    while True:
        say(f"\n{describe(desk.proposed)}")
        typed = lines.readline()
        if not typed or typed.strip() in ("done", "quit", "q"):
            break
        try:
            _take(desk, typed.strip(), say)
        except UserError as error:
            say(str(error))
    for line in ("", *conclusion(desk.session)):
        say(line)


def attempted(
    desk: ClinicDesk, board: KneeBoard, say: Callable[[str], None], patience_s: float = PATIENCE_S
) -> str:
    """Wait for one attempt at the proposed movement; return its result."""
    if trouble := board.trouble():
        raise UserError(trouble, "Type zero or skip.")
    board.start_anew()
    board.show(desk.proposed)
    until_s = board.clock_s() + patience_s
    while board.clock_s() < until_s:
        for event in board.poll(FRAME_S):
            if event.kind == "warning":
                say(f"\a{event.text}")
            elif event.kind == "broken":
                return desk.broken(event.text)
            elif event.segment is not None:
                verdict = desk.judge(event.segment)
                if verdict.tried:
                    return verdict.text
        if board.problem:
            return board.problem
    return f"The movement did not come within {patience_s:g} s."


def assess_unattended(desk: ClinicDesk, movements: int, say: Callable[[str], None]) -> None:
    """Keep passing attempts and repeat missed ones until probabilities settle, or so many moves."""
    assert desk.board is not None
    for _ in range(movements):
        say("")
        say(describe(desk.proposed))
        for tried in range(TRIES):
            if desk.attempt is not None:
                desk.repeat()
            say(attempted(desk, desk.board, say))
            if desk.board.problem:
                raise UserError(desk.board.problem, "The file keeps all earlier steps.")
            if desk.attempt is not None and (desk.attempt.passed or tried == TRIES - 1):
                say(desk.keep())
                break
        else:
            desk.leave_out()
        say(desk.now())
        if desk.session.settled:
            break
    for line in ("", *conclusion(desk.session)):
        say(line)


def _take(desk: ClinicDesk, typed: str, say: Callable[[str], None]) -> None:
    head, _, rest = typed.partition(" ")
    if typed in WORDS:
        desk.word(typed)
    elif head == "move" and desk.board is not None:
        say(attempted(desk, desk.board, say))
        say("keep | repeat" if desk.attempt else "")
        return
    elif head == "keep":
        say(desk.keep())
    elif head == "repeat" and desk.board is not None:
        say(desk.repeat())
        say(attempted(desk, desk.board, say))
        return
    elif head == "zero" and desk.board is not None:
        desk.board.zero()
        say("The board is zeroed: the straight leg is 0°.")
        return
    elif head == "move":
        say(desk.move())
    elif head == "skip":
        desk.skip(rest)
    elif head == "undo":
        if not desk.undo():
            say("There is nothing to undo.")
    elif head == "set":
        desk.override(_probabilities(rest), "typed by the clinician")
    elif head == "show":
        for name, p in sorted(desk.session.by_name().items(), key=lambda x: -x[1])[:6]:
            say(f"  {p:6.1%}  {long_name(name)}")
        return
    else:
        try:
            torque_Nm = read_number(typed, -100, 100, "Nm")
        except UserError as error:
            raise UserError(f"{error} Or type a word.", HELP[1]) from None
        desk.torque(torque_Nm)
    say(desk.now())


def _probabilities(text: str) -> dict[str, float]:
    out = {}
    for part in text.split():
        name, _, value = part.partition("=")
        try:
            out[name] = read_number(value, 0, 1)
        except UserError as error:
            raise UserError(f"{part!r}: {error.what}", "Write S3=0.5 D2=0.3.") from None
    if not out:
        raise UserError("set: no value given.", "Write S3=0.5 D2=0.3.")
    return out
