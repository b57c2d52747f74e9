"""What the example of a drive needs, tries and refuses, with small stand-ins for Systems."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from esea_gen.control.faults import FAULT_TEXT, Fault
from esea_gen.emit import example
from esea_gen.emit.example import (
    Axis,
    Column,
    drive_example,
    has_drive,
    tolerance,
    triangle_example,
)
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, flag_word
from esea_gen.language.system import System, Task


def named(name: str, *signals: str) -> SimpleNamespace:
    """An external value that feeds, or comes from, "instance.port"."""
    ends = [s.split(".") for s in signals]
    return SimpleNamespace(
        name=name, signals=tuple(SimpleNamespace(instance=i, port=p) for i, p in ends)
    )


# -- the latch, tick by tick -----------------------------------------------------------------------

STOPPED, NONE = float(Fault.STOP), float(Fault.NONE)
AXES = tuple(Axis(named(f"mode_{a}"), named(f"u_{a}"), named(f"fault_{a}")) for a in "kh")
WAIT = 3
# What is asked for how many ticks, what every axis must tell, and what is said where one does not.
TRIAL = (
    ({"halt": 1.0}, 1, STOPPED, "a stop does not latch"),
    ({"halt": 0.0}, WAIT, STOPPED, "the latch opens when the stop is over"),
    ({"again": 6.0}, WAIT, STOPPED, "rearm opens it in torque mode"),
    ({"mode_k": 0.0, "mode_h": 0.0}, WAIT, STOPPED, "mode 0 opens it"),
    ({"again": 7.0}, 1, NONE, "rearm in mode 0 does not open it"),
    ({"mode_k": 1.0, "mode_h": 1.0}, WAIT, NONE, "torque mode closes it again"),
)


class Latch:
    """Does as the trial demands, but for some outputs at one tick."""

    def __init__(self, wrong_at: int = -1, **wrong: float) -> None:
        self.asked: list[dict[str, float]] = []
        self.wrong_at, self.wrong = wrong_at, wrong
        self.faults = [fault for _, count, fault, _ in TRIAL for _ in range(count)]

    def tick(self, given: dict[str, float]) -> dict[str, float]:
        now = len(self.asked)
        self.asked.append(dict(given))
        fault = self.faults[now]
        moves = 0.0 if fault == STOPPED else 2.5
        out = {f"fault_{a}": fault for a in "kh"} | {f"u_{a}": moves for a in "kh"}
        self.out = out | (self.wrong if now == self.wrong_at else {})
        return self.out


def tried(latch: Latch, driven: bool = False) -> str:
    made = SimpleNamespace(
        axes=AXES, stop=named("halt"), rearm=named("again"), wait=WAIT, rearmed=5, driven=driven
    )
    return example._latch_fails(made, latch)


def test_a_latch_is_tried_in_six_ways_as_long_as_its_task_needs():
    latch = Latch()
    assert tried(latch, driven=True) == ""
    assert latch.asked == [given for given, count, _, _ in TRIAL for _ in range(count)]


@pytest.mark.parametrize("axis", ["k", "h"])
def test_a_latch_that_fails_at_any_tick_on_any_axis_is_told_by_what_was_asked(axis):
    end = 0
    for _, count, fault, said in TRIAL:
        for tick in range(end, end + count):
            for other in {STOPPED, NONE, float(Fault.NOT_ARMED)} - {fault}:
                latch = Latch(tick, **{f"fault_{axis}": other})
                assert tried(latch) == said
                assert len(latch.asked) == end + count  # no more is asked
            # What is closed commands nothing; what is open may.
            for command in (1e-9, -1.0):
                expected = said if fault == STOPPED else ""
                assert tried(Latch(tick, **{f"u_{axis}": command})) == expected
            assert tried(Latch(tick, **{f"u_{axis}": 0.0})) == ""
        end += count


@pytest.mark.parametrize("axis", ["k", "h"])
def test_a_law_that_moved_the_motor_moves_it_again_when_the_latch_was_tried(axis):
    last = sum(count for _, count, _, _ in TRIAL) - 1
    stands = {f"u_{axis}": 0.0}
    said = "after the latch was opened again, the motor is not driven"
    assert tried(Latch(last, **stands), driven=True) == said
    assert tried(Latch(last, **stands)) == ""
    assert tried(Latch(last - 1, **stands), driven=True) == ""


# -- how much torque is tried ----------------------------------------------------------------------


def limits(tau_max_Nm: float) -> SimpleNamespace:
    """A System whose limits allow a torque."""
    tunables = [
        SimpleNamespace(name=n, default=v) for n, v in (("k", 7.0), ("tau_max_Nm", tau_max_Nm))
    ]
    kinds = [SimpleNamespace(name="other", tunables=[]), SimpleNamespace(name="limits")]
    kinds[1].tunables = tunables
    return SimpleNamespace(name="small", kinds=kinds)


@pytest.mark.parametrize("works", [0, 1, 2])
def test_the_largest_of_three_shares_of_the_torque_that_works_is_taken(monkeypatch, works):
    asked = []

    def attempt(system, most_Nm):
        asked.append(most_Nm)
        return ("made", "") if len(asked) == works + 1 else (None, "it stops")

    monkeypatch.setattr(example, "_tried", attempt)
    assert drive_example(limits(50.0)) == "made"
    assert asked == pytest.approx([2.0, 0.75, 0.25][: works + 1])


def test_where_none_works_the_last_reason_is_told(monkeypatch):
    reasons = iter(("first", "second", "third"))
    monkeypatch.setattr(example, "_tried", lambda system, most_Nm: (None, next(reasons)))
    with pytest.raises(UserError, match=r"^small: .* cannot show the drive at work: third\."):
        drive_example(limits(50.0))


class Course:
    """A recording of three ticks whose outputs are given."""

    ticks, wait, tunables = 3, 15, {"enc": {"zeroed": 1.0}}

    def __init__(self, system: SimpleNamespace, outs: list[dict[str, float]]) -> None:
        self.given, self.moved, self.outs = [], [], iter(outs)
        self.ends = {x.signals[0].port: x for x in system.inputs}
        feeds = (self.ends["mode"], self.ends["extra"])
        self.columns = ((Column("mode", feeds), lambda k: 10.0 + k),)
        self.held = {"halt": 0.25, "mode": 0.5, "extra": 0.75}
        self.drive = SimpleNamespace(move=lambda *numbers: self.moved.append(numbers))
        self.run = SimpleNamespace(tick=self.tick)

    def tick(self, given: dict[str, float]) -> dict[str, float]:
        self.given.append(given)
        return next(self.outs)

    def _of(self, port: str) -> tuple[SimpleNamespace, ...]:
        return (self.ends[port],)


def course(monkeypatch, outs, *outputs: str):
    """What is tried on a recording, and the recording."""
    ends = {"halt": "lim.stop", "again": "lim.rearm", "mode": "lim.mode", "extra": "lim.extra"}
    made = SimpleNamespace(
        inputs=tuple(named(n, end) for n, end in ends.items()),
        outputs=tuple(named(n.partition(".")[2], n) for n in outputs),
        blocks={"lim": SimpleNamespace(name="limits"), "sensor": SimpleNamespace(name="sensor")},
    )
    recording = Course(made, outs)
    monkeypatch.setattr(example, "_Recording", lambda system, most_Nm: recording)
    monkeypatch.setattr(example, "_axis", lambda system, external, kind: "")
    monkeypatch.setattr(example, "_latch_fails", lambda made, run: "")
    return example._tried(made, 0.3), recording


def test_a_recording_is_what_was_given_and_what_came_of_it(monkeypatch):
    outs = [
        {"u_Nm": 0.5 * k, "tau_Nm": 3.0 + k / 3, "fault": float(Fault.STOP) * (k < 2)}
        for k in range(3)
    ]
    (made, said), recording = course(monkeypatch, outs, "lim.u_Nm", "sensor.tau_Nm", "lim.fault")
    assert said == ""
    assert recording.given == [{"mode": 10.0 + k, "extra": 10.0 + k} for k in range(3)]
    assert recording.moved == [(o["u_Nm"], o["tau_Nm"]) for o in outs]
    assert [x.name for x in made.checked] == ["u_Nm", "tau_Nm", "fault"]
    assert [r.given for r in made.rows] == [(10.0,), (11.0,), (12.0,)]
    assert [r.expected for r in made.rows] == [
        (0.0, 3.0, 4.0), (0.5, 3.333333, 4.0), (1.0, 3.666667, 0.0),
    ]  # fmt: skip
    assert made.held == {"halt": 0.25}
    assert (made.stop.name, made.rearm.name, made.axes[0].mode.name) == ("halt", "again", "mode")
    assert (made.wait, made.rearmed, made.driven) == (15, 1, True)
    assert made.tunables == (("enc", "zeroed", 1.0),)


def test_a_recording_that_ends_in_a_fault_tells_which(monkeypatch):
    outs = [{"u_Nm": 0.0, "fault": float(Fault.TORQUE) * (k == 2)} for k in range(3)]
    (made, said), recording = course(monkeypatch, outs, "lim.u_Nm", "lim.fault")
    assert made is None
    assert said == f"on its recording fault is {Fault.TORQUE}: {FAULT_TEXT[Fault.TORQUE]}"
    assert recording.moved == [(0.0, 0.0)] * 3  # without a torque sensor none is taken
    (made, _), _ = course(monkeypatch, 3 * outs[:1], "lim.u_Nm", "lim.fault")
    assert made.driven is False


# -- what is a drive -------------------------------------------------------------------------------

INPUTS = {
    "count_m": ("encoder_motor_knee.count",),
    "count_l": ("encoder_load.count",),
    "halt": ("lim_knee.stop",),
    "again": ("lim_knee.rearm",),
    "mode": ("law.mode", "lim_knee.mode"),
}
OUTPUTS = {"u": ("lim_knee.u_Nm",), "fault": ("lim_knee.fault",)}


def system(without: str = "", latches: tuple[str, ...] = ("held",), **other) -> SimpleNamespace:
    given, made = (
        tuple(named(n, *other.get(n, s)) for n, s in ends.items() if n != without)
        for ends in (INPUTS, OUTPUTS)
    )
    blocks = {"lim_knee": "limits", "law": "smc", "other": "watcher"}
    blocks |= dict.fromkeys(("encoder_motor_knee", "encoder_load", "encoder_gear"), "encoder")
    return SimpleNamespace(
        inputs=given,
        outputs=made,
        latches=latches,
        blocks={i: SimpleNamespace(name=n) for i, n in blocks.items()},
    )


def test_a_drive_has_two_encoders_limits_a_mode_and_a_latch():
    assert has_drive(system()) is True
    for name in (*INPUTS, *OUTPUTS):
        assert has_drive(system(name)) is False, name
    assert has_drive(system(latches=())) is False


@pytest.mark.parametrize(
    "other",
    [
        {"halt": ("other.stop",)},  # of another Block than the limits
        {"u": ("lim_knee.tau_Nm",)},
        {"count_m": ("encoder_gear.count",)},
        {"count_l": ("encoder_load.frame_error",)},
        {"mode": ("law.rearm",)},
    ],
)
def test_no_other_end_of_a_wire_stands_for_one_of_them(other):
    assert has_drive(system(**other)) is False


def test_the_axis_is_what_follows_the_blocks_name():
    blocks = {
        **{f"limits{a}": SimpleNamespace(name="limits") for a in ("", "_knee", "_hip")},
        "law_knee": SimpleNamespace(name="smc"),
    }
    made = SimpleNamespace(blocks=blocks)
    for x, axis in (
        (named("a", "limits.u_Nm"), ""),
        (named("b", "law_knee.mode", "limits_hip.mode"), "_hip"),
        (named("c", "limits_knee.mode", "limits_hip.mode"), "_knee"),
    ):
        assert example._axis(made, x, "limits") == axis
    with pytest.raises(AssertionError, match="d has nothing to do with limits"):
        example._axis(made, named("d", "law_knee.mode"), "limits")


# -- a triangle ------------------------------------------------------------------------------------


def small(inputs: tuple[Port, ...], outputs: tuple[Port, ...], values) -> System:
    """A System of one Block, all of its ports external; values of the outputs from the inputs."""
    block = Block.define(
        "only",
        "Only",
        period_s=0.001,
        state=(),
        inputs=inputs,
        outputs=outputs,
        step=lambda _c, _s, u, _guard, _label: ({}, values(u)),
    )
    given = {p.name: (f"only.{p.name}",) for p in inputs}
    made = {p.name: f"only.{p.name}" for p in outputs}
    return System("small", 0.001, {"only": block}, (Task("run", ("only",)),), {}, given, made)


PAIR, Y = Port("pair_Nm", -1, 1, "two", 2), Port("y_Nm", -9, 9, "out")
WORD = Port("state_word", 0, 1, "word", flags=(Flag("UP", "above zero"),))


def test_the_first_number_is_moved_and_the_first_number_that_answers_is_compared():
    alike = {"a_Nm": (-1, 1), "b_Nm": (-1, 1.5), "c_Nm": (-1.5, 1), "d_rad": (-1, 1)}
    inputs = (PAIR, *(Port(n, *ends, "in") for n, ends in alike.items()))
    outputs = (PAIR, WORD, Port("rest_Nm", -9, 9, "stays"), Y, Port("z_Nm", -9, 9, "out"))
    made = triangle_example(
        small(
            inputs,
            outputs,
            lambda u: {
                "pair_Nm": [u.a_Nm, -u.a_Nm],
                "state_word": flag_word([u.a_Nm > 0]),
                "rest_Nm": u.b_Nm + u.pair_Nm[0],
                "y_Nm": 3 * u.a_Nm + u.d_rad,
                "z_Nm": u.a_Nm,
            },
        )
    )
    assert (made.input.name, made.output.name) == ("a_Nm", "y_Nm")
    assert len(made.samples) == 12
    assert max(s.expected for s in made.samples) > 1


def test_only_what_has_the_same_unit_and_ends_starts_where_the_triangle_does():
    others = {"b_Nm": (2, 6), "c_Nm": (2, 7), "d_Nm": (1, 6), "e_rad": (2, 6), "f_Nm": (-7, -4)}
    inputs = tuple(Port(n, *ends, "in", on_invalid=ends[0])
                   for n, ends in {"a_Nm": (2, 6), **others}.items())  # fmt: skip
    made = triangle_example(small(inputs, (Y,), lambda u: {"y_Nm": u.a_Nm}))
    assert dict(made.held) == {
        "a_Nm": 3.0, "b_Nm": 3.0, "c_Nm": 2.0, "d_Nm": 1.0, "e_rad": 2.0, "f_Nm": -4.0,
    }  # fmt: skip


def test_where_nothing_is_moved_or_answers_there_is_no_example():
    with pytest.raises(UserError, match=r"small: .*: it has no external input of one number"):
        triangle_example(small((PAIR,), (Y,), lambda u: {"y_Nm": u.pair_Nm[0]}))
    x = Port("x_Nm", -1, 1, "in")
    with pytest.raises(UserError, match=r"small: .*: x_Nm moves no output"):
        triangle_example(
            small(
                (x,),
                (PAIR, WORD, Y),
                lambda u: {
                    "pair_Nm": [u.x_Nm] * 2,
                    "state_word": flag_word([u.x_Nm > 0]),
                    "y_Nm": 1,
                },
            )
        )


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-4.0, -3.0, (-3840, 128, 2.0**-10)),
        (-50.0, 0.0, (-1200, 200, 2.0**-5)),
        (-900.0, 2.0, (0, 128, 2.0**-7)),
        # A quarter of it is between two numbers, and goes to the even one; a step of one is least.
        (0.0, 1001.0, (500, 250, 0.5)),
        (2.0, 4.0e6, (1000002, 255, 1.0)),
    ],
)
def test_start_peak_and_lattice_of_a_range(low, high, expected):
    start, peak, lattice = expected
    found = example._lattice(Port("x_Nm", low, high, "in"))
    assert found[2] == lattice
    assert (found[0], found[1]) == (start, peak)


def test_expected_numbers_have_six_digits_and_zero_no_sign():
    assert example._number(1.23456749) == 1.234567
    assert example._number(-1.2345676) == -1.234568
    assert math.copysign(1, example._number(-4.9e-7)) == 1.0
    assert [example._wave(x) for x in (0.0, 0.5, 1.0, 1.5, 2.0)] == [0.0, 0.75, 1.0, 0.75, 0.0]


def test_a_command_is_allowed_at_least_four_thousandths_of_its_range_and_what_is_more_coarse():
    ends = {"u": "lim.u_Nm", "fault": "lim.fault", "far": "law.u_Nm"}
    blocks = {"lim": SimpleNamespace(name="limits"), "law": SimpleNamespace(name="smc")}
    u, fault, far = (named(n, end) for n, end in ends.items())
    for x in (u, fault, far):
        x.port = Port("x_Nm", -50.0, 20.0, "out")
    made = SimpleNamespace(blocks=blocks)
    assert [tolerance(made, x, 1e-5) for x in (u, fault, far)] == [0.2, 0.0005, 0.0005]
    assert [tolerance(made, x, 1e-2) for x in (u, fault, far)] == [0.5] * 3
