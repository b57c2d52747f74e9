"""Defects of a recording whose cells are all numbers.

A model can be fitted even to a corrupt recording: spikes raise full scale, a drop-out is filled in,
a constant force flattens the loops.  Such samples are masked: they neither train nor judge, and the
report names them.  What cannot be masked (an offset, backlash) or makes the rest doubtful stops the
parameters from being called ``identified``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import scipy  # its parts are read on first use

from esea_gen.identify.recording.cycles import Cycle, loop_work_J, reversals
from esea_gen.language.ports import Array

Mask = npt.NDArray[np.bool_]

# A spike: at most so many samples, this share of the torque's range off, and not where the
# deflection turns as sharply.
SPIKE_WIDTH, SPIKE_SHARE, TURN_FACTOR = 3, 0.08, 5.0
# A wider one: at most this share of a cycle, and off by so many times what the mean stiffness makes
# of all that the deflection moves meanwhile, and the noise.  Widths tried grow by this factor.
SPIKE_CYCLE, MOVED_FACTOR, NOISE_FACTOR, WIDER = 0.1, 2.0, 6.0, 1.4
# Above this count, a half cycle this much stiffer than the median is a spike.
LEAST_SPANS, STIFFER = 6, 2.0
SKIRT = 0.125  # of what is allowed: to there a wide spike is masked
TURNED_BACK = 0.05  # of its range: by so much a deflection turns
MOST_SPIKES = 0.01  # spikes over samples: more is noise
# A jump of the deflection: so many of the steps near it, and this share of its range.  Where a
# triangle turns, its tip stands off by two steps.
JUMP_STEPS, JUMP_SHARE = 2.1, 0.004
# A gap: this many usual steps long, and the deflection moves by this share of its range in it.
GAP_STEPS, GAP_SHARE = 10.0, 0.02
# A channel that stands still: within this share of its range (rubber's torque goes on by more than
# ten times that), for so many samples, while the other one moves by this share of its own, and its
# noise.
STILL_BAND, STILL_SAMPLES, STILL_SHARE = 2e-4, 8, 0.04
# A deflection that stands still for a fault: the torque goes on by this share of its range beyond
# what it is at the same deflection, to this share of its range, elsewhere.
GONE_ON, SAME_SHARE = 0.1, 0.02
AT_ITS_END = 0.01  # of its range: there it is saturated, else frozen
# Clipped at the loops' tips: flat over this share of the deflection's range, and before that over
# the same motion so many times steeper.  A rounded peak is three times steeper there.
TIP_SHARE, TIP_FACTOR = 0.01, 10.0
OFFSET_SHARE, LEAST_KEPT = 0.02, 50  # of full scale; samples
# Backlash: a stretch of next to no torque, this many times wider than the stiffness beside it asks.
LOOSE_TORQUE, LOOSE_FACTOR, LOOSE_SHARE = 0.015, 3.0, 0.03
NO_LOSS, MOST_LAG = 1e-3, 51  # of the loop's box; steps between samples


@dataclass(frozen=True)
class Finding:
    kind: str
    text: str
    stops: bool  # whether parameters that were fitted to it are not called identified
    advice: str = ""  # what to do, where the model has no term for it


def spikes(theta: Array, tau: Array) -> Mask:
    """Samples at which the torque leaves and comes back while the deflection hardly moves."""
    # Relaxation alone leaves and does not come back. Up to three samples may stand off wherever the
    # deflection does not turn as sharply; of wider spikes the size counts against all its motion.
    wide = _wide_spikes(theta, tau)
    calm = bridged(tau, wide)
    turns = scipy.ndimage.maximum_filter(_standing_off(theta), 2 * SPIKE_WIDTH + 1)
    allowed = _range(calm) * (SPIKE_SHARE + TURN_FACTOR * turns / float(np.ptp(theta)))
    return np.asarray(wide | (_standing_off(calm) > allowed))


def _wide_spikes(theta: Array, tau: Array) -> Mask:
    # Until none is new: a large one hides smaller ones, as it widens the torque's range.
    reach, found = float(np.ptp(theta)), np.zeros(len(tau), dtype=bool)
    turns = reversals(theta, TURNED_BACK * reach)
    half_cycle = float(np.median(np.diff(turns)))
    widths = [SPIKE_WIDTH + 1]
    while WIDER * widths[-1] <= SPIKE_CYCLE * 2 * half_cycle:
        widths.append(int(WIDER * widths[-1]))
    before = -1
    while before < np.count_nonzero(found):
        before = int(np.count_nonzero(found))
        for width in widths:
            rest = bridged(tau, found)
            calm = _calm(rest)
            off = _standing_off(calm, width)
            off[:width] = off[-width:] = 0.0  # nothing is beside them
            near = 2 * width + 1
            moved = scipy.ndimage.maximum_filter(theta, near)
            moved -= scipy.ndimage.minimum_filter(theta, near)
            most = min(_range(calm), reach * _stiffest(theta, calm, turns))
            allowed = most * (SPIKE_SHARE + MOVED_FACTOR * moved / reach) + _noise(rest, calm)
            skirts = off > SKIRT * allowed
            found |= scipy.ndimage.binary_propagation(off > allowed, mask=skirts)
    return found


def _stiffest(theta: Array, tau: Array, turns: Sequence[int]) -> float:
    # Spikes that widen the torque's range are in some half cycles only, whatever their share of
    # the samples is.
    spans = [(a, b) for a, b in pairwise(turns) if np.ptp(theta[a : b + 1]) > 0]
    if len(spans) < LEAST_SPANS:
        return np.inf
    found = [np.ptp(tau[a : b + 1]) / np.ptp(theta[a : b + 1]) for a, b in spans]
    return STIFFER * float(np.median(found))


def _calm(x: Array) -> Array:
    # Without what is narrower than a wide spike, and most of the noise.
    return np.asarray(scipy.ndimage.median_filter(x, 2 * SPIKE_WIDTH + 1))


def _noise(x: Array, calm: Array) -> float:
    # What it may do to the calm signal.
    return NOISE_FACTOR * float(np.median(np.abs(x - calm)))


def _range(tau: Array) -> float:
    return float(np.subtract(*np.percentile(tau, [99.5, 0.5])))


def jumps(theta: Array) -> Mask:
    """Up to three samples that no motion around explains, to one side; none of a noisy sensor."""
    width = SPIKE_WIDTH + 1
    calm = _calm(theta)
    steps = np.pad(np.abs(calm[width:] - calm[:-width]) / width, width // 2, mode="edge")
    steps = scipy.ndimage.maximum_filter(steps, 2 * width + 1)
    found = _standing_off(theta) > np.maximum(JUMP_STEPS * steps, JUMP_SHARE * np.ptp(theta))
    found[:width] = found[-width:] = False  # nothing is beside them
    return np.asarray(found & (np.mean(found) <= MOST_SPIKES))


def _standing_off(x: Array, width: int = SPIKE_WIDTH) -> Array:
    # What is narrower than a window does not survive its opening; a sharp turn does, on its way up.
    size = width + 1
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


def still(moving: Array, standing: Array) -> Iterator[tuple[int, int]]:
    """Stretches in which one channel is constant although the other one moves."""
    calm = _calm(moving)
    least = STILL_SHARE * float(np.ptp(moving)) + _noise(moving, calm)
    first = last = 0  # of stretches that overlap
    for a, b in _flat(standing, STILL_BAND * float(np.ptp(standing))):
        if b - a >= STILL_SAMPLES and np.ptp(calm[a:b]) > least:
            if a >= last:
                if last > first:
                    yield first, last
                first = a
            last = b
    if last > first:
        yield first, last


def clipped(theta: Array, tau: Array) -> Iterator[tuple[int, int]]:
    """Stretches at an end of the torque's range that begin with a kink."""
    calm, resolution = _calm(theta), float(np.percentile(np.diff(np.unique(tau)), 10))
    band = STILL_BAND * float(np.ptp(tau)) + 2 * _noise(tau, _calm(tau)) + resolution
    ends, least = np.isin(tau, (tau.min(), tau.max())).nonzero()[0], TIP_SHARE * np.ptp(theta)
    for a, b in _flat(tau, band):
        at_end = b - a >= STILL_SAMPLES and np.diff(np.searchsorted(ends, (a, b)))[0]
        if at_end and (moved := float(np.ptp(calm[a:b]))) > least:
            before = np.flatnonzero(np.abs(calm[:a] - calm[a]) >= moved)[-1:]
            if np.any(np.abs(tau[before] - tau[a]) > TIP_FACTOR * band):
                yield a, b


def _flat(x: Array, band: float) -> Iterator[tuple[int, int]]:
    # The longest stretches within the band: lows and highs are the candidates for its two ends.
    values, a = x.tolist(), 0
    lows: deque[int] = deque()
    highs: deque[int] = deque()
    for b, y in enumerate(values):
        start = a
        while lows and values[lows[-1]] >= y:
            lows.pop()
        while highs and values[highs[-1]] <= y:
            highs.pop()
        lows.append(b)
        highs.append(b)
        while values[highs[0]] - values[lows[0]] > band:
            a = min(lows[0], highs[0]) + 1
            for ends in (lows, highs):
                if ends[0] < a:
                    ends.popleft()
        if a > start:
            yield start, b
    yield a, len(values)


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Stretches that are True: first sample, and the one after the last."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def stuck(theta: Array, tau: Array) -> Iterator[tuple[int, int]]:
    """Stretches in which the deflection is constant by a fault, not by a pause."""
    # While it is held the torque relaxes or recovers: it stays below the largest that was there, to
    # its side, at this deflection. One that goes beyond is of a deflection that goes on unseen.
    reach, calm = float(np.ptp(theta)), _calm(tau)
    for a, b in still(tau, theta):
        same = np.abs(theta - theta[a]) <= SAME_SHARE * reach
        same[a + 1 : b] = False
        # A torque that is late, or a coarse encoder: what came before is still to be seen.
        came = abs(float(theta[a] - theta[max(a - STILL_SAMPLES, 0)])) / reach
        most = (GONE_ON + MOVED_FACTOR * came) * _range(tau)
        if any(np.max(s * calm[a:b]) - max(0.0, np.max(s * calm[same])) > most for s in (1, -1)):
            yield a, b


def offset_Nm(theta: Array, tau: Array, spoilt: Mask | None = None) -> float | None:
    """Torque in the middle of the loops; None where the deflection goes to one side only."""
    kept = np.ones(len(tau), dtype=bool) if spoilt is None else ~spoilt
    way = np.sign(np.gradient(scipy.ndimage.uniform_filter1d(theta, 5)))[kept]
    theta, tau = theta[kept], tau[kept]
    if len(theta) < LEAST_KEPT:
        return None
    high, low = float(theta.max()), float(theta.min())
    if min(high, -low) <= 0.2 * max(high, -low):
        return None
    x = theta / max(high, -low)
    loop = way * np.sqrt(1 - x * x)
    columns = [np.ones_like(x), x, x * np.abs(x), x**3, loop]
    found = np.linalg.lstsq(np.column_stack(columns), tau, rcond=None)[0]
    return float(found[0])


def backlash_rad(theta: Array, tau: Array, full_scale_Nm: float, cycles: Sequence[Cycle]) -> float:
    """Width with almost no torque, beyond the deflection that the stiffness beside it explains."""
    small = LOOSE_TORQUE * full_scale_Nm
    reach, found = float(np.ptp(theta)), []
    for c in cycles:
        x, y = theta[c.start : c.stop + 1], tau[c.start : c.stop + 1]
        loose = np.abs(y) < small
        for a, b in runs(loose):
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
    """Samples excluded from training and judging, and the reason; tau is free of spikes."""
    mask = np.zeros(len(tau), dtype=bool)
    findings: list[Finding] = []

    def found(kind: str, text: str, stops: bool = True, advice: str = "") -> None:
        findings.append(Finding(kind, text, stops, advice))

    left_out = "the cycle with {} and the next are left out of training and judging"
    if missing := gaps(time_s, theta) if timed else []:
        mask |= after_gaps(len(tau), missing, cycles)
        at = max(missing, key=lambda i: time_s[i + 1] - time_s[i])
        count = f"{len(missing)} drop-out{'s' if len(missing) > 1 else ''}"
        longest = f"the longest of {time_s[at + 1] - time_s[at]:.3g} s at {time_s[at]:.4g} s"
        found("gap", f"{count}, {longest}; {left_out.format('one')}", stops=False)
    width, full_scale = float(np.ptp(tau)), float(np.abs(tau).max())
    for a, b in [*clipped(theta, tau), *still(theta, tau)]:
        if np.all(mask[a:b]):
            continue
        own = tau[a:b]
        at_end = min(tau.max() - own.max(), own.min() - tau.min()) < AT_ITS_END * width
        if not at_end and abs(tau[a]) < LOOSE_TORQUE * full_scale:
            continue  # backlash, if anything
        mask[a:b] = True
        kind = "saturated" if at_end else "frozen"
        found(kind, f"the torque is {kind} at {tau[a]:.4g} Nm for {b - a} samples from sample {a}")
    for a, b in stuck(theta, tau):
        mask |= after_gaps(len(tau), [a, b - 1], cycles)
        found(
            "deflection frozen",
            f"the deflection is frozen for {b - a} samples from sample {a}, while the torque goes "
            f"beyond its usual values there; {left_out.format('them')}",
        )
    if loose := backlash_rad(theta, tau, full_scale, cycles):
        found(
            "backlash",
            f"backlash or a dead zone of {loose:.3g} rad: over that much deflection there is "
            "almost no torque, which no term of the fitted model describes",
        )
    offset = offset_Nm(theta, tau, mask)
    if offset is not None and abs(offset) > OFFSET_SHARE * full_scale:
        share = f"{100 * offset / full_scale:.1f} % of its largest"
        found(
            "offset",
            f"the torque has an offset of {offset:.3g} Nm ({share})",
            advice="; zero it on the rig, set torque.zero, or take a member with an offset",
        )
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
        out.append(replace(same[0], text=same[0].text + more))
    return tuple(out)
