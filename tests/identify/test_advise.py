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
    RATE_Hz,
    REST_s,
    advise,
    d_optimal,
    motions,
)
from tests.result_schemas import held
from tests.rigs import rig, written


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
