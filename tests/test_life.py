"""Cycles of the coupling: against ASTM E1049 as printed, another tool's counts, closed forms."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from esea_gen.device import Device, load_device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device
from esea_gen.language.wires import Signal
from esea_gen.observe.life import class_edges_rad, life_counter

from .conftest import require_tool

ASSUMED = 'status = "assumed", source = "a test" }'
CURVE = f"""
[life.curve]
range_rad = {{ value = 0.35, {ASSUMED}
cycles = {{ value = 1e5, {ASSUMED}
exponent = {{ value = 4, {ASSUMED}
"""


def counted(least: float, curve: str = CURVE, extends: str = "elbow") -> Device:
    head = f'schema = 1\nextends = "{extends}"\nname = "lived"\ntitle = "counted"\n'
    life = f"[life]\nleast_rad = {{ value = {least}, {ASSUMED}\n"
    return parse_device(head + life + curve, "lived.toml")


@pytest.fixture(scope="module")
def runners():
    require_tool("gcc")
    device = counted(0.0)
    return {r: compile_device(device, r).block("life") for r in ("f64", "f32", "q31")}


def as_printed(points) -> list[tuple[float, float]]:
    """ASTM E1049-85, 5.4.4, rule by rule: ranges and how many cycles each is."""
    out, read = [], []
    for point in points:
        read.append(point)  # rule 1
        while len(read) >= 3:  # rule 2
            x, y = abs(read[-1] - read[-2]), abs(read[-2] - read[-3])
            if x < y:  # rule 3a
                break
            if len(read) == 3:  # rule 5: Y holds the starting point
                out.append((y, 0.5))
                read.pop(0)
            else:  # rule 4
                out.append((y, 1.0))
                del read[-3:-1]
    return out + [(abs(a - b), 0.5) for a, b in itertools.pairwise(read)]  # rule 6


def turning(x) -> list[float]:
    x = [v for k, v in enumerate(x) if k == 0 or v != x[k - 1]]
    inner = [b for a, b, c in zip(x, x[1:], x[2:], strict=False) if (b - a) * (c - b) < 0]
    return [x[0], *inner, x[-1]]


def in_classes(cycles) -> np.ndarray:
    edges, out = 0.0401425727958696 * np.arange(10), np.zeros(10)  # a tenth of 2 x 11.5 deg
    for size, count in cycles:
        out[np.flatnonzero(size >= edges)[-1]] += 2 * count
    return out


def whole(runner, x):
    """Halves by class, those of the points that still wait included; status words."""
    runner.reset()
    y, s = runner.run({"theta_rad": np.asarray(x, float)})
    waiting = np.asarray(s["points_rad"][-1], float)[: round(float(s["depth"][-1]))]
    left = as_printed([*waiting[::-1], float(s["extreme_rad"][-1])])
    return np.asarray(y["halves"][-1], float) + in_classes(left), y


def test_the_transcription_gives_the_standards_example():
    # ASTM E1049, figure 6: range 3 half, 4 one and a half, 6 half, 8 one, 9 half a cycle.
    found: dict[float, float] = {}
    for size, count in as_printed([-2, 1, -3, 5, -1, 3, -4, 4, -2]):
        found[size] = found.get(size, 0) + count
    assert found == {3: 0.5, 4: 1.5, 6: 0.5, 8: 1.0, 9: 0.5}


@pytest.mark.parametrize("real", ["f64", "f32", "q31"])
def test_streams_are_counted_as_printed(runners, real):
    rng = np.random.default_rng(0)
    assert class_edges_rad(counted(0.0)) == pytest.approx(0.0401425727958696 * np.arange(10))
    for case in range(12 if real == "q31" else 40):
        points = (
            rng.uniform(-0.3, 0.3, 200)
            if case % 3 == 0
            else 0.2 * np.sin(np.cumsum(rng.normal(0, 0.3, 200)))
            if case % 3 == 1
            else np.clip(np.cumsum(rng.normal(0, 0.05, 200)), -0.3, 0.3)
        )
        x = np.repeat(np.round(points * 1024) / 1024, 3)  # exact in every format
        assert whole(runners[real], x)[0] == pytest.approx(in_classes(as_printed(turning(x))))


def test_another_tools_counts(runners):
    # PyPI rainflow 3.2.0, extract_cycles of this stream, twice the counts, into the classes.
    rng = np.random.default_rng(7)
    x = np.round(rng.uniform(-0.3, 0.3, 400) * 1024) / 1024
    expected = [26, 14, 18, 18, 10, 20, 24, 12, 16, 112]
    assert whole(runners["f32"], np.repeat(x, 2))[0].tolist() == expected


def test_damage_is_the_sum_of_shares(runners):
    # A hundred cycles of 0.3 rad: class 7, upper edge 0.8 of 2 x 11.5 deg.
    t = np.arange(100 * 40 + 25)
    y = whole(runners["f64"], 0.15 * np.sin(2 * np.pi * t / 40))[1]
    upper = 8 * 0.0401425727958696
    halves = y["halves"][-1]
    assert halves[3] == 1  # from rest to the first peak
    assert halves[7] == halves.sum() - 1
    assert halves[7] == pytest.approx(199, abs=2)  # the last ones wait
    shares = [0.5 / (1e5 * (edge / 0.35) ** -4) for edge in (0.160570291183478, upper)]
    assert y["damage"][-1] == pytest.approx(shares[0] + halves[7] * shares[1], rel=1e-6)
    # Never less than by the ranges themselves.
    assert y["damage"][-1] >= 0.5 * halves[7] / (1e5 * (0.3 / 0.35) ** -4)


def test_what_does_not_fit_is_counted_as_half_and_said(runners):
    # Ever smaller: nothing closes.  Forty points on a stack of sixteen.
    points = [(-1) ** k * 0.3 * (1 - k / 50) for k in range(40)]
    all_of_it, y = whole(runners["f64"], np.repeat(points, 2))
    flagged = np.flatnonzero(np.asarray(y["status"]).astype(int) & 4)
    assert len(flagged) == 40 - 1 - 16
    assert all_of_it == pytest.approx(in_classes(as_printed(points)))


def test_noise_and_gaps_are_no_cycles():
    require_tool("gcc")
    runner = compile_device(counted(0.02), "f32").block("life")
    rng = np.random.default_rng(1)
    t = np.arange(3000)
    slow = 0.1 * np.sin(2 * np.pi * t / 1000)
    x = np.float32(slow + rng.uniform(-0.009, 0.009, 3000)).astype(float)
    runner.reset()
    y, _ = runner.run({"theta_rad": x}, trace=False)
    assert y["halves"][-1].sum() <= 6  # three cycles and the way to the first peak
    runner.reset()
    x[500:520] = np.nan
    x[900] = 1e9
    again, _ = runner.run({"theta_rad": x}, trace=False)
    assert again["halves"][-1].tolist() == y["halves"][-1].tolist()
    status = np.asarray(again["status"]).astype(int)
    assert np.flatnonzero(status & 1).tolist() == [*range(500, 520), 900]


def test_a_drive_and_a_sensor_count_the_same_signal():
    for extends in ("elbow", "elbow_drive"):
        system = counted(0.004, extends=extends).system
        assert system.wires[Signal("life", "theta_rad")] == Signal("velocity", "theta_filtered_rad")
        told = {x.name: x.signals[0] for x in system.outputs}
        assert told["life_halves"] == Signal("life", "halves")
        assert told["life_damage"] == Signal("life", "damage")
        assert told["life_status"] == Signal("life", "status")
    assert "life" not in load_device("elbow_drive").system.blocks


def test_no_curve_no_damage_and_a_wrong_one_is_refused(elbow):
    runner = life_counter(counted(0.0, curve="")).simulator()
    for x in (0.0, 0.2, -0.2, 0.2, -0.2, 0.2):
        out = runner.step(theta_rad=x)
    assert out["damage"] == 0
    assert int(out["status"]) == 16
    with pytest.raises(UserError, match="of the life"):
        life_counter(counted(0.0, CURVE.replace("1e5", "1")))
    with pytest.raises(UserError, match="is missing"):
        life_counter(elbow)
