"""Session with a board: its data reaches the task, and a stop goes to the motor first."""

from __future__ import annotations

import errno
import math
import os
import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

import esea_host
from esea_gen.errors import UserError
from esea_host.interaction.recordings import (
    cut_trials,
    is_simulated,
    paused_at,
    read_angle,
    write_recording,
)
from esea_host.simulated.server import serve_hosts
from esea_host.study.board import WORKING, BoardSource
from esea_host.study.conductor import HELD, Conductor
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.recorded import BoardInputs
from esea_host.study.session import COMPLETED, FAILED, StudySession, replay
from esea_host.study.task import task_named
from tests.conducted import at_step, calibration, of_tasks, opening, study_of, until

TRACKING = (
    'task = "interaction.tracking"\ntrials = [{ repeat = 2, parameters = { seconds = 1.0 } }]'
)


@pytest.fixture
def begun(tmp_path, lockstep) -> Iterator:
    """A session of a protocol with the board whose clock the session moves."""
    sources = []

    def begin(protocol, drive=True) -> tuple[StudySession, BoardSource]:
        study = study_of(tmp_path / "s", protocol)
        folder = study.log_of("P01", 0).parent
        sources.append(BoardSource(lockstep, folder, drive, lockstep.advance))
        return study.session("P01", 0, sources[-1]), sources[-1]

    yield begin
    for source in sources:
        source.close()


def test_what_the_board_tells_is_what_the_task_gets_and_every_run_is_recorded(begun, lockstep):
    session, source = begun(of_tasks(TRACKING))
    # In a pause the motor lets go, and is armed again.
    source.before = lambda _: any(source.pull() for _ in range(70)) or ""
    assert session.run() == ""
    assert lockstep.state() == "ACTIVE"
    source.close()
    assert "rms_error_deg" in session.state.past[1]
    entries = read_log(session.log.path).entries
    ready = next(e.data for e in entries if e.kind == "ready")
    assert ready["simulated"]
    assert ready["state"] == "ARMED"
    assert ready["limits"]["limits.tau_max_Nm"] == pytest.approx(8.0)
    assert abs(ready["tau_Nm"]) < 0.8
    samples = [s for e in entries if e.kind == "frames" for s in e.data["samples"]]
    assert len(samples) == 200
    with esea_host.open_log(session.log.path.parent / ready["recording"]) as log:
        table = log["sense_out"]
        assert log.gaps == ()
        # The second trial: as many runs as milliseconds, and each sample is one of them.
        start, end = (log.events(t)[-1]["board_ns"] * 1e-9 for t in ("trial", "trial_end"))
        during = table.between(start + 5e-4, end + 5e-4)
        assert len(during) == 1000
        assert np.array_equal(during["theta_load_rad"][9::10], [s[1] for s in samples[100:]])
    # Cut out for the analysis, trial by trial.
    study = StudyFolder.open(session.log.path.parents[2])
    assert cut_trials(study) == 2
    assert cut_trials(study) == 0
    cut = session.log.path.parent / "encoder-2.csv"
    assert is_simulated(cut)
    time_s, theta_deg, _ = read_angle(cut)
    assert np.allclose(time_s, np.arange(1, 1001) / 1000)
    assert np.allclose(theta_deg, np.degrees(during["theta_load_rad"]), atol=1e-6)
    # Of a recording that a crash has cut, what is left is compared, with its own session's.
    recording = cut.parent / "device-1.mcap"
    os.truncate(recording, recording.stat().st_size * 9 // 10)
    inputs = BoardInputs(session.log.path)
    assert all(same for _, _, same in replay(session.log.path, (), inputs))
    assert 0 < inputs.lacking < 200
    recording.rename(cut.parent / "device-2.txt")
    cut.unlink()
    assert cut_trials(study) == 0
    torque, angle = source.gauges()
    assert (torque.low, torque.high) == pytest.approx((-8.0, 8.0))
    assert angle.high == pytest.approx(np.degrees(2.5))
    assert lockstep.state() != "ACTIVE"  # disarmed with the source's end


def test_a_trial_that_is_repeated_is_cut_again(begun, lockstep):
    session, source = begun(of_tasks(TRACKING))
    session.run()
    source.close()
    session.repeat(2, "a cough")
    session.close()
    study, folder = StudyFolder.open(session.log.path.parents[2]), session.log.path.parent
    write_recording(folder / "encoder-1.csv", [1, 2], [0, 0], [0, 0], True)
    write_recording(folder / "encoder-2.csv", [1, 2], [0, 0], [0, 0], True)
    again = BoardSource(lockstep, folder, True, lockstep.advance)
    study.session("P01", 0, again).run()
    again.close()
    assert cut_trials(study) == 1
    assert len(read_angle(folder / "encoder-2.csv")[0]) == 1000


def test_what_counts_is_what_came_after_the_last_pause(tmp_path):
    time_s = np.arange(1, 11) / 10
    paused = paused_at(
        time_s, [(0.2, "paused"), (0.35, "resumed"), (0.6, "paused"), (0.8, "resumed")]
    )
    assert np.flatnonzero(paused).tolist() == [1, 2, 5, 6]
    write_recording(tmp_path / "a.csv", time_s, time_s, paused, False)
    assert not is_simulated(tmp_path / "a.csv")
    assert read_angle(tmp_path / "a.csv")[0].tolist() == pytest.approx([0.8, 0.9, 1.0])
    write_recording(tmp_path / "b.csv", time_s, time_s, paused & False, False)
    assert (tmp_path / "b.csv").read_text().startswith("time_s,theta_rad\n")
    assert len(read_angle(tmp_path / "b.csv")[0]) == 10


def test_a_board_that_is_not_armed_is_asked_for_nothing(begun, lockstep, monkeypatch):
    asked = []
    monkeypatch.setattr(lockstep, "want", lambda *_, **wanted: asked.append(wanted))
    _, source = begun(of_tasks(TRACKING), drive=False)
    source.want({})
    assert asked == []
    monkeypatch.setattr(lockstep, "state", lambda: "ARMED")
    source.want({})
    source.want({"tau_desired_Nm": 0.5})
    assert [(w["mode"], w["tau_desired_Nm"]) for w in asked] == [(1.0, 0.0), (1.0, 0.5)]
    monkeypatch.undo()


def test_what_a_board_has_not_fails_the_trial_with_words(begun):
    session, _ = begun(calibration(), drive=False)
    session.run()
    assert session.state.states[1] == FAILED
    assert "elbow_drive does not fit: fe_deg is" in session.state.reasons[1]
    assert "axis flexion, and its only axis is without a name" in session.state.reasons[1]


def test_what_a_board_cannot_do_is_not_asked_of_it(begun):
    _, source = begun(of_tasks(TRACKING), drive=False)
    with pytest.raises(UserError, match="asks elbow_drive for impairment"):
        source.want({"impairment": 1.0})


def test_a_fault_ends_the_trial_and_a_stopped_board_starts_nothing(begun, lockstep):
    session, _ = begun(of_tasks(TRACKING))
    # Within the second trial.
    session.run(show=at_step(120, lambda: [lockstep.stop(), lockstep.advance(0.7)]))
    assert [session.state.states[n] for n in (1, 2)] == [COMPLETED, FAILED]
    assert "the board is in STOPPED" in session.state.reasons[2]
    assert len(session.state.remaining) == 0
    session.repeat(2, "the stop was an accident")
    session.close()
    again = StudySession(session.log.path, session.state.plan, "P01", session.source)
    assert "the board is in STOPPED" in again.run()
    again.close()


def test_a_full_disk_fails_the_trial_and_ends_the_session_with_the_reason(begun, monkeypatch):
    session, _ = begun(of_tasks(TRACKING))
    full = Mock(side_effect=OSError(errno.ENOSPC, ""))
    show = at_step(50, lambda: monkeypatch.setattr("mcap.writer.Writer.add_message", full))
    assert "the disk is full" in session.run(show=show)
    assert "the disk is full" in session.state.reasons[1]


def test_a_task_that_raises_leaves_the_board_under_control(begun, lockstep, monkeypatch):
    """Its torque ends with the deadline, the next trial runs, and the motor goes off at the end."""
    kind = type(task_named("interaction.tracking", ""))
    whole, steps = kind.step, iter(range(1000))

    def step(self, state, time_s, inputs):
        made = replace(whole(self, state, time_s, inputs), requests={"tau_desired_Nm": 0.5})
        return made if next(steps) != 50 else 1 / 0

    monkeypatch.setattr(kind, "step", step)
    session, source = begun(of_tasks(TRACKING))
    assert session.run() == ""
    assert [session.state.states[n] for n in (1, 2)] == [FAILED, COMPLETED]
    assert "ZeroDivisionError" in session.state.reasons[1]
    lockstep.advance(0.6)
    assert lockstep.state() not in WORKING
    source.close()


def test_a_board_lost_in_a_rest_is_armed_when_the_operator_says_so(
    begun, lockstep, simulated_elbow
):
    session, source = begun(of_tasks(TRACKING.replace("2", "3", 1) + "\nbetween_s = 1.0"))
    conductor = Conductor(StudyFolder.open(session.log.path.parents[2]), session, math.inf)
    rest = source.rest

    def lose_power(seconds):
        conductor.skip(2, "left out in the rest before it")
        simulated_elbow.restart()
        source.middle_rad, source.rest = 0.1, rest
        rest(seconds)

    source.rest = lose_power
    conductor.start()
    until(lambda: conductor.phase == HELD)
    assert lockstep.state() == "UNREFERENCED"
    conductor.pause(False)
    conductor.join(60)
    assert conductor.error is None
    assert list(session.state.states.values()) == [COMPLETED, "skipped", COMPLETED]
    assert math.isnan(source.middle_rad)  # it was taken by another zero


def test_torque_at_rest_starts_nothing(begun, lockstep, monkeypatch):
    known = lockstep.parameters()
    monkeypatch.setattr(lockstep, "parameters", lambda: known | {"limits.tau_max_Nm": 1e-3})
    session, _ = begun(of_tasks(TRACKING), drive=False)
    assert "unload the joint and zero it" in session.run()


def test_silence_is_told(begun, lockstep, monkeypatch):
    from esea_host.study import board

    _, source = begun(of_tasks(TRACKING), drive=False)
    lockstep.listen(["sense_out"])
    source.pull()
    monkeypatch.setattr(board, "SILENT_S", 0.05)
    source.advance = lambda _: None
    with pytest.raises(UserError, match="Nothing came from the board"):
        source.pull()


def test_the_stop_goes_to_the_board_first(tmp_path, simulated_elbow, qtbot, monkeypatch):
    """From the participant's window, by a key, over a real connection."""
    from PySide6.QtCore import Qt

    simulated_elbow.restart()
    study = study_of(tmp_path / "s", of_tasks(TRACKING.replace("1.0", "60.0")))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve_hosts, args=(simulated_elbow, listener, 3.0, False))
        thread.start()
        with esea_host.connect(f"tcp:127.0.0.1:{listener.getsockname()[1]}") as device:
            source = BoardSource(device, study.log_of("P01", 0).parent, drive=False)
            conductor = Conductor(study, study.session("P01", 0, source), float("inf"))
            participant, operator = opening(qtbot)(conductor, device)
            conductor.start()
            qtbot.waitUntil(lambda: conductor.trial_s > 0.1, timeout=120_000)
            qtbot.keyClick(participant, Qt.Key.Key_Escape)
            board = simulated_elbow.board
            qtbot.waitUntil(lambda: board.state_now == "STOPPED", timeout=120_000)
            qtbot.waitUntil(lambda: conductor.over, timeout=120_000)
            assert conductor.error is None
            assert "the operator stopped it" in conductor.reason
            # A board that does not confirm it is told in the largest letters.
            monkeypatch.setattr(device, "state", lambda: "ACTIVE")
            operator.stop_asked_s = 1.0
            operator.refresh()
            assert "NOT CONFIRMED" in operator.bar.state.text()
            assert "SWITCH THE BOARD'S POWER OFF" in operator.bar.words.text()
            monkeypatch.undo()
            operator.close()
            source.close()
        listener.close()
        thread.join(5.0)
    assert not thread.is_alive()


def test_every_shipped_task_says_what_it_cannot_do_without():
    for name in ("wrist.neutral", "wrist.catch", "interaction.pong", "interaction.tracking"):
        task = task_named(name, "")
        assert task.inputs
        assert set(task.switches) <= {"pause", "recentre"}
