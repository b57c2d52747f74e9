"""Which experiment next: D-optimal advice."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.identify import identify
from esea_gen.identify.next_experiment import RATE_Hz, REST_s, advise, d_optimal, motions
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
        app, f"advise {small} --minutes 2 --out {tmp_path / 'm'} --json {tmp_path / 'a.json'}"
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
