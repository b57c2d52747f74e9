"""Windows of a sweep, deviations of its fits, and what tables say: each number another way."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest

from esea_gen.analysis.frequency import HALF_POWER_DB, FrequencyResponse
from esea_gen.analysis.impedance import ImpedanceFit, OutputImpedance, impedance
from esea_gen.analysis.sweeps import Sweep, periodic_response, sweep_response
from esea_gen.errors import UserError

H = 1e-3


def test_numbers_that_stand_where_none_is_given():
    defaults = {
        FrequencyResponse.lag: {"order": 0, "low_Hz": 0.0, "high_Hz": math.inf},
        FrequencyResponse.table: {"rows": 12},
        FrequencyResponse.band: {"low_Hz": 0.0, "high_Hz": math.inf, "min_coherence": 0.0},
        FrequencyResponse.bandwidth: {
            "drop_dB": pytest.approx(3.0103, abs=1e-5),
            "passband_gain": None,
            "min_coherence": 0.0,
        },
        OutputImpedance.table: {"rows": 12, "low_Hz": 0.0, "high_Hz": math.inf},
        OutputImpedance.fit: {"low_Hz": 0.0, "high_Hz": math.inf},
        impedance: {"motion": "angle", "sign": -1.0},
        periodic_response: {"skip": 1},
        sweep_response: {"resolution_Hz": 1.0, "cycles": 3.0, "points": 200},
    }
    for function, expected in defaults.items():
        given = inspect.signature(function).parameters.values()
        assert {p.name: p.default for p in given if p.default is not p.empty} == expected
    assert pytest.approx(10 * math.log10(2), rel=1e-15) == HALF_POWER_DB


def swept(rate_Hz_s=2.0, start_Hz=1.0, end_Hz=21.0, start_s=3.0, **spoilt):
    sweep = Sweep(start_Hz, end_Hz, (end_Hz - start_Hz) / rate_Hz_s, start_s)
    t = np.arange(0.0, start_s + sweep.duration_s + 2, 2e-3)
    return t, np.sin(sweep.phase_rad(t)), sweep


@pytest.mark.parametrize(
    ("rate", "resolution", "cycles"), [(2.0, 1.0, 3.0), (0.5, 2.0, 3.0), (4.0, 0.5, 8.0)]
)
def test_where_a_window_of_a_sweep_fits(rate, resolution, cycles):
    t, u, sweep = swept(rate, 1.0, 21.0)
    r = sweep_response(t, u, 2 * u, sweep, resolution_Hz=resolution, cycles=cycles, points=60)
    # From where the sweep itself has had half the cycles; as long as the resolution or cycles.
    lowest = max(1.0, math.sqrt(rate * cycles / 2))
    fits = []
    for f in np.geomspace(lowest, 21.0, 60):
        half = max(resolution / rate, cycles / f) / 2
        centre = 3.0 + (f - 1.0) / rate
        if centre - half >= 3.0 and centre + half <= 3.0 + sweep.duration_s:
            fits.append(f)
    assert r.frequency_Hz == pytest.approx(fits)
    assert r.response == pytest.approx(2.0, abs=1e-9)
    assert r.method == f"sweep 1 to 21 Hz, local fits over {resolution:g} Hz"


def test_a_record_that_ends_before_the_sweep_keeps_what_it_has():
    t, u, sweep = swept()
    cut = (t > 6.0) & (t < 9.0)
    r = sweep_response(t[cut], u[cut], u[cut], sweep, points=100)
    # Of 2 Hz a second: from 7 to 13 Hz, less half a window of half a second at either end.
    first, last = 1 + 2 * (6.0 + 0.25 - 3), 1 + 2 * (9.0 - 0.25 - 3)
    step = (21 / math.sqrt(3)) ** (1 / 99)
    assert first <= r.frequency_Hz[0] <= first * step
    assert last / step**1.1 <= r.frequency_Hz[-1] <= last


def test_windows_of_few_samples_are_left_out():
    # Four samples a cycle at 80 a second are up to 20 Hz.
    sweep = Sweep(1.0, 31.0, 30.0)
    t = np.arange(0, 30, 1 / 80)
    u = np.sin(sweep.phase_rad(t))
    r = sweep_response(t, u, u, sweep)
    assert 19.0 < r.frequency_Hz[-1] < 20.5
    # Sixteen samples a window at least.
    few = np.arange(0, 30, 1 / 8)
    with pytest.raises(UserError, match="0 of 200 windows fit"):
        sweep_response(few, np.sin(sweep.phase_rad(few)), few, sweep)


def test_deviation_of_a_windows_fit_is_that_of_weighted_least_squares():
    t, u, sweep = swept()
    y = u + np.random.default_rng(3).normal(0, 0.3, len(t))
    r = sweep_response(t, u, y, sweep, points=12)
    k = 5
    f = r.frequency_Hz[k]
    centre, half = 3.0 + (f - 1.0) / 2.0, max(0.5, 3 / f) / 2
    at = (t >= centre - half) & (t < centre + half)
    s, phase = (t[at] - centre) / half, sweep.phase_rad(t[at])
    w = (1 + np.cos(np.pi * s)) / 2
    c, d = np.cos(phase), np.sin(phase)
    base = np.stack([c, d, s * c, s * d, np.ones(len(s)), s], axis=1)
    fits, rests = [], []
    for x in (u[at], y[at]):
        found = np.linalg.solve(base.T @ np.diag(w) @ base, base.T @ (w * x))
        fits.append(found[0] - 1j * found[1])
        rests.append(x - base @ found)
    assert r.response[k] == pytest.approx(fits[1] / fits[0], rel=1e-9)
    # White's estimate: the scatter itself, weighted, through the fit's linear map.
    through = np.linalg.solve(base.T @ np.diag(w) @ base, base.T * w)
    cov = through @ np.diag(rests[1] ** 2) @ through.T
    deviation = math.sqrt((cov[0, 0] + cov[1, 1]) / 2) / abs(fits[1])
    assert r.sigma[k] == pytest.approx(deviation, rel=1e-9)
    mean = np.sum(w * y[at]) / np.sum(w)
    share = 1 - np.sum(w * rests[1] ** 2) / np.sum(w * (y[at] - mean) ** 2)
    assert r.coherence[k] == pytest.approx(share, rel=1e-9)


@pytest.mark.parametrize("wrong", [{"start_Hz": -0.1}, {"duration_s": 0.0}, {"end_Hz": math.inf}])
def test_sweeps_that_are_none_are_refused(wrong):
    Sweep(0.0, 1.0, 2.0)
    with pytest.raises(UserError, match="Give finite ends"):
        Sweep(**{"start_Hz": 0.0, "end_Hz": 1.0, "duration_s": 2.0} | wrong)
    t, u, sweep = swept()
    for more in ({"resolution_Hz": 0.0}, {"cycles": 0.99}, {"points": 3}):
        with pytest.raises(UserError, match="at least 1 cycle and 4 points"):
            sweep_response(t, u, u, sweep, **more)


def driving_point():
    f = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
    s = 2j * np.pi * f
    z = 3.0 + 0.2 * s + 0.01 * s * s
    z = z * (1 + np.array([0.02, -0.03j, 0.01, 0.04j, -0.02]))
    return f, z


def test_the_fit_of_a_driving_point_by_normal_equations():
    f, z = driving_point()
    fit = impedance(FrequencyResponse(f, z, None, None, "m"), sign=1.0).fit()
    w = 2 * np.pi * f
    # Unknown J, B, K of z = K + j w B - w^2 J; each line over |z|, real and imaginary part.
    rows = np.concatenate(
        [
            np.stack([-(w**2), 0 * w, 1 + 0 * w], axis=1) / np.abs(z)[:, None],
            np.stack([0 * w, w, 0 * w], axis=1) / np.abs(z)[:, None],
        ]
    )
    wanted = np.concatenate([z.real, z.imag]) / np.concatenate([np.abs(z)] * 2)
    normal = np.linalg.inv(rows.T @ rows)
    found = normal @ rows.T @ wanted
    rest = wanted - rows @ found
    spread = np.sqrt(np.diag(normal) * (rest @ rest) / (10 - 3))
    assert [fit.inertia_kgm2, fit.damping_Nms_rad, fit.stiffness_Nm_rad] == pytest.approx(found)
    assert [fit.inertia_std, fit.damping_std, fit.stiffness_std] == pytest.approx(spread)
    assert fit.misfit == pytest.approx(math.sqrt((rest @ rest) / 5))
    assert (fit.low_Hz, fit.high_Hz) == (0.5, 8.0)


def test_the_table_of_a_driving_point(monkeypatch):
    f, z = driving_point()
    found = impedance(FrequencyResponse(f, -z, None, None, "a method"))
    assert found.per_angle == pytest.approx(z)
    numbers = (0.0123, 0.25, 3.5, 0.00045, 0.0067, 0.089, 0.5, 8.0)
    for misfit, said in ((0.2, "0.2"), (0.21, "0.21, above 0.2: not one mass, damper and spring")):
        monkeypatch.setattr(
            OutputImpedance, "fit", lambda self, *band, m=misfit: ImpedanceFit(*numbers, m)
        )
        assert found.table(3) == [
            "a method",
            "        Hz   gain dB  phase deg  coherence",
            *(
                f"{hz:10.3g}{20 * math.log10(abs(v)):10.2f}{math.degrees(np.angle(v)):11.1f}"
                for hz, v in ((f[0], z[0]), (f[2], z[2]), (f[4], z[4]))
            ),
            "fit from 0.5 to 8 Hz, torque that the moving needs:",
            "inertia 0.0123 +- 0.00045 kg m2",
            "damping 0.25 +- 0.0067 Nms/rad",
            "stiffness 3.5 +- 0.089 Nm/rad",
            f"relative misfit {said}",
        ]
    told = found.to_dict()
    assert told["rate_gain"] == pytest.approx(np.abs(z / (2j * np.pi * f)))
    assert told["rate_phase_deg"] == pytest.approx(np.degrees(np.angle(z / (2j * np.pi * f))))
    assert told["gain"] == pytest.approx(np.abs(z))


def test_of_a_rate_the_angle_is_a_quarter_turn_on():
    f, z = driving_point()
    s = 2j * np.pi * f
    of_rate = impedance(FrequencyResponse(f, z / s, None, None, ""), motion="rate", sign=1.0)
    assert of_rate.per_angle == pytest.approx(z)
    for motion, sign in (("angle", 0.5), ("speed", 1.0)):
        with pytest.raises(ValueError, match="must be"):
            impedance(FrequencyResponse(f, z, None, None, ""), motion=motion, sign=sign)


def test_rows_of_a_table_are_those_nearest_to_an_even_spread():
    f = np.array([1.0, 1.1, 1.2, 9.0, 10.0, 100.0])
    r = FrequencyResponse(
        f, np.array([1, 1, 1, 0.5, 0.5j, 0.1j]), np.linspace(0.9, 0.4, 6), None, "m"
    )
    assert r.table(3) == [
        "m",
        "        Hz   gain dB  phase deg  coherence",
        "         1      0.00        0.0      0.900",
        "        10     -6.02       90.0      0.500",
        "       100    -20.00       90.0      0.400",
    ]
    assert len(r.table(2)) == 4


@pytest.mark.parametrize("change", [[0.0, 1.0], [-1.0, 1.0], [1.0, 1.0], [2.0, 1.0], [1.0]])
def test_frequencies_rise_from_above_0(change):
    with pytest.raises(UserError, match="frequencies above 0 that rise"):
        FrequencyResponse(np.array(change), np.ones(2, complex), None, None, "")


def test_bands_keep_their_ends_and_four_points():
    f = np.arange(1.0, 8.0)
    c = np.array([0.1, 0.5, 0.5, 0.6, 0.7, 0.8, 0.9])
    r = FrequencyResponse(f, np.ones(7, complex), c, c / 10, "")
    part = r.band(2.0, 6.0, 0.5)
    assert part.frequency_Hz.tolist() == [2, 3, 4, 5, 6]
    assert part.coherence.tolist() == c[1:6].tolist()
    assert part.sigma.tolist() == (c / 10)[1:6].tolist()
    assert len(r.band(4.0, 7.0).frequency_Hz) == 4
    with pytest.raises(UserError, match="3 points between 5 and 7 Hz"):
        r.band(5.0, 7.0)
    with pytest.raises(UserError, match=r"3 points between 0 and inf Hz with coherence above 0\.7"):
        r.band(0.0, math.inf, 0.7)


def test_the_phase_of_a_sweep_is_the_integral_of_its_frequency():
    sweep = Sweep(0.5, 3.5, 10.0, 2.0)
    assert sweep.rate_Hz_s == pytest.approx(0.3)
    # After 1, 5 and 10 s: 0.5 t + 0.15 t^2 turns; at its end 3.5 Hz.
    t = np.array([2.0, 3.0, 7.0, 12.0])
    turns = np.array([0.0, 0.65, 6.25, 20.0])
    assert sweep.phase_rad(t) == pytest.approx(2 * np.pi * turns)


@pytest.mark.parametrize(("points", "enough"), [(5, True), (4, False)])
def test_four_windows_are_enough(points, enough):
    sweep = Sweep(0.0, 20.0, 10.0)
    t = np.arange(0.0, 10.0, 2e-3)
    u = np.sin(sweep.phase_rad(t))
    if enough:
        # The last of five frequencies is the sweep's end, round which no window fits.
        r = sweep_response(t, u, 3 * u, sweep, points=points)
        assert r.frequency_Hz == pytest.approx(np.geomspace(math.sqrt(3.0), 20.0, 5)[:4])
    else:
        with pytest.raises(
            UserError, match=r"3 of 4 windows fit into the sweep from 0 to 9\.998 s"
        ):
            sweep_response(t, u, 3 * u, sweep, points=points)
