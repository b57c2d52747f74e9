"""`make test` draws the same examples at each run, `make search` others."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.ci


def drawn(*options: str, hash_seed: int = 0) -> list[str]:
    """Every example of a file's property tests, as Hypothesis tells them."""
    command = "-s -p no:cacheprovider -p _hypothesis_pytestplugin -m hypothesis"
    command += " --hypothesis-verbosity=verbose"
    run = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            *command.split(),
            *options,
            "tests/model/test_elastomer.py",
        ],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env={
            **os.environ,
            "PYTHONHASHSEED": str(hash_seed),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # Hypothesis' alone is asked
        },
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return re.findall(r"^    \w+=.*$", run.stdout, re.MULTILINE)


def test_the_examples_are_the_same_every_time():
    first = drawn(hash_seed=1)
    assert len(set(first)) > 100
    assert drawn(hash_seed=2) == first
    searched = drawn("--hypothesis-profile=search", "--hypothesis-seed=1")
    assert len(set(searched)) > 100
    assert searched != first


def test_every_random_number_has_a_seed():
    unseeded = r"default_rng\([)]|\bimport random\b|np\.random\.(?!default_rng|Generator)"
    for path in ROOT.glob("tests/**/*.py"):
        assert not re.findall(unseeded, path.read_text()), path.name
