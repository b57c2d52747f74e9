"""Logs of studies: a crash, an edit and a forgery lose or hide nothing."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.study.exchange import omissions, to_bids, to_rows
from esea_host.study.folder import StudyFolder
from esea_host.study.log import EventLog, read_log
from esea_host.study.plan import build_plan
from esea_host.study.repair import repair
from esea_host.study.session import read_session
from esea_host.study.source import SimulatedSource
from tests.conducted import changed, run_one, study_of

# -- nothing lost ----------------------------------------------------------------------------------


def killed_at(study: StudyFolder, write: int, share: float) -> None:
    """A session in a process of its own, which dies by SIGKILL within its n-th write to the log."""
    child = os.fork()
    if child == 0:
        count, whole = 0, os.write

        def cut(file, line):
            nonlocal count
            count += Path(f"/proc/self/fd/{file}").readlink().name == "events.jsonl"
            if count == write:
                whole(file, line[: int(share * len(line))])
                os.kill(os.getpid(), signal.SIGKILL)
            return whole(file, line)

        os.write = cut
        try:
            study.session("P01", 0, SimulatedSource(3)).run()
        finally:
            os.kill(os.getpid(), signal.SIGABRT)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status)
    assert os.WTERMSIG(status) == signal.SIGKILL


@pytest.fixture(scope="module")
def uncut(tmp_path_factory, protocol) -> list:
    return list(run_one(study_of(tmp_path_factory.mktemp("uncut") / "s", protocol)).state.past)


@pytest.mark.parametrize("seed", range(6))
def test_kill_loses_the_running_trial_at_most(study, protocol, uncut, seed):
    rng = np.random.default_rng([17, seed])
    plan = build_plan(protocol, 0, 0)
    killed_at(study, int(rng.integers(2, 45)), float(rng.random()))
    path = study.log_of("P01", 0)
    before = read_session(path)
    done = [r["trial"] for r in before.past]
    assert done == list(range(1, len(done) + 1))  # all but the running one are there
    assert [t.number for t in before.remaining] == [t.number for t in plan.trials[len(done) :]]
    assert before.plan == plan
    # Nothing of what was there before has changed, and the rest is what it would have been.
    after = run_one(study).state
    assert (after.remaining, list(after.past)) == ((), uncut)
    assert read_log(path).breaks == ()
    assert path.with_suffix(".torn").exists() == (before.torn > 0)
    assert study.problems() == []


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_session_that_was_killed_in_its_first_event_begins(study, share):
    killed_at(study, 1, share)
    assert (study.log_of("P01", 0).stat().st_size > 0) == (share > 0)
    assert not study.begun("P01", 0)
    for refused in ("resume", "replay"):
        done = CliRunner().invoke(app, ["study", refused, str(study.path), "P01"])
        assert "has not begun session 1" in str(done.exception)
    done = CliRunner().invoke(app, ["study", "run", str(study.path), "P01", "--headless"])
    assert "12 of 12" in done.output
    assert study.problems() == []


def test_every_event_is_on_disk_before_the_next_step(tmp_path, monkeypatch):
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda f: synced.append(os.fstat(f).st_size))
    log = EventLog(tmp_path / "e.jsonl")
    for k in range(3):
        log.append(k, "note", {"text": "x"})
        assert synced[-1] == (tmp_path / "e.jsonl").stat().st_size
    log.close()


def test_another_protocol_does_not_go_on_with_a_session(study):
    killed_at(study, 12, 0.5)
    study.protocol = changed("seed = 7", "seed = 8")
    with pytest.raises(UserError, match="another protocol"):
        study.session("P01", 0, SimulatedSource(3))


# -- audit -----------------------------------------------------------------------------------------


def edited(kind: str, lines: list[str]) -> list[str]:
    if kind == "value":
        k = next(i for i, x in enumerate(lines) if '"held":true' in x)
        return [*lines[:k], lines[k].replace('"held":true', '"held":false'), *lines[k + 1 :]]
    if kind == "gone":
        return lines[:5] + lines[6:]
    if kind == "swapped":
        return [*lines[:5], lines[6], lines[5], *lines[7:]]
    return lines[:-4]  # a whole tail: the chain alone would not show it


@pytest.mark.parametrize("how", ["value", "gone", "swapped", "tail"])
def test_an_edit_is_named(study, how):
    run_one(study)
    assert study.problems() == []
    path = study.log_of("P01", 0)
    path.write_text("".join(edited(how, path.read_text().splitlines(keepends=True))))
    (first, *_) = study.problems()
    assert first.startswith("P01/session-1/events.jsonl: ")
    assert {"value": "content was edited", "tail": "since it ended"}.get(how, "line 6") in first
    wrong = "changed since it ended" if how == "tail" else "has been changed"
    for use in (study.rows, lambda c: study.session(c, 0, SimulatedSource(1))):
        with pytest.raises(UserError, match=wrong):
            use("P01")
    assert any(wrong in words for words in omissions(study))
    assert len(repair(study)) == 1
    assert study.problems() == []
    study.rows("P01")


def test_a_log_in_another_place_is_nobodys(study):
    run_one(study)
    study.enrol("P02", True)
    for place, words in (("P02", "another session"), ("Anna", "no participant with the code Anna")):
        shutil.copytree(study.path / "P01", study.path / place)
        assert any(words in p for p in study.problems())
        assert any(f"{place}, session 1, whole: " in p for p in omissions(study))
        with pytest.raises(UserError, match=words):
            study.rows(place)
    with pytest.raises(UserError, match="not a participant code"):
        study.enrol("P03\n", True)


def forged(path: Path, kind: str, **data) -> None:
    """Another log with a chain that holds: the last event of a kind has this data."""
    entries = list(read_log(path).entries)
    k = max(i for i, e in enumerate(entries) if e.kind == kind)
    path.unlink()
    log = EventLog(path)
    for i, e in enumerate(entries):
        log.append(e.time_s, e.kind, data if i == k else e.data)
    log.close()


@pytest.mark.parametrize(
    ("forgery", "data"),
    [
        ("trial_end", {}),
        ("trial_end", {"trial": 1, "state": "completed", "reason": "", "row": {"trial": 1}}),
        ("session", {"participant": "P01", "plan": {}}),
        ("trial", {"trial": []}),
    ],
)
def test_a_forged_log_is_named_and_the_others_are_read(tmp_path, study, forgery, data):
    run_one(study)
    study.enrol("P02", True)
    other = study.session("P02", 0, SimulatedSource(3))
    other.run()
    other.close()
    forged(study.log_of("P01", 0), forgery, **data)
    first, *_ = study.problems()
    assert first.startswith("P01/session-1/events.jsonl: an event lacks")
    for out, write in (("rows", to_rows), ("bids", to_bids)):
        with pytest.warns(UserWarning, match=r"P01/session-1.* left out"):
            assert write(StudyFolder.open(study.path), tmp_path / out) == 12
    forged(study.path / "audit.jsonl", "enrol", participant=1)
    assert any("enrol has no participant" in p for p in study.problems())
    with pytest.raises(UserError, match=r"audit\.jsonl: line 7: enrol has no participant"):
        study.participants()


def test_a_log_that_vanished_is_named_unless_deleted_on_demand(study):
    run_one(study)
    path = study.log_of("P01", 0)
    held = path.read_bytes()
    path.unlink()
    assert study.problems() == ["P01, session 1: its log is missing"]
    with pytest.raises(UserError, match="is missing, and the session was begun"):
        run_one(study)  # it would not count once it has ended
    path.write_bytes(held)
    assert study.delete("P01", "asked for it") == 1
    assert study.problems() == []
    assert not (study.path / "P01").exists()
    with pytest.raises(UserError, match="not in this study"):
        study.session("P01", 0, SimulatedSource(1))
    study.enrol("P02", True)
    assert study.participants()["P02"] == 1  # its place in the random order stays taken
    session = study.session("P02", 0, SimulatedSource(1))
    session.close()
    session.log.path.unlink()
    assert repair(study) == ["P02/session-1/events.jsonl: it is lost; the session starts again"]
    assert study.problems() == []
    study.session("P02", 0, SimulatedSource(1)).close()
