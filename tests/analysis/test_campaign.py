"""Many cases: same numbers for any workers and any interruption, nothing hidden."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from esea_gen.analysis import journal
from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.journal import Configuration, Journal, file_digest
from esea_gen.errors import UserError
from tests.campaign_cases import draw, noted, seeded
from tests.conftest import ROOT, until

PATHS = os.pathsep.join((str(ROOT), str(ROOT / "host")))
CONFIG = Configuration({"controller": "abc", "plant": "def"})


def counted(folder):
    def case(seed):
        (folder / f"{seed}-{time.monotonic_ns()}").touch()
        return {"x": seed % 1000 / 7}

    return case


@pytest.mark.ci
def test_any_number_of_workers_gives_the_same(tmp_path):
    cases = seeded(60, root=1, gain=2.0)
    one = run_cases(draw, cases, configuration=CONFIG)
    two = run_cases(draw, cases, configuration=CONFIG, workers=2, folder=tmp_path)
    assert one.to_dict() == two.to_dict()
    assert [r.case for r in one.results] == cases
    assert run_cases(draw, cases, configuration=CONFIG, folder=tmp_path).to_dict() == one.to_dict()


def started(folder: Path) -> list[str]:
    """Seeds of the cases that were begun, once for each time."""
    return [p.name.split("-")[0] for p in folder.iterdir()]


def deadly_cases(folder, *deadly):
    """Three cases; a deadly one ends its process while its neighbour runs."""
    folder.mkdir()
    shared = {"folder": str(folder), "deadly": list(deadly)}
    return [{"seed": k, "wait_s": 0.0 if k in deadly else 0.4, **shared} for k in range(3)]


def judge_deadly(result, deadly):
    for r in result.results:
        if r.case["seed"] in deadly:
            assert r.values is None
            assert "its worker died" in r.failure
        else:
            assert r.values == {"x": float(np.random.default_rng(r.case["seed"]).normal())}


@pytest.mark.ci
def test_a_case_that_kills_its_worker_is_the_only_one_that_failed(tmp_path):
    seen, cases = [], deadly_cases(tmp_path / "begun", 1)
    result = run_cases(
        noted,
        cases,
        configuration=CONFIG,
        folder=tmp_path,
        workers=2,
        progress=lambda *a: seen.append(a),
    )
    judge_deadly(result, {1})
    assert seen[-1] == (3, 3, 1)
    assert max(Counter(started(tmp_path / "begun")).values()) <= 4
    again = run_cases(noted, cases, configuration=CONFIG, folder=tmp_path)  # would die here
    assert again.to_dict() == result.to_dict()


def test_failures_are_counted_and_told(tmp_path):
    result = run_cases(draw, seeded(60, root=1), configuration=CONFIG, folder=tmp_path)
    normal = {s["seed"]: np.random.default_rng(s["seed"]).normal() for s in seeded(60, root=1)}
    bad = {s for s, v in normal.items() if v > 1.5 or v < -1.8}
    assert {r.case["seed"] for r in result.failures} == bad
    assert bad
    assert {r.failure for r in result.failures} <= {"RuntimeError: tripped at 1.0", "odd is inf"}
    table = result.table()
    assert table[0] == f"60 cases, {len(bad)} failed"
    assert sum("FAILED" in line for line in table) == min(len(bad), 10)
    p = result.summary()["rms"]
    assert (p.count, p.failed) == (60 - len(bad), len(bad))
    good = sorted(abs(v) for s, v in normal.items() if s not in bad)
    assert p.largest == good[-1]
    assert p.values[50.0] == pytest.approx(np.median(good))
    json.dumps(result.to_dict(), allow_nan=False)
    with pytest.raises(UserError, match="Choose from odd, rms"):
        result.values("tau")
    nothing = run_cases(lambda seed: {}, seeded(2), configuration=CONFIG)
    assert [r.failure for r in nothing.failures] == ["gave no numbers"] * 2
    assert nothing.summary() == {}
    text = run_cases(lambda seed: {"a": "x"}, seeded(1), configuration=CONFIG)
    assert "could not convert" in text.failures[0].failure
    # Of a long text the first 400 characters.
    long = run_cases(lambda seed: {"a": "x" * 999}, seeded(1), configuration=CONFIG)
    start = "ValueError: could not convert string to float: 'x"
    assert long.failures[0].failure == start.ljust(400, "x")


def test_a_resumed_run_does_only_what_is_missing(tmp_path):
    done, journal, seen = tmp_path / "done", tmp_path / "journal", []
    done.mkdir()
    cases = seeded(12)
    run_cases(counted(done), cases[:7], configuration=CONFIG, folder=journal)
    result = run_cases(
        counted(done),
        cases,
        configuration=CONFIG,
        folder=journal,
        progress=lambda *a: seen.append(a),
    )
    assert len(list(done.iterdir())) == 12
    assert seen[0] == (7, 12, 0)
    assert seen[-1] == (12, 12, 0)
    assert [r.case for r in result.results] == cases
    other = Configuration({"controller": "abc", "plant": "changed"})
    run_cases(counted(done), cases[:2], configuration=other, folder=journal)
    assert len(list(done.iterdir())) == 14  # another configuration shares nothing
    assert len(list(journal.iterdir())) == 2


@pytest.mark.parametrize("cut", [1, 9, 60])
def test_a_torn_last_line_is_repaired(tmp_path, cut):
    folder = tmp_path / "journal"
    cases = seeded(6)
    whole = run_cases(draw, cases, configuration=CONFIG, folder=folder)
    path = Journal(folder, CONFIG).path
    content = path.read_bytes()
    last = len(content.splitlines(keepends=True)[-1])
    path.write_bytes(content[: len(content) - min(cut, last - 1)])
    seen = []
    again = run_cases(
        draw, cases, configuration=CONFIG, folder=folder, progress=lambda *a: seen.append(a)
    )
    assert seen[0][0] == 5
    assert again.to_dict() == whole.to_dict()
    assert path.read_bytes() == content


def test_damage_elsewhere_is_told_and_not_repaired(tmp_path):
    run_cases(draw, seeded(4), configuration=CONFIG, folder=tmp_path)
    path = Journal(tmp_path, CONFIG).path
    content = path.read_text()
    digit = content.index('"rms":') + 8
    for damaged, words in (
        (content[:digit] + ("1" if content[digit] != "1" else "2") + content[digit + 1 :], "check"),
        (content.replace('"case"', '"cas', 1), "line 2: damaged"),
        (content.replace("abc", "abd", 1), "line 1: not the head"),
    ):
        path.write_text(damaged)
        with pytest.raises(UserError, match=words):
            run_cases(draw, seeded(4), configuration=CONFIG, folder=tmp_path)
        assert path.read_text() == damaged


def test_two_runs_do_not_share_a_journal(tmp_path):
    with Journal(tmp_path, CONFIG).opened(), pytest.raises(UserError, match="another run"):
        run_cases(draw, seeded(1), configuration=CONFIG, folder=tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        run_cases(draw, seeded(1), configuration=CONFIG, folder=tmp_path / "file")


SCRIPT = """
import sys
from tests.campaign_cases import noted
from esea_gen.analysis import journal
from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.cluster import code_digest
from esea_gen.analysis.journal import Configuration
folder, wait_s, jobs, cluster = sys.argv[1:]
cases = [{"seed": k, "folder": folder + "/started", "wait_s": float(wait_s)} for k in range(16)]
if __name__ == "__main__":
    run_cases(noted, cases, configuration=Configuration({"a": 1}), folder=folder + "/journal",
              workers=Workers(int(jobs), cluster or None))
"""


def killed_and_resumed(tmp_path, jobs=1, cluster=None):
    """Kill -9 the process that asked, then go on: only what was running runs twice."""
    folder, script = tmp_path / "started", tmp_path / "script.py"
    folder.mkdir()
    script.write_text(SCRIPT)
    journal = Journal(tmp_path / "journal", Configuration({"a": 1})).path
    command = [sys.executable, str(script), str(tmp_path), "0.15", str(jobs), cluster or ""]
    # The run alone: its workers see that it is gone, and its tracker tidies up behind it.
    run = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": PATHS})
    try:
        until(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 6)
    finally:
        run.kill()
        run.wait()
    kept = journal.read_bytes().count(b"\n") - 1
    assert 5 <= kept < 14
    until(lambda: not alone(journal))
    time.sleep(0.5)  # what runs ends
    begun = len(started(folder))
    assert begun - kept <= 4  # two that run, and two that had ended but were not yet taken
    cases = [{"seed": k, "folder": str(folder), "wait_s": 0.15} for k in range(16)]
    seen = []
    result = run_cases(
        noted,
        cases,
        configuration=Configuration({"a": 1}),
        folder=tmp_path / "journal",
        workers=Workers(1, cluster),
        progress=lambda *a: seen.append(a),
    )
    assert seen == [(n, 16, 0) for n in range(kept, 17)]
    assert len(started(folder)) == begun + 16 - kept
    assert [r.values for r in result.results] == [
        {"x": float(np.random.default_rng(k).normal())} for k in range(16)
    ]


def alone(journal: Path) -> bool:
    """Whether somebody still holds the journal."""
    import fcntl

    with journal.open("ab") as stream, contextlib.suppress(OSError):
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return False
    return True


def test_without_shared_memory_cases_run_one_after_another(tmp_path):
    (tmp_path / "started").mkdir()
    (tmp_path / "script.py").write_text(SCRIPT)
    env = os.environ | {"PYTHONPATH": PATHS, "JOBLIB_MULTIPROCESSING": "0"}
    command = [sys.executable, str(tmp_path / "script.py"), str(tmp_path), "0", "2", ""]
    assert subprocess.run(command, env=env, check=False).returncode == 0
    assert len(started(tmp_path / "started")) == 16


def test_kill_9_loses_only_what_is_running(tmp_path):
    killed_and_resumed(tmp_path, jobs=2)


# -- seeds and keys ---------------------------------------------------------------------


def test_a_studys_code_is_every_source_and_number_file_of_its_rooms(tmp_path, monkeypatch):
    monkeypatch.setattr(journal, "__file__", str(tmp_path / "analysis" / "journal.py"))
    counted = ["twin/plant.py", "twin/data/plants.toml", "analysis/a.py", "studies/one/study.py"]
    other = ["twin/notes.txt", "control/limits/block.py", "twin/__pycache__/plant.cpython-311.pyc"]
    for name in (*counted, *other):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("as it was", encoding="utf-8")
    before = journal.rooms_digest()
    for name in (*counted, *other):
        (tmp_path / name).write_text("changed", encoding="utf-8")
        assert (journal.rooms_digest() != before) is (name in counted), name
        (tmp_path / name).write_text("as it was", encoding="utf-8")
    assert journal.rooms_digest() == before
    (tmp_path / counted[0]).rename(tmp_path / "twin/other.py")
    assert journal.rooms_digest() != before


def test_a_key_depends_on_content_only(tmp_path):
    assert Configuration({"a": 1, "b": [2.5]}).key == Configuration({"b": [2.5], "a": 1}).key
    assert len({Configuration(p).key for p in ({"a": 1}, {"a": 2}, {"a": "1"}, {"b": 1})}) == 4
    (tmp_path / "x").write_bytes(b"abc")
    assert file_digest(tmp_path / "x").startswith("ba7816bf")  # FIPS 180-2, example 1
    for wrong in ({"a": np.nan}, {"a": object()}):
        with pytest.raises(UserError, match="JSON"):
            _ = Configuration(wrong).key
    with pytest.raises(UserError, match="occurs twice"):
        run_cases(draw, [{"seed": 1}, {"seed": 1}], configuration=CONFIG)
    for arguments in ({"workers": 0}, {"workers": -2}):
        with pytest.raises(UserError, match="workers"):
            run_cases(draw, seeded(1), configuration=CONFIG, **arguments)
    with pytest.raises(UserError, match="no cases"):
        run_cases(draw, [], configuration=CONFIG)
