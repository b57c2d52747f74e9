"""Sessions in a thread that tests can pause, with their two windows."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path

from esea_host.cli.options import know_shipped_tasks
from esea_host.study.conductor import Conductor
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.session import StudySession
from esea_host.study.source import SimulatedSource
from tests.conftest import ROOT

know_shipped_tasks()
EXAMPLE = ROOT / "examples" / "steady_hold.toml"
TRACKING = (
    'task = "interaction.tracking"\ntrials = [{ repeat = 3, parameters = { seconds = 1.0 } }]'
)
WAIT_S = 120  # a machine may be busy


def of_tasks(*blocks: str) -> Protocol:
    """A protocol of one session; each block is its lines behind the name."""
    head = 'schema = 1\nname = "short"\ntitle = "short"\nseed = 1\n'
    head += '[[session]]\nname = "calibration"\n'
    text = "".join(
        f'[[session.block]]\nname = "{k}: {b.split(chr(34))[1]}"\n{b}\n'
        for k, b in enumerate(blocks, 1)
    )
    return parse_protocol(head + text, "short.toml")


def calibration() -> Protocol:
    """The healthy calibration, without its rests."""
    return of_tasks(
        'task = "wrist.neutral"\ntrials = [{}]',
        'task = "wrist.range"\ntrials = [{ parameters = { axis = "FE", way = 1 } }, '
        '{ parameters = { axis = "FE", way = -1 } }]',
        'task = "wrist.velocity"\ntrials = [{ repeat = 2, parameters = { axis = "FE" } }]',
    )


def study_of(folder: Path, protocol: Protocol) -> StudyFolder:
    study = StudyFolder.create(folder, protocol, simulated=True, durable=False)
    study.enrol("P01", True)
    return study


def changed(old: str, new: str) -> Protocol:
    """The example's protocol with another word."""
    text = EXAMPLE.read_text(encoding="utf-8")
    assert old in text
    return parse_protocol(text.replace(old, new, 1), "p.toml", [EXAMPLE.parent])


def run_one(study: StudyFolder, **more) -> StudySession:
    """The first session of P01, or what remains of it."""
    session = study.session("P01", 0, SimulatedSource(3))
    session.run(**more)
    study.finish(session)
    session.close()
    return session


def headless(folder: Path, protocol: Protocol) -> StudyFolder:
    """A study whose first session was run without windows."""
    study = study_of(folder, protocol)
    run_one(study)
    return study


def logged(study: StudyFolder, *kinds: str) -> list:
    """Events of a session; of all kinds but what a screen tells, where none is named."""
    entries = read_log(study.log_of("P01", 0)).entries
    return [
        (e.kind, e.data) for e in entries if (e.kind in kinds if kinds else e.kind != "display")
    ]


class Stepped(Conductor):
    """Stands still at chosen times of chosen trials until it is let go, so that a test can look."""

    def __init__(self, *given, at=(), **more):
        super().__init__(*given, **more)
        self.at, self.there, self.go = list(at), threading.Event(), threading.Event()

    def steps(self, time_s, step):
        super().steps(time_s, step)
        if self.at and (self.trial.number, time_s) >= self.at[0]:
            self.at.pop(0)
            self.there.set()
            assert self.go.wait(WAIT_S)
            self.go.clear()

    def arrive(self):
        assert self.there.wait(WAIT_S), self.error
        self.there.clear()

    def go_on(self):
        self.go.set()
        self.arrive()


def beginning(folder: Path):
    """Starts sessions of a protocol; ends them in any case."""
    made = []

    def begin_one(protocol, source=None, at=(), **more) -> Stepped:
        study = study_of(folder, protocol)
        session = study.session("P01", 0, source or SimulatedSource(3))
        made.append(Stepped(study, session, **{"speed": math.inf, "at": at} | more))
        made[-1].start()
        return made[-1]

    yield begin_one
    for conductor in made:
        conductor.stop("the test is over")
        conductor.at.clear()
        conductor.go.set()
        conductor.join(20)
        assert conductor.over


def opening(qtbot):
    """Opens both windows of a session."""
    from esea_host.windows.study.operator import OperatorWindow
    from esea_host.windows.study.participant import ParticipantWindow

    def of(conductor, board=None, language="", **more):
        words = conductor.study.protocol.words(language)
        operator = OperatorWindow(conductor, words, board)
        made = ParticipantWindow(conductor, words, **more), operator
        for window in made:
            qtbot.addWidget(window)
            window.show()
        made[1].activateWindow()
        qtbot.waitUntil(made[1].isActiveWindow, timeout=120_000)
        return made

    return of


def until(there) -> None:
    """Wait for something in the session's thread."""
    end_s = time.monotonic() + 10
    while not there():
        assert time.monotonic() < end_s
        time.sleep(0.002)


def at_step(number, act):
    """What a session shows its scenes to, and that acts at one of them."""
    steps = iter(range(100_000))
    return lambda _: act() if next(steps) == number else None


def ended(conductor: Stepped) -> None:
    conductor.go.set()
    conductor.join(20)
    assert conductor.over
    if conductor.error is not None:
        raise conductor.error
