"""Energy balance of a run against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.analysis.passivity import Hand, energy_balance
from esea_gen.errors import UserError

T = 1e-3


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), k=st.floats(0, 100), b=st.just(0.0) | st.floats(1e-3, 5))
def test_a_spring_and_damper_take_in_what_they_must(seed, k, b):
    theta = np.cumsum(np.random.default_rng(seed).normal(0, 0.01, 500))
    # The trapezoidal rule is exact for a spring; a damper on the step's own rate takes in
    # b (move)^2 / h, held or not.
    spring = energy_balance(theta, -k * theta, stored_J=0.5 * k * theta[0] ** 2)
    assert spring.absorbed_J == pytest.approx(
        0.5 * k * (theta**2 - theta[0] ** 2), abs=1e-9 * (1 + k)
    )
    assert spring.generated_J == pytest.approx(0, abs=1e-9)
    move = np.diff(theta)
    damper = energy_balance(theta, np.append(-b * move / T, 0.0), held=True)
    assert damper.absorbed_J[-1] == pytest.approx(b * np.sum(move**2) / T)
    assert damper.index == 0
    active = energy_balance(theta, np.append(b * move / T, 0.0), held=True)
    assert active.generated_J == pytest.approx(b * np.sum(move**2) / T)
    assert active.index == pytest.approx(float(b > 0))


def test_energy_refuses_what_is_no_number():
    good = np.zeros(50)
    with pytest.raises(UserError, match="tau_Nm: sample 3"):
        energy_balance(good, np.where(np.arange(50) == 3, np.inf, 0))
    with pytest.raises(UserError, match="49 samples"):
        energy_balance(good, good[:-1])
    with pytest.raises(UserError, match="stored_J"):
        energy_balance(good, good, stored_J=math.nan)
    with pytest.raises(UserError, match="passive hand"):
        Hand("x", damping_Nms_rad=-1.0)
