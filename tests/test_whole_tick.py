"""What a tick costs with link and drivers, and how long a reading is under way."""

from __future__ import annotations

from dataclasses import asdict
from itertools import pairwise

import pytest

from esea_gen import files
from tests.benchmarks.whole_tick import AIM, _latency, whole_tick

from .conftest import require_tool


def test_a_reading_reaches_the_motor_within_a_period_of_control_and_a_release(drive):
    """By the latches: seen by control a tick later at the earliest, its command a tick after it."""
    require_tool("gcc")
    through_control, limits = _latency(drive)
    control = drive.system.tasks[-1]
    assert sorted(through_control) == list(range(2, 2 + control.every))
    # From one phase to the next the wait for the next run is one tick shorter.
    for now, then in pairwise(through_control):
        assert then == (now - 1 if now > 2 else 1 + control.every)
    assert limits == 3  # bad frames are bridged; the tick in which they are not


@pytest.mark.slow
def test_the_whole_tick_on_the_cortex_m4f_is_within_its_aim(drive):
    for tool in ("qemu-system-arm", "arm-none-eabi-gcc"):
        require_tool(tool)
    found = whole_tick(drive, runs=1)
    files.stamped("bench-whole-tick", asdict(found))
    assert 5000 < found.tick[1] < 20000
    assert 1000 < found.control[1] < 4000
    assert found.share < AIM
    assert found.stack_bound_bytes < found.stack_bytes
