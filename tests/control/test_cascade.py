"""Cascade control: properties of its step, and closed loop."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.model.rubber import stiffness_range_Nm_rad
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy, default_person
from esea_gen.twin.case import Setting
from esea_gen.twin.judge import judge
from esea_gen.twin.run import run_case
from tests.conftest import ROOT, without

ON = {"mode": 1.0}


@pytest.fixture(scope="module")
def law():
    return load_device("elbow_drive", "cascade").system.blocks["cascade"]


def steady(law, tau_Nm: float = 0.0, **others: float) -> dict[str, float]:
    """Step with the drive at rest, the torque as desired and the motor giving what it must."""
    u_Nm = tau_Nm / 74
    still = {p.name: 0.0 for p in law.inputs} | {"u_a_Nm": u_Nm, "u_applied_Nm": u_Nm}
    return still | ON | {"tau_set_Nm": tau_Nm, "tau_Nm": tau_Nm} | others


@pytest.mark.parametrize("tau_Nm", [-4.0, -0.3, 0.0, 2.0])
def test_at_rest_the_motor_holds_the_torque_through_its_gear(law, tau_Nm):
    # The person holds against it, so that the load does not accelerate.
    given = steady(law, tau_Nm, tau_h_Nm=-tau_Nm)
    assert law.simulator().step(**given)["u_command_Nm"] == pytest.approx(tau_Nm / 74, abs=1e-9)


def test_a_disturbance_is_taken_off_and_every_sign_is_treated_alike(law):
    quiet = law.simulator({"lead": 1.0}).step(**steady(law))["u_command_Nm"]
    pushed = law.simulator({"lead": 1.0}).step(**steady(law, d4_rad_s2=2.0))["u_command_Nm"]
    assert (quiet, pushed) == (0.0, pytest.approx(-0.663 * 2.0 / 74))
    rng = np.random.default_rng(1)
    here, there = law.simulator(), law.simulator()
    for _ in range(200):
        given = {p.name: 0.1 * p.high * rng.uniform(-1, 1) for p in law.inputs if p.low < 0}
        mirrored = {k: -v for k, v in given.items()}
        one, other = (
            s.step(**ON, governed=1.0, **x) for s, x in ((here, given), (there, mirrored))
        )
        assert one["u_command_Nm"] == -other["u_command_Nm"]


def test_the_coupling_schedules_the_gain(law):
    soft, stiff = stiffness_range_Nm_rad(load_device("elbow_drive"))

    def per_Nm(tau_Nm: float) -> float:
        # What an error adds, less what it is worth as torque.
        step = [
            law.simulator({"lead": 1.0, "integral_1_s2": 0.0}).step(
                **steady(law, tau_Nm, tau_h_Nm=-tau_Nm) | {"tau_set_Nm": tau_Nm + e}
            )["u_command_Nm"]
            for e in (0.0, 1e-4)
        ]
        return 74 * (step[1] - step[0]) / 1e-4 - 1

    gains = [per_Nm(tau) for tau in (0.0, 1.5, 3.0, 4.2)]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 2 * gains[-1]
    # kp (J kv + f) / kappa about rest, friction's slope f = fv + fc / w with it.
    about = 20 * (0.663 * 14 + 0.5551 + 0.4688 / 0.05)
    assert about / stiff < gains[-1] < gains[0] < about / soft


def test_the_integral_rests_while_the_command_is_held_back(law):
    def grown(steps: int, **given: float) -> float:
        held = law.simulator()
        for _ in range(steps):
            held.step(**steady(law, 0.5) | {"tau_set_Nm": 0.6} | given)
        return held.state["integral_Nm_s"].item()

    # The limits let nothing through: from the second period on that is known.
    assert grown(100, u_applied_Nm=0.0) == pytest.approx(10 * 0.1 * 0.005)
    assert grown(100, mode=2.0) == 0.0
    # 0.1 Nm for 100 periods, where what is asked for is what is given.
    free = law.simulator()
    u_Nm = 0.0
    for _ in range(100):
        out = free.step(**steady(law, 0.5) | {"tau_set_Nm": 0.6, "u_applied_Nm": u_Nm})
        u_Nm = out["u_command_Nm"]
    assert free.state["integral_Nm_s"].item() == pytest.approx(10 * 0.1 * 0.5)
    for bad in ({"tau_Nm": float("nan")}, {"mode": 0.0}):
        assert free.step(**steady(law, 0.5) | bad)["u_command_Nm"] == 0.0
        assert free.state["integral_Nm_s"].item() == 0.0


def test_it_asks_for_the_motors_own_encoder(tmp_path):
    text = (ROOT / "esea_gen" / "devices" / "elbow_drive.toml").read_text()
    bare = tmp_path / "bare.toml"
    bare.write_text(
        without(text, "redundancy", "cable").replace('name = "elbow_drive"', 'name = "bare"')
    )
    assert "smc" in load_device(bare).system.blocks
    with pytest.raises(UserError, match=r"\[redundancy\] is missing: cascade control needs"):
        _ = load_device(bare, "cascade").system


@pytest.mark.parametrize(
    ("study", "case", "most_Nm"),
    [("tuning", "1.7 Nm 0.6 Hz", 0.04), ("grid", "3 Nm 1 Hz", 0.1), ("bread", "0 Nm", 0.045)],
)
def test_it_follows_on_a_plant_that_it_was_not_tuned_on(study, case, most_Nm):
    found = load_study(study, ClosedLoopStudy).case(case)
    run = run_case(found, Setting("cascade", "real", default_person(study, "real")), 11)
    figures = judge(found, run, 0.221)
    assert figures["rms_true_Nm"] < most_Nm  # medians of five other seeds: 0.032, 0.08, 0.030
    assert figures["fault"] == figures["unstable"] == 0
