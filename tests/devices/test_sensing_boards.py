"""Boards of passive joints and of two drives, simulated: moved, zeroed, recorded, commissioned."""

from __future__ import annotations

import math
import re
import subprocess
import sys

import numpy as np
import pytest

from esea_gen.device import board_device
from esea_gen.devices.file import read_file
from esea_gen.errors import UserError
from esea_gen.model.sensing import of_axis
from esea_gen.studies.torque_check.procedure import KnownLoad
from esea_gen.twin.hand import HANDS
from esea_host.commissioning import StepOptions, run_step, simulated_bench, steps_of
from esea_host.connection import open_device
from esea_host.recording import open_log
from esea_host.recording.replay import verify
from esea_host.simulated import LockstepDevice, SimulatedBoard

BOARDS = {"elbow": "elbow_board", "knee": "knee_board", "wrist": "wrist_board"}


@pytest.fixture(scope="module", params=[*BOARDS, "wrist_drive"])
def board(request):
    made = SimulatedBoard(request.param)
    yield made
    made.close()


def zeroed(board: SimulatedBoard) -> LockstepDevice:
    board.restart()
    device = LockstepDevice(board)
    device.advance(1.1)
    assert device.state() == "UNREFERENCED"
    device.zero()
    device.advance(0.5)
    assert device.state() == "READY"
    return device


@pytest.mark.ci
def test_a_board_is_zeroed_moves_and_replays_bit_for_bit(board, tmp_path):
    device = zeroed(board)
    with device.record(tmp_path / "r.mcap"):
        device.advance(6.0)
    with open_log(tmp_path / "r.mcap") as log:
        assert verify(log).proven
        for axis in board.axes:
            rows = log[f"{of_axis('sense', axis)}_out"]
            assert rows[of_axis("sensing_ok", axis)].all() if board.passive else len(rows)
            bent, torque = (rows[of_axis(n, axis)] for n in ("theta_rad", "tau_Nm"))
            moves = np.ptp(bent) > 0.02
            assert moves == board.passive  # a person at a drive rests until it is armed
            # The coupling pulls the way it is bent.
            far = np.abs(bent) > 0.1
            assert (np.sign(torque[far]) == np.sign(bent[far])).all()


@pytest.mark.parametrize(("name", "stands_for"), BOARDS.items())
def test_a_passive_device_stands_for_its_board(name, stands_for, tmp_path):
    assert board_device(name).name == stands_for
    assert board_device(stands_for).name == stands_for
    text, _ = read_file(name)
    own = tmp_path / f"{name}.toml"
    own.write_text(text.replace("k1_Nm_rad = { value = ", "k1_Nm_rad = { value = 1"))
    with pytest.raises(UserError, match=r"\[encoder\.motor\]"):
        board_device(own)
    own.write_text(text)
    assert board_device(own).name == stands_for
    assert board_device("elbow_drive").name == "elbow_drive"


BAD_TABLES = {
    "nan": "time_s,theta_motor_rad,theta_load_rad\n0,0,0\n0.01,nan,0\n",
    "before": "time_s,theta_motor_rad,theta_load_rad\n0,0,0\n0.5,0,0\n",
    "has the columns": "time_s,theta,theta_load_rad\n0,0,0\n0.01,0,0\n",
    "limit is": "time_s,theta_motor_rad,theta_load_rad\n0,0,0\n0.01,40,0\n",
    "1 rows": "time_s,theta_motor_rad,theta_load_rad\n0,0,0\n",
    "0 s after": "time_s,theta_motor_rad,theta_load_rad\n0,0,0\n0,0,0\n",
}


@pytest.mark.parametrize("said", BAD_TABLES)
def test_a_table_that_is_no_motion_is_refused(said, tmp_path):
    table = tmp_path / "bad.csv"
    table.write_text(BAD_TABLES[said])
    with pytest.raises(UserError, match=said):
        SimulatedBoard("knee", motion=str(table))


WRONG = (
    ("knee", {"motion": "dancer"}),
    ("knee", {"motion": "missing.csv"}),
    ("knee", {"person": "ideal"}),
    ("wrist_drive", {"motion": "person"}),
    ("wrist_drive", {"person": "bread"}),
)


@pytest.mark.parametrize(("name", "wrong"), WRONG)
def test_what_does_not_fit_a_device_is_refused_before_c_is_compiled(name, wrong):
    with pytest.raises(UserError):
        SimulatedBoard(name, **wrong)


@pytest.mark.ci
def test_a_recorded_motion_is_what_the_board_measures(tmp_path):
    t = np.arange(0, 3, 0.01)
    motor = 0.8 * (1 - np.cos(2 * t))
    table = tmp_path / "motion.csv"
    head = "time_s,theta_motor_rad,theta_load_rad"
    rows = np.column_stack([t, motor, motor - 0.2 * np.sin(3 * t)])
    np.savetxt(table, rows, delimiter=",", comments="", header=head)
    board = SimulatedBoard("knee", motion=str(table), seed=3)
    zeroed(board)
    count_rad = 2 * math.pi / 2**board.device.file.encoder.resolution_bits.value
    for _ in range(2500):
        board.tick()
        for side, angle in zip(("motor", "load"), board.plant.truth().values(), strict=True):
            told = board.board.values[board.board.places[f"theta_{side}_rad"]]
            assert abs(told - angle) < 4 * count_rad  # a tick late, zeroed within a count
    board.close()


@pytest.mark.ci
def test_each_axis_of_a_hand_has_its_own_intent():
    board = SimulatedBoard("wrist_drive", plant="ideal", person="stiff")
    zeroed(board)
    paths = [{"theta_p_rad": 0.3}, {"theta_p_rad": -0.1}]
    board.set_up(person=HANDS["stiff"], hand=lambda: paths)
    for _ in range(1500):
        board.tick()
    truth = board.plant.truth()
    assert truth["theta_l_flexion_rad"] > 0.1
    assert truth["theta_l_deviation_rad"] < 0
    board.close()


@pytest.mark.ci
@pytest.mark.parametrize(("name", "kg", "axis"), [("knee", 10.0, ""), ("wrist", 1.0, "deviation")])
def test_a_sensor_is_commissioned(name, kg, axis):
    board = SimulatedBoard(name)
    bench = simulated_bench(board, axis=axis)
    options = StepOptions(KnownLoad(kg, 0.2), 2.0, 1.0, 2)
    steps = steps_of(board.device)
    assert [s.name for s in steps if s.motor] == []
    assert all(run_step(bench, step, options).passed for step in steps)
    board.close()


@pytest.mark.ci
@pytest.mark.parametrize("way", ["--tcp=0", "--pty"])
def test_a_served_board_is_listened_to(way, tmp_path):
    command = [sys.executable, "-m", "esea_host.simulated", "wrist", way, "--zeroed=1"]
    target = tmp_path / "r.mcap"
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served:
        try:
            said = served.stdout.readline()
            assert "wrist_board" in said
            address = re.search(r"(tcp|pty):\S+", said)[0]
            with open_device(address, "wrist") as device, device.record(target):
                angles = device.samples("theta_load_flexion_rad")
                assert all(abs(next(angles)["theta_load_flexion_rad"]) < 1 for _ in range(2500))
        finally:
            served.terminate()
    with open_log(target) as log:
        assert verify(log).proven
