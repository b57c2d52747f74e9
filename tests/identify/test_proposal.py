"""A mapping proposed from a recording, and all errors of a mapping in one message."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.errors import UserError
from esea_gen.identify import load_mapping, load_recordings, parse_mapping
from tests.typed import typed

TIME_S = np.arange(0.0, 10.0, 0.005)
THETA_RAD = 0.15 * np.sin(np.pi * TIME_S)
TAU_NM = 12 * THETA_RAD + 30 * THETA_RAD**3
LEVER_M, SENSITIVITY = 0.05, 0.4  # of a load cell, mV per N


def write(path: Path, head: str, *columns, sep=",", decimal=".", encoding="utf-8") -> Path:
    rows = (
        sep.join(f"{v:.7f}".replace(".", decimal) for v in r) for r in zip(*columns, strict=True)
    )
    path.write_text("\n".join([*([head] if head else []), *rows, ""]), encoding=encoding)
    return path


def filled(text: str) -> str:
    """A proposal with what only the rig's owner knows."""
    for table, key, value in (("deflection", "unit", "rad"), ("torque", "unit", "Nm"),
                              ("sampling", "time_unit", "s")):  # fmt: skip
        text = re.sub(rf'(\[{table}\]\n(?:.+\n)*?{key} = )""', rf'\1"{value}"', text)
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
        ("t,theta_rad,tau_Nm", (TIME_S, THETA_RAD, TAU_NM), {}, ["time_unit"]),
        ("\ufefft,theta,tau", (TIME_S, THETA_RAD, TAU_NM), {}, ["unit", "unit", "time_unit"]),
        ("Time (MS),theta_rad,tau [MNm]", (TIME_S, THETA_RAD, TAU_NM), {}, ["unit", "time_unit"]),
        ("[s],[rad],[Nm]\ntime,theta,tau", (TIME_S, THETA_RAD, TAU_NM), {},
         ["unit", "unit", "time_unit"]),
        ("Zeit [s];Winkel [°];Drehmoment [Nm]", (TIME_S, DEG, TAU_NM), WINDOWS, []),
        ("Rig 7\nBy: A, B\nms,deg,N\ntime_ms,angle_deg,force_N", (1e3 * TIME_S, DEG, FORCE_N), {},
         ["scale_Nm_per_N"]),
        ("time,angle,force\ns,deg,N", (TIME_S, DEG, FORCE_N), {}, ["scale_Nm_per_N"]),
        ("encoder_deg,loadcell_mV", (DEG, -SENSITIVITY * FORCE_N), {},
         ["scale_Nm_per_N", "sensitivity_mV_per_N", "period_s"]),
        ('t,"my ""angle""",tau', (TIME_S, THETA_RAD, TAU_NM), {},
         ["unit", "unit", "time_unit"]),
    ],
)  # fmt: skip
def test_a_proposal_reads_the_rigs_signals_back(tmp_path, head, columns, how, asked):
    file = write(tmp_path / "7 Rig[1] ü.csv", head, *columns, **how)
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
    mapping.unlink()
    mapping.symlink_to("nowhere")  # a mapping that is there stays; so does a link
    for more, said in ([], "already exists"), (["--inverse"], "--inverse"):
        again = typed("identify", file.name, *more, cwd=tmp_path)
        assert again.returncode == 2
        assert said in again.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line 1"),
        ("t,theta,tau\n", "fewer than two columns of numbers"),
        ("hello\nworld\n", "fewer than two columns of numbers"),
        ("a,b,c,d\n1,2,3,4\n3,3,3,3\n9,5,6,1\n", "which column of numbers is the deflection"),
        ("0,0,0\n1,1,1\n3,2,2\n", "deflection: '1', '2', '3'"),
        ("t,tau,tau\n0,0,0\n1,1,1\n3,2,2\n", "the column name 'tau' occurs 2 times"),
        ("t,x,tau_Nm,limit_Nm\n0,0,0,5\n1,1,1,5\n", "the torque: 'tau_Nm', 'limit_Nm'"),
        ("t_s,theta,tau\n3,0,0\n1,1,1\n0,2,2\n", "does not rise"),
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


SPELT = [  # what a rig's header says, and what it then records: SI of one unit; three clear ones
    {"t_s": 1, "time [ms]": 1e-3, "t_µs": 1e-6, "Time (MS)": 1e-3, "time": 1e-3, "t_ks": 1e3},
    {"theta_rad": 1, "angle [deg]": np.pi / 180, "phi (mrad)": 1e-3, "theta": 0.02,
     "angle_turns": 2 * np.pi, "winkel [gon]": np.pi / 200, "angle / °": np.pi / 180},
    {"tau [mNm]": 1e-3, "M [kN·m]": 1e3, "torque_N_cm": 1e-2, "tau [MNm]": 1e6, "load_kg": 9.8,
     "torque_lbin": 0.113, "torque_lb_in": 0.113, "torque ft_lbf": 1.36, "loadcell": 9.8,
     "tau [lbf·in]": 0.113, "bridge [mV/V]": 7.0, "moment\tN m": 1},
]  # fmt: skip
HEADS = [st.sampled_from([*spelt][:3] * 6 + [*spelt][3:]) for spelt in SPELT]
WAVE, END = np.sin(np.pi * TIME_S), -np.cos(np.pi * TIME_S)
MOTIONS = [WAVE, END, np.where(TIME_S < 2, 0, WAVE), np.where(TIME_S < 1.5, -1, WAVE)]
OTHERS = [*["n", "theta_dot [rad/s]"] * 4, "torque_limit_Nm", "motor_angle", "angle velocity"]
OFFSETS = [*[(0, 0)] * 4, (0.15, 0), (0, 0.7), (-2, 0.7), (0.15, 2)]


@settings(max_examples=80, derandomize=True, deadline=None, database=None)
@given(st.tuples(*HEADS), *map(st.sampled_from, (OTHERS, MOTIONS, OFFSETS, [0, 0.3], [-1, 1])),
       st.booleans(), st.permutations(range(4)))  # fmt: skip
def test_a_proposal_is_never_silently_wrong(
    tmp_path_factory, heads, other, motion, offsets, middle, sign, units_below, order
):
    theta = 0.15 * (motion + middle)
    tau = 12 * theta + 30 * theta**3
    shown = [TIME_S, theta + offsets[0], sign * tau + offsets[1]]
    shown = [x / spelt[h] for x, spelt, h in zip(shown, SPELT, heads, strict=True)]
    names, columns = ([[*x, y][k] for k in order] for x, y in ((heads, other), (shown, TIME_S % 1)))
    if units_below:
        parts = [[*re.split(r" (?=[\[(])", n), ""] for n in names]
        names = [",".join(p[0] for p in parts) + "\n" + ",".join(p[1] for p in parts)]
    folder = tmp_path_factory.mktemp("rig")
    write(folder / "rig.csv", ",".join(names), *columns)
    done = typed("identify", "rig.csv", cwd=folder)
    assert done.returncode in (0, 2), done.stderr
    if "to fill in" in done.stdout:
        with pytest.raises(UserError):
            load_mapping(folder / "rig.toml")
    elif done.returncode == 0:
        (read,) = load_recordings(load_mapping(folder / "rig.toml"))
        assert np.abs(read.theta_rad - theta).max() < 0.02 * np.ptp(theta)
        assert np.abs(read.tau_Nm - tau).max() < 0.02 * np.ptp(tau)
        assert read.time_s == pytest.approx(TIME_S, abs=1e-3)


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
zero = ""
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
    # Name; unit; the torque's two scales; a column twice; zero; sampling twice; population; a key.
    assert found == ["3", "8", "9", "9", "10", "12", "13", "14", "16", "19"]
    assert "rig.toml: 10 problems." in str(caught.value)
