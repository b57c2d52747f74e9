"""Hostile files, bytes and texts: refused with a message, in bounded time and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT

TARGETS = ["mcap", "tables", "toml", "mavlink", "strings"]


def campaigns(*words: str) -> list[dict]:
    command = [sys.executable, "-m", "tests.fuzz.hostile", *words]
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'host'}"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=env)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.ci
@pytest.mark.parametrize("target", TARGETS)
def test_hostile_input_is_refused_or_harmless(target):
    """ESEA_FUZZ_S is for longer, ESEA_FUZZ_SEED for other inputs."""
    words = "--seed", os.environ.get("ESEA_FUZZ_SEED", "36"), "--seconds"
    (found,) = campaigns(target, *words, os.environ.get("ESEA_FUZZ_S", "5"))
    assert found["faults"] == []
    assert found["inputs"] > 0


@pytest.mark.ci
@pytest.mark.parametrize("target", TARGETS)
def test_the_fuzzer_is_armed(target):
    (found,) = campaigns(target, "--inputs", "20", "--seconds", "300", "--plant")
    assert found["faults"]
