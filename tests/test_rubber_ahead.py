"""One step of the published rubber in predictive control, typed again, with its derivatives."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.control.predictive.rubber_ahead import rubber_ahead

H = 0.004
# As published: spring, stop operators, Maxwell element.
K1, K3, BETA, OMEGA = 9.39, 239.0, 62.5, 0.0197
KV, A, M, EPS1, B, N, EPS2 = 51.6, 53.9, 2.77, 0.0288, 0.732, 0.77, 0.013
MEMORY_NM = 0.37
# Torque of the Maxwell element, deflection before and after: quick, slow, at rest, through 0.
STEPS = [
    *((0.4, 0.10, 0.13), (-0.8, 0.15, 0.14), (0.3, -0.2, -0.2001), (1.2, 0.05, 0.05)),
    *((0.0, 0.0, 0.0), (-0.1, -0.004, 0.003), (0.7, 3e-5, -4e-5), (2.0, 1e-4, 1e-4 + 4e-7)),
]


class Numbers:
    """A tape that names nothing: what is written is the value."""

    def let(self, _name, value):
        return value

    def keep(self, _name, value, _slopes=None):
        return value

    def power(self, _name, base, exponent):
        return base**exponent

    def memory(self, _stretch):
        return MEMORY_NM


class Named(Numbers):
    """A tape of symbols, which remembers what they mean and which derivatives are stated."""

    def __init__(self) -> None:
        self.named: list[tuple[ca.SX, ca.SX]] = []
        self.stated: list[tuple[ca.SX, dict]] = []

    def keep(self, name, value, slopes=None):
        if slopes is not None:
            self.stated.append((value, slopes))
        self.named.append((ca.SX.sym(name), value))
        return self.named[-1][0]


@pytest.fixture(scope="module")
def rubber(drive):
    return rubber_ahead(drive)


def relaxed(tau_r, last, now):
    """(3.3, 3.4), with (1 - exp(-x))/x by its first terms' inverse."""
    middle, rate = (last + now) / 2, (now - last) / H
    gain = A * (middle**2 + 1e-8) ** (M / 2) + EPS1
    drag = B * (rate**2 + 1e-8) ** (N / 2) + EPS2
    x = H * KV * drag / gain
    series = 1 + x / 2 + x**2 / 6
    return (tau_r + KV * (now - last) * series) / (1 + x * series)


@pytest.mark.parametrize(("tau_r", "last", "now"), STEPS)
def test_torques_after_a_step(rubber, tau_r, last, now):
    x = SimpleNamespace(tau_r=tau_r, delta=last)
    for moved in (None, now - last):
        found = rubber.step(Numbers(), H, x, now, moved, None)
        rate_torque = relaxed(tau_r, last, now)
        assert found["tau_r"] == pytest.approx(rate_torque, rel=1e-9, abs=1e-12)
        wanted = K1 * now + K3 * now**3 + rate_torque + MEMORY_NM
        assert found["tau_e"] == pytest.approx(wanted, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("tau_r", "last", "now"), STEPS)
def test_derivatives_that_are_stated_are_those_of_what_was_computed(rubber, tau_r, last, now):
    tape = Named()
    free = [ca.SX.sym(n) for n in ("tau_r", "last", "now", "moved")]
    x = SimpleNamespace(tau_r=free[0], delta=free[1])
    rubber.step(tape, H, x, free[2], free[3], None)
    ((value, slopes),) = tape.stated
    assert [by.name() for by in slopes] == ["tau_r", "moved", "ratio"]
    # Between the ratio and the value stand names that depend on it.
    for symbol, meant in reversed(tape.named):
        if symbol.name() != "ratio":
            value = ca.substitute(value, symbol, meant)
    symbols, meant = zip(*tape.named, strict=True)
    for by, slope in slopes.items():
        pair = ca.substitute_inplace(
            list(symbols), list(meant), [slope(None), ca.jacobian(value, by)]
        )[1]
        stated, own = ca.Function("f", free, list(pair))(tau_r, last, now, now - last)
        assert float(stated) == pytest.approx(float(own), rel=1e-9, abs=1e-12)


def test_numbers_of_the_whole_rubber(rubber):
    # Stops at whole multiples of omega, each exp(beta omega) times as weak as the one before.
    assert rubber.stops.r == pytest.approx(OMEGA * np.arange(1, 11))
    assert rubber.stops.p == pytest.approx(
        rubber.stops.p[0] * np.exp(-BETA * OMEGA * np.arange(10))
    )
    assert rubber.soft_Nm_rad == pytest.approx(K1 + sum(rubber.stops.p) + KV / 2)
    tau_rate, play = rubber.ports()
    assert (tau_rate.name, tau_rate.high, tau_rate.size) == ("tau_rate_Nm", 20, 1)
    assert (play.name, play.high, play.size) == ("play_rad", pytest.approx(0.7), 10)
    (smooth,) = rubber.choices
    assert (smooth.name, smooth.value) == ("smooth_rad_s", 1e-4)
    told = SimpleNamespace(delta_rad=0.1, tau_rate_Nm=0.25)
    start = rubber.start(told, 0.5)
    assert start == {"tau_r": 0.25, "tau_e": pytest.approx(0.939 + 0.239 + 0.25 + 0.5)}
