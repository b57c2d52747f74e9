"""The wrist study through a board: by name, under conditions it confirms, and when it is lost."""

from __future__ import annotations

import socket
import threading
from functools import partial

import numpy as np
import pytest

import esea_host
from esea_gen.device import load_device, parse_device
from esea_gen.errors import UserError
from esea_host.people.person import PersonModel, person
from esea_host.simulated import SimulatedBoard
from esea_host.simulated.server import serve_hosts
from esea_host.study.board import BoardSource
from esea_host.study.fitting import DeviceSignals
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.plan import generator
from esea_host.study.session import COMPLETED, FAILED, replay
from esea_host.study.task import Situation, task_named
from esea_host.wrist.virtual import VirtualPerson
from tests.conducted import at_step, of_tasks, study_of
from tests.link.test_host_link import Proxy

NEUTRAL = (
    'task = "wrist.neutral"\n'
    "parameters = { seconds = 1.0, still_deg = 6.0, impairment = %s }\ntrials = [{}]"
)
RANGE = (
    'task = "wrist.range"\nparameters = { axis = "%s", way = 1, seconds = 2.0, impairment = %s }\n'
    "trials = [{}]"
)
HEALTHY, CONSTRAINED = "false", "true"


@pytest.fixture
def begun(tmp_path):
    """Starts sessions with a simulated participant in the drive; closes them in any case."""
    made = []

    def begin(*blocks, code="P01", kind=VirtualPerson):
        folder = tmp_path / code
        study = StudyFolder.create(folder, of_tasks(*blocks), simulated=True, durable=False)
        study.enrol(code, True)
        who = person(generator(1, 4, len(made)), PersonModel())
        made.append(kind(who, study.log_of(code, 0).parent))
        return study.session(code, 0, made[-1]), made[-1]

    yield begin
    for source in made:
        source.close()


def logged(session, kind):
    return [e.data for e in read_log(session.log.path).entries if e.kind == kind]


class Looking(VirtualPerson):
    """Looks at what the application has in its memory, beside what came over the link."""

    seen: list

    def frame(self, requests):
        told, board = super().frame(requests), self.board.board
        names = "theta_load_flexion_rad", "theta_load_deviation_rad"
        memory = [180 / np.pi * board.values[board.places[n]] for n in names]
        self.seen.append(dict(zip(("fe_deg", "ru_deg"), memory, strict=True)))
        return told


def test_participants_get_over_the_link_what_the_application_has(begun):
    """Rows made of the application's memory are those of the session, to the bit."""
    session, source = begun(NEUTRAL % HEALTHY, RANGE % ("RU", HEALTHY), kind=Looking)
    source.seen = []
    assert session.run() == ""
    samples = [s for data in logged(session, "frames") for s in data["samples"]]
    assert [list(x.values()) for x in source.seen] == [s[1:] for s in samples]
    past = []
    for trial in session.state.plan.trials:
        task = task_named(trial.task, "")
        state = task.begin(Situation(task.Parameters(**trial.parameters), "", tuple(past), 0))
        for time_s, *_ in samples:
            step = task.step(state, time_s, source.seen.pop(0))
            state = step.state
            if step.outcome is not None:
                break
        samples = samples[len(samples) - len(source.seen) :]
        row = session.state.past[trial.number - 1]
        assert step.outcome.row.items() <= row.items()
        past.append(row)
    assert all(same for *_, same in replay(session.log.path))


def test_conditions_are_confirmed_and_logged_with_their_tick(begun):
    session, source = begun(NEUTRAL % HEALTHY, NEUTRAL % CONSTRAINED, RANGE % ("FE", CONSTRAINED))
    assert session.run() == ""
    found = logged(session, "condition")
    assert [c["asked"] for c in found] == [{"constrained": x} for x in (0.0, 1.0, 1.0)]
    assert [set(c["acts"].values()) for c in found] == [{0.0}, {1.0}, {1.0}]
    assert found[0]["tick"] < found[1]["tick"] < found[2]["tick"]
    assert 4.0 < session.state.past[2]["end_deg"] < 35.0  # run into at 5 deg; 50 without it
    assert all(same for *_, same in replay(session.log.path))
    assert {g.name for g in source.gauges()} == {
        f"{what} {axis}" for what in ("torque", "angle") for axis in ("flexion", "deviation")
    }


def test_after_a_loss_of_power_nothing_is_armed_until_the_session_is_resumed(begun):
    session, source = begun(NEUTRAL % HEALTHY, RANGE % ("FE", CONSTRAINED), NEUTRAL % CONSTRAINED)
    why = session.run(show=at_step(150, source.board.restart))
    assert ("not armed" in why, source.device.state()) == (True, "UNREFERENCED")
    assert session.run() == ""
    states = [session.state.states[n] for n in (1, 2, 3)]
    assert states == [COMPLETED, FAILED, COMPLETED], session.state.reasons
    assert "not armed" in session.state.reasons[2]
    _, again = logged(session, "ready")
    assert again["state"] == "ARMED"
    assert [c["trial"] for c in logged(session, "condition")] == [1, 2, 3]


def test_an_impairment_that_is_not_confirmed_begins_nothing(begun, monkeypatch):
    session, source = begun(NEUTRAL % CONSTRAINED)
    said = []
    want = source.device.want
    monkeypatch.setattr(source.device, "want", lambda *a, **w: want(*a, **w | {"constrained": 0.0}))
    monkeypatch.setattr("esea_host.study.board.SWITCH_S", 1.0)
    monkeypatch.setattr(source, "waits", said.append)
    session.run()
    assert session.state.states[1] == FAILED
    assert "impairment of flexion and deviation has not switched" in session.state.reasons[1]
    assert logged(session, "frames") == []


def test_a_fault_of_one_axis_ends_the_trial_and_the_session_says_which(begun):
    session, source = begun(NEUTRAL % HEALTHY, NEUTRAL % HEALTHY)
    spoil = partial(source.board.board.drivers.__setitem__, 1, 1.0)  # frames of an encoder
    assert "Correct the cause" in session.run(show=at_step(50, spoil))
    assert session.state.states[1] == FAILED
    assert "the board is in FAULT: " in session.state.reasons[1]
    assert len(session.state.remaining) == 1


def renamed(old, new):
    text = load_device("wrist_drive").toml().replace(f'"{old}"', f'"{new}"')
    return parse_device(text, "mine.toml")


@pytest.mark.parametrize(
    ("device", "words"),
    [
        (lambda: load_device("elbow_drive"), "fe_deg is theta_load_rad of axis flexion, and its"),
        (lambda: load_device("wrist_board"), "wrist_board has no .impairment."),
        (lambda: renamed("deviation", "side"), "axis deviation, and its axes are flexion and side"),
    ],
)
def test_a_device_that_does_not_fit_is_refused_beforehand(device, words):
    task = task_named("wrist.neutral", "")
    uses = [(task, task.conditions(task.Parameters(impairment=True)))]
    with pytest.raises(UserError, match=words):
        DeviceSignals(device()).must_fit(uses)


@pytest.mark.ci
def test_a_pulled_cable_fails_the_trial_and_the_session_can_be_resumed(tmp_path, busy_machine):
    """Over TCP: the board switches its motor off; connected again it is armed, and told so."""
    study = study_of(tmp_path / "s", of_tasks(*(RANGE % ("FE", HEALTHY),) * 2))
    board = SimulatedBoard("wrist_drive", person="nobody")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve_hosts, args=(board, listener, 0.5, False))
        thread.start()
        cable = Proxy(listener.getsockname()[1])
        with esea_host.connect(cable.address) as device:
            source = BoardSource(device, study.log_of("P01", 0).parent, drive=True)
            session = study.session("P01", 0, source)
            zero = device.zero  # within it the cable is pulled for the first time
            device.zero = lambda: [setattr(device, "zero", zero), cable.pull(), zero()]
            assert "Check cable and power" in session.run(show=at_step(20, cable.pull))
            assert session.run() == ""
            reasons = session.state.reasons
            assert [session.state.states[n] for n in (1, 2)] == [FAILED, COMPLETED], reasons
            assert "Check cable and power" in reasons[1]
            assert logged(session, "ready")[1]["state"] in ("ARMED", "ACTIVE")
            assert not logged(session, "ready")[1]["restarted"]
            assert logged(session, "link")[-1]["reconnects"] == 2
            source.close()
            session.close()
            assert all(same for *_, same in replay(session.log.path))
        cable.close()
        listener.close()
        thread.join(10.0)
    board.close()
    assert not thread.is_alive()
