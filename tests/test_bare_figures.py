"""Programs on emulated cores and the q31 report: their figures, from made-up programs and runs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.emit.error_bounds import Bound
from esea_gen.language.ports import Flag, Port
from esea_gen.language.stream import Stream
from esea_gen.verify import bare, fixed_report
from esea_gen.verify.assumed import UNTRIED
from esea_gen.verify.bare import BARE_BOARDS, Emulation
from esea_gen.verify.fixed_report import BlockResult, FixedReport, SignalResult

NM = """\
00000000 0000000c T counted_step
0000000c 00000010 T entry
00000100 00001000 T harness
00000200 00000040 t esea_x_sense_step
00000240 00000008 r table
1fffffff 00000001 t last
20000000 00000100 B state
20000100 00000002 D more
00000300 00000400 T stream
00000700 00000800 R run_stream
00000800 00000020 T hex
00000820 00000020 T line
00000840 00000020 T call
00000860 00000020 T vectors
00000900 T no_size
         U missing
"""
SAID = (
    "0000000a ffffffff \n00000001 00000002\ngarbage 0000\n0000000G 00000001 \n"
    "deadbeef \nentries 4 instructions 1003 min 200 max 307\n"
)


@pytest.fixture
def programs(monkeypatch, tmp_path):
    """The tools of ``emulate``, made up; their commands."""
    asked: list[list[str]] = []
    told = {"nm": NM, "qemu": SAID}

    def said(command):
        asked.append([str(c) for c in command])
        if command[0] == "qemu":
            return told["qemu"]
        if "nm" in command[0]:
            return told["nm"]
        folder = Path(command[-1]).parent
        assert {p.name: p.read_text() for p in folder.iterdir()} == FILES
        return ""

    monkeypatch.setattr(bare, "_said", said)
    monkeypatch.setattr(bare, "find_compiler", lambda name, *_: name)
    monkeypatch.setattr(bare, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(bare, "_plugin", lambda: Path("/count.so"))
    monkeypatch.setattr(bare, "qemu_command", lambda board, semihosting: ["qemu", board.machine])
    return SimpleNamespace(asked=asked, told=told)


FILES = {"b.c": "int b;", "a.c": "int a;", "a.h": "", "bare.ld": "x"}


def test_rows_instructions_and_flash_of_a_program(programs):
    done = bare.emulate(FILES, BARE_BOARDS["m3"])
    # Of lines, those of words of eight digits, each with a blank behind it.
    assert done.rows == [["0000000a", "ffffffff"], ["deadbeef"]]
    assert done.instructions == {"min": 200.0, "mean": 250.75, "max": 307.0}
    # What is in flash, without the harness' own: 0x1000 of it is the harness' main part.
    assert done.flash_bytes == 0x1000 + 0x40 + 0x08 + 1
    compiled, _, run = programs.asked
    sources = [Path(c).name for c in compiled if c.endswith(".c")]
    assert sources == ["a.c", "b.c"]
    assert any(c.startswith("-T") and c.endswith("/bare.ld") for c in compiled)
    at = run.index("-plugin")
    assert run[at + 1] == "/count.so,entry=0x0,low=0x0,high=0x100"
    assert (run[:2], run[-2], Path(run[-1]).name) == (["qemu", "mps2-an385"], "-kernel", "bare.elf")


def test_a_program_that_nobody_counted_is_told(programs):
    programs.told["qemu"] = "x" * 30 + "y" * 2000
    with pytest.raises(RuntimeError, match=r"the plugin did not count:\ny+$"):
        bare.emulate(FILES, BARE_BOARDS["m3"])


def test_what_a_program_says_and_where_it_fails():
    assert bare._said(["sh", "-c", "echo one; echo two >&2"]) == "one\ntwo\n"
    with pytest.raises(RuntimeError, match="sh failed:\nwrong"):
        bare._said(["sh", "-c", "echo wrong >&2; exit 2"])


RENDERED: dict[str, dict] = {}


def renderer() -> SimpleNamespace:
    def render(name: str, **context) -> str:
        RENDERED[name] = context
        return f"from {name}"

    files = {"main.c": "m", "x.c": "c", "x.h": "h", "cmake/y.c": "y"}
    return SimpleNamespace(
        files=lambda: dict(files), render=render, fmt=SimpleNamespace(name="q31")
    )


WORDS = [{"name": n, "word": False} for n in ("tau_Nm", "theta_rad", "status")]
RAN = [["0000000b", "ffffffff", "00000000"], ["00000001", "80000000", "00000007"]]
END = ["00000190", "0000006c", "00000000"]
BITS = np.array([[11, 2**32 - 1, 0], [1, 2**31, 7]], dtype=np.uint32)


def judged(monkeypatch, rows, expected=BITS, board="m4f"):
    given = {}

    def emulate(files, board):
        given.update(files=files, board=board)
        return Emulation(rows, {"min": 1.0, "mean": 2.5, "max": 4.0}, 5120)

    monkeypatch.setattr(bare, "emulate", emulate)
    found = bare._judged(renderer(), board, "sense", WORDS, expected, harness="h.j2", own=3)
    return found, given


def test_every_bit_of_every_step_is_judged(monkeypatch):
    found, given = judged(monkeypatch, [*RAN, END])
    assert (found.identical, found.first_difference, found.steps) == (True, "", 2)
    assert (found.board, found.core, found.real, found.task) == (
        "m4f",
        "Cortex-M4F",
        "q31",
        "sense",
    )
    assert (found.flash_bytes, found.ram_bytes, found.stack_bytes) == (5120, 0x6C, 0x190)
    assert found.instructions == {"min": 1.0, "mean": 2.5, "max": 4.0}
    assert given["board"].name == "mps2-an386"
    assert given["files"] == {
        **{"x.c": "c", "x.h": "h", "bare.c": "from h.j2"},
        "bare.ld": "from verify/bare_task.ld.j2",
    }
    assert RENDERED["h.j2"] == {
        **{"words": WORDS, "stack_top": 0x20000000 + 2**22, "has_fpu": True},
        **{"board": "mps2-an386", "flash_bytes": 2**22, "ram_bytes": 2**22, "own": 3},
    }
    _, given = judged(monkeypatch, [*RAN, END], board="m0")
    assert RENDERED["h.j2"]["stack_top"] == 0x20000000 + 16384
    assert RENDERED["h.j2"]["has_fpu"] is False


def test_the_first_wrong_word_is_named(monkeypatch):
    for row, column, told in (
        (0, 1, "theta_rad at step 0: ffffffff instead of fffffffe"),
        (1, 2, "status at step 1: 00000007 instead of 00000006"),
        (1, 0, "tau_Nm at step 1: 00000001 instead of 00000000"),
    ):
        other = BITS.copy()
        other[row, column] -= 1
        other[1, 2] -= (row, column) == (1, 0)
        found, _ = judged(monkeypatch, [*RAN, END], other)
        assert (found.identical, found.first_difference) == (False, told)
    for rows in ([*RAN], [*RAN, RAN[0], END]):
        with pytest.raises(RuntimeError, match=f"did not finish: {len(rows)} rows"):
            judged(monkeypatch, rows)


def test_outputs_are_held_between_the_runs_of_a_task():
    def output(name, size=1, flags=()):
        return SimpleNamespace(name=name, port=SimpleNamespace(size=size, flags=flags))

    outputs = {"sense": [output("a"), output("s", flags=("F",))], "law": [output("u", 2)]}
    tasks = [SimpleNamespace(name="sense", every=1, phase=0),
             SimpleNamespace(name="law", every=3, phase=2)]  # fmt: skip
    done = []

    class Board:
        def release(self, tick):
            done.append(tick)

        def step(self, name, **given):
            done.append(name)
            x = given["x"]
            return {"a": x + 0.5, "s": x} if name == "sense" else {"u": np.array([x, 10 * x])}

    naming = SimpleNamespace(
        external=lambda x: f"{x.name}_q", stored=lambda x, value: np.array(value, np.float32)
    )
    device = SimpleNamespace(
        system=SimpleNamespace(tasks=tasks, task_outputs=lambda t: outputs[t.name])
    )
    inputs = {"sense": {"x": np.arange(1.0, 7)}, "law": {"x": np.array([7.0, 8.0])}}
    library = SimpleNamespace(board=Board)
    words, bits = bare._scheduled(device, library, inputs, 6, SimpleNamespace(naming=naming))
    assert [(w["name"], w["word"]) for w in words] == [
        *(("sense_out.a_q", False), ("sense_out.s_q", True)),
        *(("law_out.u_q[0]", False), ("law_out.u_q[1]", False)),
    ]
    assert done == [
        0,
        "sense",
        1,
        "sense",
        2,
        "sense",
        "law",
        3,
        "sense",
        4,
        "sense",
        5,
        "sense",
        "law",
    ]
    assert bits.view(np.float32).tolist() == [
        *([1.5, 1, 0, 0], [2.5, 2, 0, 0], [3.5, 3, 7, 70], [4.5, 4, 7, 70]),
        *([5.5, 5, 7, 70], [6.5, 6, 8, 80]),
    ]


class Held:
    """A library whose task doubles what it is given; of a vector it gives three."""

    def __init__(self, names) -> None:
        self.names = names

    def pack(self, inputs):
        steps = len(next(iter(inputs.values())))
        made = np.zeros(steps, [("x", "<f4"), ("v", "<f4", (2,))])
        made["x"], made["v"][:, 1] = inputs["x"], 7
        return made

    def run(self, inputs, trace, raw):
        assert (trace, raw) == (False, True)
        x = np.asarray(inputs["x"], np.float32)
        return {"y": 2 * x, "v": np.stack([x, 3 * x, 5 * x], axis=1), "s": x.astype(np.uint32)}, {}


def runs(monkeypatch, tasks):
    """What the board would be given to run, for tasks that are made up."""
    port = SimpleNamespace
    outputs = [("y", 1, ()), ("v", 3, ()), ("s", 1, ("F",))]
    system = SimpleNamespace(
        tasks=tasks,
        task=lambda name: next(t for t in tasks if t.name == name),
        task_outputs=lambda t: [port(name=n, port=port(size=k, flags=f)) for n, k, f in outputs],
    )
    given = {}

    def judged(renderer, board, what, words, expected, **own):
        given.update(renderer=renderer, board=board, what=what, words=words, expected=expected)
        given.update(own)

    monkeypatch.setattr(bare, "_judged", judged)
    monkeypatch.setattr(bare, "format_hash", lambda device, real: f"{real} hash")
    naming = SimpleNamespace(external=lambda x: f"{x.name}_q")
    monkeypatch.setattr(
        bare, "Renderer", lambda *a: SimpleNamespace(given=a, naming=naming, fmt=a[1])
    )
    device = SimpleNamespace(system=system, title="title")
    library = SimpleNamespace(task=Held)
    monkeypatch.setattr(bare, "compile_device", lambda d, real: library)
    return device, system, given


def task(name, every=1):
    return SimpleNamespace(name=name, every=every, phase=0)


def test_a_tasks_words_and_rows_are_those_of_the_host(monkeypatch):
    device, system, given = runs(monkeypatch, [task("sense"), task("law")])
    fmt = bare.FORMATS["f32"]
    for name, what in ((None, "sense"), ("law", "law")):
        bare.run_bare(device, "f32", "m3", {"x": np.array([1.0, 2.5])}, name)
        assert given["renderer"].given == (system, fmt, "f32 hash", "-", "title")
        assert (given["board"], given["what"], given["task"].name) == ("m3", what, what)
    names = ["y_q", "v_q[0]", "v_q[1]", "v_q[2]", "s_q"]
    assert given["words"] == [{"name": n, "word": n == "s_q"} for n in names]
    floats = given["expected"][:, :4].view(np.float32)
    assert floats.tolist() == [[2.0, 1.0, 3.0, 5.0], [5.0, 2.5, 7.5, 12.5]]
    assert given["expected"][:, 4].tolist() == [1, 2]
    assert given["rows"] == [["1.0f", "0.0f", "7.0f"], ["2.5f", "0.0f", "7.0f"]]
    assert (given["steps"], given["harness"]) == (2, "verify/bare_task.c.j2")


def test_all_tasks_run_as_long_as_the_shortest_of_their_inputs(monkeypatch):
    tasks = [task("sense"), task("law", 3), task("none", 4)]
    device, system, given = runs(monkeypatch, tasks)
    monkeypatch.setattr(bare, "_scheduled", lambda d, lib, inputs, ticks, r: ("words", ticks))
    inputs = {"sense": {"x": np.arange(11.0)}, "law": {"x": np.array([1.0, 2, 3])}, "none": {}}
    bare.run_bare_system(device, "f32", "m0", inputs)
    assert (given["expected"], given["ticks"], given["what"]) == (9, 9, "all tasks")
    assert given["renderer"].given[0] is system
    assert given["rows"]["none"] == 3 * [["0"]]
    assert len(given["rows"]["sense"]) == 11
    assert given["rows"]["law"][2] == ["3.0f", "0.0f", "7.0f"]
    inputs["sense"] = {"x": np.arange(8.0)}
    bare.run_bare_system(device, "f32", "m0", inputs)
    assert (given["ticks"], len(given["rows"]["none"])) == (8, 2)


# -- the report ------------------------------------------------------------------------------------


def measured(theta_rad: float = 0.25, period_s: float = 0.01, **more) -> SimpleNamespace:
    domain = SimpleNamespace(theta_max_rad=SimpleNamespace(value=theta_rad))
    file = SimpleNamespace(domain=domain, joint=None)
    return SimpleNamespace(period_s=period_s, file=file, name="x", **more)


def test_the_published_motions_in_a_devices_own_domain():
    most, h = 0.25, 0.01
    found = dict(fixed_report.published_motions(measured(most, h)))
    deg = 180 / math.pi * most  # 14.32; 5 of 11.5 are 6.23, 10 of 11.5 are 12.46
    assert list(found) == [
        "sweep 14.3 deg, 0 to 1 Hz", "sweep 6.2 deg, 0 to 1.5 Hz",
        "12.5 deg at 0.01 Hz", "14.3 deg at 0.01 Hz",
        "ramp to 6.2 deg, held for 60 s", "ramp to 12.5 deg, held for 60 s",
    ]  # fmt: skip
    sweep, small, slow, full, low, high = found.values()
    # 0.5 Hz a minute: to 1 Hz in 120 s, to 1.5 Hz in 180 s.
    assert (len(sweep), len(small), len(slow), len(full)) == (12000, 18000, 20000, 20000)
    for wave, top, end_s in ((sweep, most, 60.0), (small, 5 / 11.5 * most, 100.0)):
        assert np.abs(wave).max() == pytest.approx(top, rel=1e-4)
        k = round(end_s / h)
        phase = math.pi * (0.5 / 60) * end_s**2  # half of 2 pi (0.5 / 60) t^2
        assert wave[k] == pytest.approx(top * math.sin(phase), abs=1e-12)
        assert wave[37] == pytest.approx(top * math.sin(math.pi / 120 * 0.37**2), abs=1e-15)
    assert slow[2500] == pytest.approx(10 / 11.5 * most, rel=1e-12)  # a quarter of 100 s
    assert full[7500] == pytest.approx(-most, rel=1e-12)
    assert full[1000] == pytest.approx(most * math.sin(0.2 * math.pi), rel=1e-12)
    for wave, end in ((low, 5 / 11.5 * most), (high, 10 / 11.5 * most)):
        rise = math.ceil(end / (math.radians(20) * h))
        assert len(wave) == 1000 + rise + 6000
        assert not wave[:1001].any()
        assert np.diff(wave[1000 : 1000 + rise]) == pytest.approx(math.radians(20) * h)
        assert set(wave[1000 + rise :]) == {end}
    assert deg == pytest.approx(14.3239, abs=1e-4)


def test_a_signals_error_is_the_largest_of_all_torques_and_its_last_minute_shows_growth(
    monkeypatch,
):
    steps, h = 200, 0.5  # a minute is the last 120 steps
    exact = {n: np.ones(steps) for n in ("tau_left_Nm", "tau_right_Nm", "theta_rad", "tau")}
    got = {n: v.copy() for n, v in exact.items()}
    got["tau_left_Nm"][79], got["tau_right_Nm"][79] = 1.25, 0.5
    got["tau_left_Nm"][80], got["tau_right_Nm"][150] = 1.125, 0.75
    got["theta_rad"][:], got["tau"][:] = 9, 9
    asked = []

    def compile_device(device, real):
        def run(inputs, trace):
            asked.append((real, {n: len(v) for n, v in inputs.items()}))
            return ({"q31": got, "f64": exact}[real],)

        return SimpleNamespace(task=lambda name: SimpleNamespace(run=run))

    monkeypatch.setattr(fixed_report, "compile_device", compile_device)
    system = SimpleNamespace(
        tasks=[SimpleNamespace(name="sense")],
        task_inputs=lambda task: [SimpleNamespace(name=n) for n in ("left_rad", "right_rad")],
    )
    device = measured(period_s=h, system=system, tau_full_scale_Nm=8.0)
    found = fixed_report.compare_signal(device, "walk", np.zeros(steps))
    assert found == SignalResult("walk", steps, 0.5, 0.0625, 0.03125)
    given = {"left_rad": steps, "right_rad": steps}
    assert asked == [("q31", given), ("f64", given)]


PORTS = (
    Port("y_Nm", -4.0, 2.0, "Torque."),
    Port("z_rad", -1.0, 8.0, "Angle."),
    Port("status", 0.0, 1.0, "Bits.", flags=(Flag("F", "Flag."),)),
)


def compared(monkeypatch, streams, bound_steps=math.inf):
    """Results of a Block whose comparisons are typed, stream by stream."""
    block = SimpleNamespace(name="b", outputs=PORTS)
    bound = Bound("q31", bound_steps, {"y_Nm": 0.4, "z_rad": 1.6, "status": 0}, {}, "m", ())
    made = {s: SimpleNamespace(**v) for s, v in streams.items()}
    monkeypatch.setattr(fixed_report, "bounds_of", lambda device: {"b": bound})
    monkeypatch.setattr(fixed_report, "plan_block", lambda b: SimpleNamespace(wide={1, 2, 3}))
    monkeypatch.setattr(
        fixed_report, "streams", lambda b, steps: [Stream(n, {}) for n in streams if steps == 300]
    )

    def compare(device, plan, runner, stream, b):
        assert (device.kind, plan.wide, runner, b) == ("device", {1, 2, 3}, "C of b", bound)
        return made[stream.name]

    monkeypatch.setattr(fixed_report, "compare_fixed", compare)
    said = []
    device = SimpleNamespace(kind="device", system=SimpleNamespace(kinds=[block]))
    library = SimpleNamespace(block=lambda name: f"C of {name}")
    (found,) = fixed_report._compare_blocks(device, library, said.append)
    assert said == ["b"]
    return found


def test_a_block_is_told_by_its_worst_output_and_all_its_streams(monkeypatch):
    walk = {"errors": {"y_Nm": 0.1, "z_rad": 0.08, "status": 99}, "turned": 2, "beyond": True}
    noise = {"errors": {"y_Nm": 0.04, "z_rad": 0.4, "status": 0}, "turned": 3, "beyond": False}
    streams = {"walk": {**walk, "problems": ["bits"]}, "noise": {**noise, "problems": []}}
    found = compared(monkeypatch, streams)
    # Shares of the larger end: 0.4 of 4, 1.6 of 8; 0.1 of 4, 0.4 of 8.
    assert found == BlockResult("b", "all time", 0.2, 0.05, 3, 5, ["walk: bits"])
    found = compared(monkeypatch, {"walk": {**walk, "problems": []}}, 1)
    assert found == BlockResult("b", "one step", 0.2, 0.025, 3, 2, [UNTRIED])


def test_what_makes_a_report_fail():
    good = SignalResult("s", 1, 0.1, 5e-4, 0.0)
    core = SimpleNamespace(identical=True)
    proof = SimpleNamespace(proven=True)
    chain = SimpleNamespace(passed=True)
    whole = FixedReport(
        "x", [BlockResult("b", "one step", 0, 0, 0, 0, [])], [good], [core], [proof], chain
    )
    assert fixed_report.AIM_SHARE == 5e-4  # 0.05 % of full scale
    assert whole.passed
    assert FixedReport("x", []).passed
    for change in (
        {"blocks": [*whole.blocks, replace(whole.blocks[0], problems=["bits"])]},
        {"signals": [good, replace(good, share=math.nextafter(5e-4, 1))]},
        {"signals": [replace(good, share=math.nan)]},
        {"cores": [core, SimpleNamespace(identical=False)]},
        {"proofs": [SimpleNamespace(proven=False), proof]},
        {"chain": SimpleNamespace(passed=False)},
    ):
        assert not replace(whole, **change).passed, change


def test_which_cores_run_what(monkeypatch):
    ran = []

    def run_bare(device, real, board, inputs):
        ran.append((real, board))
        assert list(inputs) == ["a_rad", "b_rad"]
        assert all(v.tolist() == [*range(0, 1999, 9)][:200] for v in inputs.values())

    monkeypatch.setattr(fixed_report, "run_bare", run_bare)
    monkeypatch.setattr(fixed_report, "domain_chirp", lambda d, s: np.arange(int(999.5 * s)))
    system = SimpleNamespace(
        tasks=["sense"],
        task_inputs=lambda task: [SimpleNamespace(name=n) for n in ("a_rad", "b_rad")],
    )
    said: list[str] = []
    assert len(fixed_report._cores(measured(system=system), said.append)) == 5
    assert ran == [("q31", "m3"), ("f32", "m3"), ("q31", "m0"), ("f32", "m0"), ("f32", "m4f")]
    assert (said[0], said[4]) == ("Cortex-M3, q31", "Cortex-M4F, f32")
    monkeypatch.setattr(fixed_report, "run_bare_system", lambda *a: a[1:])
    monkeypatch.setattr(fixed_report, "_drive_inputs", lambda device: {"t": {}})
    drive = SimpleNamespace(file=SimpleNamespace(joint=object()))
    found = fixed_report._cores(drive, said.append)
    assert found[1:3] == [("f32", "m3", {"t": {}}), ("q31", "m0", {"t": {}})]


def test_a_check_compares_what_is_asked_for(monkeypatch):
    tried = []
    for name, made in {
        "compile_device": lambda device, real: real,
        "_compare_blocks": lambda device, library, say: [library],
        "domain_chirp": lambda device, s: np.full(int(s), 0.5),
        "published_motions": lambda device: iter([("published", np.zeros(3))]),
        "compare_signal": lambda device, name, theta: (name, len(theta)),
        "search_chain": lambda device, trials, say: trials,
        "_cores": lambda device, say: ["cores"],
        "prove_block": lambda device, block: f"proof of {block.name}",
    }.items():
        monkeypatch.setattr(fixed_report, name, made)
    system = SimpleNamespace(kinds=[SimpleNamespace(name=n) for n in "ab"])
    device = measured(system=system)
    found = fixed_report.check_fixed(device, 2.6, {"own": np.zeros(7)}, progress=tried.append)
    assert found.blocks == ["q31"]
    assert found.signals == [("published", 3), ("chirps, 3 min", 180), ("own", 7)]
    assert (found.chain, found.cores, found.proofs) == (None, [], [])
    assert tried == ["published", "chirps, 3 min", "own"]
    assert fixed_report.check_fixed(device, 0.2).signals[1] == ("chirps, 1 min", 60)
    full = fixed_report.check_fixed(device, cores=True, prove=True, search=9)
    assert (full.chain, full.cores) == (9, ["cores"])
    assert full.proofs == ["proof of a", "proof of b"]
    device.file.joint = object()
    assert fixed_report.check_fixed(device).signals == []
    assert fixed_report.read_recorded(device, None, None) == {}
