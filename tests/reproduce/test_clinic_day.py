"""A day in a clinic, simulated: the model of tiring against closed forms, the protocol, the fit."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from esea_gen.reproduce import clinic_day
from tests.typed import typed

FLAT = {0.2: 40.0, 0.5: 40.0, 0.75: 40.0}  # % of full scale, whatever the frequency


def test_the_share_is_that_of_the_equation():
    """Against an ODE solver; work alone and rest alone in closed form."""
    t = clinic_day.Tiring(0.2, 500.0, 7200.0)

    def slope(_, s, rate):
        return (t.most - s) * rate / t.length_rad - s / t.recovery_s

    for rate in (0.0, 0.35, 2.0):
        done = solve_ivp(slope, (0, 900.0), [0.03], args=(rate,), rtol=1e-10, atol=1e-12)
        assert t.after(0.03, rate, 900.0) == pytest.approx(done.y[0, -1], rel=1e-7)
    assert t.after(0.1, 0.0, 7200.0) == pytest.approx(0.1 / math.e)
    unresting = clinic_day.Tiring(0.2, 500.0, 1e15)
    assert unresting.after(0.0, 0.5, 1000.0) == pytest.approx(0.2 * (1 - math.exp(-1)))


@pytest.mark.parametrize(
    ("intensity", "active_min", "cycles"),
    [("60 %", 18.1, 350), ("80 %", 25.3, 490), ("100 %", 30.6, 580)],
)
def test_a_session_is_the_published_one(intensity, active_min, cycles):
    rows = list(clinic_day.exercises(intensity))
    assert sum(time_s for _, time_s, _ in rows) / 60 == pytest.approx(active_min, abs=0.05)
    assert sum(f * time_s for f, time_s, _ in rows) == pytest.approx(cycles)


def test_the_error_is_the_first_one_s_where_nothing_tires():
    drift, share = clinic_day.sessions(clinic_day.Tiring(1e-12, 500.0, 7200.0), "60 %", FLAT)
    assert clinic_day.errors(drift, 3.72) == pytest.approx(np.full(17, 3.72))
    assert share == pytest.approx(np.zeros(17), abs=1e-11)
    # Where something does, the other part stays: 3-4-5.
    assert clinic_day.errors(np.array([0.0, 4.0]), 3.0) == pytest.approx([3.0, 5.0])


def test_a_day_without_recovery_is_the_path_alone():
    _, share = clinic_day.sessions(clinic_day.Tiring(0.2, 5000.0, 1e15), "80 %", FLAT)
    path = 490 * 4 * clinic_day.AMPLITUDE_rad * np.arange(1, 18)
    assert share == pytest.approx(0.2 * (1 - np.exp(-path / 5000.0)), rel=1e-9)


def test_the_fit_finds_what_a_day_was_made_with(monkeypatch):
    true = clinic_day.Tiring(0.12, 2500.0, 30_000.0)
    made = {}
    for name in ("60 %", "80 %", "100 %"):
        monkeypatch.setattr("esea_gen.reproduce.clinic_day.PUBLISHED", {name: (0.0, 3.5, 0.0)})
        change, morning = clinic_day.figures(true, name, FLAT)
        made[name] = (change, 3.5, morning)
    monkeypatch.setattr("esea_gen.reproduce.clinic_day.PUBLISHED", made)
    found = clinic_day.fitted(FLAT)
    assert found.most == pytest.approx(true.most, rel=0.02)
    assert found.length_rad == pytest.approx(true.length_rad, rel=0.03)
    assert found.recovery_s == pytest.approx(true.recovery_s, rel=0.02)


@pytest.mark.ci
def test_the_command_says_what_was_published_and_that_it_is_simulated(tmp_path):
    outputs = ["--json", "c.json", "--figure", "c.png"]
    done = typed("reproduce", "clinic-day", *outputs, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "simulated" in done.stdout
    rows = json.loads((tmp_path / "c.json").read_text())["intensities"]
    assert [r["change_published_percent"] for r in rows] == [1.39, 2.70, 2.56]
    assert [r["morning_published_percent"] for r in rows] == [3.83, 3.35, 4.89]
    # Three numbers do not make six: what is left is said, and is no more than this.
    assert max(map(abs, [r["change_percent"] - r["change_published_percent"] for r in rows])) < 0.35
    for r in rows:
        stiffness = r["stiffness_Nm_rad"]
        assert len(stiffness) == 17
        assert stiffness[0] > stiffness[15] < stiffness[16]
    assert (tmp_path / "c.png").stat().st_size > 20_000
