"""Friction of a drive from recordings of real drives and from simulated runs."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import curve_fit

from esea_gen.device import parse_device
from esea_gen.errors import UserError
from esea_gen.identify.drive.friction import SteadyRun, fit_friction, read_run
from tests.conftest import ROOT
from tests.typed import typed

DATA = ROOT / "tests" / "data" / "epos_friction"
FULL_Nm = 9.84e-3  # the drives' nominal torque
SPEEDS = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0)
TRUTH = {"load_Nm": 3e-4, "fc_Nm": 2.4e-3, "fs_Nm": 8e-4, "vs_rad_s": 4.0, "fv_Nms_rad": 5e-5}


def drawn(seed, **other):
    """Simulated steady runs: an error of each run's own, teeth, noise, a speed in whole counts."""
    rng, t = np.random.default_rng(seed), TRUTH | other
    runs = []
    for w in [way * s for s in SPEEDS for way in (1, -1)] * 2:
        dry = t["fc_Nm"] + t["fs_Nm"] * np.exp(-abs(w) / t["vs_rad_s"])
        tau = t["load_Nm"] + np.sign(w) * dry + t["fv_Nms_rad"] * w + rng.normal(0, 4e-5)
        teeth = 2e-4 * np.sin(0.3 * np.arange(150) + rng.uniform(0, 6))
        omega = np.round(10 * (w + rng.normal(0, 0.05, 150))) / 10
        runs.append(SteadyRun(f"{w:g}", omega, tau + teeth + rng.normal(0, 2e-4, 150)))
    return runs


def test_the_intervals_hold_what_the_runs_were_drawn_with():
    """95 % of the intervals over 20 seeds, within what so many may by chance."""
    held = [
        e is not None and e.low <= TRUTH[name] <= e.high
        for seed in range(20)
        for found in [fit_friction(drawn(seed))]
        for name, e in ((n, getattr(found, n)) for n in TRUTH)
    ]
    assert np.mean(held) >= 0.9


def test_where_there_is_no_rise_none_is_said():
    found = fit_friction(drawn(1, fs_Nm=0.0))
    assert found.fs_Nm is found.vs_rad_s is None
    assert found.fc_Nm.low <= TRUTH["fc_Nm"] <= found.fc_Nm.high
    assert "not significant" in "\n".join(found.table())


def test_samples_that_somebody_spoilt_are_left_out():
    runs = drawn(2)
    clean = fit_friction(runs)
    for run in runs:
        run.tau_Nm[::40] = 0.5
    spoilt = fit_friction(runs)
    assert spoilt.outside >= clean.outside + 4 * len(runs) - 40
    assert spoilt.fc_Nm.value == pytest.approx(clean.fc_Nm.value, rel=0.01)


def test_an_export_is_read_as_it_is():
    """The mean torques that the data's own page has, in % of the nominal torque."""
    for name, percent in (("n200", 39.9), ("n2", 36.1)):
        run = read_run(DATA / f"{name}.csv", FULL_Nm)
        assert len(run.tau_Nm) == 500
        assert 100 * np.mean(run.tau_Nm) / FULL_Nm == pytest.approx(percent, abs=0.6)
    # Edited by hand: a note behind a row is none of its numbers.
    assert len(read_run(DATA / "worm_1.csv", FULL_Nm).tau_Nm) > 400


def test_a_real_drive_is_found_as_by_other_means():
    """Against scipy's curve_fit on the medians alone."""
    runs = [read_run(p, FULL_Nm) for p in sorted(DATA.glob("*.csv")) if "worm" not in p.name]
    found = fit_friction(runs)
    w = np.array([np.mean(r.omega_rad_s) for r in runs])
    y = 1e3 * np.array([np.median(r.tau_Nm) for r in runs])

    def model(w, load, fc, fs, vs, fv):
        return load + np.sign(w) * (fc + fs * np.exp(-np.abs(w) / vs)) + fv * w

    other, _ = curve_fit(model, w, y, p0=(0.3, 2.4, 0.8, 3.0, 0.05), maxfev=20_000)
    # The slowest runs stick and slip: means and medians are up to 5 % of the torque apart.
    assert 1e3 * found.torque_Nm(w) == pytest.approx(model(w, *other), abs=0.18)
    assert found.left_Nm < 0.15 * found.moved_Nm


def test_the_command_writes_what_it_found(tmp_path):
    runs = [str(p) for p in sorted(DATA.glob("*.csv")) if "worm" not in p.name]
    asked = ["friction", *runs, "--full-Nm", FULL_Nm, "--json", tmp_path / "f.json"]
    done = typed(*asked, "--device", "elbow_drive", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Coulomb friction" in done.stdout
    found = json.loads((tmp_path / "f.json").read_text())["friction"]
    a = parse_device((tmp_path / "elbow_drive_id.toml").read_text(), "x").file.actuator
    assert typed(*asked[:7], runs[0]).stderr.count("Give each recording once.") == 1
    # At the joint, behind a gear of 74.
    assert a.fc_Nm.value == pytest.approx(74 * found["fc_Nm"]["value_Nm"], rel=1e-5)
    assert a.fv_Nms_rad.value == pytest.approx(74**2 * found["fv_Nms_rad"]["value_Nms_rad"], 1e-5)
    assert a.fc_Nm.status == "identified"
    assert "95 % interval" in a.fc_Nm.source


@pytest.mark.parametrize(
    ("text", "full", "says"),
    [
        ("omega_rad_s,torque\n1,2\n", None, "there is no column 'tau_Nm'"),
        ("omega_rad_s,tau_Nm\n1,2\n1,x\n", None, "line 3, column 'tau_Nm'"),
        ("omega_rad_s,tau_Nm\n1,nan\n1,2\n", None, "is nan"),
        ("EPOS Studio Version:;3\nms;rpm;%\n0;1;2\n", None, "--full-Nm"),
        ("EPOS Studio Version:;3\nms;mA;%\n0;1;2\n", 1.0, "not speed in rpm"),
        ("EPOS Studio\nms;rpm;%\n0;1;2.5\n1;1;2,5\n", 1.0, "'2,5' is not a number"),
        ("EPOS Studio\nms;rpm;%\n0;1;2.5,3 turns\n", 1.0, "'2.5,3 turns' is not a number"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path, text, full, says):
    path = tmp_path / "run.csv"
    path.write_text(text)
    with pytest.raises(UserError) as refused:
        read_run(path, full)
    assert says in f"{refused.value.what} {refused.value.fix}"


def test_a_decimal_comma_of_an_export_is_read(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("EPOS Studio;,,\nms;rpm;%\n0,0;1000;2,5,,was 3\n1,0;1000;2,75\n2;1000;3,\n")
    run = read_run(path, 100.0)
    assert run.tau_Nm.tolist() == [2.5, 2.75, 3]
    assert "comments behind rows (line 3)" in run.read_as


def test_too_few_runs_are_refused():
    one_way = [r for r in drawn(0) if r.omega_rad_s.mean() > 0]
    for runs in (drawn(0)[:4], one_way):
        with pytest.raises(UserError, match="runs that move"):
            fit_friction(runs)


def test_behind_a_gear_torques_grow_speeds_fall_and_damping_grows_twice():
    found = fit_friction(drawn(1))
    at = found.at_joint(4.0)
    assert at["fc_Nm"].high == 4 * found.fc_Nm.high
    assert at["stribeck_Nm"].low == 4 * found.fs_Nm.low
    assert at["stribeck_rad_s"].value == found.vs_rad_s.value / 4
    assert at["fv_Nms_rad"].value == 16 * found.fv_Nms_rad.value
