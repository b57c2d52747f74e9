"""Which experiment next: D-optimal advice."""

import json
import math
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.identify import identify, next_experiment
from esea_gen.identify.next_experiment import (
    Advice,
    CommandedMotion,
    RATE_Hz,
    REST_s,
    advise,
    d_optimal,
    motions,
)

from .result_schemas import held
from .test_quality import rig, written


def test_the_textbooks_designs_of_a_line_and_a_parabola():
    """Fedorov: the ends of the interval, each as often; for a parabola its middle too."""
    x = np.linspace(-1, 1, 9)
    for degree, wanted in ((1, {0: 6, 8: 6}), (2, {0: 4, 4: 4, 8: 4})):
        rows = np.vander(x, degree + 1)
        gains = [np.outer(r, r) for r in rows]
        chosen = d_optimal(1e-6 * np.eye(degree + 1), gains, [1.0] * 9, 12.0)
        assert {i: chosen.count(i) for i in set(chosen)} == wanted


def test_what_costs_more_must_tell_more_and_the_time_is_kept():
    gains = [np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.diag([1.0, 0.0])]
    chosen = d_optimal(np.eye(2), gains, [1.0, 2.0, 1.01], 7.5)
    assert 2 not in chosen
    seconds = sum((1.0, 2.0, 1.01)[i] for i in chosen)
    assert seconds <= 7.5 < seconds + 1
    # Alone, the cheap one comes first; the other when the first has gained enough.
    assert chosen[0] == 0
    assert 1 in chosen
    assert d_optimal(np.eye(2), gains, [1.0, 2.0, 1.01], 0.5) == []


def test_motions_stay_in_the_domain_and_are_what_they_say():
    theta, omega = 0.2, 1.0
    found = motions(theta, omega)
    assert {m.kind for m in found} == {"cycles", "sweep", "hold"}
    for m in found:
        t, x = m.deflection()
        assert t[-1] == pytest.approx(m.seconds, abs=1 / RATE_Hz)
        assert np.abs(x).max() == pytest.approx(m.amplitude_rad, rel=2e-3)
        assert np.abs(x).max() <= theta * (1 + 1e-12)
        assert np.abs(np.diff(x)).max() * RATE_Hz <= omega * (1 + 1e-9)
        assert np.all(x[t <= REST_s] == 0)
        assert f"{math.degrees(m.amplitude_rad):.1f} deg" in m.text
        if m.kind == "cycles":
            count = int(m.text.split("then ")[1].split()[0])
            assert np.count_nonzero((x[1:] > 0) & (x[:-1] <= 0)) == pytest.approx(count, abs=1)
    # A hold that would be faster than the domain is none.
    assert "hold" not in {m.kind for m in motions(0.2, 0.05)}


def test_the_motions_of_a_domain_by_hand():
    # 0.4 rad and 2 rad/s: a sine of a quarter of it may have 2 / (2 pi 0.1) = 3.18 Hz, of the
    # whole 0.796 Hz; a hold rises to its deflection in half a second.
    found = motions(0.4, 2.0)
    most = [2.0 / (2 * math.pi * a) for a in (0.1, 0.2, 0.3, 0.4)]
    rows = []
    for a, fastest in zip((0.1, 0.2, 0.3, 0.4), most, strict=True):
        for f in (0.01, 0.05, 0.2, 0.5, 1.0, 1.5):
            if f < fastest:
                rows.append(("cycles", a, f, f, 5.0 + max(1, 20 * f) / f))
        if fastest < 1.5:  # and at the fastest itself, in whole cycles
            rows.append(("cycles", a, fastest, fastest, 5.0 + math.ceil(20 * fastest) / fastest))
        rows.append(("sweep", a, 0.0, min(1.5, fastest), 65.0))
        rows.append(("hold", a, 0.0, 0.0, 125.0))
    told = [(m.kind, m.amplitude_rad, m.first_Hz, m.last_Hz, m.seconds) for m in found]
    assert [m[0] for m in told] == [r[0] for r in rows]
    for one, row in zip(told, rows, strict=True):
        assert one[1:] == pytest.approx(row[1:])
    # A rise of exactly the domain's rate is one still; without time one frequency is enough.
    assert "hold" in {m.kind for m in motions(0.4, 0.8)[-1:]}
    assert "hold" not in {m.kind for m in motions(0.4, 0.799)[-1:]}
    untimed = motions(0.4, 0.3, timed=False)
    assert [(m.kind, m.amplitude_rad, m.first_Hz, m.seconds) for m in untimed] == [
        ("cycles", a, pytest.approx(f), pytest.approx(5 + count / f))
        for a, f, count in (
            *((pytest.approx(0.1), 0.2, 4), (pytest.approx(0.2), 0.2, 4)),
            (pytest.approx(0.3), 0.3 / (0.6 * math.pi), 4),
            (pytest.approx(0.4), 0.3 / (0.8 * math.pi), 3),
        )
    ]


K1, K3, WORTH, OWN = 12.0, 90.0, 2.5, (0.05, 10.0)


class Springs:
    """A plant of two springs, k1 x + k3 x^3, whose information is known in closed form."""

    rates: ClassVar[list] = []

    def __init__(self, device, recordings, rate_Hz):
        self.rates.append(rate_Hz)
        trained = [r for r in recordings if len(r.sets[0].training)]
        self.streams = [SimpleNamespace(training=[r.sets[0].training]) for r in trained]
        self.x = np.concatenate([r.theta_rad[r.sets[0].training] for r in trained])

    def torque(self, values):
        return values["k1_Nm_rad"] * self.x + values["k3_Nm_rad3"] * self.x**3


def of_sine(amplitude_rad: float, lasts_s: float) -> np.ndarray:
    """Integral of what k1 and k3, by a relative change, do to the torque along whole cycles."""
    a, mean = amplitude_rad, (1 / 2, 3 / 8, 5 / 16)  # of sin^2, sin^4 and sin^6
    one, both, three = (lasts_s * m * a ** (2 * k) for k, m in enumerate(mean, 1))
    return np.array([[K1 * K1 * one, K1 * K3 * both], [K1 * K3 * both, K3 * K3 * three]])


@pytest.mark.parametrize("timed", [False, True])
def test_expected_deviations_follow_from_the_information_of_the_motions(monkeypatch, timed):
    def recorded(amplitude_rad: float, lasts_s: float, rate_Hz: float, training: bool):
        t = np.arange(round(lasts_s * rate_Hz)) / rate_Hz
        rows = np.arange(len(t) if training else 0)
        x = amplitude_rad * np.sin(2 * np.pi * t)
        sets = (SimpleNamespace(training=rows),)
        return SimpleNamespace(time_s=t, theta_rad=x, sets=sets, timed=timed)

    monkeypatch.setattr(next_experiment, "FittedPlant", Springs)
    Springs.rates.clear()
    own = of_sine(*OWN)
    covariance = np.linalg.inv(WORTH * own)
    sigma = np.sqrt(np.diag(covariance))
    domain = {"theta_max_rad": 0.4, "omega_max_rad_s": 3.0}
    # A grid of the recording's own, or of the advice's where time matters.
    rate_Hz = 100.0 if timed else 250.0
    result = SimpleNamespace(
        device=SimpleNamespace(
            title="springs",
            elastomer=SimpleNamespace(maxwell="one" if timed else None),
            file=SimpleNamespace(
                domain=SimpleNamespace(**{k: SimpleNamespace(value=v) for k, v in domain.items()})
            ),
        ),
        fit=SimpleNamespace(values={"k1_Nm_rad": K1, "k3_Nm_rad3": K3}, rate_dropped=False),
        spread=SimpleNamespace(
            sigma={"k1_Nm_rad": K1 * sigma[0], "k3_Nm_rad3": K3 * sigma[1]},
            resampled=SimpleNamespace(covariance=covariance, sigma=sigma),
        ),
        recordings=[recorded(*OWN, rate_Hz, True), recorded(0.3, 4.0, rate_Hz, False)],
    )
    if timed:  # whole cycles alone
        cycles = [m for m in motions(0.4, 3.0) if m.kind == "cycles"]
        monkeypatch.setattr(next_experiment, "motions", lambda *domain: cycles)
    advice = advise(result, 3.0)
    assert Springs.rates == [100.0 if timed else None] * 2
    then = WORTH * own
    for times, m in advice.motions:
        then = then + WORTH * times * of_sine(m.amplitude_rad, m.seconds - REST_s)
    expected = np.sqrt(np.diag(np.linalg.inv(then)))
    assert list(advice.sigma_now.values()) == pytest.approx([K1 * sigma[0], K3 * sigma[1]])
    assert list(advice.sigma_then.values()) == pytest.approx(expected * [K1, K3], rel=1e-2)
    inside = "Inside the domain of the recording; the expected figures take the model's form for "
    untimed = "Record the time: without it no rate term can be identified."
    assert advice.notes == (f"{inside}right.", *([] if timed else [untimed]))
    result.recordings[0].timed = result.recordings[1].timed = True
    without = "The model has no rate terms: frequencies do not matter to this advice."
    assert advise(result, 3.0).notes[1:] == (() if timed else (without,))
    # No other choice of as long motions of one size tells more of both.
    for a in (0.1, 0.2, 0.3):
        lasts = sum(n * (m.seconds - REST_s) for n, m in advice.motions)
        other = WORTH * (own + of_sine(a, lasts))
        assert np.linalg.det(other) < np.linalg.det(then)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Nearly all cycles small: the cubic spring is hardly known."""
    sizes = (*(0.03,) * 6, *(0.1,) * 3)
    return written(tmp_path_factory.mktemp("rig"), *rig(*sizes))


@pytest.mark.ci
def test_advice_is_worth_what_it_says(small):
    result = identify(small)
    advice = advise(result, 3.0)
    assert sum(n * m.seconds for n, m in advice.motions) <= 180
    largest = max(m.amplitude_rad for _, m in advice.motions)
    assert largest == pytest.approx(result.device.file.domain.theta_max_rad.value)
    assert {m.kind for _, m in advice.motions} == {"cycles"}
    for key, now in advice.sigma_now.items():
        assert now == pytest.approx(result.spread.sigma[key], rel=1e-9)
        assert 0 < advice.sigma_then[key] < now
    # Four times as long: no more than half as sure again, and no less than nearly so.
    longer = advise(result, 12.0)
    for key, then in advice.sigma_then.items():
        assert 0.4 * then < longer.sigma_then[key] < then
    with pytest.raises(UserError, match="too short"):
        advise(result, 0.1)


@pytest.mark.ci
def test_the_protocol_and_its_motions(small, tmp_path):
    done = CliRunner().invoke(
        app,
        f"advise {small} --minutes 2 --out {tmp_path / 'm'} --json {tmp_path / 'a.json'}",
    )
    assert done.exit_code == 0, done.output
    assert "what to record next" in done.output
    content = json.loads((tmp_path / "a.json").read_text())
    held("advise", content)
    for number, step in enumerate(content["motions"], 1):
        assert step["text"] in " ".join(done.output.split())
        path = tmp_path / "m" / f"{number}-{step['kind']}.csv"
        t, x = np.loadtxt(path, delimiter=",", skiprows=1).T
        assert np.abs(x).max() == pytest.approx(step["amplitude_rad"], rel=2e-3)
        assert t[-1] == pytest.approx(step["seconds"], abs=0.02)


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (("cycles", 0.1, 0.2, 0.2, 25.0), "4 cycles of a sine of 5.7 deg at 0.2 Hz"),
        (("cycles", 0.2, 0.01, 0.01, 105.0), "1 cycle of a sine of 11.5 deg at 0.01 Hz"),
        (("cycles", 0.05, 1.25, 1.25, 21.0), "20 cycles of a sine of 2.9 deg at 1.2 Hz"),
        (("sweep", 0.3, 0.0, 1.5, 65.0), "a sine of 17.2 deg, from 0 to 1.5 Hz in 60 s"),
        (
            ("hold", 0.3, 0.0, 0.0, 125.0),
            "go to 17.2 deg in 0.5 s and hold 59 s; the same to the other side",
        ),
    ],
)
def test_a_motion_in_words(motion, words):
    assert CommandedMotion(*motion).text == f"rest 5 s, then {words}"


def test_the_course_of_a_motion():
    t, x = CommandedMotion("sweep", 0.3, 0.5, 1.5, 15.0).deflection()
    assert t.tolist() == [k / 100 for k in range(1501)]
    # From 0.5 Hz it gains 0.1 Hz a second: 0.5 u + 0.05 u^2 turns.
    for k in (0, 499, 500, 525, 700, 1100, 1499, 1500):
        u = max(k / 100 - 5, 0)
        turns = 0.5 * u + 0.05 * u * u
        assert x[k] == pytest.approx(0.3 * math.sin(2 * math.pi * turns), abs=1e-12)
    t, x = CommandedMotion("hold", 0.2, 0.0, 0.0, 25.0).deflection()
    for at, level in (
        *((0, 0), (5, 0), (5.25, 0.1), (5.5, 0.2), (14.5, 0.2), (14.75, 0.1), (15, 0)),
        *((15.25, -0.1), (15.5, -0.2), (24.5, -0.2), (24.75, -0.1), (25, 0)),
    ):
        assert x[round(100 * at)] == pytest.approx(level, abs=1e-12)


def test_advice_line_by_line():
    one = CommandedMotion("cycles", 0.1, 0.2, 0.2, 25.0)
    two = CommandedMotion("sweep", 0.3, 0.0, 1.5, 65.0)
    advice = Advice(
        *("Rig", ((1, one), (3, two)), {"k1": 12.3456, "beta": 0.01}),
        *({"k1": 1.5, "beta": 0.00321}, ("first", "second")),
    )
    assert advice.table() == [
        "Rig: what to record next, 3.7 min",
        f"  1. {one.text}",
        f"  2. 3 times: {two.text}",
        "expected standard deviations, of this recording and with these motions",
        "  k1                   12.3        1.5",
        "  beta                 0.01    0.00321",
        "note: first",
        "note: second",
    ]
    told = advice.to_dict()
    assert told["notes"] == ["first", "second"]
    assert told["motions"][1] == {
        **{"times": 3, "kind": "sweep", "amplitude_rad": 0.3, "first_Hz": 0.0, "last_Hz": 1.5},
        **{"seconds": 65.0, "text": two.text},
    }
    assert told["sigma_then"] == {"k1": 1.5, "beta": 0.00321}


def test_without_a_free_number_or_time_there_is_no_advice():
    def result(values, resampled):
        return SimpleNamespace(
            device=SimpleNamespace(elastomer=SimpleNamespace(maxwell=None)),
            fit=SimpleNamespace(values=values, rate_dropped=False),
            spread=SimpleNamespace(sigma=values, resampled=resampled),
        )

    for values, resampled in (({}, "known"), ({"k1_Nm_rad": 12.0}, None)):
        with pytest.raises(UserError, match="No parameter is free: every one is at a bound"):
            advise(result(values, resampled), 3.0)
    # Where one gains nothing, another that gains less for its time is taken; a tie by its place.
    gains = [np.diag([1.0, 0.0]), np.zeros((2, 2)), np.diag([1.0, 0.0])]
    assert d_optimal(np.eye(2), gains, [2.0, 1.0, 2.0], 4.0) == [0, 0]
    assert d_optimal(np.eye(2), gains, [2.0, 1.0, 2.0], 3.9) == [0]
    assert d_optimal(np.eye(2), gains[1:2], [1.0], 4.0) == []
    assert d_optimal(np.eye(2), [], [], 4.0) == []
