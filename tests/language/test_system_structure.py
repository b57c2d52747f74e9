"""How a System hangs together: who feeds whom, what is latched, what the watch is asked."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable
from esea_gen.language.system import System
from esea_gen.language.watch import WATCHED
from esea_gen.language.wires import Task

H = 1e-3


@cache
def block(name: str, every: int = 1, gain: bool = False, inputs=None, latched=False) -> Block:
    """y is ten times x (or the gain times it) and the sum of all else; twice it is told too."""
    inputs = inputs or (Port("x_rad", -9e9, 9e9, "x"),)

    def step(c, s, u, guard, label):
        first, *rest = vars(u).values()
        y = (c.factor if gain else 10) * first + sum(rest)
        return {}, {"y_rad": y, "twice_rad": 2 * y, "pair": [y, -y]}

    return Block.define(
        *(name, "made up"),
        period_s=every * H,
        tunables=(Tunable("gain", 10.0, 0.0, 99.0, "gain"),) if gain else (),
        coefficients=(Port("factor", 0, 99, "gain"),) if gain else (),
        prepare=(lambda t: {"factor": 1 * t.gain}) if gain else None,
        state=(),
        inputs=inputs,
        outputs=(
            Port("y_rad", -9e9, 9e9, "y"),
            Port("twice_rad", -9e9, 9e9, "twice"),
            Port("pair", -9e9, 9e9, "pair", 2),
        ),
        step=step,
        starts_latched=latched,
    )


WATCHING = (Port("x_rad", -9e9, 9e9, "x"), *WATCHED.values())


def parts(asked: str = "coeffs_ok") -> dict:
    """Three tasks of one, two and four ticks; the two slow ones are tuned."""
    shared = block("shared")
    seen = (Port("x_rad", -9e9, 9e9, "x"), WATCHED[asked])
    return {
        "name": "three",
        "base_period_s": H,
        "blocks": {
            "first": shared,
            "again": shared,
            "middle": block("middle", 2, True, seen),
            "slow": block("slow", 4, True, latched=True),
            "also": block("also", 4),
        },
        "tasks": (
            Task("fast", ("first", "again")),
            Task("medium", ("middle",), every=2, phase=1),
            Task("lazy", ("slow", "also"), every=4, phase=2, release=3),
        ),
        "wires": {
            "again.x_rad": "slow.y_rad",
            "middle.x_rad": "first.y_rad",
            f"middle.{asked}": f"watch.{asked}",
            "slow.x_rad": "first.twice_rad",
            "also.x_rad": "slow.y_rad",
        },
        "inputs": {"given_rad": ("first.x_rad",)},
        "outputs": {
            "told_rad": "again.y_rad",
            "middle_rad": "middle.y_rad",
            "lazy_rad": "also.y_rad",
            "pair": "first.pair",
        },
    }


def test_the_slowest_tuned_task_checks_where_that_is_asked():
    assert System(**parts()).checker == "lazy"
    assert System(**parts("late_level")).checker == ""
    changed = parts()
    changed["blocks"]["slow"] = block("slow", 4)
    assert System(**changed).checker == "medium"
    both = parts()
    both["blocks"]["middle"] = block("middle", 2, True, WATCHING)
    both["wires"] |= {f"middle.{n}": f"watch.{n}" for n in WATCHED}
    s = System(**both)
    assert [p.name for p in s.watched(s.task("medium"))] == list(WATCHED)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"blocks": {"watch": block("watch")}}, "no block may be called watch"),
        ({"inputs": {"a": ("first.x_rad", "again.x_m")}}, "no such port again.x_m; there are"),
        ({"inputs": {"a": ("nobody.x_rad",)}}, r"no such port nobody.x_rad; there are \[\]"),
        ({"outputs": {"a": "first.x_rad"}}, "no such port first.x_rad; there are .'y_rad', 'twic"),
        ({"outputs": {"a": "watch.nothing"}}, "no such port watch.nothing; there are .'clock_ok'"),
        ({"wires": {"middle.x_rad": "first.pair"}}, r"\(1 x 2\) feeds .*\(rad x 1\)"),
        ({"wires": {"also.x_rad": "also.y_rad"}}, "must run before .* in task lazy"),
        ({"wires": {"slow.x_rad": "also.y_rad"}}, "must run before .* in task lazy"),
        ({"wires": {"first.x_rad": "slow.y_rad"}}, "an input port is fed twice"),
        ({"wires": {"again": "slow.y_rad"}}, "'again' is not of the form instance.port"),
        ({"wires": {"again.": "slow.y_rad"}}, "'again.' is not of the form instance.port"),
        ({"wires": {".x_rad": "slow.y_rad"}}, "'.x_rad' is not of the form instance.port"),
        ({"inputs": {}}, "input first.x_rad is not fed"),
    ],
)
def test_what_does_not_hang_together_is_refused(change, words):
    given = parts()
    for key, value in change.items():
        given[key] = given[key] | value if key != "inputs" else value
    with pytest.raises(ValueError, match=words):
        System(**given)


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ({"phase": -1}, r"task lazy: phase -1 must be in \[0, 4\)"),
        ({"phase": 4}, r"task lazy: phase 4 must be in \[0, 4\)"),
        ({"every": 0}, "task lazy: phase 0 must be in"),
        ({"release": 0}, r"task lazy: release 0 must be in \[1, 4\]"),
        ({"release": 5}, r"task lazy: release 5 must be in \[1, 4\]"),
        ({"every": 5}, "slow is built for 0.004 s, but task lazy runs every 0.005 s"),
        ({"blocks": ("slow",)}, "tasks run .*, but the blocks are"),
        ({"blocks": ("slow", "also", "also")}, "tasks run .*, but the blocks are"),
    ],
)
def test_tasks_fit_their_blocks(task, words):
    given = parts()
    lazy = {"blocks": ("slow", "also"), "every": 4} | task
    given["tasks"] = (*given["tasks"][:2], Task("lazy", **lazy))
    with pytest.raises(ValueError, match=words):
        System(**given)
    for release in (1, 4, None):  # the ends are taken
        given["tasks"] = (*given["tasks"][:2], Task("lazy", ("slow", "also"), 4, 3, release))
        assert System(**given).tasks[2].phase == 3


def test_a_schedule_by_hand():
    s = System(**parts())
    run = s.simulator({"slow": {"gain": 3.0}})
    given = np.arange(1.0, 13.0)
    told, middles, lazies, levels = [], [], [], []
    for k, x in enumerate(given):
        run.release(k)
        out = run.step("fast", given_rad=x)
        assert out["pair"].tolist() == [10 * x, -10 * x]
        assert list(out) == ["told_rad", "pair"]
        told.append(out["told_rad"])
        if k % 2 == 1:
            middles.append(run.step("medium")["middle_rad"])
        if k % 4 == 2:
            lazies.append(run.step("lazy")["lazy_rad"])
        levels.append(run.watch.late_level)
    # Started at 1, 3 ...: what fast wrote a tick before.  Coefficients are known to be whole from
    # the release of the lazy task's first run, three ticks after its start at 2.
    first = 10 * given
    assert middles == [10 * first[k - 1] + (k >= 5) for k in range(1, 12, 2)]
    # Started at 2, 6, 10; three times what was twice fast's; then ten times it.
    slow = {k: 3 * 2 * first[k - 1] for k in (2, 6, 10)}
    assert lazies == [10 * v for v in slow.values()]
    # Released three ticks after each start.
    expected = [0.0] * 5 + [10 * slow[2]] * 4 + [10 * slow[6]] * 3
    assert told == expected
    assert set(levels) == {0}
    # A run that has not ended at its release is late; what it holds is from its start.
    late = s.simulator()
    for k in range(7):
        late.release(k)
        late.step("fast", given_rad=1.0)
    assert late.watch.late_level > 0
    assert late.watch.coeffs_ok == 0  # for the checking run has not ended
    assert late.held["medium"] == {"first_y_rad": 10.0}
    # The medium task's runs were due at 3 and 5, the lazy one's at 5; one is forgotten a tick.
    assert late.seen["lazy"]["late_level"] == (16 - 2) + 2 * 16 - 1
