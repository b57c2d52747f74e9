"""Smoothness metrics: the published package's values, closed forms, invariances, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from esea_host.smoothness import (
    NoAnswerError,
    derivatives,
    dimensionless_jerk,
    ldlj,
    peak_speed_ratio,
    resampled,
    rms_acceleration,
    sensitivity_band,
    sparc,
    steady_rate,
    submovements,
    vdv,
)
from tests.conftest import ROOT

TRACKED_HZ = (0.1, 0.2, 0.4, 0.5)


def tau(n):
    return np.arange(n) / n


def minimum_jerk(n):
    """Speed over the path's length over the duration."""
    return 30 * tau(n) ** 2 * (1 - tau(n)) ** 2


def tracked(duration_s, fs_Hz, order=0):
    """The order-th derivative of the thesis' target, 0.04 rad at each of four frequencies."""
    t = np.arange(round(duration_s * fs_Hz)) / fs_Hz
    w = 2 * np.pi * np.array(TRACKED_HZ)[:, None]
    return np.sum(0.04 * w**order * np.sin(w * t + order * np.pi / 2), axis=0)


PROFILES = {
    "minimum jerk": (minimum_jerk(200), 100.0),
    "gauss": (np.exp(-5 * (np.arange(200) / 100 - 1) ** 2), 100.0),
    "two bells": (
        np.exp(-40 * (tau(300) - 0.3) ** 2) + 0.6 * np.exp(-60 * (tau(300) - 0.75) ** 2),
        100.0,
    ),
    "four sines": (np.abs(tracked(45, 100, 1)), 100.0),
    "signed swing": (np.sin(6 * np.pi * tau(1000)) * np.sin(np.pi * tau(1000)) ** 2, 1000.0),
    "odd length": (
        (1 - np.cos(2 * np.pi * tau(137))) * (1 + 0.3 * np.sin(8 * np.pi * tau(137))),
        60.0,
    ),
}
# Values of github.com/siva82kb/SPARC, scripts/smoothness.py at 3650934, on these profiles with
# NumPy 2.4: sparc(v, fs)[0], sparc(v, fs, fc=4.0)[0], dimensionless_jerk(v, fs) and
# log_dimensionless_jerk(v, fs).
PUBLISHED = {
    "minimum jerk": (-1.4058292842, -1.4058292842, -194.911798752, -5.2725471421),
    "gauss": (-1.4140312617, -1.4140312617, -335.746837033, -5.8163574148),
    "two bells": (-1.7421945765, -1.7421945765, -1719.87425366, -7.4500064588),
    "four sines": (-5.2527524322, -5.2527524322, -2361246757.08, -21.5824556034),
    "signed swing": (-2.1756492992, -1.7815155327, -33093.5084632, -10.4070924232),
    "odd length": (-1.7607951237, -1.7607951237, -4892.44584241, -8.4954476297),
}


# -- agreement ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROFILES)
def test_the_published_package_agrees(name):
    speed, fs_Hz = PROFILES[name]
    ten, four, jerk, log_jerk = PUBLISHED[name]
    assert sparc(speed, fs_Hz=fs_Hz, convention="reference").value == pytest.approx(ten, abs=1e-8)
    assert sparc(speed, fs_Hz, cutoff_Hz=4.0).value == pytest.approx(four, abs=1e-8)
    assert dimensionless_jerk(speed, fs_Hz).value == pytest.approx(jerk, rel=1e-8)
    found = ldlj(speed, fs_Hz=fs_Hz, convention="reference").value
    assert found == pytest.approx(log_jerk, abs=1e-8)
    assert type(found) is float


def test_minimum_jerk_in_closed_form():
    """Derived from the position's polynomial: 720/1.875^2 = 204.8, whatever length and duration."""
    t, T, A = sp.symbols("t T A", positive=True)
    s = t / T
    speed = sp.diff(A * (10 * s**3 - 15 * s**4 + 6 * s**5), t)
    peak = speed.subs(t, T / 2)
    jerk = sp.integrate(sp.expand(sp.diff(speed, t, 2) ** 2), (t, 0, T))
    exact = sp.simplify(T**3 / peak**2 * jerk)
    assert exact == sp.Rational(1024, 5)
    ratio = sp.simplify(peak / (sp.integrate(sp.expand(speed), (t, 0, T)) / T))
    n = 40_000
    assert dimensionless_jerk(minimum_jerk(n), 1e4).value == pytest.approx(-float(exact), rel=5e-4)
    assert ldlj(minimum_jerk(n), 1e4).value == pytest.approx(-math.log(exact), abs=5e-4)
    assert peak_speed_ratio(minimum_jerk(n), 1e4).value == pytest.approx(float(ratio), rel=1e-6)
    # The thesis' exponents with a sum for the integral: T^2 and the sampling rate more.
    thesis = ldlj(minimum_jerk(n), 1e4, "thesis").value
    assert thesis == pytest.approx(math.log(float(exact) * 4.0**2 * 1e4), abs=5e-4)


def test_spectral_arc_length_of_a_gauss_bell_by_quadrature():
    """Its spectrum is a Gauss bell: the arc up to where that falls to 5 % is an integral."""
    width_s, fs_Hz = 0.1, 1000.0
    speed = np.exp(-0.5 * (np.arange(-1, 1, 1 / fs_Hz) / width_s) ** 2)
    end_Hz = math.sqrt(2 * math.log(20)) / (2 * math.pi * width_s)

    def slope(f):
        k = (2 * math.pi * width_s) ** 2
        return k * f * math.exp(-0.5 * k * f**2)

    arc, _ = quad(lambda f: math.hypot(1 / end_Hz, slope(f)), 0, end_Hz)
    assert sparc(speed, fs_Hz).value == pytest.approx(-arc, abs=2e-3)
    assert sparc(speed, fs_Hz, padlevel=8).value == pytest.approx(-arc, abs=2e-4)


def test_rms_and_vibration_dose_of_a_sine():
    """Over whole periods: A/sqrt(2), and (3/8 A^4 T)^(1/4)."""
    a = 7.0 * np.sin(2 * np.pi * 2 * np.arange(5000) / 1000)
    assert rms_acceleration(a, 1000.0).value == pytest.approx(7 / math.sqrt(2))
    dose = (3 / 8 * 7**4 * 5) ** 0.25
    assert vdv(a, 1000.0).value == pytest.approx(dose)
    assert vdv(a, 1000.0).unit == "deg/s^2 * s^0.25"
    assert vdv(a, 1000.0, "thesis").value == pytest.approx(dose * 1000**0.25)


@pytest.mark.parametrize(("frequency_Hz", "count"), [(0.5, 1), (1.0, 2), (2.0, 4)])
def test_submovements_are_the_bells(frequency_Hz, count):
    speed = np.abs(np.sin(2 * np.pi * frequency_Hz * np.arange(1000) / 1000))
    assert submovements(speed, 1000.0).value == count


# -- what a metric claims not to see --------------------------------------------------------------

bells = st.lists(
    st.tuples(st.floats(0.1, 1), st.floats(0.2, 0.8), st.floats(0.06, 0.3)), min_size=1, max_size=4
)


def speed_of(bell_list, n=400):
    speed = sum(a * np.exp(-0.5 * ((tau(n) - at) / width) ** 2) for a, at, width in bell_list)
    return speed * np.sin(np.pi * tau(n)) ** 2


METRICS = (sparc, ldlj, dimensionless_jerk, peak_speed_ratio, submovements)


@given(bells, st.floats(1e-3, 1e3))
def test_amplitude_does_not_matter(bell_list, factor):
    speed = speed_of(bell_list)
    for metric in METRICS:
        one, other = metric(speed, 200.0).value, metric(factor * speed, 200.0).value
        assert other == pytest.approx(one, rel=1e-9)
    assert ldlj(factor * speed, 200.0, "thesis").value == pytest.approx(
        ldlj(speed, 200.0, "thesis").value, rel=1e-9
    )


@given(bells, st.floats(0.3, 3))
def test_duration_does_not_matter_to_the_reference(bell_list, factor):
    """The same samples, faster or slower.  Arc length: where the band scales with them."""
    speed = speed_of(bell_list)
    for metric in METRICS[1:]:
        one, other = metric(speed, 200.0).value, metric(speed, 200.0 * factor).value
        assert other == pytest.approx(one, rel=1e-9)
    one = sparc(speed, 200.0, cutoff_Hz=20.0).value
    assert sparc(speed, 400.0, cutoff_Hz=40.0).value == pytest.approx(one, rel=1e-9)
    # The thesis' exponent of T is two too many, and its sum has no time step.
    slower = ldlj(speed, 200.0 * factor, "thesis").value
    assert slower == pytest.approx(ldlj(speed, 200.0, "thesis").value - math.log(factor), rel=1e-9)


@given(bells)
def test_a_stack_is_its_movements(bell_list):
    stack = np.array([speed_of(bell_list), speed_of(bell_list[:1]), minimum_jerk(400)])
    for metric in METRICS:
        values = metric(stack, 200.0).value
        assert values.shape == (3,)
        assert values == pytest.approx([metric(row, 200.0).value for row in stack], rel=1e-12)


# -- what has no answer ---------------------------------------------------------------------------

GOOD = minimum_jerk(200)


def with_nan():
    speed = GOOD.copy()
    speed[77:80] = np.nan
    return speed


ALL = (sparc, ldlj, dimensionless_jerk, submovements, peak_speed_ratio, rms_acceleration, vdv)


@pytest.mark.parametrize("metric", ALL)
@pytest.mark.parametrize(
    ("signal", "fs_Hz", "reason", "words"),
    [
        (np.zeros(200), 100.0, "constant", "constant"),
        (np.full(200, 0.1), 100.0, "constant", "constant"),
        (with_nan(), 100.0, "gap", "3 of 200 samples are NaN or infinite, the first is sample 77"),
        (np.where(GOOD > 1, np.inf, GOOD), 100.0, "gap", "infinite"),
        (GOOD[:9], 100.0, "short", "9 samples, too short: at least 10"),
        ([], 100.0, "shape", "shape"),
        (np.ones((2, 3, 4)), 100.0, "shape", "shape"),
        (np.ma.masked_inside(GOOD, 1, 1.2), 100.0, "gap", "samples are NaN"),
        (GOOD, 0.0, "rate", "0"),
        (GOOD, math.nan, "rate", "nan"),
        (GOOD, -5, "rate", "-5"),
        (GOOD, "100", "rate", "100"),
    ],
)
def test_no_number_without_an_answer(metric, signal, fs_Hz, reason, words):
    with pytest.raises(NoAnswerError, match=words) as caught:
        metric(signal, fs_Hz)
    assert caught.value.reason == reason
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    "metric", [sparc, ldlj, dimensionless_jerk, submovements, peak_speed_ratio]
)
def test_aliased(metric):
    """A tremor of 49.5 Hz at 100 Hz, or noise alone; but a tenth of noise on a reach is let by."""
    rng = np.random.default_rng(3)
    t = np.arange(200) / 100
    noise = rng.normal(size=200)
    for signal in (GOOD + np.sin(2 * np.pi * 49.5 * t), noise, np.resize([0.0, 1.0], 200)):
        with pytest.raises(NoAnswerError, match="aliased"):
            metric(signal, 100.0)
    metric(GOOD + 0.1 * 1.875 * noise, 100.0)


RATES_HZ = (59.94, 60, 75, 90, 100, 120, 128, 148, 240, 256, 300, 1000)


@given(
    st.sampled_from(RATES_HZ),
    st.sampled_from((2, 3)),
    st.integers(150, 1500),
    st.floats(0, 2),
    st.sampled_from((np.round, np.floor)),
)
def test_rounded_stamps_are_a_steady_rate_and_a_lost_frame_is_a_gap(rate, digits, n, start, how):
    """Two decimals up to 150 Hz; the metrics are those of the true times."""
    if digits == 2 and rate > 150:
        rate = 60
    true = (0.0 if rate in (100, 1000) else start) + np.arange(n) / rate
    # Of a whole number of roundings, the sum's last bit would decide.
    stamps = how(true * 10**digits + 1e-6) / 10**digits
    fs_Hz = steady_rate(stamps)
    assert fs_Hz == pytest.approx(rate, rel=2 * 10.0**-digits * rate / (n - 1) + 1e-6)
    u = np.clip(1.2 * np.arange(n) / n - 0.1, 0, 1)
    speed = u**2 * (1 - u) ** 2
    for metric in (sparc, ldlj):
        assert metric(speed, fs_Hz, time_s=stamps).value == pytest.approx(
            metric(speed, rate).value, rel=0.02
        )
    lost = np.delete(stamps, n // 2)
    with pytest.raises(NoAnswerError, match="gap"):
        sparc(speed[1:], steady_rate(lost), time_s=lost)


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (np.cumsum(np.repeat([0.003, 0.004], 300)), "no steady rate"),  # one rate, then another
        (np.round(np.arange(300) / 500, 2), "too coarse"),  # five frames share a stamp
        (np.round(np.arange(300) / 99.5, 2), "too coarse"),  # one long step, as of a lost frame
        (np.round(np.arange(300) / 60 + 0.004 * (np.arange(300) % 3), 3), "gap"),  # jitter
    ],
)
def test_stamps_that_rounding_does_not_explain(stamps, words):
    with pytest.raises(NoAnswerError, match=words):
        sparc(np.hanning(len(stamps)), steady_rate(stamps), time_s=stamps)


@given(st.integers(0, 99), st.sampled_from((60.0, 120.0)))
def test_resampling_irregular_frames_gives_the_metrics_of_regular_ones(seed, rate):
    """Minimum jerk of 2 s; frames up to 0.2 periods early or late, three of them lost."""
    rng, n = np.random.default_rng(seed), int(4 * rate)
    t = np.arange(n) / rate

    def position(at):
        u = np.clip((at - 1) / 2, 0, 1)
        return 30 * u**3 * (10 - 15 * u + 6 * u**2)

    frames = np.delete(t + rng.uniform(-0.2, 0.2, n) / rate, [n // 3, n // 2, n // 2 + 1])
    made = resampled(frames, position(frames), rate)
    assert (made.frames, made.missing, made.merged) == (n - 3, 0, 0)
    assert made.bridged >= 2
    assert np.max(np.abs(made.values - position(made.time_s))) < 0.02
    chains = [derivatives(x, rate) for x in (made.values, position(t))]
    for of in (lambda d: sparc(d.speed, rate), lambda d: ldlj(d.velocity, rate, jerk=d.jerk)):
        mine, true = (of(d).value for d in chains)
        assert mine == pytest.approx(true, rel=0.01)
    for bad in (np.delete(frames, range(n // 2, n // 2 + 10)), frames[::-1], frames[:5]):
        with pytest.raises(NoAnswerError):
            resampled(bad, position(bad), rate)
    for bad_rate in (rate / 2, 20 * rate, math.nan):
        with pytest.raises(NoAnswerError):
            resampled(frames, position(frames), bad_rate)


def test_a_gap_in_time_is_found_and_a_steady_rate_is_not_one():
    t = np.arange(200) / 100
    assert sparc(GOOD, 100.0, time_s=t + 1e9).value == sparc(GOOD, 100.0).value
    late = np.where(np.arange(200) > 120, t + 0.3, t)
    for metric in ALL:
        with pytest.raises(NoAnswerError, match=r"0.31 s after sample 120") as caught:
            metric(GOOD, 100.0, time_s=late)
        assert caught.value.reason == "gap"
    with pytest.raises(NoAnswerError, match="one time for each"):
        sparc(GOOD, 100.0, time_s=t[1:])


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda: sparc(GOOD, 19.0), "cutoff"),
        (lambda: sparc(GOOD, 100.0, cutoff_Hz=51.0), "cutoff"),
        (lambda: sparc(GOOD, 100.0, cutoff_Hz=math.nan), "cutoff"),
        (lambda: sparc(GOOD[:20], 1000.0), "short"),
        (lambda: sparc(np.sin(2 * np.pi * 30 * np.arange(2000) / 1000), 1000.0), "cutoff"),
        (lambda: sparc(GOOD, 100.0, threshold=1.0), "setting"),
        (lambda: sparc(GOOD, 100.0, "mine"), "setting"),
        (lambda: ldlj(GOOD, 100.0, "iso2631"), "setting"),
        (lambda: ldlj(np.arange(200.0), 100.0), "constant"),
        (lambda: ldlj(GOOD, 100.0, jerk=GOOD[1:]), "shape"),
        (lambda: vdv(GOOD, 100.0, "reference"), "setting"),
        (lambda: submovements(GOOD, 100.0, threshold=0.0), "setting"),
        (lambda: derivatives(GOOD, 100.0, 50.0), "cutoff"),
        (lambda: derivatives(GOOD[:50], 100.0), "short"),
        (lambda: derivatives(np.zeros(200), 100.0), "constant"),
        (lambda: derivatives(with_nan(), 100.0), "gap"),
        (lambda: derivatives(GOOD, 100.0).last(3.0), "short"),
        (lambda: derivatives(GOOD, 100.0).last(math.nan), "short"),
    ],
)
def test_settings_without_an_answer(call, reason):
    with pytest.raises(NoAnswerError) as caught:
        call()
    assert caught.value.reason == reason


# -- chain and band -------------------------------------------------------------------------------


def test_the_chain_gives_the_derivatives_without_delay():
    """Of the thesis' target, whose derivatives are known; the ends are cut off."""
    found = derivatives(tracked(60, 1000), 1000.0)
    inside = slice(3000, -3000)
    for order, name in enumerate(("position", "velocity", "acceleration", "jerk")):
        exact = tracked(60, 1000, order)
        error = getattr(found, name)[inside] - exact[inside]
        assert np.max(np.abs(error)) < 1.5e-3 * np.max(np.abs(exact)), name
    kept = found.last(45.0)
    assert kept.speed == pytest.approx(np.abs(found.velocity[-45_000:]))
    assert kept.processing.stop_Hz == 4.0
    assert 2.9 < kept.processing.half_power_Hz < 3.2


def test_nothing_from_4_Hz_on_passes():
    """60 dB each time: a tremor of 5 Hz on the target is not in the jerk, where it was 30 times."""
    t = np.arange(60_000) / 1000
    shaken = derivatives(tracked(60, 1000) + 0.01 * np.sin(2 * np.pi * 5 * t), 1000.0)
    quiet = derivatives(tracked(60, 1000), 1000.0)
    inside = slice(3000, -3000)
    change = np.max(np.abs(shaken.jerk - quiet.jerk)[inside])
    assert change < 1e-3 * np.max(np.abs(quiet.jerk))
    passed = derivatives(tracked(60, 1000) + 0.01 * np.sin(2 * np.pi * 5 * t), 1000.0, 12.0)
    assert np.max(np.abs(passed.jerk - quiet.jerk)[inside]) > 100 * change


def test_the_band_over_cut_off_and_threshold():
    speed, fs_Hz = PROFILES["signed swing"]
    band = sensitivity_band(
        lambda **s: sparc(speed, fs_Hz, **s),
        cutoff_Hz=(4.0, 10.0, 20.0, 900.0),
        threshold=(0.02, 0.05, 0.1),
    )
    by_hand = [
        sparc(speed, fs_Hz, cutoff_Hz=c, threshold=h).value
        for c in (4.0, 10.0, 20.0)
        for h in (0.02, 0.05, 0.1)
    ]
    assert (band.low, band.high) == (min(by_hand), max(by_hand))
    assert band.value == sparc(speed, fs_Hz).value
    # A setting without an answer is named, not dropped.
    assert len(band.refused) == 3
    assert "cutoff_Hz = 900" in band.refused[0]


# Of the published package on tests/data/reaches, at 100 Hz: SPARC, LDLJ; numpy 2.
REACHES = {
    ("cp01-1", 5): (-1.3956152212559843, -13.43838147188516),
    ("cp01-1", 7): (-1.5043243200233287, -14.579279813224739),
    ("ap01-1", 5): (-1.5335522922280587, -15.13438645203577),
    ("ap01-1", 7): (-1.7013461203471705, -14.96188967707367),
    ("pp01-1", 5): (-2.0924219253496044, -16.014033513014198),
    ("pp01-1", 7): (-3.3964552741892295, -19.311023657663814),
}


def reach_speed(x, y, time_s):
    """Speed of a reach at 100 Hz."""
    steady = np.arange(0, time_s[-1], 0.01)
    return np.hypot(*(np.gradient(np.interp(steady, time_s, p), 0.01) for p in (x, y)))


def test_a_few_recorded_reaches_agree_with_the_published_package():
    rows = np.genfromtxt(
        ROOT / "tests/data/reaches/reaches.csv", delimiter=",", names=True, dtype=None
    )
    for (recording, reach), (arc, jerk) in REACHES.items():
        own = rows[(rows["recording"] == recording) & (rows["reach"] == reach)]
        speed = reach_speed(own["x_px"], own["y_px"], own["time_ms"] / 1000)
        assert sparc(speed, 100.0).value == pytest.approx(arc, abs=1e-8)
        assert ldlj(speed, 100.0).value == pytest.approx(jerk, abs=1e-8)
