"""The page "From a board to the display in ten commands", executed as it is written."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from esea_host.wrist.stored import load_calibration

from .conftest import ROOT, require_tool, until

PAGE = ROOT / "docs" / "wrist-display.md"
COMMANDS = re.findall(r"```sh\n\s*(.*?)\n\s*```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
PORT = re.search(r"--tcp (\d+)", PAGE.read_text(encoding="utf-8"))[1]
WAIT_S = 300


def test_the_page_has_ten_commands_and_few_words():
    assert len(COMMANDS) == 10
    assert len(PAGE.read_text(encoding="utf-8").split()) < 900


@pytest.mark.ci
def test_the_ten_commands_do_what_the_page_says(tmp_path):
    for tool in ("gcc", "arm-none-eabi-gcc"):
        require_tool(tool)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    how = {"cwd": tmp_path, "env": os.environ | {"QT_QPA_PLATFORM": "offscreen", "PATH": path}}
    board = None
    try:
        for command in COMMANDS:
            words = command.replace(PORT, port).split()
            if words[-1] == "&":
                board = subprocess.Popen(words[:-1], stdout=subprocess.PIPE, text=True, **how)
                assert port in until(board.stdout.readline)
                continue
            if words[:2] == ["esea-host", "wrist"] and "--headless" not in words:
                words += ["--seconds", "3"]  # a window that nobody closes
            done = subprocess.run(
                words, capture_output=True, text=True, timeout=WAIT_S, check=False, **how
            )
            assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    finally:
        if board is not None:
            board.terminate()
            board.communicate()
    out = tmp_path / "out"
    assert load_calibration(out / "wrist-display.toml").constrained is not None
    for name in ("wrist-board.mcap", "wrist-display.mcap", "wrist-display.png"):
        assert (out / name).stat().st_size > 10_000, name
