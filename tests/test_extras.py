"""The package without its extras: working commands, and messages that name the extra."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from esea_gen.link.transport import LinkError, open_transport
from tests.conftest import ROOT

# Every module of these packages is as good as not installed.
WITHOUT = """
import sys
for name in {names!r}:
    sys.modules[name] = None
sys.argv = {argv!r}
from {program}.cli import main
main()
"""
LINK = ("pymavlink", "serial")
HOST = ("mcap", "pyarrow", "pandas", "statsmodels", "PySide6", "pyqtgraph")
INSTALL = 'Install it with: pip install "esea-gen'
CLUSTER = ("dask", "distributed")


def without(names, *words, cwd: Path, program: str = "esea_gen") -> tuple[int, str]:
    """Exit code and all that a command says in a process of its own."""
    text = WITHOUT.format(names=names, argv=[program.replace("_", "-"), *words], program=program)
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=cwd, capture_output=True, text=True, check=False
    )
    said = " ".join((done.stdout + done.stderr).split())
    assert "Traceback" not in said, said
    return done.returncode, said


@pytest.mark.ci
def test_the_core_builds_c_and_says_that_a_dialect_needs_the_link(tmp_path):
    code, said = without((*LINK, *HOST, *CLUSTER), "build", "elbow", "--out", "c", cwd=tmp_path)
    assert code == 0
    assert 'no MAVLink dialect: it needs pymavlink; pip install "esea-gen[link]"' in said
    for real, kind in (("f64", "manifest.json"), ("f32", "*.[ch]")):
        built, committed = (
            {p.name: p.read_bytes() for p in (folder / real).glob(kind)}
            for folder in (tmp_path / "c", ROOT / "generated" / "elbow")
        )
        assert built == committed != {}
    assert not (tmp_path / "c" / "dialect").exists()


@pytest.mark.parametrize("command", ["report", "emulate", "firmware"])
def test_a_long_command_names_the_link_before_it_starts(tmp_path, command):
    code, said = without(LINK, command, "nothing.toml", cwd=tmp_path)
    assert code == 2
    assert f'esea-gen {command} needs pymavlink, which is not installed. {INSTALL}[link]"' in said


def test_a_serial_port_without_pyserial_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r"pyserial is not installed.*esea-gen\[link\]"):
        open_transport("serial:/dev/null")


@pytest.mark.ci
def test_the_host_tool_names_its_extra(tmp_path):
    assert without(("mcap",), "--help", cwd=tmp_path, program="esea_host")[0] == 0
    code, said = without(("mcap",), "show", "a.mcap", cwd=tmp_path, program="esea_host")
    assert code == 2
    assert f'needs mcap, which is not installed. {INSTALL}[host]"' in said


@pytest.mark.ci
def test_the_browser_view_names_its_extra(tmp_path):
    words = "serve", "tcp:127.0.0.1:1"
    code, said = without(("tornado",), *words, cwd=tmp_path, program="esea_host")
    assert code == 2
    assert f'needs tornado, which is not installed. {INSTALL}[serve]"' in said
