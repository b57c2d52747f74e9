"""A mapping proposed from a recording, and all errors of a mapping in one message."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify import load_mapping, load_recordings, parse_mapping
from tests.typed import typed

TIME_S = np.arange(0.0, 10.0, 0.005)
THETA_RAD = 0.15 * np.sin(np.pi * TIME_S)
TAU_NM = 12 * THETA_RAD + 30 * THETA_RAD**3
LEVER_M, SENSITIVITY = 0.05, 0.4  # of a load cell, mV per N


def write(path: Path, head: str, *columns, sep=",", decimal=".", encoding="utf-8") -> Path:
    rows = (sep.join(f"{v:.7f}".replace(".", decimal) for v in r) for r in zip(*columns))  # noqa: B905
    path.write_text("\n".join([*([head] if head else []), *rows, ""]), encoding=encoding)
    return path


def filled(text: str) -> str:
    """A proposal with the numbers that only the rig's owner knows."""
    known = {"scale_Nm_per_N": LEVER_M, "sensitivity_mV_per_N": SENSITIVITY, "period_s": 0.005}
    for key, value in known.items():
        number = f'{key} = {{ value = {value}, status = "assumed", source = "rig" }}'
        text = re.sub(rf"^# {key} = .*$", number, text, flags=re.MULTILINE)
    return text


DEG, FORCE_N = np.degrees(THETA_RAD), TAU_NM / LEVER_M
WINDOWS = {"sep": ";", "decimal": ",", "encoding": "cp1252"}


@pytest.mark.parametrize(
    ("head", "columns", "how", "asked"),
    [
        ("t,theta_rad,tau_Nm", (TIME_S, THETA_RAD, TAU_NM), {}, []),
        ("\ufefft,theta,tau", (TIME_S, THETA_RAD, TAU_NM), {}, []),
        ("", (TIME_S, THETA_RAD, TAU_NM), {}, []),
        ("Zeit [s];Winkel [°];Drehmoment [Nm]", (TIME_S, DEG, TAU_NM), WINDOWS, []),
        ("Rig 7\nBy: A, B\nms,deg,N\ntime_ms,angle_deg,force_N", (1e3 * TIME_S, DEG, FORCE_N), {},
         ["scale_Nm_per_N"]),
        ("time,angle,force\ns,deg,N", (TIME_S, DEG, FORCE_N), {}, ["scale_Nm_per_N"]),
        ("encoder_deg,loadcell_mV", (DEG, -SENSITIVITY * FORCE_N), {},
         ["scale_Nm_per_N", "sensitivity_mV_per_N", "period_s"]),
        ('t,"my ""angle""",tau', (TIME_S, THETA_RAD, TAU_NM + 0.0), {}, []),
    ],
)  # fmt: skip
def test_a_proposal_reads_the_rigs_signals_back(tmp_path, head, columns, how, asked):
    file = write(tmp_path / "7 Rig ü.csv", head, *columns, **how)
    done = typed("identify", file.name, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    mapping = file.with_suffix(".toml")
    assert re.findall(r"to fill in: \w+\.(\w+):", done.stdout) == asked
    if asked:  # nothing is invented: the next command says what is missing
        with pytest.raises(UserError) as error:
            load_mapping(mapping)
        assert all(key in str(error.value) for key in asked)
        mapping.write_text(filled(mapping.read_text("utf-8")), "utf-8")
    (read,) = load_recordings(load_mapping(mapping))
    assert np.abs(read.theta_rad - THETA_RAD).max() < 1e-6
    assert np.abs(read.tau_Nm - TAU_NM).max() < 1e-5
    assert read.time_s == pytest.approx(TIME_S, abs=1e-6)
    again = typed("identify", file.name, cwd=tmp_path)  # a mapping that is there stays
    assert again.returncode == 2
    assert "is there already" in again.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line 1"),
        ("t,theta,tau\n", "fewer than two columns of numbers"),
        ("hello\nworld\n", "fewer than two columns of numbers"),
        ("a,b,c,d\n1,2,3,4\n3,3,3,3\n9,5,6,1\n", "which is deflection and which is torque"),
        ("t,theta,tau\nnan,0,0\n1,1,1\n3,2,2\n", "line 2, column 't' is nan"),
        ("t,theta,tau\n0,NaN,0\n1,1,1\n3,2,2\n", "line 2, column 'theta' is NaN"),
        ("t,theta,tau\n0,1,0\n1,1,1\n3,1,2\n", "'theta', taken for the deflection, is constant"),
        ("t,theta,tau\n0,0,0\n1,1\n3,2,2\n", "line 3 has 2 cells"),
    ],
)
def test_a_file_that_shows_nothing_is_rejected(tmp_path, text, said):
    (tmp_path / "rig.csv").write_text(text)
    done = typed("identify", "rig.csv", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in " ".join(done.stderr.split())
    assert [p.name for p in tmp_path.iterdir()] == ["rig.csv"]


def test_all_errors_of_a_mapping_are_reported_together():
    text = """schema = 1
[device]
name = "Rig"
title = "t"
rate_terms = false
[deflection]
column = "x"
unit = "grad"
[torque]
column = "x"
unit = "mV"
[sampling]
time_unit = "h"
[search]
population = 100
[[recording]]
files = ["a.csv"]
us = "train"
"""
    with pytest.raises(UserError) as caught:
        parse_mapping(text, "rig.toml")
    found = re.findall(r"^- rig\.toml, line (\d+): ", str(caught.value), re.MULTILINE)
    # Name; unit; the torque's two scales; a column twice; sampling twice; population; a key.
    assert found == ["3", "8", "9", "9", "10", "12", "13", "15", "18"]
    assert "rig.toml: 9 problems." in str(caught.value)
