"""Tuning on the virtual exoskeleton, and rejected input."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from esea_gen.errors import UserError
from esea_gen.studies.tracking import TuningCase
from esea_gen.studies.tuning_sweep import Trial, extremes, tune
from tests.own_device import own_device, own_text
from tests.typed import command


def trial(value: float, **figures) -> Trial:
    usual = {
        "rms_Nm": 0.1,
        "overshoot_percent": 0.0,
        "reach_percent": 98.0,
        "command_above_20Hz_Nm": 0.01,
        "noise_above_5Hz_Nm": 0.02,
        "rate_limited_share": 0.0,
        "surface_rad_s": 1.0,
        "outside_share": 0.0,
        "limited_share": 0.0,
    }
    return Trial(value, **(usual | figures))


# -- figures --------------------------------------------------------------------------------------


@given(gain=st.floats(0.2, 3.0), lag_deg=st.floats(-40.0, 120.0), offset=st.floats(-0.2, 0.2))
def test_overshoot_is_what_a_sinusoid_of_known_gain_has(gain, lag_deg, offset):
    (case,) = TuningCase().cases()
    t = np.arange(len(case.trajectory.tau_desired_Nm)) / 1000
    true = 1.7 * (gain * np.sin(2 * math.pi * 0.6 * t - math.radians(lag_deg)) + offset)
    over, reach = extremes(case, SimpleNamespace(plant={"tau_e_Nm": true}))
    # An offset lifts one extreme and lowers the other: the worst counts, the mean stays.
    assert over == pytest.approx(max(0.0, 100 * (gain + abs(offset) - 1)), abs=0.02 * gain)
    assert reach == pytest.approx(100 * gain, abs=100 * abs(offset) / 20 + 0.02 * gain)


FAILING = 2.0


def half_run(value, **_) -> dict[str, float]:
    """As run_trial, at once; one value raises, and one has a figure that is not finite."""
    if value == FAILING:
        raise UserError("The compiler is gone.", "Install it.")
    figures = asdict(trial(value, rms_Nm=math.inf if value > FAILING else 0.1 / value))
    del figures["unusable"]
    return figures | {"unstable": 0.0, "tripped": 0.0, "fault": 0.0}


def test_a_trial_that_fails_is_an_unusable_one(monkeypatch, tmp_path):
    monkeypatch.setattr("esea_gen.studies.tuning_sweep.run_trial", half_run)
    path, picture = tmp_path / "a.json", tmp_path / "a.png"
    lambdas = ["tune", "--parameter", "lambda_1_s", "--json", path, "--figure", picture, "--values"]
    code, shown, error = command(*lambdas, "1,1.5,2,3")
    assert (code, error) == (0, "")
    rows = [line.split() for line in shown.splitlines()]
    (failed,) = [r for r in rows if r[:1] == ["2"]]
    assert failed[1:10] == ["-"] * 9
    assert " ".join(failed[10:]) == "FAILED: The compiler is gone. Install it."
    (infinite,) = [r for r in rows if r[:1] == ["3"]]
    assert " ".join(infinite[10:]) == "FAILED: rms_Nm is inf"
    (sweep,) = json.loads(path.read_text())["sweeps"]
    assert sweep["chosen"] == 1.5
    assert [t["unusable"] for t in sweep["trials"]][:2] == ["", ""]
    assert sweep["trials"][2]["unusable"].startswith("failed: The compiler")
    assert sweep["trials"][2]["rms_Nm"] is None
    assert picture.stat().st_size > 10_000
    # None ran: the table says why, and the command fails.
    code, shown, error = command(*lambdas, "3,4")
    assert (code, error) == (1, "")
    assert "chosen: none; no value is usable, failed: rms_Nm is inf" in shown


def test_a_parameter_without_effect_is_not_chosen(monkeypatch):
    same = half_run(1.0)
    monkeypatch.setattr("esea_gen.studies.tuning_sweep.run_trial", lambda **_: same)
    (sweep,) = tune("smc", parameter="lead", values=(1.0, 2.0)).sweeps
    assert (sweep.chosen, sweep.reason) == (None, "it makes no difference in this case")


# -- against the twin -----------------------------------------------------------------------------


@pytest.mark.ci
def test_the_printed_controller_needs_the_printed_layer_on_the_nominal_plant():
    """The thesis: phi was selected so that the surface did not saturate, at 1.5."""
    (sweep,) = tune("smc-published", "ideal", parameter="phi_rad_s", values=(2.0, 1.0, 1.5)).sweeps
    assert [t.value for t in sweep.trials] == [1.0, 1.5, 2.0]
    assert sweep.chosen is not None
    assert sweep.chosen.value == 1.5
    # The surface is nearly the same whatever the layer; so the narrow one is left.
    assert sweep.trials[0].surface_rad_s > 1.0
    assert sweep.trials[0].outside_share > 0.1


def test_a_steeper_surface_has_less_error_until_it_overshoots(tmp_path):
    code, shown, error = command(
        "tune",
        "--parameter",
        "smc.lambda_1_s",
        "--values",
        "25,5,15",
        "--json",
        tmp_path / "t.json",
        "--figure",
        tmp_path / "t.png",
    )
    assert code == 0, error
    content = json.loads((tmp_path / "t.json").read_text())
    (sweep,) = content["sweeps"]
    low, middle, high = sweep["trials"]
    assert middle["rms_Nm"] < 0.7 * low["rms_Nm"]
    assert high["overshoot_percent"] > 15  # softened it would be 5
    assert middle["overshoot_percent"] < 5
    rough = [t["command_above_20Hz_Nm"] for t in (high, middle, low)]
    assert rough == sorted(rough, reverse=True)
    assert sweep["chosen"] == 15
    assert "chosen: 15; RMS error" in shown
    assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")
    # The lines that are printed to be pasted make a device with the chosen value.
    lines = shown.split("In the device file:\n")[1].splitlines()
    assert lines == content["device_file"]
    device = own_device("\n".join(lines))
    assert tomllib.loads("\n".join(lines))["sliding_mode"]["lambda_1_s"]["status"] == "assumed"
    assert device.file.sliding_mode.lambda_1_s.value == 15


def test_a_tunable_without_a_key_is_to_be_set_at_run_time():
    found = tune("smc", "ideal", parameter="lead", values=(1.0, 2.0))
    assert found.device_lines() == []
    assert found.table()[-1] == "At run time: smc.lead = 2."
    one, two = found.sweeps[0].trials
    assert two.rms_Nm < one.rms_Nm


@pytest.mark.ci
def test_the_axis_that_moves_is_tuned():
    found = tune("wrist_drive", "ideal", parameter="smc_flexion.lambda_1_s", values=(5.0, 9.0))
    assert found.device_lines()[0] == "[sliding_mode]"


# -- what is refused ------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--plant", "moon"], ["Unknown plant 'moon'", "ideal, real, random"]),
        (["--parameter", "slope", "--values", "1,2"], ["tunable of smc 'slope'", "lambda_1_s"]),
        (["--parameter", "cutoff_Hz", "--values", "20,30"], ["from motor_rate.cutoff_Hz, load"]),
        (["--parameter", "phi_rad_s", "--values", "1"], ["1: 2 or more are", "0.001 to 100"]),
        (["--parameter", "phi_rad_s", "--values", "1,nan"], ["1,nan: not a list of numbers"]),
        (["--parameter", "phi_rad_s", "--values", "1,b"], ["not a list of numbers"]),
        (["--parameter", "lambda_1_s", "--values", "9,90"], ["= 90 is outside 1 to 25"]),
        (["--parameter", "u_max_Nm", "--values", "1e9,2"], ["= 2, 1e+09 is outside 0.00221 to 0"]),
        (["--controller", "mpc"], ["mpc has no smc.phi_rad_s", "--parameter", "predictive."]),
        (
            ["--controller", "mpc", "--parameter", "lambda_1_s", "--values", "9,15"],
            ["Unknown tunable of mpc 'lambda_1_s'", "predictive."],
        ),
        (["--values", "1,2"], ["no parameter", "--parameter"]),
        (["--figure", "a.txt"], [".png, .svg or .pdf"]),
    ],
)
def test_tune_refuses(arguments, words):
    code, shown, error = command("tune", *arguments)
    assert (code, shown) == (2, "")
    assert "Traceback" not in error
    for word in words:
        assert word in error


@pytest.mark.ci
@pytest.mark.parametrize(
    ("section", "key", "value", "words"),
    [
        ("sliding_mode", "lambda_1_s", 30, ["= 30", "limit 25", "Give a value from 1 to 25"]),
        ("sliding_mode", "phi_rad_s", -1, ["phi_rad_s = -1", "limit 0.001", "0.001 to 100"]),
        ("actuator", "coulomb_width_rad_s", -0.05, ["coulomb_width_rad_s = -0.05", "limit 0.001"]),
        ("timing", "control_rate_Hz", 300, ["300 Hz does not divide", "1000 Hz", "Give 250 Hz"]),
        ("timing", "control_rate_Hz", 50, ["15 1/s", "1 to 6.25", "50 Hz", "120 Hz or more"]),
        ("disturbance", "drive_1_s", 100, ["= 100 1/s", "limit 18", "18.03", "166.4 Hz"]),
        ("disturbance", "gain_tau_Nm_rad", 9e4, ["multiplied by 1.37", "limit is 0.9999", "lower"]),
        ("disturbance", "gain_theta", 0, ["multiplied by 1.0", "Raise gain_theta"]),
        ("actuator", "J_kgm2", 0, ["J_kgm2 = 0", "limit 0.0001"]),
        ("sliding_mode", "lambda_1_s", math.nan, ["lambda_1_s", "finite"]),
    ],
)
def test_a_device_that_cannot_work_is_refused(tmp_path, section, key, value, words):
    path = tmp_path / "mine.toml"
    path.write_text(own_text(**{section: {key: value}}))
    for arguments in (["simulate", "tuning", "--controller", path], ["tune", "--controller", path]):
        code, shown, error = command(*arguments)
        assert (code, shown) == (2, "")
        assert "Traceback" not in error
        for word in ["mine.toml", *words]:
            assert word in error


def test_the_fixes_that_are_named_are_accepted():
    """What a refusal tells to write must not be refused in turn."""

    def device(**sections):
        return own_device(**{name: dict([pair]) for name, pair in sections.items()})

    for rate, fix in ((300, 250), (333.333, 250), (450, 500), (1500, 1000), (170, 200)):
        with pytest.raises(UserError, match=f"Give {fix} Hz"):
            device(timing=("control_rate_Hz", rate))
        device(timing=("control_rate_Hz", fix))
    with pytest.raises(UserError, match=r"raise joint.motor_velocity_Hz to 166.4 Hz"):
        _ = device(disturbance=("drive_1_s", 100)).system
    _ = device(disturbance=("drive_1_s", 100), joint=("motor_velocity_Hz", 166.4)).system
    _ = device(disturbance=("drive_1_s", 18.03)).system


# -- outputs --------------------------------------------------------------------------------------

LONG_RUNS = (
    ["simulate", "tuning"],
    ["tune"],
    ["passivity"],
    ["uncertainty", "elbow"],
    ["reproduce", "chapter3"],
    ["reproduce", "chapter4"],
    ["reproduce", "discretisation"],
    ["reproduce", "bandwidth", "--data", "."],
    ["verify", "elbow"],
    ["torque-check", "elbow", "--mass", "1", "--arm", "0.1"],
    ["report", "elbow"],
)


@pytest.mark.ci
@pytest.mark.parametrize("run", LONG_RUNS, ids=lambda run: "-".join(run[:2]))
def test_an_output_that_cannot_be_written_is_refused_before_the_run(monkeypatch, tmp_path, run):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").write_text("precious")
    (tmp_path / "folder.png").mkdir()
    options = ["--json"]
    if not {"verify", "torque-check", "report"} & set(run):
        options += ["--figure"]
    if run[0] == "simulate":
        options += ["--csv"]
    for option in options:
        for name, words in (
            ("a-file/x.png", "Not a directory"),
            ("folder.png", "is a folder"),
            ("/proc/nothing/x.png", "/proc/nothing/x.png: cannot be written"),
            (f"new/{'x' * 300}.png", "a name has more than 255 bytes"),
        ):
            # The table is printed before anything is written: that it is not there shows that
            # nothing was run.
            code, shown, error = command(*run, option, name)
            assert (code, shown) == (2, "")
            assert words in error
            assert "Traceback" not in error
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a-file", "folder.png"]
    assert (tmp_path / "a-file").read_text() == "precious"


def test_a_file_that_fails_at_the_end_leaves_the_table(monkeypatch, tmp_path):
    def full(path, text):
        raise UserError(f"{path}: cannot be written (No space left on device).", "Give another.")

    monkeypatch.setattr("esea_gen.studies.tuning_sweep.run_trial", half_run)
    monkeypatch.setattr("esea_gen.files.write_whole", full)
    code, shown, error = command(
        *("tune", "--parameter", "lambda_1_s", "--values", "1,1.5"),
        *("--json", tmp_path / "a.json"),
    )
    assert code == 2
    assert "chosen: 1.5" in shown
    assert "No space left" in error
