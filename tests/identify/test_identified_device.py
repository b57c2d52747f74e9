"""Ranges and limits of an identified device, from a recording in closed form."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, Decimal

import numpy as np
import pytest

from esea_gen.device import with_numbers
from esea_gen.identify import load_mapping, load_recordings
from esea_gen.identify.drafting import draft, fitted_device
from esea_gen.identify.published.fit import Fit
from esea_gen.identify.published.plant import FittedPlant
from esea_gen.identify.published.space import place_of
from tests.rigs import written

HZ, CYCLES = 2.5, 6
TRAINED_DEG, SKIPPED_DEG, TORQUE_Nm = 5.0, 8.0, 0.7


def drafted(folder, fs_Hz=1000.0, factor=1.5, rate=False, scale=1.0):
    """First cycle wider than those that train; torque in step with the deflection."""
    t = np.arange(round(CYCLES * fs_Hz / HZ) + 1) / fs_Hz
    amplitude = np.where(t < 1 / HZ, SKIPPED_DEG, TRAINED_DEG) * scale
    x = amplitude * np.sin(2 * np.pi * HZ * t)
    y = TORQUE_Nm / TRAINED_DEG * x + 0.05 * np.cos(2 * np.pi * HZ * t)
    path = written(
        folder,
        *(t, x, y),
        ('unit = "rad"', 'unit = "deg"'),
        ("rate_terms = false", f"rate_terms = {str(rate).lower()}\nlimit_factor = {factor}"),
        ("[[rec", "[cycles]\nskip_first = 1\nhold_out_last = 1\n[[rec"),
    )
    source = load_mapping(path)
    recordings = load_recordings(source)
    return source, recordings, draft(source, recordings, rate)


def ceiled(x: float) -> float:
    """Two digits, never less."""
    exact = Decimal(repr(round(x, 12)))
    return float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - 1), ROUND_CEILING))


@pytest.mark.parametrize(("fs_Hz", "samples"), [(1000.0, 20), (100.0, 5), (400.0, 8)])
def test_ranges_of_a_draft_hold_the_recording(tmp_path, fs_Hz, samples):
    _, recordings, device = drafted(tmp_path, fs_Hz)
    file, trained = device.file, math.radians(TRAINED_DEG)
    assert file.domain.theta_max_rad.value == pytest.approx(trained, rel=2e-3)
    # The largest change over 20 ms, but five samples at least: a chord of the sine at its middle.
    span_s = samples / fs_Hz
    rate = 2 * trained * math.sin(math.pi * HZ * span_s) / span_s
    assert file.domain.omega_max_rad_s.value == pytest.approx(rate, rel=5e-3)
    largest = float(np.abs(recordings[0].tau_Nm).max())
    assert largest == pytest.approx(
        math.hypot(SKIPPED_DEG / TRAINED_DEG * TORQUE_Nm, 0.05), rel=1e-3
    )
    assert file.domain.tau_full_scale_Nm.value == pytest.approx(largest)
    # Limits hold all of it, what does not train too.
    assert file.limits.theta_rad.value == ceiled(1.5 * math.radians(SKIPPED_DEG))
    assert file.limits.tau_Nm.value == ceiled(1.5 * largest)
    assert file.limits.omega_rad_s.value == 25.0


def test_limits_follow_their_factor_and_the_rate(tmp_path):
    _, recordings, device = drafted(tmp_path, 1000.0, factor=4.0, scale=5.7)
    limits, domain = device.file.limits, device.file.domain
    assert limits.theta_rad.value == 3.2  # as wide as a device file may have it
    assert limits.omega_rad_s.value == ceiled(4.0 * domain.omega_max_rad_s.value)
    assert 25.0 < limits.omega_rad_s.value < 40.0
    assert limits.tau_Nm.value == ceiled(4.0 * float(np.abs(recordings[0].tau_Nm).max()))


def values_of(**changed: float) -> dict[str, float]:
    return {
        "k1_Nm_rad": 12.0,
        "k3_Nm_rad3": 90.0,
        "alpha_Nm_rad": 40.0,
        "beta_1_rad": 7.0,
        "omega_rad": 0.03,
    } | changed


@pytest.mark.parametrize("largest_rate_Nm", [0.0, 3.0])
@pytest.mark.parametrize(
    "changed", [{}, {"k1_Nm_rad": 60.0, "omega_rad": 0.1}, {"alpha_Nm_rad": 0.0}]
)
def test_a_fitted_devices_limit_is_what_its_model_gives_from_end_to_end(
    tmp_path, changed, largest_rate_Nm
):
    """The model itself, first at one end of the deflection, then at the other."""
    source, recordings, template = drafted(tmp_path)
    values = values_of(**changed)
    fit = Fit(values, 1e-3, 8, 8, 1.0)
    device = fitted_device(source, recordings, template, fit, largest_rate_Nm)
    theta = template.file.limits.theta_rad.value * (1 - 1e-7)  # inside in single precision too
    free = with_numbers(
        template, {place_of(k): v for k, v in values.items()} | {"limits.tau_Nm": 1000.0}
    ).sensor.simulator()
    free.step(theta_rad=-theta, omega_rad_s=0.0)
    reach = free.step(theta_rad=theta, omega_rad_s=0.0)["tau_Nm"] + 1.5 * largest_rate_Nm
    assert float(reach) > template.file.limits.tau_Nm.value
    assert device.file.limits.tau_Nm.value == ceiled(float(reach))
    assert device.file.limits.theta_rad == template.file.limits.theta_rad
    found = dict(device.quantities())
    for key, v in values.items():
        assert (found[f"elastomer.{key}"].value, found[f"elastomer.{key}"].status) == (
            v,
            "identified",
        )


@pytest.mark.parametrize("rate", [False, True])
def test_the_torque_is_the_sum_of_its_parts_times_their_stiffness(tmp_path, rate):
    """Two ways through the C: all parameters at once, and each part alone with a stiffness of 1."""
    _, recordings, template = drafted(tmp_path, 200.0, rate=rate)
    plant = FittedPlant(template, recordings, 200.0 if rate else None)
    stiff = {"k1_Nm_rad": 12.0, "k3_Nm_rad3": 90.0, "alpha_Nm_rad": 40.0}
    shape = {"beta_1_rad": 7.0, "omega_rad": 0.03}
    whole = shape | stiff
    if rate:
        # The viscosity of a unit stiffness; that of kv is so many times it.
        viscous = {"A_Nms_rad": 0.8, "m": 0.7, "eps1_Nms_rad": 0.05, "B": 1.5, "n": 0.4}
        shape |= viscous | {"eps2": 1.0}
        stiff["kv_Nm_rad"] = kv = 5.0
        scaled = {k: kv * viscous[k] for k in ("A_Nms_rad", "eps1_Nms_rad")}
        whole |= shape | scaled | {"kv_Nm_rad": kv}
    basis = plant.basis(shape)
    torque = plant.torque(whole)
    np.testing.assert_allclose(basis @ list(stiff.values()), torque, atol=1e-9)
    assert np.all(np.abs(basis).max(axis=0) > 1e-4)
    assert np.linalg.matrix_rank(basis) == len(stiff)
    # Only what trains: four whole cycles of 5 degrees, from peak to peak.
    trained = np.concatenate([s.theta_rad[at] for s in plant.streams for at in s.training])
    assert len(trained) == len(plant.measured) == len(torque)
    assert np.abs(trained).max() == pytest.approx(math.radians(TRAINED_DEG), rel=2e-3)
    np.testing.assert_allclose(basis[:, 0], trained)
