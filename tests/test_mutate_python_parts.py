"""Whom a fault in Python is shown to, and what is made of their answers: no test runs."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from esea_gen.errors import UserError
from esea_gen.verify.mutation import python
from esea_gen.verify.mutation.python import Found, PythonReport, _asked, _Copy, _drawn, sources_of
from esea_gen.verify.mutation.python_edits import PythonFaults, PythonMutant
from esea_gen.verify.mutation.python_tests import QUICK_FILES, QUICK_TESTS, Entered


def mutant(line=3, suspect="", path="esea_gen/a.py"):
    return PythonMutant(path, line, "sign", "1  ->  -1", suspect, "text", 2)


def found(fate, by="", of="room", **more):
    return Found(of, mutant(**more), fate, by, ("tests/test_a.py", "tests/test_b.py"))


# -- what is told ----------------------------------------------------------------------------------


def test_a_fault_in_one_line_and_as_json():
    edit = "esea_gen/a.py:3: sign: 1  ->  -1"
    assert str(found("survived")) == f"survived: {edit}"
    assert str(found("killed", "test_a")) == f"noticed by test_a: {edit}"
    assert str(found("no end", "test_a")) == f"no end in test_a: {edit}"
    row = {"of": "room", "file": "esea_gen/a.py", "line": 3, "kind": "sign", "edit": "1  ->  -1"}
    assert found("killed", "t").to_dict() == {**row, "fate": "killed", "noticed_by": "t"}
    assert found("no end", "t").to_dict() == {**row, "fate": "no end", "noticed_by": "t"}
    asked = ["tests/test_a.py", "tests/test_b.py"]
    assert found("survived").to_dict() == {**row, "fate": "survived", "tests": asked}
    assert found("survived", suspect="why").to_dict() == {
        **{**row, "fate": "survived", "equivalent_suspect": "why", "tests": asked},
    }


def test_a_report_counts_what_no_test_noticed():
    report = PythonReport(7)
    assert (report.score, report.survivors) == (1.0, [])
    report.found = [
        found("killed", "t"), found("survived", of="other", line=9), found("no end", "t"),
        found("survived", suspect="a text"), found("killed", "t", of="other"),
    ]  # fmt: skip
    report.broken, report.left_out = {"b", "a"}, (4, 30)
    assert report.score == 3 / 5
    assert [m.line for m in report.survivors] == [9, 3]
    assert report.table() == [
        "survived: esea_gen/a.py:9: sign: 1  ->  -1",
        "survived: esea_gen/a.py:3: sign: 1  ->  -1  (a text)",
        *(f"fails without a fault, set aside: {name}" for name in "ab"),
        *("room: 2 of 3", "other: 1 of 2"),
        "3 of 5 faults noticed, 2 survived (1 of these may do nothing at all)",
        "4 of 30 places left out by rule: no wrong result",
    ]
    told = report.to_dict()
    assert [told[k] for k in ("seed", "tried", "score", "left_out_by_rule", "places")] == [
        *(7, 5, 0.6, 4, 30),
    ]
    assert (told["fails_without_fault"], len(told["mutants"])) == (["a", "b"], 5)
    report.found = report.found[:1]
    assert "room: 1 of 1" not in report.table()


# -- what is drawn ---------------------------------------------------------------------------------


def test_rooms_files_and_numbers_by_name(tmp_path):
    for name in ("esea_gen/room/__init__.py", "esea_gen/room/deep/b.py", "esea_gen/one.py",
                 "esea_gen/other/__init__.py", "tests/test_a.py"):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    room = [Path("esea_gen/room/__init__.py"), Path("esea_gen/room/deep/b.py")]
    assert sources_of(tmp_path, "room") == sources_of(tmp_path, "esea_gen/room") == room
    assert sources_of(tmp_path, "one") == sources_of(tmp_path, "esea_gen/one.py")
    assert sources_of(tmp_path, "room/deep/b.py") == room[1:]
    for name in ("none", "one.txt"):
        with pytest.raises(UserError, match="no room or file") as error:
            sources_of(tmp_path, name)
        assert error.value.fix == "Rooms: other, room."
    with pytest.raises(UserError) as error:
        sources_of(tmp_path / "tests", "none")
    assert error.value.fix == "Run it in a checkout of the sources."
    assert [_asked(w, 5) for w in ("room", "room:1", "a.py:12")] == [
        *(("room", 5), ("room", 1), ("a.py", 12)),
    ]
    for wrong in ("room:0", "room:x", "room:-1"):
        with pytest.raises(UserError, match="no number of faults"):
            _asked(wrong, 5)


def test_faults_are_drawn_by_their_seed_from_all_files_alike():
    files = [PythonFaults(f"{n}.py", "y = a + 2\nz = b - 3\n") for n in "ab"]
    all_ = _drawn(files, None, 1)
    assert len(all_) == len({(m.path, m.text) for m in all_}) == 18
    assert all_ == sorted(all_, key=lambda m: (m.path, m.line, m.kind, m.edit))
    few = _drawn(files, 6, 1)
    assert len(few) == 6
    assert set(few) <= set(all_)
    assert few == _drawn(files, 6, 1)
    assert {tuple(_drawn(files, 6, s)) for s in range(4)} != {tuple(few)}
    assert {m.path for s in range(4) for m in _drawn(files, 6, s)} == {"a.py", "b.py"}
    assert len(_drawn(files, 99, 1)) == 18


# -- who is asked ----------------------------------------------------------------------------------


class Copy(_Copy):
    """Tests that answer as is typed: with the fault, and without."""

    def __init__(self, with_fault=(), without=()) -> None:
        self.broken, self.sound, self.asked = set(), set(), []
        self.answers = {True: list(with_fault), False: list(without)}
        self.faulty = False
        self.root = Path(__file__).parent

    @contextmanager
    def fault(self, mutant):
        self.faulty = True
        yield
        self.faulty = False

    def run(self, tests, limit_s, *more, **env):
        self.asked.append((self.faulty, list(tests), limit_s))
        return self.answers[self.faulty].pop(0)


A = ["tests/test_a.py"]


def test_who_fails_with_the_fault_and_passes_without_has_noticed():
    for name in ("test_x", "test_x[1 - 2]", "test_x[a b-c]", "C::test_x[]"):
        for more in ("", " - AssertionError: [1] - 2 == [3]"):
            copy = Copy([(1, f"1 failed\nFAILED tests/test_a.py::{name}{more}\n")], [(0, "")])
            assert copy.who_notices(mutant(), A, 9) == ("killed", f"tests/test_a.py::{name}")
    copy = Copy([(1, "ERROR tests/test_a.py::test_y\n")] * 2, [(0, "")])
    for _ in range(2):  # the second time it is known to be sound
        assert copy.who_notices(mutant(), A, 9) == ("killed", "tests/test_a.py::test_y")
    assert copy.asked == [
        *((True, A, 9), (False, ["tests/test_a.py::test_y"], None), (True, A, 9)),
    ]
    # Without a name it is the file; no test, or none that fails, has noticed nothing.
    assert Copy([(2, "")], [(0, "")]).who_notices(mutant(), A, 9) == ("killed", A[0])
    assert Copy([(0, "")]).who_notices(mutant(), A, 9) == ("survived", "")
    assert Copy([(5, "")]).who_notices(mutant(), A, 9) == ("survived", "")


def test_who_fails_without_the_fault_too_is_set_aside():
    def fails(name):
        return 1, f"FAILED tests/test_a.py::test_{name} - x\n"

    copy = Copy([fails("b"), fails("c")], [(1, ""), (0, "")])
    assert copy.who_notices(mutant(), A, 9) == ("killed", "tests/test_a.py::test_c")
    assert copy.broken == {"tests/test_a.py::test_b"}
    copy = Copy([fails(k) for k in range(9)], [(1, "")] * 9)
    assert copy.who_notices(mutant(), A, 9) == ("survived", "")
    assert len(copy.broken) == python.BROKEN_MOST
    copy = Copy([(2, "")] * 9, [(2, "")] * 9)
    assert copy.who_notices(mutant(), A, 9) == ("survived", "")
    assert (copy.broken, len(copy.asked)) == (set(A), 2)


def test_a_test_that_does_not_end_has_noticed_if_it_ends_without():
    copy = Copy([(None, "")], [(0, "")])
    assert copy.who_notices(mutant(), A, 9) == ("no end", A[0])
    assert copy.asked[1] == (False, A, 9)
    assert Copy([(None, "")], [(None, "")]).who_notices(mutant(), A, 9) == ("survived", "")


def asked_in_turn(quick, near, slow):
    """In which order groups of tests are asked, and with what time."""
    turns = []
    fates = {"quick": quick, "near": near, "slow": slow}

    def who(mutant, tests, limit_s):
        turns.append((tests[0], limit_s))
        return (fates[tests[0]], tests[0]) if fates[tests[0]] != "survived" else ("survived", "")

    def of(tests, path, function, most_s):
        assert (path, function) == ("esea_gen/a.py", 2)
        name = {python.QUICK_S: "quick", python.SLOW_S: "slow"}[most_s]
        turns.append(list(tests))
        return ([name], 2.0) if fates[name] else ([], 0.0)

    copy = SimpleNamespace(entered=SimpleNamespace(quick=of), who_notices=who, limit_of=len)
    return _Copy.fate_of, copy, turns


@pytest.mark.parametrize(
    ("quick", "near", "slow", "fate", "asked"),
    [
        ("killed", "killed", "killed", ("killed", "quick"), ["quick"]),
        ("no end", "killed", "killed", ("no end", "quick"), ["quick"]),
        ("survived", "killed", "killed", ("killed", "near"), ["quick", "near"]),
        ("survived", "survived", "killed", ("killed", "slow"), ["quick", "near", "slow"]),
        ("survived", "survived", "survived", ("survived", ""), ["quick", "near", "slow"]),
        ("", "survived", "", ("survived", ""), ["near"]),
        ("", "no end", "killed", ("no end", "near"), ["near"]),
    ],
)
def test_those_that_enter_the_function_are_asked_first(quick, near, slow, fate, asked):
    run, copy, turns = asked_in_turn(quick, near, slow)
    all_ = ["near", "far", "farther"]
    assert run(copy, mutant(), ["near"], all_, None) == fate
    times = {"quick": 60 + 6 * 2.0, "near": 4, "slow": 60 + 6 * 2.0}
    assert [t for t in turns if isinstance(t, tuple)] == [(n, times[n]) for n in asked]
    assert turns[0] == all_
    assert ["far", "farther"] in turns or "near" not in asked
    run, copy, turns = asked_in_turn(quick, near, slow)
    run(copy, mutant(), ["near"], all_, 5.0)
    assert [t for t in turns if isinstance(t, tuple)] == [(n, 5.0) for n in asked]


def test_a_file_has_six_times_its_time_and_a_minute(tmp_path):
    record = tmp_path / "a.json"
    ran = []

    def run(tests, limit_s, *more, **env):
        ran.append((tests, limit_s, more, env))
        record.write_text("{}")

    entered = SimpleNamespace(
        file=lambda test: record, of=lambda test: {"x": {"time_s": 1.5}, "y": {"time_s": 0.5}}
    )
    copy = SimpleNamespace(entered=entered, run=run)
    assert [_Copy.limit_of(copy, "tests/test_a.py") for _ in range(2)] == [72.0, 72.0]
    assert ran == [
        (["tests/test_a.py"], None, ("-p", "esea_entered"), {"ESEA_ENTERED": str(record)}),
    ]  # fmt: skip


# -- what is known of each test --------------------------------------------------------------------


def records(root, **tests):
    """Records of made-up test files: by test, its time and the functions that it enters."""
    (root / "tests").mkdir()
    entered = Entered(root, root / "kept")
    for name, told in tests.items():
        (root / f"tests/test_{name}.py").write_text(f"# {name}\n")
        rows = {
            f"tests/test_{name}.py::{t}": {"time_s": s, "entered": e} for t, (s, e) in told.items()
        }
        entered.file(f"tests/test_{name}.py").write_text(json.dumps(rows))
    return entered, [f"tests/test_{name}.py" for name in tests]


def test_what_enters_little_else_and_lasts_short_comes_first(tmp_path):
    here, near = "room/a.py:7", "room/a.py:77"
    entered, tests = records(
        tmp_path,
        one={"wide": (0.1, [here, "x", "y"]), "slow": (3.0, [here]), "quick": (0.2, [here])},
        two={"other": (0.1, [near]), "pair": (0.3, [here, near])},
        three={"apart": (0.1, ["room/aa.py:7", "b"])},
    )
    one, two = (f"tests/test_{n}.py::" for n in ("one", "two"))
    ask = entered.quick
    path = "esea_gen/room/a.py"
    assert ask(tests, path, 7, 9.0) == (
        [f"{one}quick", f"{one}slow", f"{two}pair", f"{one}wide"], pytest.approx(3.6),
    )  # fmt: skip
    # One that takes too long is left out, and those after it are not.
    assert ask(tests, path, 7, 0.61)[0] == [f"{one}quick", f"{two}pair", f"{one}wide"]
    assert ask(tests, path, 8, 9.0) == ([], 0.0)
    assert set(ask(tests, path, 0, 9.0)[0]) == {
        *(f"{one}{n}" for n in ("wide", "slow", "quick")), f"{two}other", f"{two}pair",
    }  # fmt: skip
    assert ask(["tests/test_none.py"], path, 7, 9.0) == ([], 0.0)


def test_no_more_tests_and_files_than_are_worth_it(tmp_path):
    files = {f"f{k:02}": {f"t{i:02}": (0.0, ["a.py:1"]) for i in range(9)} for k in range(12)}
    entered, tests = records(tmp_path, **files)
    names, _ = entered.quick(tests, "esea_gen/a.py", 1, 1.0)
    assert (QUICK_TESTS, QUICK_FILES) == (60, 8)
    assert len(names) == 60
    few = {n: {"t": (0.0, ["a.py:1"])} for n in files}
    (tmp_path / "more").mkdir()
    entered, tests = records(tmp_path / "more", **few)
    assert len(entered.quick(tests, "esea_gen/a.py", 1, 1.0)[0]) == 8
