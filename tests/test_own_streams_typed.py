"""Streams of the adaptation, of passivity and of the limits, sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.adaptation import adaptation
from esea_gen.control.adaptation_streams import STREAMS as OF_ADAPTATION
from esea_gen.control.limits import limits
from esea_gen.control.limits_streams import STREAMS as OF_LIMITS
from esea_gen.control.passivity import passivity
from esea_gen.control.passivity_streams import STREAMS as OF_PASSIVITY

from .limits_model import SHIPPED


@pytest.fixture(scope="module")
def masses(drive):
    block = adaptation(drive)
    return block, OF_ADAPTATION.memories(block, np.dtype("f4"), np.random.default_rng(1))


def test_a_mass_swings_and_the_sensor_shows_it_scaled(masses):
    block, found = masses
    ports = {p.name: p for p in block.inputs}
    tunables = {t.name: t for t in block.tunables}
    mass = 0.6 * tunables["mass_Nm"].high
    t = np.arange(1600) * block.period_s
    # Half a turn a second, 1.3 rad about 1.2 rad.
    angle, rate = 1.2 + 1.3 * np.sin(np.pi * t), 1.3 * np.pi * np.cos(np.pi * t)
    assert [s.name for s in found] == [
        *("a mass", "a soft rubber", "a stiff rubber", "another mass", "beyond the horizontal")
    ]
    scales = ((1.1, 0.02, 1.2), (1.6, 0.4, 1.2), (0.6, -0.4, 1.2), (-1.0, 0, 1.2), (1.0, 0, 0))
    held = 0.9 * ports["tau_Nm"].high
    assert ports["tau_Nm"].low == -ports["tau_Nm"].high
    cut = 0
    for stream, (scale, offset, zero) in zip(found, scales, strict=True):
        x = stream.inputs
        assert x["theta_load_rad"] == pytest.approx(angle, abs=1e-6)
        assert x["omega_load_rad_s"] == pytest.approx(rate, abs=1e-6)
        shown = scale * mass * np.sin(angle - zero) + offset + 0.2 * np.sign(rate)
        assert x["tau_Nm"] == pytest.approx(np.clip(shown, -held, held), abs=1e-5)
        cut += np.count_nonzero(abs(shown) > held)
        doubted = np.flatnonzero(x["sensing_ok"] != 1)
        assert doubted.tolist() == [800, 801, 802, 803, 804, 1598, 1599]
        assert x["sensing_ok"][800:805].tolist() == [0] * 5
        assert np.isnan(x["sensing_ok"][1598:]).all()
        wanted = x["tau_desired_Nm"]
        assert (-3 <= wanted.min() < -2.9, 2.9 < wanted.max() <= 3) == (True, True)
        hung = {"mass_Nm": mass, "mass_angle_rad": zero, "share": 1.0}
        for word, end in (("soft", "high"), ("stiff", "low")):
            if word in stream.name:
                hung |= {n: getattr(tunables[n], end) for n in ("gain", "loss", "offset_Nm")}
        changes = {k: {n: v.tolist() for n, v in c.items()} for k, c in stream.coefficients.items()}
        taken_off = {1500: {"mass_Nm": [0.0]}} if stream.name == "a mass" else {}
        assert changes == {0: {n: [pytest.approx(v)] for n, v in hung.items()}} | taken_off


def test_coefficients_of_passivity_at_and_beyond_their_ends(drive):
    block = passivity(drive)
    (stream,) = OF_PASSIVITY.memories(block, np.dtype("f4"), np.random.default_rng(1))
    coefficients = block.coefficients
    cases = [{}]
    for p in coefficients:
        low, high = np.float32(p.low), np.float32(p.high)
        outside = [np.nextafter(low, np.float32("-inf")), np.nextafter(high, np.float32("inf"))]
        values = [low, high, *outside, np.nan, np.inf, -np.inf, 3.4e38, -3.4e38]
        cases += [{p.name: float(v)} for v in values]
    cases.append({p.name: np.nan for p in coefficients})
    found = [
        {n: float(v[0]) for n, v in stream.coefficients[k].items()}
        for k in sorted(stream.coefficients)
    ]

    def key(case):
        return sorted((n, repr(v)) for n, v in case.items())

    # Every one of them, held for eight steps; what is no number in whatever order.
    assert sorted(stream.coefficients) == [8 * k for k in range(len(found))]
    expected = {repr(key(c)) for c in cases}
    assert expected == {repr(key(c)) for c in found}
    assert found[0] == {}
    assert set(found[-1]) == {p.name for p in coefficients}
    assert np.isnan(list(found[-1].values())).all()
    assert stream.steps == 8 * len(found)
    x = stream.inputs
    assert x["mode"].tolist() == [k // 8 % 3 for k in range(stream.steps)]
    assert set(x["sensing_ok"]) == set(x["request_ok"]) == {1.0}
    for p in block.inputs:
        if p.name not in ("mode", "sensing_ok", "request_ok"):
            # Half of its range, nearly to both ends.
            near = 0.02 * (p.high - p.low)
            assert 0.5 * p.low <= x[p.name].min() <= 0.5 * p.low + near
            assert 0.5 * p.high - near <= x[p.name].max() <= 0.5 * p.high


def test_memory_of_the_limits_that_contradicts_itself(drive):
    block = limits(drive)
    found = {s.name: s for s in OF_LIMITS.events(block, np.random.default_rng(1))}
    stream = found["memory that contradicts itself"]
    ends = {p.name: p.high for p in block.state}
    injected = [
        {n: float(v[0]) for n, v in stream.injections[k].items()} for k in sorted(stream.injections)
    ]
    # Each twice: while released, and latched by a stop.
    assert list(map(repr, injected[::2])) == list(map(repr, injected[1::2]))
    step = injected[8]["u_mirror_Nm"]
    assert 0.2 < step / ends["u_last_Nm"] < 0.4
    assert list(map(repr, injected[::2])) == list(
        map(
            repr,
            [
                {"fault_mirror": -3.0},
                {"fault_stored": 4.0},
                {"rearm_mirror": 0.0},
                {"rearm_last": 5.0},
                {"u_mirror_Nm": step},
                {"u_last_Nm": step},
                {"key": 0.0},
                {"key": 1.0},
                {"key": float(np.float32(ends["key"]))},
                {"fault_stored": 4.0, "fault_mirror": -4.0},
                {"fault_stored": 0.0, "fault_mirror": 0.0},
                {"u_last_Nm": step, "u_mirror_Nm": -step},
                {"rearm_last": -1.0, "rearm_mirror": 1.0},
                {"key": 0.0, "fault_stored": 2.0, "fault_mirror": -2.0},
                {"key": 0.0, "fault_stored": 0.0, "fault_mirror": 0.0},
                {"key": np.nan},
                {"age": np.inf},
            ],
        )
    )
    # Two steps after the last release, or after a stop of two.
    for k, at in enumerate(sorted(stream.injections)):
        before = stream.inputs["stop"][at - 4 : at]
        assert before.tolist() == ([1.0, 1.0, 0.0, 0.0] if k % 2 else [0.0] * 4)


def streams_of_limits(drive):
    block = limits(drive)
    found = {s.name: s for s in OF_LIMITS.events(block, np.random.default_rng(1))}
    return block, found


def values_of(x):
    """What an input takes on, what is no number once."""
    return {"nan" if np.isnan(v) else float(np.float32(v)) for v in np.unique(x)}


def test_each_cause_of_the_limits_is_tried_with_its_own_values(drive):
    block, found = streams_of_limits(drive)
    x, n = found["every fault, and its release"].inputs, SHIPPED
    middle, bent = 0.5 * (n.low + n.high), 0.2 * n.theta
    edges = (n.low - n.margin - 0.01, n.high + n.margin + 0.01)
    own = {
        "stop": {0, 1, 0.5},
        "sensing_ok": {0, 1, 0.5},
        "request_ok": {0, 1},
        "clock_ok": {0, 1, 0.5},
        "coeffs_ok": {0, 1, 0.5},
        "late_level": {0, 129},
        "theta_rad": {bent, 1.02 * n.theta, -1.02 * n.theta},
        "tau_Nm": {0.1 * n.tau, 1.02 * n.tau, -1.02 * n.tau},
        "omega_load_rad_s": {0, 1.02 * n.omega, -1.02 * n.omega},
        "omega_motor_rad_s": {0, 1.02 * n.omega, -1.02 * n.omega},
        "theta_load_rad": {middle, *edges},
        "theta_motor_rad": {
            *(middle + bent, middle + 1.02 * n.theta, middle - 1.02 * n.theta),
            *(e + bent for e in edges),
        },
    }
    for p in block.inputs:
        beyond = {2 * p.high + 1, 2 * min(p.low, 0) - 1}
        tried = values_of(x[p.name])
        assert "nan" in tried, p.name
        if p.name in own:
            wanted = sorted(own[p.name] | beyond)
            assert sorted(tried - {"nan"}) == pytest.approx(wanted, rel=1e-6), p.name
        else:
            assert {float(np.float32(v)) for v in beyond} <= tried, p.name
