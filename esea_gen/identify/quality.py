"""What is wrong with a recording although every cell of it is a number.

A recording that a rig spoilt still fits: spikes raise full scale, a drop-out is filled in, a force
that stands still pulls the loops flat.  Such samples are masked: they neither train nor judge, and
the report names them.  What cannot be masked (an offset, backlash) or makes the rest doubtful stops
the parameters from being called ``identified``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy  # its parts are read on first use

from esea_gen.identify.cycles import Cycle, loop_work_J
from esea_gen.language.ports import Array

Mask = npt.NDArray[np.bool_]

# A spike: at most so many samples, this share of the torque's range off, and not where the
# deflection turns as sharply.
SPIKE_WIDTH, SPIKE_SHARE, TURN_FACTOR = 3, 0.08, 5.0
MOST_SPIKES = 0.01  # share of samples: more is noise
# A jump of the deflection: so many of the steps near it, and this share of its range.  Where a
# triangle turns, its tip stands off by two steps.
JUMP_STEPS, JUMP_SHARE = 2.1, 0.004
# A gap: this many usual steps long, and the deflection moves by this share of its range in it.
GAP_STEPS, GAP_SHARE = 10.0, 0.02
# A torque that stays the same number, this many samples and this share of the deflection's range.
STILL_SAMPLES, STILL_SHARE = 8, 0.04
AT_ITS_END = 0.01  # of its range: there it is saturated, else frozen
OFFSET_SHARE = 0.02  # of full scale
# Backlash: a stretch of next to no torque, this many times wider than the stiffness beside it asks.
LOOSE_TORQUE, LOOSE_FACTOR, LOOSE_SHARE = 0.015, 3.0, 0.03
NO_LOSS, MOST_LAG = 1e-3, 51  # of the loop's box; steps between samples


@dataclass(frozen=True)
class Finding:
    """Something wrong with a recording.

    kind: jumps, spikes, noise, gap, frozen, saturated, offset or backlash.
    stops: whether parameters that were fitted to it are not called ``identified``.
    """

    kind: str
    text: str
    stops: bool


def spikes(theta: Array, tau: Array) -> Mask:
    """Up to three samples that stand off from what is before and behind them, to one side."""
    width = float(np.subtract(*np.percentile(tau, [99.5, 0.5])))
    turns = scipy.ndimage.maximum_filter(_standing_off(theta), 2 * SPIKE_WIDTH + 1)
    allowed = width * (SPIKE_SHARE + TURN_FACTOR * turns / float(np.ptp(theta)))
    return np.asarray(_standing_off(tau) > allowed)


def jumps(theta: Array) -> Mask:
    """Up to three samples of the deflection, to one side, that no motion as that around explains.

    return: none where there are so many that the sensor is noisy.
    """
    width = SPIKE_WIDTH + 1
    calm = scipy.ndimage.median_filter(theta, 2 * SPIKE_WIDTH + 1)
    steps = np.pad(np.abs(calm[width:] - calm[:-width]) / width, width // 2, mode="edge")
    steps = scipy.ndimage.maximum_filter(steps, 2 * width + 1)
    found = _standing_off(theta) > np.maximum(JUMP_STEPS * steps, JUMP_SHARE * np.ptp(theta))
    found[:width] = found[-width:] = False  # nothing is beside them
    return np.asarray(found & (np.mean(found) <= MOST_SPIKES))


def _standing_off(x: Array) -> Array:
    # What is narrower than a window does not survive its opening; a sharp turn does, on its way up.
    size = SPIKE_WIDTH + 1
    above = x - scipy.ndimage.grey_opening(x, size, mode="nearest")
    below = scipy.ndimage.grey_closing(x, size, mode="nearest") - x
    return np.asarray(np.maximum(above, below))


def bridged(values: Array, mask: Mask) -> Array:
    """A signal with masked samples drawn straight between their neighbours."""
    kept = np.flatnonzero(~mask)
    return np.asarray(np.interp(np.arange(len(values)), kept, values[kept]))


def gaps(time_s: Array, theta: Array) -> list[int]:
    """Samples after which time is missing while the deflection moved."""
    steps, moves = np.diff(time_s), np.abs(np.diff(theta))
    reach = float(np.ptp(theta))
    speed = scipy.ndimage.maximum_filter(
        np.where(steps > GAP_STEPS * np.median(steps), 0.0, moves / steps), 11
    )
    missed = np.maximum(moves, speed * steps)
    long = steps > GAP_STEPS * np.median(steps)
    return [int(i) for i in np.flatnonzero(long & (missed > GAP_SHARE * reach))]


def after_gaps(count: int, found: Sequence[int], cycles: Sequence[Cycle]) -> Mask:
    """The cycle that holds a gap and the next one, in which the model's memory is wrong."""
    mask = np.zeros(count, dtype=bool)
    starts = [c.start for c in cycles] + [c.stop for c in cycles[-1:]]
    for i in found:
        before = [s for s in starts if s <= i]
        behind = [s for s in starts if s > i]
        mask[before[-1] if before else 0 : behind[1] if len(behind) > 1 else count] = True
    return mask


def still(theta: Array, tau: Array) -> Iterator[tuple[int, int]]:
    """Stretches in which the torque is the same number although the deflection moves."""
    reach = float(np.ptp(theta))
    edges = np.flatnonzero(np.diff(tau) != 0)
    starts = np.concatenate([[0], edges + 1])
    stops = np.concatenate([edges + 1, [len(tau)]])
    for a, b in zip(starts, stops, strict=True):
        if b - a >= STILL_SAMPLES and np.ptp(theta[a:b]) > STILL_SHARE * reach:
            yield int(a), int(b)


def offset_Nm(theta: Array, tau: Array) -> float | None:
    """Torque in the middle of the loops; None where the deflection goes to one side only."""
    high, low = float(theta.max()), float(theta.min())
    if high <= 0 or low >= 0 or min(high, -low) < 0.2 * max(high, -low):
        return None
    x = theta / max(high, -low)
    way = np.sign(np.gradient(scipy.ndimage.uniform_filter1d(theta, 5)))
    loop = way * np.sqrt(np.clip(1 - x * x, 0, 1))
    columns = [np.ones_like(x), x, x * np.abs(x), x**3, loop]
    found = np.linalg.lstsq(np.stack(columns, axis=1), tau, rcond=None)[0]
    return float(found[0])


def backlash_rad(theta: Array, tau: Array, full_scale_Nm: float, cycles: Sequence[Cycle]) -> float:
    """Width in which there is next to no torque, beyond what the stiffness beside it explains.

    return: median over passes; 0 where there is none.
    """
    small = LOOSE_TORQUE * full_scale_Nm
    reach, found = float(np.ptp(theta)), []
    for c in cycles:
        x, y = theta[c.start : c.stop + 1], tau[c.start : c.stop + 1]
        loose = np.abs(y) < small
        edges = np.flatnonzero(np.diff(np.concatenate([[False], loose, [False]]).astype(int)))
        for a, b in edges.reshape(-1, 2):
            if a < 2 or b > len(y) - 3 or y[a - 1] * y[b] > 0:
                continue  # not a pass through zero
            width = abs(x[b - 1] - x[a])
            beside = []
            for step, at in ((-1, a - 1), (1, b)):
                end = at
                while 0 < end + step < len(y) and abs(y[end]) < 6 * small:
                    end += step
                if abs(x[end] - x[at]) > 0:
                    beside.append(abs(y[end] - y[at]) / abs(x[end] - x[at]))
            usual = 2 * small / min(beside) if beside and min(beside) > 0 else reach
            found.append(width - usual if width > LOOSE_FACTOR * usual else 0.0)
    width = float(np.median(found)) if found else 0.0
    return width if width > LOOSE_SHARE * reach else 0.0


def examined(
    time_s: Array, theta: Array, tau: Array, cycles: Sequence[Cycle], timed: bool
) -> tuple[Mask, tuple[Finding, ...]]:
    """Samples that neither train nor judge, and what is wrong; tau is free of spikes."""
    mask, findings = np.zeros(len(tau), dtype=bool), []
    missing = gaps(time_s, theta) if timed else []
    if missing:
        mask |= after_gaps(len(tau), missing, cycles)
        longest = max(missing, key=lambda i: time_s[i + 1] - time_s[i])
        findings.append(
            Finding(
                "gap",
                f"{len(missing)} drop-out{'s' if len(missing) > 1 else ''}, the longest of "
                f"{time_s[longest + 1] - time_s[longest]:.3g} s at {time_s[longest]:.4g} s; the "
                "cycle that holds one and the next neither train nor judge",
                False,
            )
        )
    width = float(np.ptp(tau))
    for a, b in still(theta, tau):
        at_end = min(tau.max() - tau[a], tau[a] - tau.min()) < AT_ITS_END * width
        if not at_end and abs(tau[a]) < LOOSE_TORQUE * np.abs(tau).max():
            continue  # backlash, if anything
        mask[a:b] = True
        kind = "saturated" if at_end else "frozen"
        text = f"the torque is {kind} at {tau[a]:.4g} Nm for {b - a} samples from sample {a}"
        findings.append(Finding(kind, text, True))
    full_scale = float(np.abs(tau).max())
    loose = backlash_rad(theta, tau, full_scale, cycles)
    if loose:
        text = (
            f"backlash or a dead zone of {loose:.3g} rad: over that much deflection there is next "
            "to no torque, which no term of the fitted model gives"
        )
        findings.append(Finding("backlash", text, True))
    offset = offset_Nm(theta, tau)
    if offset is not None and abs(offset) > OFFSET_SHARE * full_scale:
        text = (
            f"the torque has an offset of {offset:.3g} Nm ({100 * offset / full_scale:.1f} % of "
            "its largest); zero it on the rig, set torque.zero, or take a member with an offset"
        )
        findings.append(Finding("offset", text, True))
    findings += _backward(time_s, theta, tau, cycles, timed)
    return mask, _shortened(findings)


def _backward(
    time_s: Array, theta: Array, tau: Array, cycles: Sequence[Cycle], timed: bool
) -> list[Finding]:
    # Loops that give energy: no rubber does, a torque that was recorded later seems to.
    least = NO_LOSS * float(np.ptp(theta)) * float(np.ptp(tau))

    def work(later_s: float) -> float:
        moved = np.interp(time_s + later_s, time_s, tau)
        return float(np.median([loop_work_J(theta, moved, c) for c in cycles]))

    if not cycles or work(0.0) > -least:
        return []
    text = f"the loops run backward: {-work(0.0):.3g} J come out of a cycle"
    if timed:
        usual = float(np.median(np.diff(time_s)))
        lags = usual * np.arange(1, MOST_LAG)
        enough = [float(lag) for lag in lags if work(float(lag)) >= 0]
        if enough:
            text += (
                f"; the torque lags the deflection by {1e3 * enough[0]:.3g} ms at least: align the "
                "channels, or set torque.lag_s"
            )
    return [Finding("lag", text, True)]


def _shortened(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    # Of one kind the first, and how many more.
    out = []
    for kind in dict.fromkeys(f.kind for f in findings):
        same = [f for f in findings if f.kind == kind]
        more = f", and {len(same) - 1} more such stretches" if len(same) > 1 else ""
        out.append(Finding(kind, same[0].text + more, same[0].stops))
    return tuple(out)


__all__ = ["Finding", "after_gaps", "bridged", "examined", "gaps", "jumps", "spikes", "still"]
