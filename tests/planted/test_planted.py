"""Faults in Python sources: they are what they say, and their fate is told truly."""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

from .__main__ import main
from .campaign import mutate_python
from .edits import PythonFaults
from .entered import entering
from .near import Importers, near_tests

pytestmark = pytest.mark.ci

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
'''

TEST = """\
import pytest
from esea_gen.small.sums import clipped, label


def test_clipped():
    assert clipped(1.0) == 3.0
    assert clipped(2.9) == 1.5


def test_limit():
    with pytest.raises(ValueError):
        clipped(4.0)


def test_committed_label():
    assert label(0.25) == "25.0 %"


def test_wrong():
    assert clipped(1.0) == 4.0
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # Of each process that runs tests half the time is that of plugins, which none of these need.
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    files = {
        "esea_gen/__init__.py": "",
        "esea_gen/small/__init__.py": "",
        "esea_gen/small/sums.py": SOURCE,
        "esea_gen/small/alone.py": "LIMIT = 4\n",
        "tests/__init__.py": "",
        "tests/test_sums.py": TEST,
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
    ("source", "kinds"),
    [
        ("y = a + b", ["dropped term", "dropped term", "operator"]),
        ("y = a is b", ["comparison"]),
        ("y = x[3]", ["off by one", "sign"]),
        ("y = 2.0", ["constant", "sign"]),
        ("y = not x", ["not"]),
        ("y = f(a, b)", ["swapped argument"]),
        ("n += 1", ["deleted statement", "off by one", "operator", "sign"]),
        ("if a:\n    f()", ["deleted statement", "not"]),
        # What no run can tell, and by rule what gives no wrong result: looks, lengths, 1 % of an
        # order of magnitude.
        ('"""A text of 3 + 4."""', []),
        ("def f(x: Array[3] = None) -> Size[4]: ...", []),
        ("raise ValueError(f'{a + b}')", []),
        ("y = np.maximum(a, b)", []),
        ("y = zip(a, strict=True)", []),
        ("y = f(a, strict=True)", ["constant"]),
        ("axes.plot(a, lw=0.8, alpha=0.5)", ["deleted statement"]),
        ("y = 1e-9", ["sign"]),
        ("assert a < 1", []),
    ],
)
def test_each_kind_of_fault_and_what_is_left_alone(source, kinds):
    assert sorted(k for _, k, _ in every(source)) == sorted(kinds)


def test_faults_are_single_and_leave_the_source_as_it_was():
    faults = PythonFaults("a.py", SOURCE)
    whole = ast.unparse(ast.parse(SOURCE)).splitlines()
    for k in range(len(faults)):
        changed = faults.make(k).text.splitlines()
        assert sum(a != b for a, b in zip(changed, whole, strict=True)) == 1
    assert ast.unparse(faults.tree) == ast.unparse(ast.parse(SOURCE))


def test_the_command_says_who_noticed_and_what_nobody_did(checkout, capsys, monkeypatch):
    monkeypatch.chdir(checkout)
    before = {p: p.read_bytes() for p in checkout.rglob("*.py")}
    what = "esea_gen/small/sums.py:4"
    main([what, "--seed", "5", "--json", "r.json"])
    assert "of 4 faults noticed" in capsys.readouterr().out
    told = json.loads((checkout / "r.json").read_text())
    # What fails without a fault proves nothing; nor does what compares with committed output.
    assert told["fails_without_fault"] == ["tests/test_sums.py::test_wrong"]
    # Of a text that no independent test reads nothing is noticed; of the sum everything is.
    for f in told["faults"]:
        assert (f["mutant"]["line"] == 16) == (f["noticed_by"] == ""), f
        assert f["noticed_by"].rpartition("::")[2] in ("", "test_clipped", "test_limit")
    assert 0 < told["score"] <= 1
    again = mutate_python(checkout, [what], seed=5, jobs=2)
    assert again.score == told["score"]
    assert {p: p.read_bytes() for p in checkout.rglob("*.py")} == before


def test_tests_that_enter_the_function_are_asked_first(checkout, monkeypatch):
    """Recorded once; a record of a test file that has changed since is left out."""
    (checkout / "tests/planted").mkdir()
    for name in ("__init__.py", "entered.py"):
        shutil.copy(Path(__file__).with_name(name), checkout / "tests/planted")
    # Nearer by import than what calls the function, and longer to look at.
    far = "from esea_gen.small.twice import f\n\ndef test_far():\n    assert f() == 3.0\n"
    (checkout / "tests/test_far.py").write_text(far)
    call = "from esea_gen.small.sums import clipped\n\ndef f():\n    return clipped(1.0)\n"
    (checkout / "esea_gen/small/twice.py").write_text(call)
    monkeypatch.setenv("PYTHONPATH", str(checkout))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.planted.entered"]
    subprocess.run(command, cwd=checkout, capture_output=True, check=False)
    known = entering(checkout)
    label = "esea_gen/small/sums.py:label"
    assert set(known[label]) == {"tests/test_sums.py::test_committed_label"}
    assert "tests/test_far.py::test_far" in known["esea_gen/small/sums.py:clipped"]
    for f in mutate_python(checkout, ["esea_gen/small/sums.py"], sample=6, seed=5).found:
        assert f.mutant.function in ("", "clipped", "label")
        if f.mutant.function == "clipped" and f.fate == "killed":
            assert f.noticed_by in known["esea_gen/small/sums.py:clipped"]
    (checkout / "tests/test_sums.py").write_text(TEST + "\n")
    assert label not in entering(checkout)


def test_what_is_emitted_is_compared_where_it_follows_from_a_source():
    graph = Importers(ROOT)
    assert graph.emits(Path("esea_gen/model/sensing.py"))
    assert not graph.emits(Path("esea_gen/twin/people.py"))


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


def test_the_nearest_tests_by_import_come_first_and_so_many_more(checkout):
    # sums <- twice <- a test; sums <- shared <- a test; a test that bears the source's name.
    files = {
        "esea_gen/small/twice.py": "def f():\n    from esea_gen.small import sums\n",
        "tests/test_other.py": "from tests.shared import clipped\n",
        "tests/test_twice.py": "import esea_gen.small.twice\n" + "#\n" * 99,
        "tests/test_apart.py": "import esea_gen\n",
        "tests/test_traces.py": "import esea_gen.small.sums\n",  # of committed output
        "tests/shared.py": "from esea_gen.small.sums import clipped\n",
    }
    for name, text in files.items():
        (checkout / name).write_text(text)
    graph, source = Importers(checkout), Path("esea_gen/small/sums.py")
    near = near_tests(graph, source, independent=True)
    assert near == [f"tests/test_{n}.py" for n in ("sums", "other", "twice")]
    every_test = near_tests(graph, source, independent=False, widen=9)
    assert set(every_test) - set(near) == {"tests/test_traces.py"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "no room or file 'nowhere'"),
        (["small:none"], "'small:none': no number of faults"),
        (["esea_gen/small/alone.py"], "No test imports esea_gen.small.alone"),
        (["esea_gen/small/sums.py:1", "--tests", "tests/test_none.py"], "do not pass without"),
    ],
)
def test_what_cannot_be_asked_is_refused(checkout, monkeypatch, arguments, said):
    monkeypatch.chdir(checkout)
    with pytest.raises(SystemExit, match=re.escape(said)):
        main(arguments)
