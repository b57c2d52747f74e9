"""What a run in the emulator says, from a board that is made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_gen.verify import emulator
from esea_gen.verify.emulator import Difference, RunningBoard, first_difference


def f32(*values):
    return np.array(values, np.float32)


def test_the_first_step_that_differs_in_any_bit():
    host = {"a": f32(1, 2, 3), "v": np.array([[1, 2], [3, 4], [5, 6]], np.uint32)}
    board = {n: a.copy() for n, a in host.items()}
    assert first_difference(board, host) is None
    board["v"][2, 1] = 7
    assert first_difference(board, host) == Difference(2, "v", "0x00000007", "0x00000006")
    board["v"][1] = (9, 10)
    assert first_difference(board, host) == Difference(1, "v", "0x00000009", "0x00000003")
    board["a"][1] = -2
    # In one step the first output by order.
    assert first_difference(board, host) == Difference(1, "a", "0xc0000000", "0x40000000")
    board["v"][0, 1] = 0
    assert first_difference(board, host) == Difference(0, "v", "0x00000000", "0x00000002")


def test_bits_are_compared_and_not_numbers():
    nan = np.array([0x7FC00001], np.uint32).view(np.float32)
    assert first_difference({"a": nan}, {"a": nan.copy()}) is None
    assert first_difference({"a": nan}, {"a": f32(np.nan)}).board == "0x7fc00001"
    assert first_difference({"a": f32(-0.0)}, {"a": f32(0.0)}).board == "0x80000000"
    every_other = np.arange(6, dtype=np.uint32)[::2]
    assert first_difference({"a": every_other}, {"a": np.array([0, 2, 4], np.uint32)}) is None


@pytest.mark.parametrize(
    ("board", "host"),
    [
        ({}, {}),
        ({"a": f32(1)}, {"b": f32(1)}),
        ({"a": f32(1)}, {"a": f32(1), "b": f32(1)}),
        ({"a": f32(1)}, {"a": f32(1, 2)}),
        ({"a": f32(1)}, {"a": np.array([1], np.uint32)}),
        ({"a": np.array([1.0])}, {"a": np.array([1.0])}),
    ],
)
def test_outputs_that_cannot_be_compared_are_refused(board, host):
    with pytest.raises(ValueError, match="against"):
        first_difference(board, host)


def named(name, size=1, flags=()):
    return SimpleNamespace(name=name, port=SimpleNamespace(size=size, flags=flags))


class System:
    """Two tasks with inputs and one without."""

    tasks = (
        SimpleNamespace(name="sense", every=1, phase=0),
        SimpleNamespace(name="law", every=3, phase=2),
        SimpleNamespace(name="own", every=2, phase=1),
    )
    latches = ()
    takes: ClassVar = {"sense": ("x", "y"), "law": ("w",), "own": ()}
    gives: ClassVar = {
        "sense": (named("a"), named("s", flags=("F",))),
        "law": (named("u", 2),),
        "own": (),
    }

    def task(self, name):
        return next(t for t in self.tasks if t.name == name)

    def task_inputs(self, task):
        return [named(n) for n in self.takes[task.name]]

    def task_outputs(self, task):
        return self.gives[task.name]


DEVICE = SimpleNamespace(system=System(), name="x", origin="x.toml")


def test_inputs_are_checked_and_rounded_to_float32():
    found = emulator._float32(DEVICE, "sense", {"x": [0.1, 2], "y": np.zeros((2, 3))})
    assert found["x"].tolist() == [float(np.float32(0.1)), 2.0]
    assert {a.dtype for a in found.values()} == {np.dtype(np.float32)}
    assert emulator._float32(DEVICE, "own", {"": [1, 2, 3]})[""].tolist() == [0, 0, 0]
    for task, inputs, said in (
        ("none", {}, "no task 'none'"),
        ("own", {}, "takes no input"),
        ("own", {"": []}, "takes no input"),
        ("own", {"": [1], "x": [1]}, "takes no input"),
        ("sense", {"x": [1]}, r"takes \['x', 'y'\], got \['x'\]"),
        ("sense", {"x": [1], "y": [1], "z": [1]}, "takes"),
        ("sense", {"x": [1], "y": [1, 2]}, "different lengths"),
        ("sense", {"x": [], "y": []}, "empty"),
    ):
        with pytest.raises(UserError, match=said):
            emulator._float32(DEVICE, task, inputs)


def running() -> RunningBoard:
    """A board whose answers tell what it was asked, in order."""
    made = RunningBoard.__new__(RunningBoard)
    made.device, made.asked = DEVICE, []

    def exchange(requests, window):
        made.window_of = window
        for k, (message, wanted) in enumerate(requests):
            name, sequence, *row = message
            made.asked.append((name, sequence, row, wanted))
            yield SimpleNamespace(
                a=row[0] + 0.5 if row else 0, s=k, u=[sequence, -sequence], step_ticks=100 + k
            )

    made.exchange = exchange
    made.window = list
    made.message = lambda *parts: parts
    return made


def test_tasks_are_interleaved_by_their_ticks():
    board, seen = running(), []
    inputs = {
        "law": {"w": f32(7, 8)},
        "sense": {"y": f32(10, 11, 12, 13, 14), "x": f32(0, 1, 2, 3, 4)},
        "own": {"": f32(0, 0)},
    }
    outputs, ticks = board.run_tasks(inputs, lambda done, all_: seen.append((done, all_)))
    sense, law, own = ("ESEA_SENSE_IN", "ESEA_LAW_IN", "ESEA_OWN_IN")
    assert [a[:3] for a in board.asked] == [
        (sense, 0, [0, 10]), (sense, 1, [1, 11]), (own, 1, []), (sense, 2, [2, 12]),
        (law, 2, [7]), (sense, 3, [3, 13]), (own, 3, []), (sense, 4, [4, 14]), (law, 5, [8]),
    ]  # fmt: skip
    assert board.asked[4][3] == "ESEA_LAW_OUT"
    assert board.window_of == [sense, law, own]
    assert outputs["sense"]["a"].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]
    assert outputs["sense"]["s"].tolist() == [0, 1, 3, 5, 7]
    assert outputs["sense"]["s"].dtype == np.uint32
    assert outputs["sense"]["a"].dtype == outputs["law"]["u"].dtype == np.float32
    assert outputs["law"]["u"].tolist() == [[2, -2], [5, -5]]
    assert {t: n.tolist() for t, n in ticks.items()} == {
        "law": [104, 108], "sense": [100, 101, 103, 105, 107], "own": [102, 106],
    }  # fmt: skip
    assert seen == [(9, 9)]
    alone, times = running().run_task("law", {"w": f32(1)})
    assert (alone["u"].tolist(), times.tolist()) == ([[2, -2]], [100])


def test_a_sequence_goes_round_after_32_bits():
    late = SimpleNamespace(name="law", every=3, phase=2**32 - 4)
    found = list(running()._messages(late, {"w": f32(7, 8, 9)}))
    assert found == [("ESEA_LAW_IN", k, w) for k, w in ((2**32 - 4, 7), (2**32 - 1, 8), (2, 9))]


def test_it_says_how_far_it_is_every_hundred():
    seen = []
    running().run_tasks({"own": {"": np.zeros(250)}}, lambda *at: seen.append(at))
    assert seen == [(100, 250), (200, 250), (250, 250)]


INFO = {
    **{"board": "as it says", "content_hash": "f00d", "empty_ticks": 7, "stack_peak_bytes": 333},
    **{"sequence_gaps": 1, "bad_frames": 2, "unknown_messages": 3, "lost_bytes": 4},
}


def judged(monkeypatch, board="netduinoplus2", host=None, **inputs):
    """A run whose board gives ones and host what is typed."""
    done = []

    class Board:
        def __init__(self, device, image, timeout_s, options):
            done.append((timeout_s, options))

        def __enter__(self):
            return self

        def __exit__(self, *_):
            done.append("closed")

        def reset(self):
            done.append("reset")

        def run_tasks(self, arrays, progress):
            done.append("ran")
            given = {t: {"a": f32(*[1] * len(next(iter(c.values()))))} for t, c in arrays.items()}
            times = {t: np.arange(10, 10 + 3 * len(c["a"]), 3, np.uint32) for t, c in given.items()}
            return given, times

        def info(self):
            return SimpleNamespace(**INFO)

    monkeypatch.setattr(emulator, "RunningBoard", Board)
    monkeypatch.setattr(emulator, "_host_outputs", lambda d, real, a: {
        t: {"a": f32(*(host or [1] * len(next(iter(c.values())))))} for t, c in a.items()
    })  # fmt: skip
    monkeypatch.setattr(emulator, "format_hash", lambda device, real: f"{real} hash")
    monkeypatch.setattr(emulator, "emulator_version", lambda: "QEMU 1")
    image = SimpleNamespace(
        **{"board": board, "real": "f32", "flash_bytes": 11, "ram_bytes": 22, "stack_bytes": 44},
        **{"step_stack_bytes": {"sense": 55, "law": 66}, "compiler": "gcc 1"},
    )
    return emulator.run_tasks_in_emulator(DEVICE, image, inputs), done


def test_figures_of_each_task_without_what_measuring_takes(monkeypatch):
    given = {"sense": {"x": np.zeros(4), "y": np.zeros(4)}, "law": {"w": np.zeros(3)}}
    found, done = judged(monkeypatch, **given)
    assert done == [(10.0, ()), "reset", "ran", "closed"]
    told = found["sense"].to_dict()
    assert told.pop("duration_s") >= 0
    # The timer's 10, 13, 16, 19 less 7.
    scale = emulator.find_board("netduinoplus2").tick_instructions
    assert told == {
        **{"device": "x", "task": "sense", "steps": 4, "identical": True, "first_difference": None},
        **{"expected_hash": "f32 hash", "hash_matches": False, "flash_bytes": 11, "ram_bytes": 22},
        "instructions": {"min": 3 * scale, "median": int(7.5 * scale), "max": 12 * scale},
        **{"stack_bytes": 44, "step_stack_bytes": 55, "emulator": "QEMU 1", "compiler": "gcc 1"},
        **{k: v for k, v in INFO.items() if k != "empty_ticks"},
    }
    assert found["law"].step_stack_bytes == 66
    assert found["law"].steps == 3
    assert found["law"].step_instructions.tolist() == [scale * t for t in (3, 6, 9)]
    monkeypatch.setitem(INFO, "content_hash", "f32 hash")
    assert judged(monkeypatch, law=given["law"])[0]["law"].hash_matches
    with pytest.raises(UserError, match="No task is given"):
        judged(monkeypatch)


def test_on_the_host_nothing_is_counted(monkeypatch):
    found = judged(monkeypatch, "host", host=[1, 1, 2], law={"w": np.zeros(3)})[0]["law"]
    assert (found.instructions, found.stack_peak_bytes) == ({}, 0)
    assert found.emulator == "none: the host itself"
    assert not found.identical
    assert found.to_dict()["first_difference"] == {
        **{"step": 2, "output": "a", "board": "0x3f800000", "host": "0x40000000"},
    }


def test_without_a_task_the_first_is_run(monkeypatch):
    monkeypatch.setattr(emulator, "run_tasks_in_emulator", lambda *a: {"sense": a, "law": "law"})
    found = emulator.run_in_emulator(DEVICE, "image", "given", timeout_s=5.0, options=("-x",))
    assert found == (DEVICE, "image", {"sense": "given"}, None, 5.0, ("-x",))
    assert emulator.run_in_emulator(DEVICE, "image", "given", "law") == "law"


def test_the_hosts_outputs_are_as_the_link_carries_them(monkeypatch):
    flags = np.array([1, 2], np.uint32)

    def library(device, real):
        assert real == "q31"
        run = {"a": np.array([0.1, 0.2]), "s": flags}
        return SimpleNamespace(
            task=lambda name: SimpleNamespace(run=lambda columns, trace: (run, trace)),
            board=lambda: "board",
        )

    monkeypatch.setattr(emulator, "compile_device", library)
    monkeypatch.setattr(
        emulator, "run_schedule", lambda board, inputs: {t: {"b": np.ones(1)} for t in inputs}
    )
    (found,) = emulator._host_outputs(DEVICE, "q31", {"sense": {}}).values()
    assert found["a"].tolist() == f32(0.1, 0.2).tolist()
    assert (found["a"].dtype, found["s"].dtype) == (np.float32, np.uint32)
    both = emulator._host_outputs(DEVICE, "q31", {"sense": {}, "law": {}})
    assert [list(c) for c in both.values()] == [["b"], ["b"]]
    latched = System()
    latched.latches = ("l",)
    one = emulator._host_outputs(SimpleNamespace(system=latched), "q31", {"sense": {}})
    assert list(one["sense"]) == ["b"]


def test_commands_of_the_emulator_and_of_programs(monkeypatch):
    monkeypatch.setattr(emulator.shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(emulator, "find_compiler", lambda name, package: name)
    board = emulator.find_board("mps2-an500")
    plain = ["/bin/qemu-system-arm", "-M", "mps2-an500", "-display", "none", "-monitor", "none"]
    assert emulator.qemu_command(board) == [*plain, "-nodefaults"]
    printing = [*plain, "-nodefaults", "-semihosting-config", "enable=on,target=native"]
    assert emulator.qemu_command(board, semihosting=True) == printing
    image = SimpleNamespace(elf="a.elf")
    for name, command in (("host", ["a.elf"]), ("myrio", [None, "a.elf"])):
        board = emulator.find_board(name)
        found = emulator.program_command(image, board)
        assert found == [board.runner if c is None else c for c in command]
    with pytest.raises(UserError, match="is a library"):
        emulator.start_board(SimpleNamespace(board="sim"), 1.0)
    monkeypatch.setattr(emulator.shutil, "which", lambda name: None)
    with pytest.raises(UserError, match="not installed"):
        emulator.find_qemu()


def test_an_emulator_that_ends_or_says_nothing_is_told():
    class Server:
        calls = 0

        def accept(self):
            self.calls += 1
            if self.calls < 3:
                raise TimeoutError
            return "line", "address"

    process = SimpleNamespace(runs=lambda: True, said=lambda: "burnt")
    assert emulator._accept(Server(), process, 60.0) == "line"
    for runs, timeout_s in ((False, 60.0), (True, 0.0)):
        process.runs = lambda runs=runs: runs
        with pytest.raises(LinkError, match="did not open") as error:
            emulator._accept(Server(), process, timeout_s)
        assert error.value.said == "burnt"
