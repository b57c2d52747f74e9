"""What is found wrong with a recording, and told of it: each rule at its limit."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.device import Device
from esea_gen.identify import quality
from esea_gen.identify.cycles import Cycle
from esea_gen.identify.family_file import family_device
from esea_gen.identify.parameters import with_values
from esea_gen.identify.quality import Finding, backlash_rad, examined, offset_Nm
from esea_gen.identify.quality_gate import excused_of, gate_notes, gated
from esea_gen.model.family import FittedMember, Member, Term

# Offset.


def offset_typed(theta: np.ndarray, tau: np.ndarray, kept: np.ndarray) -> float:
    """The constant of a fit by the normal equations; the way is that of a mean of five samples."""
    padded = np.concatenate([theta[1::-1], theta, theta[:-3:-1]])
    mean = sum(padded[k : k + len(theta)] for k in range(5)) / 5
    way = np.sign(
        np.concatenate([[mean[1] - mean[0]], mean[2:] - mean[:-2], [mean[-1] - mean[-2]]])
    )
    x, way = theta[kept] / np.abs(theta[kept]).max(), way[kept]
    rows = np.array([x**0, x, x * np.abs(x), x**3, way * np.sqrt(np.maximum(1 - x**2, 0))])
    return float(np.linalg.solve(rows @ rows.T, rows @ tau[kept])[0])


@pytest.mark.parametrize("sign", [1, -1])
def test_an_offset_is_that_of_the_fit_typed_again(sign):
    rng = np.random.default_rng(5)
    k = np.arange(700)
    for middle in (0.0, 0.05, -0.06):
        theta = sign * (0.2 * np.sin(0.0371 * k + 0.3) + middle)
        tau = 9 * theta + 0.4 * np.cos(0.0371 * k) + rng.normal(0, 0.5, len(k)) + 0.3
        spoilt = (k > 300) & (k < 340)
        tau[spoilt] = 77.0
        theta[310] = 5.0  # spoilt, too: it is no end of the motion
        found = offset_Nm(theta, tau, spoilt)
        assert found == pytest.approx(offset_typed(theta, tau, ~spoilt), rel=1e-9)
        assert abs(found) > 0.02


@pytest.mark.parametrize("sign", [1, -1])
def test_an_offset_needs_both_sides_and_fifty_samples(sign):
    x = np.sin(0.0371 * np.arange(700))
    for low, known in ((-0.2015, True), (-0.1999, False), (0.1, False)):
        theta = sign * np.where(x > 0, x / x.max(), -low * x / -x.min())
        if low > 0:
            theta = sign * np.abs(x)
        assert (offset_Nm(theta, 3 * theta + 1) is not None) == known
    few = np.arange(700) >= 50
    theta = np.sin(0.2 * np.arange(700))
    assert offset_Nm(theta, 3 * theta + sign, few) == pytest.approx(sign, rel=1e-9)
    assert offset_Nm(theta, 3 * theta + sign, np.arange(700) >= 49) is None


# Backlash.  In these the full scale is such that below 1 there is next to no torque.

FULL = 1 / 0.015


def passing(
    loose: int = 10, left: tuple = (6, 4, 2), right: tuple = (2, 4, 6), spread: float = 1.0, at=0.0
) -> tuple[np.ndarray, np.ndarray]:
    """A rising deflection, one a sample; the torque of two sides, and none for some samples.

    spread: of the loose samples' deflection; at: their torque.
    """
    x = np.arange(len(left) + loose + len(right), dtype=float)
    width = (loose - 1) * (spread - 1)
    inside = slice(len(left), len(left) + loose)
    x[inside] = len(left) + spread * np.arange(loose)
    x[len(left) + loose :] += width
    return x, np.array([*(-v for v in left), *[at] * loose, *right])


def width(*passes: tuple[np.ndarray, np.ndarray], reach: float = 0.0) -> float:
    """Of cycles on end; reach: of the whole deflection, at least."""
    theta = np.concatenate([*(x for x, _ in passes), [reach, 0.0]])
    tau = np.concatenate([*(y for _, y in passes), [0.0, 0.0]])
    ends = np.cumsum([0, *(len(x) for x, _ in passes)])
    cycles = [Cycle(int(a), int(b) - 1, 1.0, 0, "training") for a, b in pairwise(ends)]
    return backlash_rad(theta, tau, FULL, cycles)


def test_the_width_is_what_the_stiffness_beside_it_does_not_explain():
    # Ten samples are 9 wide; at a slope of 2 the torque takes 1 from -1 to 1.
    assert width(passing()) == pytest.approx(8.0)
    # Of both sides the softer one counts: 2 over 4, too.
    assert width(passing(right=(4, 8, 12))) == width(passing(left=(12, 8, 4))) == pytest.approx(8.0)
    assert width(passing(right=(4, 8, 12), left=(12, 8, 4))) == pytest.approx(8.5)
    # The slope is that up to six times next to no torque, and no farther.
    assert width(passing(left=(96, 6.0, 4, 2), right=(2, 4, 6.0, 96))) == pytest.approx(8.0)
    both = {"left": (96, 93, 5.99, 4, 2), "right": (2, 4, 5.99, 93, 96)}
    assert width(passing(**both)) == pytest.approx(9 - 2 / (91 / 3))
    # By where the torque is not zero, to either side.
    assert width(tuple(-v for v in passing())) == width((passing()[0], -passing()[1])) == 8.0


def test_next_to_no_torque_is_less_than_a_share_of_the_full_scale():
    assert 0.015 * FULL == 1.0
    for at, wide in ((1.0, 0.0), (0.995, 8.0), (-0.995, 8.0), (1.005, 0.0), (-1.005, 0.0)):
        assert width(passing(at=at)) == pytest.approx(wide)


def test_a_width_counts_from_thrice_what_is_explained():
    for spread, wide in ((1.005, 2.015), (1.0, 0.0), (0.995, 0.0)):
        assert width(passing(loose=4, spread=spread)) == pytest.approx(wide)
    # And from 3 % of the whole range on.
    for reach, wide in ((265.0, 8.0), (268.0, 0.0)):
        assert width(passing(), reach=reach) == pytest.approx(wide)


def test_only_a_pass_through_zero_counts_and_not_at_a_cycles_end():
    rising = np.array([2.0, 2.0, *[0.0] * 10, 2.0, 2.0, 2.0])
    assert width((np.arange(15.0), rising)) == width((np.arange(15.0), -rising)) == 0
    for left, right, wide in (
        ((4, 2), (2, 4, 6), 8.0),
        ((2,), (2, 4, 6), 0.0),
        ((6, 4, 2), (2, 4), 0.0),
    ):
        assert width(passing(left=left, right=right)) == pytest.approx(wide), (left, right)
    # What counts are the samples that are next to it.
    assert width(passing(left=(6, -4, 2))) == width(passing(right=(2, -4, 6))) == 8.0
    # The first sample of a cycle says nothing of the slope.
    assert width(passing(left=(90, 3, 2), right=(2, 3, 4, 5, 6, 7))) == pytest.approx(9 - 2)
    x, y = passing(left=(3, 2), right=(2, 6, 10))
    assert width((x, y)) == pytest.approx(8.5)  # two samples before it give no slope: 4 a sample


def test_of_several_passes_the_median_counts():
    three = [passing(loose=n) for n in (10, 14, 21)]
    assert width(*three) == pytest.approx(12.0)
    assert width(three[0], three[1]) == pytest.approx(10.0)
    assert width((np.arange(30.0), np.linspace(-9, 9, 30))) == 0
    # Where nothing beside it moves, or no torque rises, nothing is known.
    x, y = passing()
    x[:3], x[-3:] = x[2], x[-3]
    assert width((x, y)) == 0
    assert width((np.arange(16.0), np.array([-2.0] * 3 + [0.0] * 10 + [2.0] * 3))) == 0


# All of them.

PER, STEP_s = 400, 0.01


def swings(count: int = 6, lag_rad: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, list]:
    """Time, deflection of 0.1 rad, torque of 2 Nm that lags, and its cycles."""
    angle = 2 * np.pi * np.arange(count * PER + 1) / PER
    cycles = [Cycle(k * PER, (k + 1) * PER, 0.1, 0, "training") for k in range(count)]
    time = np.arange(len(angle)) * STEP_s
    return time, 0.1 * np.sin(angle), 2 * np.sin(angle - lag_rad), cycles


def test_a_sound_recording_has_nothing():
    mask, findings = examined(*swings(), True)
    assert not np.any(mask)
    assert findings == ()


@pytest.mark.parametrize("sign", [1, -1])
def test_an_offset_is_told_from_a_fiftieth_of_the_largest_torque(sign):
    t, x, y, cycles = swings()
    # A spring: the offset is found exactly.  0.02 (2 + o) = o at 0.0408.
    assert examined(t, x, y + 0.0406 * sign, cycles, True)[1] == ()
    (f,) = examined(t, x, y + 0.0410 * sign, cycles, True)[1]
    assert (f.kind, f.stops) == ("offset", True)
    (f,) = examined(t, x, y + 0.5 * sign, cycles, True)[1]
    end = "(20.0 % of its largest)" if sign > 0 else "(-20.0 % of its largest)"
    assert f.text == f"the torque has an offset of {0.5 * sign:g} Nm {end}"
    assert f.advice.startswith("; zero it on the rig")


def without(t, x, y, *gaps: tuple[int, int]):
    keep = np.ones(len(t), dtype=bool)
    for a, b in gaps:
        keep[a:b] = False
    return t[keep], x[keep], y[keep]


def test_gaps_are_counted_and_the_longest_is_named():
    t, x, y, cycles = swings()
    # Samples 450 to 499 are missing: 0.51 s after 4.49 s; then 30 from 1500 on, 50 later now.
    mask, (f,) = examined(*without(t, x, y, (450, 500)), cycles[:5], True)
    said = "the longest of 0.51 s at 4.49 s; the cycle that holds one and the next neither train"
    assert f.text.startswith(f"1 drop-out, {said}")
    assert (f.kind, f.stops) == ("gap", False)
    assert np.flatnonzero(mask).tolist() == list(range(400, 1200))
    two = without(t, x, y, (450, 500), (1500, 1530))
    mask, (f,) = examined(*two, cycles[:5], True)
    assert f.text.startswith(f"2 drop-outs, {said}")
    assert np.flatnonzero(mask).tolist() == list(range(400, 2000))
    assert examined(*two, cycles[:5], False)[1] == ()
    # The longest is not the first; after it 2.3 s go on as usual.
    t, x, y = without(t, x, y, (450, 480), (1500, 1571), (1800, 1830))
    (f,) = examined(t, x, y, cycles[:5], True)[1]
    assert f.text.startswith("3 drop-outs, the longest of 0.72 s at 14.99 s; the cycle")


@pytest.mark.parametrize(
    ("level", "kind"),
    [
        (1.961, "saturated"),  # within a hundredth of the range of 4 of its end
        (1.9594, "frozen"),
        (-1.961, "saturated"),
        (-1.9594, "frozen"),
        (0.0304, "frozen"),
        (0.0299, None),  # so near to zero it may be backlash: 1.5 % of 2
        (-0.0299, None),
        (-0.0304, "frozen"),
    ],
)
def test_a_torque_that_stands_still_by_where_it_does(level, kind):
    t, x, y, cycles = swings()
    y[700:760] = level
    mask, found = examined(t, x, y, cycles, True)
    if kind is None:
        assert not np.any(mask)
        assert "frozen" not in {f.kind for f in found}
    else:
        assert np.flatnonzero(mask).tolist() == list(range(700, 760))
        (f,) = found
        assert (f.kind, f.stops) == (kind, True)
        assert f.text == f"the torque is {kind} at {level:.4g} Nm for 60 samples from sample 700"


@pytest.mark.parametrize("level", [196.0, -196.0, 3.0, -3.0])
def test_just_a_hundredth_from_an_end_and_just_off_zero_it_is_frozen(level):
    t, x, y, cycles = swings()
    y *= 100.0  # 200 Nm: a hundredth of the range is 4, 1.5 % of the largest 3
    y[700:760] = level
    assert [f.kind for f in examined(t, x, y, cycles, True)[1]] == ["frozen"]


def test_a_deflection_that_stands_still_spoils_its_cycles_and_the_next():
    t, x, y, cycles = swings()
    # Across the cycle's end at 800 and to the next one at 1200 the torque goes on through its loop.
    x[780:1200] = x[780]
    mask, found = examined(t, x, y, cycles, True)
    (f,) = [f for f in found if f.kind == "deflection frozen"]
    assert f.stops
    assert f.text.startswith("the deflection is frozen for 420 samples from sample 780, while the")
    assert np.flatnonzero(mask).tolist() == list(range(400, 1600))


def test_backlash_is_told_by_its_width():
    t, x, _, cycles = swings()
    y = 20 * np.sign(x) * np.maximum(np.abs(x) - 0.02, 0)
    (f,) = examined(t, x, y, cycles, True)[1]
    assert (f.kind, f.stops) == ("backlash", True)
    told = backlash_rad(x, y, 1.6, cycles)
    assert told == pytest.approx(0.04, abs=0.003)
    assert f.text.startswith(f"backlash or a dead zone of {told:.3g} rad: over that much")


# Loops that run backward.


@pytest.mark.parametrize(
    ("lag", "text"),
    [
        # An ellipse of half axes 0.1 and 2 and an angle has pi 0.1 2 sin(angle); 0.0008 is the
        # thousandth of its box.
        (0.00126, None),
        (0.00128, "0.000804 J come out of a cycle; the torque lags the deflection by 10 ms at"),
        # A sample is 0.01571 rad: 6.4 of them, 49.7, and 50.3, which is too much.
        (0.1, "0.0627 J come out of a cycle; the torque lags the deflection by 70 ms at least"),
        (0.78, "0.442 J come out of a cycle; the torque lags the deflection by 500 ms at least"),
        (0.79, "0.446 J come out of a cycle"),
        (-0.5, None),
    ],
)
def test_loops_that_give_energy_are_told_with_the_least_lag(lag, text):
    t, x, y, cycles = swings(6, lag)
    found = quality._backward(t, x, y, cycles, True)
    if text is None:
        assert found == []
        return
    (f,) = found
    assert (f.kind, f.stops) == ("lag", True)
    assert f.text.startswith(f"the loops run backward: {text}")
    assert ("align the channels" in f.text) == (lag < 0.785)
    # Without a clock nothing is said of time; one longer step makes no other usual one.
    (f,) = quality._backward(t, x, y, cycles, False)
    assert f.text.endswith("J come out of a cycle")
    (f,) = quality._backward(t + np.where(np.arange(len(t)) > 2390, 0.7, 0), x, y, cycles, True)
    assert f.text.startswith(f"the loops run backward: {text}")
    assert quality._backward(t, x, y, [], True) == []


def test_of_one_kind_the_first_is_told_and_how_many_more():
    a, b = Finding("frozen", "at 1", True), Finding("offset", "by 2", True, "; zero it")
    found = quality._shortened(
        [a, b, Finding("frozen", "at 3", False), Finding("frozen", "4", True)]
    )
    assert found == (Finding("frozen", "at 1, and 2 more such stretches", True), b)
    assert quality._shortened([a, b]) == (a, b)
    assert quality._shortened([a, a])[0].text == "at 1, and 1 more such stretches"


# The gate.

SPRUNG = "spring", "offset"


def seen(*kinds: str, stops: bool = True) -> SimpleNamespace:
    return SimpleNamespace(label="rig", findings=[Finding(k, k, stops) for k in kinds])


def test_a_dead_zone_excuses_backlash_where_the_device_has_one(elbow):
    assert excused_of(elbow) == set()
    for value, excused in ((0.01, {"backlash"}), (0.0, set())):
        assert excused_of(with_values(elbow, {"dead_zone_rad": value})) == excused


def member(*kinds: str) -> FittedMember:
    terms = tuple(Term(k) for k in kinds)
    return FittedMember(Member("own", "own", terms), 0.2, tuple(1.0 for _ in kinds))


def test_a_member_with_an_offset_excuses_one_and_its_terms_are_doubted_one_by_one(elbow):
    plain, own = (family_device(elbow, member(*k), "drawn") for k in (("spring",), SPRUNG))
    assert (excused_of(plain), excused_of(own)) == (set(), {"offset"})
    before = statuses(own)
    assert gated(own, [seen("offset")]) is own
    shut = statuses(gated(own, [seen("offset", "lag")]))
    changed = {k for k, v in shut.items() if v != before[k]}
    assert changed == {
        k for k, v in before.items() if k.startswith("family.") and v[0] == "identified"
    }
    assert {"family.scale_rad", *(f"family.terms[{i}].weight_Nm" for i in (0, 1))} <= changed
    assert shut["family.terms[1].weight_Nm"][0] == "assumed"
    assert gated(plain, [seen("offset")]) is not plain


def test_who_has_a_term_for_it_needs_no_advice():
    told = Finding("offset", "an offset", True, "; zero it")
    one = [SimpleNamespace(label="rig", findings=[told])]
    assert gate_notes(one)[1:] == ("Quality, rig: an offset; zero it.",)
    assert gate_notes(one, {"offset"}) == ("Quality, rig: an offset.",)


def statuses(device: Device) -> dict[str, tuple[str, str]]:
    return {k: (q.status, q.source) for k, q in device.quantities()}


def test_behind_a_shut_gate_what_was_identified_is_assumed(elbow):
    put = {"k1_Nm_rad": 9.0, "m": 1.5, "dead_zone_rad": 0.01}
    device = with_values(elbow, put, limits={"tau_Nm": 9.0})
    before = statuses(device)
    for recordings in ([], [seen("frozen", stops=False)], [seen("backlash")]):
        assert gated(device, recordings) is device
    shut = gated(device, [seen("frozen", "backlash"), seen("lag", "frozen")])
    why = "not identified, the recording has: frozen, lag; trial"
    changed = {k: v for k, v in statuses(shut).items() if v != before[k]}
    names = ("elastomer.k1_Nm_rad", "elastomer.maxwell.m", "elastomer.dead_zone_rad")
    assert changed == dict.fromkeys(names, ("assumed", why))
    assert before["limits.tau_Nm"] == ("identified", "trial")
    assert dict(shut.quantities())["elastomer.k1_Nm_rad"].value == 9.0


def test_notes_of_one_recording_name_it_and_of_several_those_that_have_it():
    assert gate_notes([seen("frozen", stops=False)]) == ("Quality, rig: frozen.",)
    both = [seen("frozen"), SimpleNamespace(label="other", findings=[Finding("odd", "odd", False)])]
    assert gate_notes(both) == (
        "Quality gate: frozen. The torque model's numbers are marked assumed, not identified.",
        "Quality, rig: frozen.",
        "Quality, other: odd.",
    )
    same = [seen("odd", stops=False), seen("odd", stops=False)]
    assert gate_notes(same) == ("Quality, all: odd.",)
    assert gate_notes([*same, seen()]) == ("Quality, rig, rig: odd.",)
