"""Inconsistent Systems are rejected with the faulty name."""

from __future__ import annotations

from functools import cache

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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"blocks": {"watch": block("watch")}}, "no block may be called watch"),
        ({"blocks": {"slow": block("Shared")}}, r"named shared \(in any case\)"),
        ({"blocks": {"slow": block("lazy")}}, r"named lazy \(in any case\)"),
        ({"inputs": {"a": ("first.x_rad", "again.x_m")}}, "no such port again.x_m; there are"),
        ({"inputs": {"a": ("nobody.x_rad",)}}, r"no such port nobody.x_rad; there are \[\]"),
        ({"outputs": {"a": "first.x_rad"}}, "no such port first.x_rad; there are .'y_rad', 'twic"),
        ({"outputs": {"a": "watch.nothing"}}, "no such port watch.nothing; there are .'clock_ok'"),
        ({"wires": {"middle.x_rad": "first.pair"}}, r"1 x 2\) feeds .*rad x 1\)"),
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
