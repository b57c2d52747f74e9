"""Received folders run no code until it is trusted."""

from __future__ import annotations

import importlib.util
import os
import py_compile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.trust import read_code, trust
from esea_host.cli import app
from tests.conftest import ROOT

EXAMPLE = ROOT / "examples" / "steady_hold.toml"


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A protocol and its task, which tells when it runs, of nobody's list."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    folder = tmp_path / "received"
    folder.mkdir()
    own = EXAMPLE.with_suffix(".py").read_text()
    (folder / "task.py").write_text(f"{own}\nopen({str(tmp_path / 'RAN')!r}, 'w').close()\n")
    (folder / "p.toml").write_text(EXAMPLE.read_text().replace("steady_hold.py", "task.py"))
    return folder


def ran(place: Path) -> bool:
    return (place.parent / "RAN").exists()


def call(*words: object) -> tuple[int, str]:
    """Exit code, and what was said."""
    done = CliRunner().invoke(app, ["study", *map(str, words)])
    return done.exit_code, done.output + str(done.exception)


def hash_of(place: Path) -> str:
    return read_code(place / "task.py").sha256


@pytest.fixture
def study(place) -> Path:
    """A study of somebody else, with a session of P01."""
    made = place / "s"
    call("create", place / "p.toml", made, "--simulated", "--trust", hash_of(place))
    call("enrol", made, "P01", "--consent")
    assert "12 of 12" in call("run", made, "P01", "--headless")[1]
    (place.parent / "config" / "esea-host" / "trusted-code").unlink()
    (place.parent / "RAN").unlink()
    task = made / "tasks" / "task.py"  # run afresh, were it run
    task.write_text(task.read_text() + "# changed\n")
    return made


def test_a_protocols_code_runs_once_it_is_trusted_by_its_hash(place):
    code, said = call("check", place / "p.toml")
    assert (code, ran(place)) == (1, False)
    assert "was not run" in said
    assert f"--trust {hash_of(place)}" in said
    assert call("check", place / "p.toml", "--trust", "f" * 64)[0] == 1
    assert "is not a SHA-256" in call("check", place / "p.toml", "--trust", hash_of(place)[:12])[1]
    assert not ran(place)
    assert call("check", place / "p.toml", "--trust", hash_of(place))[0] == 0
    assert ran(place)
    assert call("check", place / "p.toml")[0] == 0  # remembered
    with (place / "task.py").open("a") as file:
        file.write("# another\n")
    assert "Untrusted code" in call("check", place / "p.toml")[1]


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("run {} P01 --session 2 --headless", 1),
        ("resume {} P01 --session 2", 1),
        ("replay {} P01", 1),
        ("skip {} P01 1 --reason x", 1),
        ("repeat {} P01 1 --reason x", 1),
        ("export {} {}-bids --as bids", 1),
        ("export {} {}-rows", 0),
        ("enrol {} P02 --consent", 0),
        ("delete {} P01 --reason x", 0),
    ],
)
def test_no_command_runs_what_nobody_trusted(place, study, words, code):
    found, said = call(*words.format(study, study).split())
    assert (found, ran(place)) == (code, False)
    assert ("Untrusted code" in said) == bool(code)


def test_an_audit_runs_nothing_and_covers_protocol_and_tasks(place, study):
    code, said = call("audit", study)
    assert (code, ran(place)) == (1, False)
    assert f"tasks/task.py: SHA-256 {read_code(study / 'tasks' / 'task.py').sha256}" in said
    assert "tasks/task.py: changed since the study was created" in said
    (study / "tasks" / "task.py").unlink()
    (study / "tasks" / "more.py").write_text("")
    with (study / "protocol.toml").open("a") as file:
        file.write("\n")
    said = call("audit", study)[1]
    for text in ("protocol.toml: changed", "tasks/task.py: removed", "tasks/more.py: added"):
        assert text in said


def test_a_session_of_a_changed_study_warns(study):
    again = "run", study, "P01", "--headless", "--trust", read_code(study / "tasks/task.py").sha256
    code, said = call(*again)
    assert code == 1
    assert f"Continue: esea-host study run {study} P01 --session 2" in said
    with pytest.warns(UserWarning, match=r"tasks/task\.py: changed since"):
        assert call(*again, "--session", "2")[0] == 0


@pytest.mark.parametrize("named", ["{}/task.py", "../task.py", "link.py", "up/task.py", "loop.py"])
def test_a_protocol_names_files_of_its_own_folder_only(place, named):
    inner = place / "inner"
    inner.mkdir()
    trust([hash_of(place)])
    for name, target in (("link.py", place / "task.py"), ("up", place), ("loop.py", "loop.py")):
        (inner / name).symlink_to(target)
    text = (place / "p.toml").read_text().replace("task.py", named.format(place))
    (inner / "p.toml").write_text(text)
    code, said = call("check", inner / "p.toml")
    assert (code, ran(place)) == (1, False)
    assert "p.toml, line 5: " in said
    assert "leads out of" in said


def test_a_study_with_a_link_that_leaves_it_is_not_opened(place, study):
    (study / "P02").symlink_to(place.parent)
    assert "'P02' leads out of" in call("audit", study)[1]


def test_byte_code_beside_a_trusted_file_is_not_run(place):
    task = place / "task.py"
    held, at = task.read_text(), task.stat()
    task.write_text("raise SystemExit".ljust(len(held)))
    os.utime(task, (at.st_atime, at.st_mtime))
    py_compile.compile(str(task), importlib.util.cache_from_source(str(task)))
    task.write_text(held)
    os.utime(task, (at.st_atime, at.st_mtime))
    assert call("check", place / "p.toml", "--trust", hash_of(place))[0] == 0


@pytest.mark.parametrize("controller", ["{},sliding_mode", "{}", None])
def test_a_law_that_a_device_file_names_runs_once_it_is_trusted(place, controller):
    """As it came, or as the device's own; a name on the command line is the user's own choice."""
    file, name = place / "c.toml", "elbow_drive" if controller else str(place / "c.toml")
    head = "" if controller else 'schema = 1\nextends = "elbow_drive"\nname = "c"\ntitle = "c"\n'
    file.write_text(f'{head}laws = ["task.py:LAW"]\n')
    chosen = controller and controller.format(file)
    with pytest.raises(UserError, match=rf"Untrusted code.*esea-gen --trust {hash_of(place)}"):
        _ = load_device(name, chosen).laws
    assert not ran(place)
    trust([hash_of(place)])
    with pytest.raises(UserError, match="no law 'LAW' in it"):
        _ = load_device(name, chosen).laws
    assert ran(place)
