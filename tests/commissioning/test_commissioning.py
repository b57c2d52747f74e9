"""Commissioning: every step passes on a good machine, and each fault is named by its own step."""

from __future__ import annotations

import json
import math
import os
import re
import time
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.link.kept import name_encoders
from esea_gen.link.transport import LinkError
from esea_gen.studies.torque_check.procedure import KnownLoad
from esea_gen.twin.run import plant_variant
from esea_gen.twin.stepped import SteppedTwin
from esea_host.commissioning import (
    STEPS,
    BoardUnit,
    CommissioningEndedError,
    CommissioningRecord,
    SimulatedHands,
    StepOptions,
    run_step,
    simulated_bench,
    unit_of,
)
from tests.typed import host_command

UNIT = BoardUnit("", 1)
BY_NAME = {s.name: s for s in STEPS}
# Within 1 s the rubber is not at rest: two counts of the load side change while it is judged.
OPTIONS = StepOptions(KnownLoad(1.0, 0.2), 2.0, 1.0, 2)


SWAPPED = {"count_motor": "count_load", "count_load": "count_motor"}


class WrongDrive(SteppedTwin):
    """Another torque than commanded; encoders that count the other way, are swapped or stand."""

    def __init__(self, variant, motor_gain=1.0, reversed_encoders=(), read_as=()):
        super().__init__(variant)
        self.gain = motor_gain
        full = {p.name: round(p.high) + 1 for p in self.system.blocks["encoders"].outputs}
        self.turned = {n: full[n] for n in (f"count_{side}" for side in reversed_encoders)}
        self.read_as = dict(read_as)

    def step(self, u_Nm):
        return super().step([self.gain * u for u in u_Nm])

    def _read(self):
        turned, told = self.turned, super()._read()
        told |= {n: told.get(other, 1000) for n, other in self.read_as.items()}
        return {n: -x % turned[n] if n in turned else x for n, x in told.items()}


@pytest.fixture
def bench_of(simulated_elbow):
    """A bench with a machine of the ideal plant, and what is wrong with it."""

    def made(zeroed: bool = True, **wrong):
        drive = simulated_elbow
        first, variant = drive.first_plant, plant_variant(drive.device, "ideal", "ideal", 0)
        drive.first_plant = WrongDrive(variant, **wrong)
        drive.restart()
        drive.first_plant = first
        bench = simulated_bench(drive)
        if zeroed:
            assert run_step(bench, BY_NAME["zero"], OPTIONS).passed
        return bench

    yield made
    simulated_elbow.restart()


def quick(step: str, bench, options: StepOptions = OPTIONS):
    return run_step(bench, BY_NAME[step], options)


def test_a_good_machine_passes_and_its_numbers_are_the_plants(bench_of, tmp_path, monkeypatch):
    monkeypatch.setattr("esea_host.commissioning.steps.TURN_RAD_S", 1.0)
    monkeypatch.setattr("esea_host.commissioning.steps.FRICTION_RAD_S", (0.6, 1.4))
    bench = bench_of(zeroed=False)
    record = CommissioningRecord(tmp_path / "unit-7", bench.board.name, unit_of(bench.device))
    for step in STEPS[:-1]:  # the last one takes longer: test_swinging.py
        result = run_step(bench, step, OPTIONS)
        assert result.passed, result.lines()
        record.add(result, bench.device)
        if step.name == "friction":
            a = bench.board.file.actuator
            # The ideal plant is the device file's drive, its cable rigid and without loss.
            assert result.found["fc_low_Nm"] < a.fc_Nm.value < result.found["fc_high_Nm"]
            assert result.found["fc_value_Nm"] == pytest.approx(a.fc_Nm.value, rel=0.03)
            assert result.found["fv_value_Nms_rad"] == pytest.approx(a.fv_Nms_rad.value, rel=0.03)
        if step.name == "torque":
            means = {m["label"]: m["mean_Nm"] for m in result.found["torque_check"]["measurements"]}
            # One count that changes half way is more than the limit: recorded again, and said.
            assert result.found["recorded_again"]
            assert means["plus_1"] == pytest.approx(1.0 * 9.81 * 0.2, abs=0.05)
    assert bench.device.state() == "READY"
    again = CommissioningRecord(tmp_path / "unit-7", bench.board.name, unit_of(bench.device))
    assert [e["step"] for e in again.entries] == [s.name for s in STEPS[:-1]]
    entry = again.last("sign", bench.board.digest)
    assert entry["simulated"]
    assert entry["content_hash"] == bench.device.identity.content_hash
    assert (again.folder / entry["picture"]).read_bytes().startswith(b"\x89PNG")
    assert again.last("sign", "another device file") is None
    titles = tuple((s.name, s.title) for s in STEPS[:-1])
    told = again.summary(titles, bench.board.digest)
    assert all(re.search(r"passed \(simulated\), \d{4}-.* UTC$", x) for x in told)
    assert all("not done" in x for x in again.summary(titles, "another"))


def test_results_count_for_their_own_board_only(bench_of, tmp_path):
    bench = bench_of(zeroed=False)
    device, digest = bench.device, bench.board.digest
    record, other = (CommissioningRecord(tmp_path, bench.board.name, unit_of(device)) for _ in "12")
    record.add(result := quick("zero", bench), device)
    assert other.add(result, device)["number"] == 2  # another program in the same folder
    named = BoardUnit("encoders 5, 6", 1)
    record.entries.append(record.entries[0] | {"step": "sign", "board_serial": named.serial})
    record.entries.append({k: v for k, v in record.entries[0].items() if k[:6] != "board_"})
    for unit, counts in (
        (record.unit, {"zero"}),
        (BoardUnit("", record.unit.start + 1), set()),
        (named, {"sign"}),
        (BoardUnit(named.serial, 2), {"sign"}),
        (BoardUnit("encoders 5, 7", 1), set()),
    ):
        record.unit = unit
        assert {s for s in ("zero", "sign") if record.last(s, digest)} == counts
        assert f"keeps {3 - len(counts)} results of another board" in record.notice()
    moment = datetime.fromisoformat(record.entries[0]["utc"])
    assert 0 <= time.time() - moment.timestamp() < 600
    name_encoders(device.session, [5, 6])
    assert unit_of(device).serial == "encoders 5, 6"
    device.drive.board.restart(blank=True)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("wrong", "step", "words"),
    [
        ({"motor_gain": -1.0}, "sign", "swap two of its phases"),
        ({"reversed_encoders": {"gear"}}, "encoders", "motor's own encoder counts the other way"),
        ({"reversed_encoders": {"motor"}}, "encoders", "motor-side encoder counts the other way"),
        ({"reversed_encoders": {"load"}}, "encoders", "load-side encoder counts the other way"),
        ({"reversed_encoders": {"motor", "load"}}, "encoders", "Both joint encoders count the"),
        ({"reversed_encoders": {"motor", "load", "gear"}}, "encoders", "All count down"),
        ({"read_as": SWAPPED}, "sign", "two encoders are swapped"),
        ({"read_as": {"count_load": ""}}, "encoders", "Check its magnet and cable"),
        ({"motor_gain": 0.0}, "sign", "the drive is enabled"),
    ],
)
def test_what_is_turned_round_is_named_with_what_to_swap(bench_of, wrong, step, words, monkeypatch):
    monkeypatch.setattr("esea_host.commissioning.steps.TURN_RAD_S", 2.0)
    result = quick(step, bench_of(**wrong))
    assert not result.passed
    assert words in result.problem[1], result.problem


def test_an_encoder_off_twice_a_turn_is_found_and_its_correction_takes_it_away(bench_of):
    bench = bench_of()
    amplitude_rad = math.radians(0.8)
    full = 1 << round(bench.board.file.encoder.resolution_bits.value)
    board = bench.device.drive.board
    show = board.show

    def off(counts: tuple[int, int, int]) -> None:
        motor, load, gear = counts
        error = amplitude_rad * math.sin(2 * 2 * math.pi * motor / full)
        show((round(motor + error * full / (2 * math.pi)) % full, load, gear))

    board.show = off
    try:
        result = quick("encoders", bench)
    finally:
        del board.show
    assert result.problem is None
    assert not result.passed
    assert "motor side: largest error" in next(c.what for c in result.checks if not c.passed)
    table = np.array(result.found["motor_correction_rad"])
    # Of the error only what no straight line takes is left: compared so, where the joint was.
    nodes = np.arange(len(table)) * 2 * math.pi / len(table)
    was = nodes < 1.8
    truth = -amplitude_rad * np.sin(2 * nodes[was])
    left = truth - table[was]
    straight = np.polyval(np.polyfit(nodes[was], left, 1), nodes[was])
    assert np.max(np.abs(left - straight)) < 0.1 * amplitude_rad
    assert np.ptp(table[was]) > 0.3 * amplitude_rad


@pytest.mark.slow
def test_a_torque_sensor_that_is_off_fails_by_its_accuracy(bench_of):
    bench = bench_of()
    bench.change_hands(SimulatedHands(bench.device.drive, torque_error=0.15))
    result = quick("torque", bench)
    assert not result.passed
    assert "accuracy" in {c.what for c in result.checks if not c.passed}


def test_order_cancel_and_gaps(bench_of, monkeypatch):
    bench = bench_of(zeroed=False)
    with pytest.raises(UserError, match="Do the step 'zero' first"):
        quick("sign", bench)
    with pytest.raises(UserError, match="--mass"):
        quick("torque", bench, StepOptions())
    assert quick("zero", bench).passed
    # Ended in the middle of a push: the motor is stopped, and nothing is judged.
    hands, seen = SimulatedHands(bench.device.drive), []
    advance = bench.pass_time

    def later(seconds: float) -> None:
        advance(seconds)
        if bench.device.state() == "ACTIVE":
            seen.append(1)
            if len(seen) == 40:
                bench.cancel()

    bench.change_hands(hands)
    monkeypatch.setattr(bench, "pass_time", later)
    with pytest.raises(CommissioningEndedError):
        quick("sign", bench)
    bench.device.advance(0.6)  # the torque fades, and the heartbeat tells of it
    assert bench.device.state() == "STOPPED"
    assert not bench.device.drive.board.motor[0]
    bench.device.release()
    bench.device.advance(0.3)
    monkeypatch.setattr(bench, "pass_time", advance)
    # A hole in what was recorded is no verdict.
    feed, count = bench.device.receiver.decoder.feed, iter(range(10**6))
    monkeypatch.setattr(
        bench.device.receiver.decoder, "feed", lambda d: feed(d if next(count) != 30 else b"")
    )
    if bench.device.state() != "READY":
        bench.device.zero()
        bench.device.advance(0.5)
    with pytest.raises(UserError, match="Rows are missing"):
        quick("encoders", bench)
    # Nor is what came before the board fell silent for good.
    ticks = iter(range(10**6))
    monkeypatch.setattr(bench, "pass_time", lambda s: advance(s) if next(ticks) < 300 else None)
    with pytest.raises(LinkError, match="nothing has come for 2 s"):
        bench.capture(12.0)


def test_a_record_of_another_machine_or_damaged_is_refused(bench_of, tmp_path):
    content = {"kind": "esea-host commissioning", "version": 1, "device": "knee", "entries": []}
    entry = {"step": "zero", "host_ns": 10**30, "passed": 1, "simulated": 1, "device_digest": ""}
    for damaged in ("{", *(json.dumps(content | {"entries": [e]}) for e in (entry, {}, "x"))):
        (tmp_path / "record.json").write_text(damaged)
        with pytest.raises(UserError, match="cannot be read as a record"):
            CommissioningRecord(tmp_path, "elbow_drive", UNIT)
    (tmp_path / "record.json").write_text(json.dumps(content))
    with pytest.raises(UserError, match="record of a knee"):
        CommissioningRecord(tmp_path, "elbow_drive", UNIT)
    (tmp_path / "record.json").write_text(json.dumps(content | {"version": 2}))
    with pytest.raises(UserError, match="not a record of this version"):
        CommissioningRecord(tmp_path, "knee", UNIT)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--step", "nothing"], "There is no step 'nothing'"),
        (["--step", "torque"], "needs a known mass"),
        (["--mass", "1"], "belong together"),
        (["--second-mass", "1"], "belong together"),
        (["--step", "adaptation", "--mass", "1", "--arm", "0.3"], "Give --second-mass KG"),
    ],
)
def test_wrong_words_end_before_anything_is_connected(words, said):
    code, _, told = host_command("commission", "tcp:127.0.0.1:1", *words)
    assert code == 2
    assert said in told


def test_in_the_terminal(simulated_elbow, tmp_path, monkeypatch):
    simulated_elbow.restart()
    monkeypatch.setattr("esea_host.cli.commission.SimulatedBoard", lambda *a, **k: simulated_elbow)
    monkeypatch.setattr(simulated_elbow, "close", lambda: None)
    words = ["commission", "sim:elbow_drive", "--terminal", "--record", str(tmp_path / "r")]
    code, said, _ = host_command(*words, "--step", "zero", "--step", "sign")
    assert not code, said
    assert "Zero (simulated): PASSED" in said
    assert "Motor sign (simulated): PASSED" in said
    assert "not done" in said
    assert (tmp_path / "r" / "002-sign.png").is_file()
    said = host_command(*words, "--step", "zero")[1]
    assert "keeps 2 results of another board or an earlier start" in said
    simulated_elbow.board.lib.sim_unique(0)


@pytest.mark.ci
def test_the_guided_screens(bench_of, qtbot, tmp_path):
    from PySide6.QtCore import Qt

    from esea_host.windows.commission import CommissioningWindow

    bench = bench_of(zeroed=False, motor_gain=-1.0)
    record = CommissioningRecord(tmp_path / "r", bench.board.name, UNIT)
    window = CommissioningWindow(bench, STEPS, StepOptions(), record)
    qtbot.addWidget(window)
    window.resize(1180, 860)
    window.show()
    qtbot.keyClick(window, Qt.Key.Key_S)
    qtbot.waitUntil(lambda: not window.busy and "zero" in window.done, timeout=120_000)
    assert "✓ 1. Zero" in window.list.item(0).text()
    assert not window.picture.pixmap().isNull()
    window.list.setCurrentRow(2)
    assert "The motor moves" in window.head.text()
    window.start_button.click()
    qtbot.waitUntil(lambda: not window.busy and "sign" in window.done, timeout=120_000)
    assert "swap two of its phases" in window.text.text()
    assert "FAILED" in window.list.item(2).text()
    folder = os.environ.get("ESEA_PICTURES")
    qtbot.wait(300)  # texts ask for room
    window.grab().save(str(Path(folder or tmp_path) / "host-commission.png"))
    # Without a known mass the last one cannot be begun, and says why.
    window.list.setCurrentRow(4)
    assert not window.start_button.isEnabled()
    assert "--mass" in window.text.text()
    # Space ends what runs, wherever the focus is.
    window.list.setCurrentRow(1)
    window.start()
    qtbot.keyClick(window, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: not window.busy, timeout=120_000)
    assert "encoders" not in window.done
    assert len(record.entries) == 2


def test_a_person_is_waited_for(bench_of, qtbot, tmp_path):
    from esea_host.windows.commission import CommissioningWindow

    bench = bench_of(zeroed=False)
    bench.hands_free = False  # as on a board: Return says that it is done
    record = CommissioningRecord(tmp_path, "x", UNIT)
    window = CommissioningWindow(bench, STEPS, StepOptions(), record)
    qtbot.addWidget(window)
    window.start()
    qtbot.waitUntil(window.ready_button.isEnabled, timeout=120_000)
    assert "nobody in it" in window.text.text()
    assert not window.done
    window.go_on()
    qtbot.waitUntil(lambda: not window.busy, timeout=120_000)
    # Nobody did what was asked: the simulated person still pulls, and the zero is not taken so.
    assert not window.done["zero"].passed
    assert "FAILED" in window.text.text()
