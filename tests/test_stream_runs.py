"""A stream through a C, an executor and an emulated board, piece by piece: runners are made up."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.ports import Flag, Port
from esea_gen.language.stream import Stream
from esea_gen.verify import coverage, preempt, runs
from esea_gen.verify.coverage import Coverage, Decision
from esea_gen.verify.one_step import drift
from esea_gen.verify.preempt import Preemption, preempt_everywhere


def thing(**parts):
    return SimpleNamespace(**parts)


class Counting:
    """A Block that sums what it is given; 100 more after a reset, so that it is seen."""

    def __init__(self) -> None:
        self.sum, self.log = 0.0, []
        self._coeffs = [thing(raw=bytearray(b"gain"), g=1.0, v=[0.0, 0.0])]
        self.library = thing(ffi=thing(buffer=lambda c: c.raw))

    def run(self, inputs, trace=True, raw=False):
        x = inputs["x"]
        self.log.append((len(x), trace, raw))
        made = self.sum + np.cumsum(x * self._coeffs[0].g)
        self.sum = float(made[-1])
        return {"y": 2 * made}, {"s": made}

    def reset(self):
        self.sum = 1000.0

    @property
    def state(self):
        return self.sum

    @state.setter
    def state(self, value):
        self.sum = value

    def put_state(self, values):
        self.sum = float(values["s"])


def test_a_stream_in_pieces_between_what_is_put_in():
    x = np.arange(1.0, 11.0)
    stream = Stream("s", {"x": x}, {3: {"s": np.array(50.0)}}, {6: {"g": np.array([2.0])}})
    assert runs._segments(stream) == [(0, 3), (3, 6), (6, 10)]
    expected = [*np.cumsum(x[:3]), *(50 + np.cumsum([*x[3:6], *(2 * x[6:])]))]
    runner = Counting()
    y, s = runs.run_c(runner, stream)
    assert (s["s"].tolist(), y["y"].tolist()) == (expected, [2 * v for v in expected])
    assert runner.log == [(3, True, False), (3, True, False), (4, True, False)]
    # Stopped in its middle and at every cut, disturbed, and put back: the same.
    runner = Counting()
    y, s = runs.run_c(runner, stream, restore=True, raw=True)
    assert s["s"].tolist() == expected
    pieces = [(3, True, True), (2, True, True), (7, False, False), (1, True, True)]
    assert runner.log == [*pieces, (7, False, False), (4, True, True)]
    plain = Stream("s", {"x": x})
    runner = Counting()
    assert runs.run_c(runner, plain, restore=True)[1]["s"].tolist() == np.cumsum(x).tolist()
    assert [n for n, *_ in runner.log] == [5, 7, 5]


def test_a_stream_that_is_cut_in_its_middle_is_not_cut_twice():
    stream = Stream("s", {"x": np.ones(10)}, {5: {"s": np.array(50.0)}})
    runner = Counting()
    runs.run_c(runner, stream, restore=True)
    assert [n for n, *_ in runner.log] == [5, 5]


def test_a_symbolic_block_is_given_what_is_put_in():
    class Simulator:
        def __init__(self):
            self.coefficients, self.state = {"g": np.array([1.0]), "h": np.array([5.0])}, {"s": 0.0}

        def run(self, inputs):
            made = self.state["s"] + np.cumsum(inputs["x"] * self.coefficients["g"][0])
            self.state = {"s": made[-1]}
            return {"y": made + self.coefficients["h"][0]}, {"s": made}

    ports = [Port(n, 0.0, 9.0, n) for n in ("g", "h")]
    block = thing(coefficients=ports, simulator=Simulator)
    x = np.arange(1.0, 7.0)
    stream = Stream("s", {"x": x}, {2: {"s": 50.0}}, {4: {"g": np.array([3.0])}})
    y, s = runs.run_symbolic(block, stream)
    assert s["s"].tolist() == [1, 3, 53, 57, 72, 90]
    assert y["y"].tolist() == [v + 5 for v in s["s"]]


def test_coefficients_are_put_in_over_those_that_were_prepared():
    runner = Counting()
    (held,) = runner._coeffs
    values = {"g": np.array([3.0]), "v": np.array([4.0, 5.0])}
    held.raw[:] = b"lost"
    runs._put_coefficients(runner, [b"gain"], values)
    assert (held.raw, held.g, held.v) == (b"gain", 3.0, [4.0, 5.0])
    ports = [Port("g", 0.0, 9.0, "g"), Port("v", 0.0, 9.0, "v", size=2)]
    prepared = [np.array([1.0], np.float32), np.array([2.0, 3.0])]
    made = runs.changed(thing(coefficients=ports), prepared, {"v": np.array([[7], [8]])})
    assert [m.tolist() for m in made] == [[1.0], [7.0, 8.0]]
    made = runs.changed(thing(coefficients=ports), prepared, {"g": 0.1})
    assert (made[0].dtype, made[0].tolist()) == (np.float32, [float(np.float32(0.1))])


def test_cells_hold_ports_one_after_the_other():
    cells = runs._Cells([Port("a", 0, 9, "a"), Port("v", 0, 9, "v", size=3), Port("b", 0, 9, "b")])
    cells.put({"v": np.array([1.0, 2.0, 3.0]), "b": 4.0, "other": 9.0})
    assert cells.values.tolist() == [0, 1, 2, 3, 4]
    cells.put({"a": 5.0})
    assert cells.values.tolist() == [5, 1, 2, 3, 4]
    found = cells.split(np.arange(10.0).reshape(2, 5))
    assert {n: a.tolist() for n, a in found.items()} == {
        **{"a": [0.0, 5.0], "v": [[1.0, 2.0, 3.0], [6.0, 7.0, 8.0]], "b": [4.0, 9.0]},
    }


def test_an_executor_is_stepped_with_states_put_in_between():
    class Simulator:
        def __init__(self):
            self.state = {"s": np.array([1.0]), "v": np.array([0.0, 0.0])}

        def step(self, x):
            self.state = {k: v + x for k, v in self.state.items()}
            return {"y": 10 * x}

    ports = thing(outputs=[thing(name="y")], state=[thing(name="s"), thing(name="v")])
    ports.simulator = Simulator
    given = {2: {"s": np.array([100.0]), "v": np.array([5.0, 6.0])}}
    y, s = runs.run_executor(ports, Stream("s", {"x": np.array([1.0, 2.0, 3.0])}, given))
    assert y["y"].tolist() == [10, 20, 30]
    assert s["s"].tolist() == [2, 4, 103]
    assert s["v"].tolist() == [[1, 1], [3, 3], [8, 9]]


def test_how_far_two_runs_come_apart():
    flags = Port("status", 0, 3, "s", flags=(Flag("A", "a"),))
    block = thing(state=[Port("m", 0, 9, "m")], outputs=[Port("y", 0, 9, "y"), flags])
    one = {"m": [1.0, 2.0, 3.0], "status": [1, 2, 3]}
    other = {"m": [1.5, 2.0, 1.0], "status": [1, 3, 2], "y": [0]}
    assert drift(block, one, other) == {"m": 2.0, "status": pytest.approx(2 / 3)}


# -- coverage --------------------------------------------------------------------------------------


def covered() -> Coverage:
    decisions = [
        Decision(3, "fmin", "a", {"first is less": 0, "second is less": 2}),
        Decision(4, "lt", "b", {"true": 0, "false": 0}, {"true": "by range"}),
        Decision(5, "and", "c", {"both true": 0, "only first false": 5, "only second false": 0},
                 {"only second false": "by logic"}, {"both true": "a fault"}),
        Decision(6, "not", "d", {"true": 1, "false": 9}),
    ]  # fmt: skip
    return Coverage("block", "f32", ("s", "t"), 30, decisions)


def test_sides_that_can_be_taken_and_those_that_were():
    made = covered()
    assert made.sides == 2 + 1 + 1 + 2
    assert made.uncovered == ["a: fmin never 'first is less'", "b: lt never 'false'"]
    assert made.ratio == pytest.approx(4 / 6)
    assert made.excluded == ["b: lt, true: by range", "c: and, only second false: by logic"]
    assert made.detectors == ["c: and, both true: a fault"]
    assert made.to_dict() == {
        **{"block": "block", "format": "f32", "streams": ["s", "t"], "steps": 30, "decisions": 4},
        **{"sides": 6, "covered": 4, "ratio": made.ratio, "uncovered": made.uncovered},
        **{"excluded": made.excluded, "detectors": made.detectors},
    }
    assert Coverage("block", "f32", (), 0, []).ratio == 1.0


def test_what_only_a_fault_takes_is_set_aside_with_its_condition():
    nodes = [
        *(Node("input", source=(0, k)) for k in range(2)),
        *(Node("const", value=v) for v in (4.0, 2.0)),
        *(Node("lt", (0, 1)), Node("le", (1, 0)), Node("and", (4, 5))),
        *(Node("if_else_zero", (6, 2)), Node("if_else_zero", (4, 3)), Node("select", (5, 2, 3))),
    ]
    kernel = Kernel("k", tuple(nodes), ((7, 8),))

    def decisions(taken=0):
        sides = {6: ("both true", "only first false"), 7: ("true", "false"), 8: ("true", "false"),
                 9: ("true", "false")}  # fmt: skip
        return {
            i: Decision(i, nodes[i].op, "w", dict.fromkeys(of, taken)) for i, of in sides.items()
        }

    made = decisions()
    coverage._set_aside(kernel, [*made.values()], 4.0, "why")
    assert {i: d.detectors for i, d in made.items()} == {
        **{6: {"both true": "why"}, 7: {"true": "why"}, 8: {}, 9: {"true": "why"}},
    }
    made = decisions(taken=1)
    coverage._set_aside(kernel, [*made.values()], 4.0, "why")
    assert not any(d.detectors for d in made.values())
    made = decisions()
    made[7].seen["true"] = 3
    coverage._set_aside(kernel, [*made.values()], 4.0, "why")
    assert (made[6].detectors, made[7].detectors) == ({}, {})


def test_a_decision_is_named_by_the_nearest_value_that_needs_it():
    users = {0: [1, 2], 1: [3], 2: [4], 3: [5], 4: [5]}
    names = {4: ("near_Nm", "(3.1)"), 5: ("far_Nm", "")}

    def where(node, final=None):
        return coverage._where(final or {}, users, names, node)

    assert where(4) == "near_Nm ((3.1))"
    assert where(5) == "far_Nm"
    assert where(2) == "v2 in near_Nm ((3.1))"
    assert where(0) == "v0 in near_Nm ((3.1))"
    assert where(1) == "v1 in far_Nm"
    assert where(1, {3: "tau_Nm"}) == "v1 in the result tau_Nm"
    assert where(0, {1: "tau_Nm"}) == "v0 in the result tau_Nm"
    assert coverage._where({}, {}, {}, 7) == "v7"
    kernel = Kernel("k", (Node("input"), Node("sq", (0,)), Node("add", (1, 0))), ((2,),))
    assert coverage._users(kernel) == {0: [1, 2], 1: [2]}


# -- forced ticks ----------------------------------------------------------------------------------

FAST = thing(name="fast", every=1, phase=0, release_ticks=1)
SLOW = thing(name="slow", every=3, phase=0, release_ticks=3)


class Rig:
    """A slower task of three instructions, 10, 20 and 30; its run ends with the last.

    It is entered in every third tick.  Never reached: 40.  Its third run gives a wrong bit.
    """

    made: list[Rig]
    ticks = 24

    def __init__(self, held, device, image, inputs) -> None:
        self.fast, self.slow = FAST, SLOW
        self.rows = {"fast": range(self.ticks), "slow": range(70)}
        self.entry = {"fast": 1, "slow": 10}
        self.log, self.differences, self.now = [], [], 100
        self.board = thing(release=lambda tick: self.log.append(("release", tick)))
        self.stops: list[int] = []
        held.run = self.run
        Rig.made.append(self)

    def start(self):
        return self.now

    def run(self):
        return self.stops.pop(0) if self.stops else 0

    def give(self, task, run):
        self.log.append(("give", task.name, run))
        if task.name == "fast" and run % 3 == 0:
            self.stops = [10]

    def host(self, task, run, tick):
        self.log.append(("host", task.name, run, tick))

    def compare(self, task):
        self.log.append(("compare", task.name))

    def to(self, target):
        self.log.append(("to", target))
        self.at = target
        return 0 if target is None or target == 40 else target

    def ended(self):
        return self.at == 30

    def same_state(self, tick):
        self.log.append(("state", tick))

    def tick(self):
        self.log.append("tick")


def forced(monkeypatch, instructions, **more):
    Rig.made = []
    held = type("Held", (), {
        "__init__": lambda self, image: None, "__enter__": lambda self: self,
        "__exit__": lambda self, *_: None,
    })  # fmt: skip
    monkeypatch.setattr(preempt, "_Rig", Rig)
    monkeypatch.setattr(preempt, "HeldProcessor", held)
    found = preempt_everywhere("device", "image", {}, instructions, **more)
    return found, Rig.made[0].log


def test_a_tick_comes_before_each_instruction_that_is_reached(monkeypatch):
    found, log = forced(monkeypatch, [30, 40, 20, 10], tries=2)
    # The last first; 40 is tried twice.
    assert [e[1] for e in log if e[0] == "to"] == [10, 20, 40, 30, 40]
    assert found.preemptions == (
        *(Preemption(10, 101, False), Preemption(20, 104, False), Preemption(30, 110, False)),
    )
    assert (found.instructions, found.not_reached, found.ticks) == (4, (40,), 13)
    # A run that is open goes on after the tick, and is compared then, with the host's of its time.
    first = log.index(("to", 10))
    assert log[:2] == [("give", "fast", 0), ("host", "fast", 0, 100)]
    assert log[first + 1 : first + 8] == [
        *("tick", ("release", 101), ("give", "fast", 1), ("host", "fast", 1, 101)),
        *(("compare", "fast"), ("host", "slow", 0, 100), ("compare", "slow")),
    ]
    assert ("state", 101) not in log
    assert ("state", 102) in log
    # One that has ended is compared at once.
    last = log.index(("to", 30))
    assert log[last + 1 : last + 4] == [
        *(("host", "slow", 3, 109), ("compare", "slow"), ("state", 110)),
    ]


def test_a_run_that_had_to_end_before_the_tick_is_late(monkeypatch):
    monkeypatch.setattr(SLOW, "release_ticks", 1)
    found, _ = forced(monkeypatch, [30, 20])
    assert [(p.where, p.late) for p in found.preemptions] == [(20, True), (30, False)]
    monkeypatch.setattr(SLOW, "release_ticks", 2)
    assert not any(p.late for p in forced(monkeypatch, [20])[0].preemptions)


def test_one_in_so_many_runs_is_disturbed_until_the_inputs_end(monkeypatch):
    seen = []
    found, log = forced(monkeypatch, [20] * 9, each=2, progress=lambda *a: seen.append(a))
    assert [e[1] for e in log if e[0] == "to"] == [None, 20] * 4
    assert (found.ticks, len(found.preemptions), found.not_reached) == (24, 4, ())
    assert (seen, forced(monkeypatch, [])[0].ticks) == ([], 0)
    # How far it is, every hundred ticks; no longer than the shorter of the inputs.
    monkeypatch.setattr(Rig, "ticks", 999)
    found, _ = forced(monkeypatch, [20] * 99, each=2, progress=lambda *a: seen.append(a))
    assert (found.ticks, seen) == (210, [(17, 99), (33, 99)])
