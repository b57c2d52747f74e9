"""Identification: selection and weight of samples, and the stated uncertainty.

Made recordings with sharp reversals, so that every cycle's samples are known by counting.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from esea_gen.device import Device
from esea_gen.hostlib.library import compile_system
from esea_gen.identify import Identification, Recording, identify, load_mapping, load_recordings
from esea_gen.identify.published.plant import FittedPlant, uncertainty
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.resampling import FitRows
from esea_gen.model.sensing import sensing_system
from tests.rigs import changed, table

CYCLE = 100  # samples

MAPPING = changed(
    ("[[recording]]", "[search]\npopulation = 16\n[[recording]]"), ("rig.csv", "*.csv")
)


def sine(cycles: int, amplitude_rad: float = 0.1) -> np.ndarray:
    return amplitude_rad * np.sin(2 * np.pi * np.arange(cycles * CYCLE) / CYCLE)


def lossy(theta_rad: np.ndarray) -> np.ndarray:
    """Torque of a spring with a little friction and a little ripple, which no model has."""
    rising = np.gradient(theta_rad) > 0
    ripple = 0.01 * np.sin(3.7 * np.arange(len(theta_rad)))
    return 10 * theta_rad + 200 * theta_rad**3 + np.where(rising, 0.05, -0.05) + ripple


def written(folder: Path, mapping: str = MAPPING, **torques: tuple[np.ndarray, np.ndarray]) -> Path:
    """Mapping beside its recordings: by name the deflection and the torque."""
    folder.mkdir(exist_ok=True)
    for name, (x, y) in torques.items():
        (folder / f"{name}.csv").write_text(table(np.arange(len(x)) / CYCLE, x, y))
    (folder / "map.toml").write_text(mapping)
    return folder / "map.toml"


def loaded(path: Path) -> list[Recording]:
    return load_recordings(load_mapping(path))


# -- which samples ---------------------------------------------------------------------------------


def roles_by_sample(recording: Recording) -> np.ndarray:
    """How often each sample trains and how often it is held out, shape (samples, 2)."""
    seen = np.zeros((len(recording.theta_rad), 2), dtype=int)
    for s in recording.sets:
        np.add.at(seen[:, 0], s.training, 1)
        np.add.at(seen[:, 1], s.held_out, 1)
    return seen


@pytest.mark.parametrize(("skip_first", "hold_out_last"), [(0, 1), (1, 1), (2, 2), (1, 3)])
@pytest.mark.parametrize("start", [0.0, 1.1])
def test_no_sample_trains_and_is_held_out(tmp_path, skip_first, hold_out_last, start):
    angle = start + 2 * np.pi * np.arange(14 * 97) / 97
    theta = np.sin(angle) * np.where(angle < 7 * 2 * np.pi, 0.1, 0.2)
    rules = f"[cycles]\nskip_first = {skip_first}\nhold_out_last = {hold_out_last}\n"
    path = written(tmp_path, MAPPING + rules, a=(theta, lossy(theta)), b=(theta, lossy(theta)))
    for recording in loaded(path):
        seen = roles_by_sample(recording)
        assert seen.sum(axis=1).max() == 1
        assert seen[:, 0].sum() > 0
        # What is held out is whole cycles, as many of each block as the rules say.
        blocks = {c.block for c in recording.cycles if c.role == "held_out"}
        held = [c for c in recording.cycles if c.role == "held_out"]
        assert len(held) == hold_out_last * len(blocks)
        assert seen[:, 1].sum() == sum(c.stop - c.start for c in held)


# -- what it may depend on -------------------------------------------------------------------------


def corrupted(recording: Recording, role: str) -> np.ndarray:
    """The recorded torque, wrong at every sample of a role."""
    tau = recording.tau_Nm.copy()
    for s in recording.sets:
        at = getattr(s, role)
        tau[at] += 0.3 * np.cos(0.9 * at)
    return tau


def found(result: Identification) -> dict[str, object]:
    """What the fit says: numbers, how sure, and how well it fits what it was trained on."""
    sets = result.to_dict()["sets"]
    return {
        "values": result.fit.values,
        "cost": result.fit.cost,
        "sigma": result.spread.sigma,
        "training_rms_Nm": [s["training"]["rms_Nm"] for s in sets],
    }


@pytest.mark.ci
def test_a_wrong_held_out_torque_changes_no_identified_number(tmp_path):
    theta = np.concatenate([sine(5, 0.1), sine(5, 0.2)])
    path = written(tmp_path / "good", rig=(theta, lossy(theta)))
    good = identify(path)
    (recording,) = loaded(path)
    held = identify(written(tmp_path / "held", rig=(theta, corrupted(recording, "held_out"))))
    assert found(held) == found(good)
    # It is seen where it belongs, and a wrong training torque does change the numbers.
    assert min(s["held_out"]["rms_Nm"] for s in held.to_dict()["sets"]) > 0.2
    trained = identify(written(tmp_path / "trained", rig=(theta, corrupted(recording, "training"))))
    assert found(trained)["values"] != found(good)["values"]


@pytest.mark.ci
@pytest.mark.parametrize("rate_Hz", [1000.0, 250.0])
@pytest.mark.parametrize(("amplitudes", "skip_first"), [((0.1, 0.2), 1), ((0.1, 0.1104), 0)])
def test_a_wrong_held_out_torque_reaches_no_row_of_a_fit_with_rate_terms(
    tmp_path, elbow, rate_Hz, amplitudes, skip_first
):
    # On a grid of its own, between recorded samples: held-out ones must not leak in there either,
    # least of all where the next block trains from its first sample on (another amplitude, but no
    # open cycle between them).
    theta = np.concatenate([sine(5, a) for a in amplitudes])
    mapping = MAPPING + f"[cycles]\nskip_first = {skip_first}\n"
    (recording,) = loaded(written(tmp_path, mapping, rig=(theta, lossy(theta))))
    wrong = replace(recording, tau_Nm=corrupted(recording, "held_out"))
    good, held = (FittedPlant(elbow, [r], rate_Hz) for r in (recording, wrong))
    np.testing.assert_array_equal(held.measured, good.measured)
    np.testing.assert_array_equal(held.weight, good.weight)
    # As many rows as the training cycles last, a second each.
    cycles = sum(c.role == "training" for c in recording.cycles)
    assert cycles == (4 if skip_first else 7)
    assert len(good.measured) == pytest.approx(cycles * rate_Hz, abs=0.02 * rate_Hz)


# -- how much each counts --------------------------------------------------------------------------


def spring(cycles: int, k1_Nm_rad: float) -> tuple[np.ndarray, np.ndarray]:
    theta = sine(cycles)
    return theta, k1_Nm_rad * theta


def test_every_recording_weighs_the_same_however_long_it_is(tmp_path):
    # Two springs at one amplitude: the stiffness that serves both equally is their mean.  By
    # samples the long one, with 28 training cycles against 3, would pull it to 11.8.
    result = identify(written(tmp_path, **{"long": spring(31, 12.0), "short": spring(6, 10.0)}))
    assert result.fit.values["k1_Nm_rad"] == pytest.approx(11.0, rel=1e-6)
    # The cost is the mean of both mean squares: each a sine of 0.1 Nm about the mean spring.
    assert result.fit.cost == pytest.approx(0.1**2 / 2, rel=1e-6)
    for s in result.to_dict()["sets"]:
        assert s["training"]["rms_Nm"] == pytest.approx(0.1 / np.sqrt(2), rel=1e-6)


# -- the rate on the fit's grid --------------------------------------------------------------------


def replayed(device: Device, theta_rad: np.ndarray) -> Recording:
    """A recording of the device's own C at its own rate, every sample training."""
    system = sensing_system(device, device.velocity, device.sensor, counts=False)
    task = compile_system(system, "f64").task("sense")
    tau = task.run({"theta_rad": theta_rad}, trace=False)[0]["tau_Nm"]
    at = np.arange(len(theta_rad))
    whole = DataSet("own", 0.1, at, at[:0], {}, None, None, None)
    t = at * device.period_s
    return Recording("own", "own.csv", "0" * 16, t, theta_rad, tau, True, 0, (), (whole,))


def parameters(device: Device) -> dict[str, float]:
    return {k.rsplit(".", 1)[-1]: q.value for k, q in device.quantities() if "elastomer." in k}


def test_the_devices_own_torque_is_fitted_without_error(elbow):
    t = np.arange(3000) * elbow.period_s
    recording = replayed(elbow, 0.1 * np.sin(2 * np.pi * (0.5 + 0.4 * t) * t))
    plant = FittedPlant(elbow, [recording], 1 / elbow.period_s)
    values = parameters(elbow)
    del values["stops"]
    tau_Nm, omega_rad_s = plant.judged
    np.testing.assert_array_equal(tau_Nm, plant.measured)
    estimate = elbow.velocity.simulator()
    rates = [estimate.step(theta_rad=x)["omega_mid_rad_s"] for x in recording.theta_rad.tolist()]
    assert omega_rad_s == pytest.approx(np.ravel(rates), abs=1e-9)
    assert max(rates) > 1.5
    assert FittedPlant(elbow, [recording]).judged is None  # no rates where the samples are taken
    # The sensor takes the rate of the same step; one step off is 0.02 Nm here.
    assert np.max(np.abs(plant.torque(values) - plant.measured)) < 1e-9
    assert np.max(np.abs(plant.measured)) > 1


# -- how sure it is --------------------------------------------------------------------------------


class Cubic:
    """Stands for the compiled plant: k1 and k3 of a cubic spring, in closed form."""

    whole = False

    def __init__(self, theta_rad: np.ndarray, measured: np.ndarray, cycles: int = 1) -> None:
        self.rows = FitRows.of([(0, cycles, np.zeros(len(theta_rad)))])
        self.basis = np.stack([theta_rad, theta_rad**3], axis=1)
        self.measured = measured
        self.weight = np.full(len(measured), 1 / np.sqrt(len(measured)))

    def torque(self, values: dict[str, float]) -> np.ndarray:
        return self.basis @ [values["k1_Nm_rad"], values["k3_Nm_rad3"]]


def alike(rng: np.random.Generator, rho: float, runs: int, n: int) -> np.ndarray:
    """Noise of unit variance of which neighbours are alike by ``rho``, shape (runs, n)."""
    noise = rng.normal(size=(runs, n))
    for k in range(1, n):
        noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1 - rho**2) * noise[:, k]
    return noise


RUNS, SAMPLES, TOLD = 400, 4000, 40


@pytest.mark.ci
@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95])
def test_standard_deviations_are_the_scatter_of_repeated_experiments(rho):
    theta = 0.2 * np.sin(np.arange(SAMPLES) * 2 * np.pi / 200)
    basis = Cubic(theta, theta).basis
    noise = 0.02 * alike(np.random.default_rng(11), rho, RUNS, SAMPLES)
    measured = basis @ [10.0, 200.0] + noise
    fits = np.linalg.lstsq(basis, measured.T, rcond=None)[0].T
    said = []
    for fit, row in itertools.islice(zip(fits, measured, strict=True), TOLD):
        values = dict(zip(("k1_Nm_rad", "k3_Nm_rad3"), fit.tolist(), strict=True))
        told = uncertainty(Cubic(theta, row, 20), values)
        said.append([told.sigma[k] for k in values])
        assert told.correlation_factor == pytest.approx(np.sqrt((1 + rho) / (1 - rho)), rel=0.2)
    # The scatter of 400 fits is known to 3.5 %, the mean of 40 deviations of 20 cycles to 3 %; a
    # plain covariance says 2 and 6.2 times too little at 0.6 and 0.95.
    np.testing.assert_allclose(np.mean(said, axis=0), fits.std(axis=0), rtol=0.12)


FEW_rad = np.array([-0.2, -0.1, 0.05, 0.15, 0.2])


@pytest.mark.parametrize("unit", [1.0, 1e6, 1e-6])
def test_a_parameter_without_effect_is_not_determined(unit):
    plant = Cubic(FEW_rad, unit * (10 * FEW_rad + [0.01, -0.02, 0.015, -0.01, 0.005]))
    # As far below the other as rounding may leave it, and as far as any number may tell.
    plant.basis[:, 1] = 1e-15 * np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    plant.basis *= unit
    told = uncertainty(plant, {"k1_Nm_rad": 10.0, "k3_Nm_rad3": 200.0})
    assert told.sigma["k3_Nm_rad3"] == math.inf
    assert 0 < told.sigma["k1_Nm_rad"] < 0.2


@pytest.mark.parametrize(("k3", "end"), [(4000.0, 2500.0), (-400.0, 0.0), (0.0, 0.0)])
def test_what_depends_on_a_bound_is_told(k3, end):
    """The bounds of k3 are 0 and 2500; the second is true of a rubber that has no k3."""
    theta = 0.2 * np.sin(np.arange(SAMPLES) * 2 * np.pi / 200)
    noise = np.random.default_rng(3).normal(0, 0.02, SAMPLES)
    plant = Cubic(theta, Cubic(theta, theta).basis @ [30.0, k3] + noise, 20)
    k1 = theta @ (plant.measured - end * theta**3) / (theta @ theta)
    told = uncertainty(plant, {"k1_Nm_rad": k1, "k3_Nm_rad3": end})
    expected = (end - k3) * 0.75 * 0.2**2  # of a sine, the mean of x^4 over that of x^2
    assert told.moved == ({"k1_Nm_rad": pytest.approx(expected, rel=0.01)} if k3 else {})


# -- units -----------------------------------------------------------------------------------------

# The National Institute of Standards and Technology, special publication 811, appendix B.
SI = {
    **{("deflection", k): v for k, v in {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180}.items()},
    **{("length", k): v for k, v in {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}.items()},
    **{("torque", k): v for k, v in {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}.items()},
    **{("force", k): v for k, v in {"N": 1.0, "kN": 1e3, "mN": 1e-3, "tonf": 9806.65}.items()},
    ("length", "um"): 1e-6,
    ("force", "kgf"): 9.80665,
    ("force", "lbf"): 4.4482216152605,
}


@pytest.mark.parametrize("unit", SI, ids="-".join)
def test_recorded_units_become_si(tmp_path, unit):
    where, name = unit
    factor = SI[unit]
    x, y = sine(4), lossy(sine(4))
    moved = where in ("deflection", "length")
    told = (x / factor, y) if moved else (x, y / factor)
    scale = {"length": "scale_rad_per_m", "force": "scale_Nm_per_N"}.get(where)
    put = f'unit = "{name}"'
    if scale:
        put += f'\n{scale} = {{ value = 1.0, status = "assumed", source = "a test" }}'
    mapping = MAPPING.replace('unit = "rad"' if moved else 'unit = "Nm"', put)
    (recording,) = loaded(written(tmp_path, mapping, rig=told))
    np.testing.assert_allclose(recording.theta_rad, x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(recording.tau_Nm, y, rtol=1e-9, atol=1e-12)
