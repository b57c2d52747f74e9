"""Hostile files, bytes and texts: refused with a message, in bounded time and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT

TARGETS = ["mcap", "tables", "toml", "mavlink", "strings"]


def campaign(target: str, *words: str) -> dict:
    command = [sys.executable, "-m", "tests.fuzz.hostile", target, *words]
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'host'}"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=env)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("target", TARGETS)
def test_hostile_input_is_refused_or_harmless(target):
    found = campaign(target, "--inputs", "12", "--seconds", "300")
    assert found["faults"] == []
    assert found["inputs"] == 12


@pytest.mark.ci
@pytest.mark.parametrize("target", TARGETS)
def test_more_hostile_input(target):
    """ESEA_FUZZ_S is for longer, ESEA_FUZZ_SEED for other inputs."""
    words = "--seed", os.environ.get("ESEA_FUZZ_SEED", "36"), "--seconds"
    found = campaign(target, *words, os.environ.get("ESEA_FUZZ_S", "12"))
    assert found["faults"] == []
    assert found["inputs"] > 0


@pytest.mark.ci
@pytest.mark.parametrize("target", TARGETS)
def test_the_fuzzer_is_armed(target):
    assert campaign(target, "--inputs", "20", "--seconds", "300", "--plant")["faults"]
