"""Names of values inside the emitted functions."""

from __future__ import annotations

import re
import subprocess

import casadi as ca
import pytest

import esea_gen
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task

from .conftest import require_tool

# Labels that C, C++ or the function itself already has a meaning for.
AWKWARD = ("register", "class", "bool", "state", "in", "linux", "x_rad", "x_rad_now", "INFINITY")


def system_of(label_names) -> System:
    """A Block that doubles its input once for each label, and keeps the sum."""

    def step(c, s, u, guard, label):
        value = u.x_rad
        for k, name in enumerate(label_names):
            value = label(name, ca.fmin(value * 2.0, 4.0 + k), "why")
        moved = label("moved", value > s.kept_rad, "")
        word = flag_word([moved, ca.logic_not(guard.state_ok)])
        total = ca.if_else(moved, value, s.kept_rad)
        return {"kept_rad": ca.fmax(total, 0.5)}, {"y_rad": ca.fmin(total, 2.0), "status": word}

    flags = (
        Flag("MOVED", "the sum grew", compares=("y_rad",)),
        Flag("STATE_REPAIRED", "the state was corrupt"),
    )
    block = Block.define(
        "awkward",
        "Names",
        period_s=0.001,
        state=(Port("kept_rad", -4.0, 4.0, "sum", init=1.0),),
        inputs=(Port("x_rad", -1.0, 1.0, "input", on_invalid=0.0),),
        outputs=(
            Port("y_rad", -2.0, 2.0, "output"),
            Port("status", 0.0, 3.0, "what happened", flags=flags),
        ),
        step=step,
    )
    return System(
        "names",
        0.001,
        {"awkward": block},
        (Task("only", ("awkward",)),),
        {},
        {"x_rad": ("awkward.x_rad",)},
        {"y_rad": "awkward.y_rad", "status": "awkward.status"},
    )


def locals_of(text: str) -> list[str]:
    body = text[text.index("_step(") :]
    return re.findall(r"const \w+ (\w+) =", body)


def step_text(real: str, label_names) -> dict[str, str]:
    return Renderer(system_of(label_names), FORMATS[real], "-", "-", "Names").own_files()


@pytest.mark.parametrize("real", ["f64", "f32", "q31"])
def test_awkward_labels_still_compile(real, tmp_path):
    files = step_text(real, AWKWARD)
    files |= {p.name: p.read_text() for p in FORMATS[real].sources()}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    names = locals_of(files["esea_names_awkward.c"])
    assert len(names) == len(set(names))
    for compiler in (("gcc", "-std=gnu99"), ("g++", "-std=gnu++17", "-x", "c++")):
        require_tool(compiler[0])
        command = [*compiler, "-fsyntax-only", "-Wall", "-Wextra", "-Wshadow", "-Werror"]
        command += ["-include", "math.h", "esea_names_awkward.c"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("real", "expected"),
    [
        ("f64", {"kept_rad_used", "kept_rad_next", "y_rad_out", "status", "moved"}),
        ("f32", {"kept_rad_used", "kept_rad_next", "y_rad_out", "status", "moved"}),
        ("q31", {"kept_used_q28", "kept_next_q28", "y_out_q28", "status", "moved"}),
    ],
)
def test_a_value_has_the_name_of_its_label_or_its_port(real, expected):
    names = set(locals_of(step_text(real, ("first", "second"))["esea_names_awkward.c"]))
    assert expected <= names
    assert "second" in {n.split("_")[0] for n in names}


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_every_label_of_a_shipped_block_is_a_name(real):
    device = esea_gen.load_device("elbow_drive")
    block = device.system.blocks["limits"]
    printed = FORMATS[real].emit(block).step
    names = {s.name for s in printed.statements}
    inputs = {p.name for p in block.inputs}
    missing = [n for n, _ in block.labels if n not in names | inputs]
    assert missing == []


def test_the_guards_labels_are_these_and_mean_what_they_say():
    def step(c, s, u, guard, label):
        total = label("total", u.x_rad + u.w_rad + ca.sum1(u.v_rad), "sum")
        return {"held_rad": u.w_rad}, {"y_rad": total}

    block = Block.define(
        "guarded",
        "Guard",
        period_s=0.001,
        state=(Port("held_rad", -1.0, 1.0, "last w", init=0.25),),
        inputs=(
            Port("x_rad", -1.0, 1.0, "replaced by a number", on_invalid=0.5),
            Port("v_rad", -1.0, 1.0, "two at once", 2, on_invalid=0.125),
            Port("w_rad", -1.0, 1.0, "replaced by a state", on_invalid="held_rad"),
        ),
        outputs=(Port("y_rad", -4.0, 4.0, "sum"),),
        step=step,
    )
    corrupt, replaced = "Guard: a corrupt state starts", "Guard: an invalid input is replaced"
    assert [(n, c.partition(" the ")[0].rstrip(".")) for n, c in block.labels] == [
        ("state_ok", corrupt),
        *(("x_rad_ok", ""), ("x_rad_used", replaced)),
        ("v_rad_ok", ""),  # of two elements there is no one value to name
        *(("w_rad_ok", ""), ("w_rad_used", replaced)),
        ("inputs_ok", ""),
        ("total", "sum"),
    ]
    # By what each label says, from (held, x, v, w).
    for held, x, v, w, expected in (
        (0.75, -1.0, (0.5, 1.0), 0.5, (1, 1, -1.0, 1, 1, 0.5, 1, 1.0)),
        (0.75, 1.5, (0.5, 1.0), 9.0, (1, 0, 0.5, 1, 0, 0.75, 0, 2.75)),
        (3.0, 0.0, (0.5, 2.0), -9.0, (0, 1, 0.0, 0, 0, 0.25, 0, 0.5)),
        (float("nan"), 0.0, (0.0, 0.0), 0.0, (0, 1, 0.0, 1, 1, 0.0, 1, 0.0)),
    ):
        found = block.labelled_step(held, x, ca.DM(v), w)[2:]
        assert tuple(float(f) for f in found) == expected


def test_a_name_that_two_structs_have_stands_with_its_structs():
    def step(c, s, u, guard, label):
        total = c.gain * u.x + s.gain + s.both + u.both + c.both
        new = {"gain": total, "both": u.w[1], "kept": [total, u.x]}
        return new, {"y": total + s.kept[0] - s.kept[1] + u.w[0]}

    block = Block.define(
        "clash",
        "Names",
        period_s=0.001,
        tunables=(Tunable("gain", 1.0, 0.5, 2.0, "factor"),),
        coefficients=(Port("gain", 0.5, 2.0, "factor"), Port("both", 0.5, 2.0, "too")),
        prepare=lambda t: {"gain": 1 * t.gain, "both": 1 * t.gain},
        state=(
            Port("gain", -9.0, 9.0, "sum"),
            Port("both", -9.0, 9.0, "older"),
            Port("kept", -9.0, 9.0, "oldest", 2),
        ),
        inputs=(
            Port("x", -1.0, 1.0, "in"),
            Port("both", -1.0, 1.0, "in too"),
            Port("w", -1.0, 1.0, "pair", 2),
        ),
        outputs=(Port("y", -99.0, 99.0, "out"),),
        step=step,
    )
    made = FORMATS["f64"].emit(block)
    reads = {s.name: s.expression for s in made.step.statements if "->" in s.expression}
    assert reads == {
        "coeffs_gain": "coeffs->gain",
        "coeffs_both": "coeffs->both",
        "state_gain_now": "state->gain",
        "state_both_now": "state->both",
        "kept_now_0": "state->kept[0]",
        "kept_now_1": "state->kept[1]",
        "x": "in->x",
        "in_both": "in->both",
        "w_0": "in->w[0]",
        "w_1": "in->w[1]",
    }
    assert [s.expression for s in made.prepare.statements] == ["params->gain"]
    assert made.init.results == (("0.0",), ("0.0",), ("0.0", "0.0"))
