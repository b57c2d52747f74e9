"""Step metrics, frequency response and impedance against closed forms."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from esea_gen.analysis.frequency import FrequencyResponse, OutputImpedance
from esea_gen.analysis.step import step_metrics
from esea_gen.analysis.sweeps import Sweep, sweep_response
from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_gen.reproduce.spring_rig import author_bandwidth, check_on_data

H = 1e-3


def second_order(t, wn, zeta):
    """Step response of wn^2 / (s^2 + 2 zeta wn s + wn^2), zeta below 1, any sign."""
    wd = wn * math.sqrt(1 - zeta**2)
    return np.where(
        t < 0, 0.0, 1 - np.exp(-zeta * wn * t) * (np.cos(wd * t) + zeta * wn / wd * np.sin(wd * t))
    )


# -- step -----------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(
    zeta=st.floats(0.2, 0.9),
    f_Hz=st.floats(2.0, 20.0),
    scale=st.floats(-30.0, 30.0).filter(lambda v: abs(v) > 1e-3),
    offset=st.floats(-5.0, 5.0),
    start_s=st.floats(0.1, 2.0),
)
def test_second_order_step_in_any_unit_and_at_any_time(zeta, f_Hz, scale, offset, start_s):
    wn = 2 * np.pi * f_Hz
    t = np.arange(0, start_s + 15 / (zeta * wn), 0.002 / f_Hz)
    y = offset + scale * second_order(t - start_s, wn, zeta)
    m = step_metrics(t, y, step_s=start_s, before=offset, after=offset + 1.25 * scale)
    assert m.verdict == "stable", m.reason
    peak = 100 * math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    assert m.overshoot_percent == pytest.approx(peak, rel=2e-3, abs=0.02)
    assert m.steady_error_percent == pytest.approx(20, abs=0.05)
    # The envelope bounds the settling from above.
    assert m.settling_5_s <= m.settling_2_s
    assert m.settling_2_s <= -math.log(0.02 * math.sqrt(1 - zeta**2)) / (zeta * wn) * 1.01


@pytest.mark.parametrize(
    ("zeta", "verdict"),
    [(-0.02, "growing"), (0.0, "sustained oscillation"), (0.03, "stable"), (0.5, "stable")],
)
def test_instability_of_an_oscillator(zeta, verdict):
    t = np.arange(-0.5, 4, H)
    m = step_metrics(t, second_order(t, 2 * np.pi * 3, zeta), step_s=0.0)
    assert m.verdict == verdict
    if verdict != "stable":
        assert m.oscillation_Hz == pytest.approx(3, abs=0.4)
        assert m.rise_s is m.settling_2_s is m.overshoot_percent is None
        assert len(m.table()) == 1


# -- frequency response ---------------------------------------------------------------------------


def exact(f, wn, zeta, delay_s=0.0):
    s = 2j * np.pi * f
    return np.exp(-s * delay_s) / ((s / wn) ** 2 + 2 * zeta * s / wn + 1)


@settings(max_examples=30)
@given(wn=st.floats(5, 100), zeta=st.floats(0.2, 2.0), gain=st.floats(0.01, 50))
def test_bandwidth_of_a_second_order_lag(wn, zeta, gain):
    f = np.geomspace(0.001, 1000, 2400)
    found = FrequencyResponse(f, gain * exact(f, wn, zeta), None, None, "exact").bandwidth()
    q = 1 - 2 * zeta**2
    assert found.bandwidth_Hz == pytest.approx(
        wn * math.sqrt(q + math.hypot(q, 1)) / (2 * np.pi), rel=2e-3
    )
    assert found.passband_gain == pytest.approx(gain, rel=1e-3)
    assert not found.returns


def test_the_definition_of_a_bandwidth_is_said():
    f = np.geomspace(0.1, 100, 400)
    dip = 1 - 0.6 * np.exp(-(np.log(f / 3) ** 2) / 0.1) + 0j  # falls at 2.4 Hz, comes back
    r = FrequencyResponse(f, dip, None, None, "exact")
    b = r.bandwidth()
    assert b.returns
    assert 2 < b.bandwidth_Hz < 3
    # Flat to 1 Hz, then 20 dB a decade: -3.01 dB is at the root of 2, however coarse the grid.
    corner = FrequencyResponse(
        np.array([0.1, 1, 10, 100]), np.array([1, 1, 0.1, 0.01 + 0j]), None, None, "asymptotes"
    )
    assert corner.bandwidth().bandwidth_Hz == pytest.approx(math.sqrt(2), rel=1e-3)
    assert r.bandwidth(drop_dB=20).bandwidth_Hz is None
    assert r.bandwidth(passband_gain=2.0).bandwidth_Hz == f[0]


@settings(max_examples=30)
@given(k=st.floats(1, 100), delay_s=st.floats(1e-3, 0.01))
def test_margins_of_an_integrator_with_delay(k, delay_s):
    # |L| = 1 at w = k, phase -180 deg at w d = pi/2.
    f = np.geomspace(0.01, 3 / delay_s, 4000)
    s = 2j * np.pi * f
    m = FrequencyResponse(f, k / s * np.exp(-s * delay_s), None, None, "exact").margins()
    assert m.phase_margin_deg == pytest.approx(90 - math.degrees(k * delay_s), abs=0.05)
    assert m.phase_margin_Hz == pytest.approx(k / (2 * np.pi), rel=1e-3)
    assert m.gain_margin_dB == pytest.approx(20 * math.log10(np.pi / (2 * k * delay_s)), abs=0.02)
    assert m.gain_margin_Hz == pytest.approx(0.25 / delay_s, rel=1e-3)
    if k * delay_s < np.pi / 2 - 0.01:
        assert m.delay_margin_s == pytest.approx(np.pi / 2 / k - delay_s, rel=2e-2)


def test_the_worst_of_several_crossings_counts():
    # Gain 2 with a dip to 1/2 at 1 Hz, then a fall: crossings at f = 1/e, e and 10 ln-steps later.
    f = np.geomspace(0.1, 30, 3000)
    gain = np.where(np.abs(np.log(f)) < 1, 0.5, np.where(f < 10, 2.0, 0.1))
    m = FrequencyResponse(f, gain * np.exp(-2j * np.pi * f * 0.03), None, None, "").margins()
    # Phase -10.8 deg per Hz: margins 176, 151 and 72 deg; delays 180/360/f - 30 ms.
    assert m.phase_margin_deg == pytest.approx(180 - 10.8 * 10, abs=0.5)
    assert m.delay_margin_s == pytest.approx(0.5 / 10 - 0.03, abs=3e-4)
    # Phase -180 deg only at 16.7 Hz, gain 0.1 there.
    assert m.gain_margin_dB == pytest.approx(20)
    assert m.gain_margin_Hz == pytest.approx(0.5 / 0.03, rel=1e-3)


def test_open_loop_of_a_closed_one():
    f = np.geomspace(0.1, 100, 300)
    s = 2j * np.pi * f
    loop = 30 / s / (1 + 0.01 * s)
    found = FrequencyResponse(f, loop / (1 + loop), None, None, "exact").open_loop()
    assert found.response == pytest.approx(loop)
    assert found.margins().gain_margin_dB is None
    # w_c from |L| = 1: w^2 (1 + 1e-4 w^2) = 900.
    wc = math.sqrt((-1 + math.sqrt(1 + 4 * 900e-4)) / 2e-4)
    assert found.margins().phase_margin_deg == pytest.approx(
        90 - math.degrees(math.atan(0.01 * wc)), abs=0.05
    )


def discrete(wn, zeta, h, hold="zoh"):
    b, a, _ = signal.cont2discrete(([wn**2], [1, 2 * zeta * wn, wn**2]), h, hold)
    return b.ravel(), a


@pytest.fixture(scope="module")
def swept():
    """40 s, 0 to 40 Hz, at irregular times picked out of an exact simulation at 20 kHz."""
    rng = np.random.default_rng(4)
    h = 5e-5
    t = np.arange(800_000) * h
    sweep = Sweep(0.0, 40.0, 40.0)
    b, a = discrete(2 * np.pi * 8, 0.4, h, "foh")
    y = np.concatenate([np.zeros(200), signal.lfilter(b, a, np.sin(sweep.phase_rad(t)))[:-200]])
    keep = np.sort(rng.choice(len(t), 20_000, replace=False))
    return t[keep], np.sin(sweep.phase_rad(t[keep])), y[keep], sweep  # 10 ms of delay


def test_sweep_at_irregular_samples(swept):
    t, u, y, sweep = swept
    r = sweep_response(t, u, y, sweep)
    true = exact(r.frequency_Hz, 2 * np.pi * 8, 0.4, 0.01)
    assert r.frequency_Hz[0] < 1.4
    assert r.frequency_Hz[-1] > 38
    later = sweep_response(t + 5, u, y, Sweep(0.0, 40.0, 40.0, start_s=5.0))
    np.testing.assert_allclose(later.response, r.response, rtol=1e-6)
    assert np.max(np.abs(r.response / true - 1)) < 0.022
    # All but a little of that is the sweep's rate: H - j k / (4 pi) d2H/df2, k = 1 Hz/s.
    d = 1e-2
    near = [exact(r.frequency_Hz + e, 2 * np.pi * 8, 0.4, 0.01) for e in (-d, 0, d)]
    curve = (near[0] - 2 * near[1] + near[2]) / d**2
    assert np.max(np.abs(r.response / (true - 1j / (4 * np.pi) * curve) - 1)) < 0.006
    wn, q = 2 * np.pi * 8, 1 - 2 * 0.4**2
    closed_form = wn * math.sqrt(q + math.hypot(q, 1)) / (2 * np.pi)
    assert r.bandwidth(passband_gain=1.0).bandwidth_Hz == pytest.approx(closed_form, rel=6e-3)
    rng = np.random.default_rng(0)
    noisy = sweep_response(t, u, y + rng.normal(0, 0.1, len(t)), sweep)
    part = noisy.band(2, 15)
    error = np.abs(part.response / exact(part.frequency_Hz, 2 * np.pi * 8, 0.4, 0.01) - 1)
    assert np.max(error) < 0.1
    assert 0.5 < np.sqrt(np.mean(error**2) / np.mean(2 * part.sigma**2)) < 2
    assert noisy.coherence[-1] < 0.3
    assert noisy.coherence[0] > 0.9


def test_a_wrong_sweep_is_refused(swept):
    t, u, y, sweep = swept
    with pytest.raises(UserError, match="not the given sweep"):
        sweep_response(t, u, y, dataclasses.replace(sweep, end_Hz=39.0))
    with pytest.raises(UserError, match="windows fit"):
        sweep_response(t[:50], u[:50], y[:50], sweep)
    with pytest.raises(UserError, match="does not rise"):
        Sweep(3.0, 3.0, 10.0)


# -- impedance ------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(j=st.floats(0, 2), b=st.floats(-0.5, 5), k=st.floats(0.1, 50))
def test_impedance_of_a_known_driving_point(j, b, k):
    f = np.geomspace(0.2, 6, 40)
    s = 2j * np.pi * f
    # A spring pulls back: the torque on what is moved.
    z = OutputImpedance.of(FrequencyResponse(f, -(k + b * s + j * s * s), None, None, ""))
    assert z.per_rate.real == pytest.approx(b, abs=1e-6)
    fit = z.fit()
    assert (fit.inertia_kgm2, fit.damping_Nms_rad, fit.stiffness_Nm_rad) == pytest.approx(
        (j, b, k), rel=1e-5, abs=1e-6
    )
    assert fit.misfit < 1e-5
    assert (fit.low_Hz, fit.high_Hz) == pytest.approx((0.2, 6))


# -- recorded data's layout -----------------------------------------------------------------------


def test_check_on_data_judges_a_folder(tmp_path, swept):
    t, u, y, _ = swept
    for name in ("chirp", "step_closed_loop"):
        (tmp_path / name).mkdir()
    head = ",time,torque_in,torque_ati,torque_sea\n"

    def write(path, columns):
        rows = zip(range(len(columns[0])), *columns, strict=True)
        path.write_text(head + "\n".join(",".join(repr(float(v)) for v in r) for r in rows))

    write(tmp_path / "chirp" / "bw_sea_cl-1-2-14-x.csv", (t, u, y, y))
    step = np.arange(0, 6, 2e-3)
    steady = second_order(step - 3, 30, 0.5)
    wild = np.where(step < 1, 20 * np.sin(60 * step), 0)
    write(tmp_path / "step_closed_loop" / "a.csv", (step, 1.0 * (step >= 3), steady, steady))
    write(tmp_path / "step_closed_loop" / "b.csv", (step, 1.0 * (step >= 3), 0.1 * wild, wild))
    expected = author_bandwidth(t, u, y)
    table = tmp_path / "published_SEABandwidthClosedLoop.csv"
    table.write_text(f",torque,bandwidth\n0,1.0,3.0\n1,1.0,{expected!r}\n# 2,1.0,9.0\n")
    said = []
    result = check_on_data(tmp_path, said.append)
    assert result.reproduced
    assert len(said) == 3
    # 4.5 dB down: wn sqrt(q + sqrt(q^2 + 10^0.45 - 1)); to his 2.5 Hz of smoothing.
    q = 1 - 2 * 0.4**2
    closed_form = 8 * math.sqrt(q + math.sqrt(q * q + 10**0.45 - 1))
    assert expected == pytest.approx(closed_form, abs=1.5)
    assert result.sweeps[0].local_author_drop.bandwidth_Hz == pytest.approx(closed_form, rel=0.03)
    assert result.steps["a.csv"]["torque_ati"].stable
    assert result.steps["b.csv"]["torque_sea"].verdict == "diverged"
    json.dumps(plain(result.to_dict()), allow_nan=False)
    assert "come out" in result.table()[-1]
    assert len(result.figure().axes) == 3
    table.write_text(f",torque,bandwidth\n0,1.0,3.0\n1,1.0,{expected + 0.1!r}\n")
    assert not check_on_data(tmp_path).reproduced
    table.write_text(",torque,bandwidth\n0,1.0,x\n")
    with pytest.raises(UserError, match=r"line 2, column .bandwidth.: .x. is not a number"):
        check_on_data(tmp_path)
    with pytest.raises(UserError, match="0 sweeps"):
        check_on_data(tmp_path / "none")
