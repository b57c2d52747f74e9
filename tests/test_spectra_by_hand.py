"""Spectra, periods, margins and bandwidths, each summed or interpolated a second time by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis.frequency import FrequencyResponse
from esea_gen.analysis.response import checked, checked_period, checked_time, plain, resample
from esea_gen.analysis.sweeps import periodic_response, welch_response
from esea_gen.errors import UserError


def lines(x: np.ndarray, length: int) -> np.ndarray:
    """Transforms of Hann-weighted halves-overlapping segments without their means."""
    k = np.arange(length)
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * k / length)
    turn = np.exp(-2j * np.pi * np.outer(k, np.arange(length // 2 + 1)) / length)
    step = length - length // 2
    starts = range(0, len(x) - length + 1, step)
    return np.array(
        [(hann * (x[s : s + length] - x[s : s + length].mean())) @ turn for s in starts]
    )


@pytest.mark.parametrize(("samples", "length"), [(160, 32), (170, 33), (80, 32), (64 + 17, 16)])
@pytest.mark.parametrize("with_instrument", [False, True])
def test_averaged_spectra(samples, length, with_instrument):
    rng, h = np.random.default_rng(samples), 0.02
    r = rng.normal(3.0, 1.0, samples)
    u = np.convolve(r, [0.5, 1.0, -0.2])[:samples] + rng.normal(0, 0.3, samples)
    y = np.convolve(u, [0.0, 0.7, 0.4])[:samples] + rng.normal(0, 0.5, samples)
    given = r if with_instrument else None
    found = welch_response(u, y, h, segment_s=length * h, instrument=given)
    by = lines(r if with_instrument else u, length)
    x, z = lines(u, length), lines(y, length)
    count = len(x)
    through = np.sum(by.conj() * z, axis=0)
    use = slice(1, (length + 1) // 2)  # neither the mean nor half the rate
    assert found.frequency_Hz == pytest.approx(np.arange(length // 2 + 1)[use] / (length * h))
    expected = through / np.sum(by.conj() * x, axis=0)
    np.testing.assert_allclose(found.response, expected[use], rtol=1e-9)
    power = np.sum(np.abs(by) ** 2, axis=0) * np.sum(np.abs(z) ** 2, axis=0)
    c = (np.abs(through) ** 2 / power)[use]
    np.testing.assert_allclose(found.coherence, c, rtol=1e-9)
    # Neighbours overlap by half: their Hann-weighted spectra correlate by a sixth [Welch 1967].
    independent = count / (1 + 2 * (1 / 6) ** 2 * (count - 1) / count)
    np.testing.assert_allclose(found.sigma, np.sqrt((1 - c) / (2 * c * independent)), rtol=1e-9)
    kind = "with instrument" if with_instrument else "H1"
    assert found.method == f"Welch {kind}, {count} Hann segments of {length * h:g} s"


def test_lines_that_do_not_excite_are_left_out():
    # A sine of one line, which the window spreads over its neighbours; nothing elsewhere.
    t = np.arange(640) / 64
    u = 5.0 + np.sin(2 * np.pi * 8 * t) + 2e-3 * np.sin(2 * np.pi * 20 * t)
    u = u + 2e-4 * np.sin(2 * np.pi * 27 * t)
    r = welch_response(u, 3 * u, 1 / 64, segment_s=1.0)
    assert r.frequency_Hz.tolist() == [7, 8, 9, 19, 20, 21]
    np.testing.assert_allclose(r.response, 3.0)
    np.testing.assert_allclose(r.coherence, 1.0)
    np.testing.assert_allclose(r.sigma, 0.0, atol=1e-6)


def test_four_segments_of_sixteen_samples_are_enough():
    x = np.random.default_rng(0).normal(size=40)
    assert "4 Hann segments of 16 s" in welch_response(x, x, 1.0, segment_s=16.0).method
    for samples, segment_s, words in (
        (39, 16.0, "16 s gives 3 segments of 16 samples in 39 s; at least 4 of 16 are needed"),
        (40, 15.0, "15 s gives 4 segments of 15 samples"),
        (40, 41.0, "41 s gives 0 segments of 41 samples"),
        (40, 0.2, "0.2 s gives 0 segments of 0 samples"),
    ):
        with pytest.raises(UserError, match=words):
            welch_response(x[:samples], x[:samples], 1.0, segment_s=segment_s)
    for bad in (0.0, -1.0, math.inf):
        with pytest.raises(UserError, match="Give a sample period above 0"):
            welch_response(x, x, bad, segment_s=16.0)
    assert checked_period(1e-9) == 1e-9
    for signals, words in (
        ((x, x[1:]), "y: 39 samples, the other signals have 40"),
        ((x[1:], x), "y: 40 samples, the other signals have 39"),
    ):
        with pytest.raises(UserError, match=words):
            welch_response(*signals, 1.0, segment_s=16.0)
    with pytest.raises(UserError, match="instrument: 32 samples"):
        welch_response(x, x, 1.0, segment_s=16.0, instrument=x[8:])


@pytest.mark.parametrize("samples", [26, 27])
@pytest.mark.parametrize(("periods", "skip"), [(4, 1), (3, 0), (2, 0)])
def test_the_lines_of_a_periodic_input(samples, periods, skip):
    rng, h = np.random.default_rng(samples + periods), 0.1
    one = rng.normal(2.0, 1.0, samples)
    count = periods - skip
    u = np.tile(one, periods) + rng.normal(0, 0.05, periods * samples)
    y = 2 * np.roll(u, 3) + rng.normal(0, 0.3, periods * samples)
    tail = np.zeros(samples // 2)  # half a period more is left out
    found = periodic_response(np.append(u, tail), np.append(y, tail), h, samples=samples, skip=skip)
    wanted = range(1, (samples + 1) // 2)  # not the mean, nor half the rate
    assert found.frequency_Hz == pytest.approx([k / (samples * h) for k in wanted])
    n = np.arange(samples)
    for at, k in enumerate(wanted):
        turn = np.exp(-2j * np.pi * k * n / samples)
        a = [u[p * samples : (p + 1) * samples] @ turn for p in range(skip, periods)]
        b = [y[p * samples : (p + 1) * samples] @ turn for p in range(skip, periods)]
        response = sum(b) / sum(a)
        assert found.response[at] == pytest.approx(response, rel=1e-9)
        shared = abs(sum(q * p.conjugate() for p, q in zip(a, b, strict=True))) ** 2
        whole = sum(abs(p) ** 2 for p in a) * sum(abs(q) ** 2 for q in b)
        assert found.coherence[at] == pytest.approx(shared / whole, rel=1e-9)
        rest = sum(abs(q - response * p) ** 2 for p, q in zip(a, b, strict=True)) / (count - 1)
        deviation = math.sqrt(rest / 2 / count) / abs(sum(b) / count)
        assert found.sigma[at] == pytest.approx(deviation, rel=1e-9)
    assert found.method == f"{count} periods of {samples * h:g} s"


def test_one_period_has_no_scatter():
    u = np.random.default_rng(1).normal(size=64)
    r = periodic_response(u, -u, 0.5, samples=32)
    assert (r.coherence, r.sigma, r.method) == (None, None, "1 periods of 16 s")
    for samples, skip, words in (
        (32, 2, "64 samples hold 0 periods of 32 after 2"),
        (33, 1, "64 samples hold 0 periods of 33 after 1"),
        (1, 0, "64 samples hold 0 periods of 1 after 0"),
        (32, -1, "64 samples hold 3 periods of 32 after -1"),
    ):
        with pytest.raises(UserError, match=words):
            periodic_response(u, u, 0.5, samples=samples, skip=skip)


@pytest.mark.parametrize(("away", "told"), [(0.49, False), (0.51, True)])
def test_an_input_repeats_where_it_scatters_by_less_than_half(away, told):
    wave = np.cos(2 * np.pi * np.arange(40) / 8)
    u = np.concatenate([(1 + away) * wave, (1 - away) * wave])
    if told:
        with pytest.raises(UserError, match="u does not repeat every 40 samples"):
            periodic_response(u, u, 1.0, samples=40, skip=0)
    else:
        assert periodic_response(u, u, 1.0, samples=40, skip=0).frequency_Hz.tolist() == [0.125]


# -- samples --------------------------------------------------------------------------------------


def test_a_signal_is_one_finite_row_of_32():
    x = np.arange(32)
    assert checked("a", x).tolist() == list(range(32))
    assert checked("a", x, 32).dtype == np.float64
    bad = np.where(x == 5, np.nan, np.where(x > 29, -np.inf, x))
    for values, like, words in (
        (x[:31], None, r"a: shape \(31,\), needs one row of at least 32 samples"),
        (x.reshape(1, 32), None, r"a: shape \(1, 32\)"),
        (np.tile(x, (32, 1)), None, r"a: shape \(32, 32\)"),
        (x, 33, "a: 32 samples, the other signals have 33"),
        (bad, None, r"a: sample 5 is nan \(3 such samples\)"),
    ):
        with pytest.raises(UserError, match=words):
            checked("a", values, like)
    again = np.where(x == 8, 6.5, np.where(x == 20, 1, x))
    with pytest.raises(UserError, match=r"sample 8 \(6\.5 s\) is not after sample 7 \(7 s\)"):
        checked_time(again)
    with pytest.raises(UserError, match=r"sample 8 \(7 s\) is not after sample 7"):
        checked_time(np.where(x == 8, 7.0, x))


def test_numbers_for_json():
    assert plain(np.array([[1.0, math.nan], [math.inf, -2.5]])) == [[1.0, None], [None, -2.5]]
    assert plain(math.inf) is None
    assert [plain(v) for v in (0.5, 3, "x", None)] == [0.5, 3, "x", None]


def test_the_longest_stretch_without_a_gap():
    # 1 s apart; gaps of 10.5 s; 40, 50 and 35 samples.
    t = np.concatenate([np.arange(40.0), 49.5 + np.arange(50.0), 109.0 + np.arange(35.0)])
    assert np.flatnonzero(np.diff(t) > 1).tolist() == [39, 89]
    r = resample(t, [2 * t, -t])
    assert r.time_s.tolist() == (49.5 + np.arange(50)).tolist()
    assert [s.tolist() for s in r.signals] == [(2 * r.time_s).tolist(), (-r.time_s).tolist()]
    assert (r.period_s, r.widest_s, r.dropped_s) == (1.0, 1.0, 143.0 - 49.0)
    # An interval of just ten times the usual one is none.
    near = np.concatenate([np.arange(40.0), 49.0 + np.arange(50.0)])
    r = resample(near, [near])
    assert len(r.time_s) == 99
    assert (r.widest_s, r.dropped_s) == (10.0, 0.0)
    assert resample(near, [near], max_gap_s=9.9).dropped_s == 98 - 49
    # A grid of any period, as far as it goes.
    r = resample(near[:40], [near[:40] ** 2], period_s=0.7)
    assert r.time_s == pytest.approx(0.7 * np.arange(56))
    whole = np.floor(r.time_s)
    assert r.signals[0] == pytest.approx(whole**2 + (r.time_s - whole) * (2 * whole + 1))


@pytest.mark.parametrize("period_s", [0.1, 0.3, 0.7])
def test_a_regular_recording_keeps_its_last_sample(period_s):
    # Whatever rounding makes of its length over its period.
    for count in range(33, 120):
        t = np.arange(count) * period_s
        assert len(resample(t, [t], period_s=period_s).time_s) == count


def test_a_stretch_of_32_samples_is_needed():
    t = np.arange(32.0)
    assert len(resample(t, [t]).time_s) == 32
    words = "The longest stretch without a gap above 10 s lasts 31 s; 32 samples of 1.01 s are need"
    with pytest.raises(UserError, match=words):
        resample(t, [t], period_s=1.01)
    for name in ({"period_s": 0.0}, {"max_gap_s": -1.0}):
        with pytest.raises(UserError, match="Give a sample period above 0"):
            resample(t, [t], **name)
    with pytest.raises(UserError, match="signal 1: 33 samples"):
        resample(t, [t, np.arange(33.0)])


@pytest.mark.parametrize(("period", "finer"), [(1.4, 1), (1.5, 1), (1.6, 2), (3.0, 3), (2.6, 3)])
def test_a_coarser_grid_is_reached_through_a_low_pass(period, finer):
    t = np.arange(300.0)
    x = np.random.default_rng(3).normal(size=300)
    r = resample(t, [x, 0.02 * t - 3], period_s=period)
    assert r.time_s == pytest.approx(period * np.arange(math.floor(299 / period + 1e-9) + 1))
    fine = period / finer * np.arange((len(r.time_s) - 1) * finer + finer)
    fine = fine[fine <= 299 + 1e-9]
    values = np.interp(fine, t, x)
    if finer > 1:
        # A sinc of 0.4 of the coarse rate under Hamming's window; turned round at the ends.
        n = np.arange(-10 * finer, 10 * finer + 1)
        taps = np.sinc(0.8 / finer * n) * (0.54 + 0.46 * np.cos(np.pi * n / (10 * finer)))
        half = 10 * finer
        first = 2 * values[0] - values[half:0:-1]
        last = 2 * values[-1] - values[-2 : -half - 2 : -1]
        padded = np.concatenate([first, values, last])
        smooth = [padded[k : k + 2 * half + 1] @ taps / taps.sum() for k in range(len(values))]
        values = np.array(smooth)[::finer]
    assert r.signals[0] == pytest.approx(values, abs=1e-9)
    assert r.signals[1] == pytest.approx(0.02 * r.time_s - 3)


# -- margins and bandwidth ------------------------------------------------------------------------


def locus(f, gain_dB, phase_deg) -> FrequencyResponse:
    values = 10 ** (np.array(gain_dB) / 20) * np.exp(1j * np.radians(phase_deg))
    return FrequencyResponse(np.array(f, float), values, None, None, "")


def test_margins_between_four_points():
    m = locus([1, 10, 100, 1000], [20, 10, -10, -40], [-90, -150, -200, -340]).margins()
    # The gain is 1 half way from 10 to 100 Hz, the phase -180 deg three fifths of it.
    assert m.phase_margin_Hz == pytest.approx(10**1.5)
    assert m.phase_margin_deg == pytest.approx(5)
    assert m.delay_margin_s == pytest.approx(5 / 360 / 10**1.5)
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10**1.6, 2))
    at_100 = 1 + 10**-0.5 * np.exp(-1j * np.radians(200))
    assert m.modulus_margin == pytest.approx(abs(at_100))


def test_the_margin_nearest_to_the_limit_of_either_sign():
    # Gain crosses 1 at 10^0.5 (phase -120), 10^1.5 (-190) and 10^2.5 Hz (-160).
    f = [1, 10, 100, 1000]
    m = locus(f, [10, -10, 10, -10], [-100, -140, -240, -80]).margins()
    assert (m.phase_margin_Hz, m.phase_margin_deg) == pytest.approx((10**1.5, -10))
    assert m.delay_margin_s == pytest.approx(min(60 / 360 / 10**0.5, 20 / 360 / 10**2.5))
    # Phase crosses -180 at 10^1.4, going down, at -2 dB; at 10^2.375, going up.
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10**1.4, 2))
    m = locus(f, [10, -10, 10, -10], [-100, -140, -220, -80]).margins()
    up = 2 + 40 / 140
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10**1.5, 0), abs=1e-9)
    m = locus(f, [10, 4, 10, 11], [-100, -140, -220, -80]).margins()
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10**1.5, -7))
    m = locus(f, [10, 9, 9, 4], [-100, -140, -220, -80]).margins()
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10**up, -9 + 5 * 40 / 140))
    assert (m.phase_margin_deg, m.phase_margin_Hz, m.delay_margin_s) == (None, None, None)
    m = locus(f, [12, 12, 6, 2], [-100, -220, -260, -140]).margins()
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10 ** (2 + 2 / 3), -10 / 3))
    # A turn further on, the limit is at -540 deg.
    m = locus(f, [30, 20, 4, -2], [-100, -260, -420, -580]).margins()
    assert (m.gain_margin_Hz, m.gain_margin_dB) == pytest.approx((10**2.75, 0.5))
    m = locus(f, [30, 20, 10, 5], [-20, -60, -100, -170]).margins()
    assert (m.gain_margin_Hz, m.gain_margin_dB) == (None, None)


def test_a_bandwidth_between_points():
    r = locus([1, 10, 100, 1000, 10000], [2, 3, -4, 1, -12], [0, -10, -20, -30, -40])
    b = r.bandwidth(drop_dB=3.0)
    # From 2 dB down to -1: four sevenths of the way from 3 to -4 dB.
    assert b.bandwidth_Hz == pytest.approx(10 ** (1 + 4 / 7))
    assert (b.peak_dB, b.peak_Hz) == pytest.approx((1, 10))
    assert b.passband_gain == pytest.approx(10**0.1)
    assert (b.passband, b.drop_dB, b.returns) == ("gain at 1 Hz", 3.0, True)
    last = r.bandwidth(drop_dB=8.0)
    assert (last.bandwidth_Hz, last.returns) == (pytest.approx(10 ** (3 + 7 / 13)), False)
    # Of a gain that is given, 20 dB: all of it lies below; to be just there is not below.
    given = r.bandwidth(drop_dB=3.0, passband_gain=10.0)
    assert (given.bandwidth_Hz, given.returns, given.passband) == (1.0, False, "given gain")
    assert given.peak_dB == pytest.approx(-17)
    assert r.bandwidth(drop_dB=14.01).bandwidth_Hz is None
    half = FrequencyResponse(
        np.arange(1.0, 5.0), np.array([1.0, 1, 0.5, 0.25], complex), None, None, ""
    )
    drop = -20 * math.log10(0.5)
    assert half.bandwidth(drop_dB=drop).bandwidth_Hz == 3.0
    for wrong in ({"passband_gain": -1.0}, {"drop_dB": 0.0}, {"drop_dB": math.inf}):
        with pytest.raises(UserError, match=r"bandwidth: passband gain .* Both must be above 0"):
            r.bandwidth(**wrong)
    coherent = FrequencyResponse(
        r.frequency_Hz, r.response, np.array([0.4, 0.5, 0.9, 0.9, 0.9]), None, ""
    )
    assert coherent.bandwidth(drop_dB=3.0, min_coherence=0.5).passband == "gain at 10 Hz"


def test_the_open_loops_deviation_grows_where_it_tracks():
    closed = np.array([0.9, 0.5j, -0.2, 0.1])
    r = FrequencyResponse(np.arange(1.0, 5.0), closed, None, np.full(4, 0.01), "m").open_loop()
    np.testing.assert_allclose(r.response, [9, 0.5j / (1 - 0.5j), -1 / 6, 1 / 9])
    np.testing.assert_allclose(r.sigma, 0.01 / np.abs([0.1, 1 - 0.5j, 1.2, 0.9]))


@pytest.mark.parametrize("order", [0, 1])
def test_a_lag_is_fitted_by_what_each_point_is_worth(order):
    f = np.geomspace(0.3, 20, 25)
    s = 2j * np.pi * f
    rng = np.random.default_rng(order)
    truth = 1.7 * np.exp(-0.02 * s) / (1, 1 + s / 20)[order]
    sigma = 10.0 ** rng.uniform(-4, -1, 25)
    noise = np.maximum(sigma, 1e-3) * (rng.normal(size=25) + 1j * rng.normal(size=25))
    r = FrequencyResponse(f, truth * (1 + noise), None, sigma, "")
    fit = r.lag(order)

    def cost(gain, delay, corner=math.inf):
        value = gain * np.exp(-s * delay) / (1 + s / (2 * np.pi * corner))
        miss = np.abs(value / r.response - 1)
        return np.sum((miss / np.maximum(sigma, 1e-3)) ** 2), miss

    numbers = [fit.gain, fit.delay_s, fit.natural_Hz][: 2 + order]
    assert (fit.order, fit.natural_Hz is None, fit.damping) == (order, not order, None)
    least, miss = cost(*numbers)
    assert fit.misfit == pytest.approx(math.sqrt(np.mean(miss**2)))
    # No number a little off does better.
    for k in range(len(numbers)):
        for share in (0.999, 1.001):
            moved = [x * (share if i == k else 1) for i, x in enumerate(numbers)]
            assert cost(*moved)[0] > least
    band = r.lag(order, low_Hz=f[5], high_Hz=f[19])
    part = FrequencyResponse(f[5:20], r.response[5:20], None, sigma[5:20], "").lag(order)
    assert band.gain == pytest.approx(part.gain, rel=1e-6)
