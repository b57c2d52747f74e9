"""Standard deviations and torque band: coverage under four kinds of error."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.identify.recording.resampling import FitRows, LeftOut, covered, resampled

# A known rubber: springs and two stops; five amplitudes of four cycles, of which the first
# conditions, the last judges.
WEIGHTS = np.array([2.0, 1.5, 3.0, 1.0])
AMPLITUDES, CYCLES, PER = (0.3, 0.5, 0.7, 0.85, 1.0), 4, 200
COUNT = len(AMPLITUDES) * CYCLES * PER
X = np.repeat(AMPLITUDES, CYCLES * PER) * np.sin(2 * np.pi * np.arange(COUNT) / PER)
PLACE = np.arange(COUNT) % (CYCLES * PER) // PER
TRAINS, JUDGES = (PLACE > 0) & (PLACE < CYCLES - 1), PLACE == CYCLES - 1
CASES = ("white", "alike", "harmonic", "friction")


def play(x: np.ndarray, r: float) -> np.ndarray:
    out, state = [], 0.0
    for value in x.tolist():
        state = min(max(state, value - r), value + r)
        out.append(state)
    return np.array(out)


def terms(x: np.ndarray) -> np.ndarray:
    return np.stack([x, x**3, x - play(x, 0.07), x - play(x, 0.3)], axis=1)


TRUE = terms(X)


def measured(case: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Terms of the deflection that the encoder shows, and the torque, Nm of 6."""
    shown, torque = TRUE, TRUE @ WEIGHTS
    if case == "white":
        return shown, torque + rng.normal(0, 0.05, COUNT)
    if case == "alike":
        noise = rng.normal(0, 0.05, COUNT)
        for i in range(1, COUNT):
            noise[i] = 0.98 * noise[i - 1] + np.sqrt(1 - 0.98**2) * noise[i]
        return shown, torque + noise
    torque = torque + rng.normal(0, 0.01, COUNT)
    if case == "harmonic":  # 0.1 deg of an encoder, on a coupling of 0.2 rad
        phase, waves = rng.uniform(0, 2 * np.pi), rng.uniform(1, 3)
        return terms(X + 0.00873 * np.sin(2 * np.pi * waves * X + phase)), torque
    return shown, torque + 0.08 * np.tanh(np.gradient(X) / 0.002)


def one(case: str, seed: int) -> tuple[np.ndarray, LeftOut, float]:
    """Error of the weights, what is said of it, and the share of judging samples in the band."""
    shown, torque = measured(case, np.random.default_rng(seed))
    fit = np.linalg.lstsq(shown[TRAINS], torque[TRAINS], rcond=None)[0]
    each = np.split(np.sign(np.gradient(shown[:, 0]))[TRAINS], len(AMPLITUDES))
    rows = FitRows.of([(i, CYCLES - 2, w) for i, w in enumerate(each)])
    residual = (torque - shown @ fit)[TRAINS]
    found = resampled(shown[TRAINS], residual, np.ones(len(residual)), rows, False)
    return fit - WEIGHTS, found, covered((torque - shown @ fit)[JUDGES], found.band_Nm)


def sweep(case: str, seeds: range) -> tuple[float, float, int]:
    """RMS error over RMS deviation said; share of samples inside the band; friction seen."""
    errors, said, inside, seen = [], [], [], 0
    for seed in seeds:
        error, found, share = one(case, seed)
        errors.append(error)
        said.append(found.sigma)
        inside.append(share)
        seen += found.friction_Nm is not None
    ratio = np.mean(np.square(errors), axis=0) / np.mean(np.square(said), axis=0)
    return float(np.sqrt(ratio.mean())), float(np.mean(inside)), seen


@pytest.mark.parametrize("case", CASES)
def test_what_is_said_covers(case):
    """A sample of the sweep below, wide enough for eight runs."""
    ratio, inside, seen = sweep(case, range(8))
    assert 0.5 < ratio < 1.6
    assert 0.92 < inside < 0.98
    assert (seen == 8) if case == "friction" else (seen <= 1)


def test_leaving_out_is_what_fits_without_the_block_give():
    """Against a fit anew for every block, weights of rows included; both levels, their mean."""
    rng = np.random.default_rng(2)
    j, weight = rng.normal(size=(240, 3)), rng.uniform(0.5, 2, 240)
    y = j @ [1.0, -2.0, 0.5] + rng.normal(0, 0.1, 240)
    rows = FitRows.of([(i, 4, np.zeros(60)) for i in range(4)])
    fit = np.linalg.lstsq(j * weight[:, None], y * weight, rcond=None)[0]
    found = resampled(j, y - j @ fit, weight, rows, True)
    variances, outside = [], np.zeros(240)
    for size in (15, 60):
        fits = []
        for k in range(240 // size):
            out = np.arange(240) // size == k
            part = np.linalg.lstsq((j * weight[:, None])[~out], (y * weight)[~out], rcond=None)[0]
            fits.append(part)
            outside[out] = (y - j @ part)[out]  # of the conditions in the end
        g = len(fits)
        variances.append((g - 1) / g * np.sum((np.array(fits) - np.mean(fits, 0)) ** 2, axis=0))
    assert found.sigma == pytest.approx(np.sqrt(np.mean(variances, axis=0)), rel=1e-9)
    order = np.argsort(np.abs(outside))
    share = np.cumsum(weight[order] ** 2) / np.sum(weight**2)
    assert found.band_Nm == pytest.approx(np.abs(outside)[order][np.searchsorted(share, 0.95)])


def test_fewer_blocks_than_parameters_leave_none_without_a_deviation():
    """Six blocks and eight parameters: without more the deviations span five directions only."""
    rng = np.random.default_rng(6)
    j = rng.normal(size=(300, 8))
    noise = rng.normal(0, 0.1, 300)
    residual = noise - j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    rows = FitRows.of([(0, 1, np.zeros(300))])
    found = resampled(j, residual, np.ones(300), rows, False)
    plain = 0.01 * np.linalg.inv(j.T @ j)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.5 * np.linalg.eigvalsh(plain).min()
    # What the blocks say adds to it, and no more than that; all weights alike change nothing.
    assert np.linalg.eigvalsh(found.covariance).max() < 8 * np.linalg.eigvalsh(plain).max()
    heavy = resampled(j, residual, np.full(300, 3.0), rows, False)
    np.testing.assert_allclose(heavy.covariance, found.covariance, rtol=1e-9)
