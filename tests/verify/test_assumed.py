"""Assumptions of error bounds: joints at their ends, clips, a search."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.language.stream import Stream, single
from esea_gen.observe.human import extended_state
from esea_gen.verify import equivalence
from esea_gen.verify.bounds import PORT_RANGES, bounds_or_rule, steps_beyond
from esea_gen.verify.runs import run_symbolic
from esea_gen.verify.streams import streams
from esea_gen.verify.verdict import ONE_STEP

NAME = "human_eso"
# Rests at, and next to, an end.
BESIDE_rad = (0.0, 1e-4, 3e-4, 5e-4, 1e-3)


@pytest.fixture(scope="module")
def block(drive):
    return extended_state(drive)


def at_rest(theta_rad, tau_Nm, steps=1500):
    """The joint stands still; the torque on it is there from the first step on."""
    theta = single(np.full(steps, theta_rad))
    return Stream("at rest", {"theta_load_rad": theta, "tau_Nm": single(np.full(steps, tau_Nm))})


def bit(block, name):
    return 1 << [f.name for f in block.status_port.flags].index(name)


# -- the person's torque, with the joint at an end -------------------------------------------------


@pytest.mark.parametrize("tau_Nm", [4.0, -4.0])
@pytest.mark.parametrize("beside", BESIDE_rad)
def test_at_an_end_the_estimate_is_what_it_is_anywhere_else(block, tau_Nm, beside):
    """The observer's equations know no angle, only differences of it."""
    port = block.inputs[0]
    middle, _ = run_symbolic(block, at_rest(1.0, tau_Nm))
    for end, inwards in ((port.low, 1), (port.high, -1)):
        y, _ = run_symbolic(block, at_rest(np.float64(end + inwards * beside), tau_Nm))
        for name in ("omega_load_rad_s", "tau_h_Nm", "tau_h_rate_Nm_s"):
            assert y[name] == pytest.approx(middle[name], abs=1e-8), name
        assert not np.any(y["status"])
        # It has learnt that the person holds the joint.
        assert abs(y["omega_load_rad_s"][-1]) < 1e-9
        assert y["tau_h_Nm"][-1] == pytest.approx(-tau_Nm, abs=1e-9)


def test_no_valid_sample_lets_a_clip_of_the_angle_act(block):
    """Whatever is drawn from the port's range: its ends in turn, and the fastest motion."""
    flag = bit(block, "ANGLE_CLIPPED")
    (theta, tau), steps = block.inputs, 4000
    rng = np.random.default_rng(2)
    ends = np.where((np.arange(steps) // 7) % 2, theta.high, theta.low)
    wild = rng.choice([theta.low, theta.high, 1.0], steps)
    for angle in (ends, wild, np.full(steps, theta.high), np.full(steps, theta.low)):
        for torque in (np.full(steps, tau.high), rng.choice([tau.low, tau.high], steps)):
            y, _ = run_symbolic(
                block, Stream("valid", {"theta_load_rad": angle, "tau_Nm": torque}, rough=True)
            )
            assert not np.any(y["status"].astype(int) & flag)


@pytest.mark.parametrize(("end", "way"), [("high", 1.0), ("low", -1.0)])
def test_unseen_the_angle_rests_at_its_end_and_comes_back(block, end, way):
    port = block.inputs[0]
    start, rate = getattr(port, end) - way * 0.5, 2.0  # rad, rad/s: 0.25 s to the end
    theta = single(start + way * rate * 1e-3 * np.arange(200))
    angle = np.concatenate([theta, np.full(600, np.nan), np.full(900, getattr(port, end))])
    stream = Stream("unseen", {"theta_load_rad": angle, "tau_Nm": 0 * angle}, rough=True)
    y, s = run_symbolic(block, stream)
    rests = np.flatnonzero(y["status"].astype(int) & bit(block, "ANGLE_CLIPPED") != 0)
    assert 200 < rests[0] < 400
    assert rests[-1] < 800
    # The rate goes with the angle: both rest, and the angle within a step's room of the port's end.
    after = slice(rests[0] + 1, 800)
    assert np.all(way * y["omega_load_rad_s"][after] <= 1e-12)
    assert np.all(np.abs(s["theta_rad"][after] - getattr(port, end)) < 0.1)
    # Seen again, at rest at the end: the estimate comes to rest there.
    assert abs(y["omega_load_rad_s"][-1]) < 1e-9
    assert y["theta_load_est_rad"][-1] == pytest.approx(getattr(port, end), abs=1e-9)


# -- what verify observes --------------------------------------------------------------------------


def test_verify_fails_when_an_assumption_is_broken(drive, block, monkeypatch):
    """Twice as fast as the rate's range: a clip of the rate acts."""
    port = block.inputs[0]
    limit = next(p.high for p in block.outputs if p.name == "omega_load_rad_s")

    def own(rough):
        theta = single(port.low + np.minimum(1e-3 * 2 * limit * np.arange(150), 3.0))
        return Stream("too fast", {"theta_load_rad": theta, "tau_Nm": 0 * theta}, rough=rough)

    def verified(rough):
        generated = streams(block)[:3]
        monkeypatch.setattr(equivalence, "streams", lambda *_: [*generated, own(rough)])
        found = equivalence.verify(drive, ["f32"], blocks=[NAME])
        return found, found.comparisons[-1]

    found, fast = verified(rough=False)
    assert not found.passed
    assert fast.beyond > 50
    assert any("no clip of a state acts" in text for text in fast.problems)
    # Declared: judged step by step, and said so.  But then no stream tries the bound.
    found, fast = verified(rough=True)
    assert fast.passed
    assert fast.rule == ONE_STEP
    assert all(c["steps_beyond_the_bounds_assumptions"] > 0 for c in found.to_dict()["comparisons"])
    assert not found.passed
    assert any("was not tested" in text for text in found.comparisons[0].problems)


def test_a_step_of_another_matrix_is_counted(drive, block):
    """A closed form: so many invalid samples, so many steps that only predict."""
    bounds, _ = bounds_or_rule(drive, block)
    theta = single(np.full(300, 1.0))
    theta[[0, 1, 50, 51, 200]] = np.nan  # the first two are before anything was seen
    stream = Stream("gaps", {"theta_load_rad": theta, "tau_Nm": 0 * theta})
    _, states = run_symbolic(block, stream)
    assert steps_beyond(block, bounds[PORT_RANGES], stream, states) == 3
