"""What trains, what judges, what counts as loose, and the models from elsewhere, in closed form."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify.family import compare, peers
from esea_gen.identify.family.members import members
from esea_gen.identify.recording.cycles import Cycle, data_sets
from esea_gen.identify.recording.quality import backlash_rad, offset_Nm
from esea_gen.identify.recording.resampling import whole_conditions


def recording(time_s, theta, tau, *sets):
    found = [SimpleNamespace(training=np.array(a, int), held_out=np.array(b, int)) for a, b in sets]
    return SimpleNamespace(
        time_s=np.asarray(time_s, float), theta_rad=theta, tau_Nm=tau, sets=tuple(found)
    )


def test_whole_conditions_judge_where_no_set_does_both():
    both, only, judged = ([0, 1], [2]), ([0, 1], []), ([], [0, 1])
    x = np.zeros(3)
    for sets, whole in (
        ([[both]], False),
        ([[only], [judged]], True),
        ([[only, judged]], True),
        ([[only], [judged, both]], False),
        ([[only]], True),
    ):
        assert whole_conditions([recording(x, x, x, *s) for s in sets]) == whole


def test_the_amplitude_of_a_file_without_cycles_is_half_its_range():
    theta = np.linspace(-0.1, 0.3, 50)
    (found,) = data_sets("rig", theta, theta, (), "train")
    assert found.amplitude_rad == pytest.approx(0.2)
    cycles = tuple(Cycle(0, 9, a, 0, "training") for a in (0.1, 0.13, 0.4))
    (found,) = data_sets("rig", theta, theta, cycles, "train")
    assert found.amplitude_rad == pytest.approx(0.13)
    assert found.work_first_J is None


# A joint with play: no torque inside, a spring outside.  60 samples a quarter of a cycle.
QUARTER, REACH, STIFF = 60, 0.2, 20.0


def loose(play_rad: float, start: int = 0) -> tuple[np.ndarray, np.ndarray, list[Cycle]]:
    turn = np.arange(start, start + 8 * QUARTER + 1) * 0.5 * np.pi / QUARTER
    theta = REACH * 2 / np.pi * np.arcsin(np.sin(turn))  # a triangle
    tau = STIFF * np.sign(theta) * np.maximum(np.abs(theta) - play_rad / 2, 0)
    marks = [4 * QUARTER * k for k in range(3)]
    return theta, tau, [Cycle(a, b, REACH, 0, "training") for a, b in pairwise(marks)]


@pytest.mark.parametrize("start", [0, 7, QUARTER, 2 * QUARTER + 20])
def test_play_is_measured_wherever_a_cycle_starts(start):
    step = REACH / QUARTER
    for play in (0.04, 0.08):
        theta, tau, cycles = loose(play, start)
        found = backlash_rad(theta, tau, float(np.abs(tau).max()), cycles)
        assert found == pytest.approx(play, abs=2 * step)
    theta, tau, cycles = loose(0.0, start)
    assert backlash_rad(theta, tau, float(np.abs(tau).max()), cycles) == 0


def test_a_rest_at_an_end_of_the_record_is_no_play():
    """Loose there, and of the other sign at the other end: yet nothing passes through zero."""
    theta = np.concatenate([np.linspace(0.05, 0.06, 12), np.linspace(0.06, 0.2, 40)])
    tau = np.where(np.arange(52) < 12, 0.0, STIFF * (theta - 0.06))
    for sign in (1.0, -1.0):
        y = tau.copy()
        y[-1] = sign * y[-1]
        for way in (slice(None), slice(None, None, -1)):
            cycle = [Cycle(0, 51, 0.1, 0, "training")]
            assert backlash_rad(theta[way], y[way], 2.0, cycle) == 0


@pytest.mark.parametrize("offset", [-0.3, 0.0, 0.7])
def test_an_offset_is_found_beside_a_lossy_and_uneven_spring(offset):
    turn = np.linspace(0, 6 * np.pi, 1801)
    theta = 0.2 * np.sin(turn)
    tau = 8 * theta + 90 * theta**3 + 3 * theta * np.abs(theta) + 0.5 * np.cos(turn) + offset
    # The direction of the deflection is taken over five samples: at the turns it lags a little.
    assert offset_Nm(theta, tau) == pytest.approx(offset, abs=2e-3)
    # Of a side that is hardly reached there is no middle: a fifth of the other is the least.
    assert offset_Nm(theta + 0.13, tau) is not None
    assert offset_Nm(theta + 0.137, tau) is None
    assert offset_Nm(np.abs(theta), tau) is None


def test_errors_of_a_peer_are_its_torque_less_what_was_measured():
    x = np.arange(4.0)
    r = recording(x, x, np.array([1.0, 2.0, 3.0, 4.0]), ([0, 1], [2, 3]))
    found = compare._errors([r], [np.array([1.0, 2.0, 3.5, 3.5])])
    assert (found.mean_rms(False), found.mean_rms(True)) == (0, 0.5)


def test_a_peer_is_fitted_to_what_trains_at_its_own_samples(monkeypatch):
    """Its columns in closed form: one that is 1 at the first sample alone, and one that grows."""
    asked = []

    def columns(shape, t, x):
        asked.append((shape.copy(), t, x))
        first = np.zeros(len(x))
        first[0] = 1.0
        return np.stack([x * shape[0], first], axis=1)

    low, high = np.array([0.5]), np.array([2.0])
    monkeypatch.setitem(peers.PEERS, "made up", (columns, low, high))
    n = 60
    t = np.arange(n) * 0.01
    theta = 0.1 * np.sin(0.3 * np.arange(n))
    trained = np.arange(30)
    scale = float(np.abs(theta[trained]).max())
    tau = 7 * theta / scale
    tau[0] += 3.0
    tau[30:] = 99.0  # of what is held out nothing may be known
    r = recording(t, theta, tau, (trained, np.arange(30, n)))
    (torque,) = peers.fit_peer("made up", [r], 1)
    np.testing.assert_allclose(torque[:30], tau[:30], atol=1e-9)
    np.testing.assert_allclose(torque[30:], 7 * theta[30:] / scale, atol=1e-9)
    for shape, grid, x in asked:
        assert low <= shape <= high
        np.testing.assert_allclose(grid, t, atol=1e-12)
        np.testing.assert_allclose(x, theta / scale, atol=1e-12)
    # A long recording is thinned to a grid over all of it.
    asked.clear()
    n = peers.MOST_SAMPLES + 501
    t = np.arange(n) * 0.01
    theta = 0.1 * np.sin(0.01 * np.arange(n))
    r = recording(t, theta, 7 * theta, (np.arange(n), []))
    (torque,) = peers.fit_peer("made up", [r], 1)
    assert np.abs(torque - 7 * theta).max() < 1e-3
    _, grid, _ = asked[0]
    assert (len(grid), grid[0], grid[-1]) == (peers.MOST_SAMPLES, 0, pytest.approx(t[-1]))


def test_members_have_the_names_that_the_command_takes():
    """As the documentation and mapping files call them; what each is made of, by its title."""
    names = ["stops", "slips", "Maxwell", "fractional"]
    soft = [f"{n}, strain" for n in names] + ["stops, worn", "slips, worn"]
    more = ["slips, worn, offset", "stops, Maxwell, offset", "stops, sides, offset"]
    found = {m.name: m for m in members()}
    assert sorted(found) == sorted([*names, *soft, *more])
    for name, m in found.items():
        kinds = {t.kind for t in m.terms}
        has = {"stops": "stop", "slips": "slip", "Maxwell": "maxwell", "fractional": "maxwell"}
        assert {has[w] for w in name.split(", ") if w in has} <= kinds
        assert ("offset" in kinds) == name.endswith("offset")
        softened = any(w in name for w in ("strain", "worn"))
        assert any(t.softening for t in m.terms) == softened
        assert ("path" in {t.softening.kind for t in m.terms if t.softening}) == ("worn" in name)
        assert "spring" in kinds
