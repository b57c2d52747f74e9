"""What an identification tells its reader: every note where it applies, with its numbers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify.notes import band_notes, notes_of
from esea_gen.identify.published.parameters import bounds_of

VALUES = {
    "k1_Nm_rad": 10.0,
    "alpha_Nm_rad": 3.0,
    "omega_rad": 0.01,
    "kv_Nm_rad": 5.0,
    "eps2": 0.0131,
}


def verdict_of(rms_Nm=0.05, asymmetry=(0.02,), softening=(None,)):
    sets = [
        (SimpleNamespace(asymmetry=a, softening=s), None, None)
        for a, s in zip(asymmetry, softening * len(asymmetry), strict=False)
    ]
    return SimpleNamespace(misfits=SimpleNamespace(sets=sets, mean_rms=lambda held_out: rms_Nm))


def recording(dropped=0, gap_s=0.01, timed=True):
    times = np.cumsum([0.0, *[0.01] * 97, gap_s])
    theta = 0.2 * np.sin(np.arange(99) / 5)
    return SimpleNamespace(
        label="one",
        dropped=dropped,
        time_s=times,
        theta_rad=theta,
        timed=timed,
        temperature_C=None,
    )


def told(
    values=VALUES,
    sigma=None,
    recordings=None,
    verdict=None,
    pair=None,
    edges=(),
    rate_dropped=False,
):
    """All notes in one text."""
    mapping = SimpleNamespace(sampling=SimpleNamespace(min_step_s=0.002))
    fit = SimpleNamespace(values=values, rate_dropped=rate_dropped, edges=edges)
    return "\n".join(
        notes_of(
            SimpleNamespace(mapping=mapping),
            recordings or [recording()],
            fit,
            SimpleNamespace(sigma=sigma or {}),
            verdict or verdict_of(),
            pair,
        )
    )


@pytest.fixture(autouse=True)
def _known_scales(monkeypatch):
    monkeypatch.setattr("esea_gen.identify.notes.largest_torque", lambda source, recordings: 4.0)
    monkeypatch.setattr("esea_gen.identify.notes.scales_assumed", lambda source: False)


@pytest.mark.parametrize(
    ("worst", "side"), [(0.049, "within"), (-0.049, "within"), (0.051, "above"), (-0.3, "above")]
)
def test_asymmetry_is_judged_by_the_worst_of_all_sets_against_5_percent(worst, side):
    text = told(verdict=verdict_of(asymmetry=(0.01, worst, None)))
    assert f"up to {100 * worst:+.1f} %, {side} our limit of 5 %" in text
    assert "one side only" not in text


def test_one_sided_loading_and_softening():
    text = told(verdict=verdict_of(asymmetry=(None,)))
    assert "Loaded to one side only" in text
    assert "our limit" not in text
    assert "Mullins" not in text
    text = told(verdict=verdict_of(asymmetry=(0.0, 0.0, 0.0), softening=(0.1, 0.25, None)))
    assert "up to 25 % less work" in text
    text = told(verdict=verdict_of(asymmetry=(0.0,), softening=(0.0101,)))
    assert "up to 1 % less work" in text
    text = told(verdict=verdict_of(asymmetry=(0.0, 0.0), softening=(-0.004, 0.009)))
    assert "none seen, no block's last cycle loses 1 % less work than its first" in text
    assert "up to" not in text.split("scragging")[1].split("\n")[0]


@pytest.mark.parametrize(
    ("rms_Nm", "verdict"),
    [
        (0.08, "the rate terms help"),
        (0.05, "the rate terms do not help, and are left out"),
        (0.04, "the rate terms do not help, and are left out"),
    ],
)
def test_what_the_rate_terms_are_worth_in_per_cent_of_full_scale(rms_Nm, verdict):
    text = told(pair=(verdict_of(rms_Nm), verdict_of(0.05)))
    assert f"element {100 * rms_Nm / 4:.2f} %, with it 1.25 % of full scale" in text
    assert verdict in text
    assert "Held-out error without" not in told()
    assert "Held-out error without" not in told(pair=(verdict_of(rms_Nm),) * 2, rate_dropped=True)


def test_why_there_are_no_rate_terms():
    without = {k: v for k, v in VALUES.items() if k != "kv_Nm_rad"}
    assert "eps2 is fixed at 0.0131" in told()
    assert "no stiffness, so it is left out" in told(without, rate_dropped=True)
    assert "no time was recorded" in told(without, recordings=[recording(), recording(timed=False)])
    assert "rate_terms = false" in told(without)
    assert "as good or better" in told(without, pair=(verdict_of(),) * 2)
    assert "marked assumed too" in told(recordings=[recording(timed=False)])
    assert "marked assumed too" not in told()


def test_samples_that_are_missing_are_counted():
    two = [recording(dropped=2), recording(dropped=1)]
    assert "3 of 201 samples dropped by sampling.min_step_s = 0.002 s" in told(recordings=two)
    text = told()
    assert "dropped" not in text
    assert "gap" not in text
    assert "one: the largest gap between samples is 0.11 s" in told(
        recordings=[recording(gap_s=0.11)]
    )
    assert "gap" not in told(recordings=[recording(gap_s=0.09)])


@pytest.mark.parametrize(
    ("sigma", "said"), [(4.9, ""), (5.1, "deviation 5.1"), (np.inf, "deviation infinite")]
)
def test_what_is_known_to_half_of_itself_only_is_called_out(sigma, said):
    text = told(sigma={"k1_Nm_rad": sigma})
    assert ("k1_Nm_rad = 10 is poorly determined" in text) == bool(said)
    assert said in text


def test_bounds_and_edges():
    high = bounds_of("k1_Nm_rad")[1]
    text = told(VALUES | {"k1_Nm_rad": high}, sigma={"k1_Nm_rad": 9 * high}, edges=["omega is low"])
    assert f"k1_Nm_rad = {high:.4g} is at its upper bound" in text
    assert "poorly" not in text
    assert "Omega is low." in text


def test_the_band_is_told_in_percent_of_full_scale_and_beside_what_was_held_out():
    r = SimpleNamespace(label="one", tau_Nm=np.zeros(5), sets=[SimpleNamespace(held_out=[0, 2, 4])])
    verdict = SimpleNamespace(torque_Nm={"one": np.array([0.01, 9.0, -0.02, 9.0, 0.4])})
    spread = SimpleNamespace(band_Nm=0.396, friction_Nm=None)
    assert band_notes([r], verdict, spread, 4.0) == [
        "Torque: 95 % of errors in blocks left out are below 0.396 Nm (9.9 % of full scale); of "
        "the held-out samples 67 % are."
    ]
