"""The cable's balance that a prediction starts from, at any torque, turn, give and gap."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.control.predictive.cable_model import CableModel
from esea_gen.control.predictive.horizon import Tape

# -- cable -----------------------------------------------------------------------------------------

SOFT, INSIDE = 30.0, 150 / 15  # Nm/rad


@pytest.mark.parametrize("tau_e", [-23.0, -3.0, 0.01, 0.4, 4.0, 21.0])
@pytest.mark.parametrize("turned", [-0.2, 0.003, 0.15])
@pytest.mark.parametrize(("give", "gap"), [(1 / 150, 0.006), (1 / 80, 0.03), (0.0, 0.0)])
def test_the_motor_side_goes_where_cable_and_elastomer_balance(drive, tau_e, turned, give, gap):
    """A fifteenth of the stiffness inside the gap, all of it beyond either end."""
    model, tape = CableModel(drive, SOFT), Tape()
    x = SimpleNamespace(tau_e=ca.SX.sym("tau_e"), delta=0.05)
    p = SimpleNamespace(gap_rad=gap, give_rad_Nm=give)
    pull = model.pull(tape, x.tau_e)
    # What rubs is carried by the cable too.
    rubs = 0.6 * (model.coulomb(tape, 0.5, pull) - 0.5)
    found = model.follow(tape, x, turned, pull + rubs, p)
    values = {x.tau_e.name(): tau_e}

    def number(expression):
        known = list(ca.symvar(expression))
        f = ca.Function("f", known, [expression])
        return float(f.call([values[s.name()] for s in known])[0])

    for e in tape.entries:
        values[e.symbol.name()] = number(e.value)
        for symbol, slope in e.slopes or ():
            here, there = values[symbol.name()], number(slope)
            ends = []
            for side in (1e-6, -1e-6):
                values[symbol.name()] = here + side
                ends.append(number(e.value))
            values[symbol.name()] = here
            assert there == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-6), e.symbol
    assert found is not None
    delta = values["delta_next"]
    wound, half = turned - delta, gap / 2
    pull = np.clip(tau_e, -20, 20)
    elastomer = pull + 0.6 * 0.1 * abs(pull) + SOFT * (delta - 0.05)
    beyond = wound - np.clip(wound, -half, half)
    if give:
        carried = INSIDE * np.clip(wound, -half, half) + beyond / give
        assert carried == pytest.approx(elastomer, abs=1e-9)
    else:
        assert wound == pytest.approx(0, abs=1e-12)
