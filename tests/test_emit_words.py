"""Texts, times and numbers of what is emitted round the kernels: cases worked out by hand."""

from __future__ import annotations

import pytest

from esea_gen.emit import example
from esea_gen.emit.wrapping import wrap

# -- times of a drive's recording ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("constants", "wait", "arm", "rest"),
    [
        # Of tasks at every and at every fifth tick the slower one decides, where the least of each
        # is shorter: three runs of it, two, and one whole one after the end.
        ((3, 7, 3), 15, 10, 6),
        ((14, 9, 5), 15, 10, 6),
        ((16, 11, 7), 16, 11, 7),
    ],
)
def test_a_slow_task_lengthens_a_recording(drive, monkeypatch, constants, wait, arm, rest):
    for name, value in zip(("LEAST_WAIT", "SETTLE_TICKS", "REST_TICKS"), constants, strict=True):
        monkeypatch.setattr(example, name, value)
    assert {t.every for t in drive.system.tasks} == {1, 5}
    made = example._Recording(drive.system, 0.3)
    assert (made.wait, made.arm) == (wait, arm)
    # Five ticks armed, 120 of torque.
    assert (made.start, made.end) == (arm + 5, arm + 125)
    assert made.ticks == arm + 125 + rest


def test_torque_is_wanted_between_its_two_ends_alone(drive):
    made = example._Recording(drive.system, 1.0)
    # A parabola that is 1 at two thirds of the way and 3/4 at its end; in steps of 2^-8.
    wanted = [made._wanted(k) for k in range(made.ticks)]
    assert wanted[: made.start + 1] == [0.0] * (made.start + 1)
    assert wanted[made.end :] == [0.0] * (made.ticks - made.end)
    assert wanted[made.start + 40] == 0.75
    assert wanted[made.start + 80] == max(wanted) == 1.0
    x = 1.5 * 119 / 120
    assert wanted[made.end - 1] == round(x * (2 - x) * 256) / 256
    modes = [made._mode(k) for k in range(made.ticks)]
    assert modes == [0.0] * made.start + [1.0] * (made.ticks - made.start)
    # The load stands until then and goes on at 0.2 rad/s.
    angles = [made._load(k) for k in (0, made.start, made.start + 50)]
    assert angles == pytest.approx([made.middle, made.middle, made.middle + 0.01], abs=1e-12)


# -- long lines ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["f", "of", "esea_f"])
def test_a_line_is_broken_behind_a_calls_bracket_where_nothing_else_helps(name):
    long = "a" * 88
    assert wrap(f"    return {name}({long});\n") == (f"    return {name}(\n{' ' * 12}{long});\n")


@pytest.mark.parametrize("word", ["if", "while"])
def test_a_condition_of_one_long_name_stays(word):
    # Its bracket is no call's: a blank stands before it.
    line = f"    {word} ({'a' * 95}) {{\n"
    assert wrap(line) == line
