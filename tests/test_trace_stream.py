"""What a drive's trace is run over: everything that the trace is to show happens in it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from esea_gen.device import Device, load_device
from esea_gen.verify.traces import trace_stream

H = 1e-3


@pytest.fixture(scope="module", params=["elbow_drive", "elbow_mpc"])
def stream(request) -> dict[str, np.ndarray]:
    device: Device = load_device(request.param)
    assert device.period_s == H
    return trace_stream(device)


def stretches(x: np.ndarray) -> list[tuple[float, float, float]]:
    """Values of a piecewise constant signal: value, first time, end."""
    edges = [0, *(np.flatnonzero(np.diff(x)) + 1).tolist(), len(x)]
    return [(float(x[a]), round(a * H, 4), round(b * H, 4)) for a, b in itertools.pairwise(edges)]


def test_both_modes_run_and_are_left_and_entered_again(stream):
    modes = stretches(stream["mode"])
    assert [m for m, _, _ in modes] == [0, 1, 2, 0, 1]
    # Long enough for what fades in a second, and at rest long enough to be armed again.
    assert all(end - begin > 0.4 for mode, begin, end in modes if mode)
    for mode, begin, _ in modes:
        if mode == 1:
            # Each time after a request of its own, which came while the drive was off.
            asked = [t for n, t, _ in stretches(stream["rearm"]) if n and t < begin]
            off = stream["mode"][round(asked[-1] / H)]
            assert off == 0


def test_it_is_stopped_and_loses_frames_while_it_is_on(stream):
    (stop,) = [s for s in stretches(stream["stop"]) if s[0]]
    assert stream["mode"][round(stop[1] / H) - 1] == 2
    assert stream["mode"][round(stop[1] / H)] == 0
    (lost,) = [s for s in stretches(stream["frame_error_load"]) if s[0]]
    assert lost[0] == 2.0
    assert lost[2] - lost[1] == pytest.approx(0.002)
    assert stream["mode"][round(lost[1] / H)] == 2
    assert not np.any(stream["frame_error_motor"])


def test_what_is_wanted_is_known_ahead(stream):
    wanted = stream["tau_desired_Nm"]
    assert np.max(np.abs(wanted)) == pytest.approx(0.5, abs=2e-4)
    ahead = []
    for name in [n for n in stream if n.startswith("tau_preview")]:
        # A later value of the same signal, the same time ahead throughout.
        is_so = (k for k in range(1, 1000) if np.array_equal(stream[name][:500], wanted[k:][:500]))
        ahead.append(next(is_so, None))
    assert None not in ahead
    assert ahead == sorted(set(ahead))
