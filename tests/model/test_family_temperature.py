"""The factor of temperature of a member of the family: sensor, inverse, prediction, energy, file.

No recording with a temperature was there: what holds is worked out from the form.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from esea_gen.control.predictive.drive import predictive_controller
from esea_gen.device import Device, parse_device
from esea_gen.devices.schema import json_schema
from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.export.fmu import make_fmu
from esea_gen.export.model import block_model
from esea_gen.hostlib.library import compile_device
from esea_gen.identify.family.identification import family_device
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.rubber import fitted_of, rubber_inverse
from esea_gen.model.temperature import TemperatureFactor
from tests.control.test_predictive import situation
from tests.control.test_predictive_family import FamilyPlain
from tests.devices.test_devices import conforms
from tests.model.test_family import path_of
from tests.model.test_family_device import EVERY, drive, refused

pytestmark = pytest.mark.ci

OFFSET_Nm = -0.1  # EVERY's last term
WARM = TemperatureFactor(23.0, -0.004, 10.0, 40.0)
AT_C, FACTOR = 31.0, 0.968  # 1 - 0.004 * 8
HOT = {"temperature_C": AT_C}
THETA = 0.15 * np.sin(np.linspace(0, 25, 2500)) * np.linspace(0.2, 1, 2500)
# One operator of each kind, and an offset.
FEW = FittedMember(
    Member(
        "few",
        "few",
        (
            Term("spring", Rise("power", 1)),
            Term("slip", Rise("power", 3), (0.3,), softening=Softening("path", 8.0)),
            Term("stop", Rise("power", 1), (0.1,)),
            Term("maxwell", Rise("power", 1), (3.0,)),
            Term("offset"),
        ),
    ),
    0.2,
    (1.0, 2.0, 0.4, 0.3, OFFSET_Nm),
)


def scaled(fitted: FittedMember, factor: float) -> FittedMember:
    """The same rubber at another temperature, by hand: every weight but the offset's."""
    weights = (
        w if t.kind == "offset" else factor * w
        for w, t in zip(fitted.weights_Nm, fitted.member.terms, strict=True)
    )
    return replace(fitted, weights_Nm=tuple(weights))


@pytest.fixture(scope="module")
def warm(elbow) -> Device:
    return family_device(elbow, replace(EVERY, temperature=WARM), "drawn")


@pytest.fixture(scope="module")
def by_hand(elbow) -> Device:
    """Without a section, its weights those at 31 degC."""
    return family_device(elbow, scaled(EVERY, FACTOR), "drawn")


def sensed(device: Device, real: str, **tunables: float) -> np.ndarray:
    runner = compile_device(device, real).block("sensor")
    runner.prepare(tunables)
    out, _ = runner.run({"theta_rad": THETA, "omega_rad_s": 0 * THETA}, trace=False)
    return np.asarray(out["tau_Nm"], dtype=np.float64)


@pytest.mark.parametrize(("real", "rounding"), [("f64", 1e-14), ("f32", 3e-7)])
def test_the_c_at_a_temperature_is_the_factor_times_that_at_the_reference(warm, real, rounding):
    """But for the offset; rounding is of the largest torque, some 4 Nm."""
    usual, hot = sensed(warm, real), sensed(warm, real, **HOT)
    expected = FACTOR * (usual - OFFSET_Nm) + OFFSET_Nm
    assert np.ptp(usual) > 2
    assert np.abs(hot - expected).max() < rounding * np.abs(usual).max() * 2
    cold = sensed(warm, real, temperature_C=15.5)
    expected = 1.03 * (usual - OFFSET_Nm) + OFFSET_Nm
    assert np.abs(cold - expected).max() < rounding * np.abs(usual).max() * 2


def test_whole_numbers_are_within_their_bound_at_a_temperature(elbow):
    """Of the C at 31 degC against the weights by hand in float64, by the bound derived there."""
    device = family_device(elbow, replace(FEW, temperature=WARM), "drawn")
    hand = family_device(elbow, scaled(FEW, FACTOR), "drawn")
    (knob,) = device.sensor.tunables
    there = replace(device.sensor, tunables=(replace(knob, default=AT_C),))
    most = any_bound(plan_block(there)).outputs["tau_Nm"]
    found = sensed(device, "q31", **HOT)
    assert np.abs(found - sensed(hand, "f64")).max() < most < 0.01
    assert np.abs(found - sensed(device, "f64")).max() > 2 * most  # armed: the factor is seen


def test_the_inverse_is_that_of_the_sensor_at_the_same_temperature(warm, by_hand):
    """Requests given back by the sensor; the set-points are those of the weights by hand."""
    wanted = 1.5 * np.sin(np.linspace(0, 20, 1500))
    inverse = rubber_inverse(warm)
    good = next(f.threshold for f in inverse.status_port.flags if f.name == "NOT_CONVERGED")
    points, _ = inverse.simulator(HOT).run({"tau_Nm": wanted})
    at = {"theta_rad": points["theta_rad"], "omega_rad_s": 0 * wanted}
    given, _ = warm.sensor.simulator(HOT).run(at)
    assert np.abs(given["tau_Nm"] - wanted).max() <= good < 1e-3
    assert np.all(points["status"].astype(int) & 0b1100011 == 0)
    elsewhere, _ = warm.sensor.simulator().run(at)
    assert np.abs(elsewhere["tau_Nm"] - wanted).max() > 20 * good  # armed
    hand, _ = rubber_inverse(by_hand).simulator().run({"tau_Nm": wanted})
    assert np.abs(hand["theta_rad"] - points["theta_rad"]).max() < 1e-4


@pytest.mark.parametrize("seed", [1, 2])
def test_the_prediction_is_that_of_the_weights_by_hand(warm, by_hand, seed):
    """Gradient, Hessian and plan of the controller, at 31 degC and with the weights at 31 degC."""
    given, found = {}, []
    for base, tunables in ((by_hand, {}), (warm, HOT), (warm, {})):
        device = parse_device(drive(base, "elbow_mpc"), "mine.toml")
        program = predictive_controller(device)
        if not given:
            given = situation(np.random.default_rng(seed), device, program, FamilyPlain)
        executor = program.simulator(tunables)
        # A Maxwell branch remembers a torque: with the weights of the reference, one at that.
        remembered = np.array(given["relaxed_Nm"]) / (1.0 if base is by_hand else FACTOR)
        executor.step(**given | {"relaxed_Nm": remembered})
        arrays = (executor.array("qp_f"), executor.array("qp_H"), executor.state["plan"])
        found.append([np.array(a).ravel() for a in arrays])
    for hand, hot, usual in zip(*found, strict=True):
        size = np.abs(hand).max()
        assert np.abs(hot - hand).max() < 1e-9 * size
        assert np.abs(usual - hand).max() > 1e-4 * size  # armed


# Energy.


@pytest.mark.parametrize("temperature_C", [10.0, 23.0, 40.0])
def test_no_path_at_a_constant_temperature_gives_energy(warm, temperature_C):
    rng = np.random.default_rng(5)
    runner = compile_device(warm, "f64").block("sensor")
    for _ in range(6):
        x = path_of([*rng.uniform(-0.2, 0.2, 6), 0.0], 400)
        runner.prepare({"temperature_C": temperature_C})
        out, _ = runner.run({"theta_rad": x, "omega_rad_s": 0 * x}, trace=False)
        torque = out["tau_Nm"] - OFFSET_Nm
        steps = 0.5 * (torque[1:] + torque[:-1]) * np.diff(x)
        assert np.cumsum(steps).min() >= -1e-4 * np.abs(steps).sum()


def test_a_change_under_load_gives_its_share_of_the_stored_energy(elbow):
    """A spring of 5 Nm/rad, bent at 40 degC and let go at 10: |dg| k x^2 / 2 comes out."""
    bent = FittedMember(Member("one", "one", (Term("spring", Rise("power", 1)),)), 0.2, (1.0,))
    sensor = family_device(elbow, replace(bent, temperature=WARM), "drawn").sensor
    x = np.linspace(0, 0.2, 401)

    def work(path: np.ndarray, temperature_C: float) -> float:
        runner = sensor.simulator({"temperature_C": temperature_C})
        torque = runner.run({"theta_rad": path, "omega_rad_s": 0 * path})[0]["tau_Nm"].ravel()
        return float(np.trapezoid(torque, path))

    given = -work(x[::-1], 10.0) - work(x, 40.0)
    assert given == pytest.approx(0.004 * 30 * 0.5 * 5.0 * 0.2**2, rel=1e-9)


# The device file.


def test_what_is_written_is_read_back(warm):
    again = parse_device(warm.toml(), "again.toml")
    assert again.digest == warm.digest
    assert fitted_of(again).temperature == WARM
    assert conforms(tomllib.loads(warm.toml()), json_schema()) == []
    knob = dict(warm.system.tunables)["sensor"]
    assert (knob.default, knob.low, knob.high, knob.unit) == (23.0, 10.0, 40.0, "degC")
    for outside in (9.9, 40.1):
        with pytest.raises(ValueError, match="temperature_C"):
            warm.sensor.simulator({"temperature_C": outside})


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_an_fmu_knows_that_0_degC_is_no_0_K(warm, fmi):
    text = make_fmu(block_model(warm, "sensor"), fmi).files["modelDescription.xml"].decode()
    assert '<BaseUnit K="1" offset="273.15"/>' in text
    assert 'unit="degC"' in text


@pytest.mark.parametrize(
    ("was", "now", "parts"),
    [
        (
            "reference_C = { value = 23.0",
            "reference_C = { value = 41.0",
            ["family.temperature.reference_C = 41 degC is outside", "10 to high_C = 40"],
        ),
        (
            "low_C = { value = 10.0",
            "low_C = { value = 40.0",
            ["family.temperature.high_C = 40 degC is not above", "low_C = 40"],
        ),
        (
            "per_K = { value = -0.004",
            "per_K = { value = -0.048",
            ["per_K = -0.048 1/K makes the factor 0.184 at 40 degC", "below its limit 0.2"],
        ),
        (
            "per_K = { value = -0.004",
            "per_K = { value = 0.06",
            ["family.temperature.per_K = 0.06 1/K is above its limit 0.05"],
        ),
        (
            "high_C = { value = 40.0",
            "high_K = { value = 40.0",
            ["family.temperature.high_K", "high_C"],
        ),
    ],
)
def test_a_wrong_factor_is_refused_with_its_place(warm, was, now, parts):
    text = warm.toml()
    assert was in text
    said = refused(text.replace(was, now))
    for part in parts:
        assert part in said, said
