"""What each property of the limits says of one step, its numbers typed: at an end, and beyond."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from esea_gen.control.limits.faults import Fault

from ..limits_model import FLAGS
from .limits_proof import POSSIBLE, PROPERTIES
from .limits_step import compiled
from .smt_terms import parsed, value_of
from .typed_limits_step import (
    CUT,
    INF,
    INITIAL,
    KEY,
    NAN,
    RELEASED,
    RUNNING,
    STEP,
    THETA,
    TINY,
    WAS_CLOSED,
    WIDE_OPEN,
    Told,
    U,
    down,
    up,
)


@pytest.fixture(scope="module")
def holds(drive):
    """Whether a property holds of the running drive, some of its numbers changed."""
    block = next(b for b in drive.system.kinds if b.name == "limits")
    limit = compiled(drive)

    def asked(name: str, *changes: dict[str, Any], fraction: int | None = None) -> bool:
        step = Told(block, limit, {k: v for c in changes for k, v in c.items()}, fraction)
        possible = name.removeprefix("possible: ")
        made = PROPERTIES[name].formula if possible == name else POSSIBLE[possible]
        said = value_of(parsed(made(step)), {})
        assert said in (True, False)
        return bool(said)

    return asked


@pytest.mark.parametrize("name", PROPERTIES)
def test_a_drive_that_runs_is_cut_or_is_released_breaks_none(holds, name):
    assert holds(name)
    assert holds(name, CUT)
    assert holds(name, RELEASED)
    assert holds(name, CUT, WAS_CLOSED)


def ends(place: str, low: float, high: float, name: str = "") -> list[Any]:
    """Both ends hold; what is one float beyond does not, nor does NaN."""
    rows = [({place: v}, True) for v in (low, high)]
    return [(name, *r) for r in [*rows, *(({place: v}, False) for v in (down(low), up(high), NAN))]]


def command_cases() -> list[Any]:
    last = "before.u_last_Nm"
    cases = ends("out.u_Nm", -U, U, "command_within_compiled")
    cases += ends("out.u_Nm", -0.125, 0.125, "command_within_narrowed")
    for at in (0.1875, -0.1875):
        for u in (at, -np.sign(at) * 0.125):
            cases.append(("command_within_narrowed", {last: at, "out.u_Nm": u}, True))
            beyond = {last: at, "out.u_Nm": up(u) if u > 0 else down(u)}
            cases.append(("command_within_narrowed", beyond, False))
    nothing = {last: NAN, "coef.u_max_Nm": NAN}
    cases += [("command_within_narrowed", nothing | {"out.u_Nm": u}, u == 0) for u in (0, TINY)]
    cases += ends("out.u_Nm", 0.03125, 0.09375, "command_rate")
    cases += [
        (n, c | {"coef.u_step_Nm": 1, last: 0}, told)
        for n, c, told in ends("out.u_Nm", -STEP, STEP, "command_rate")
    ]
    cases += [("command_rate", {"after.key": k, "out.u_Nm": 0.2}, k == 0) for k in (0, TINY)]
    # A push falls by a full step, or is none.
    for place, at, beyond, sign in (
        *(("given.theta_load_rad", a, f(a), s) for a, f, s in ((2, down, 1), (0, up, -1))),
        *(("given.omega_load_rad_s", a, f(a), s) for a, f, s in ((4, down, 1), (-4, up, -1))),
        *(("given.omega_motor_rad_s", a, f(a), s) for a, f, s in ((4, down, 1), (-4, up, -1))),
        *(("given.mode", 0, 1, s) for s in (1, -1)),
    ):
        name = {"theta": "ends", "omega": "brake", "mode": "off"}[place[6:].split("_")[0]]
        for was, u, enough in (
            *((0.0625, u, True) for u in (0, 0.03125)),
            *((0.0625, u, False) for u in (up(0.03125), 0.0625, 0.09375)),
            *((0, u, u == 0) for u in (0, TINY)),
        ):
            now = {last: sign * was, "out.u_Nm": sign * u}
            cases.append((name, {place: at} | now, enough))
            cases.append((name, {place: beyond} | now, True))
    # The other way every push goes.
    cases += [("ends", {"given.theta_load_rad": a, "out.u_Nm": u}, True)
              for a, u in ((2, -0.2), (3, -0.2), (0, 0.2), (-1, 0.2))]  # fmt: skip
    cases += [("brake", {f"given.omega_{w}_rad_s": a, "out.u_Nm": u}, True)
              for w in ("load", "motor") for a, u in ((5, -0.2), (-5, 0.2))]  # fmt: skip
    cases.append(("off", {"given.mode": 0, "out.u_Nm": -0.01}, False))
    return cases


def input_cases() -> list[Any]:
    cases: list[Any] = [("stop", {"given.stop": v}, False) for v in (TINY, 1, -1, NAN)]
    cases += [("stop", {"given.stop": -0.0}, True)]
    for name in ("sensing_ok", "clock_ok", "coeffs_ok"):
        cases += [("sensing", {f"given.{name}": v}, False) for v in (0, down(1), up(1), NAN)]
    cases += [("late", {"given.late_level": v}, v == 128) for v in (128, up(128), 255, NAN)]
    for name, high in (("mode", 2), ("rearm", 7)):
        for k in range(-1, high + 2):
            cases.append(("input_invalid", {f"given.{name}": k}, 0 <= k <= high))
            cases.append(("input_invalid", {f"given.{name}": k + 0.5}, False))
    for v in (0, up(1), NAN):
        cases.append(("input_invalid", {"given.request_ok": v}, False))
    # Ends that are no float are rounded towards 0.
    theta, low, high = 0.3499999940395355, -0.949999988079071, 3.3499999046325684
    for name, range_ in {
        **{"u_command_Nm": (-4 * U, 4 * U), "control_beat": (0, 255), "stop": (0, 1)},
        **{"theta_rad": (-theta, theta), "theta_motor_rad": (low, high), "tau_Nm": (-20, 20)},
        **{"theta_load_rad": (-0.5999999642372131, 3), "late_level": (0, 255)},
        **{"omega_load_rad_s": (-12, 12), "omega_motor_rad_s": (-12, 12)},
    }.items():
        cases += ends(f"given.{name}", *range_, "input_invalid")
    beat, was, age, then = "given.control_beat", "before.beat_last", "before.age", "after.age"
    cases += [("control_stale", {beat: v}, v == 1) for v in (1, down(1), 0)]
    same = {beat: 8, was: 8}
    cases += [
        *(("control_stale", same | {age: 24, then: v}, False) for v in (25, 24)),
        ("control_stale", same | {age: down(24), then: 25}, True),
        *(("control_stale", same | {age: 2, then: v}, ok) for v, ok in ((3, 1), (down(3), 0))),
        *(("control_stale", same | {age: NAN, then: v}, ok) for v, ok in ((25, 1), (24.9, 0))),
        ("control_stale", {beat: 8, was: 7, age: 25, then: 0}, True),
        ("control_stale", CUT | same | {age: 2, then: 2}, True),
    ]
    return cases


def limit_cases() -> list[Any]:
    cases: list[Any] = []

    def both(name: str, place: str, narrowed: Any, compiled_: Any, **more: float) -> None:
        nan = {place: NAN}
        for rows, opened in ((narrowed, {}), (compiled_, WIDE_OPEN)):
            told = ends(place, *rows, name)
            cases.extend((n, {**opened, **more, **c}, t) for n, c, t in told if c != nan)

    both("deflection", "given.theta_rad", (-0.25, 0.25), (-THETA, THETA))
    at = {"given.theta_load_rad": 0}
    both("deflection", "given.theta_motor_rad", (-0.25, 0.25), (-THETA, THETA), **at)
    at = {"given.theta_motor_rad": 0}
    both("deflection", "given.theta_load_rad", (-0.25, 0.25), (-THETA, THETA), **at)
    apart = {"given.theta_motor_rad": 0.2, "given.theta_load_rad": -0.2}
    cases += [("deflection", apart, False), ("deflection", WIDE_OPEN | apart, False)]
    both("torque", "given.tau_Nm", (-4, 4), (-8, 8))
    both("speed", "given.omega_load_rad_s", (-8, 8), (-10, 10))
    both("speed", "given.omega_motor_rad_s", (-8, 8), (-10, 10))
    # 0.35 and 2.7 lie between floats: the ones next to them, on the side of the range.
    low, high = -0.3499999940395355, 2.6999998092651367
    both("range_of_motion", "given.theta_load_rad", (-0.125, 2.125), (low, high))
    for limit, opened in ((10, {}), (15, WIDE_OPEN)):
        cases += [("energy", opened | {"out.energy_J": v}, v <= limit) for v in (limit, up(limit))]
    return cases


def memory_cases() -> list[Any]:
    def pair(one: str, other: str, value: float) -> dict[str, float]:
        return {f"before.{one}": value, f"before.{other}": -value}

    cases: list[Any] = []
    ranges = {"beat_last": (0, 255), "age": (0, 25), "ticks": (0, 100)}
    slot_J = 24.239999771118164
    for name, range_ in {**ranges, "slot_J": (0, slot_J)}.items():
        cases += ends(f"before.{name}", *range_, "memory")
    # 0.2 % of room in a sum of ten; 242.8848 lies between floats.
    most = float(np.float32(slot_J * 10 * 1.002))
    most = most if Fraction(most) <= Fraction(slot_J) * Fraction("10.02") else down(most)
    for i in range(10):
        cases += ends(f"before.slots_J[{i}]", -most, most, "memory")
    closed = {"before.key": 0, **pair("u_last_Nm", "u_mirror_Nm", 0)}
    for fault in (1, 15, 0.5, 16):
        told = closed | pair("fault_stored", "fault_mirror", fault)
        cases.append(("memory", told, fault in (1, 15)))
    whole_ = closed | pair("fault_stored", "fault_mirror", 9)
    cases += [("memory", whole_ | pair("u_last_Nm", "u_mirror_Nm", u), False) for u in (TINY, -0.1)]
    cases += [("memory", {"before.key": k}, False) for k in (1, down(KEY), up(KEY), NAN)]
    cases += [("memory", whole_ | {"before.key": k}, False) for k in (TINY, -1, NAN)]
    cases.append(("memory", pair("fault_stored", "fault_mirror", 9), False))
    cases.append(("memory", {"before.fault_mirror": -TINY}, False))
    for k in (-2, -1, 0, 7, 8, NAN):
        cases.append(("memory", pair("rearm_last", "rearm_mirror", k), k in (-1, 0, 7)))
    cases += [("memory", {"before.rearm_mirror": k}, False) for k in (3, down(-3), NAN)]
    for u in (-U, U, down(-U), up(U)):
        cases.append(("memory", pair("u_last_Nm", "u_mirror_Nm", u), abs(u) <= U))
    cases += [("memory", {"before.u_mirror_Nm": f(-0.0625)}, False) for f in (up, down)]
    bad = CUT | {"before.age": 26}
    cases += [("memory", bad | {"out.fault": k}, k == 2) for k in (1, 2, 3)]
    cases += [("memory", {"before.age": 26, "out.fault": 2}, False)]
    return cases


def latch_cases() -> list[Any]:
    no_cause = ("TORQUE_CLIPPED", "RATE_LIMITED", "ROM_LOW", "ROM_HIGH", "SPEED_LIMITED")
    cases: list[Any] = [("shown_cause", {"out.fault": k}, k == 0) for k in (0, TINY, 1)]
    for flag in set(FLAGS) - {"REARM_REFUSED", "FAULT_LATCHED"}:
        cases.append(("shown_cause", {"shown": (flag,)}, flag in no_cause))
    cases += [
        ("release", RELEASED | {place: v}, False)
        for place, values in {
            **{"given.mode": (TINY, 1, NAN), "given.stop": (TINY, 1), "given.rearm": (3, 5, up(4))},
            **{"given.u_command_Nm": (TINY, -TINY, NAN), "before.key": (TINY, 1, NAN)},
            **{"before.fault_stored": (0, down(1), NAN), "out.fault": (1, TINY)},
            "before.rearm_last": (4, 2, -1, 3 + 2.0**-19, 3 - 2.0**-19, NAN),
        }.items()
        for v in values
    ]
    cases += [("release", RELEASED | {"before.rearm_last": 3 + d}, True)
              for d in (2.0**-20, -(2.0**-20))]  # fmt: skip
    cases.append(("release", RELEASED | {"before.fault_stored": 1}, True))
    for k in range(8):
        for now in range(8):
            told = RELEASED | {"before.rearm_last": k, "given.rearm": now}
            cases.append(("release", told, now == (k + 1) % 8))
    wrong = RELEASED | {"given.mode": 1}
    cases += [("release", wrong | {"before.key": KEY}, True), ("release", wrong | CUT, True)]
    cases += [
        ("latched_no_torque", {"before.key": k, "out.u_Nm": u}, k == KEY or u == 0)
        for k in (0, KEY, down(KEY), NAN)
        for u in (0, TINY, -TINY, NAN)
    ]
    now = {"given.rearm": 5}
    cases += [("request_spent", now | {"after.rearm_last": k}, k == 5) for k in (5, 4, -1)]
    corrupt = {"shown": ("STATE_REPAIRED",)}
    cases += [("request_spent", corrupt | {"after.rearm_last": k}, k == -1) for k in (3, -1, 1)]
    for k in range(-1, 9):
        told = {"given.rearm": k, "after.rearm_last": 0.5}
        cases += [("request_spent", told, not 0 <= k <= 7)]
    return cases


def number_cases() -> list[Any]:
    ranges = {"u_Nm": (-U, U), "u_cut_Nm": (-U, U), "u_lag_Nm": (-2 * U, 2 * U), "fault": (0, 15)}
    cases: list[Any] = []
    for name, range_ in ranges.items():
        cases += ends(f"out.{name}", *range_, "outputs_in_range")
    energies = {0.0: True, 1e30: True, -TINY: False, INF: False, -INF: False}
    for v, told in [*energies.items(), (NAN, False)]:
        cases.append(("energy_is_number", {"out.energy_J": v}, told))
    cases.append(("outputs_in_range", {"out.energy_J": NAN}, True))
    states = {
        **{"key": (0, KEY), "fault_stored": (0, 15), "fault_mirror": (-15, 0)},
        **{"rearm_last": (-1, 7), "rearm_mirror": (-7, 1), "u_last_Nm": (-U, U)},
        **{"u_mirror_Nm": (-U, U), "beat_last": (0, 255), "age": (0, 25), "ticks": (0, 100)},
        "slot_J": (0, 24.239999771118164),
    }
    for name, range_ in states.items():
        cases += ends(f"after.{name}", *range_, "states_in_range")
    for i in range(10):
        for v in (1e30, -1e30, INF, -INF, NAN):
            cases.append(("states_in_range", {f"after.slots_J[{i}]": v}, abs(v) < INF))
    for flagged in range(2):
        for pair_ in ((3, 3), (3, 4), (4, 3), (2**31 - 1, 2**31), (2**32 - 1, 0)):
            counted = [(1, 1), (1, 1)]
            counted[flagged] = pair_
            cases.append(("counters", {"counters": counted}, pair_[0] <= pair_[1]))
    cases += [("own_memory", {f"after.{n}": v}, False) for n, v in (
        ("fault_mirror", -1), ("rearm_mirror", 3), ("u_mirror_Nm", 0), ("key", 0), ("key", 1),
    )]  # fmt: skip
    faulty = {"after.fault_stored": 1, "after.fault_mirror": -1}
    cases += [("own_memory", faulty, False), ("own_memory", CUT | faulty, True)]
    low = {"after.fault_stored": down(1), "after.fault_mirror": -down(1)}
    cases += [("own_memory", CUT | low, False)]
    moved = {"after.u_last_Nm": TINY, "after.u_mirror_Nm": -TINY}
    cases += [("own_memory", CUT | moved, False)]
    return cases


@pytest.mark.parametrize(
    "cases", [command_cases, input_cases, limit_cases, memory_cases, latch_cases, number_cases]
)
def test_what_a_property_allows(holds, cases):
    wrong = [case for case in cases() if holds(*case[:2]) != bool(case[2])]
    assert wrong == []
    refused = {n: c for n, c, told in cases() if not told}
    # A cut is the answer to every cause.
    for name in {"stop", "sensing", "late", "input_invalid", "deflection", "torque"} & set(refused):
        assert holds(name, refused[name], CUT)


PARTS = {
    **{"out.u_Nm": TINY, "after.u_last_Nm": -TINY, "after.key": 1, "out.fault": down(1)},
    **{"after.fault_stored": down(1), "shown": ("STOPPED",)},
}


def test_a_cut_is_no_torque_and_a_closed_latch_with_a_reason(holds):
    for part, value in PARTS.items():
        assert not holds("stop", CUT, {"given.stop": 1, part: value}), part
    assert holds("stop", CUT, {"given.stop": 1, "out.fault": 1, "after.fault_stored": 1})


def test_the_smallest_of_several_causes_is_the_reason(holds):
    order = [
        *("STATE_REPAIRED", "TUNABLE_INVALID", "STOPPED", "INPUT_INVALID", "SENSING_LOST"),
        *("CONTROL_STALE", "DEFLECTION", "INTERACTION_TORQUE", "SPEED", "RANGE_OF_MOTION"),
        *("ENERGY", "CLOCK", "LATE", "COEFFICIENTS"),
    ]
    pairs = combinations(enumerate(order, start=2), 2)
    for (i, one), (j, other) in (p for p in pairs if p[1][0] - p[0][0] in (1, 3, 11)):
        shown = {"shown": ("FAULT_LATCHED", other, one)}
        assert holds("new_reason", CUT, shown, {"out.fault": i})
        assert not holds("new_reason", CUT, shown, {"out.fault": j})
        # Of an older reason nothing is said, nor of a drive that runs on.
        assert holds("new_reason", CUT, WAS_CLOSED, shown, {"out.fault": j})
        assert holds("new_reason", {"shown": (one,), "out.fault": j})


def test_the_first_reason_stays_while_the_memory_is_whole(holds):
    before = CUT | WAS_CLOSED
    other = before | {"after.fault_stored": 8}
    assert not holds("first_reason", other)
    at_ends = {
        **{"before.beat_last": 255, "before.age": 25, "before.ticks": 100},
        **{"before.slot_J": 24.239999771118164, "before.fault_stored": 1},
        **{"before.fault_mirror": -1, "before.rearm_last": -1, "before.rearm_mirror": 1},
        **{f"before.slots_J[{i}]": down(2.4239999771118164) for i in range(10)},
    }
    assert not holds("first_reason", other, at_ends)
    assert holds("first_reason", other, at_ends, {"after.fault_stored": 1})
    for broken in (
        *({f"before.{n}": v} for n, v in (("fault_mirror", -8), ("rearm_mirror", 3))),
        *({f"before.{n}": v} for n, v in (("u_mirror_Nm", TINY), ("key", TINY), ("ticks", -TINY))),
        *({f"before.{n}": v} for n, v in (("beat_last", up(255)), ("age", up(25)), ("age", -1))),
        *({f"before.slots_J[{i}]": v} for i in range(10) for v in (2.43, -TINY)),
        {"before.u_last_Nm": TINY, "before.u_mirror_Nm": -TINY},
        {"before.fault_stored": down(1), "before.fault_mirror": -down(1)},
        {"after.key": KEY},
    ):
        assert holds("first_reason", other, broken), broken


def test_torque_reason_and_key_agree(holds):
    closed = {"shown": ("FAULT_LATCHED",), "after.key": 0}
    for broken in (
        *({"out.fault": 1}, {"after.fault_stored": 1}, {"after.key": 0}, {"out.u_Nm": 0.05}),
        *({"shown": ("FAULT_LATCHED",)}, closed, {"out.fault": 1, "after.fault_stored": 1}),
    ):
        assert not holds("agreement", broken), broken
    for broken in ({"out.fault": 8}, {"out.u_Nm": TINY, "after.u_last_Nm": TINY}, {"shown": ()}):
        assert not holds("agreement", CUT, broken), broken


def test_memory_of_zeros_and_of_init_is_latched(holds):
    zeros = {f"before.{n}": 0 for n in INITIAL}
    initial = {f"before.{n}": v for n, v in INITIAL.items()}
    not_armed = CUT | {"out.fault": 1, "after.fault_stored": 1}
    for name, memory in (("zero_memory", zeros), ("initial_memory", initial)):
        assert not holds(name, memory)
        assert holds(name, memory, not_armed)
        for place in memory:
            assert holds(name, memory, {place: 0.25}), place
    assert holds("zero_memory", zeros, CUT)
    assert not holds("initial_memory", initial, CUT)


def test_each_coefficient_within_its_compiled_bounds(drive, holds):
    block = next(b for b in drive.system.kinds if b.name == "limits")
    assert {p.name for p in block.coefficients} == set(RUNNING["coef"])
    reversed_ = {"coef.rom_min_rad": 2, "coef.rom_max_rad": 2}
    assert not holds("coefficients", reversed_)
    assert holds("coefficients", reversed_ | {"coef.rom_min_rad": down(2)})
    for p in block.coefficients:
        for value, within in ((p.low, True), (p.high, True), (down(p.low), False)):
            told = {f"coef.{p.name}": value}
            other = {"rom_min_rad": "rom_max_rad", "rom_max_rad": "rom_min_rad"}.get(p.name)
            if other:
                told[f"coef.{other}"] = 2.5 if other == "rom_max_rad" else -0.14999999105930328
            inside = within and len(set(told.values())) == len(told)
            assert holds("coefficients", told) == inside, told
        for value in (up(p.high), NAN):
            assert not holds("coefficients", {f"coef.{p.name}": value})


def test_whole_numbers_may_be_one_unit_apart(holds):
    # 2^-24 units: the last command's copies differ by half a unit each, and no more is sound.
    bits, unit = 24, 2.0**-24
    whole_ = {"before.slots_J[0]": 0}
    for units, allowed in ((1, True), (-1, True), (2, False), (-2, False)):
        told = {"before.u_mirror_Nm": -0.0625 + units * unit}
        assert holds("memory", whole_, told, fraction=bits) == allowed, units
    for speed, brakes in ((4 + unit, True), (4, False), (-4 - unit, True), (-4, False)):
        for name in ("load", "motor"):
            told = {f"given.omega_{name}_rad_s": speed, "out.u_Nm": np.sign(speed) * 0.125}
            told["before.u_last_Nm"] = np.sign(speed) * 0.0625
            assert holds("brake", told, fraction=bits) == (not brakes), speed


def test_what_must_be_possible(holds):
    place = {
        **{"given.theta_rad": 0, "given.tau_Nm": 0, "given.omega_load_rad_s": 0},
        **{"given.omega_motor_rad_s": 0, "given.theta_load_rad": 1, "given.theta_motor_rad": 1},
        **{"coef.rom_max_rad": 2, "coef.rom_gain_Nm_rad": 1, "coef.brake_rad_s": 8},
        **{"coef.speed_gain_Nms_rad": 1, "out.u_Nm": 0.2},
    }
    assert holds("possible: full torque", place)
    for name in place:
        assert not holds("possible: full torque", place, {name: 0.1}), name
    assert not holds("possible: full torque", place, {"after.key": 0})
    low = 0.19889999926090240  # the float below nine tenths of 0.221
    for u, enough in ((low, False), (up(low), True)):
        assert holds("possible: full torque", place, {"out.u_Nm": u}) == enough
    assert holds("possible: release", RELEASED)
    assert not holds("possible: release", WAS_CLOSED, CUT)
    assert not holds("possible: release", {"before.key": KEY})
    for code in range(2, 16):
        for told in range(16):
            assert holds(f"possible: reason {code}", {"out.fault": told}) == (told == code)
        assert not holds(f"possible: reason {code}", {"out.fault": code, "before.key": 0})
    assert {n for n in POSSIBLE if n.startswith("reason")} == {f"reason {k}" for k in range(2, 16)}
    assert list(Fault)[2:] == list(range(2, 16))
