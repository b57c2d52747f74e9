"""A Block that also gives out what it reads or makes: the same steps, and the numbers asked for."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.reference import reference
from esea_gen.control.shown import (
    gains_reference,
    shown_reference,
    with_outputs,
    with_state_as_output,
)
from esea_gen.language.ports import Port

GIVEN = {
    "tau_desired_Nm": 1.5,
    "theta_desired_rad": 0.7,
    "omega_desired_rad_s": -0.3,
    "theta_load_rad": 0.4,
    "omega_load_rad_s": 0.2,
    "tau_Nm": 0.25,
    "wish_gain": 1.1,
    "wish_shift_Nm": 0.05,
}
TUNED = {"Kp_Nm_rad": 2.0, "Kd_Nms_rad": 0.3, "tau_range_Nm": 3.0, "blend_s": 0.5}


def one_step(block, mode=2.0):
    simulator = block.simulator(TUNED)
    return simulator.step(**GIVEN, mode=mode), simulator.state


@pytest.fixture(scope="module")
def plain(drive):
    return reference(drive)


def test_a_reference_shows_its_gains_and_does_the_same(plain):
    shown = gains_reference(plain)
    own, state = one_step(plain)
    found, kept = one_step(shown)
    more = {n: found.pop(n) for n in ("stiffness_Nm_rad", "damping_Nms_rad")}
    assert more == pytest.approx({"stiffness_Nm_rad": 2.0, "damping_Nms_rad": 0.3}, rel=1e-6)
    assert found == own
    assert {k: v.tolist() for k, v in kept.items()} == {k: v.tolist() for k, v in state.items()}
    ports = [(p.name, p.low, p.high) for p in shown.outputs[len(plain.outputs) :]]
    assert ports == [
        ("stiffness_Nm_rad", 0, pytest.approx(3.0)),
        ("damping_Nms_rad", 0, pytest.approx(0.35)),
    ]
    assert shown.outputs[: len(plain.outputs)] == plain.outputs


def test_a_reference_shows_what_a_horizon_needs(plain):
    """A wish of 1.5 Nm is one of 1.7 Nm of the rubber at hand; a spring pulls 0.6 Nm beside."""
    shown = shown_reference(plain)
    found, _ = one_step(shown)
    keep = np.exp(-0.001 / 0.5)
    law = 1.7 + 2.0 * 0.3 + 0.3 * -0.5
    assert {p.name: float(found[p.name]) for p in shown.outputs[len(plain.outputs) :]} == {
        "offset_Nm": pytest.approx(0.25 - law),
        "keep": pytest.approx(keep),
        "tau_range_Nm": pytest.approx(3.0),
        "Kp_Nm_rad": pytest.approx(2.0),
        "Kd_Nms_rad": pytest.approx(0.3),
        "tau_wanted_Nm": pytest.approx(1.7),
        "theta_wanted_rad": pytest.approx(0.7),
        "omega_wanted_rad_s": pytest.approx(-0.3),
    }
    ranges = {p.name: (p.low, p.high) for p in plain.inputs}
    for p in shown.outputs:
        if "wanted" in p.name:
            assert (p.low, p.high) == ranges[p.name.replace("wanted", "desired")]


def test_an_output_needs_a_source_of_its_size_and_a_name_of_its_own(plain):
    for port, source in (
        (Port("a_Nm", -1, 1, "not there"), "next_nothing"),
        (Port("a_Nm", -1, 1, "of another size", 2), "next_offset_Nm"),
        (Port("mode", -1, 1, "taken"), "next_offset_Nm"),
    ):
        with pytest.raises(ValueError, match=f"no {source} of size {port.size}"):
            with_outputs(plain, [(port, source)])
    one = (Port("a_Nm", -99, 99, "once"), "next_offset_Nm")
    with pytest.raises(ValueError, match="the name a_Nm"):
        with_outputs(plain, [one, one])
    with pytest.raises(ValueError, match="no state nothing"):
        with_state_as_output(plain, "nothing", "")


def test_an_input_and_a_coefficient_are_shown_as_they_are_read(plain):
    more = [
        (Port("b_Nm", -99, 99, "an input"), "label_tau_adapted_Nm"),
        (Port("c", 0, 1, "a coefficient"), "c_keep"),
        (Port("d_Nm", -99, 99, "a state"), "next_tau_set_Nm"),
    ]
    found, _ = one_step(with_outputs(plain, more), mode=1.0)
    assert (found["b_Nm"], found["c"]) == pytest.approx((1.7, np.exp(-0.002)))
    assert found["d_Nm"] == found["tau_set_Nm"] == pytest.approx(0.25)
