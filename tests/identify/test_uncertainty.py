"""Torque uncertainty: the Monte-Carlo against first-order propagation, and against itself."""

from __future__ import annotations

import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.device import Device, load_device, with_numbers
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device
from esea_gen.identify.published.plant import FittedPlant
from esea_gen.identify.published.plant import uncertainty as identified
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.studies.uncertainty import motions as room
from esea_gen.studies.uncertainty import study
from esea_gen.studies.uncertainty.motions import (
    Encoders,
    Spread,
    assumed_spread,
    continuous_torque,
    elastomer_values,
    identified_spread,
    motions,
)
from tests.conftest import ROOT
from tests.observed import filtered

DATA = ROOT / "tests" / "data" / "hdrb"
SHORT_S = 6.0


@pytest.fixture(scope="module")
def cubic(elbow) -> Device:
    """Spring alone: no memory, so that first-order propagation is exact arithmetic."""
    e = elbow.file.elastomer.model_copy(update={"maxwell": None})
    bare = Device(elbow.file.model_copy(update={"elastomer": e}), "spring.toml")
    return with_numbers(bare, {"elastomer.alpha_Nm_rad": 0.0})


@pytest.fixture(scope="module")
def found(elbow):
    return study.torque_uncertainty(elbow, 16, 3, limit_s=SHORT_S)


def slope(theta: np.ndarray) -> np.ndarray:
    x = ca.SX.sym("x")
    derivative = ca.Function("d", [x], [ca.jacobian(239.0 * x**3 + 9.39 * x, x)])
    return np.asarray(derivative(theta[None, :])).ravel()


@pytest.mark.ci
def test_quantisation_of_a_spring_is_first_order(cubic):
    found = study.torque_uncertainty(
        cubic, 24, spread=Spread((), np.zeros((0, 0)), "none"), limit_s=30.0
    )
    count = 2 * np.pi / 2**12
    moves = motions(cubic, 30.0)
    cells = np.concatenate([m.cell for m in moves] * 16)
    rng = np.random.default_rng(5)
    errors = []
    slopes = [slope(m.theta_rad) for m in moves]
    true = [filtered(m.theta_rad, count) for m in moves]
    for _ in range(16):
        for m, steep, smooth in zip(moves, slopes, true, strict=True):
            t = np.arange(len(m.theta_rad)) * 1e-3
            start, phase = rng.uniform(0, 2 * np.pi, 2)
            load = start + np.deg2rad(45) * np.cos(2 * np.pi * 0.2 * t + phase)
            counts = (np.round((load + m.theta_rad) / count) - np.round(load / count)) * count
            # What the sensor would make of the true deflection is what the command compares with.
            error = filtered(counts, count) - smooth
            errors.append((steep * error)[m.kept] * m.sign)
    error = np.concatenate(errors)
    tried = []
    for i in range(study.TORQUES):
        here = (cells // study.RATES) == i
        if here.sum() < 16000:  # too few for the share that is asked for
            continue
        tried.append(i)
        f = found.cells[study.QUANTISATION][i, None]
        assert f.sigma_Nm == pytest.approx(np.std(error[here]), rel=0.06), i
        ends = np.abs(np.quantile(error[here], [0.025, 0.975]))
        assert f.half_width_Nm == pytest.approx(np.max(ends), rel=0.06), i
        assert abs(f.bias_Nm) < 4 * f.bias_error_Nm + 0.02 * f.sigma_Nm
    # All classes of torque but the last, beyond the full scale, where the motions hardly come.
    assert tried == [0, 1, 2, 3, 4]
    # No Maxwell element: nothing depends on the rate.  What is left is what the filter lags, and
    # f32 rounding.
    lag = [g * (x - m.theta_rad) for g, x, m in zip(slopes, true, moves, strict=True)]
    kept = np.concatenate([x[m.kept] * m.sign for x, m in zip(lag, moves, strict=True)])
    half = np.max(np.abs(np.quantile(kept, [0.025, 0.975])))
    assert abs(found.overall(study.RATE).half_width_Nm - half) < 1e-5
    assert found.overall(study.PARAMETERS).sigma_Nm == 0


@pytest.mark.ci
def test_nonlinearity_is_bounded_by_its_amplitude(cubic):
    nothing = Spread((), np.zeros((0, 0)), "none")
    found = study.torque_uncertainty(cubic, 10, spread=nothing, residual_deg=0.2, limit_s=SHORT_S)
    moves = motions(cubic, SHORT_S)
    theta = max(float(np.abs(m.theta_rad).max()) for m in moves)
    reached = {int(i) for m in moves for i in np.unique(m.cell // study.RATES)}
    assert reached == {0, 1, 2, 3}
    for i in reached:
        f = found.cells[study.NONLINEARITY][i, None]
        # Each side is off by at most twice its amplitude: its own error and its zero's.
        assert f.half_width_Nm < slope(np.array([theta + 0.014]))[0] * 4 * np.deg2rad(0.2)
        assert f.sigma_Nm > 0.2 * 9.39 * np.deg2rad(0.2)
    none = study.torque_uncertainty(cubic, 2, spread=nothing, residual_deg=0.0, limit_s=SHORT_S)
    assert none.overall(study.NONLINEARITY).sigma_Nm == 0


def test_standard_errors_shrink_and_the_same_seed_repeats(elbow, found):
    assert study.torque_uncertainty(elbow, 16, 3, limit_s=SHORT_S).to_dict() == found.to_dict()
    assert found.overall(study.RATE).sigma_error_Nm == 0
    assert found.overall(study.TOGETHER).sigma_error_Nm > 0
    assert [n for n, _ in found.convergence][-1] == 16
    assert found.convergence[-1][1].sigma_Nm == found.overall(study.TOGETHER).sigma_Nm
    other = study.torque_uncertainty(elbow, 16, 4, limit_s=SHORT_S)
    a, b = found.overall(study.TOGETHER), other.overall(study.TOGETHER)
    assert a.sigma_Nm != b.sigma_Nm
    assert abs(a.sigma_Nm - b.sigma_Nm) < 4 * np.hypot(a.sigma_error_Nm, b.sigma_error_Nm)


def test_tally_knows_a_normal_distribution():
    rng = np.random.default_rng(5)
    tally = study.Tally(4.0)
    cell = np.zeros(20_000, dtype=int)
    for _ in range(20):
        tally.add(0.01 + 0.05 * rng.standard_normal(20_000), cell)
    f = tally.figures(np.arange(study.TORQUES * study.RATES))
    assert f.bias_Nm == pytest.approx(0.01, abs=4 * f.bias_error_Nm)
    assert f.sigma_Nm == pytest.approx(0.05, abs=4 * f.sigma_error_Nm)
    assert f.bias_error_Nm == pytest.approx(0.05 / np.sqrt(400_000), rel=0.5)
    assert f.high_Nm == pytest.approx(0.01 + 1.96 * 0.05, rel=0.01)
    assert f.low_Nm == pytest.approx(0.01 - 1.96 * 0.05, rel=0.015)
    assert tally.figures(np.array([3])) is None


def test_encoders_count_and_bend(elbow):
    theta = np.linspace(-0.1, 0.1, 3000)
    for k in range(5):
        e = Encoders(elbow, 0.1, np.random.default_rng(k))
        count = 2 * np.pi / 4096
        read = e.read(theta, counts=True, nonlinear=False)
        assert np.max(np.abs(read - theta)) <= count
        assert read / count == pytest.approx(np.round(read / count), abs=1e-9)
        bent = e.read(theta, counts=False, nonlinear=True) - theta
        assert np.max(np.abs(bent)) <= 4 * np.deg2rad(0.1)
        assert np.max(np.abs(bent)) > 1e-4
        # Zeroed where both encoders stand alike.
        assert e.read(np.zeros(1), counts=False, nonlinear=True)[0] == pytest.approx(0, abs=1e-15)
        assert e.read(theta, counts=False, nonlinear=False) == pytest.approx(theta, abs=1e-12)


def test_the_continuous_model_has_converged(elbow):
    from scipy.interpolate import CubicSpline

    t = np.arange(3000) * 1e-3
    path = CubicSpline(t, 0.15 * np.sin(2 * np.pi * 0.8 * t))
    torque = {}
    for dense in (10, 40):
        finer = with_numbers(elbow, {"timing.sense_rate_Hz": dense * 1000.0})
        fine = compile_device(finer, "f64").block("sensor")
        torque[dense] = continuous_torque(fine, path, len(t), dense, 1e-3)
    # 0.0002 % of full scale: far below what it is compared with.
    assert np.max(np.abs(torque[10] - torque[40])) < 1e-5


@pytest.mark.ci
def test_identified_spread_is_the_identifications_own(tmp_path):
    # A small search is enough here: any device near the optimum has a covariance.
    mapping = tmp_path / "map.toml"
    text = (DATA / "hdrb.toml").read_text() + "\n[search]\npopulation = 16\n"
    mapping.write_text(text, encoding="utf-8")
    arguments = ["identify", str(mapping), "--model", "published"]
    arguments += ["--data", str(DATA), "--out", str(tmp_path)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    device = load_device(tmp_path / "hdrb.toml")
    spread = identified_spread(device, mapping, DATA)
    assert spread.band_Nm is not None
    assert 0 < spread.band_Nm < device.tau_full_scale_Nm
    recordings = load_recordings(load_mapping(mapping, DATA))
    values = elastomer_values(device)
    known = identified(FittedPlant(device, recordings), values)
    root = spread.root
    # Directions below the cap have the identification's standard deviations.
    capped = np.linalg.norm(root, axis=0) > 0.499
    assert 0 < capped.sum() < root.shape[1]
    for k, s in spread.sigma.items():
        assert s <= known.sigma[k] / values[k] * 1.02, k
    assert spread.sigma["k1_Nm_rad"] > 0
    assert "covariance of the identification" in spread.origin
    rng = np.random.default_rng(0)
    for _ in range(50):
        drawn, _ = spread.draw(device, rng)
        assert all(np.isfinite(v) and v >= 0 for v in drawn.values())
    with pytest.raises(UserError, match="identified 'hdrb', not 'elbow'"):
        identified_spread(load_device("elbow"), mapping, DATA)


def test_assumed_spread_has_its_share_and_stays_in_bounds(elbow):
    spread = assumed_spread(elbow, 0.3)
    assert set(spread.keys) == set(elastomer_values(elbow)) - {"eps2"}
    rng = np.random.default_rng(2)
    draws = [spread.draw(elbow, rng) for _ in range(400)]
    assert np.log([d["k1_Nm_rad"] for d, _ in draws]).std() == pytest.approx(0.3, rel=0.15)
    assert max(d["n"] for d, _ in draws) == 1.0  # its upper bound
    assert sum(c for _, c in draws) > 0


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "SIGNALS", tuple(replace(s, duration_s=5.0) for s in room.SIGNALS))
    files = {"json": tmp_path / "u.json", "figure": tmp_path / "u.png"}
    arguments = ["uncertainty", "elbow", "--runs", "2", "--seed", "7"]
    for k, v in files.items():
        arguments += [f"--{k}", str(v)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    content = json.loads(files["json"].read_text())
    assert (content["runs"], content["seed"]) == (2, 7)
    assert files["figure"].read_bytes()[:4] == b"\x89PNG"
    said = " ".join(done.output.split())
    assert "Not included: temperature" in said
    assert "assumed: 5 % (standard deviation) of each parameter" in said
    every = next(f for f in content["sources"][study.TOGETHER] if f["torque"] is None)
    assert every["low_percent"] < 0 < every["high_percent"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--figure", "u.xyz"], "not the name of a picture file"),
        (["--data", "."], "--data without --recording"),
    ],
)
def test_the_command_refuses(arguments, said):
    done = CliRunner().invoke(app, ["uncertainty", "elbow", *arguments])
    assert isinstance(done.exception, UserError)
    assert said in str(done.exception)


def test_a_device_without_linear_stiffness_is_refused(elbow):
    with pytest.raises(UserError, match="no unique inverse"):
        study.torque_uncertainty(with_numbers(elbow, {"elastomer.k1_Nm_rad": 0.0}), 2)


def test_what_the_models_form_leaves_is_the_devices_own(found):
    # No recording: nothing is known of it, and no other device's figure stands in.
    (note,) = (n for n in found.notes() if "model's form" in n)
    assert "not known" in note
    assert "1.6" not in note
    own = replace(found, spread=replace(found.spread, band_Nm=0.0894))
    (note,) = (n for n in own.notes() if "model's form" in n)
    assert "0.0894 Nm, 2 %" in note  # of 4.47 Nm
