"""Watch of ticks and runs, against its documentation."""

from __future__ import annotations

import pytest

from esea_gen.language.watch import LATE_MOST, TaskWatch


def seen(watch):
    return {k: int(v) for k, v in watch.values().items()}


def late_runs(count, every=5):
    """Runs of a task that have not ended when their release comes, one after the other."""
    watch, levels = TaskWatch(), []
    for tick in range(count * every + 1):
        watch.see(tick)
        if tick and tick % every == 0:
            watch.due("control")
            levels.append(seen(watch)["late_level"])
        if tick % every == 0:
            watch.start("control")
    return levels


def test_eleven_late_runs_of_the_control_task_are_bridged_and_the_twelfth_is_not():
    levels = late_runs(12)
    # 16 for each, 1 off at each of the five ticks between two.
    assert levels == [16 * n - 5 * (n - 1) for n in range(1, 13)]
    assert levels[10] <= LATE_MOST < levels[11]
    # It ends at 255 and stays there.
    assert set(late_runs(60)[30:]) == {255}


def test_one_late_run_in_sixteen_ticks_is_forgotten_as_it_comes():
    assert late_runs(6, every=16) == [16] * 6


def test_a_run_that_has_ended_is_in_time_and_each_task_has_its_own():
    watch = TaskWatch()
    watch.see(0)
    watch.due("sense")  # of a task that never ran nothing is due
    for task in ("sense", "control"):
        watch.start(task)
    watch.end("sense")
    watch.see(1)
    watch.due("sense")
    assert seen(watch)["late_level"] == 0
    watch.due("control")
    assert seen(watch)["late_level"] == 16
    # It ends after all; the next one is judged for itself.
    watch.end("control")
    watch.due("control")
    assert seen(watch)["late_level"] == 16


@pytest.mark.parametrize(
    ("before", "now", "ok"),
    [
        (7, 8, 1),
        (7, 7, 0),
        (7, 9, 0),
        (7, 6, 0),
        (2**32 - 1, 0, 1),
        (2**32 - 1, 1, 0),
        (0, 2**31, 0),
    ],
)
def test_a_tick_follows_the_one_before(before, now, ok):
    watch = TaskWatch()
    watch.see(before)  # the first may be any
    assert seen(watch) == {"clock_ok": 1, "late_level": 0, "coeffs_ok": 0}
    watch.see(now)
    assert seen(watch)["clock_ok"] == ok
    watch.see((now + 1) % 2**32)
    assert seen(watch)["clock_ok"] == 1


@pytest.mark.parametrize("start", [0, 7, 2**32 - 1])
def test_only_the_next_tick_is_in_order_however_far_the_other_is(start):
    """Lost, repeated, backward; by one more than any power of two as well."""
    for jump in (1, 0, 2, -1, *(2**k + 1 for k in range(1, 32)), *(1 - 2**k for k in range(1, 32))):
        watch = TaskWatch()
        watch.see(start)
        watch.see((start + jump) % 2**32)
        assert seen(watch)["clock_ok"] == (jump == 1), jump
