"""Parameters that a recording does not determine: reported, without a false interval.

All recordings are simulated; the rubbers are written here a second time.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

from esea_gen.identify import load_mapping, load_recordings
from esea_gen.identify.family.fit import UnitTerms, fit_member, member_spread, members, not_seen
from esea_gen.identify.family.identification import drafted_member, family_section, identify_member
from esea_gen.identify.notes import temperature_notes, told_apart_notes
from esea_gen.identify.recording.resampling import FitRows, resampled
from esea_gen.model.family import FittedMember, Member, Rise, Term
from esea_gen.model.temperature import TemperatureFactor
from tests.identify.test_identify_temperature import THREE, motion, recorded, springs
from tests.identify.test_recordings import MAPPING
from tests.rigs import table

PER, CYCLES = 100, 4


def moved(amplitudes: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Time and deflection in rad, some cycles of each amplitude."""
    x = np.repeat(amplitudes, PER * CYCLES) * np.sin(
        2 * np.pi * np.arange(PER * CYCLES * len(amplitudes)) / PER
    )
    return np.arange(len(x)) / PER, x


def hard(x: np.ndarray, softens: bool) -> np.ndarray:
    """A spring and a stop, Nm; softened by the largest deflection so far, or not at all."""
    out, stuck, last, most = [], 0.0, 0.0, 0.0
    for value in x.tolist():
        stuck = float(np.clip(stuck + value - last, -0.008, 0.008))
        last = value
        left = 1 / (1 + most / 0.03) if softens else 1.0
        out.append(left * (12 * value + 300 * value**3 + 12 * stuck))
        most = max(most, abs(value))
    return np.array(out)


def rig(folder: Path, amplitudes: tuple[float, ...], softens: bool = False) -> Path:
    """Its recording, first cycles skipped, with 5 mNm of noise."""
    t, x = moved(amplitudes)
    y = hard(x, softens) + np.random.default_rng(3).normal(0, 0.005, len(x))
    (folder / "rig.csv").write_text(table(t, np.degrees(x), y))
    (folder / "map.toml").write_text(MAPPING)
    return folder / "map.toml"


# Softening that nothing shows.


@pytest.mark.parametrize("name", ["stops, strain", "slips, strain"])
def test_softening_that_no_row_shows_is_not_invented(tmp_path, name):
    """0.1, then 0.05 rad: after the first quarter of a cycle the memory stands still."""
    done = identify_member(rig(tmp_path, (0.1, 0.05)), name)
    assert not any(t.softening for _, t in done.fitted.used)
    assert done.fitted.weights_Nm[0] == pytest.approx(12 * 0.1, rel=0.05)
    said = "\n".join(done.notes)
    assert "Softening by strain is not seen" in said
    assert "skip_first = 0" in said
    assert "negligible" not in said
    # A fresh start, no deflection of which was ever above 0.05 rad: 12 * 0.05 + 0.13 Nm.
    _, x = moved((0.05,))
    (r,) = done.recordings
    fresh = replace(r, theta_rad=x, time_s=np.arange(len(x)) / PER)
    rows = UnitTerms(done.fitted.member, [fresh], PER).over(done.fitted.scale_rad)[0]
    off = np.abs(rows @ np.array(done.fitted.weights_Nm) - hard(x, False)).max()
    assert off < 0.08 * np.abs(hard(x, False)).max()


def test_softening_that_amplitudes_show_is_found(tmp_path):
    """0.05, then 0.1 rad: the memory grows, and the fit tells it from a stiffer spring."""
    done = identify_member(rig(tmp_path, (0.05, 0.1), softens=True), "stops, strain")
    assert "not seen" not in "\n".join(done.notes)
    soft = sum(w for w, t in done.fitted.used if t.kind == "spring" and t.softening)
    plain = sum(w for w, t in done.fitted.used if t.kind == "spring" and not t.softening)
    assert soft == pytest.approx(12 * 0.1 + 300 * 0.1**3, rel=0.05)
    assert plain < 0.05 * soft


def test_a_stop_that_never_slips_is_a_spring(tmp_path):
    recordings = load_recordings(load_mapping(rig(tmp_path, (0.05, 0.1))))
    form = next(m for m in members() if m.name == "stops")
    terms = UnitTerms(form, recordings, PER)
    fitted = fit_member(terms, recordings, 2.0)
    twins = not_seen(terms, recordings, fitted)
    text = {form.terms[i].text: form.terms[k].text for i, k in twins.items()}
    assert text["stop of x, threshold 1.1"] == "spring of x"
    assert all(fitted.weights_Nm[i] == 0 < fitted.weights_Nm[k] for i, k in twins.items())
    (note,) = told_apart_notes(fitted, twins, {})
    assert "stop of x, threshold 1.1 (spring of x)" in note


# A direction that no row determines.


def cycled(conditions: int) -> tuple[np.ndarray, FitRows]:
    """Four cycles of a hundred rows in each condition: x, and the blocks."""
    x = np.tile(np.sin(2 * np.pi * np.arange(400) / 100), conditions)
    ways = np.split(np.sign(np.gradient(x)), conditions)
    return x, FitRows.of([(i, 4, w) for i, w in enumerate(ways)])


def noisy(j: np.ndarray, rows: FitRows, seed: int):
    """Error of a fit to noise of 0.1 Nm, and what is said of it."""
    noise = np.random.default_rng(seed).normal(0, 0.1, len(j))
    fit = np.linalg.lstsq(j, noise, rcond=None)[0]
    return fit, resampled(j, noise - j @ fit, np.ones(len(j)), rows, True)


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_weights_that_no_row_tells_apart_are_infinite(unit):
    """x twice, once scaled, and its cube: the sum of two weights is known, neither is."""
    x, rows = cycled(4)
    _, alone = noisy(np.column_stack([x, x**3]), rows, 1)
    _, found = noisy(np.column_stack([x, 0.3 * unit * x, x**3]), rows, 1)
    assert np.isinf(found.sigma[:2]).all()
    assert found.sigma[2] == pytest.approx(alone.sigma[1], rel=1e-6)
    assert found.band_Nm == pytest.approx(alone.band_Nm, rel=1e-6)
    _, none = noisy(np.column_stack([x, np.zeros(len(x))]), rows, 1)
    assert np.isfinite(none.sigma[0])
    assert np.isinf(none.sigma[1])


@pytest.mark.parametrize("grown", [(0, 0, 1, 1), (0, 0, 0, 1)])
def test_softening_that_is_hardly_seen_has_a_wide_interval(grown):
    """The memory grows by 1 % in two of four conditions, or in one, which then alone tells it.

    The scatter of the fits is the independent number; their deviation by the normal equations is
    0.1 Nm over the column's part across the other, worked out below.
    """
    x, rows = cycled(4)
    memory = np.where(np.repeat(grown, 400) == 1, 1.0, 0.99)
    j = np.column_stack([x, x / (1 + memory / 0.3)])
    across = j[:, 1] - x * (x @ j[:, 1]) / (x @ x)
    plain = 0.1 / np.linalg.norm(across)
    assert plain > 3  # Nm: hardly seen
    both = [noisy(j, rows, seed) for seed in range(40)]
    errors, said = (np.array([v[k] for v in both], dtype=object) for k in (0, 1))
    errors = np.array([e[1] for e in errors])
    said = np.array([s.sigma[1] for s in said])
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(plain, rel=0.3)
    assert np.sqrt(np.mean(errors**2) / np.mean(said**2)) == pytest.approx(1.0, abs=0.25)


def test_a_weight_that_is_not_determined_is_assumed():
    """Nor one whose deviation is as large as itself, or that is at its bound (no deviation)."""
    rise = Rise("power", 1)
    spring = (Term("spring", rise), *(Term("stop", rise, (r,)) for r in (3.0, 1.0, 0.5)))
    fitted = FittedMember(Member("four", "four", spring), 0.1, (1.0, 2.0, 0.3, 0.04))
    sigma = {0: 0.01, 1: np.inf, 2: 0.31, 3: None}
    first, *others = (t.weight_Nm for t in family_section(fitted, "rig.csv", sigma=sigma).terms)
    assert first.status == "identified"
    assert "standard deviation 0.01" in first.source
    assert {o.status for o in others} == {"assumed"}
    for other, why in zip(others, ("not determined", "deviation 0.31", "lower bound"), strict=True):
        assert why in other.source
    (note,) = told_apart_notes(fitted, {}, sigma)
    assert "infinite" in note
    assert spring[1].text in note
    assert spring[0].text not in note


# The change a kelvin.

FORM = Member(
    "three",
    "three",
    (Term("spring", Rise("power", 1)), Term("spring", Rise("power", 3)), Term("offset")),
)
USES = {
    "two": {15.0: "cycles", 31.0: "train"},
    # Without the file at 15 degC there are 0.2 K, without that at 31 there is 1 K: that tells none.
    "hot": {15.0: "train", 31.0: "train", 31.2: "train", 20.0: "held_out"},
    "cold": {15.0: "train", 16.0: "train", 31.0: "train", 20.0: "held_out"},
    "three": THREE,
}


def kelvins(folder: Path, uses: dict[float, str], seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the change a kelvin over other noise, and the deviations said."""
    recordings = load_recordings(load_mapping(recorded(folder, uses, law=springs, noise_Nm=0)))
    terms = UnitTerms(FORM, recordings, PER)
    _, theta = motion()
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        made = [
            replace(
                r, tau_Nm=springs(theta, r.temperature_C, -0.004) + rng.normal(0, 0.05, len(theta))
            )
            for r in recordings
        ]
        fitted = fit_member(terms, made, 3.0)
        factor, (_, spread) = fitted.temperature, member_spread(terms, made, fitted, 3.0)
        truth = -0.004 / (1 - 0.004 * (factor.reference_C - 23))
        found.append((factor.per_K - truth, spread.sigma[-1]))
    return tuple(np.array(found).T)


@pytest.mark.parametrize("uses", USES.values(), ids=USES)
def test_the_interval_of_the_change_a_kelvin_is_as_wide_as_its_error(tmp_path, uses):
    """With two temperatures one condition left out leaves one: that is no deviation."""
    error, said = kelvins(tmp_path, uses, range(20))
    assert 0.6 < np.sqrt(np.mean((error / said) ** 2)) < 1.6
    assert 0.6 < np.sqrt(np.mean(error**2) / np.mean(said**2)) < 1.6


def test_a_change_at_the_end_of_the_search_is_called_out(tmp_path):
    """A rubber that loses 9 % a kelvin: the factor would be below 0.2."""
    recordings = load_recordings(load_mapping(recorded(tmp_path, THREE, -0.09, law=springs)))
    fitted = fit_member(UnitTerms(FORM, recordings, PER), recordings, 3.0)
    factor = fitted.temperature
    assert "at the low end of its search" in "\n".join(temperature_notes(recordings, factor, 1e-4))
    inside = TemperatureFactor(23.0, 0.9 * factor.per_K, 15.0, 31.0)
    assert "end of its search" not in "\n".join(temperature_notes(recordings, inside, 1e-4))
    device = drafted_member(load_mapping(tmp_path / "map.toml"), recordings, fitted, None, 1e-4)
    source = device.file.family.temperature.per_K.source
    assert "at the low end of its search" in source
    assert "standard deviation" not in source


def test_the_result_is_json_where_a_number_is_not_determined(tmp_path):
    done = identify_member(rig(tmp_path, (0.05, 0.1)), "stops")
    first, *rest = done.sigma
    unknown = replace(done, sigma={first: np.inf, **{k: done.sigma[k] for k in rest}})
    told = json.loads(json.dumps(unknown.to_dict(), allow_nan=False))
    assert told["model"]["terms"][0]["sigma_Nm"] is None
    assert told["model"]["terms"][1]["sigma_Nm"] == done.sigma[rest[0]]


# The torque's band.


def test_what_is_left_out_is_judged_by_a_fit_that_keeps_the_bounds():
    """Without the largest amplitude the cube would fall below 0: refits by another solver."""
    x, _ = cycled(4)
    x = x * np.repeat([0.3, 0.31, 0.32, 1.0], 400)
    rows = FitRows.of([(i, 4, w) for i, w in enumerate(np.split(np.sign(np.gradient(x)), 4))])
    j = np.column_stack([x, x**3])
    y = 2 * np.tanh(2 * x) / 2 + 1.5 * x**5  # softer first, then harder
    fit = np.linalg.lstsq(j, y, rcond=None)[0]
    assert fit.min() > 0
    outside, least = np.zeros(len(x)), []
    for k in range(4):
        out = rows.condition == k
        outside[out] = (y - j @ nnls(j[~out], y[~out])[0])[out]
        least.append(np.linalg.lstsq(j[~out], y[~out], rcond=None)[0].min())
    assert min(least) < -0.5  # what no fit of the model would give
    room = -fit, np.full(2, np.inf)
    found = resampled(j, y - j @ fit, np.ones(len(x)), rows, True, room)
    np.testing.assert_allclose(found.outside_Nm, outside, atol=1e-9)
    free = resampled(j, y - j @ fit, np.ones(len(x)), rows, True)
    assert free.band_Nm > 1.5 * found.band_Nm
    np.testing.assert_array_equal(free.covariance, found.covariance)
