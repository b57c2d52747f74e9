"""Help and completion answer at once, with every name."""

from __future__ import annotations

import errno
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import click
import pytest
import typer
from typer.testing import CliRunner

import esea_gen
import esea_host
from esea_gen import load_device
from esea_gen.analysis.plots import new_figure, save
from esea_gen.cli import names
from esea_gen.cli.app import app
from esea_gen.cli.groups import registered
from esea_gen.device import controllers
from esea_gen.devices.file import shipped_controllers, shipped_devices
from esea_gen.errors import UserError
from esea_gen.studies.registry import Reproduction, Study, studies
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.published import PEOPLE
from tests import typed

# None of these may be loaded to show a list of commands, or to complete a name.
SLOW = ("casadi", "sympy", "scipy", "numpy", "matplotlib", "rich")


def test_the_text_of_the_sources_says_what_is_registered():
    """A study that is written in another way would be missing from help and completion."""
    written = names.written_studies()
    assert {k: (s.title, s.help) for k, s in studies(Study).items()} == {
        k: (w.title, w.help) for k, w in written.items()
    }
    assert sorted(names.closed_loop_studies()) == sorted(studies(ClosedLoopStudy))
    assert {w.name: w.recordings for w in names.reproductions()} == {
        k: s.recordings for k, s in studies(Reproduction).items()
    }


def test_names_of_devices_and_controllers():
    assert names.shipped() == sorted(shipped_devices())
    assert set(names.configured()) == set(controllers())
    assert set(names.configured()) >= set(shipped_controllers())
    assert set(names.PEOPLE) == {"none", "random", *PEOPLE}


def test_blocks_are_those_of_the_device(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    want = sorted({b.name for b in load_device("elbow_drive").system.kinds})
    assert names.block_names("elbow_drive") == want
    assert names.block_names("elbow_drive") == want  # from the cache
    assert names.block_names("no such device") == []


def loaded_by(code: str) -> list[str]:
    check = f"import sys; print([m for m in {SLOW} if m in sys.modules], file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{check}"], capture_output=True, text=True, check=True
    )
    return eval(done.stderr.splitlines()[-1])


HELP = """
from esea_gen.cli.app import app
import esea_gen.cli
try:
    app({args})
except SystemExit:
    pass
"""


@pytest.mark.parametrize(
    "args", [["--help"], ["simulate", "--help"], ["tune", "--help"], ["reproduce", "--help"]]
)
def test_help_loads_no_engine(args):
    assert loaded_by(HELP.format(args=args)) == []


@pytest.mark.parametrize("program", [esea_gen, esea_host])
def test_every_command_has_a_home_and_every_file_of_commands_is_in_it(program):
    package = f"{program.__name__}.cli"
    command = typer.main.get_command(import_module(f"{package}.app").app)
    for path in Path(program.__file__).parent.glob("cli/[a-z]*.py"):
        import_module(f"{package}.{path.stem}")
    known = registered(package)
    written = {c.name or c.callback.__name__ for c in known.registered_commands}
    written |= {g.name for g in known.registered_groups}
    assert written == set(command.commands)
    assert all(command.commands[n].name == n for n in written)


def test_quiet_and_verbose(tmp_path):
    target = tmp_path / "mine.toml"
    assert CliRunner().invoke(app, ["-q", "new", "mine", "--out", str(target)]).output == ""
    assert target.is_file()
    for flags, traced in (([], False), (["-v"], True)):
        code, _, said = typed.command(*flags, "build", "nothing")
        assert code == 2
        assert ("Traceback" in said) == traced


def test_a_full_disk_is_one_paragraph(monkeypatch, tmp_path):
    """Scratch files, kept files, pictures: what was there stays, nothing half is left."""

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("esea_gen.devices.schema.json_schema", full)
    code, _, said = typed.command("schema")
    assert code == 2
    assert "No space left on device" in said
    assert "TMPDIR" in said
    (tmp_path / "old.png").write_text("old")
    monkeypatch.setattr("os.replace", full)
    with pytest.raises(UserError, match="No space left"):
        save(new_figure(2, 2)[0], tmp_path / "old.png")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["old"]


def completed(line: str) -> list[str]:
    code = "import sys; sys.argv = ['esea-gen']; from esea_gen.cli import main; main()"
    words = line.split(" ")
    env = {
        "_ESEA_GEN_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "PYTHONPATH": ":".join(sys.path),
        "PATH": "/usr/bin:/bin",
    }
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=env
    )
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("esea-gen simulate back", ["backdriven"]),
        ("esea-gen simulate bread --plant ra", ["random"]),
        ("esea-gen verify elbow_drive --block lim", ["limits"]),
    ],
)
def test_a_press_completes(line, found):
    assert completed(line) == found


def test_a_press_loads_no_engine_and_no_checker_of_values():
    """What typer checks values with takes as long to load as all the rest."""
    press = """
import os, sys
os.environ |= {"_ESEA_GEN_COMPLETE": "complete_bash", "COMP_CWORD": "4"}
os.environ["COMP_WORDS"] = "esea-gen simulate tuning --plant r"
sys.argv = ["esea-gen"]
from esea_gen.cli import main
try:
    main()
except SystemExit:
    print([m for m in ("pydantic", "casadi", "numpy") if m in sys.modules], file=sys.stderr)
"""
    done = subprocess.run(
        [sys.executable, "-c", press], capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["real", "random"]
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.mark.parametrize("program", ["esea_gen", "esea_host"])
def test_help_says_of_each_command_what_the_command_says(program):
    """Help takes it from the text of the file, without reading what the command imports."""
    root = typer.main.get_command(import_module(f"{program}.cli.app").app)
    told = "".join(root.get_help(click.Context(root, max_content_width=10_000)).split())
    assert len(root.list_commands(None)) == sum(map(len, root.groups.values())) > 15
    for name in root.list_commands(None):
        words = root.commands[name].get_short_help_str(limit=500)
        assert f"{name}{words}".replace(" ", "") in told, name


def test_help_of_the_host_loads_no_engine():
    code = HELP.format(args=["--help"]).replace("esea_gen", "esea_host")
    assert loaded_by(code) == ["rich"]  # which prints its tables
