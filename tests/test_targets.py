"""One table of processors and boards: an entry, and a folder for a board that runs the firmware."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from esea_gen import targets
from esea_gen.cli import app
from esea_gen.errors import UserError

from .conftest import ROOT


def test_every_firmware_folder_has_an_entry_and_is_found():
    folders = {p.name for p in (ROOT / "firmware" / "boards").iterdir()}
    found = targets.firmware_boards()
    assert {b.folder for b in found.values()} == {f"boards/{name}" for name in folders}
    assert {"mps2-an385", "mps2-an500", targets.DEFAULT_BOARD} <= set(found)
    for name in found:
        assert targets.find_board(name) is targets.BOARDS[name]
        assert len(name) <= 15  # what a board may tell of itself


def test_a_board_is_one_entry_and_its_folder(tmp_path, monkeypatch):
    new = replace(targets.BOARDS["netduinoplus2"], name="olimex", title="Olimex, Cortex-M4F")
    monkeypatch.setitem(targets.BOARDS, "olimex", new)
    with pytest.raises(UserError, match="no board 'olimex'"):  # no firmware for it yet
        targets.find_board("olimex")
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware")
    (tmp_path / "firmware" / "boards" / "olimex").mkdir()
    monkeypatch.setattr(targets, "firmware_folder", lambda: tmp_path / "firmware")
    assert targets.find_board("olimex") is new
    with pytest.raises(UserError, match=r"olimex \(Olimex, Cortex-M4F\)"):
        targets.find_board("arduino")


def test_the_help_names_every_board_with_firmware():
    said = CliRunner().invoke(app, ["firmware", "--help"], env={"COLUMNS": "300"}).output
    for name in targets.firmware_boards():
        assert name in said


def test_the_set_up_installs_every_compiler_from_its_package():
    setup = (ROOT / ".ci" / "setup").read_text()
    for processor in targets.PROCESSORS.values():
        command, package = processor.toolchain.gcc
        assert re.search(rf'need {command} "{package}', setup), processor.name


def test_no_flag_of_a_processor_stands_outside_the_table():
    pattern = re.compile(r"-m(cpu|arch|fpu|float-abi|tune|thumb)\b")
    found = [
        str(p.relative_to(ROOT))
        for p in (ROOT / "esea_gen").rglob("*.py")
        if pattern.search(p.read_text(encoding="utf-8"))
    ]
    assert found == ["esea_gen/targets.py"]


def test_a_clock_stands_in_the_table_alone():
    """Build, gate, emulator and image read a board's row; C is told by a macro, and checks it."""
    number = re.compile(r"\b(16|25|168|216|667)(0{6}u?|e6|[. ]?MHz)\b|clock_MHz = \d")
    folders = (ROOT / "esea_gen", ROOT / "firmware", ROOT / "templates" / "bench")
    files = [p for f in folders for p in f.rglob("*") if p.suffix in (".py", ".c", ".h", ".j2")]
    code = {p: re.sub(r"(?s)/\*.*?\*/|#[^\n]*", "", p.read_text(encoding="utf-8")) for p in files}
    found = {p.name for p, text in code.items() if number.search(text)}
    assert found == {"targets.py", "drivers.c"}  # there in what the board says where it stays slow
    for board in targets.firmware_boards().values():
        if not board.machine:
            assert not board.clock_defines
            continue
        assert f"-DESEA_CLOCK_HZ={board.clock_Hz:.0f}u" in board.clock_defines
        # An instruction takes 1 ns there; TIM2 of that machine counts them, whatever the clock.
        assert board.tick_instructions == (1 if board.reset_Hz else 1e9 / board.clock_Hz)
