"""Simulated knee patients, the sensor that reads them, pendulum and range tests, the commands."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import subprocess
import sys
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.signal import lfilter
from typer.testing import CliRunner

from esea_gen import files
from esea_gen.errors import UserError
from esea_host.assess import MEASURED_NOTICE, NOTICE
from esea_host.assess import build as build_module
from esea_host.assess import patients as sim
from esea_host.assess.build import PEOPLE, PER_CATEGORY, draw_many
from esea_host.assess.database import KNEE_GRID, ResponseDataBase, answered, shipped
from esea_host.assess.desk import ClinicDesk
from esea_host.assess.evaluation import judge, meet
from esea_host.assess.files import angle_columns, from_recordings, read_recording
from esea_host.assess.passive_tests import motion_range, pendulum_test
from esea_host.assess.probing import Comfort, probing_movement
from esea_host.assess.responses import LegRecording, Location, along, passage
from esea_host.assess.session import Assessment, assessed_hypotheses
from esea_host.assess.simulated import knee_sensor, swept
from esea_host.assess.validation import against_elbow, knee_stiffness, pendulum_table, ramp_torque
from esea_host.cli.app import app
from esea_host.recording.integrity import Gap, GapError
from esea_host.recording.layout import StreamColumn, StreamLayout
from esea_host.recording.writer import Recorder
from esea_host.study.words import words_of
from tests.assess.test_assess import made_up
from tests.browser import browser, readable
from tests.conftest import ROOT

DEG = math.pi / 180


# -- patients ---------------------------------------------------------------------------------


def test_leg_of_a_mean_body_by_hand():
    """Winter: 70 kg, 1.7 m; shank and foot 4.27 kg, 0.418 m long."""
    assert sim.leg_weight_Nm(1.7, 70) == pytest.approx(4.27 * 9.81 * 0.606 * 0.4182, rel=1e-3)
    assert sim.leg_inertia_kgm2(1.7, 70) == pytest.approx(4.27 * (0.735 * 0.4182) ** 2, rel=1e-3)


def test_passive_torque_as_published():
    """Riener and Edrich's three exponentials at 30 deg, ankle -15, hip 60, by hand."""
    by_hand = math.exp(1.8 - 0.69 - 1.056 + 1.302) - math.exp(-3.971 + 0.006 + 1.485 - 0.768)
    by_hand += -4.82 + math.exp(2.22 - 4.5)
    assert float(sim.passive_torque_Nm(30 * DEG)) == pytest.approx(by_hand)


def test_reflex_grows_with_speed_beyond_its_thresholds_and_tone_does_not():
    knees = sim.Knees([sim.nominal("S3"), sim.nominal("D3")])
    at = np.full(2, 100 * DEG)
    reflex = [knees.reflex_Nm(at, np.full(2, v * DEG))[0] for v in (20, 60, 90, 120)]
    assert reflex[0][0] == pytest.approx(0, abs=1e-3)  # below 47 deg/s
    assert reflex[1][0] < reflex[2][0] < reflex[3][0]
    assert np.all(knees.reflex_Nm(np.full(2, 40 * DEG), np.full(2, 1.0))[0] == 0)  # below 55 deg
    assert all(r[1] == 0 for r in reflex)
    relaxed = sim.Knees([sim.nominal("relaxed")])
    tone, away = 3 * 1.6**2, math.tanh((100 - 30) / 25)
    for v in (0, 10, 120, 500):
        rate = np.full(2, v * DEG)
        pull = knees.still_Nm(at, rate)[1] - relaxed.still_Nm(at[:1], rate[:1])[0]
        # Of its two muscles the stretched one has more force, at most 1.4 times, the other less.
        longer, shorter = min(1.4, 1 + 0.12 * v * DEG), max(0.0, 1 - 0.12 * v * DEG)
        exact = -tone * (0.5 * (1 + away) * longer - 0.5 * (1 - away) * shorter)
        assert pull == pytest.approx(exact)
    assert sim.stretched(np.array([-20.0, 0.0, 20.0])) == pytest.approx([0, 1, 1.4])


def test_reflex_comes_after_its_delay():
    """Held, then stretched at once: nothing of the reflex before the delay."""
    p = dataclasses.replace(sim.nominal("S5"), tone_Nm=0.0)
    silent = dataclasses.replace(p, gain_Nms_rad2=0.0)
    t = np.arange(300) * sim.STEP_S
    path = 60 * DEG + np.maximum(t - 0.1, 0) * 100 * DEG
    rate = np.where(t > 0.1, 100 * DEG, 0.0)
    m = sim.Knees([p, silent]).move(np.stack([path] * 2, 1), np.stack([rate] * 2, 1), [[0], [0]])
    torque = m.torque_Nm[:, 0] - m.torque_Nm[:, 1]
    first = t[np.flatnonzero(np.abs(torque) > 1e-9)[0]]
    over = t[np.flatnonzero(m.rate_rad_s[:, 0] > p.dynamic_threshold_rad_s)[0]]
    assert first >= 0.1 + p.delay_s - 1e-9
    assert over + p.delay_s - 0.02 < first < over + p.delay_s + 0.02
    assert torque.max() > 5


def test_the_knees_reflex_is_the_one_that_is_held_against_the_elbow(monkeypatch):
    """The same stretch through the whole knee, and through the formula fitted to the elbow.

    So a difference from that elbow is one of parameters, and not of units, joint or lags.
    """
    # Hands that do not give way.
    monkeypatch.setattr("esea_host.assess.patients.HANDS_Nm_rad", 10_000.0)
    monkeypatch.setattr("esea_host.assess.patients.HANDS_Nms_rad", 100.0)
    rate, p = 90 * DEG, sim.nominal("S4")
    t = np.arange(600) * sim.STEP_S
    path = 20 * DEG + rate * t
    silent = dataclasses.replace(p, gain_Nms_rad2=0.0)
    both = sim.Knees([p, silent]).move(np.stack([path] * 2, 1), np.full((600, 2), rate), [[0], [0]])
    torque = both.torque_Nm[:, 0] - both.torque_Nm[:, 1]
    stiffness = knee_stiffness(rate)[4]
    assert stiffness == pytest.approx(45 * (90 - 41) * DEG)
    threshold = p.threshold_rad[0] - p.threshold_rate_s * rate
    exact = ramp_torque(path, rate, threshold, stiffness, p.reflex_max_Nm[0])
    assert torque[-1] > 10
    assert np.abs(torque - exact)[path < 110 * DEG].max() < 0.02 * exact[-1]


def test_free_leg_without_passive_torque_is_a_pendulum():
    """Period 2 pi sqrt(J / W) about hanging, small swings."""
    knees = sim.Knees([sim.KneePatient("", passive_scale=0.0, damping_Nms_rad=0.0)])
    m = knees.release(85 * DEG, 4.0, [[0]])
    x = m.angle_rad[:, 0] - 90 * DEG
    crossings = m.time_s[np.flatnonzero(np.diff(np.sign(x)))]
    period = 2 * float(np.mean(np.diff(crossings)))
    exact = 2 * math.pi * math.sqrt(knees.inertia[0] / knees.weight[0])
    assert period == pytest.approx(exact, rel=2e-3)


def test_hands_never_pull_more_than_10_kgf():
    p = dataclasses.replace(sim.nominal("D5"), tone_Nm=60.0)
    path, rate = (x[:4000] for x in sim.sweep())
    m = sim.Knees([p]).move(path[:, None], rate[:, None], [[0]])
    assert np.abs(m.torque_Nm).max() == pytest.approx(10 * 9.81 * 0.246 * 1.7)


@pytest.mark.ci
def test_pendulum_behaviour_as_published():
    """Relaxed legs 1.6 or more (Bajd and Vodovnik), less and less with spasticity."""
    found = pendulum_table()
    rows = {r["category"]: r for r in found}
    assert 1.6 <= rows["relaxed"]["relaxation_index"] <= 2.0
    index = [rows[c]["relaxation_index"] for c in ("relaxed", *sim.CATEGORIES[:5])]
    swing = [rows[c]["first_swing_deg"] for c in ("relaxed", *sim.CATEGORIES[:5])]
    assert index == sorted(index, reverse=True)
    assert swing == sorted(swing, reverse=True)
    assert index[-1] < 1.0
    # Fewer swings, and what swings there are die out no more slowly than a relaxed leg's.
    swings = [rows[c]["swings"] for c in ("relaxed", *sim.CATEGORIES[:5])]
    assert swings[:5] == sorted(swings[:5], reverse=True)
    assert max(swings[4:]) <= 0.5 * swings[0]
    ratios = [r["damping_ratio"] for r in found if r["damping_ratio"] is not None]
    assert min(ratios) == rows["relaxed"]["damping_ratio"]
    # Dystonic-like: tone holds the leg up, so that it falls less far, and takes swings away.
    tense = [rows[c] for c in ("relaxed", *sim.CATEGORIES[5:])]
    for key in ("first_swing_deg", "rest_deg", "swings"):
        assert [x[key] for x in tense] == sorted((x[key] for x in tense), reverse=True), key
    assert [x["relaxation_index"] for x in tense[1:]] == sorted(
        (x["relaxation_index"] for x in tense[1:]), reverse=True
    )
    assert tense[1]["relaxation_index"] < rows["relaxed"]["relaxation_index"] + 0.05


# -- the sensor -------------------------------------------------------------------------------


def test_the_sensors_c_reads_a_torque_back_through_its_dead_zone():
    sensor = knee_sensor()
    t = np.arange(0, 6, 0.002)
    torque = 12 * np.sin(2 * math.pi * 0.3 * t)
    angle = 1 + 0.8 * np.sin(2 * math.pi * 0.3 * t)
    error, sensor.error_Nm = sensor.error_Nm, 0.0
    try:
        exact, seen = sensor.read(t, torque, angle, [1])
    finally:
        sensor.error_Nm = error
    # Away from the dead zone; one count of an encoder is 1.5 mrad, 0.13 Nm of 83 Nm/rad and more.
    apart = np.abs(torque) > 6
    assert np.std((exact - torque)[apart]) < 0.25
    assert np.std(np.diff(exact)) > 0  # quantised, not copied
    assert np.abs(seen - angle).max() < 0.004
    many = np.array([sensor.read(t, torque, angle, [k])[0] for k in range(12)])
    assert np.sqrt(np.mean((many - torque) ** 2)) == pytest.approx(1.83, rel=0.35)
    assert np.array_equal(sensor.read(t, torque, angle, [4])[0], many[4])


# -- pendulum and range tests -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("zeta", "hertz", "held_s"), [(0.05, 1, 0), (0.15, 0.8, 0.5), (0.3, 1.2, 1)]
)
def test_damped_pendulum_in_closed_form(zeta, hertz, held_s):
    """x = rest - drop e^(-zeta w t) (cos wd t + ...): index 1 + e^(-pi zeta / sqrt(1 - zeta^2)).

    The hands let it sink by 4 deg and lift it again first, which was the first swing: index 0.06.
    """
    w, root = 2 * math.pi * hertz / math.sqrt(1 - zeta**2), math.sqrt(1 - zeta**2)
    t = np.arange(0, 14, 0.005)
    u = np.maximum(t - held_s, 0)
    held = 4 * np.sin(np.pi * t / (held_s or 1)) ** 2 * (t < held_s)
    shape = np.exp(-zeta * w * u) * (np.cos(w * root * u) + zeta / root * np.sin(w * root * u))
    r = pendulum_test(t, (5 + held + 65 * (1 - shape)) * DEG)
    over = math.exp(-math.pi * zeta / root)
    assert r.relaxation_index == pytest.approx(1 + over, abs=0.01)
    assert r.first_swing_rad / DEG == pytest.approx(65 * (1 + over), abs=0.3)
    assert r.damping_ratio == pytest.approx(zeta, rel=0.05)
    assert r.frequency_Hz == pytest.approx(hertz, rel=0.02)
    assert r.reached_rest
    # Fastest fall: at wd t = atan(root / zeta).
    at = math.atan2(root, zeta)
    fastest = 65 * w * math.exp(-zeta / root * at) * math.sin(at) / root
    assert r.peak_rate_rad_s / DEG == pytest.approx(fastest, rel=0.02)
    assert "Relaxation index" in r.sentences()[1]
    lifted = np.clip((t - 12) * 20, 0, 40)  # at the end: index 2.6, with damping below 0
    assert not pendulum_test(t, (5 + held + 65 * (1 - shape) - lifted) * DEG).reached_rest


def test_a_pendulum_test_that_is_none_is_refused():
    t = np.arange(0, 8, 0.005)
    with pytest.raises(UserError, match="straight knee"):
        pendulum_test(t, np.zeros(len(t)))
    with pytest.raises(UserError, match="gaps"):
        pendulum_test(t, np.full(len(t), np.nan))
    moving = pendulum_test(t, 40 * DEG * (1 - np.cos(6 * t)) + 0.05 * t)
    assert not moving.reached_rest
    assert "still moving" in moving.sentences()[-1]


@pytest.mark.parametrize(
    ("viscous", "dry", "body"),
    [(4.0, 0.0, (1.7, 70.0)), (0.0, 1.5, (1.7, 70.0)), (4.0, 1.5, (1.2, 30.0))],
)
def test_loop_in_closed_form(viscous, dry, body):
    """Ellipse pi b w A^2 and parallelogram 4 F A, on a spring of 5 Nm/rad, in Nm for any body."""
    amplitude, w = 0.6, 2 * math.pi * 0.1
    t = np.arange(0, 40, 0.01)
    angle = 1.1 - amplitude * np.cos(w * t)
    rate = amplitude * w * np.sin(w * t)
    torque = 5 * (angle - 1.1) + viscous * rate + dry * np.sign(rate)
    weight = sim.leg_weight_Nm(*body) * np.cos(angle)
    inertia = sim.leg_inertia_kgm2(*body) * amplitude * w**2 * np.cos(w * t)
    r = motion_range(LegRecording(t, angle, torque - weight + inertia, *body))
    exact = math.pi * viscous * w * amplitude**2 + 4 * dry * amplitude
    assert r.loop_J == pytest.approx(exact, rel=0.02)
    assert r.stiffness_Nm_rad == pytest.approx(5, rel=0.01)
    assert (r.low_rad, r.high_rad) == pytest.approx((0.5, 1.7), abs=0.01)
    assert r.fastest_rad_s == pytest.approx(amplitude * w, rel=0.02)
    assert r.slow
    assert r.cycles in (3, 4)


def test_an_elastic_loop_is_zero_within_the_sensors_error():
    """A lossless leg and a torque error of 1.8 Nm that lasts 1 s: -2 J was reported as a loss."""
    t = np.arange(0, 60, 0.02)
    angle = 1.1 - 0.9 * np.cos(0.4 * t)
    off = []
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal(len(t)) * math.sqrt(2 * 0.02)
        error = 1.826 * lfilter([1], [1, -math.exp(-0.02)], noise)
        r = motion_range(LegRecording(t, angle, error - sim.leg_weight_Nm(1.7, 70) * np.cos(angle)))
        off.append(r.loop_J / r.loop_error_J)
    assert 0.7 < np.std(off) < 1.4
    assert "loss is below the error" in " ".join(r.sentences())


# -- validation -------------------------------------------------------------------------------


@pytest.mark.ci
def test_the_published_elbow_against_the_simulated_knee():
    """Threshold, delay and gain in numbers, of the curve itself."""
    found = against_elbow(ROOT / "tests" / "data" / "elbow")
    assert found["peak_Nm"] == pytest.approx(7.225, abs=1e-3)  # its largest line
    assert found["rms_error_Nm"] < 0.03 * found["peak_Nm"]
    # A threshold within those of the severities, whatever the delay; no torque before it.
    own = found["knee_threshold_deg"]
    assert all(own[5] < x < own[1] for x in found["threshold_scaled_by_delay_ms"].values())
    assert found["onset_deg"] >= found["threshold_deg"]
    # And what does not agree, so that nobody thinks it does: stiffer, and slower to set in.
    assert found["softer_than_elbow"][90][5] > 1.5
    assert all(ms > 40 for ms in found["lag_ms"].values())
    assert found["healthy_largest_Nm"] is None
    done = CliRunner().invoke(
        app, ["assess", "validate", "--elbow", str(ROOT / "tests/data/elbow")]
    )
    assert done.exit_code == 0, done.output
    assert "as a share of the range" in done.output


# -- meeting patients -------------------------------------------------------------------------


@pytest.mark.ci
def test_the_shipped_data_base_is_what_the_simulated_knee_answers():
    """Of each category the first and the last, simulated again; the file keeps seven digits."""
    data, n = shipped(), PER_CATEGORY
    assert data.categories == (*sim.CATEGORIES, sim.RELAXED)
    assert (data.provenance["per_category"], data.provenance["seed"]) == (n, PEOPLE)
    people = draw_many(PEOPLE, n, data.categories)
    at = [i for k in range(len(data.categories)) for i in (k * n, k * n + n - 1)]
    passages = swept([people[i] for i in at], [[PEOPLE, 7, i] for i in at])
    names = [people[i].category for i in at]
    again = ResponseDataBase.of(
        answered(zip(names, passages, strict=True), KNEE_GRID), KNEE_GRID, {}
    )
    close = {"atol": 1e-5, "equal_nan": True}
    assert np.allclose(again.responses, data.responses[at], **close)
    assert np.array_equal(again.passes, data.passes[at])
    assert np.allclose(again.error_Nm2, data.error_Nm2, **close)


@pytest.mark.slow
def test_the_shipped_data_base_is_built_again(monkeypatch, tmp_path):
    monkeypatch.setattr(build_module, "cache_folder", lambda: tmp_path)
    again, data = build_module.build(), shipped()
    assert again.calibration == data.calibration
    assert np.allclose(again.responses, data.responses, atol=1e-5, equal_nan=True)


@pytest.mark.ci
def test_a_meeting_goes_to_its_end_and_draws_again_the_same(monkeypatch):
    monkeypatch.setattr("esea_host.assess.evaluation.MOST", 3)
    monkeypatch.setattr("esea_host.assess.evaluation.MOVEMENTS", 2)
    data = made_up()
    rng = np.random.default_rng(0)
    people = [("inside", sim.draw_category("S2", rng)), ("outside", sim.draw_outside("rigid", rng))]
    h = assessed_hypotheses(data)
    met = meet(data, h, people, 0, 9, ("expected", "random"))
    assert [m.way for m in met] == ["expected", "random", "expected"]
    assert all(2 <= len(m.steps) - 1 <= 3 for m in met)
    again = meet(data, h, people, 0, 9, ("expected", "random"))
    assert all(np.array_equal(a.steps, b.steps) for a, b in zip(met, again, strict=True))
    other = meet(data, h, people, 0, 10, ("expected", "random"))
    assert not np.array_equal(met[0].steps, other[0].steps)


@pytest.mark.ci
def test_the_judge_counts(tmp_path):
    """Made-up meetings: all right, all sure at the second movement, one outsider missed."""
    from esea_host.assess.evaluation import Met
    from esea_host.assess.pages import evaluation_page

    data = made_up()
    names = assessed_hypotheses(data).names

    def met(group: str, truth: str, said: str, way: str, sure: int) -> Met:
        steps = np.full((13, len(names)), 0.01 / (len(names) - 1))
        steps[:, names.index(said)] = 0.99
        steps[:sure] = 1 / len(names)
        level = 0.0 if truth in ("rigid", "relaxed") else float(truth[1:].partition("+")[0])
        s, d = (level, 0.0) if truth[0] == "S" else (0.0, level)
        severity = {x: {"mean": level, "low": level, "high": level} for x in "SD"}
        return Met(group, truth, s, d, way, steps, severity)

    rows = [
        met("inside", c, c, w, 2 if w == "expected" else 6)
        for c in data.diagnoses
        for w in ("expected", "random")
    ]
    rows += [met("outside", "rigid", "none of these", "expected", 2)]
    rows += [met("outside", "rigid", "relaxed", "expected", 2)]
    rows += [met("outside", "relaxed", "relaxed", "expected", 2)]
    between = [met("between", f"{x}1.5", f"{x}1", "expected", 2) for x in "SD"]
    mixed = [met("mixed", "S2+D1", "none of these", "expected", 2)]
    r = judge(rows + between + mixed, mixed, data)
    assert r["simulated"] is True
    assert r["data_base"]["digest"] == data.digest
    # Whatever severities there are: the neighbours of D1.5 are D1 and D2.
    assert r["between"]["on_both_neighbours"] == pytest.approx(0.99 + 0.01 / (len(names) - 1))
    assert r["motions_ratio"] == pytest.approx(2 / 6)
    assert r["accuracy"] == 1
    assert r["none_rate_outside"] == pytest.approx(2 / 3)
    assert r["none_rate_inside"] == 0
    assert np.trace(np.array(r["confusion"])[:, :6]) == 6
    # Of 12 answers one is uniform (1/8, and by chance the first name), the others 0.99 and right.
    assert r["ways"]["expected"]["calibration_error"] < 0.2
    json.dumps(r, allow_nan=False)
    with pytest.raises(KeyError):
        evaluation_page(r)  # a page needs the fixed protocol too
    fixed = [dataclasses.replace(x, way=w) for x in rows[::2] for w in ("fixed", "thesis")]
    whole = judge(rows + fixed + between + mixed, mixed, data)
    files.stamped("host-assess-virtual", {"seed": 1} | whole)
    with browser(tmp_path / "profile") as b:
        readable(b, evaluation_page(whole), tmp_path)


# -- commands ---------------------------------------------------------------------------------


@pytest.fixture
def base(tmp_path):
    path = tmp_path / "base.npz"
    made_up().save(path)
    return path


def csv_of(path, **columns):
    head = ",".join(columns)
    rows = "\n".join(
        ",".join(f"{v:.6g}" for v in row) for row in zip(*columns.values(), strict=True)
    )
    path.write_text(f"{head}\n{rows}\n")
    return path


def test_a_conversation_without_a_sensor_and_with_one(base, tmp_path):
    page, file = tmp_path / "page.html", tmp_path / "out.json"
    typed = "very strong\n-3,5\nwhat\nset S3=0.5\nset Q=1\nskip pain\nundo\nshow\ndone\n"
    done = CliRunner().invoke(
        app,
        ["assess", "run", "--database", str(base), "--json", str(file), "--page", str(page)],
        input=typed,
    )
    assert done.exit_code == 0, done.output
    assert NOTICE in done.output
    assert "'what' is not a number" in done.output
    assert "category: 'Q'" in done.output
    steps = [e["what"] for e in json.loads(file.read_text())["trail"]]
    assert steps == ["begin", "felt", "measured", "clinician", "skipped", "undone"]
    text = page.read_text()
    assert text.count(NOTICE) >= 2
    assert "<svg" in text
    assert "http" not in text.replace("http://www.w3.org", "")


@pytest.mark.parametrize("name", ["S3", "S5"])
def test_a_typed_torque_says_what_a_recording_of_the_movement_does(name, monkeypatch):
    """A reflex answers 60 ms late: read at the midpoint, it tells of where the leg was before."""
    p, m = sim.nominal(name), probing_movement(Location(75 * DEG, 95 * DEG), Comfort())
    t = np.arange(round((m.duration_s + 0.6) / sim.STEP_S)) * sim.STEP_S
    path, rate = m.at(t - 0.3)
    moved = sim.Knees([p]).move(path[:, None], rate[:, None], [[0]])
    seen = passage(LegRecording(t, moved.angle_rad[:, 0], moved.torque_Nm[:, 0]))
    desk = ClinicDesk(Assessment(made_up()))
    monkeypatch.setattr(ClinicDesk, "proposed", m)
    there = np.flatnonzero(moved.angle_rad[:, 0] >= 75 * DEG)[0]  # soft hands: a little late
    where = desk.answered
    desk.torque(float(moved.torque_Nm[there, 0]))
    typed = desk.session.trail[-1].details

    def recorded(place):
        return float(along(seen, place).responses_Nm[0])

    assert typed["location"] == where.text()
    assert typed["response_Nm"] == pytest.approx(recorded(where), abs=0.5)
    # Armed: at the midpoint itself the map has another torque.
    assert recorded(m.location) > typed["response_Nm"] + 1.3


@pytest.mark.ci
def test_recordings_are_read_and_a_wrong_one_is_one_paragraph(base, tmp_path):
    t = np.arange(0, 6, 0.01)
    angle = 60 + 45 * np.sin(1.2 * t)
    path = csv_of(tmp_path / "r.csv", time_s=t, angle_deg=angle, torque_Nm=0 * t + 2)
    run = ["assess", "run", "--database", str(base), "--recording"]
    done = CliRunner().invoke(app, [*run, str(path)])
    assert done.exit_code == 0, done.output
    assert "r.csv:" in done.output
    bad = csv_of(tmp_path / "b.csv", time_s=t, angle_deg=angle)
    call = [sys.executable, "-m", "esea_host.cli", *run, str(bad)]
    said = subprocess.run(call, capture_output=True, text=True, cwd=ROOT, check=False)
    assert said.returncode == 2
    assert "Needs torque_Nm" in said.stderr
    assert "Traceback" not in said.stderr
    for text in ("", "time_s\nx\n", "time_s,angle_deg\n1\n"):
        bad.write_text(text)
        with pytest.raises(UserError):
            read_recording(bad)


def test_pendulum_and_range_from_files(tmp_path):
    t = np.arange(0, 12, 0.01)
    w = 5.8
    angle = 65 * (1 - np.exp(-0.4 * t) * np.cos(w * t))
    fall = csv_of(tmp_path / "p.csv", time_s=t, angle_deg=angle)
    out = tmp_path / "p.json"
    done = CliRunner().invoke(app, ["assess", "pendulum", str(fall), "--json", str(out)])
    assert done.exit_code == 0, done.output
    assert "Not a medical device" in done.output
    found = json.loads(out.read_text())
    assert found["relaxation_index"] == pytest.approx(1 + math.exp(-0.4 * math.pi / w), abs=0.02)
    slow = csv_of(
        tmp_path / "l.csv", time_s=t * 3, angle_deg=65 - 30 * np.cos(0.5 * 3 * t),
        torque_Nm=np.sin(1.5 * t),
    )  # fmt: skip
    figure = tmp_path / "l.png"
    call = ["assess", "range", str(slow), "--figure", str(figure), "--json", str(out)]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0, done.output
    assert json.loads(out.read_text())["notice"] in done.output
    assert figure.read_bytes()[:4] == b"\x89PNG"


def fallen(t):
    return 65 * (1 - np.exp(-0.4 * t) * np.cos(5.8 * t))


def led(t):
    u = np.clip(t / 1.875 - 1, 0, 1)
    return 60 * u**3 * (10 - 15 * u + 6 * u**2)


@pytest.mark.parametrize(
    ("call", "t", "columns", "said"),
    [
        ("pendulum", 0.01, {"angle_rad": fallen}, "angle_rad goes to [0-9]{4} deg, more than"),
        ("pendulum", 0.1, {"angle_deg": fallen}, "a sample every 0.1 s, at most 0.04 s"),
        ("pendulum", 10.0, {"angle_deg": lambda t: fallen(t / 1000)}, "time_s in seconds"),
        ("pendulum", 0.01, {"angle_deg": led}, "60 deg/s and 1.7 rad/s2, the leg was lowered"),
        (
            "pendulum",
            0.0005,
            {"angle_deg": lambda t: fallen(np.maximum(0, t - 0.2))},
            "ends within the first swing",
        ),
        (
            "range",
            0.01,
            {"angle_deg": lambda t: 60 + 30 * np.sin(t), "torque_Nm": lambda t: 1e3 * np.sin(t)},
            "too much for hands",
        ),
    ],
)
def test_wrong_units_and_what_is_no_fall(tmp_path, call, t, columns, said):
    time_s = np.arange(1200) * t
    file = csv_of(tmp_path / "x.csv", time_s=time_s, **{k: f(time_s) for k, f in columns.items()})
    assert re.search(said, refused(call, file))


def mcap_of(path, gap=False, note="", **columns):
    """A recording as ``esea-host record`` and ``import`` write it, at 100 Hz."""
    layout = StreamLayout(
        "knee", (StreamColumn("sequence", "u4"), *(StreamColumn(c) for c in columns))
    )
    n = len(next(iter(columns.values())))
    rows = np.zeros(n, layout.dtype)
    rows["sequence"] = np.arange(n) * 10
    for name, values in columns.items():
        rows[name] = values
    ns = np.arange(n, dtype=np.int64) * 10_000_000
    with Recorder(path) as recorder:
        if note:
            recorder.note(note)
        recorder.rows(layout, rows, ns, ns)
        if gap:
            recorder.gap(Gap("knee", 100, 140, 3, "link", int(ns[12])))
    return path


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t, x: (np.delete(t, slice(300, 500)), np.delete(x, slice(300, 500))), "line 302"),
        (lambda t, x: (np.where(t > 5, t - 1, t), x), "time_s goes from 5"),
    ],
    ids=["hole", "back in time"],
)
def test_a_recording_with_a_hole_is_refused(tmp_path, spoil, said):
    t = np.arange(0, 14, 0.01)
    x = 65 * (1 - np.exp(-0.4 * t) * np.cos(5.8 * t))
    whole = csv_of(tmp_path / "whole.csv", time_s=t, angle_deg=x)
    assert CliRunner().invoke(app, ["assess", "pendulum", str(whole)]).exit_code == 0
    t, x = spoil(t, x)
    with pytest.raises(UserError, match=said):
        angle_columns(csv_of(tmp_path / "spoilt.csv", time_s=t, angle_deg=x))


def test_an_mcap_recording_gives_what_its_csv_does(tmp_path):
    t = np.arange(0, 14, 0.01)
    angle = 65 * (1 - np.exp(-0.4 * t) * np.cos(5.8 * t))
    slow = 65 - 30 * np.cos(0.5 * t)
    torque = np.sin(0.5 * t)
    for what, x in (("pendulum", angle), ("range", slow)):
        told = []
        files = (
            csv_of(tmp_path / f"{what}.csv", time_s=t, angle_deg=x, torque_Nm=torque),
            mcap_of(tmp_path / f"{what}.mcap", theta_load_rad=x * DEG, tau_Nm=torque),
        )
        for file in files:
            done = CliRunner().invoke(app, ["assess", what, str(file)])
            assert done.exit_code == 0, done.output
            told.append([x for x in done.output.splitlines() if "left out: nothing" not in x])
        assert told[0] == told[1]
    # Armed: a hole, no angle, no torque, no recording.
    hole = mcap_of(tmp_path / "hole.mcap", gap=True, theta_load_rad=slow * DEG, tau_Nm=torque)
    with pytest.raises(GapError, match="gap"):
        read_recording(hole)
    with pytest.raises(UserError, match="no stream has an angle"):
        read_recording(mcap_of(tmp_path / "a.mcap", tau_Nm=torque))
    with pytest.raises(UserError, match="Needs torque_Nm"):
        read_recording(mcap_of(tmp_path / "b.mcap", theta_load_rad=slow * DEG))
    (tmp_path / "c.mcap").write_text("no")
    with pytest.raises(UserError):
        read_recording(tmp_path / "c.mcap")


def test_a_simulated_patient_is_assessed_in_the_conversation(base, tmp_path):
    call = ["assess", "run", "--database", str(base), "--patient", "simulated:D3"]
    page, file = tmp_path / "page.html", tmp_path / "out.json"
    call += ["--json", str(file)]
    done = CliRunner().invoke(
        app, [*call, "--page", str(page), "--to-deg", "120"], input="move\nmove\n"
    )
    assert done.exit_code == 0, done.output
    assert done.output.count("Simulated: ") == 2
    assert "The patient is simulated." in done.output
    assert "The simulated patient was: D3" in done.output
    assert "SIMULATED PATIENT" in page.read_text()
    saved = json.loads(file.read_text())
    assert saved["simulated"] is True
    assert saved["database"]["digest"] == ResponseDataBase.load(base).digest
    wrong = CliRunner().invoke(app, ["assess", "run", "--patient", "S3"], input="")
    assert "simulated:S3" in str(wrong.exception)
    without = CliRunner().invoke(app, ["assess", "run", "--database", str(base)], input="move\n")
    assert "no simulated patient" in without.output


@pytest.mark.ci
def test_a_data_base_from_recordings_of_any_categories(tmp_path):
    rng = np.random.default_rng(0)
    t = np.arange(0, 30, 0.01)
    for name, stiff in (("stiff", 6.0), ("soft", 1.0)):
        (tmp_path / name).mkdir()
        for k in range(4):
            w = 0.15 * t
            angle = 1 + 0.5 * np.sin(w * t)
            torque = stiff * np.exp(rng.normal(0, 0.05)) * (angle - 1)
            path = csv_of(tmp_path / name / f"{k}.csv", time_s=t, angle_rad=angle, torque_Nm=torque)
            path.write_text("# height_m=1.6 mass_kg=60\n" + path.read_text())
            with pytest.raises(
                UserError, match=r"1.6 by the file, 1.7 here.  *Give --height-m 1.6"
            ):
                read_recording(path)
    data = from_recordings(tmp_path)
    assert set(data.categories) == {"stiff", "soft"}
    assert data.reference is None
    assert data.notice == MEASURED_NOTICE  # people's, and said of all that is made with it
    assert Assessment(data).to_dict()["notice"] == MEASURED_NOTICE
    assert data.common.sum() > 5
    done = CliRunner().invoke(
        app, ["assess", "build", str(tmp_path / "d.npz"), "--recordings", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    assert "8 people, 2 categories" in done.output
    assert "Not calibrated" in done.output
    # One more person, in an MCAP file, whose note tells the body's size.
    w = 0.15 * t
    more = {"theta_load_rad": 1 + 0.5 * np.sin(w * t), "tau_Nm": 1.0 * 0.5 * np.sin(w * t)}
    mcap_of(tmp_path / "soft" / "k.mcap", note="height_m=1.6 mass_kg=60", **more)
    assert len(from_recordings(tmp_path).category) == 9
    mcap_of(tmp_path / "soft" / "l.mcap", note="height_m=tall mass_kg=60", **more)
    with pytest.raises(UserError, match="body size"):
        from_recordings(tmp_path)
    with pytest.raises(UserError, match="no recordings"):
        from_recordings(tmp_path / "none")


@pytest.mark.ci
def test_every_page_says_what_it_is_not(base, tmp_path):
    for name in ("a.png", "a.pdf", "a.html"):
        page = tmp_path / name
        done = CliRunner().invoke(
            app, ["assess", "run", "--database", str(base), "--page", str(page)], input="slight\n"
        )
        assert done.exit_code == 0, done.output
        assert page.stat().st_size > 10_000
    digest = ResponseDataBase.load(base).digest[:12]
    today = datetime.now(UTC).strftime("%Y-%m-")
    assert f"database {digest}" in page.read_text()
    assert today in page.read_text()
    done = CliRunner().invoke(
        app, ["assess", "run", "--database", str(base), "--page", "x.doc"], input=""
    )
    assert isinstance(done.exception, UserError)


def refused(*call):
    done = CliRunner().invoke(app, ["assess", *map(str, call)], input="")
    assert isinstance(done.exception, UserError), done.output
    return str(done.exception)


def test_what_cannot_be_is_refused_in_a_sentence(base, tmp_path):
    t = np.arange(0, 40, 0.02)
    slow = csv_of(tmp_path / "l.csv", time_s=t, angle_deg=60 - 30 * np.cos(t), torque_Nm=0 * t)
    seldom = csv_of(
        tmp_path / "s.csv", time_s=t[::50], angle_deg=60 - 30 * np.cos(t[::50]),
        torque_Nm=0 * t[::50],
    )  # fmt: skip
    assert ".svg" in refused("range", slow, "--figure", tmp_path / "x.txt")
    assert "25 Hz" in refused("range", seldom)
    for bad in (["--height-m", -1], ["--height-m", 9], ["--mass-kg", 14]):
        assert "15 to 250 kg" in refused("run", "--database", base, *bad)
        assert "15 to 250 kg" in refused("range", slow, *bad)
    for twice in ("S2+S4", "D1+D1"):
        assert "S2+D4" in refused("run", "--patient", f"simulated:{twice}")
    other = tmp_path / "other.npz"
    dataclasses.replace(made_up(), categories=("left", *made_up().categories[1:])).save(other)
    assert "left" in refused("evaluate", "--database", other, "--patients", 8, "--jobs", 1)


def test_every_command_says_what_it_is_not():
    for command in ("build", "evaluate", "run", "pendulum", "range", "validate"):
        told = CliRunner().invoke(app, ["assess", command, "--help"]).output
        assert "Not a medical device" in told, command
    # On the display, in either language, what is true of any database.
    shown = [words_of(x).scene("knee_notice", {}) for x in ("en", "de")]
    assert shown[0] == MEASURED_NOTICE
    assert shown[1].count(".") == 2
    assert "erprobt" in shown[1]  # tried, as in English; not trained
