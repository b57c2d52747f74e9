"""The registry of studies, and a study added as the documentation says: one file."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.studies import simulation as room
from esea_gen.studies.registry import Study, load_study, studies
from esea_gen.studies.simulation import ClosedLoopStudy, default_person, simulate
from esea_gen.twin.case import Setting
from esea_gen.twin.loop_run import RanAwayError
from esea_gen.twin.off import refuse_unknown
from tests.conftest import ROOT
from tests.result_schemas import held

pytestmark = pytest.mark.ci

PAGE = ROOT / "docs" / "add-experiment.md"
LIST = ROOT / "docs" / "experiment-list.md"
PACKAGE = Path(esea_gen.__file__).parent


def sources() -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in PACKAGE.rglob("*") if p.suffix in (".py", ".toml", ".j2")}


def command(arguments: list[str], folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "esea_gen.cli", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_page_adds_a_study_with_one_file(tmp_path):
    before = sources()
    page = PAGE.read_text(encoding="utf-8")
    files = re.findall(r'```python title="([^"]+)"\n(.*?)```', page, re.S)
    for name, text in files:
        (tmp_path / name).write_text(text, encoding="utf-8")
    (line,) = re.findall(r"```sh\n(.*?)\n```", page, re.S)
    program, *arguments = shlex.split(line)
    assert program == "esea-gen"
    assert arguments[arguments.index("--jobs") + 1] == "2"
    with command(arguments, tmp_path) as running:
        said, error = running.communicate(timeout=600)
    assert running.returncode == 0, error
    # Touched: what the page says to write, and nothing of the package.
    assert len(files) == 1
    assert sources() == before
    content = json.loads((tmp_path / "ramps.json").read_text())
    assert content["title"] == "Ramps to 1 Nm, output fixed"
    assert [(c["name"], c["seed"]) for c in content["cases"]] == [
        (f"in {s} s", k) for k in (0, 1) for s in ("0.2", "0.5", "1")
    ]
    assert content["ended_runs"] == 0
    for c in content["cases"]:
        # Held at 1 Nm: off by the hysteresis of 0.12 Nm at most.
        assert abs(c["end_Nm"] - 1) < 0.12
        assert 0 < c["rms_true_Nm"] < 1
    assert (
        "Ramps to 1 Nm, output fixed: mpc-no-preview, plant real, person none, 2 runs a case"
        in said
    )
    assert (tmp_path / "ramps.png").read_bytes()[:4] == b"\x89PNG"


SPY = '''
import os

import numpy as np

from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Case
from esea_gen.twin.trajectories import fixed_output


class Spy(ClosedLoopStudy):
    """Which process runs it; the last case fails there."""

    name = "spy"
    title = "Spied on"

    def cases(self):
        return [Case(n, fixed_output(n, np.zeros(500), 100)) for n in ("a", "b", "c", "broken")]

    def measure(self, case, run, device):
        if case.name == "broken":
            raise ValueError("no figure of this one")
        return super().measure(case, run, device) | {"process": os.getpid()}
'''


def test_workers_run_it_and_a_failure_is_no_instability(tmp_path):
    (tmp_path / "spy.py").write_text(SPY)
    arguments = [
        "simulate",
        "spy.py:spy",
        "--runs",
        "3",
        "--jobs",
        "2",
        "--json",
        "out.json",
        "--csv",
        "out.csv",
    ]
    with command(arguments, tmp_path) as running:
        said, error = running.communicate(timeout=600)
    assert running.returncode == 1, error
    content = json.loads((tmp_path / "out.json").read_text())
    held("simulate", content)
    good = [c for c in content["cases"] if c["name"] != "broken"]
    lost = [c for c in content["cases"] if c["name"] == "broken"]
    processes = {c["process"] for c in good}
    assert running.pid not in processes
    assert os.getpid() not in processes
    assert len(good) == 9
    assert not any("failure" in c for c in good)
    assert [c["failure"] for c in lost] == ["ValueError: no figure of this one"] * 3
    assert not any(c["unstable"] or c["tripped"] or c["fault"] for c in content["cases"])
    assert all(c["rms_true_Nm"] is None for c in lost)
    assert content["ended_runs"] == 3
    assert "UNSTABLE" not in said
    assert "3 failed" in said
    assert "failed: ValueError: no figure of this one" in said
    assert "3 of 12 runs were unstable, tripped, latched or failed" in said


def test_a_plant_that_runs_away_is_unstable(monkeypatch):
    def leave(*_):
        raise RanAwayError("the plant left its ranges before 1 s")

    monkeypatch.setattr(room, "run_case", leave)
    done = simulate("tuning", Setting("smc"))
    (entry,) = done.cases()
    assert entry["unstable"] is True
    assert entry["rms_true_Nm"] is None
    assert "failure" not in entry
    assert "1 UNSTABLE, 1 left the plant's ranges" in "\n".join(done.table())
    assert done.figure() is not None
    json.dumps(done.to_dict(), allow_nan=False)
    head = {"schema": "simulate", "schema_version": 1, "tool_version": "0.1.0"}
    held("simulate", head | done.to_dict())


def test_a_journal_gives_figures_and_a_second_look_gives_signals(tmp_path, monkeypatch):
    first = simulate("step", Setting("smc", "ideal"), folder=tmp_path)
    again = simulate("step", Setting("smc", "ideal"), folder=tmp_path)
    assert again.to_dict() == first.to_dict()
    assert list(again.kept) == ["0.5 Nm", "1 Nm", "2 Nm"]


def test_every_study_has_what_help_shows():
    every = studies(Study)
    assert {"tuning", "grid", "chapter4", "all"} <= set(every)
    for name, study in every.items():
        assert study.name == name
        assert study.title
        assert study.help
    for name in studies(ClosedLoopStudy):
        assert load_study(name, ClosedLoopStudy).cases(), name
    # The page's table, too.
    rows = re.findall(r"^\| `([\w-]+)` \| [^|]+\| (none|moves)", LIST.read_text(), re.M)
    moved = {k: "moves" if s.person else "none" for k, s in studies(ClosedLoopStudy).items()}
    assert dict(rows) == moved


def test_a_wrong_name_gets_the_nearest_one(tmp_path):
    with pytest.raises(UserError, match=r"Unknown study 'grd'\. Did you mean grid\?"):
        load_study("grd", ClosedLoopStudy)
    with pytest.raises(UserError, match="Unknown study 'chapter3'"):
        default_person("chapter3", "real")
    (tmp_path / "spy.py").write_text(SPY)
    with pytest.raises(UserError, match=r"'spi'\. Did you mean spy\? Choose from spy\."):
        load_study(f"{tmp_path}/spy.py:spi", ClosedLoopStudy)
    with pytest.raises(UserError, match=r"'1 Nm 6 Hz'\. Did you mean"):
        load_study("grid", ClosedLoopStudy).case("1 Nm 6 Hz")
    missed = CliRunner().invoke(app, ["reproduce", "chapter5"])
    assert missed.exit_code == 2
    assert "Did you mean" in missed.output


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "cannot be read"),
        ("x = (", "cannot be imported (SyntaxError"),
        ("import nothing_of_this_name", "cannot be imported (ModuleNotFoundError"),
        ("from esea_gen.studies.tracking import Grid", "no study of this kind in it"),
        (SPY + "\n\nclass Other(Spy):\n    pass\n", "there is a study spy already"),
    ],
)
def test_a_file_that_holds_no_study_is_explained(tmp_path, text, said):
    path = tmp_path / "mine.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UserError) as error:
        load_study(f"{path}:spy", ClosedLoopStudy)
    assert said in str(error.value)


def test_an_edited_file_is_read_again(tmp_path):
    path = tmp_path / "spy.py"
    path.write_text(SPY)
    assert load_study(f"{path}:spy", ClosedLoopStudy).title == "Spied on"
    path.write_text(SPY.replace("Spied on", "Edited"))
    assert load_study(f"{path}:spy", ClosedLoopStudy).title == "Edited"


def test_a_study_without_its_method_is_told(tmp_path):
    path = tmp_path / "bare.py"
    head = "from esea_gen.studies.simulation import ClosedLoopStudy\n"
    path.write_text(f'{head}class Bare(ClosedLoopStudy):\n    """Bare."""\n    name = "bare"\n')
    with pytest.raises(UserError, match=r"study bare: has no method cases\. Add it"):
        load_study(f"{path}:bare", ClosedLoopStudy).cases()
    path.write_text(path.read_text() + "    def cases(self):\n        return iter(())\n")
    with pytest.raises(UserError, match="There are no cases"):
        simulate(f"{path}:bare", Setting("smc", "ideal"))


def test_what_a_plant_or_device_has_not_is_refused():
    for study, setting, said in (
        ("twists", Setting("smc", "ideal"), "no cable_loss: its cable is rigid"),
        ("tuning", Setting("smc", axis="flexion"), r"one axis\. Leave --axis out"),
    ):
        with pytest.raises(UserError, match=said):
            simulate(study, setting)
    with pytest.raises(UserError, match="Did you mean fc_Nm"):
        refuse_unknown("case a", ["fc_Nn"], ["fc_Nm"])
