"""What an identification tells its reader: every note where it applies, with its numbers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify.notes import band_notes, notes_of
from esea_gen.identify.published.space import bounds_of

VALUES = {
    "k1_Nm_rad": 10.0,
    "alpha_Nm_rad": 3.0,
    "omega_rad": 0.01,
    "kv_Nm_rad": 5.0,
    "eps2": 0.0131,
}
WITHOUT = {k: v for k, v in VALUES.items() if k != "kv_Nm_rad"}
HIGH = bounds_of("k1_Nm_rad")[1]


def verdict_of(rms_Nm=0.05, asymmetry=(0.02,), softening=(None,)):
    sets = [
        (SimpleNamespace(asymmetry=a, softening=s), None, None)
        for a, s in zip(asymmetry, softening * len(asymmetry), strict=False)
    ]
    return SimpleNamespace(misfits=SimpleNamespace(sets=sets, mean_rms=lambda held_out: rms_Nm))


def recording(dropped=0, gap_s=0.01, timed=True):
    times = np.cumsum([0.0, *[0.01] * 97, gap_s])
    theta = 0.2 * np.sin(np.arange(99) / 5)
    facts = {"dropped": dropped, "timed": timed, "temperature_C": None}
    return SimpleNamespace(label="one", time_s=times, theta_rad=theta, tau_Nm=20 * theta, **facts)


def told(values=VALUES, sigma=None, recordings=None, verdict=None, pair=None, **fit):
    """All notes in one text; full scale is 4 Nm."""
    tables = {
        "sampling": SimpleNamespace(min_step_s=0.002),
        "full_scale_Nm": SimpleNamespace(value=4.0),
        "deflection": SimpleNamespace(scale_rad_per_m=None),
        "torque": SimpleNamespace(scale_Nm_per_N=None),
    }
    source = SimpleNamespace(mapping=SimpleNamespace(**tables))
    fitted = SimpleNamespace(**{"values": values, "rate_dropped": False, "edges": {}} | fit)
    spread = SimpleNamespace(sigma=sigma or {})
    given = recordings or [recording()], fitted, spread, verdict or verdict_of(), pair
    return "\n".join(notes_of(source, *given))


@pytest.mark.parametrize(
    ("given", "said", "unsaid"),
    [
        ({}, "eps2 is fixed at 0.0131", "dropped by"),
        ({"verdict": verdict_of(asymmetry=(0.01, -0.049, None))}, "-4.9 %, within our limit", ""),
        ({"verdict": verdict_of(asymmetry=(0.01, 0.051))}, "+5.1 %, above our limit of 5 %", ""),
        ({"verdict": verdict_of(asymmetry=(None,))}, "Loaded to one side only", "Mullins"),
        (
            {"verdict": verdict_of(asymmetry=(0.0,) * 3, softening=(0.1, 0.25, None))},
            "up to 25 % less work",
            "none seen",
        ),
        (
            {"verdict": verdict_of(asymmetry=(0.0,) * 2, softening=(-0.004, 0.009))},
            "none seen, no block's last cycle loses 1 % less",
            "",
        ),
        (
            {"pair": (verdict_of(0.08), verdict_of(0.05))},
            "element 2.00 %, with it 1.25 % of full scale: the rate terms help",
            "",
        ),
        ({"pair": (verdict_of(0.05),) * 2}, "the rate terms do not help, and are left out", ""),
        ({"pair": (verdict_of(),) * 2, "rate_dropped": True}, "", "Held-out error without"),
        ({"values": WITHOUT, "rate_dropped": True}, "no stiffness, so it is left out", ""),
        ({"values": WITHOUT, "recordings": [recording(timed=False)]}, "no time was recorded", ""),
        ({"values": WITHOUT}, "rate_terms = false", ""),
        ({"recordings": [recording(timed=False)]}, "marked assumed too", ""),
        (
            {"recordings": [recording(dropped=2), recording(dropped=1)]},
            "3 of 201 samples dropped by sampling.min_step_s = 0.002 s",
            "",
        ),
        ({"recordings": [recording(gap_s=0.11)]}, "largest gap between samples is 0.11 s", ""),
        ({"recordings": [recording(gap_s=0.09)]}, "", "gap"),
        ({"sigma": {"k1_Nm_rad": 4.9}}, "", "poorly"),
        ({"sigma": {"k1_Nm_rad": 5.1}}, "poorly determined (standard deviation 5.1)", ""),
        ({"sigma": {"k1_Nm_rad": np.inf}}, "poorly determined (standard deviation infinite)", ""),
        (
            {"values": VALUES | {"k1_Nm_rad": HIGH}, "sigma": {"k1_Nm_rad": 9 * HIGH}},
            "is at its upper bound",
            "poorly",
        ),
        ({"edges": {"omega_rad": "omega is low"}}, "Omega is low.", ""),
        ({"values": VALUES | {"omega_rad": 0.21}}, "No stop slips", ""),
        ({"values": VALUES | {"alpha_Nm_rad": 0.0}}, "carry no torque", "No stop slips"),
    ],
)
def test_a_note_where_it_applies(given, said, unsaid):
    text = told(**given)
    assert said in text
    assert not unsaid or unsaid not in text


def test_the_band_in_percent_of_full_scale_beside_what_was_held_out():
    r = SimpleNamespace(label="one", tau_Nm=np.zeros(5), sets=[SimpleNamespace(held_out=[0, 2, 4])])
    verdict = SimpleNamespace(torque_Nm={"one": np.array([0.01, 9.0, -0.02, 9.0, 0.4])})
    spread = SimpleNamespace(band_Nm=0.396, friction_Nm=-0.08)
    band, friction = band_notes([r], verdict, spread, 4.0)
    assert "below 0.396 Nm (9.9 % of full scale)" in band
    assert "67 % are" in band
    assert "0.08 Nm less friction than the model has" in friction
