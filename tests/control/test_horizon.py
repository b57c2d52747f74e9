"""What a prediction is made of: its grid, its tape of named values, and the cable's balance."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.control.predictive.cable_model import CableModel
from esea_gen.control.predictive.horizon import Horizon, Model, Stops, Tape, linearise
from esea_gen.errors import UserError


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"intervals": 1}, "intervals is 1; 2 to 100"),
        ({"intervals": 101}, "intervals is 101; 2 to 100"),
        ({"substeps": 0}, "substeps is 0; 1 to 50"),
        ({"substeps": 51}, "substeps is 51; 1 to 50"),
        ({"long_intervals": 10}, "long_intervals is 10; 0 to 9"),
        ({"interval_s": 0.0}, "interval_s is 0.0"),
        ({"interval_s": 10.01}, "interval_s is 10.01"),
        ({"delay_s": -1e-9}, "delay_s is -1e-09; 0 to the horizon's 0.2 s"),
        ({"delay_s": 0.2001}, "delay_s is 0.2001"),
    ],
)
def test_what_is_outside_its_range_is_refused(changes, words):
    with pytest.raises(UserError, match=words):
        Horizon(**changes)


def made_up(t, h, x, u, p, w):
    """Two states, a memory, what is kept with slopes and without, a power, a parameter."""
    push = t.let("push", x.v + h * (p.gain * u - x.s * x.v))
    wave = t.keep("wave", ca.sin(push), {push: lambda _: ca.cos(push)})
    ahead = t.let("ahead", x.s + h * push + 0.1 * wave * x.v)
    tau = t.memory(ahead)
    stiff = t.power("stiff", ahead**2 + 1, 1.7)
    after = t.keep("after", stiff * push - tau * x.s)
    return {"s": ahead, "v": t.let("end", push - h * (tau + after + w.force) + h * u * x.s)}


def plainly(s, v, u, gain, force, tau, h):
    push = v + h * (gain * u - s * v)
    ahead = s + h * push + 0.1 * np.sin(push) * v
    after = (ahead**2 + 1) ** 1.7 * push - tau * s
    return ahead, push - h * (tau + after + force) + h * u * s


def test_a_substep_is_split_at_its_memory_and_differentiated():
    """Against central differences; the memory's torque gains stiffness times deflection, less
    what is held back."""
    model = Model(
        states=("s", "v"),
        start=lambda u, tau: {},
        substep=made_up,
        error=lambda x, p, r: [],
        effort=lambda x, u, p: [],
        inputs=(),
        in_force="",
        u_max=1.0,
        forecasts={"force": lambda u, p, s: 0},
        parameters=("gain",),
        stops=Stops((0.1,), (1.0,)),
    )
    h, scale = 0.07, 2.5
    lin = linearise(model, h, scale)
    s, v, u, gain, force, tau, slope, offset = 0.6, -0.9, 0.4, 3.1, 0.8, 1.3, 5.0, 0.45
    named, deflection = lin.before([s, v], u, [gain], [force])
    assert lin.named == named.numel()
    ends = plainly(s, v, u, gain, force, tau, h)
    assert float(deflection) == pytest.approx(ends[0])
    following, k = lin.after([s, v], u, [gain], [force], named, tau, slope)
    assert lin.coefficients == k.numel() > 0
    alone = lin.onward([s, v], u, [gain], [force], named, tau)
    for found in (following, alone):
        assert np.array(found).ravel() == pytest.approx(ends)

    def moved(ds, dv, du):
        """Central difference along a direction, with the torque that goes with it."""
        size = 1e-6

        def at(side):
            d = side * size
            there = (s + d * ds, v + d * dv, u + d * du)
            ahead = plainly(*there, gain, force, tau, h)[0]
            pulled = tau + slope * (ahead - ends[0]) - d * offset
            return np.array(plainly(*there, gain, force, pulled, h))

        return (at(1) - at(-1)) / (2 * size)

    for ds, dv in ((1, 0), (0, 1), (0.3, -2.0)):
        for kernel, du in ((lin.column, 0.0), (lin.newest, scale)):
            d_next, d_deflection = kernel([ds, dv], k, offset)
            expected = moved(ds, dv, du)
            assert np.array(d_next).ravel() == pytest.approx(expected, rel=1e-6)
            assert float(d_deflection) == pytest.approx(expected[0], rel=1e-6)


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
