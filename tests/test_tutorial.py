"""The tutorial runs, with its documented output."""

from __future__ import annotations

import re
import subprocess
import sys

from tests.conftest import ROOT


def test_tutorial(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "tutorial.py", tmp_path / "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    said = done.stdout
    assert "status ['INPUT_INVALID']" in said
    errors = [float(x) for x in re.findall(r"model: (\S+) % of full scale", said)]
    assert len(errors) == 2
    assert errors[0] < 1e-9 < errors[1] < 1e-2
    # Only below the folder that it was given.
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    out = tmp_path / "out"
    assert sorted(p.name for p in (out / "elbow").iterdir()) == ["f32", "f64"]
    assert (out / "hdrb.toml").is_file()
    held_out = re.search(r"mean .*held out\s+([\d.]+) %", said)
    assert held_out
    assert 0 < float(held_out.group(1)) < 10
