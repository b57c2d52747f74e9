"""Softer gains of the sliding mode while its error swings."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import signal

from esea_gen.control.sliding_mode.controller import sliding_mode
from esea_gen.studies.off_table import SWINGING_NM
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy, simulate_case
from tests.control.test_sliding_mode import TS, bits, inputs_of


def softness(block, error: np.ndarray, **tunables: float) -> np.ndarray:
    """How soft the gains are, after each step with that error."""
    simulator, out = block.simulator(tunables), []
    for e in error:
        simulator.step(**inputs_of(block, delta_set_rad=float(e)))
        out.append(float(np.squeeze(simulator.state["soft"])))
    return np.array(out)


def test_what_counts_as_a_swing(drive):
    """Two high-passes of 4 Hz, by SciPy from their definition; RMS of 3.5 to 3.9 mrad."""
    block = sliding_mode(drive)
    t = np.arange(1600) * TS
    kept = math.exp(-2 * math.pi * 4 * TS)
    b, a = signal.zpk2tf([1, 1], [kept, kept], kept**2)
    window = 1 - math.exp(-TS / 0.5)
    seen = []
    for Hz, size in itertools.product((0.6, 1.0, 4.0, 6.0), (0.004, 0.007, 0.02, 0.08)):
        error = size * np.sin(2 * np.pi * Hz * t)
        fast = np.clip(signal.lfilter(b, a, error), -0.0065, 0.0065)
        square = signal.lfilter([window], [1, window - 1], fast**2)
        asked = np.clip((square - 3.5e-3**2) / (3.9e-3**2 - 3.5e-3**2), 0, 1)
        expected = [0.0]
        for x in asked[1:]:
            expected.append(max(x, expected[-1] * math.exp(-TS / 60)))
        assert softness(block, error) == pytest.approx(np.array(expected), abs=1e-6)
        seen.append((Hz, size, bool(expected[-1] > 0.5)))
    swings = [(Hz, size) for Hz, size, soft in seen if soft]
    assert swings == [(4.0, 0.02), (4.0, 0.08), (6.0, 0.02), (6.0, 0.08)]


def test_a_step_softens_nothing_and_a_swing_is_forgotten(drive):
    block = sliding_mode(drive)
    t = np.arange(400) * TS
    assert not softness(block, np.concatenate([np.zeros(50), 0.04 * np.exp(-t / 0.1)])).any()
    swing = 0.02 * np.sin(2 * np.pi * 6 * t)
    found = softness(block, np.concatenate([swing, np.zeros(4000)]))
    assert found[399] == 1
    assert found[1000] < 1
    # A time constant of 60 s.
    assert found[3000] / found[1000] == pytest.approx(math.exp(-2000 * TS / 60), rel=1e-6)
    assert not softness(block, swing, softening=0.0).any()
    assert softness(block, swing, softening=0.5)[-1] == 0.5
    # Off and on again, nothing is left of it.
    simulator = block.simulator()
    for e in swing:
        y = simulator.step(**inputs_of(block, delta_set_rad=float(e)))
    assert y["status"] & bits(block).SOFTENED
    simulator.step(**inputs_of(block, mode=0.0))
    assert not simulator.step(**inputs_of(block))["status"] & bits(block).SOFTENED


# Random plants with everything off at once, on which the gains as they are make a swing.
LIGHT_AND_LATE = (0, 16, 36, 71)


RANDOM = {
    **{"controller": "smc", "plant": "random", "person": "none", "real": "f32"},
    "off": "random",
}


def test_light_and_late_drives_do_not_swing(drive):
    case = load_study("tuning", ClosedLoopStudy).cases()[0]
    above = {}
    for softening in (0.0, 1.0):
        tunables = {"smc": {"softening": softening}}
        above[softening] = [
            simulate_case("tuning", case.name, k, tunables=tunables, **RANDOM)["rms_above_4Hz_Nm"]
            for k in LIGHT_AND_LATE
        ]
    assert min(above[0.0]) > SWINGING_NM > max(above[1.0])
