"""Knee assessment on a board: through the link, with faults, tests, the window."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_host.assess.board import KneeBoard, await_fall, be_ready
from esea_host.assess.desk import ClinicDesk, assess_unattended, attempted
from esea_host.assess.passive_tests import pendulum_test
from esea_host.assess.patients import DEG, Knees
from esea_host.assess.probing import Comfort, ProbingMovement, probing_movement
from esea_host.assess.responses import Location
from esea_host.assess.session import Assessment
from esea_host.assess.simulated import MovedKnee, patient_named
from esea_host.cli.app import app
from esea_host.recording.log import open_log
from esea_host.simulated import LockstepDevice, SimulatedBoard
from tests.assess.test_assess import made_up

COMFORT = Comfort(0, 120 * DEG)


class SlippingKnee(MovedKnee):
    """Its load encoder jumps by a radian when it is told to."""

    slips_rad = 0.0

    def step(self):
        motor, load = super().step()[""]
        return {"": (motor, load + self.slips_rad)}


@pytest.fixture
def opened(tmp_path, request):
    """A desk at a board that is not zeroed yet, and the simulated knee on it."""
    device = load_device("knee_board")
    patient = patient_named(getattr(request, "param", "S3"), (1.7, 70))
    knee = SlippingKnee(patient, device, 3)
    file = tmp_path / "session.json"
    with LockstepDevice(SimulatedBoard(device, seed=3, motion=knee.step)) as connected:
        given = {"advance": connected.advance, "therapist": knee}
        board = KneeBoard(connected, COMFORT, file, **given)
        desk = ClinicDesk(Assessment(made_up()), COMFORT, patient=patient, file=file, board=board)
        yield desk, knee
        board.close()


@pytest.mark.ci
def test_movements_go_into_the_session_and_its_recording(opened):
    desk, _ = opened
    said: list[str] = []
    be_ready(desk.board, said.append)
    assert any("zeroed" in line for line in said)
    assess_unattended(desk, 2, said.append)
    desk.board.close()
    saved = json.loads(desk.file.read_text())
    assert saved["simulated"]
    measured = [e["details"] for e in saved["trail"] if e["what"] == "measured"]
    assert len(measured) == 2
    with open_log(desk.file.with_name(saved["recording"])) as log:
        noted = list(log.events("movement"))
        stream = log["sense_out"]
        board_s, angle = stream.board_ns * 1e-9, stream["theta_load_rad"]
    for details in measured:
        assert details["recording"] == saved["recording"]
        (event,) = [e for e in noted if e["begin_s"] == details["begin_s"]]
        assert event["passed"]
        inside = (board_s >= details["begin_s"]) & (board_s <= details["end_s"])
        assert np.ptp(angle[inside]) > 10 * DEG


@pytest.mark.parametrize("how", ["slips", "unplugged"])
def test_what_breaks_a_movement_is_said_and_nothing_is_half_written(opened, how, monkeypatch):
    desk, knee = opened
    board, said = desk.board, []
    be_ready(board, said.append)

    def away(*_):
        raise LinkError("the cable is off")

    def broken(*_):
        if board.watch.moving and len(board.rows) > 2000:
            if how == "slips":
                knee.slips_rad = 1.0
            else:
                monkeypatch.setattr(board.device.drive, "read", away)
        return poll(*_)

    poll = board.poll
    monkeypatch.setattr(board, "poll", broken)
    before = desk.session.by_name()
    text = attempted(desk, board, said.append)
    assert "cut off" in text
    assert desk.session.by_name() == before
    assert desk.session.trail[-1].what == "skipped"
    assert ("cable" in text) == (how == "unplugged")
    with pytest.raises(UserError):
        attempted(desk, board, said.append)
    board.close()
    saved = json.loads(desk.file.read_text())
    with open_log(desk.file.with_name(saved["recording"])) as log:
        assert log.integrity.complete
        assert len(log["sense_out"].time_s) > 2000


def test_a_board_that_is_not_zeroed_measures_nothing(opened):
    desk, _ = opened
    for _ in range(60):
        assert not desk.board.poll(0.02)
    assert "not zeroed" in desk.board.trouble()
    assert not desk.board.rows
    with pytest.raises(UserError, match="not zeroed"):
        attempted(desk, desk.board, print)


@pytest.mark.ci
def test_keep_repeat_and_the_warning_in_the_window(opened, qtbot, monkeypatch):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QApplication

    from esea_host.windows.assess import AssessWindow

    desk, knee = opened
    beeps: list[int] = []
    monkeypatch.setattr(QApplication, "beep", lambda: beeps.append(1))
    window = AssessWindow(desk)
    window.timer.stop()
    qtbot.addWidget(window)
    panel = window.panel

    def until(done):
        for _ in range(400):
            desk.board.device.advance(0.04)
            window.animate()
            if done():
                return
        raise AssertionError("it did not happen")

    until(lambda: "not zeroed" in panel.verdict.text())
    window.bar.steps["Zero"].click()
    assert not window.bar.steps["Keep"].isEnabled()
    window.move_leg()
    until(lambda: desk.attempt is not None)
    window.animate()
    assert window.bar.steps["Keep"].isEnabled()
    qtbot.mouseClick(window.bar.steps["Repeat"], Qt.MouseButton.LeftButton)
    assert desk.attempt is None
    window.move_leg()
    until(lambda: desk.attempt is not None)
    window.animate()
    assert not beeps
    qtbot.mouseClick(window.bar.steps["Keep"], Qt.MouseButton.LeftButton)
    assert [e.what for e in desk.session.trail][-1] == "measured"
    window.limit(0, 120, 60)
    knee.follow(probing_movement(Location(60 * DEG, 100 * DEG), Comfort()))
    until(lambda: beeps)
    assert "Too fast" in panel.warning.text()
    assert "SIMULATED" in window.windowTitle()


@pytest.mark.ci
def test_pendulum_and_range_at_a_board(tmp_path):
    found = {}
    for name, more in (("pendulum", []), ("range", ["--seconds", "30"])):
        file = tmp_path / f"{name}.json"
        words = ["--device", "sim:knee", "--patient", "simulated:relaxed", "--json", str(file)]
        run = CliRunner().invoke(app, ["assess", name, *words, *more], catch_exceptions=False)
        assert run.exit_code == 0, run.output
        assert "SIMULATED" in run.output
        found[name] = json.loads(file.read_text())
        # Its recording begins before the board was zeroed: sensing_ok = 0, and a clock of its own.
        words = [str(file.with_name(f"{name}-1.mcap")), "--json", str(file)]
        run = CliRunner().invoke(app, ["assess", name, *words], catch_exceptions=False)
        read = json.loads(file.read_text())
        assert read["simulated"] is found[name]["simulated"] is True
        for key in {"relaxation_index", "high_rad"} & set(read):
            assert read[key] == pytest.approx(found[name][key], rel=0.03)
    # The same leg without cuff, coupling and encoders.
    leg = Knees([patient_named("relaxed", (1.7, 70))]).release(0.0, 12.0, [[1]])
    bare = pendulum_test(leg.time_s, leg.angle_rad[:, 0])
    assert found["pendulum"]["relaxation_index"] == pytest.approx(bare.relaxation_index, abs=0.1)
    assert found["pendulum"]["rest_rad"] == pytest.approx(bare.rest_rad, abs=5 * DEG)
    assert found["range"]["low_rad"] < 12 * DEG
    assert found["range"]["high_rad"] > 118 * DEG


@pytest.mark.parametrize(("opened", "fastest"), [("S3", 60), ("relaxed", 180)], indirect=["opened"])
def test_a_leg_in_hands_does_not_fall(opened, fastest):
    desk, knee = opened
    be_ready(desk.board, print)
    knee.follow(ProbingMovement(Location(25 * DEG, fastest * DEG), 5 * DEG, 45 * DEG, 75 / fastest))
    with pytest.raises(UserError, match="no leg fell"):
        await_fall(desk.board, print, 6.0)
    knee.let_fall()
    assert np.ptp(await_fall(desk.board, print, 20.0).angle_rad) > 40 * DEG
    knee.slips_rad = 1.0  # of a leg at rest, which has no movement to break
    with pytest.raises(UserError, match="valid"):
        await_fall(desk.board, print, 20.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["pendulum"], "--device"),
        (["range", "x.csv", "--device", "sim:knee"], "--device"),
        (["run", "--headless"], "--device"),
        (["run", "--json", __file__], "already exists"),
        (["range", "x.csv", "--figure", "x.txt"], "not the name of a picture file"),
        (["range", "x.csv", "--from-deg", "-1"], "reach: -1 to 130 deg"),
        (["run", "--device", "tcp:127.0.0.1:1", "--patient", "simulated:S3"], "sim:knee"),
        (["pendulum", "--device", "sim:elbow_drive"], "has a motor"),
        (["run", "--device", "sim:elbow"], "measures up to 20 Nm"),
    ],
)
def test_what_does_not_go_together_is_refused(words, said):
    run = CliRunner().invoke(app, ["assess", *words])
    assert run.exit_code != 0
    assert isinstance(run.exception, UserError)
    assert said in str(run.exception)
