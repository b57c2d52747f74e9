"""Averaged spectra and periods: every sum written out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis.sweeps import periodic_response, welch_response
from esea_gen.errors import UserError


def test_deviation_and_coherence_of_periods_by_their_sums():
    # Three periods after one that is left out; line by line, with the transform written out.
    n, skip, count = 16, 1, 3
    rng = np.random.default_rng(7)
    t = np.arange(n * (skip + count) + 5)  # what is no whole period is not used
    u = np.cos(2 * np.pi * 2 * t / n) + 0.5 * np.sin(2 * np.pi * 5 * t / n)
    u += rng.normal(0, 0.05, len(t))
    y = 3.0 * u + rng.normal(0, 0.2, len(t))
    r = periodic_response(u, y, 0.01, samples=n, skip=skip)
    lines = np.rint(r.frequency_Hz * 0.01 * n).astype(int)
    assert {2, 5} <= set(lines)
    for i, k in enumerate(lines):
        turn = np.exp(-2j * np.pi * k * np.arange(n) / n)
        a, b = (
            [np.sum(x[p * n : (p + 1) * n] * turn) for p in range(skip, skip + count)]
            for x in (u, y)
        )
        h = sum(b) / sum(a)
        assert r.response[i] == pytest.approx(h, rel=1e-9)
        cross = sum(x.conjugate() * z for x, z in zip(a, b, strict=True))
        powers = sum(abs(x) ** 2 for x in a) * sum(abs(z) ** 2 for z in b)
        assert r.coherence[i] == pytest.approx(abs(cross) ** 2 / powers, rel=1e-9)
        # Of a mean of three, half along the gain, over the mean output.
        rest = sum(abs(z - h * x) ** 2 for x, z in zip(a, b, strict=True)) / (count - 1)
        assert r.sigma[i] == pytest.approx(
            math.sqrt(rest / 2 / count) / abs(sum(b) / count), rel=1e-9
        )


@pytest.mark.parametrize(
    ("samples", "skip", "said"),
    [(0, 1, "hold 0 periods of 0"), (1, 0, "hold 0 periods"), (50, -1, "periods of 50 after -1")],
)
def test_periods_that_are_none_are_refused(samples, skip, said):
    with pytest.raises(UserError, match=said):
        periodic_response(np.ones(100), np.ones(100), 0.01, samples=samples, skip=skip)


@pytest.mark.parametrize(("count", "segment"), [(4000, 500), (4001, 333), (900, 301)])
def test_welch_counts_its_segments_and_states_the_deviation_of_their_mean(count, segment):
    rng = np.random.default_rng(3)
    u = rng.normal(0, 1, count)
    y = u + rng.normal(0, 0.5, count)
    r = welch_response(u, y, 0.01, segment_s=segment * 0.01)
    starts = range(0, count - segment + 1, segment - segment // 2)
    assert f"{len(starts)} Hann segments of {segment * 0.01:g} s" in r.method
    # Half-overlapping Hann segments: each shares a sixth of the amplitude with either neighbour.
    effective = len(starts) / (1 + 2 * (1 / 6) ** 2 * (1 - 1 / len(starts)))
    np.testing.assert_allclose(r.sigma**2, (1 - r.coherence) / (2 * r.coherence * effective))
    # The line in the middle, from the segments themselves.
    k = len(r.frequency_Hz) // 2
    window = np.hanning(segment + 1)[:-1]
    turn = window * np.exp(-2j * np.pi * r.frequency_Hz[k] * 0.01 * np.arange(segment))
    s = [
        [np.sum((x[a : a + segment] - x[a : a + segment].mean()) * turn) for a in starts]
        for x in (u, y)
    ]
    s_u, s_y = map(np.array, s)
    assert r.response[k] == pytest.approx(
        np.sum(s_y * s_u.conj()) / np.sum(abs(s_u) ** 2), rel=1e-6
    )
