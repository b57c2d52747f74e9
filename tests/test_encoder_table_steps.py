"""An encoder's table where the truth is exact, and its intervals typed a second time."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t as student

from esea_gen.device import load_device
from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError
from esea_gen.identify.encoder_table import EncoderTable, fit_table, read_counts, with_table
from esea_gen.identify.regression import Estimate
from tests.test_regression import clustered

FULL, NODES, ZERO_rad = 4096, 16, 0.7
TURN = 2 * math.pi
# Mean 0: what a table and a zero share is the zero's.
TRUE = 0.01 * np.array([3, -1, 4, 1, -5, 9, -2, -6, 5, -3, 5, -8, 9, -7, -9, 5.0])


def angles(span_rad: float, count: int, ways: int = 3) -> np.ndarray:
    """To and fro, the turns between two samples."""
    k = (np.arange(count) + 0.5) / count * ways
    return span_rad * np.abs((k + 1) % 2 - 1)


def recorded(span_rad, count, direction, play_rad=0.0, start=0.0):
    """Counts, as fine as numbers are, and what the better encoder says."""
    turned = angles(span_rad, count) + start
    raw = turned % TURN
    table = np.interp(raw, TURN * np.arange(NODES + 1) / NODES, [*TRUE, TRUE[0]])
    reference = direction * (turned + table) - ZERO_rad
    way = np.sign(np.gradient(reference))
    return raw / TURN * FULL, reference + way * play_rad / 2


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("span", [1.3 * TURN, 3.4 * TURN])
def test_a_table_that_is_exact_is_found_exactly(direction, span):
    count, reference = recorded(span, 3000, direction)
    found = fit_table("load", count, reference, FULL, NODES)
    assert (found.side, found.direction, found.samples) == ("load", direction, 3000)
    # The play is none; the better one turns to and fro.
    assert found.play_rad.value < 1e-9
    np.testing.assert_allclose([v.value for v in found.values], TRUE, atol=1e-9)
    assert found.zero_rad == pytest.approx(ZERO_rad, abs=1e-9)
    assert found.after_rad < 1e-9
    turned = angles(span, 3000) % TURN
    table = np.interp(turned, TURN * np.arange(NODES + 1) / NODES, [*TRUE, TRUE[0]])
    assert found.before_rad == pytest.approx(np.std(table), rel=1e-9)
    # A straight line from node to node misses an eighth of the second difference.
    bends = [abs(TRUE[k - 1] - 2 * TRUE[k] + TRUE[(k + 1) % NODES]) / 8 for k in range(NODES)]
    np.testing.assert_allclose([v.half for v in found.values], bends, atol=1e-9)
    np.testing.assert_allclose([v.low for v in found.values], TRUE - bends, atol=1e-9)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_play_that_is_exact_is_found_beside_the_table(direction):
    count, reference = recorded(1.7 * TURN, 3000, direction, 1e-3)
    found = fit_table("motor", count, reference, FULL, NODES)
    assert found.play_rad.value == pytest.approx(1e-3, abs=2e-5)
    assert 0 < found.play_rad.low <= found.play_rad.value <= found.play_rad.high < 1.1e-3
    np.testing.assert_allclose([v.value for v in found.values], TRUE, atol=5e-5)


@pytest.mark.parametrize("way", [1, -1])
def test_standing_still_is_neither_way(way):
    turned = np.concatenate(
        [np.linspace(10, 17, 2000), np.full(850, 17.0), np.linspace(17, 16.5, 150)]
    )
    found = fit_table("motor", way * turned % TURN / TURN * FULL, way * turned, FULL, NODES)
    assert found.play_rad is None


@pytest.mark.parametrize("zero", [0.0, 3.1, -3.1])
def test_a_zero_anywhere_in_the_turn_is_found(zero):
    count, reference = recorded(1.3 * TURN, 3000, 1)
    found = fit_table("load", count, reference + ZERO_rad - zero, FULL, NODES)
    assert found.zero_rad == pytest.approx(zero, abs=1e-9)
    np.testing.assert_allclose([v.value for v in found.values], TRUE, atol=1e-9)
    assert found.before_rad < 0.1


@pytest.mark.parametrize("way", [1, -1])
def test_a_play_needs_a_tenth_of_the_samples_either_way(way):
    """Up for most of the time, and back for a tenth of it."""
    seen = []
    for back in range(290, 312, 3):
        turned = way * np.concatenate(
            [np.linspace(10, 17.5, 3000 - back), np.linspace(17.49, 16.5, back)]
        )
        padded = np.concatenate([np.zeros(5), turned, np.zeros(5)])
        moved = [padded[k + 6 : k + 11].sum() - padded[k : k + 5].sum() for k in range(3000)]
        backward = sum(way * m < 0 for m in moved)
        found = fit_table("motor", turned % TURN / TURN * FULL, turned, FULL, NODES)
        assert (found.play_rad is not None) == (backward > 300)
        assert found.zero_rad == pytest.approx(0, abs=1e-9)
        seen.append(backward)
    assert min(abs(n - 302) for n in seen) <= 1
    assert min(seen) < 300


def test_intervals_are_those_of_forty_blocks_typed_again():
    rng = np.random.default_rng(4)
    count, reference = recorded(1.3 * TURN, 2000, 1, 2e-3)
    reference = reference + rng.normal(0, 1e-3, 2000)
    found = fit_table("motor", count, reference, FULL, NODES)
    raw = count / FULL * TURN
    off = reference - raw
    middle = np.angle(np.mean(np.exp(1j * off)))
    error = (off - middle + math.pi) % TURN - math.pi
    hats = np.zeros((2000, NODES))
    for k, place in enumerate(raw / TURN * NODES):
        i = int(place)
        hats[k, i % NODES] += 1 - (place - i)
        hats[k, (i + 1) % NODES] += place - i
    padded = np.concatenate([np.zeros(5), reference, np.zeros(5)])
    moved = [np.sign(padded[k + 6 : k + 11].sum() - padded[k : k + 5].sum()) for k in range(2000)]
    terms = np.column_stack([hats, 0.5 * np.array(moved)])
    values = np.linalg.lstsq(terms, error, rcond=None)[0]
    left = error - terms @ values
    spread = np.sqrt(np.diag(clustered(terms, left, np.arange(2000) // 50)))
    halves = student.ppf(0.975, 39) * spread
    level = values[:NODES]
    bends = np.abs(level[np.arange(NODES) - 1] - 2 * level + np.roll(level, -1)) / 8
    assert [v.value for v in found.values] == pytest.approx(level - level.mean(), abs=1e-9)
    assert [v.half for v in found.values] == pytest.approx(
        np.hypot(halves[:NODES], bends), rel=1e-6
    )
    assert found.play_rad.value == pytest.approx(abs(values[-1]), rel=1e-6)
    assert found.play_rad.half == pytest.approx(halves[-1], rel=1e-6)
    assert found.after_rad == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)
    assert found.before_rad == pytest.approx(np.std(error), rel=1e-9)
    assert found.zero_rad == pytest.approx(-(middle + level.mean()), abs=1e-9)


def test_a_node_that_was_hardly_beside_is_not_known():
    """From the third node to the sixth: those in between, and the ends by what they weigh."""
    turned = TURN / NODES * np.concatenate([np.linspace(3.0, 6.0, 601), [6.3, 6.69, 6.6]])
    found = fit_table("motor", turned / TURN * FULL, turned, FULL, NODES)
    # Beyond the sixth 0.3, 0.69 and 0.6: the seventh has 1.59 of a sample.
    assert [k for k, v in enumerate(found.values) if v is not None] == [3, 4, 5, 6, 7]
    found = fit_table("motor", turned[:-1] / TURN * FULL, turned[:-1], FULL, NODES)
    assert [k for k, v in enumerate(found.values) if v is not None] == [3, 4, 5, 6]
    assert found.play_rad is None


def known(*values: float | None, half: float = 0.001) -> EncoderTable:
    nodes = tuple(None if v is None else Estimate(v, v - half, v + half) for v in values)
    return EncoderTable("motor", 1, nodes, 0.25, None, 0.5, 0.125, 640)


def test_nodes_that_were_never_seen_lie_on_their_neighbours_line():
    assert known(1.0, None, None, 4.0).filled() == [1.0, 2.0, 3.0, 4.0]
    # Round the turn: from the last known one to the first.
    assert known(None, 3.0, 7.0, None).filled() == [
        pytest.approx(13 / 3),
        3.0,
        7.0,
        pytest.approx(17 / 3),
    ]
    assert known(0.123456789, 1.0).filled() == [0.1234568, 1.0]


def test_the_table_for_people_is_in_degrees():
    deg = math.degrees(1)
    found = known(0.01, None, -0.02, 0.0, half=0.002)
    lines = found.table()
    assert lines[0].split() == ["at", "deg", "add", "deg", "95", "%", "interval"]
    assert lines[1].split() == ["0.00", f"{0.01 * deg:.4f}", "0.4584", "to", "0.6875"]
    assert lines[2].split() == ["90.00", "never", "there"]
    assert lines[3].split()[:2] == ["180.00", "-1.1459"]
    assert lines[4].split()[:2] == ["270.00", "0.0000"]
    assert lines[5:] == [
        "effective error of the angle: 28.6479 deg without the table, 7.1620 with it; 640 samples"
    ]
    play = replace(found, play_rad=Estimate(0.1, 0.05, 0.2))
    assert play.table()[5] == "play between the two: 5.7296 deg (95 %: 2.8648 to 11.4592)"
    told = play.to_dict()
    assert told["play"] == {"value_rad": 0.1, "low_rad": 0.05, "high_rad": 0.2}
    assert told["nodes"][1] is None
    assert told["nodes"][2] == pytest.approx(
        {"value_rad": -0.02, "low_rad": -0.022, "high_rad": -0.018}
    )
    assert found.to_dict()["play"] is None
    assert (told["zero_rad"], told["before_rad"], told["after_rad"]) == (0.25, 0.5, 0.125)


def test_counts_are_from_0_to_one_below_a_turn(tmp_path: Path):
    path = tmp_path / "x.csv"
    path.write_text("count,reference_rad\n0,1.5\n4095,-2\n")
    _, count, reference = read_counts(path, 4096)
    assert (count.tolist(), reference.tolist()) == ([0, 4095], [1.5, -2])
    for wrong in ("-1", "4096", "0.5"):
        path.write_text(f"count,reference_rad\n0,1.5\n{wrong},2\n")
        with pytest.raises(UserError, match=r"line 3, column .*is not a count of 0 to 4095"):
            read_counts(path, 4096)


def test_four_hundred_samples_are_enough():
    count, reference = recorded(1.3 * TURN, 400, 1)
    assert fit_table("motor", count, reference, FULL, NODES).samples == 400
    with pytest.raises(UserError, match="399 samples"):
        fit_table("motor", count[:-1], reference[:-1], FULL, NODES)


def test_a_device_takes_a_table_up_to_its_fields_limit():
    device = load_device("elbow_drive")
    most = field_facts("encoder.motor.correction_rad")["high"]
    plain = device.file.encoder
    for size in (most, -most):
        found = known(*[0.0] * 15, size)
        side = with_table(device, found, 0.5, "bench").file.encoder.motor
        assert side.correction_rad.values == (*[0.0] * 15, pytest.approx(size, rel=1e-6))
        assert side.correction_rad.status == "identified"
        assert side.correction_rad.source == "bench; 95 % intervals of up to 0.001 rad either way"
        at = side.correction_orientation_rad
        assert (at.value, at.status, at.source) == (0.5, "identified", "bench")
        assert side.orientation_rad == ((plain.motor and plain.motor.orientation_rad) or at)
    for size in (1.01 * most, -1.01 * most):
        with pytest.raises(UserError, match=r"A correction of .* rad is above"):
            with_table(device, known(*[0.0] * 15, size), 0.5, "bench")
    # A side that has an orientation of its own keeps it, and the other side what it had.
    again = with_table(
        with_table(device, known(*[0.0] * 16), 0.5, "a"), known(*[0.0] * 16), 0.9, "b"
    )
    assert again.file.encoder.motor.orientation_rad.value == (
        plain.motor.orientation_rad.value if plain.motor and plain.motor.orientation_rad else 0.5
    )
    assert again.file.encoder.motor.correction_orientation_rad.value == 0.9
    assert again.file.encoder.load == plain.load
