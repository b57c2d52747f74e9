"""Cases written for the elbow, in another device's torques and range of motion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.device import load_device, with_numbers
from esea_gen.studies.registry import studies
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.studies.tracking import ImpedanceStudy, Twists
from esea_gen.twin.controllers import largest_torque_Nm

DRIVE = load_device("elbow_drive")
SCALING = [study for study in studies(ClosedLoopStudy).values() if study.scales]


@pytest.mark.ci
@pytest.mark.parametrize("study", SCALING, ids=lambda study: study.name)
@settings(max_examples=8)
@given(st.floats(0.3, 5), st.floats(-2, 1), st.floats(0.3, 3))
def test_no_case_asks_for_more_of_a_device_than_of_the_elbow(study, torque, low, room):
    numbers = {"safety.rom_min_rad": low, "safety.rom_max_rad": low + room}
    numbers["domain.tau_full_scale_Nm"] = full = torque * DRIVE.tau_full_scale_Nm
    cases = study.of(with_numbers(DRIVE, numbers)).cases_run()
    for case, elbows in zip(cases, study.of(DRIVE).cases_run(), strict=True):
        path, written = case.trajectory, elbows.trajectory
        asked, share = np.max(np.abs(written.tau_desired_Nm)), full / DRIVE.tau_full_scale_Nm
        assert np.max(np.abs(path.tau_desired_Nm)) == pytest.approx(share * asked)
        assert low <= path.theta_p_rad.min() <= path.theta_p_rad.max() <= low + room
        assert np.ptp(path.omega_p_rad_s) <= np.ptp(written.omega_p_rad_s) * (1 + 1e-9)
        assert elbows.name in study.case(elbows.name).name  # as it is written


def test_cable_gains_and_motor_limit_are_the_devices_own():
    numbers = {"redundancy.cable_Nm_rad": 1500.0, "domain.tau_full_scale_Nm": 44.7}
    device = with_numbers(DRIVE, numbers | {"safety.u_max_Nm": 0.1})
    twists = Twists().of(device).cases_run()
    assert {c.plant["cable_stiffness_Nm_rad"] for c in twists} == {1350.0, 1500.0, 1700.0}
    gains = [c.tunables["reference"] for c in ImpedanceStudy().of(device).cases_run()]
    assert max(g["Kp_Nm_rad"] for g in gains) == 3.0
    assert largest_torque_Nm(device) == 0.1
