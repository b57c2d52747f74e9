"""A simulated session on its way to other programs; logs of other machines on their way here."""

from __future__ import annotations

import csv
import json
import re
import subprocess
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib.image import imread

import esea_host
from esea_gen.errors import UserError
from esea_host.cli import main
from esea_host.cli.live import parameters
from esea_host.recording.export import to_bids, to_csv, to_parquet
from esea_host.recording.foreign import import_table, read_mapping
from esea_host.simulated.demo import run_demo
from tests.benchmarks import link as bench
from tests.conftest import ROOT, require_tool
from tests.typed import typed

pytestmark = pytest.mark.ci

DATA = ROOT / "tests" / "data" / "modexo"
STEP = DATA / "20170816-stepTorqueSoftware-i_005_b_1_k_10_T_50_2.csv"
BOOT = DATA / "20170811-stepTorqueSoftware-i_005_b_20_k_100.csv"


@pytest.fixture(scope="module")
def demo(simulated_elbow, tmp_path_factory):
    simulated_elbow.restart()
    return run_demo(simulated_elbow, 4.0, tmp_path_factory.mktemp("demo") / "page.png")


def test_the_first_minute_leaves_a_recording_its_proof_and_a_page(demo, tmp_path):
    assert demo.verdict.same
    assert demo.verdict.unproven == 0
    assert demo.rms_error_Nm < 0.4  # of 1.7 Nm, against a person who moves
    page = imread(demo.report)
    assert page.shape[0] > 900
    assert np.ptp(page[..., :3]) > 0.9
    with esea_host.open_log(demo.recording) as log:
        assert log.facts["simulated"]
        assert log.events("note")[0]["text"].startswith("simulated")
    with pytest.raises(UserError, match="already exists"):
        run_demo("elbow_drive", 4.0, demo.report)
    with pytest.raises(UserError, match=r"elbow has no motor\. This needs elbow_drive or "):
        run_demo("elbow", 4.0, tmp_path / "a.png")


def test_parameters_are_all_tried_before_one_is_set(simulated_elbow, tmp_path, monkeypatch, capsys):
    simulated_elbow.restart()
    device = esea_host.simulated.LockstepDevice(simulated_elbow)
    monkeypatch.setattr(device.session, "save_parameters", lambda: None)
    monkeypatch.setattr("esea_host.cli.live.open_device", lambda *_: nullcontext(device))
    before = device.parameters()
    for words, said in (
        ("reference.Kd_Nms_rad=99", "=99 is not a number from 0 to 0.35 Nm s/rad"),
        ("encoder_motor.zeroed=0.5", "only a calibration sets it.*esea-host zero"),
        ("reference.Kp_Nm_rad=2", "Kp_Nm_rad is given twice"),
    ):
        with pytest.raises(UserError, match=said):
            parameters("x", assign=["Kp_Nm_rad=1", words])
    (tmp_path / "l.json").write_text('{"parameters": {"smc.lambda_1_s": true}}')
    with pytest.raises(UserError, match="lambda_1_s has no number"):
        parameters("x", load=tmp_path / "l.json")
    assert device.parameters() == before
    parameters("x", assign=["reference.Kd_Nms_rad=.35"], keep=True, save=tmp_path / "p.json")
    assert "(simulated: stored until it ends)" in capsys.readouterr().out
    assert json.loads((tmp_path / "p.json").read_text())["simulated"]


def test_csv_has_units_and_reads_back_to_the_bit(demo, tmp_path):
    path = tmp_path / "a.csv"
    with esea_host.open_log(demo.recording) as log:
        table = log["sense_out"]
        assert to_csv(log, "sense_out", path) == len(table)
    with path.open(newline="") as file:
        header, *lines = list(csv.reader(file))
    assert header[0] == "time_s [s]"
    assert "tau_Nm [Nm]" in header
    assert "limits_status" in header
    # The board's clock started again once, with zeroing: an empty line there.
    assert sum(not any(line) for line in lines) == 1
    column = header.index("tau_Nm [Nm]")
    values = np.array([line[column] for line in lines if any(line)], np.float32)
    assert values.tobytes() == table["tau_Nm"].tobytes()


def test_parquet_keeps_units_meanings_and_facts(demo, tmp_path):
    with esea_host.open_log(demo.recording) as log:
        to_parquet(log, "sense_out", tmp_path / "a.parquet")
        tau_Nm, facts = log["sense_out"]["tau_Nm"], log.facts
    found = pq.read_table(tmp_path / "a.parquet")
    field = found.schema.field("tau_Nm")
    assert field.metadata[b"unit"] == b"Nm"
    assert b"torque" in field.metadata[b"meaning"]
    assert json.loads(found.schema.metadata[b"esea.facts"]) == facts
    assert found["tau_Nm"].to_numpy().tobytes() == tau_Nm.tobytes()


def test_bids_motion_by_its_specification(demo, tmp_path):
    """File names, one header-less table, a row of channels for each column, the required keys."""
    with esea_host.open_log(demo.recording) as log:
        path = to_bids(log, tmp_path, "07", "torque")
        last = list(log["sense_out"].pieces())[-1]
        with pytest.raises(UserError, match="not a BIDS label"):
            to_bids(log, tmp_path, "0_7", "torque")
        with pytest.raises(UserError, match="already exists"):
            to_bids(log, tmp_path, "07", "torque")
        assert "elbowdrivecontrolout" in to_bids(log, tmp_path, "07", "torque", "control_out").name
    assert path == tmp_path / "sub-07/motion/sub-07_task-torque_tracksys-elbowdrive_motion.tsv"
    rows = [line.split("\t") for line in path.read_text().splitlines()]
    channels = (path.parent / f"{path.name.removesuffix('motion.tsv')}channels.tsv").read_text()
    head, *names = [line.split("\t") for line in channels.splitlines()]
    assert head[:5] == ["name", "component", "type", "tracked_point", "units"]
    assert len(rows) == len(last)
    assert {len(r) for r in rows} == {len(names)}
    kinds = {"ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "ORNT", "POS", "VEL"}
    assert {n[2] for n in names} <= kinds
    side = json.loads(path.with_suffix(".json").read_text())
    assert {"SamplingFrequency", "TaskName"} <= set(side)
    assert side["SamplingFrequency"] == 1000
    assert side["MotionChannelCount"] == len(names)
    assert "simulated" in side["TaskDescription"]
    about = json.loads((tmp_path / "dataset_description.json").read_text())
    assert re.fullmatch(r"1\.\d+\.\d+", about["BIDSVersion"])
    assert (tmp_path / "participants.tsv").read_text() == "participant_id\nsub-07\n"


def test_the_official_bids_validator_finds_no_error(demo, tmp_path):
    validator = require_tool("bids-validator-deno")

    def errors() -> set[str]:
        command = [validator, "--json", tmp_path]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
        issues = json.loads(done.stdout)["issues"]["issues"]
        found = {i["code"] for i in issues if i["severity"] == "error"}
        assert bool(done.returncode) == bool(found)
        return found

    with esea_host.open_log(demo.recording) as log:
        path = to_bids(log, tmp_path, "07", "torque")
    assert errors() == set()
    side = json.loads(path.with_suffix(".json").read_text())
    del side["SamplingFrequency"]
    path.with_suffix(".json").write_text(json.dumps(side))
    assert errors()  # it is armed


MAPPING = """
[time]
source = "Time (ms)"
scale = 1e-3
period_s = 0.05

[[columns]]
source = "LoadCell ()"
name = "tau_load_Nm"
unit = "Nm"
scale = 1e-3

[[columns]]
source = "EPOSCurrent ()"
name = "current_raw"
wraps_at = 65536
"""


def mapping(tmp_path, text: str):
    path = tmp_path / "mapping.toml"
    path.write_text(text)
    return read_mapping(path)


def test_a_foreign_log_is_read_with_its_faults(tmp_path):
    """Counts taken from the file with awk: 1107 rows, 567 above 32767, one jump by 99.656 s."""
    report = import_table(STEP, mapping(tmp_path, MAPPING), tmp_path / "a.mcap")
    assert (report.rows, report.wrapped, report.left_out) == (1107, 567, ())
    assert report.backward_s == [99.656]
    table = esea_host.open_log(tmp_path / "a.mcap")["foreign"]
    (gap,) = table.gaps
    assert (gap.after_tick, gap.before_tick, gap.missing) == (1, 2, -1)
    assert table.units == {"tau_load_Nm": "Nm"}
    assert table["tau_load_Nm"][0] == pytest.approx(0.05)
    assert np.ptp(table["current_raw"]) < 65536
    assert table["current_raw"].min() < 0
    with pytest.raises(UserError, match="time jumps there"):
        table.between(0.0, 1.0)
    assert np.all(np.diff(table.time_s) > 0)


def test_boot_messages_and_lines_of_other_lengths_are_counted(tmp_path):
    """157 lines of eight fields, by awk; one of them begins in the middle of another."""
    text = """
header = false
fields = 8
[time]
source = 7
scale = 1e-3
period_s = 0.05
[[columns]]
source = 0
name = "tau_Nm"
scale = 1e-3
broken = [1000.0]
"""
    report = import_table(BOOT, mapping(tmp_path, text), tmp_path / "a.mcap")
    lines = BOOT.read_text(errors="replace").splitlines()
    assert sum(line.count(",") == 7 for line in lines) == 157
    assert report.rows == 156
    assert report.rows + sum(int(x.split()[0]) for x in report.left_out) == len(lines)
    values = esea_host.open_log(tmp_path / "a.mcap")["foreign"]["tau_Nm"]
    broken = sum(line.startswith("1000.00,") and line.count(",") == 7 for line in lines)
    assert report.broken == np.count_nonzero(np.isnan(values)) == broken > 0


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("[time", "not valid TOML"),
        ("[time]\nperiod_s = -1\n[[columns]]\nsource = 1\nname = 'a'", r"time\.period_s"),
        ("[time]\nperiod_s = 1e30\n[[columns]]\nsource = 1\nname = 'a'", r"period_s.*86400"),
        ("[time]\nperiod_s = 1\n[[columns]]\nsource = 1\nname = 'sequence'", "names two columns"),
        ("[time]\nperiod_s = 1\n[[columns]]\nsource = 9\nname = 'a'", "no column 9"),
        ("[time]\nperiod_s = 1\n[[columns]]\nsource = 1\nnam = 'a'", r"columns\[0\].nam"),
        ("[time]\nperiod_s = 1\n[[columns]]\nsource = 'Load'\nname = 'a'", "no column 'Load'.*X1"),
    ],
)
def test_a_wrong_mapping_is_told_where(tmp_path, text, wrong):
    with pytest.raises(UserError, match=wrong):
        import_table(STEP, mapping(tmp_path, text), tmp_path / "a.mcap")


def test_from_the_command_line(demo, tmp_path):
    def said(*words: str, code: int = 0) -> str:
        done = typed(*words, program=main)
        assert done.returncode == code, done
        return " ".join(f"{done.stdout} {done.stderr}".split())

    log = str(demo.recording)
    assert "matches the generated C bit for bit." in said("replay", log, "--verify")
    # Its own exports are read without options, and say that they are simulated.
    told = []
    for kind in ("csv", "parquet"):
        table = str(tmp_path / f"own.{kind}")
        said("export", log, table, "--to", kind)
        told.append(said("smoothness", table).partition("SIMULATED: ")[2])
        assert "SIMULATED" in said("analyse", "loading", table, "--json", str(tmp_path / "l"))
        assert json.loads((tmp_path / "l").read_text())["simulated"]
        angle = "theta_rad [rad]" if kind == "csv" else "theta_rad"
        chosen = f"[time]\nperiod_s = 1e-3\n[[columns]]\nsource = '{angle}'\nname = 'x'"
        import_table(Path(table), mapping(tmp_path, chosen), again := tmp_path / f"{kind}.mcap")
        assert "(simulated own." in said("show", str(again))
    assert told[0] == told[1]
    assert "theta_load_rad [rad] over time_s [s]" in told[0]
    assert "s at 1000 Hz" in told[0]
    first = said("replay", log, "--speed", "0").split("} {")[0] + "}"
    assert json.loads(first).items() > {"sequence": 0, "simulated": True}.items()
    for words in (("view", log), ("monitor", f"file:{log}", "--device", "elbow_drive")):
        assert "esea-host replay" in said(*words, code=2)
    assert "rows" in said("export", log, str(tmp_path / "a.csv"))
    assert "Unknown format 'xls'" in said("export", log, "a.xls", "--to", "xls", code=2)
    assert "not an address" in said("monitor", "elbow", code=2)
    assert "--seconds" in said("demo", "--seconds", "-5", code=2)
    assert "not the name of a picture" in said("demo", "--headless", "--report", "a.txt", code=2)
    (tmp_path / "m.toml").write_text(MAPPING)
    words = "import", str(STEP), str(tmp_path / "b.mcap"), "--mapping", str(tmp_path / "m.toml")
    assert "1107 rows, 1 gaps" in said(*words)


@pytest.mark.slow
def test_the_live_view_holds_its_memory_with_every_channel_drawn(simulated_elbow):
    """A quarter of an hour of rows, 900 pictures of 42 curves and 37 spectra."""
    found = bench.window_soak(simulated_elbow, 0.25, 180.0, 1.0, channels=40)
    assert found["pictures"] >= 899
    assert found["memory_growth_bytes"] < 1e6


def test_an_export_that_fails_leaves_nothing(demo, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("csv.writer", full)
    with esea_host.open_log(demo.recording) as log, pytest.raises(UserError, match="No space left"):
        to_csv(log, "sense_out", tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []
