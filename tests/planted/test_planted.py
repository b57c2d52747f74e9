"""Mutation of Python sources: the faults are what they say, and their fate is told truly."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest

from esea_gen.errors import UserError

from .__main__ import main
from .campaign import mutate_python
from .edits import PythonFaults
from .near import Entered, Importers, near_tests

pytestmark = pytest.mark.ci

# Few, for each takes a process: of the sum, and of the text.
TRIED, SEED = 4, 5

SOURCE = '''\
"""Say 1 + 1."""

LIMIT = 3


def clipped(x: float, scale: float = 2.5) -> float:
    """Never 7."""
    log = []
    log.append(x)
    if x > LIMIT and scale > 0:
        raise ValueError("above " + "3")
    return -min(x, scale) + len(log) * 4.0


def label(x: float) -> str:
    return f"{100 * x:.1f} %"


def ends(n: int) -> int:
    while n > 0:
        n -= 1
    return n
'''

TEST = """\
import pytest
from esea_gen.small.sums import clipped, ends, label


def test_clipped():
    assert clipped(1.0) == 3.0
    assert clipped(2.9) == 1.5
    assert ends(3) == 0


def test_limit():
    with pytest.raises(ValueError):
        clipped(4.0)
"""

# Compares with what the program itself gave: accepted along with the fault, it proves nothing.
COMMITTED_TEST = """\
from esea_gen.small.sums import label


def test_label():
    assert label(0.25) == "25.0 %"
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # Of each process that runs tests half the time is that of plugins, which none of these need.
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    files = {
        "esea_gen/__init__.py": "",
        "esea_gen/small/__init__.py": "",
        "esea_gen/small/sums.py": SOURCE,
        "tests/test_sums.py": TEST,
        "tests/test_traces.py": COMMITTED_TEST,
        "pyproject.toml": '[tool.pytest.ini_options]\ntestpaths = ["tests"]\n',
    }
    for name, text in files.items():
        path = tmp_path / "checkout" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "checkout"


def every(source: str) -> list[tuple[int, str, str]]:
    faults = PythonFaults("a.py", source)
    made = [faults.make(k) for k in range(len(faults))]
    return [(m.line, m.kind, m.edit) for m in made if m is not None]


@pytest.mark.parametrize(
    ("source", "kind", "edit"),
    [
        ("y = a + b", "operator", "y = a + b  ->  y = a - b"),
        ("y = a + b", "dropped term", "y = a + b  ->  y = a"),
        ("y = a + b", "dropped term", "y = a + b  ->  y = b"),
        ("y = a / b", "operator", "y = a / b  ->  y = a * b"),
        ("y = a < b", "comparison", "y = a < b  ->  y = a <= b"),
        ("y = a is b", "comparison", "y = a is b  ->  y = a is not b"),
        ("y = x[3]", "off by one", "y = x[3]  ->  y = x[4]"),
        ("y = x[3]", "sign", "y = x[3]  ->  y = x[-3]"),
        ("y = 2.0", "constant", "y = 2.0  ->  y = 2.02"),
        ("y = -x", "sign", "y = -x  ->  y = x"),
        ("y = True", "constant", "y = True  ->  y = False"),
        ("y = not x", "not", "y = not x  ->  y = x"),
        ("y = f(a, b)", "swapped argument", "y = f(a, b)  ->  y = f(b, a)"),
        ("y = a and b", "operator", "y = a and b  ->  y = a or b"),
        ("f.a = b", "deleted statement", "f.a = b"),
        ("n += 1", "deleted statement", "n += 1"),
        ("if a:\n    f()", "not", "a  ->  not a"),
        ("if a:\n    f()", "deleted statement", "f()"),
    ],
)
def test_each_kind_of_fault(source, kind, edit):
    assert (kind, edit) in [(k, e) for _, k, e in every(source)]


@pytest.mark.parametrize(
    "source",
    [
        '"""A text of 3 + 4."""',
        "def f(x: Array[3] = None) -> Size[4]: ...",
        "raise ValueError(f'{a + b}')",
        "if TYPE_CHECKING:\n    from a import b",
        "y = f(a, a)",
        "y = np.maximum(a, b)",
        "y = ca.logic_and(a, b)",
        "y = 'a'",
    ],
)
def test_what_no_run_can_tell_is_left_alone(source):
    assert every(source) == []


@pytest.mark.parametrize(
    ("source", "left"),
    [
        # Whether lengths are looked at, what a repr shows, how wide a line is drawn.
        ("y = zip(a, strict=True)", []),
        ("y = f(a, strict=True)", ["constant"]),
        ("y = field(repr=False)", []),
        ("y = field(init=False)", ["constant"]),
        ("axes.plot(a, lw=0.8, alpha=0.5)", ["deleted statement"]),
        ("axes.plot(a, width=0.8)", ["deleted statement", "constant", "sign"]),
        ("y = new_figure(9.6, 4.0 + a, nrows=2)", ["off by one", "sign", "swapped argument"]),
        # 1 % of an order of magnitude, not its sign, nor 1 % of what has digits or is a quantity.
        ("y = 1e-9", ["sign"]),
        ("y = 1e300", ["sign"]),
        ("y = 2e-9", ["constant", "sign"]),
        ("y = 1e-5", ["constant", "sign"]),
        ("y = 0.001", ["constant", "sign"]),
        ("y = 1e5", ["constant", "sign"]),
        ("y = 1.0", ["constant", "sign"]),
        ("assert a < 1", []),
    ],
)
def test_what_gives_no_wrong_result_is_left_out_by_rule(source, left):
    assert sorted(k for _, k, _ in every(source)) == sorted(left)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("y = zip(a, strict=True)", 1),
        ("axes.plot(a, lw=0.8)", 2),
        ("y = 1e-9", 1),
        ("y = 1e-3", 0),
        ("y = new_figure(9.6, 4)", 4),
        ('"""A text of 3."""\nraise ValueError(f"{a + b}")', 0),
    ],
)
def test_how_many_are_left_out_is_told(source, count):
    assert PythonFaults("a.py", source).left_out == count


def test_faults_are_single_and_leave_the_source_as_it_was():
    faults = PythonFaults("a.py", SOURCE)
    whole = ast.unparse(ast.parse(SOURCE)).splitlines()
    texts = set()
    for k in range(len(faults)):
        mutant = faults.make(k)
        assert mutant is not None
        changed = mutant.text.splitlines()
        assert len(changed) == len(whole)
        assert sum(a != b for a, b in zip(changed, whole, strict=True)) == 1
        assert SOURCE.splitlines()[mutant.line - 1].strip()
        texts.add(mutant.text)
    assert len(texts) > 30
    assert ast.unparse(faults.tree) == ast.unparse(ast.parse(SOURCE))


def test_faults_are_noticed_or_told(checkout):
    before = {p: p.read_bytes() for p in checkout.rglob("*.py")}
    report = mutate_python(checkout, ["small"], limit_s=60, sample=TRIED, seed=SEED)
    assert len(report.found) == TRIED
    fates = {(f.mutant.line, f.mutant.kind, f.mutant.edit): f.fate for f in report.found}
    # Who noticed it is told, and for what nobody noticed, who was asked.
    assert {f.asked for f in report.found} == {("tests/test_sums.py",)}
    for f in report.found:
        assert f.noticed_by.startswith("tests/test_sums.py::test_") == (f.fate == "killed")
    # Of a text that no independent test reads nothing is noticed; of the sum everything is.
    assert {f for (line, _, _), f in fates.items() if line == 16} == {"survived"}
    assert {f for (line, _, _), f in fates.items() if line == 12} == {"killed"}
    assert 0 < report.score < 1
    assert report.score == pytest.approx(1 - len(report.survivors) / TRIED)
    # Repeatable, and the checkout is as it was.
    # However many at a time.
    again = mutate_python(checkout, [f"small:{TRIED}"], limit_s=60, seed=SEED, jobs=3)
    assert again.to_dict() == report.to_dict()
    assert {p: p.read_bytes() for p in checkout.rglob("*.py")} == before
    told = json.loads(json.dumps(report.to_dict()))
    assert told["tried"] == TRIED
    # Nothing of this source is left out.
    every_place = len(PythonFaults("sums.py", SOURCE)) + len(PythonFaults("__init__.py", ""))
    assert (told["left_out_by_rule"], told["places"]) == (0, every_place)


@pytest.mark.slow
def test_a_fault_that_does_not_end_is_ended_and_counts_as_noticed(checkout):
    source = checkout / "esea_gen/small/sums.py"
    source.write_text("def ends(n):\n    while n:\n        n -= 1\n")
    (checkout / "tests/test_sums.py").write_text(
        "from esea_gen.small.sums import ends\n\ndef test_ends():\n    ends(3)\n"
    )
    report = mutate_python(checkout, ["esea_gen/small/sums.py"], limit_s=8)
    fates = {f.mutant.kind: f.fate for f in report.found}
    assert fates["deleted statement"] == "no end"
    assert fates["not"] == "survived"  # nothing looks at what it gives
    assert "survived: esea_gen/small/sums.py:2: not: n  ->  not n" in report.table()


def test_a_test_that_is_slow_without_the_fault_too_tells_nothing(checkout):
    (checkout / "tests/test_sums.py").write_text(
        "import time\nfrom esea_gen.small.sums import ends\n\n"
        "def test_ends():\n    time.sleep(30)\n    assert ends(3) == 0\n"
    )
    (checkout / "esea_gen/small/sums.py").write_text("def ends(n):\n    return 0 * n\n")
    (found,) = mutate_python(checkout, ["esea_gen/small/sums.py:1"], limit_s=2).found
    assert found.fate == "survived"


def test_what_may_do_nothing_is_told_as_such():
    faults = PythonFaults("a.py", 'y = 1 if a < b else 2\nz = f"{100 * a}"\n')
    made = [m for m in map(faults.make, range(len(faults))) if m is not None]
    why = {m.kind: m.suspect for m in made if m.line == 1}
    assert why["comparison"] == "differs only where both sides are equal"
    assert why["off by one"] == ""
    assert {m.suspect for m in made if m.line == 2} == {"in a text for people"}
    for path, name, marked in (
        ("a.py", "_events", True),
        ("a_streams.py", "f", True),
        ("a.py", "f", False),
    ):
        inputs = PythonFaults(path, f"def {name}(x):\n    return x[1]\n")
        assert all(inputs.make(k).suspect.startswith("in an input") == marked for k in range(2))
    swapped = PythonFaults("a.py", "y = max(a, b)\nz = f(a, b)\n")
    made = [m for m in map(swapped.make, range(len(swapped))) if m is not None]
    assert [m.suspect for m in made] == ["differs only where an argument is no number", ""]


def test_committed_output_is_left_out_unless_asked_for(checkout):
    source = Path("esea_gen/small/sums.py")
    for independent, names in (
        (True, {"test_sums.py"}),
        (False, {"test_sums.py", "test_traces.py"}),
    ):
        near, more = near_tests(Importers(checkout), source, independent=independent, widen=9)
        assert {p.name for p in near} == names
        assert more == []


def test_the_nearest_tests_by_import_come_first_and_so_many_more(checkout):
    # sums <- twice <- a test; sums <- shared <- two tests, one of which bears the source's name.
    files = {
        "esea_gen/small/twice.py": "def f():\n    from esea_gen.small import sums\n",
        "tests/test_sums.py": "from .shared import clipped\n\ndef test_it(): ...\n",
        "tests/test_other.py": "from tests.shared import clipped\n",
        "tests/test_twice.py": "import esea_gen.small.twice\n# long\n" + "#\n" * 99,
        "tests/test_apart.py": "import esea_gen\n",
        "tests/shared.py": "from esea_gen.small.sums import clipped\n",
        "esea_gen/small/alone.py": "",
        "tests/__init__.py": "",
    }
    (checkout / "tests/test_traces.py").unlink()
    for name, text in files.items():
        (checkout / name).write_text(text)
    graph = Importers(checkout)
    source = Path("esea_gen/small/sums.py")
    (near, none), (_, two) = (near_tests(graph, source, independent=True, widen=n) for n in (0, 2))
    assert [p.name for p in near] == ["test_sums.py", "test_other.py", "test_twice.py"]
    assert none == two == []
    twice = Path("esea_gen/small/twice.py")
    assert [p.name for p in near_tests(graph, twice, independent=True, widen=0)[0]] == [
        "test_twice.py"
    ]
    with pytest.raises(UserError, match=r"No test imports esea_gen\.small\.alone"):
        near_tests(graph, Path("esea_gen/small/alone.py"), independent=True, widen=0)
    # A test of its own stands nearer than those over others; so many are asked at least, and
    # more on demand.
    for name in ("near", "far", "farther"):
        uses = "small.sums" if name == "near" else "small.twice"
        (checkout / f"tests/test_{name}.py").write_text(f"import esea_gen.{uses}\n" + "#\n" * 999)
    near, more = near_tests(Importers(checkout), source, independent=True, widen=1)
    assert [p.name for p in near] == [
        "test_near.py",
        "test_sums.py",
        "test_other.py",
        "test_twice.py",
    ]
    assert [p.name for p in more] == ["test_far.py"]


def test_files_that_a_package_finds_itself_are_imported_by_it(checkout):
    # And a test that bears a file's name is asked, however far it stands.
    files = {
        "esea_gen/laws/__init__.py": "import pkgutil\nALL = pkgutil.iter_modules(__path__)\n",
        "esea_gen/laws/one.py": "",
        "esea_gen/laws/two.py": "import esea_gen.laws.one\n",
        "tests/test_laws.py": "import esea_gen.laws\n",
        "tests/test_one.py": "import esea_gen.laws.two\n",
    }
    for k in range(5):
        files[f"tests/test_{k}.py"] = "import esea_gen.laws.one\n"
    for name, text in files.items():
        (checkout / name).parent.mkdir(exist_ok=True)
        (checkout / name).write_text(text)
    graph = Importers(checkout)
    near, _ = near_tests(graph, Path("esea_gen/laws/one.py"), independent=True, widen=0)
    assert {p.name for p in near} == {"test_one.py", *(f"test_{k}.py" for k in range(5))}
    near, _ = near_tests(graph, Path("esea_gen/laws/two.py"), independent=True, widen=0)
    assert {p.name for p in near} == {"test_one.py", "test_laws.py"}


def test_a_file_that_no_test_imports_is_refused_before_anything_is_tried(checkout):
    (checkout / "esea_gen/small/alone.py").write_text("LIMIT = 4\n")
    said = []
    with pytest.raises(UserError, match=r"No test imports esea_gen\.small\.alone"):
        mutate_python(checkout, ["small"], progress=said.append)
    assert said == []


def test_a_test_that_fails_without_a_fault_proves_nothing(checkout):
    (checkout / "tests/test_sums.py").write_text(
        "from esea_gen.small.sums import ends\n\n"
        "def test_wrong():\n    assert ends(3) == 1\n\n"
        "def test_right():\n    assert ends(3) == 0\n"
    )
    (checkout / "esea_gen/small/sums.py").write_text(
        "def ends(n):\n    if n > 3:\n        n -= 1\n    return 0 * n\n"
    )
    report = mutate_python(checkout, ["small"], limit_s=60, sample=3, seed=1)
    assert report.broken == {"tests/test_sums.py::test_wrong"}
    assert "fails without a fault, set aside: tests/test_sums.py::test_wrong" in report.table()
    assert report.to_dict()["fails_without_fault"] == sorted(report.broken)
    assert {f.noticed_by for f in report.found} <= {"", "tests/test_sums.py::test_right"}


@pytest.mark.parametrize(("independent", "fate"), [(True, "survived"), (False, "killed")])
def test_a_single_test_of_committed_output_is_left_out_too(checkout, independent, fate):
    (checkout / "esea_gen/small/label.py").write_text(
        'def label(x):\n    return f"{100 * x:.1f} %"\n'
    )
    (checkout / "tests/test_label.py").write_text(
        "from esea_gen.small.label import label\n\n"
        "def test_its_unit():\n    assert label(0.25).endswith(' %')\n\n"
        "def test_committed_label():\n    assert label(0.25) == '25.0 %'\n"
    )
    what = ["esea_gen/small/label.py:1"]
    (found,) = mutate_python(checkout, what, limit_s=60, independent=independent).found
    assert found.fate == fate
    assert ("test_committed_label" in found.noticed_by) != independent


def test_a_long_edit_is_shown_where_it_is():
    faults = PythonFaults("a.py", f"y = [{', '.join(f'a{k} + b{k}' for k in range(40))}]\n")
    made = [m for m in map(faults.make, range(len(faults))) if m and m.kind == "operator"]
    for k, mutant in enumerate(made):
        before, after = mutant.edit.split("  ->  ")
        assert (f"a{k} + b{k}" in before, f"a{k} - b{k}" in after) == (True, True)
        assert len(mutant.edit) < 210


def test_the_command(checkout, capsys, monkeypatch):
    monkeypatch.chdir(checkout)
    main(["small", "--sample", "2", "--seed", "2", "--json", "r.json"])
    assert "of 2 faults noticed" in capsys.readouterr().out
    rows = json.loads((checkout / "r.json").read_text())["mutants"]
    assert {r["file"] for r in rows} == {"esea_gen/small/sums.py"}
    assert {r["of"] for r in rows} == {"small"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "no room or file 'nowhere'"),
        (["small:none"], "'small:none': no number of faults"),
        (["small:0"], "'small:0': no number of faults"),
        (["small:1", "--tests", "tests/test_none.py"], "do not pass without a fault"),
    ],
)
def test_the_command_refuses(checkout, monkeypatch, arguments, said):
    monkeypatch.chdir(checkout)
    with pytest.raises(SystemExit, match=re.escape(said)):
        main(arguments)


def test_a_fault_knows_the_function_that_it_is_in():
    source = (
        "import functools\n\nA = 1\n\n\n"
        "@functools.cache\ndef outer(x=2):\n    y = 3\n    y += 4\n\n"
        "    def inner():\n        return 5\n\n    return inner() + y\n\n\nclass C:\n    z = 6\n\n"
        "    def f(self):\n        return 7\n"
    )
    faults = PythonFaults("a.py", source)
    found = {}
    for k in range(len(faults)):
        mutant = faults.make(k)
        if mutant is not None and mutant.kind in ("off by one", "deleted statement"):
            found[mutant.line, mutant.kind] = mutant.function
    # What Python calls the first line of a function is that of its decorator; a default is worked
    # out before it is entered, and what stands in a module or a class when it is imported.
    assert found == {
        **{(3, "off by one"): 0, (7, "off by one"): 0, (8, "off by one"): 6},
        **{(9, "off by one"): 6, (9, "deleted statement"): 6, (12, "off by one"): 11},
        **{(18, "off by one"): 0, (21, "off by one"): 20},
    }


def test_what_each_test_enters_is_kept_and_asked_first(checkout, tmp_path):
    (checkout / "esea_gen/small/sums.py").write_text(
        "def one():\n    return 1\n\n\ndef two():\n    return 2\n\n\ndef four():\n    return 4\n"
    )
    (checkout / "tests/test_sums.py").write_text(
        "import time\n\nimport pytest\nfrom esea_gen.small.sums import four, one, two\n\n\n"
        "@pytest.fixture(scope='module')\ndef shared():\n    return four()\n\n\n"
        "def test_slow():\n    time.sleep(0.2)\n    assert one() == 1\n\n\n"
        "def test_first(shared):\n    assert one() == 1\n\n\n"
        "def test_second(shared):\n    assert (two(), shared) == (2, 4)\n"
    )
    kept = tmp_path / "kept"
    what = ["esea_gen/small/sums.py"]
    assert mutate_python(checkout, what, entered=kept, sample=1).score == 1
    entered = Entered(checkout, kept)
    told = entered.of("tests/test_sums.py")
    places = {name.partition("::")[2]: t["entered"] for name, t in told.items()}
    assert places == {
        "test_slow": ["small/sums.py:1"],
        # A fixture counts for all that share it, whoever asks first.
        "test_first": ["small/sums.py:1", "small/sums.py:9"],
        "test_second": ["small/sums.py:5", "small/sums.py:9"],
    }
    assert told["tests/test_sums.py::test_slow"]["time_s"] > 0.2
    # What enters little else first, within the time; for what stands outside functions, all.
    source, tests = "esea_gen/small/sums.py", ["tests/test_sums.py"]
    first, slow = (f"tests/test_sums.py::test_{n}" for n in ("first", "slow"))
    assert entered.quick(tests, source, 1, 100)[0] == [slow, first]
    assert entered.quick(tests, source, 1, 0.1)[0] == [first]
    assert entered.quick(tests, source, 7, 100) == ([], 0.0)
    assert set(entered.quick(tests, source, 0, 100)[0]) == set(told)
    # Asked first, they notice what no other test file is asked for any more.
    (checkout / "tests/test_a.py").write_text("import esea_gen.small.sums\n\ndef test_a(): ...\n")
    (again,) = mutate_python(checkout, what, entered=kept, sample=1).found
    assert again.noticed_by in set(told)
    # With another text the record is no longer used.
    (checkout / "tests/test_sums.py").write_text("import esea_gen.small.sums\n")
    assert Entered(checkout, kept).of("tests/test_sums.py") == {}
