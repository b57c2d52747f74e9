"""What a campaign makes of mutants, how they are compiled together and told apart: all made up."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.program import Program
from esea_gen.verify.mutation import bench, campaign, tasks
from esea_gen.verify.mutation.bench import Bench
from esea_gen.verify.mutation.campaign import MutationReport, run_mutation

# -- the campaign ----------------------------------------------------------------------------------


def a_mutant(name: str, file: str = "a.c", kind: str = "k", function: str = "step"):
    return SimpleNamespace(
        **{"file": file, "kind": kind, "function": function, "kernel": name, "edit": name},
        **{"block": None, "__str__": name},
    )


FATES = {  # proof, told apart, outside the bound; None where the compiler refuses
    "killed": ("", "bits", True),
    "small": ("", "bits", False),
    "same": ("another form", "", None),
    "lost": ("", "", None),
    "wrong proof": ("always", "bits", True),
    "whole": ("a whole number is compared", "bits", True),
    "refused": None,
}


def ran(monkeypatch, names, sample=None, seed=0, blocks=None, **files):
    made = [a_mutant(n, files.get(n.split()[0], "b.c"), n[0]) for n in names]
    asked = {"checked": 0, "said": [], "loaded": []}

    class NoBench:
        def __init__(self, device, real, folder, loose, kinds):
            asked.update(loose=loose, kinds=[k.name for k in kinds])
            self.loose = loose

        def check(self):
            asked["checked"] += 1

        def loaded(self, group):
            asked["loaded"].append([m.kernel for m in group])
            for m in group:
                yield m, None if FATES[m.kernel] is None else m.kernel

        def difference(self, library, mutant):
            assert library == mutant.kernel
            return FATES[library][1]

        def outside_bound(self, library, mutant):
            return FATES[library][2]

    monkeypatch.setattr(campaign, "Bench", NoBench)
    monkeypatch.setattr(campaign, "mutants", lambda device, real: list(made))
    monkeypatch.setattr(campaign, "Prover", lambda kernel, fmt, block: lambda edit: FATES[edit][0])
    kinds = [SimpleNamespace(name=n) for n in "bcd"]
    monkeypatch.setattr(campaign, "chosen_blocks", lambda device, blocks: kinds)
    made[0].block = kinds[1]
    device = SimpleNamespace(name="x")
    report = run_mutation(device, "f32", sample, seed, asked["said"].append, blocks)
    return report, asked


def test_every_fate_is_counted_once(monkeypatch):
    names = [*FATES, "lost", "killed", "killed"]
    report, asked = ran(monkeypatch, names, lost="a.c")
    assert (report.tried, report.rejected, report.killed) == (9, 1, 6)
    assert report.killed_by_bound == 5
    assert [(m.kernel, p) for m, p in report.equivalent] == [("same", "another form")]
    assert [m.kernel for m in report.survivors] == ["lost", "lost"]
    assert [m.kernel for m, _ in report.contradicted] == ["wrong proof"]
    assert report.kinds == {"k": (3, 3), "s": (1, 2), "l": (0, 2), "w": (2, 2)}
    assert (report.score, report.raw_score) == (6 / 8, 6 / 9)
    # File by file, and what ships is looked at first.
    assert [len(g) for g in asked["loaded"]] == [2, 8]
    assert (asked["checked"], asked["loose"], asked["kinds"]) == (1, True, ["c"])
    assert asked["said"] == ["x, f32: mutant 1 of 10"]
    told = report.to_dict()
    assert (told["score"], told["required_score"], told["kinds"]["s"]) == (
        *(0.75, 0.95, {"killed": 1, "tried": 2}),
    )
    assert (told["tried"], told["rejected_by_compiler"], told["killed_by_bound_alone"]) == (9, 1, 5)


def test_it_says_how_far_it_is_every_fifty(monkeypatch):
    _, asked = ran(monkeypatch, ["lost"] * 49 + ["refused"] + ["killed"] * 51)
    assert asked["said"] == [f"x, f32: mutant {k} of 101" for k in (1, 51, 101)]


def test_a_sample_is_drawn_by_its_seed_and_asks_no_bound(monkeypatch):
    names = ["killed"] * 30 + ["lost"] * 30
    report, asked = ran(monkeypatch, names, 20, 4)
    assert (report.tried, report.killed_by_bound, asked["loose"]) == (20, None, False)
    again, _ = ran(monkeypatch, names, 20, 4)
    others = {ran(monkeypatch, names, 20, s)[0].killed for s in range(5, 12)}
    assert again.killed == report.killed
    assert len(others) > 1
    assert ran(monkeypatch, names, 60, 4)[0].killed == 30
    assert ran(monkeypatch, names, 99, 4)[0].tried == 60


def test_blocks_are_chosen_by_their_files(monkeypatch):
    files = {"killed": "esea_x_b.c", "small": "esea_x.c", "lost": "esea_x_d.c"}
    report, _ = ran(monkeypatch, ["killed", "small", "lost"], blocks=["b"], **files)
    assert report.tried == 2
    report, _ = ran(monkeypatch, ["killed", "small", "lost"], **files)
    assert report.tried == 3


def test_a_report_of_nothing_has_missed_nothing():
    empty = MutationReport("x", "f64")
    assert (empty.score, empty.raw_score) == (1.0, 1.0)
    empty.tried, empty.equivalent = 1, [("m", "p")]
    assert (empty.score, empty.raw_score) == (1.0, 0.0)


def test_a_proof_is_of_a_kernel_and_of_a_block_only_in_its_step(monkeypatch):
    made = []
    monkeypatch.setattr(
        campaign, "Prover", lambda *a: made.append(a) or (lambda edit: f"{len(made)} {edit}")
    )
    prove = campaign._Provers(FORMATS["f32"])
    block = Block.__new__(Block)
    one, two = (a_mutant(n, function=f) for n, f in (("e", "step"), ("d", "init")))
    one.block = two.block = block
    assert (prove(one), prove(two), prove(one)) == ("1 e", "2 d", "2 e")
    assert [a[2] for a in made] == [block, None]
    one.edit = None
    assert prove(one) == ""


# -- the bench -------------------------------------------------------------------------------------


def test_each_text_has_names_of_its_own():
    assert bench._renamed(["one", "two"], ["f", "g"]) == (
        "#define f m0_f\n#define g m0_g\none\n#undef f\n#undef g\n"
        "#define f m1_f\n#define g m1_g\ntwo\n#undef f\n#undef g"
    )


def no_bench(**parts) -> Bench:
    made = Bench.__new__(Bench)
    for name, value in parts.items():
        setattr(made, name, value)
    return made


def test_faults_are_compiled_together_up_to_a_size_and_halved_where_one_is_refused(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(bench, "BATCH_SIZE", 10)
    commands, chosen = [], []

    def gcc(*arguments, check=False):
        commands.append(arguments)
        (tmp_path / arguments[arguments.index("-o") + 1]).write_text("")
        return "bad" not in (tmp_path / "mutants.c").read_text()

    opened = SimpleNamespace(esea_choose_mutant=chosen.append)
    ffi = SimpleNamespace(dlopen=lambda path: opened, dlclose=lambda lib: chosen.append("closed"))
    made = no_bench(
        renderer=None, folder=tmp_path, batches=0, library=SimpleNamespace(ffi=ffi),
        objects={"a.c": "a.c.o", "b.c": "b.c.o"}, fmt=SimpleNamespace(needs_libm=False),
        _gcc=gcc, _symbols=lambda m: (["own"], ["f"]), _choosing=lambda n, names: f"{n} {names}",
    )  # fmt: skip

    def mutant(text):
        return SimpleNamespace(file="a.c", text=lambda renderer: text)

    texts = ["aaaa", "bbbb", "ccc", "bad", "dd", "ee"]
    found = [(m.text(None), lib is not None) for m, lib in made.loaded([mutant(t) for t in texts])]
    assert found == [(t, t != "bad") for t in texts]
    # Three together, for more than ten letters; then three, of which one alone is refused.
    assert chosen == [0, 1, 2, "closed", 0, 1, "closed"]
    assert [c[:4] for c in commands] == 4 * [("-shared", "mutants.c", "choose.c", "b.c.o")]
    assert [c[5] for c in commands] == [f"mutants{k}.so" for k in (1, 2, 3, 4)]
    assert (tmp_path / "choose.c").read_text() == "2 ['f']"
    assert (tmp_path / "mutants.c").read_text().startswith("#define own m0_own\n#define f m0_f\ndd")
    assert not (tmp_path / "mutants1.so").exists()
    assert list(made.loaded([])) == []
    made.fmt.needs_libm = True
    list(made.loaded([mutant("x")]))
    assert commands[-1][-1] == "-lm"


def test_functions_of_the_files_names_call_the_chosen_one():
    def kind(name, *arguments):
        args = [SimpleNamespace(kind=k, cname=c) for k, c in arguments]
        return SimpleNamespace(result=SimpleNamespace(cname=name), args=args)

    kinds = {
        "f": kind("void", ("pointer", "x *"), ("primitive", "uint32_t")),
        "g": kind("int", ("pointer", "y *")),
    }
    ffi = SimpleNamespace(typeof=lambda function: kinds[function])
    library = SimpleNamespace(ffi=ffi, lib=SimpleNamespace(f="f", g="g"))
    assert no_bench(library=library)._choosing(2, ["f", "g"]).splitlines() == [
        *("#include <stdint.h>", "static int chosen;"),
        "void esea_choose_mutant(int which) { chosen = which; }",
        *(f"void m{k}_f(void *, uint32_t);" for k in range(2)),
        "static void (*const table_f[])(void *, uint32_t) = {m0_f, m1_f};",
        "void f(void * a0, uint32_t a1) { table_f[chosen](a0, a1); }",
        *(f"int m{k}_g(void *);" for k in range(2)),
        "static int (*const table_g[])(void *) = {m0_g, m1_g};",
        "int g(void * a0) { return table_g[chosen](a0); }",
    ]


def test_what_a_file_defines_for_others():
    system = SimpleNamespace(tasks=[SimpleNamespace(name="run")])
    library = SimpleNamespace(
        prefix="esea_small", system=system,
        lib=SimpleNamespace(**dict.fromkeys(
            ("esea_small_init", "esea_small_run_step", "esea_small_b_init", "esea_small_b_step"))),
    )  # fmt: skip
    renderer = SimpleNamespace(emitted={"b": object()})
    made = no_bench(library=library, renderer=renderer)
    assert made._symbols(SimpleNamespace(block=None)) == (
        *([], ["esea_small_init", "esea_small_run_step"]),
    )
    own = SimpleNamespace(block=SimpleNamespace(name="b"))
    assert made._symbols(own) == ([], ["esea_small_b_init", "esea_small_b_step"])


class Exact:
    """What a stream must give: its own name."""

    def __init__(self, name: str) -> None:
        self.stream = name

    def first_difference(self, outputs, states):
        return f"{self.stream} differs" if self.stream in outputs else ""


def test_the_first_difference_is_told_and_the_rest_is_not_run(monkeypatch):
    block = SimpleNamespace(name="b")
    ran_ = []

    def run_c(runner, stream):
        ran_.append(stream)
        return runner, {}

    setup = {"told": ""}
    monkeypatch.setattr(bench, "run_c", run_c)
    monkeypatch.setattr(bench, "setup_difference", lambda block, library, wanted: setup["told"])
    monkeypatch.setattr(bench, "task_signature", lambda library: library.wiring)
    judged = [bench.Judged(Exact(n), None) for n in ("walk", "noise", "steps")]
    made = no_bench(
        judged={"b": judged}, setups={"b": None}, blocks=[block], programs=[], library=None
    )
    made.__dict__["wiring"] = [b"as it ships"]

    def library(*differs, wiring=b""):
        return SimpleNamespace(block=lambda name: differs, wiring=[wiring])

    assert made.block_difference(library("noise", "steps"), block) == "noise differs"
    assert ran_ == ["walk", "noise"]
    assert made.block_difference(library(), block) == ""
    setup["told"] = "init differs"
    assert made.block_difference(library("walk"), block) == "init differs"
    step, whole, init = (
        SimpleNamespace(block=b, function=f)
        for b, f in ((block, "step"), (None, ""), (block, "init"))
    )
    assert made.difference(library("walk"), step) == "walk differs"
    assert made.difference(library("walk"), init) == "init differs"
    assert made.difference(library(wiring=b"as it ships"), whole) == ""
    assert made.difference(library(wiring=b"other"), whole).startswith("the task differs")
    made.library = library()
    with pytest.raises(RuntimeError, match="already differs: init differs"):
        made.check()
    setup["told"] = ""
    made.check()


def test_the_looser_criterion_has_a_bound_only_of_blocks(monkeypatch):
    asked = []

    def compare(device, block, library, stream, bounds, _, rule, symbolic):
        asked.append((stream, bounds, rule, symbolic))
        return SimpleNamespace(passed=stream != library)

    monkeypatch.setattr(bench, "compare", compare)
    judged = [bench.Judged(Exact(n), s) for n, s in (("a", "A"), ("b", None), ("c", "C"))]
    made = no_bench(judged={"b": judged}, limits={"b": ("bounds", "rule")}, device=None)
    one = SimpleNamespace(block=SimpleNamespace(name="b"))
    assert not made.outside_bound("b", one)
    assert asked == [("a", "bounds", "rule", "A"), ("c", "bounds", "rule", "C")]
    assert made.outside_bound("c", one)
    assert made.outside_bound("b", SimpleNamespace(block=None))
    program = Program.__new__(Program)
    assert made.outside_bound("b", SimpleNamespace(block=program))


def test_a_program_is_run_in_a_process_of_its_own(monkeypatch):
    program = SimpleNamespace(name="p")
    made = no_bench(device=None, executed={"p": [(SimpleNamespace(name=n), n) for n in "abc"]})
    fails = {"a": "", "b": "bits", "c": ""}

    def compare(device, p, library, stream, expected):
        assert stream.name == expected
        if library == "astray":
            raise RuntimeError("astray")
        return SimpleNamespace(passed=stream.name not in library, problems=fails[stream.name])

    monkeypatch.setattr(bench, "compare_program", compare)
    assert made.program_difference("", program) == ""
    assert made.program_difference("cb", program) == "b: bits"
    assert made.program_difference("c", program) == "c: bits differ"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert made._program_difference("", program) == ""
        assert made._program_difference("c", program) == "the Program differs from its executor"


# -- tasks -----------------------------------------------------------------------------------------


def test_other_tunables_lie_low_and_high_in_turn():
    gains = [("a", "low", -1.0, 3.0), ("b", "x", 0.0, 1.0), ("a", "high", 10.0, 20.0)]
    system = SimpleNamespace(
        tunables=[(i, SimpleNamespace(name=n, low=lo, high=hi)) for i, n, lo, hi in gains]
    )
    shares = [np.float32(v) for v in (-1 + 0.3 * 4, 0.7, 13.0)]
    assert tasks._other_tunables(system) == {
        "a": {"low": pytest.approx(shares[0]), "high": shares[2]},
        "b": {"x": float(shares[1])},
    }


def test_a_board_is_run_by_its_ticks_and_told_a_hundred_at_a_time(monkeypatch):
    fast = SimpleNamespace(name="fast", every=1, phase=0)
    slow = SimpleNamespace(name="slow", every=7, phase=3)
    made = []
    monkeypatch.setattr(
        tasks, "working_inputs",
        lambda system, task, steps: {"x": np.arange(float(steps))},
    )  # fmt: skip

    class Board:
        def __init__(self, wrong=None):
            self._state, self.wrong, self.ticks = bytearray(4), wrong, 0

        def release(self, tick):
            assert tick == self.ticks
            self.ticks += 1

        def step(self, name, x):
            made.append((self.ticks - 1, name, x))
            self._state[0] = int(x) % 256
            return {"y": x + (made[-1] == self.wrong)}

    library = SimpleNamespace(
        system=SimpleNamespace(tasks=[fast, slow]), ffi=SimpleNamespace(buffer=lambda b: b)
    )
    sound = tasks._board_run(library, Board())
    assert len(sound) == 12
    assert [m for m in made if m[1] == "slow"][:2] == [(3, "slow", 0.0), (10, "slow", 1.0)]
    assert sum(m[1] == "slow" for m in made) == 171  # ticks 3, 10, ... 1193
    assert [m[0] for m in made if m[1] == "fast"] == list(range(1200))
    assert all(m[2] == m[0] for m in made if m[1] == "fast")
    for wrong, first in (((99, "fast", 99.0), 0), ((100, "fast", 100.0), 1),
                         ((1193, "slow", 170.0), 11)):  # fmt: skip
        other = tasks._board_run(library, Board(wrong))
        assert [a == b for a, b in zip(sound, other, strict=True)] == [k < first for k in range(12)]


class Runner:
    """A task with one tunable, whose C notes what it was given; y = 2 x, once per row."""

    prefix = stem = "p"
    _in_type = np.dtype([("x", "<f4"), ("v", "<f4", (2,))])
    _out_type = np.dtype([("y", "<f4"), ("untouched", "u1", (4,))])
    _state_type = np.dtype([("s", "<u4")])

    def __init__(self, made: list) -> None:
        self.made = made
        self._coeffs, self._params = [bytearray(b"coef")], bytearray(b"par")
        self._state = np.zeros(1, self._state_type)

    @property
    def state(self):
        return self._state.copy()

    @state.setter
    def state(self, value):
        self._state[:] = value
        self.made.append(("state", value.tobytes()))

    def reset(self):
        self.made.append("reset")
        self._state["s"] += 1

    def prepare(self, tunables):
        self.made.append(("prepare", tunables))
        for memory in self._coeffs:
            memory[0] = len(self.made)
        return 300

    def pack(self, inputs):
        packed = np.zeros(800, self._in_type)
        for name, values in inputs.items():
            packed[name] = values
        return packed

    def _cast(self, kind, values):
        return values

    def _run(self, *given):
        packed, out, states, steps = given[-4:]
        self.made.append(("run", packed.copy(), out.tobytes()[:8], steps))
        out["y"] = 2 * packed["x"]
        states["s"] = np.arange(steps)


def test_what_a_task_does_is_told_from_rubbish_and_at_the_ends_of_its_tunables():
    made: list = []
    ports = [SimpleNamespace(name=n, port=Port(n, low, high, n, size=k)) for n, low, high, k in (
        ("x", -2.0, 4.0, 1), ("v", -1.0, 1.0, 2),
    )]  # fmt: skip
    tunable = SimpleNamespace(name="g", low=-1.0, high=2.0)
    system = SimpleNamespace(
        tasks=[SimpleNamespace(name="run")], tunables=[("b", tunable)], latches=(),
        task_inputs=lambda task: ports,
    )  # fmt: skip
    runner = Runner(made)
    library = SimpleNamespace(
        ffi=SimpleNamespace(buffer=lambda memory: memory), system=system, task=lambda name: runner
    )
    found = tasks.task_signature(library)
    asked = [m[1] for m in made if m[0] == "prepare"]
    values = [t["b"]["g"] for t in asked[:7]]
    ulp = 2.0**-23
    assert values[:4] == [-1.0, 2.0, -1.0 - ulp, 2.0 + 2 * ulp]
    assert np.isnan(values[4])
    assert values[5:] == [np.inf, 0.5]
    assert asked[7:] == [{}, {"b": {"g": float(np.float32(-0.1))}}]
    # The code, of which a byte is kept, and the coefficients after each.
    assert found[:7] == [bytes([300 % 256, k]) + b"oef" for k in range(1, 8)]
    # Memory is rubbish before it is prepared, the state before it is reset.
    assert found[7:10] == [b"\x08" + 3 * b"\xa5", 3 * b"\xa5", b"\xa6" + 3 * b"\xa5"]
    assert made[8:10] == [("state", 4 * b"\xa5"), "reset"]
    runs = [m for m in made if m[0] == "run"]
    assert [(m[2], m[3]) for m in runs] == 4 * [(8 * b"\xa5", 800)]
    slow, wild = (m[1] for m in runs[:2])
    for packed in (wild["x"] / 1.02, wild["v"] / 1.02):
        assert packed.shape[0] == 800
    assert (wild["x"].min(), wild["x"].max()) == pytest.approx((-2.04, 4.08), abs=0.05)
    assert (wild["v"].min(), wild["v"].max()) == pytest.approx((-1.02, 1.02), abs=0.02)
    wave = 0.3 * np.sin(0.01 * np.arange(800))
    assert slow["x"] == pytest.approx(wave * abs(wild["x"][0]), abs=1e-6)
    assert slow["v"][:, 1] == pytest.approx(wave * abs(wild["v"][0, 1]), abs=1e-6)
    out = np.frombuffer(found[10], Runner._out_type)
    assert np.array_equal(out["y"], 2 * slow["x"])
    assert set(out["untouched"].ravel()) == {0xA5}
    assert found[11] == np.arange(800, dtype="<u4").tobytes()
    assert len(found) == 7 + 2 * (3 + 4)
    # A task without coefficients is run once; with latches, the board is run too.
    runner._coeffs = []
    made.clear()
    system.tunables = []
    assert len(tasks.task_signature(library)) == 1 + 4
    assert [m for m in made if m[0] == "prepare"] == [("prepare", {})]
