"""The limits with every tunable narrowed, and energy windows that no slot divides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.control.limits.block import limits
from tests import limits_model as model

# What a tunable narrows, in the words of the plain state machine.
WORDS = {
    "u_max_Nm": "u",
    "tau_max_Nm": "tau",
    "theta_max_rad": "theta",
    "rom_min_rad": "low",
    "rom_max_rad": "high",
    "omega_max_rad_s": "omega",
    "energy_max_J": "energy",
}
# Float32 numbers, so that all formats hold the same; 1 rad, where the calm stream is, stays inside.
NARROW = {
    "u_max_Nm": (0.03125, 0.125, 0.1875),
    "u_rate_Nm_s": (4.0, 16.0, 32.0),
    "tau_max_Nm": (2.0, 4.5, 7.625),
    "theta_max_rad": (0.125, 0.25),
    "rom_min_rad": (0.25, 0.75),
    "rom_max_rad": (1.25, 2.0),
    "omega_max_rad_s": (1.0, 4.0, 8.0),
    "energy_max_J": (0.25, 2.0, 8.0),
}


@pytest.fixture(scope="module")
def runners(drive):
    return {real: model.compiled(drive, real) for real in model.REALS}


def narrowed(runner, values):
    """The runner with these tunables, and the same numbers for the plain state machine."""
    assert runner.prepare(values) == 0
    told = {WORDS[k]: v for k, v in values.items() if k in WORDS}
    if "u_rate_Nm_s" in values:
        told["step"] = values["u_rate_Nm_s"] * 1e-3
    return replace(model.SHIPPED, **told)


@pytest.mark.parametrize("real", model.REALS)
@settings(max_examples=25)
@given(
    st.fixed_dictionaries({}, optional={k: st.sampled_from(v) for k, v in NARROW.items()}),
    st.lists(model.EVENT, max_size=6),
)
def test_any_narrowing_against_a_plain_state_machine(runners, real, values, events):
    numbers = narrowed(runners[real], values)
    model.against_plain_limits(
        runners[real], model.stream_of(events), numbers, model.TIES[real], model.ERRORS[real]
    )


@pytest.mark.parametrize("window_s", [0.05, 0.055, 0.0501, 0.033, 0.0105])
def test_a_window_that_no_slot_divides_is_covered_whole(drive, window_s):
    # All that was given within the window counts: slots are rounded up, by a slot at most.
    simulator = limits(model.changed(drive, energy_window_s=window_s)).simulator()
    ticks = int(np.ceil(round(window_s * 1e3, 6)))
    slot = int(np.ceil(round(window_s * 1e2, 6)))
    for start in range(model.STEPS - 160, model.STEPS - 130):
        x = model.calm()
        x["tau_Nm"][start] = 8.0
        x["omega_load_rad_s"][start] = 4.0
        simulator.reset()
        y, _ = simulator.run(x)
        held = y["energy_J"] > 0.03
        assert y["energy_J"][start] == pytest.approx(0.032)
        assert np.all(held[start : start + ticks])
        assert not np.any(held[start + 11 * slot :])
