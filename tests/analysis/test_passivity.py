"""Energy balance of a run against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.analysis.passivity import Hand, energy_balance
from esea_gen.errors import UserError

T = 1e-3


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), k=st.floats(0, 100), b=st.floats(1e-3, 5))
def test_a_spring_and_damper_take_in_what_they_must(seed, k, b):
    theta = np.cumsum(np.random.default_rng(seed).normal(0, 0.01, 500))
    theta -= theta[0]
    # The trapezoidal rule is exact for a spring.
    spring = energy_balance(theta, -k * theta)
    assert spring.absorbed_J == pytest.approx(0.5 * k * theta**2, abs=1e-9 * (1 + k))
    assert spring.generated_J == pytest.approx(0, abs=1e-9 * (1 + k))
    # A damper on a steady motion takes in b w^2 t; one of the wrong sign gives that out.
    t = np.arange(500) * T
    damper, active = (energy_balance(t, np.full(500, -c)) for c in (b, -b))
    assert damper.absorbed_J[-1] == pytest.approx(b * t[-1])
    assert (damper.generated_J, active.generated_J) == pytest.approx((0, b * t[-1]))


def test_energy_refuses_what_is_no_number():
    good = np.zeros(50)
    with pytest.raises(UserError, match="tau_Nm: sample 3"):
        energy_balance(good, np.where(np.arange(50) == 3, np.inf, 0))
    with pytest.raises(UserError, match="49 samples"):
        energy_balance(good, good[:-1])
    with pytest.raises(UserError, match="passive hand"):
        Hand("x", damping_Nms_rad=-1.0)
