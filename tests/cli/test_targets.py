"""One table of processors and boards: an entry, and a folder for a board that runs the firmware."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace

import pytest

from esea_gen import targets
from esea_gen.errors import UserError
from tests.conftest import ROOT


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


def test_the_set_up_installs_every_compiler_from_its_package():
    setup = (ROOT / ".ci" / "setup").read_text()
    for processor in targets.PROCESSORS.values():
        command, package = processor.toolchain.gcc
        if processor.toolchain.zig:
            continue  # pip's stands in
        assert re.search(rf'need {command} "{package}', setup), processor.name
