"""The main job, end to end, on the recorded rubber: `make run`."""

from __future__ import annotations

import json

import pytest

from tests.cli.test_cli import run
from tests.conftest import ROOT, require_tool

pytestmark = pytest.mark.slow  # `make run` is the same; CI runs it with the sample

HDRB = ROOT / "tests" / "data" / "hdrb" / "hdrb.toml"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    folder = tmp_path_factory.mktemp("main job")
    for arguments in (
        ["identify", HDRB, "--out", "hdrb", "--json", "identification.json"],
        ["build", "hdrb/hdrb.toml", "--out", "generated"],
        ["report", "hdrb/hdrb.toml", "--recording", HDRB, "--out", "r.html", "--json", "r.json"],
    ):
        done = run(*arguments, cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_rubber_is_identified(finished):
    found = json.loads((finished / "identification.json").read_text())
    assert found["mean_rms"]["held_out_percent"] < 1.6
    errors = {r["model"]: r["held_out"] for r in found["choice"]["compare"][::-1]}
    assert found["mean_rms"]["held_out_percent"] < 0.5 * errors["published"]
    assert found["notes"][:2] == found["choice"]["reasons"][:2]
    text = (finished / "hdrb" / "hdrb.toml").read_text()
    assert 'status = "identified"' in text
    assert f'member = "{found["choice"]["chosen"]}"' in text


def test_the_board_gives_the_hosts_bits_on_the_recorded_stream(finished):
    streams = json.loads((finished / "r.json").read_text())["board"]["streams"]
    assert streams
    for result in streams.values():
        assert result["steps"] > 50_000
        assert result["identical"] is True
        assert result["hash_matches"] is True
        assert result["instructions"]["max"] > 0
        assert result["flash_bytes"] > 0


def test_one_hash_runs_through(finished):
    found = json.loads((finished / "r.json").read_text())
    manifest = json.loads((finished / "generated" / "f32" / "manifest.json").read_text())
    assert manifest["content_hash"] == found["content_hash"]
    assert found["content_hash"] in (finished / "r.html").read_text()


def test_the_page_says_what_was_not_identified(finished):
    page = (finished / "r.html").read_text()
    assert "ate terms not identified" in page
    assert "assumed" in page
