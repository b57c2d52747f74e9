"""Cases written for the elbow, in another device's torques and range of motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.device import load_device, with_numbers
from esea_gen.studies.registry import load_study, studies
from esea_gen.studies.simulation import ClosedLoopStudy

DRIVE = load_device("elbow_drive")
FULL_NM = DRIVE.tau_full_scale_Nm
SCALING = [name for name, study in studies(ClosedLoopStudy).items() if study.scales]


def cases_on(name, **numbers):
    device = with_numbers(DRIVE, {k.replace("__", "."): v for k, v in numbers.items()})
    return load_study(name, ClosedLoopStudy).of(device).cases_run()


@pytest.mark.parametrize("name", SCALING)
@settings(max_examples=8)
@given(st.floats(0.3, 5), st.floats(-2, 1), st.floats(0.3, 3))
def test_no_case_asks_for_more_of_a_device_than_of_the_elbow(name, torque, low, room):
    given = cases_on(
        name,
        domain__tau_full_scale_Nm=torque * FULL_NM,
        safety__rom_min_rad=low,
        safety__rom_max_rad=low + room,
    )
    for case, elbows in zip(given, cases_on(name), strict=True):
        path, as_written = case.trajectory, elbows.trajectory
        asked = np.max(np.abs(path.tau_desired_Nm)) / (torque * FULL_NM)
        assert asked == pytest.approx(np.max(np.abs(as_written.tau_desired_Nm)) / FULL_NM)
        assert low <= path.theta_p_rad.min() <= path.theta_p_rad.max() <= low + room
        # The angle still is what the rate adds up to.
        assert np.ptp(path.omega_p_rad_s) <= np.ptp(as_written.omega_p_rad_s) * (1 + 1e-9)
        moved = np.ptp(path.theta_p_rad) * np.ptp(as_written.omega_p_rad_s)
        assert moved == pytest.approx(np.ptp(as_written.theta_p_rad) * np.ptp(path.omega_p_rad_s))


@pytest.mark.parametrize("name", SCALING)
def test_the_elbow_runs_them_as_they_are_written(name):
    for run, written in zip(cases_on(name), load_study(name, ClosedLoopStudy).cases(), strict=True):
        assert run.name == written.name
        assert np.array_equal(run.trajectory.theta_p_rad, written.trajectory.theta_p_rad)
