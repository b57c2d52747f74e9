"""Signals of the live view, without a window: history, trigger, spectrum."""

from __future__ import annotations

import math
from contextlib import closing

import numpy as np
import pytest

from esea_host.connection.receiver import Batch
from esea_host.recording import Gap
from esea_host.recording.layout import StreamColumn, StreamLayout
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.windows.feed import LiveFeed, RowRing, curve, spans
from esea_host.windows.signals import AxisColumns
from esea_host.windows.trigger import SINGLE, Trigger, crossings
from tests.control.test_motor_temperature import warm_text
from tests.windows.test_host_live import run_for

LAYOUT = StreamLayout("sense_out", (StreamColumn("sequence", "u4"), StreamColumn("tau_Nm")))


def batch(first: int, count: int, *gaps: Gap) -> Batch:
    rows = np.zeros(count, LAYOUT.dtype)
    rows["sequence"] = np.arange(first, first + count)
    rows["tau_Nm"] = rows["sequence"] % 1000
    return Batch(LAYOUT, rows, rows["sequence"].astype(np.int64) * 1_000_000, 0, gaps)


def test_a_ring_holds_the_newest_rows_in_a_memory_that_never_grows():
    ring = RowRing(LAYOUT, 1000)
    held, first = ring.nbytes, 0
    for count in [1, 999, 1000, 7, 2500, 333] * 5:
        ring.extend(batch(first, count))
        first += count
        assert ring.nbytes == held
    assert ring.total == first
    part = ring.last()
    assert part.rows["sequence"].tolist() == list(range(first - 1000, first))
    assert part.first == first - 1000
    assert np.allclose(part.time_s, part.rows["sequence"] * 1e-3)
    assert ring.last(3).rows["sequence"].tolist() == [first - 3, first - 2, first - 1]
    inner = part.between((first - 10) * 1e-3, (first - 5) * 1e-3)
    assert inner.rows["sequence"].tolist() == list(range(first - 10, first - 4))
    assert (inner.first, len(part.between(0.0, 1.0).rows)) == (first - 10, 0)
    # A copy: what comes afterwards does not change a picture that is held.
    ring.extend(batch(first, 1000))
    assert part.rows["sequence"][0] == first - 1000


def test_a_curve_shows_every_peak_and_every_gap_and_does_not_flicker():
    ring = RowRing(LAYOUT, 20_000)
    ring.extend(batch(0, 9_000))
    ring.extend(batch(9_100, 10_900, Gap("sense_out", 8_999, 9_100, 100, "link")))
    part = ring.last()
    values = np.zeros(len(part.rows))
    values[[1234, 7777]] = 5.0, -3.0
    time_s, drawn = curve(part, values, 1000)
    assert len(time_s) == len(drawn) <= 1000
    assert np.nanmax(drawn) == 5.0
    assert np.nanmin(drawn) == -3.0
    assert time_s[np.nanargmax(drawn)] == pytest.approx(1.234, abs=0.04)
    hole = time_s[np.isnan(drawn)]
    assert hole.min() - 1e-6 <= 9.1 <= hole.max() + 0.04
    # One row later every group but those at the ends is the same.
    ring.extend(batch(20_000, 1))
    moved_s, _ = curve(ring.last(), np.append(values, 0.0)[-len(ring.last().rows) :], 1000)
    assert set(moved_s[2:-2]) <= set(time_s) | set(moved_s[-4:])
    # Short stretches are drawn row by row; a gap is a hole there, too.
    assert ring.total == 19_901
    few = RowRing(LAYOUT, 100)
    few.extend(batch(0, 3))
    few.extend(batch(9, 2, Gap("sense_out", 2, 9, 6, "board")))
    drawn = curve(few.last(), few.last().rows["tau_Nm"].astype(float), 1000)[1]
    assert np.array_equal(drawn, [0, 1, 2, np.nan, 9, 10], equal_nan=True)
    nothing = RowRing(LAYOUT, 10).last()
    assert [len(x) for x in curve(nothing, np.zeros(0), 1000)] == [0, 0]


def test_spans_join_what_is_near():
    time_s = np.arange(10.0)
    held = np.array([1, 1, 0, 1, 0, 0, 0, 1, 0, 1], bool)
    assert spans(time_s, held, 0.5) == [(0, 1), (3, 3), (7, 7), (9, 9)]
    assert spans(time_s, held, 2.0) == [(0, 3), (7, 9)]
    assert spans(time_s, np.zeros(10, bool), 2.0) == []


def sines(seconds: float, hz: float, amplitude: float, offset: float = 0.0):
    """A stretch of 1 kHz with a sine in it."""
    ring = RowRing(LAYOUT, round(seconds * 1000) + 1)
    ring.extend(batch(0, round(seconds * 1000)))
    part = ring.last()
    return part, offset + amplitude * np.sin(2 * np.pi * hz * part.time_s)


def test_a_trigger_finds_its_edge_between_samples_and_not_across_a_gap():
    part, values = sines(2.0, 3.0, 1.0)
    # asin(0.5) = pi / 6: a twelfth of the period after each rise through zero, 5 / 12 falling.
    rising = crossings(part, values, 0.5, True)
    assert rising == pytest.approx((np.arange(6) + 1 / 12) / 3, abs=1e-5)
    assert crossings(part, values, 0.5, False) == pytest.approx(
        (np.arange(6) + 5 / 12) / 3, abs=1e-5
    )
    assert len(crossings(part, values, 1.5, True)) == 0
    part.after_gap[28] = True  # the first crossing is at 27.8 ms
    assert len(crossings(part, values, 0.5, True)) == 5
    values[360:364] = np.nan
    assert len(crossings(part, values, 0.5, True)) == 4


def test_a_single_trigger_holds_and_a_normal_one_waits_for_whole_pictures():
    part, values = sines(2.0, 3.0, 1.0)
    single = Trigger(SINGLE, 0.5)
    single.arm(0.4)
    early = part.between(0.0, 0.9)
    # The picture of 0.5 s about 1 / 3 s + 1 / 36 s began before it was armed; the next is at 0.694.
    assert math.isnan(single.look(early, values[: len(early.rows)], 0.5))
    assert single.look(part, values, 0.5) == pytest.approx(2 / 3 + 1 / 36, abs=1e-4)
    assert single.done
    assert single.shown_s(0.5) == pytest.approx((0.5944, 1.0944), abs=1e-3)
    part2, values2 = sines(6.0, 3.0, 1.0)
    assert single.look(part2, values2, 0.5) == pytest.approx(2 / 3 + 1 / 36, abs=1e-4)
    normal = Trigger("normal", 0.5)
    assert normal.look(part, values, 0.5) == pytest.approx(4 / 3 + 1 / 36, abs=1e-4)
    assert normal.look(part2, values2, 0.5) == pytest.approx(16 / 3 + 1 / 36, abs=1e-4)
    assert not normal.done


def test_a_sine_is_a_peak_of_its_amplitude():
    from esea_host.windows.plots import amplitudes

    part, values = sines(6.0, 12.5, 0.4, offset=3.0)
    f_Hz, size = amplitudes(part, values + 0.01 * np.cos(2 * np.pi * 100.0 * part.time_s))
    assert f_Hz[np.argmax(size)] == pytest.approx(12.5, abs=0.2)
    assert size.max() == pytest.approx(0.4, rel=0.02)
    assert size[np.argmin(abs(f_Hz - 100.0))] == pytest.approx(0.01, rel=0.02)
    part.after_gap[5980] = True  # too little is left behind it
    assert len(amplitudes(part, values)[0]) == 0


@pytest.mark.ci
def test_a_motor_that_is_warm_is_seen(tmp_path):
    (tmp_path / "warm.toml").write_text(warm_text(), encoding="utf-8")
    with closing(SimulatedBoard(str(tmp_path / "warm.toml"))) as board:
        device = LockstepDevice(board)
        with closing(LiveFeed(device, threaded=False)) as feed:
            run_for(device, feed, 0.4)
            feed.came_s = math.inf
            columns = AxisColumns(feed)
            newest = {name: ring.last() for name, ring in feed.rings.items()}
            told = dict(columns.readouts("", newest))
            acts = [f.name for stream, f in columns.flags("") if f.held(newest[stream].rows)[-1]]
    assert 110 < float(told["winding [\u00b0C]"]) <= 125
    assert 5 <= float(told["torque left [%]"]) < 100
    assert "derated" in acts
