"""Fit of lag, backlash and dead zone on recordings with known values.

The recordings are made on a grid twenty times as fine, by a rubber of stops and a gap of two flanks
that are this file's own.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.identify import identify, load_mapping, load_recordings
from esea_gen.identify.family.identification import identify_member
from esea_gen.identify.recording.reading import beyond_rad, followed_rad
from tests import rigs
from tests.result_schemas import held
from tests.rigs import changed, table

PER, FINE = 100, 20  # samples a cycle, steps a sample
MAPPING = changed(
    (
        "schema = 1\n",
        'schema = 1\nfull_scale_Nm = { value = 3.0, status = "assumed", source = "r" }\n',
    ),
    ("[[recording]]", "[cycles]\nhold_out_last = 1\n[search]\npopulation = 16\n[[recording]]"),
    ("rig.csv", "*.csv"),
)
LAG = "[torque]", '[torque]\nlag_s = "fit"'
BACKLASH = "[deflection]", '[deflection]\nbacklash_rad = "fit"'
DEAD = "[deflection]", '[deflection]\ndead_zone_rad = "fit"'
Rubber = Callable[[np.ndarray], np.ndarray]
Samples = tuple[np.ndarray, np.ndarray, np.ndarray]


def stops(x: np.ndarray, weights: dict[float, float]) -> np.ndarray:
    """A spring and stops, each by how far it is strained: weight by threshold."""
    y = 20 * x + 500 * x**3
    for r, w in weights.items():
        strain, rows = 0.0, []
        for step in np.diff(x, prepend=x[0]):
            strain = max(-r, min(r, strain + step))
            rows.append(strain)
        y = y + w * np.array(rows)
    return y


def member_rubber(x: np.ndarray) -> np.ndarray:
    # Two thresholds of the member "stops", as its own are of the largest deflection.
    return stops(x, {0.007: 8.0, 0.03: 5.0})


def published_rubber(x: np.ndarray) -> np.ndarray:
    return stops(x, {0.012 * i: 30 * np.exp(-60 * 0.012 * i) for i in range(1, 11)})


def springy_rubber(x: np.ndarray) -> np.ndarray:
    # With so little loss the gate sees the dead zone: there is next to no torque in it.
    return stops(x, {0.012 * i: 0.5 * np.exp(-60 * 0.012 * i) for i in range(1, 11)})


def behind_flanks(x: np.ndarray, gap: float) -> np.ndarray:
    """What one of two flanks, a gap apart, pushes along."""
    left, rows = x[0] - gap / 2, []
    for v in x:
        if v < left:
            left = v
        elif v > left + gap:
            left = v - gap
        rows.append(left + gap / 2)
    return np.array(rows)


def recorded(
    hz: float,
    seed: int,
    *,
    lag_s: float = 0.0,
    gap: float = 0.0,
    dead: float = 0.0,
    amplitude: float = 0.1,
    rubber: Rubber = member_rubber,
) -> Samples:
    """Four cycles of a sine; noise of 0.2 % of the largest torque."""
    t = np.arange(4 * PER * FINE + 1) / (PER * FINE * hz)
    x = amplitude * np.sin(2 * np.pi * hz * t)
    own = behind_flanks(x, gap)
    own = np.where(own > dead, own - dead, np.where(own < -dead, own + dead, 0.0))
    y = np.interp(t - lag_s, t, rubber(own))[::FINE]
    noise = np.random.default_rng(seed).normal(0, 0.002 * np.abs(y).max(), len(y))
    return t[::FINE], x[::FINE], y + noise


def two_rates(seed: int, **more: float) -> list[Samples]:
    return [recorded(0.1, seed, **more), recorded(1.0, seed + 50, **more)]


def two_sizes(seed: int, **more: float | Rubber) -> list[Samples]:
    return [recorded(1.0, seed, **more), recorded(1.0, seed + 50, amplitude=0.05, **more)]


def written(folder: Path, recordings: list[Samples], *changes: tuple[str, str]) -> Path:
    for i, columns in enumerate(recordings):
        (folder / f"r{i}.csv").write_text(table(*columns))
    return mapped(folder, *changes)


def mapped(folder: Path, *changes: tuple[str, str]) -> Path:
    return rigs.mapped(folder, *changes, text=MAPPING)


# Lag.


@pytest.mark.parametrize("lag_ms", [12, -8])
def test_a_lag_is_found_between_two_rates_and_taken_out(tmp_path, lag_ms):
    result = identify_member(written(tmp_path, two_rates(1, lag_s=lag_ms / 1000), LAG), "stops")
    (n,) = result.channels
    assert abs(n.found - lag_ms / 1000) < min(0.001, 2 * n.sigma)
    assert n.sigma < 0.001
    row = result.to_dict()["channels"][0]
    assert (row["key"], row["value"], row["status"]) == ("torque.lag_s", n.found, "identified")
    some = {k: result.to_dict()[k] for k in ("channels", "notes", "simulated")}
    held("identify", {"schema": "identify", "schema_version": 1, "tool_version": "0"} | some)
    # The torque of the quick recording stands where it would without a lag: 1 ms is 0.02 Nm.
    fine = np.arange(4 * PER * FINE + 1) / (PER * FINE)
    true = member_rubber(0.1 * np.sin(2 * np.pi * fine))
    r = result.recordings[1]
    dropped_s = 4.0 - r.time_s[-1]
    assert dropped_s == pytest.approx(0.02 if lag_ms > 0 else 0.01)
    wanted = np.interp(r.time_s + (0 if lag_ms > 0 else dropped_s), fine, true)
    assert np.sqrt(np.mean((r.tau_Nm - wanted)[PER:] ** 2)) < 0.01
    assert "lag of" in dict(result.device.quantities())["family.scale_rad"].source
    assert "the identified lag too small" in "".join(result.notes)


def test_without_a_lag_none_is_taken_and_nothing_changes(tmp_path):
    result = identify_member(written(tmp_path, two_rates(1), LAG), "stops")
    (n,) = result.channels
    assert abs(n.found) < min(0.001, 2 * n.sigma)
    assert n.sigma < 0.001
    assert (n.value, n.why) == (0.0, "not seen beyond two deviations")
    plain = identify_member(mapped(tmp_path), "stops")
    assert result.toml() == plain.toml()
    assert "channels" not in plain.to_dict()
    assert len(result.notes) == len(plain.notes) + 1


def test_one_quick_condition_of_three_tells_a_lag(tmp_path):
    """Left out, it would leave one rate, at which any lag would do."""
    made = [*two_rates(2, lag_s=0.012), recorded(0.1, 5, lag_s=0.012, amplitude=0.05)]
    (n,) = identify_member(written(tmp_path, made, LAG), "stops").channels
    assert abs(n.found - 0.012) < min(0.001, 2 * n.sigma)
    assert n.sigma < 0.001


@pytest.mark.ci
def test_the_published_models_search_finds_a_lag(tmp_path):
    both = two_rates(3, lag_s=0.012, rubber=published_rubber)
    (n,) = identify(written(tmp_path, both, LAG)).channels
    assert abs(n.found - 0.012) < min(0.001, 2 * n.sigma)


def test_what_is_held_out_has_no_part_in_the_lag(tmp_path):
    """The last cycle judges: its torque is put 60 ms later."""
    good = two_rates(1, lag_s=0.012)
    (n,) = identify_member(written(tmp_path, good, LAG), "stops").channels
    bad = []
    for t, x, y in good:
        # From the third upper reversal on, at 2 1/4 of four cycles, the held-out cycle goes.
        last = np.flatnonzero(t > t[-1] * 2.25 / 4 + 1e-9)
        late = y.copy()
        late[last] = np.interp(t[last] - 0.06, t, y)
        bad.append((t, x, late))
    (m,) = identify_member(written(tmp_path, bad, LAG), "stops").channels
    assert m.found == pytest.approx(n.found, abs=1e-12)
    assert m.sigma == pytest.approx(n.sigma, rel=1e-9)


@pytest.mark.ci
def test_loss_that_the_model_lacks_is_no_lag_if_it_is_alike_at_every_rate(tmp_path):
    """An ellipse, which no sum of stops draws: the torque leads by 0.15 rad at both rates.

    Without the share of a cycle beside the lag, 0.26 ms were found.
    """
    made = []
    for hz, seed in ((0.1, 1), (1.0, 2)):
        t, x, _ = recorded(hz, seed)
        angle = 2 * np.pi * hz * t
        y = 2 * np.sin(angle + 0.15) + 0.5 * np.sin(angle) ** 3
        made.append((t, x, y + np.random.default_rng(seed).normal(0, 0.004, len(t))))
    (n,) = identify_member(written(tmp_path, made, LAG), "stops").channels
    assert abs(n.found) < 1e-4


def not_taken(folder: Path, recordings: list[Samples], *changes: tuple[str, str]) -> str:
    result = identify_member(written(folder, recordings, LAG, *changes), "stops")
    (n,) = result.channels
    assert (n.value, n.to_dict()["status"]) == (0.0, "assumed")
    assert n.why is not None
    assert n.note in result.notes
    old = MAPPING.replace(*LAG)
    for a, b in changes:
        old = old.replace(a, b, 1)
    (folder / "map.toml").write_text(old.replace('lag_s = "fit"', ""))
    assert result.toml() == identify_member(folder / "map.toml", "stops").toml()
    return n.why


@pytest.mark.ci
def test_what_cannot_tell_a_lag_from_loss_is_said(tmp_path):
    late = {"lag_s": 0.012}
    one_rate = [recorded(1.0, 1, **late), recorded(1.0, 2, amplitude=0.05, **late)]
    assert "last 1 to 1 s, below a factor of 2" in not_taken(tmp_path, one_rate)
    # As long as the other's are short, at one speed.
    one_speed = [recorded(1.0, 1, **late), recorded(2.0, 2, amplitude=0.05, **late)]
    assert "move at 0.4 to 0.4 rad/s" in not_taken(tmp_path, one_speed)
    period = 'period_s = { value = 0.01, status = "assumed", source = "why" }'
    no_clock = ('time_column = "t"', period)
    assert "no time was recorded" in not_taken(tmp_path, two_rates(1), no_clock)
    # An eighth of the shortest cycle is the bound.
    assert "bound of the search, 125 ms" in not_taken(tmp_path, two_rates(1, lag_s=0.14))


# Backlash.


def test_a_backlash_is_found_and_taken_out(tmp_path):
    result = identify_member(written(tmp_path, two_sizes(1, gap=0.003), BACKLASH), "stops")
    (n,) = result.channels
    assert n.found == pytest.approx(0.003, rel=0.05)
    assert abs(n.found - 0.003) < 2 * n.sigma
    # What the rubber's model trains on, and what judges it, is the deflection behind the gap.
    r = result.recordings[0]
    assert np.abs(r.theta_rad - behind_flanks(recorded(1.0, 0)[1], 0.003)).max() < 0.05 * 0.003
    assert result.to_dict()["mean_rms"]["held_out_percent"] < 0.25
    # Whose encoders see the gap, measures with it: the numbers are not identified.
    weight = dict(result.device.quantities())["family.terms[0].weight_Nm"]
    assert weight.status == "assumed"
    assert "backlash taken out" in weight.source


@pytest.mark.ci
def test_a_lag_and_a_backlash_are_told_apart(tmp_path):
    off = {"lag_s": 0.012, "gap": 0.003}
    made = two_rates(4, **off)
    made += [recorded(hz, 9, amplitude=0.05, **off) for hz in (0.1, 1.0)]
    lag, gap = identify_member(written(tmp_path, made, BACKLASH, LAG), "stops").channels
    assert (lag.key, gap.key) == ("torque.lag_s", "deflection.backlash_rad")
    assert abs(lag.found - 0.012) < min(0.001, 2 * lag.sigma)
    assert abs(gap.found - 0.003) < min(0.00015, 2 * gap.sigma)


def test_behind_a_gap_and_beyond_a_dead_zone():
    x = np.array([0.0, 1, 3, 2, 1, 0, -1, 0, 2])
    np.testing.assert_allclose(followed_rad(x, 2.0), [0, 0, 2, 2, 2, 1, 0, 0, 1])
    np.testing.assert_array_equal(followed_rad(x, 0.0), x)
    np.testing.assert_allclose(beyond_rad(x, 1.5), [0, 0, 1.5, 0.5, 0, 0, 0, 0, 0.5])


# Dead zone.


@pytest.mark.ci
def test_a_dead_zone_is_found_and_stands_in_the_device_file(tmp_path):
    made = [
        recorded(1.0, i, amplitude=a, dead=0.02, rubber=springy_rubber)
        for i, a in ((1, 0.1), (2, 0.08))
    ]
    path = written(tmp_path, made, DEAD)
    (tmp_path / "none.toml").write_text(MAPPING)
    plain = load_recordings(load_mapping(tmp_path / "none.toml"))
    assert {f.kind for r in plain for f in r.findings} == {"backlash"}
    result = identify(path)
    (n,) = result.channels
    assert n.found == pytest.approx(0.02, rel=0.05)
    assert abs(n.found - 0.02) < 2 * n.sigma
    # The device measures through it; its C is judged on the deflection as it was recorded.
    load_device(result.write(tmp_path / "out"))
    rubber = result.device.elastomer
    assert (rubber.dead_zone_rad.value, rubber.dead_zone_rad.status) == (n.value, "identified")
    assert rubber.k1_Nm_rad.status == "identified"
    assert np.array_equal(result.recordings[0].theta_rad, plain[0].theta_rad)
    assert result.to_dict()["mean_rms"]["held_out_percent"] < 0.35


# What is refused.


def test_what_only_the_fit_finds_is_refused_elsewhere(tmp_path):
    path = written(tmp_path, two_sizes(1), LAG)
    with pytest.raises(UserError, match=r"torque\.lag_s = 'fit' works with esea-gen identify"):
        load_recordings(load_mapping(path))
    with pytest.raises(UserError, match=r"the model 'stops' has no dead zone"):
        identify_member(mapped(tmp_path, DEAD), "stops")
