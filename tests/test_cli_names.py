"""Help and completion answer at once, and name what there is."""

from __future__ import annotations

import subprocess
import sys
from operator import attrgetter

import pytest

import esea_gen
from esea_gen import load_device
from esea_gen.cli import names
from esea_gen.devices.file import shipped_controllers, shipped_devices
from esea_gen.studies.registry import Study, studies
from esea_gen.studies.reproduction import Reproduction
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.controllers import controllers
from esea_gen.twin.people import PEOPLE

# None of these may be loaded to show a list of commands, or to complete a name.
SLOW = ("casadi", "sympy", "scipy", "numpy", "matplotlib")


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


def test_what_is_slow_is_seen():
    """Armed: the package's face does load it, when it is asked for."""
    assert "casadi" in loaded_by("from esea_gen import load_device")
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        attrgetter("nothing")(esea_gen)


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
        ("esea-gen simulate bread --controller sliding", ["sliding_mode"]),
        ("esea-gen build knee_", ["knee_printed"]),
        ("esea-gen simulate bread --plant ra", ["random"]),
        ("esea-gen verify elbow_drive --block lim", ["limits"]),
    ],
)
def test_a_press_completes(line, found):
    assert completed(line) == found
