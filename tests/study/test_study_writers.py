"""Studies that many processes write, that are killed, edited, full or repaired."""

from __future__ import annotations

import errno
import json
import os
import re
import resource
import signal
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen import files
from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.study.exchange import to_rows
from esea_host.study.folder import StudyFolder
from esea_host.study.log import EventLog, read_log
from esea_host.study.repair import repair
from esea_host.study.report import study_page
from esea_host.study.session import read_session
from esea_host.study.source import SimulatedSource
from tests.conducted import run_one


def forked(work) -> int:
    """Another process that does it; it ends with 0, or 1 where that raised."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    return child


def ended(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


# -- many at once ----------------------------------------------------------------------------------


def any_command(rng: np.random.Generator, folder: Path, out: Path) -> list[str]:
    code, trial = f"P{rng.integers(1, 4):02d}", str(rng.integers(1, 13))
    return [
        ["run", str(folder), code, "--headless"],
        ["resume", str(folder), code, "--headless"],
        ["skip", str(folder), code, trial, "--reason", "no time"],
        ["repeat", str(folder), code, trial, "--reason", "a cough"],
        ["enrol", str(folder), code, "--consent"],
        ["export", str(folder), str(out)],
        ["event", str(folder), "deviation", "late"],
    ][rng.integers(7)]


def at_random(folder: Path, seed: int, runs: int) -> None:
    rng = np.random.default_rng([41, seed])
    for k in range(runs):
        words = any_command(rng, folder, folder.parent / f"out-{seed}-{k}")
        done = CliRunner().invoke(app, ["study", *words])
        if not isinstance(done.exception, UserError | SystemExit | None):
            (folder.parent / f"fault-{seed}-{k}").write_text(f"{words}: {done.exception!r}")


@pytest.mark.parametrize(
    "runs", [3, pytest.param(20, marks=pytest.mark.ci)], ids=lambda n: f"{10 * n} runs"
)
def test_ten_processes_corrupt_nothing(tmp_path, study, runs):
    """Of them two die by SIGKILL, wherever they are."""
    children = [forked(lambda seed=seed: at_random(study.path, seed, runs)) for seed in range(10)]
    for child in children[:2]:
        time.sleep(float(np.random.default_rng(runs).uniform(0.2, 1.0)))
        os.kill(child, signal.SIGKILL)
    assert {ended(c) for c in children[:2]} <= {0, -signal.SIGKILL}
    assert {ended(c) for c in children[2:]} == {0}
    assert [p.read_text() for p in tmp_path.glob("fault-*")] == []
    study = StudyFolder.open(study.path)
    assert study.problems() == []
    codes = [d["participant"] for k, d in study.audited() if k == "enrol"]
    assert len(codes) == len(set(codes))
    for _, _, path in study.sessions():
        assert len([e for e in read_log(path).entries if e.kind == "session"]) == 1
    assert to_rows(study, tmp_path / "out") == sum(len(study.rows(c)) for c in codes)


def test_a_second_writer_is_refused_and_told_who_holds_it(study):
    session = study.session("P01", 0, SimulatedSource(1))
    for refused in (
        lambda: study.session("P01", 0, SimulatedSource(1)),
        lambda: study.session("P01", 0, None),
        lambda: study.delete("P01", "asked"),
    ):
        with pytest.raises(UserError, match=rf"in use by .* \(process {os.getpid()} on "):
            refused()
    assert "delete" not in [k for k, _ in study.audited()]
    study.enrol("P02", True)  # of others nobody waits
    session.close()
    study.session("P01", 0, None).close()


def test_a_dead_holders_lock_is_taken_over_on_record(study):
    def die() -> None:
        session = study.session("P01", 0, SimulatedSource(1))
        os.kill(os.getpid(), signal.SIGKILL)
        session.close()  # never

    child = forked(die)
    assert ended(child) == -signal.SIGKILL
    path = study.log_of("P01", 0)
    assert run_one(study).state.remaining == ()
    (told,) = [e.data for e in read_log(path).entries if e.kind == "takeover"]
    assert told["pid"] == child
    assert {"host", "person", "since"} < set(told)
    assert path.with_suffix(".lock").read_text() == ""


def test_a_holder_on_another_computer_counts_as_alive_until_repair(study):
    run_one(study)
    lock = study.log_of("P01", 0).with_suffix(".lock")
    lock.write_text(json.dumps({"host": "elsewhere", "pid": 1, "person": "Anna", "since": "then"}))
    with pytest.raises(UserError, match=r"Anna \(process 1 on elsewhere.*study repair"):
        study.session("P01", 0, None)
    assert repair(study) == []
    study.session("P01", 0, None).close()


# -- disks and clocks ------------------------------------------------------------------------------


def test_a_full_disk_leaves_no_half_line(study):
    path = study.log_of("P01", 0)

    def fill() -> None:
        session = study.session("P01", 0, SimulatedSource(1))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 3000, -1))
        try:
            session.run()
        except OSError as error:
            os._exit(error.errno)

    assert ended(forked(fill)) == errno.EFBIG
    assert path.read_bytes().endswith(b"\n")
    assert run_one(study).state.remaining == ()
    assert study.problems() == []


def test_a_clock_that_goes_back_is_recorded(study, monkeypatch):
    monkeypatch.setattr("esea_host.study.log.utc_now", lambda: "2020-01-01T00:00:00.000Z")
    study.record("deviation", text="the clock was set")
    *_, before, last = study.trail()
    assert last.utc.startswith("2020")
    assert before.utc > last.utc
    assert "s behind the event before" in last.clock
    assert study.problems() == []


def test_a_read_only_study_is_read_and_not_half_written(study, monkeypatch):
    run_one(study)
    whole = os.open

    def refused(path, flags, *more, **given):
        if flags & (os.O_WRONLY | os.O_RDWR) and str(path).startswith(str(study.path)):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return whole(path, flags, *more, **given)

    before = (study.path / "audit.jsonl").read_bytes()
    monkeypatch.setattr(os, "open", refused)
    for write in (lambda: study.enrol("P02", True), lambda: study.session("P01", 0, None)):
        with pytest.raises(PermissionError):
            write()
    assert (study.path / "audit.jsonl").read_bytes() == before
    assert len(study.rows("P01")) == 12


# -- breaks and their repair -----------------------------------------------------------------------


@pytest.mark.parametrize("how", ["more", "less", "other", "replaced", "gone"])
def test_what_another_program_changed_is_not_written_on(tmp_path, how):
    path = tmp_path / "e.jsonl"
    with EventLog(path) as log:
        log.append(None, "note", {"text": "x"})
        log.append(None, "note", {"text": "y"})
        held = path.read_bytes()
        if how in ("replaced", "gone"):
            path.unlink()
        if how != "gone":
            new = {"more": held + b"x", "less": held[:-3], "other": held.replace(b'"y"', b'"z"')}
            path.write_bytes(new.get(how, held))
        now = path.read_bytes() if path.exists() else None
        with pytest.raises(UserError, match="another program has changed it"):
            log.append(None, "note", {"text": "z"})
        assert (path.read_bytes() if path.exists() else None) == now


def test_a_broken_session_is_named_left_out_repaired_and_gone_on_with(tmp_path, study):
    run_one(study)
    study.enrol("P02", True)
    session = study.session("P02", 0, SimulatedSource(2))
    session.run()
    session.close()
    path = study.log_of("P01", 0)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:20], *lines[21:]]))
    held = path.read_bytes()
    with pytest.warns(UserWarning, match="P01/session-1.* left out"):
        assert to_rows(study, tmp_path / "out") == 12
    (said,) = repair(study)
    assert said.startswith("P01/session-1/events.jsonl: what was behind the break (line 21: ")
    aside = path.with_suffix(".aside-1.jsonl")
    assert held == b"".join(lines[:20]) + aside.read_bytes()
    assert path.read_bytes().startswith(b"".join(lines[:20]))
    assert study.problems() == []
    kinds = [k for k, d in study.audited() if k == "repair" and d["aside"] == aside.name]
    assert kinds == ["repair"]
    assert [e.data["kept"] for e in read_log(path).entries if e.kind == "repair"] == [20]
    assert read_session(path).remaining != ()
    assert run_one(study).state.remaining == ()
    assert study.problems() == []
    assert repair(study) == []
    with closing(study.session("P01", 0, None)):
        assert "not repaired: " in repair(study)[0]


def test_entries_behind_a_break_of_the_audit_trail_are_entered_again(study):
    """As two writers without a lock left it: both have gone on from the same entry."""
    path = study.path / "audit.jsonl"
    one = path.read_bytes()
    study.enrol("P02", True)
    first = path.read_bytes()[len(one) :]
    path.write_bytes(one)
    study.enrol("P03", True)
    path.write_bytes(path.read_bytes() + first)
    study = StudyFolder.open(study.path)
    with pytest.raises(UserError, match="study repair"):
        study.participants()
    (said,) = repair(study)
    assert said.endswith("2 of its entries are back")
    assert list(study.participants()) == ["P01", "P03", "P02"]
    assert study.problems() == []
    assert [e.data["restored"]["n"] for e in study.trail() if "restored" in e.data] == [3, 4]


@pytest.mark.parametrize("damage", [(b"(?s).*", b""), (b".*\n", b""), (b":true", b":false")])
def test_a_trail_without_its_beginning_is_not_repaired(study, damage):
    """By whomever: what it says, that nobody real takes part, must not be lost."""
    path = study.path / "audit.jsonl"
    path.write_bytes(now := re.sub(*damage, path.read_bytes(), count=1))
    study = StudyFolder.open(study.path, by="Weber")
    assert study.problems()[0].startswith("audit.jsonl: ")
    for act in (repair, lambda s: s.enrol("P09", True, form="1"), study_page):
        with pytest.raises(UserError, match="Restore the file from a copy"):
            act(study)
    assert path.read_bytes() == now


# -- real and simulated ----------------------------------------------------------------------------


class Real(SimulatedSource):
    """Passes for a board with somebody in it."""

    simulated = False


@pytest.fixture
def real(tmp_path, protocol) -> StudyFolder:
    study = StudyFolder.create(tmp_path / "r", protocol, False, durable=False, by="Third")
    study.allocate(tmp_path / "list.csv", 4)
    study.by = "Anna"
    study.enrol("P01", True, form="v2")
    study.disclose("P01", str(tmp_path / "list.csv"))
    return study


def test_every_row_is_marked_and_a_real_study_takes_no_simulated_device(study, real):
    assert {r["simulated"] for r in run_one(study).state.past} == {True}
    with pytest.raises(UserError, match="is a real study, and this device is simulated"):
        real.session("P01", 0, SimulatedSource(1))
    with pytest.raises(UserError, match="is a simulated study, and this device is real"):
        study.session("P01", 0, Real(1))
    assert not real.log_of("P01", 0).exists()
    session = real.session("P01", 0, Real(1))
    session.run()
    session.close()
    assert {r["simulated"] for r in real.rows("P01")} == {False}
    entries = read_log(real.log_of("P01", 0)).entries
    assert {e.by for e in entries} == {"Anna"}
    assert all(e.utc.endswith("Z") and e.clock for e in entries)
    assert {"program", "content", "device"} == set(entries[0].data["about"])


def test_a_rehearsal_uses_nothing_up(real):
    trail = len(real.trail())
    log = real.new_rehearsal(0)
    with pytest.raises(UserError, match="'Anna Weber' is not a participant code"):
        real.session("Anna Weber", 0, SimulatedSource(1), rehearsal=log)
    session = real.session("P01", 0, SimulatedSource(1), rehearsal=log)
    assert session.run() == ""
    real.finish(session)
    session.close()
    assert session.state.rehearsal
    assert all(r["rehearsal"] and r["simulated"] for r in session.state.past)
    assert [e.kind for e in real.trail()[trail:]] == ["rehearsal"]
    assert (list(real.sessions()), list(real.participants())) == ([], ["P01"])
    assert (other := real.new_rehearsal(0)) != log
    assert real.delete("P01", "asked for it") == 1  # what was rehearsed with that person too
    assert (log.exists(), other.parents[1].exists()) == (False, True)


def test_a_session_goes_on_with_its_device(study, protocol, monkeypatch):
    class Board(SimulatedSource):
        content_hash = "a1"

        def ready(self):
            return {"device": "knee", "content_hash": self.content_hash}

    asked = iter([""] * 30 + ["the participant asked"])
    session = study.session("P01", 0, Board(1))
    session.run(stop=lambda: next(asked))
    monkeypatch.setattr(Board, "content_hash", "b2")
    assert "content hash a1; this board, knee, has b2" in session.run()
    session.close()
    monkeypatch.setattr(study, "simulated", False)
    monkeypatch.setattr(study, "by", "Anna")
    with pytest.raises(UserError, match="begun on a simulated device; this one is real"):
        study.session("P01", 0, Real(1))


def test_resume_reuses_device_and_seed(study):
    def call(*words: str) -> str:
        done = CliRunner().invoke(app, ["study", words[0], str(study.path), "P01", *words[1:]])
        return done.output + str(done.exception)

    call("run", "--headless", "--seed", "5")
    before = study.rows("P01")
    call("repeat", "3", "--reason", "a cough")
    assert "begun with --device simulated, not virtual" in call("resume", "--device", "virtual")
    assert "12 of 12" in call("resume", "--headless")
    assert sorted(study.rows("P01"), key=lambda r: r["trial"]) == list(before)


def test_who_does_it_is_asked_for_in_a_real_study(tmp_path, real, protocol):
    for by in ("", "  "):
        nobody = StudyFolder.open(real.path, by=by)
        with pytest.raises(UserError, match="--operator NAME"):
            nobody.enrol("P02", True, form="v2")
    with pytest.raises(UserError, match="--form"):
        real.enrol("P02", True)
    with pytest.raises(UserError, match="future"):
        real.enrol("P02", True, form="v2", date="2999-01-01")
    with pytest.raises(UserError, match="not a date"):
        real.enrol("P02", True, form="v2", date="26.11.2026")
    with pytest.raises(UserError, match="operator's name"):
        StudyFolder.open(real.path, by="A\nB")
    (consent,) = [e for e in real.trail() if e.kind == "consent"]
    assert (consent.by, consent.data["by"], consent.data["form"]) == ("Anna", "Anna", "v2")
    for kind, given in (("adverse", {"severity": "bad"}), ("deviation", {"text": " "})):
        with pytest.raises(UserError, match="Not recorded"):
            real.record(kind, **given)


def test_withdrawal_ends_the_use_of_data(tmp_path, study):
    run_one(study)
    study.withdraw("P01")
    assert study.log_of("P01", 0).exists()
    assert (study.rows("P01"), to_rows(study, tmp_path / "out")) == ((), 0)
    with pytest.raises(UserError, match="has withdrawn"):
        study.session("P01", 1, SimulatedSource(1))
    with pytest.raises(UserError, match="has withdrawn"):
        study.withdraw("P01")
    assert study.problems() == []


def test_a_file_system_without_locks_is_refused(tmp_path, monkeypatch):
    def none(_) -> bool:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(files, "try_lock", none)
    with pytest.raises(UserError, match="has no locks"), files.locked(tmp_path / "x.lock"):
        pass


def test_a_session_that_broke_in_its_first_line_begins_anew(study):
    run_one(study)
    path = study.log_of("P01", 0)
    path.write_bytes(b"x" + path.read_bytes())
    assert len(repair(study)) == 1
    assert not path.exists()
    assert run_one(study).state.remaining == ()
