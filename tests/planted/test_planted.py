"""Planted Python faults: they match their description, and results are reported correctly."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest

from .__main__ import main
from .campaign import mutate_python
from .edits import PythonFaults

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
    assert mutate_python(checkout, [what], seed=5, jobs=2).score == told["score"]
    assert {p: p.read_bytes() for p in checkout.rglob("*.py")} == before
