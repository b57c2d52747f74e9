"""One step of the emitted limits as formulas, worked out for numbers that are typed."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.errors import UserError

from ..conftest import require_tool
from ..limits_model import FLAGS
from .limits_proof import PROPERTIES
from .limits_step import LimitsC, Step, compiled
from .smt_terms import Terms
from .typed_limits_step import INITIAL, RUNNING, TINY, U

COUNTED = [
    *("INPUT_INVALID", "STATE_REPAIRED", "SENSING_LOST", "TORQUE_CLIPPED", "RATE_LIMITED"),
    *("ROM_LOW", "ROM_HIGH", "SPEED_LIMITED", "REARM_REFUSED", "CLOCK", "LATE"),
]
STRUCTS = {"coef": "coeffs", "before": "state", "given": "in"}


@pytest.fixture(scope="module")
def step(drive) -> Step:
    require_tool("gcc")
    made = Step(LimitsC(drive, "f32"))
    assert len(made.initial) == 21
    assert len(made.counters) == len(COUNTED)
    return made


def worked_out(step: Step, **changes: float) -> Terms:
    """The step from the running drive, some of its numbers changed: ``given.mode`` and such."""
    known = {
        f"{struct}.{name}": np.float32(changes.get(f"{group}.{name}", value))
        for group, struct in STRUCTS.items()
        for name, value in RUNNING[group].items()
    }
    for k, name in enumerate(COUNTED):
        known[f"state.n_{name.lower()}"] = (2**32 - 1 if name == "LATE" else 10 * k, 32)
    return Terms(step.script.lines, known)


def test_every_number_has_its_own_place(step):
    asked = {"coef": step.coef, "given": step.given, "before": step.before}
    changes: dict[str, float] = {}
    for group in STRUCTS:
        for name in RUNNING[group]:
            changes[f"{group}.{name}"] = len(changes) + 0.5
    at = worked_out(step, **changes)
    for place, value in changes.items():
        group, name = place.split(".")
        port, bracket, index = name.partition("[")
        more = [int(index[:-1])] if bracket else []
        assert at(asked[group](port, *more).term) == value, place


def test_a_running_drive_follows_by_the_narrowed_step(step):
    at = worked_out(step)
    # From 0.0625 towards 0.1 by at most 0.03125.
    assert (at(step.out("u_Nm").term), at(step.out("u_lag_Nm").term)) == (
        *(0.09375, np.float32(0.1) - np.float32(0.09375)),
    )
    after = {n: at(step.after(n).term) for n in ("key", "u_last_Nm", "u_mirror_Nm", "beat_last")}
    assert list(after.values()) == [5592405.5, 0.09375, -0.09375, 8]
    assert [at(step.after(n).term) for n in ("fault_stored", "rearm_last", "rearm_mirror")] == [
        *(0, 3, -3),
    ]
    assert at(step.out("fault").term) == 0
    assert [n for n in FLAGS if at(step.flag(n))] == ["RATE_LIMITED"]
    assert (at(step.runs), at(step.latched), at(step.cut)) == (True, False, False)
    assert [at(c) for c in step.cases] == [True, False]
    # Of the window's slots none is full yet: they stay, and the present one grows by 1 mJ.
    slots = [at(step.after("slots_J", i).term) for i in range(10)]
    assert slots == [(i + 1) / 16 for i in range(10)]
    assert at(step.after("slot_J").term) == np.float32(0.5) + np.float32(1e-3)
    assert at(step.out("energy_J").term) == pytest.approx(0.5 + 1e-3 + 55 / 16, rel=1e-6)


def test_a_stop_cuts_in_the_same_step(step):
    at = worked_out(step, **{"given.stop": 1})
    assert (at(step.out("u_Nm").term), at(step.out("fault").term)) == (0, 4)
    assert [at(step.after(n).term) for n in ("key", "fault_stored", "fault_mirror")] == [0, 4, -4]
    assert [n for n in FLAGS if at(step.flag(n))] == ["STOPPED", "FAULT_LATCHED"]
    assert (at(step.runs), at(step.latched), at(step.cut)) == (False, True, True)
    assert [at(c) for c in step.cases] == [False, True]


def test_counters_by_their_flags_stay_at_their_end(step):
    at = worked_out(step, **{"given.late_level": 200, "given.sensing_ok": 0})
    pairs = {n: (at(a)[0], at(b)[0]) for n, (a, b) in zip(COUNTED, step.counters, strict=True)}
    end = 2**32 - 1
    assert pairs == {
        n: (end, end) if n == "LATE" else (10 * k, 10 * k + (n == "SENSING_LOST"))
        for k, n in enumerate(COUNTED)
    }


def test_what_init_writes(step):
    at = worked_out(step)
    found = [(at(now.term), at(written.term)) for now, written in step.initial]
    assert found == [(np.float32(v), INITIAL[n]) for n, v in RUNNING["before"].items()]


def test_the_largest_change_is_narrowed_or_compiled(step):
    for narrowed, largest in ((0.03125, 0.03125), (0.0505, 0.04999999701976776)):
        at = worked_out(step, **{"coef.u_step_Nm": narrowed})
        assert at(step.change.term) == np.float32(largest)


def test_a_magnitude_is_beyond_a_limit_on_either_side(step):
    most = step.limit.tau_max_Nm
    for tau_Nm, outside, above in (
        (8, False, True),
        (8.001, True, True),
        (-8.001, True, True),
        (-8, False, True),
        (4, False, False),
        (-4, False, False),
    ):
        at = worked_out(step, **{"given.tau_Nm": tau_Nm})
        assert at(step.beyond("tau_Nm", most)) == outside
        assert at(step.above(step.given("tau_Nm"), step.coef("tau_max_Nm"))) == above


CASES = [
    {}, {"given.mode": 0}, {"given.mode": 2}, {"given.stop": TINY}, {"given.stop": np.nan},
    {"given.rearm": 4}, {"given.rearm": 3.5}, {"given.u_command_Nm": np.inf},
    {"given.u_command_Nm": -0.8}, {"given.control_beat": 7}, {"given.control_beat": 0},
    {"given.control_beat": 7, "before.age": 24}, {"given.theta_load_rad": 2.0},
    {"given.theta_load_rad": 2.2}, {"given.theta_load_rad": -0.1}, {"given.tau_Nm": 4.5},
    {"given.omega_load_rad_s": 5}, {"given.omega_motor_rad_s": -9}, {"given.late_level": 129},
    {"given.clock_ok": 0}, {"given.coeffs_ok": np.nan}, {"before.slot_J": 20},
    {"before.age": 26}, {"before.key": 1}, {"before.u_mirror_Nm": 0}, {"before.fault_stored": 3},
    {"coef.u_max_Nm": 1}, {"coef.rom_min_rad": 2}, {"coef.energy_max_J": np.nan},
    {f"before.{n}": 0 for n in RUNNING["before"]}, {f"before.{n}": v for n, v in INITIAL.items()},
    {"before.key": 0, "before.fault_stored": 9, "before.fault_mirror": -9, "before.u_last_Nm": 0,
     "before.u_mirror_Nm": 0, "given.mode": 0, "given.u_command_Nm": 0, "given.rearm": 4},
    {"before.u_last_Nm": U, "before.u_mirror_Nm": -U, "given.u_command_Nm": -0.2},
]  # fmt: skip


def test_the_emitted_c_keeps_every_property(step):
    formulas = {name: p.formula(step) for name, p in PROPERTIES.items()}
    seen = {True: 0, False: 0}
    for case in CASES:
        at = worked_out(step, **case)
        broken = [name for name, formula in formulas.items() if not at(formula)]
        assert broken == [], case
        seen[bool(at(step.cut))] += 1
    assert min(seen.values()) > 5


def test_a_fault_is_put_into_the_file_that_is_named(drive, monkeypatch):
    from . import limits_step

    class Files:
        prefix = "esea_x"

        def __init__(self, system, fmt, digest, command, title) -> None:
            self.given = system, fmt.name, digest, command, title

        def files(self):
            return {"a.c": "one", "b.h": "two"}

    monkeypatch.setattr(limits_step, "Renderer", Files)
    monkeypatch.setattr(limits_step, "format_hash", lambda device, real: f"{real} hash")
    assert LimitsC(drive, "q31").files == {"a.c": "one", "b.h": "two"}
    made = LimitsC(drive, "f32", lambda name, text: f"{name} {text}")
    assert made.files == {"a.c": "a.c one", "b.h": "b.h two"}
    assert made.renderer.given == (drive.system, "f32", "f32 hash", "-", drive.title)
    assert made.function("step") == "esea_x_limits_step"


def test_a_device_without_limits_has_no_numbers_of_them(elbow):
    with pytest.raises(UserError, match="no limits before the motor"):
        compiled(elbow)
