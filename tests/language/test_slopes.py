"""Derivatives that a Block carries along beside its step, against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable, around
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.slopes import FAR, sloped


def chained() -> Block:
    """A chain of sums: s = a s + u, v moves with b s and 2 v, w with nothing that is tuned."""
    return Block.define(
        "chained",
        "A chain",
        period_s=2e-3,
        tunables=tuple(Tunable(n, 0.5, 0.0, 4.0, n, "", "") for n in "abc"),
        coefficients=(Port("a", 0, 4, ""), Port("twice", 0, 9, ""), Port("c", 0, 4, "")),
        prepare=lambda t: {"a": t.a, "twice": 2 * t.b, "c": t.c},
        state=(around("w_1", 9, ""), around("s_1", 1e6, ""), around("v_1", 1e6, "", 2)),
        inputs=(around("x_1", 9, ""),),
        outputs=(around("y_1", 1e9, ""), around("still_1", 9, ""), around("z_1", 1e9, "")),
        step=lambda c, s, u, guard, label: (
            {
                "w_1": u.x_1,
                "s_1": c.a * s.s_1 + u.x_1,
                "v_1": [s.v_1[0] + c.twice * s.s_1, s.v_1[1] + s.v_1[0]],
            },
            {"y_1": c.c * s.v_1[1] + s.w_1, "still_1": s.w_1, "z_1": s.v_1[0] + c.c * c.c * u.x_1},
        ),
    )


def by_hand(a, b, c, x):
    s, v0, v1, w, rows = 0.0, 0.0, 0.0, 0.0, []
    for u in x:
        rows.append((c * v1 + w, v0 + c * c * u))
        w, s, v0, v1 = u, a * s + u, v0 + 2 * b * s, v1 + v0
    return np.array(rows)


def test_slopes_follow_the_memory_that_a_tunable_reaches():
    numbers, x = {"a": 0.7, "b": 1.3, "c": 0.9}, np.array([2.0, -1.0, 0.5, 3.0, -2.0, 1.0])
    order = ("c", "a", "b")
    block = sloped(chained(), ("z_1", "y_1"), order)
    assert [p.name for p in block.outputs] == ["y_1", "z_1", "slopes"]
    slopes = block.outputs[-1]
    assert (slopes.size, slopes.low, slopes.high) == pytest.approx((6, -1e30, 1e30), rel=1e-6)
    assert FAR == 1e30
    # By c nothing moves, by b both of v, by a the sum too; of coefficients one each.
    held = {p.name: (p.size, p.high) for p in (*block.state, *block.coefficients)}
    assert held["s_slopes"] == pytest.approx((0 + 3 + 2, 1e30), rel=1e-6)
    assert held["c_slopes"] == pytest.approx((3, 1e30), rel=1e-6)
    assert block.period_s == 2e-3
    y, _ = block.simulator(numbers).run({"x_1": x})
    expected = by_hand(*numbers.values(), x)
    np.testing.assert_allclose(y["z_1"], expected[:, 1])
    np.testing.assert_allclose(y["y_1"], expected[:, 0])
    found = np.asarray(y["slopes"]).reshape(len(x), 2, 3)
    for k, name in enumerate(order):
        up, down = (numbers | {name: numbers[name] + d} for d in (1e-4, -1e-4))
        rise = (by_hand(*up.values(), x) - by_hand(*down.values(), x)) / 2e-4
        np.testing.assert_allclose(found[:, :, k], rise[:, ::-1], rtol=1e-6, atol=1e-6)


def test_slopes_of_the_torque_by_each_of_its_numbers():
    sensor = torque_sensor(load_device("elbow"), tunable=True)
    numbers = sensor.default_tunables()
    outputs = ("tau_Nm", "tau_rate_Nm", "tau_hysteresis_Nm")
    by = tuple(numbers)
    block = sloped(sensor, outputs, by)
    t = np.arange(60) / 60
    path = {"theta_rad": 0.15 * np.sin(7 * t) + 0.01, "omega_rad_s": 1.05 * np.cos(7 * t)}
    y, _ = block.simulator(numbers).run(path)
    shown = [p.name for p in sensor.outputs if p.name in outputs]
    found = np.asarray(y["slopes"]).reshape(len(t), len(outputs), len(by))
    for k, name in enumerate(by):
        step = 1e-5 * numbers[name]
        up, down = (
            sensor.simulator(numbers | {name: numbers[name] + d}).run(path)[0]
            for d in (step, -step)
        )
        for i, output in enumerate(outputs):
            rise = (up[output] - down[output]) / (2 * step)
            size = np.abs(rise).max()
            np.testing.assert_allclose(found[:, i, k], rise, rtol=1e-4, atol=1e-5 * size + 1e-9)
    assert shown == list(outputs)


@pytest.mark.parametrize("name", ["y_1", "still_1"])
def test_an_output_that_nothing_tunes_has_no_slope(name):
    block = sloped(chained(), (name,), ("b",))
    y, _ = block.simulator({"b": 0.6}).run({"x_1": np.array([1.0, 2.0, 3.0, 4.0])})
    moves = np.any(np.asarray(y["slopes"]) != 0)
    assert moves == (name == "y_1")
