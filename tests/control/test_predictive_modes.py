"""Linear modes of predictive control with a hand, against the emitted C in the time domain."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from esea_gen.analysis.passivity import Hand
from esea_gen.device import load_device
from esea_gen.studies.passivity.push import push_case
from esea_gen.twin.case import Setting
from esea_gen.twin.run import run_case
from tests.benchmarks.predictive_modes import SLOW_HZ, Controller, Plant


@pytest.fixture(scope="module")
def controller() -> Controller:
    # The damping that the passivity Block adds to these swings, on average.
    return Controller((0.0, 0.175))


def swing_in_c(inertia_kgm2: float, damping_Nms_rad: float, spring_Nm_rad: float):
    """Growth (1/s) and frequency (Hz) of a pushed hand's swing: ideal plant, f32 C."""
    hand = Hand("hand", inertia_kgm2, damping_Nms_rad, spring_Nm_rad)
    case = push_case(load_device("elbow_mpc"), hand, 0.0, 0.0)
    angle = run_case(case, Setting("mpc-no-preview", "ideal", "ideal"), 0)["theta_l_rad"][1300:3900]
    angle = angle - np.mean(angle)
    ups = np.nonzero((angle[:-1] < 0) & (angle[1:] >= 0))[0]
    peaks = [np.max(angle[a:b]) for a, b in itertools.pairwise(ups)]
    return np.polyfit(ups[:-1] * 1e-3, np.log(peaks), 1)[0], 1e3 / np.mean(np.diff(ups))


@pytest.mark.parametrize("hand", [(0.1, 0.0, 30.0), (0.1, 0.0, 1000.0), (0.2, 0.5, 100.0)])
def test_a_hand_swings_in_the_emitted_c_as_predicted(controller, hand):
    inertia, damping, spring = hand
    growth, frequency_Hz = controller.modes(Plant(20.0, 1e4, inertia, damping, spring))
    seen_growth, seen_Hz = swing_in_c(*hand)
    i = int(np.argmin(np.abs(frequency_Hz - seen_Hz) + 1e3 * (growth < -5)))
    assert frequency_Hz[i] == pytest.approx(seen_Hz, rel=0.03)
    # Friction at rest and the rubber's hysteresis, which the linear plant leaves out, only damp.
    assert growth[i] - 0.6 < seen_growth < growth[i] + 0.1


def test_the_derivatives_do_not_depend_on_the_differences(controller):
    other = Controller((0.0, 0.175), amplitude=1e-5)
    plant = Plant(20.0, 150.0, 0.2, 0.5, 10.0)
    fastest = [max(g[f > SLOW_HZ]) for g, f in (c.modes(plant) for c in (controller, other))]
    assert fastest[0] == pytest.approx(fastest[1], abs=0.02)
    assert fastest[0] < 0
