"""The three first pages, followed literally in an empty folder: every command, every picture."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from tests.conftest import ROOT, require_tool

DOCS = ROOT / "docs"
# What each page promises: words printed, and files written, with the picture that shows them.
PAGES = {
    "first-firmware": (["verdict: PASS", "same bits as the host's"], "out/loop.png"),
    "first-controller": (["mine.toml, plant real", "proportional.py:LAW", "cascade"], "mine.png"),
    "first-study": (["20 SIMULATED participants: 280 trials completed", "12 of 12"], "hold.html"),
}


def commands(page: str) -> str:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 900
    return "".join(re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


@pytest.mark.ci
@pytest.mark.parametrize("page", PAGES)
def test_a_first_page_followed_literally(page, tmp_path):
    for tool in ("bash", "gcc", *["qemu-system-arm"] * (page == "first-firmware")):
        require_tool(tool)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    env = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
        "COLUMNS": "120",
    }
    words, result = PAGES[page]
    done = subprocess.run(
        ["bash", "-euxo", "pipefail", "-c", commands(page)],
        cwd=tmp_path, env=env, capture_output=True, text=True, check=False, timeout=1800,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert [w for w in words if w not in done.stdout] == []
    if result.endswith(".png"):
        shown, made = (imread(p) for p in (DOCS / f"{page}.png", tmp_path / result))
        assert shown.shape == made.shape
        assert np.abs(shown - made).mean() < 0.02  # the page's picture is the command's
    else:
        assert "SIMULATED: no person took part." in (tmp_path / result).read_text()
        assert (tmp_path / "shared" / "rows.csv").read_text().count("\n") == 281


def test_the_entries_are_on_the_readme_and_on_the_start_page():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    start = (DOCS / "index.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) < 120
    blocks = re.compile(r"^```\w+\n.*?^```", re.DOTALL | re.MULTILINE)
    for page in PAGES:
        assert f"(docs/{page}.md)" in readme
        assert f"({page}.md)" in start
    assert blocks.findall(readme) == blocks.findall(start)  # the same commands, the same program
    assert [n for n in re.findall(r"\]\(((?!http)[^)#]+)", readme) if not (ROOT / n).exists()] == []
