"""Assessment of the knee: inference, maps, movements, sessions; each against a second way."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import re

import numpy as np
import pytest
from scipy import stats

from esea_gen.errors import UserError
from esea_host.assess.database import LocationGrid, ResponseDataBase, responses_at
from esea_host.assess.desk import conclusion
from esea_host.assess.evaluation import calibration_error, confusion, share_interval
from esea_host.assess.hypotheses import (
    NONE,
    Evidence,
    Hypotheses,
    between_severities,
    mixtures,
    summarised,
)
from esea_host.assess.probing import (
    Comfort,
    contextual_information,
    expected_information,
    informative,
    inherent_information,
    next_movement,
    probing_movement,
)
from esea_host.assess.responses import (
    LegRecording,
    Location,
    MovementReadings,
    Passage,
    along,
    effective_samples,
    passage,
)
from esea_host.assess.session import Assessment

DEG = math.pi / 180
GRID = LocationGrid.spanning((0, 120 * DEG), (-100 * DEG, 100 * DEG), (6, 4))
KNOWN = np.ones(GRID.cells, bool)


def made_up(people: int = 40, seed: int = 3, spread: float = 0.1) -> ResponseDataBase:
    """Two disorders at three severities and the relaxed, from plain formulas."""
    rng = np.random.default_rng(seed)
    a, r = GRID.centres.T
    category, rows, names = [], [], ["S1", "S2", "S3", "D1", "D2", "D3", "relaxed"]
    for i, name in enumerate(names):
        level = 0 if name == "relaxed" else int(name[1])
        shape = 4 * level * (np.maximum(r, 0) if name[0] == "S" else np.tanh(a))
        for _ in range(people):
            strong = np.exp(rng.normal(0, spread))
            rows.append(a + strong * (shape if level else 0 * shape) + rng.normal(0, 0.3, len(a)))
            category.append(i)
    rows = np.array(rows)
    return ResponseDataBase(
        GRID,
        tuple(names),
        np.array(category),
        rows,
        np.ones_like(rows),
        {"source": "formulas"},
        "relaxed",
    )


@pytest.fixture(scope="module")
def data() -> ResponseDataBase:
    return made_up()


@pytest.fixture(scope="module")
def small() -> Hypotheses:
    """Three hypotheses of no structure at all."""
    rng = np.random.default_rng(0)
    n = GRID.cells
    b = rng.normal(0, 1, (3, 2, n))
    return Hypotheses(
        ("a", "b", "c"),
        GRID,
        KNOWN,
        rng.normal(0, 3, (3, n)),
        np.swapaxes(b, 1, 2) @ b,
        rng.uniform(0.5, 1.5, (3, n)),
    )


# -- inference --------------------------------------------------------------------------------


def test_joint_likelihood_is_the_exact_one(small):
    """Every reading at a cell's centre; the joint density from SciPy, covariance written out."""
    cells, y, extra = [0, 7, 7, 20], np.array([1.0, -2.0, 0.5, 3.0]), [0.0, 0.4, 0.0, 0.2]
    evidence = Evidence(small)
    for c, v, e in zip(cells, y, extra, strict=True):
        assert evidence.add(GRID.location(c), v, e)
    for h in range(3):
        people = small.covariance[h][np.ix_(cells, cells)]
        noise = small.noise_Nm[h, cells] ** 2 + np.square(extra)
        exact = stats.multivariate_normal(small.mean[h, cells], people + np.diag(noise))
        assert evidence.log_likelihood()[h] == pytest.approx(exact.logpdf(y), abs=1e-9)


def test_a_movement_is_one_piece_of_news_with_a_common_error(small):
    """Three places of one movement, errors that go together, then one more: SciPy's density."""
    cells, y = [3, 9, 15, 9], np.array([1.0, -2.0, 0.5, 0.1])
    error = np.array([[1.0, 0.9, 0.8], [0.9, 1.0, 0.9], [0.8, 0.9, 1.0]])
    places = tuple(GRID.location(c) for c in cells)
    evidence = Evidence(small)
    assert evidence.add_movement(MovementReadings(places[:3], y[:3], error, 0.2))
    assert evidence.add(places[3], y[3], 0.5)
    assert len(evidence) == 2
    for h in range(3):
        c = small.covariance[h][np.ix_(cells, cells)] + np.diag(small.noise_Nm[h, cells] ** 2)
        c[:3, :3] += error
        c[3, 3] += 0.25
        exact = stats.multivariate_normal(small.mean[h, cells], c).logpdf(y)
        assert evidence.log_likelihood()[h] == pytest.approx(exact, abs=1e-9)
    evidence.undo()
    other = Evidence(small)
    other.add_movement(MovementReadings(places[:3], y[:3], error, 0.2))
    assert evidence.log_likelihood() == pytest.approx(other.log_likelihood())
    # Of places off the map nothing is counted, of the others all.
    away = (Location(9.0, 0.0), *places[1:3])
    assert other.add_movement(MovementReadings(away, y[:3], error, 0.2))
    assert not other.add_movement(MovementReadings(away[:1], y[:1], error[:1, :1], 0.2))


def test_without_covariance_it_is_the_thesis_naive_bayes(small):
    """(8.5), (8.6), multiplied out in plain numbers."""
    plain = dataclasses.replace(small, covariance=np.zeros_like(small.covariance))
    evidence, p = Evidence(plain), np.full(3, 1 / 3)
    for c, v in ((3, 0.7), (11, -1.0), (3, 0.1)):
        evidence.add(GRID.location(c), v)
        likelihood = [
            math.exp(-((v - m) ** 2) / (2 * s**2)) / math.sqrt(2 * math.pi * s**2)
            for m, s in zip(plain.mean[:, c], plain.noise_Nm[:, c], strict=True)
        ]
        p = p * likelihood / np.sum(p * likelihood)
    x = np.exp(evidence.log_likelihood())
    assert x / x.sum() == pytest.approx(p, rel=1e-9)


def test_the_same_place_again_is_no_news_about_the_person(small):
    """Means 0 and 2, people 1 Nm apart, noise 0.5: twenty readings of 1.3, by hand."""
    n = GRID.cells
    joint = dataclasses.replace(
        small.only(["a", "b"]),
        mean=np.array([np.zeros(n), np.full(n, 2.0)]),
        covariance=np.ones((2, n, n)),
        noise_Nm=np.full((2, n), 0.5),
    )
    naive = dataclasses.replace(
        joint, covariance=np.zeros((2, n, n)), noise_Nm=np.full((2, n), math.sqrt(1.25))
    )
    odds = []
    for h in (joint, naive):
        evidence = Evidence(h)
        for _ in range(20):
            evidence.add(GRID.location(22), 1.3)
        log = evidence.log_likelihood()
        odds.append(log[1] - log[0])
    assert odds[0] == pytest.approx((1.3**2 - 0.7**2) / 2 / (1 + 0.25 / 20))  # 0.6: still open
    assert odds[1] == pytest.approx(20 * (1.3**2 - 0.7**2) / 2 / 1.25)  # 9.6: quite sure


def test_far_from_everything_is_none_of_these_and_never_0_over_0(data):
    session = Assessment(data)
    for torque in (60.0, -1e6, 1e12):
        session.observe(GRID.location(20), torque)
        assert np.all(np.isfinite(session.probabilities))
        assert session.probabilities.sum() == pytest.approx(1)
        assert session.by_name()[NONE] > 0.99


def test_a_person_of_a_category_is_found_and_one_of_none_is_not(data):
    a, r = GRID.centres.T
    for name, shape in (("S2", 8 * np.maximum(r, 0)), ("D3", 12 * np.tanh(a))):
        session = Assessment(data)
        for c in (2, 9, 15, 20, 23, 6):
            session.observe(GRID.location(c), float(a[c] + shape[c]), 0.3)
        assert max(session.by_name(), key=session.by_name().get) == name
    session = Assessment(data)
    for c in (2, 9, 15, 20, 23, 6):
        session.observe(GRID.location(c), float(a[c] - 6 * np.sign(r[c])), 0.3)
    assert session.by_name()[NONE] > 0.9


def test_any_number_of_categories_of_any_joint():
    rng = np.random.default_rng(1)
    grid = LocationGrid.spanning((-1, 1), (-5, 5), (3, 4))
    names = tuple("elbow-" + c for c in "abcdefg")
    rows = np.array([[k + rng.normal(0, 0.1, 12)] for k in range(7) for _ in range(5)])[:, 0]
    data = ResponseDataBase(
        grid, names, np.repeat(np.arange(7), 5), rows, np.ones_like(rows), {}, None
    )
    session = Assessment(data)
    assert session.names == (*names, NONE)
    session.observe(grid.location(4), 3.0)
    assert max(session.by_name(), key=session.by_name().get) == "elbow-d"
    assert session.severity() == {}
    with pytest.raises(UserError, match="without a disorder"):
        Assessment(data, mixed=True)


@pytest.mark.parametrize("kind", ["people", "distributions", "centroids"])
def test_every_summary_finds_a_clear_case(data, kind):
    session = Assessment(data, kind=kind)
    a, r = GRID.centres.T
    for c in (2, 9, 15, 20, 23, 3):
        session.observe(GRID.location(c), float(a[c] + 12 * np.maximum(r[c], 0)), 0.3)
    assert max(session.by_name(), key=session.by_name().get) == "S3"


def test_unknown_summary_is_refused(data):
    with pytest.raises(UserError, match="distributions or centroids"):
        summarised(data, "best")


def test_severity_between_two_is_a_number(data):
    session = Assessment(data)
    a, r = GRID.centres.T
    for c in (3, 7, 11, 15, 19, 23):
        session.observe(GRID.location(c), float(a[c] + 10 * np.maximum(r[c], 0)), 0.2)
    found = session.severity()["S"]
    assert found["mean"] == pytest.approx(2.5, abs=0.2)
    assert found["low"] <= 2.5 <= found["high"]
    fine, labels = between_severities(session.hypotheses.only(["S1", "S2", "S3"]))
    assert labels[2] == ("S", 1.5)
    assert fine.mean[2] == pytest.approx(fine.mean[[0, 4]].mean(axis=0))


def test_two_disorders_add_beyond_the_relaxed(data):
    h = summarised(data)
    pair = mixtures(h, "relaxed")
    i = pair.names.index("S2+D3")
    at = [h.names.index(n) for n in ("S2", "D3", "relaxed")]
    assert len(pair.names) == 9
    assert pair.mean[i] == pytest.approx(h.mean[at[0]] + h.mean[at[1]] - h.mean[at[2]])
    session = Assessment(data, mixed=True)
    a, r = GRID.centres.T
    for c in (2, 9, 15, 20, 23, 6, 11, 0):
        y = a[c] + 8 * np.maximum(r[c], 0) + 12 * np.tanh(a[c])
        session.observe(GRID.location(c), float(y), 0.3)
    assert max(session.by_name(), key=session.by_name().get) == "S2+D3"


# -- database ---------------------------------------------------------------------------------


def line(rate_rad_s: float, seconds: float = 2.0) -> Passage:
    """A stretch at constant speed over a response that is a plane."""
    t = np.arange(0, seconds, 0.01)
    angle = 0.5 + rate_rad_s * t
    rate = np.full_like(t, rate_rad_s)
    return Passage(t, angle, rate, 3 + 2 * angle - rate, np.zeros(len(t), bool), 0.0)


def test_a_plane_is_read_off_exactly_along_the_line_and_nothing_elsewhere():
    grid = LocationGrid.spanning((0.4, 1.6), (-1, 1), (6, 5))
    p = line(0.4)
    got = responses_at(p, grid)
    found, passes = got.values, got.passes
    a, r = grid.centres.T
    near = np.isclose(r, 0.4) & (a > 0.6) & (a < 1.2)
    assert near.sum() >= 3
    assert found[near] == pytest.approx(3 + 2 * a[near] - 0.4, abs=1e-3)
    assert np.all(passes[near] == 1)  # two hundred samples, one pass
    assert np.all(np.isnan(found[r < 0]))
    strained = dataclasses.replace(p, strained=np.ones(len(p.time_s), bool))
    assert np.all(np.isnan(responses_at(strained, grid).values))


def test_one_file_with_its_provenance_and_nothing_slips_in(tmp_path, data):
    path, again = tmp_path / "a.npz", tmp_path / "b.npz"
    fitted = dataclasses.replace(data, calibration={"own_Nm": 0.7})
    digest = fitted.save(path)
    assert fitted.save(again) == digest
    assert path.read_bytes() == again.read_bytes()
    read = ResponseDataBase.load(path)
    assert read.provenance == data.provenance
    assert read.calibration == {"own_Nm": 0.7}
    assert np.array_equal(read.responses, data.responses)
    # Armed: a changed number, a cut file, something else.
    with np.load(path) as file:
        arrays = {n: file[n] for n in file.files}
    arrays["responses_Nm"][0, 0] += 1e-3
    np.savez(tmp_path / "c.npz", **arrays)
    with pytest.raises(UserError, match="changed after saving"):
        ResponseDataBase.load(tmp_path / "c.npz")
    (tmp_path / "d.npz").write_bytes(path.read_bytes()[:-100])
    (tmp_path / "e.npz").write_text("no")
    # Whole, and of no use: all that follows from it would be NaN.
    endless = data.responses.copy()
    endless[5, 3] = np.inf
    for bad in ({"responses": endless}, {"calibration": {"own_Nm": math.nan}}):
        dataclasses.replace(data, **bad).save(tmp_path / "g.npz")
        with pytest.raises(UserError, match="infinite or missing"):
            ResponseDataBase.load(tmp_path / "g.npz")
    for name in ("d.npz", "e.npz", "f.npz"):
        with pytest.raises(UserError, match="no response database"):
            ResponseDataBase.load(tmp_path / name)


def test_bilinear_weights_and_the_edge_of_the_map():
    w = GRID.weights(Location(30 * DEG, 25 * DEG), KNOWN)
    a, r = GRID.centres.T
    assert w.sum() == pytest.approx(1)
    assert w @ a == pytest.approx(30 * DEG)
    assert w @ r == pytest.approx(25 * DEG)
    assert GRID.weights(Location(200 * DEG, 0), KNOWN) is None
    assert GRID.weights(Location(30 * DEG, 25 * DEG), ~KNOWN) is None


# -- correlated samples -----------------------------------------------------------------------


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_effective_samples_of_an_ar1(phi):
    """n (1 - phi) / (1 + phi)."""
    rng = np.random.default_rng(2)
    n, x = 20000, np.zeros(20000)
    for k, e in enumerate(rng.normal(size=n)):
        x[k] = phi * x[k - 1] + e
    assert effective_samples(x) == pytest.approx(n * (1 - phi) / (1 + phi), rel=0.15)


# -- movements --------------------------------------------------------------------------------


def test_minimum_jerk_through_the_location_at_its_midpoint():
    where = Location(70 * DEG, -80 * DEG)
    m = probing_movement(where, Comfort())
    amplitude = abs(m.end_rad - m.start_rad)
    assert abs(where.rate_rad_s) == pytest.approx(1.875 * amplitude / m.duration_s)
    t = np.linspace(0, m.duration_s, 4001)
    angle, rate = m.at(t)
    assert angle[2000] == pytest.approx(where.angle_rad)
    assert rate[2000] == pytest.approx(where.rate_rad_s)
    assert np.abs(rate).max() == pytest.approx(80 * DEG)
    assert np.gradient(angle, t)[5:-5] == pytest.approx(rate[5:-5], abs=1e-4)
    # Minimum jerk: the sixth derivative of the path vanishes, so it is a polynomial of order 5.
    assert np.polyval(np.polyfit(t - t.mean(), angle, 5), t - t.mean()) == pytest.approx(angle)
    assert m.at(m.duration_s + 1)[1] == 0


def test_reach_and_comfort_are_kept_or_the_location_is_left_alone():
    tight = Comfort(low_rad=20 * DEG, high_rad=100 * DEG, rate_rad_s=60 * DEG)
    m = probing_movement(Location(85 * DEG, 50 * DEG), tight)
    assert m.end_rad <= 100 * DEG + 1e-12
    assert m.start_rad >= 20 * DEG
    assert probing_movement(Location(98 * DEG, 50 * DEG), tight) is None  # no room
    assert probing_movement(Location(60 * DEG, 80 * DEG), tight) is None  # too fast
    assert probing_movement(Location(60 * DEG, 0.0), tight) is None
    for bad in ({"low_rad": 1.0, "high_rad": 0.5}, {"rate_rad_s": -1.0}, {"high_rad": math.nan}):
        with pytest.raises(UserError):
            Comfort(**bad)


def test_a_movement_is_read_from_the_nearest_point_outwards():
    p = line(0.5)
    found = along(p, Location(0.9, 0.55))
    first = found.locations[0]
    assert first.angle_rad == pytest.approx(0.9, abs=0.01)
    assert first.rate_rad_s == pytest.approx(0.5)
    assert found.distance == pytest.approx(0.05 / (20 * DEG), rel=0.05)
    assert found.passed
    a = np.array([w.angle_rad for w in found.locations])
    assert found.responses_Nm == pytest.approx(3 + 2 * a - 0.5, abs=0.02)
    # From 0.5 to 1.5 rad in steps of a tolerance, 10 deg.
    assert len(a) in (5, 6)
    assert np.diff(np.sort(a)) == pytest.approx(10 * DEG, abs=1.2 * DEG)
    assert len(along(p, Location(0.9, 0.55), most=2).locations) == 2
    assert not along(p, Location(0.9, 1.5)).passed
    left = along(dataclasses.replace(p, strained=p.time_s > 0.4), Location(1.2, 0.5))
    assert not left.passed
    assert max(w.angle_rad for w in left.locations) < 0.75
    assert along(dataclasses.replace(p, strained=p.time_s >= 0), Location(0.9, 0.5)) is None


def test_weight_and_inertia_of_a_standard_leg_leave_nothing():
    """Winter's shares written out: 0.061 M at 0.606 of 0.246 H, radius of gyration 0.735."""
    h, m = 1.8, 80.0
    t = np.arange(0, 4, 0.002)
    angle = 1.0 + 0.4 * np.sin(3 * t)
    acceleration = -0.4 * 9 * np.sin(3 * t)
    mass, length = 0.061 * m, 0.246 * h
    torque = mass * (0.735 * length) ** 2 * acceleration
    torque = torque - mass * 9.81 * 0.606 * length * np.cos(angle)
    p = passage(LegRecording(t, angle, torque, h, m))
    assert np.abs(p.response_Nm[60:-60]).max() < 0.05
    twice = passage(LegRecording(t, angle, torque + 2, h, m))
    grown = (h * m) / (1.70 * 70)
    assert np.mean(twice.response_Nm - p.response_Nm) == pytest.approx(2 / grown, rel=1e-6)
    assert p.error_Nm == pytest.approx(0.0382 * 47.8 / grown)


def test_a_strained_hand_is_seen():
    t = np.arange(0, 2, 0.002)
    angle = 1.0 + 0.4 * np.sin(3 * t)
    p = passage(LegRecording(t, angle, np.where((t > 0.5) & (t < 0.7), 45.0, 5.0)))
    assert not p.strained[p.time_s < 0.3].any()
    assert p.strained[(p.time_s > 0.55) & (p.time_s < 1.05)].all()
    assert not p.strained[p.time_s > 1.3].any()


@pytest.mark.parametrize(
    "change",
    [
        {"time_s": np.zeros(100)},
        {"angle_rad": np.full(100, np.nan)},
        {"height_m": 17.0},
        {"time_s": np.arange(3.0), "angle_rad": np.zeros(3), "torque_Nm": np.zeros(3)},
    ],
)
def test_a_bad_recording_is_refused(change):
    good = {k: np.linspace(0, 1, 100) for k in ("time_s", "angle_rad", "torque_Nm")}
    LegRecording(**good)
    with pytest.raises(UserError):
        LegRecording(**{**good, **change})


# -- where to probe next ----------------------------------------------------------------------


def test_thesis_information_inherent_and_of_the_five_most_probable():
    means = np.array([[0.0, 1], [2, 1], [4, 1], [100, 1], [6, 1], [8, 1]])
    assert inherent_information(means)[1] == 0
    assert inherent_information(means)[0] == pytest.approx(np.std([0, 2, 4, 100, 6, 8]))
    found = contextual_information(means, np.array([0.2, 0.2, 0.2, 0.01, 0.2, 0.19]))
    assert found[0] == pytest.approx(math.sqrt(8))  # of 0, 2, 4, 6, 8


def test_expected_information_of_cases_known():
    p, one = np.array([0.5, 0.5]), np.ones((2, 1, 1))
    assert expected_information(np.zeros((2, 1)), one, p) == pytest.approx(0, abs=1e-12)
    assert expected_information(np.array([[0.0], [1000]]), one, p) == pytest.approx(math.log(2))
    assert expected_information(np.array([[0.0], [9]]), one, np.array([1, 1e-9])) == 0


def test_expected_information_by_drawing_is_never_less():
    """Two readings at once; a bound from below, not far below."""
    rng = np.random.default_rng(4)
    p = np.array([0.5, 0.3, 0.2])
    m = np.array([[0.0, 0.0], [2.0, 1.0], [-1.0, 2.0]])
    c = np.array([[[1.0, 0.5], [0.5, 1.0]], [[2.0, 0.0], [0.0, 1.0]], [[0.5, 0.1], [0.1, 0.5]]])
    i = rng.choice(3, 50_000, p=p)
    y = m[i] + np.einsum("kij,kj->ki", np.linalg.cholesky(c)[i], rng.normal(size=(len(i), 2)))
    each = np.stack([stats.multivariate_normal(m[h], c[h]).pdf(y) for h in range(3)], axis=1)
    drawn = np.mean(np.log(each[np.arange(len(i)), i] / (each @ p)))
    assert 0.6 * drawn < expected_information(m, c, p) < drawn


def test_next_movement_goes_where_it_tells_most_and_not_where_it_failed(data):
    session = Assessment(data)
    m = next_movement(session)
    cell = int(
        np.argmin(np.abs(GRID.centres - [m.location.angle_rad, m.location.rate_rad_s]).sum(1))
    )
    value = informative(session)
    able = [probing_movement(GRID.location(c), Comfort()) is not None for c in range(GRID.cells)]
    assert np.array_equal(np.isfinite(value), able)
    assert value[cell] == np.nanmax(value)
    session.missed(m.location)
    assert next_movement(session).location != m.location
    by_thesis = informative(session, measure="thesis")
    assert next_movement(session, value=by_thesis).location != m.location
    means, p = session.hypotheses.mean[:-1], session.probabilities[:-1]
    assert by_thesis[able] == pytest.approx(contextual_information(means, p)[able])
    with pytest.raises(UserError, match="Widen the reach"):
        next_movement(session, Comfort(0.1, 0.2))
    inherent = informative(session, measure="inherent")
    assert inherent[able] == pytest.approx(np.std(means, axis=0)[able])
    with pytest.raises(UserError, match="expected, thesis, inherent"):
        informative(session, measure="luck")


# -- a session --------------------------------------------------------------------------------


def test_the_clinician_has_the_last_word_and_the_trail_tells(data):
    session = Assessment(data)
    session.observe(GRID.location(20), 9.0, 0.3)
    session.override({"D2": 0.7, "S1": 0.1}, "history of the patient")
    assert "by hand" in conclusion(session)[-1]
    p = session.by_name()
    assert p["D2"] == pytest.approx(0.7)
    assert p["S1"] == pytest.approx(0.1)
    assert sum(p.values()) == pytest.approx(1)
    before = session.by_name()
    session.observe(GRID.location(2), 5.0, 0.3)
    assert session.by_name() != before
    assert session.undo()
    assert session.by_name() == pytest.approx(before)
    assert session.undo()  # the clinician's own
    assert session.by_name()["D2"] != pytest.approx(0.7)
    assert "by hand" not in conclusion(session)[-1]  # taken back: it no longer stands
    assert [e.what for e in session.trail] == [
        "begin", "measured", "clinician", "measured", "undone", "undone",
    ]  # fmt: skip
    trail = json.loads(json.dumps(session.to_dict()))["trail"]
    before = ""
    for e in trail:  # each digest is of the digest before it and of the step
        body = [before, e["time"], e["what"], e["details"], e["probabilities"]]
        before = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
        assert e["digest"] == before
    assert trail[0]["details"]["database"] == data.digest
    assert all(re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ", e["time"]) for e in trail)


@pytest.mark.parametrize("bad", [{"X": 0.5}, {"S1": 1.5}, {"S1": math.nan}, {"S1": 0.6, "S2": 0.6}])
def test_an_override_that_is_none_is_refused_and_nothing_changes(data, bad):
    session = Assessment(data)
    before = session.by_name()
    with pytest.raises(UserError):
        session.override(bad, "")
    assert session.by_name() == before
    assert len(session.trail) == 1


def test_it_works_without_a_sensor(data):
    session = Assessment(data, prior={"D1": 0.3})
    assert session.by_name()["D1"] == pytest.approx(0.3)
    where = Location(80 * DEG, 70 * DEG)
    session.feel(where, "very strong")
    strong = session.by_name()
    session.undo()
    session.feel(where, "none")
    weak = session.by_name()
    assert strong["S3"] > 5 * weak["S3"]
    assert weak["relaxed"] > 5 * strong["relaxed"]
    n = len(session.evidence)
    session.skip("pain")
    assert len(session.evidence) == n
    with pytest.raises(UserError, match="very strong"):
        session.feel(where, "lots")


@pytest.mark.parametrize("rate_deg_s", [-70, -15, 15, 70])
def test_a_word_is_the_torque_against_the_movement_that_it_stands_for(data, rate_deg_s):
    where = Location(80 * DEG, rate_deg_s * DEG)
    felt, read = Assessment(data), Assessment(data)
    felt.feel(where, "slight")
    relaxed_Nm = 80 * DEG  # as the made-up people respond
    read.observe(where, relaxed_Nm + math.copysign(4, rate_deg_s), 2.0)
    assert felt.by_name() == pytest.approx(read.by_name(), abs=0.02)


def test_settled_when_probabilities_have_stopped_changing(data):
    session = Assessment(data)
    a, r = GRID.centres.T
    assert not session.settled
    for c in (2, 9, 15, 20, 23, 6, 3, 7, 11):
        session.observe(GRID.location(c), float(a[c] + 8 * np.maximum(r[c], 0)), 0.3)
    assert session.settled
    session.override({"D3": 0.9}, "")
    assert not session.settled


def test_outside_the_map_nothing_is_counted(data):
    session = Assessment(data)
    before = session.by_name()
    assert not session.observe(Location(5.0, 0.0), 3.0)
    assert not session.observe(GRID.location(0), math.nan)
    assert session.by_name() == before
    # Each was a step, and taking it back takes back nothing else.
    session.feel(GRID.location(2), "slight")
    felt = session.by_name()
    session.observe(Location(5.0, 0.0), 3.0)
    assert session.undo()
    assert session.by_name() == felt
    assert [session.undo() for _ in range(4)] == [True, True, True, False]
    assert session.by_name() == before


def test_what_was_taken_back_settles_nothing(data):
    session = Assessment(data)
    for _ in range(12):
        session.feel(GRID.location(2), "slight")
    for _ in range(12):
        assert session.undo()
    assert not session.settled
    session.missed(GRID.location(2))
    assert GRID.location(2) in session.avoided
    assert session.undo()
    assert session.avoided == set()


# -- scores -----------------------------------------------------------------------------------


def test_scores_of_cases_known():
    confidence, right = np.array([0.95] * 10 + [0.55] * 10), np.array([1] * 10 + [0] * 10, float)
    assert calibration_error(confidence, right) == pytest.approx(0.5 * 0.05 + 0.5 * 0.55)
    assert calibration_error(np.full(20, 0.75), np.array([1] * 15 + [0] * 5, float)) == 0
    counts = confusion(np.array([0, 0, 1]), np.array([0, 2, 1]), 2, 3)
    assert counts.tolist() == [[1, 0, 1], [0, 1, 0]]
    # Wilson's interval of 8 of 10, as tabulated.
    assert share_interval(8, 10) == pytest.approx([0.4902, 0.9433], abs=1e-4)
    low, high = stats.binomtest(3, 40).proportion_ci(method="wilson")
    assert share_interval(3, 40) == pytest.approx([low, high])
