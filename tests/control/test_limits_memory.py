"""Limits before the motor: corrupt memory never ends the latch or widens a limit, in any format."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from esea_gen.control.limits.block import limits
from esea_gen.control.limits.faults import Fault
from esea_gen.hostlib.codec import block_field
from esea_gen.hostlib.library import CRunner, block_system, compile_device, compile_system
from esea_gen.language.stream import single
from esea_gen.model.sensing import zeros_missing
from tests import limits_model as model
from tests.conftest import require_tool
from tests.proof.sanitize import UNDEFINED, standard_error

EVERY = [*model.REALS, "q31"]
WIDTHS = {"f64": 64, "f32": 32, "q31": 32}


@pytest.fixture(scope="module")
def runners(drive) -> dict[str, CRunner]:
    return {real: model.compiled(drive, real) for real in EVERY}


# -- corrupt memory --------------------------------------------------------------------------------


def quiet(steps: int) -> dict[str, np.ndarray]:
    """Off, nothing commanded, no cause left: only a request is missing."""
    x = {k: v[:steps].copy() for k, v in model.calm().items()}
    for name in ("mode", "u_command_Nm", "stop", "rearm"):
        x[name][:] = 0
    return x


def flips(runner: CRunner, prepared: np.ndarray):
    """The prepared state with each single bit of each state field flipped."""
    for name in (f.name for f in runner.state_fields):
        raw = prepared[name].tobytes()
        for bit in range(8 * len(raw)):
            data = bytearray(raw)
            data[bit // 8] ^= 1 << bit % 8
            state = prepared.copy()
            state[name] = np.frombuffer(bytes(data), prepared[name].dtype).reshape(
                prepared[name].shape
            )
            yield f"{name} bit {bit}", state


@pytest.mark.parametrize("real", EVERY)
@pytest.mark.parametrize("since_start", [True, False])
def test_no_flipped_bit_ends_the_latch(runners, real, since_start):
    runner = runners[real]
    before = quiet(12) if since_start else model.with_value("tau_Nm", 9.0)
    y = model.ran(runner, before)
    assert y["fault"][-1] == (Fault.NOT_ARMED if since_start else Fault.TORQUE)
    prepared = runner.state
    after = quiet(8)
    after["rearm"][:] = before["rearm"][-1]
    after["control_beat"] = single(before["control_beat"][-1] + 1 + np.arange(8) // 4)
    tried = 0
    for what, state in flips(runner, prepared):
        runner.state = state
        y, _ = runner.run(after, trace=False)
        assert np.all(y["fault"] != 0), what
        assert np.all(y["u_Nm"] == 0), what
        assert np.all(y["fault"] == np.round(y["fault"])), what
        tried += 1
    assert tried == 13 * WIDTHS[real] + 8 * 32
    # Armed: the same run with a request does release.
    runner.state = prepared
    after["rearm"][2:] = (after["rearm"][0] + 1) % 8
    assert runner.run(after, trace=False)[0]["fault"][2] == 0


@pytest.mark.parametrize("real", EVERY)
def test_flipped_bits_while_running(runners, real):
    runner = runners[real]
    x = model.calm()
    model.ran(runner, {k: v[: model.AT] for k, v in x.items()})
    prepared = runner.state
    rest = {k: v[model.AT : model.AT + 6] for k, v in x.items()}
    clean = runner.run(rest, trace=False)[0]["u_Nm"]
    guarded = ("key", "fault_", "rearm_", "u_last", "u_mirror")
    for what, state in flips(runner, prepared):
        runner.state = state
        y, _ = runner.run(rest, trace=False)
        assert np.all(np.abs(y["u_Nm"]) <= model.SHIPPED.u), what
        if what.startswith(guarded):
            zero = state[what.split()[0]][0] == prepared[what.split()[0]][0]  # -0.0 is 0.0
            if zero:
                assert np.array_equal(y["u_Nm"], clean), what
            else:
                assert np.all(y["fault"] == Fault.STATE_CORRUPT), what
                assert y["status"][0] & model.BIT["STATE_REPAIRED"], what
                assert np.all(y["u_Nm"] == 0), what
        elif np.any(y["fault"]):
            assert np.all(y["u_Nm"][y["fault"] != 0] == 0), what
        else:
            assert np.array_equal(y["u_Nm"], clean), what


@pytest.mark.ci
@pytest.mark.parametrize("real", EVERY)
def test_memory_of_random_bytes_or_zeros_is_latched(runners, real):
    runner = runners[real]
    runner.reset()
    rng = np.random.default_rng(5)
    x = {k: v[20:26] for k, v in model.calm().items()}
    shape = runner.state
    for k in range(1500):
        raw = rng.bytes(shape.nbytes) if k else bytes(shape.nbytes)
        runner.state = np.frombuffer(raw, shape.dtype)
        y, s = runner.run(x)
        assert np.all(y["u_Nm"] == 0)
        assert np.all(y["fault"] == Fault.STATE_CORRUPT)
        assert np.all(s["key"] == 0)
        assert all(np.all(np.isfinite(v.astype(float))) for v in (*y.values(), *s.values()))


@pytest.mark.parametrize("real", EVERY)
def test_corrupt_state_is_a_fault_that_a_person_can_clear(runners, real):
    for port in (f.port for f in runners[real].state_fields):
        for bad in (np.nan, np.inf, -np.inf, 1e30):
            x = model.calm()
            model.recover(x, 140)
            runner = runners[real]
            assert model.ran(runner, {k: v[: model.AT] for k, v in x.items()})["fault"][-1] == 0
            runner.put_state({port.name: np.full(port.size, bad)})
            y, _ = runner.run({k: v[model.AT :] for k, v in x.items()})
            assert y["status"][0] & model.BIT["STATE_REPAIRED"]
            assert np.all(y["fault"][:42] == Fault.STATE_CORRUPT), port.name
            assert np.all(y["u_Nm"][:44] == 0)
            assert y["fault"][42] == 0
            assert abs(y["u_Nm"][44]) <= 0.05 + 1e-7


@pytest.mark.parametrize("real", EVERY)
def test_what_corrupt_memory_says_of_the_last_request_is_no_ground_for_an_edge(runners, real):
    # The memory says 0 where the request stands at 1, in a step whose own request cannot be read.
    runner = runners[real]
    before = quiet(12)
    before["rearm"][:] = 1
    model.ran(runner, before)
    runner.put_state({"rearm_last": 0.0})
    after = quiet(8)
    after["control_beat"] = single(before["control_beat"][-1] + 1 + np.arange(8) // 4)
    after["rearm"][:] = 1
    after["rearm"][0] = np.nan
    y, _ = runner.run(after, trace=False)
    assert np.all(y["fault"] == Fault.STATE_CORRUPT)
    assert not np.any(y["status"] & model.BIT["REARM_REFUSED"])


@pytest.mark.parametrize("real", EVERY)
def test_a_flipped_sign_gives_no_energy_credit(runners, real):
    runner = runners[real]
    x = model.calm(500)
    x["tau_Nm"][200:] = 7.5
    x["omega_load_rad_s"][200:] = 7.0
    model.ran(runner, {k: v[:400] for k, v in x.items()})
    (slots,) = (f.name for f in runner.state_fields if f.name == "slots_J")
    state = runner.state
    state[slots] = -state[slots]
    runner.state = state
    y, _ = runner.run({k: v[400:] for k, v in x.items()}, trace=False)
    assert np.flatnonzero(y["fault"] == Fault.ENERGY)[0] == 85  # the 286th period at 52.5 mJ


# -- tunables --------------------------------------------------------------------------------------


@pytest.mark.parametrize("real", EVERY)
def test_no_message_can_widen(drive, real):
    require_tool("gcc")
    task = compile_system(block_system(limits(drive)), real).task("run")
    for t in limits(drive).tunables:
        wide = t.low - 1e-3 if t.name == "rom_min_rad" else t.high + 1e-3
        for bad in (wide, np.nan, np.inf, -np.inf):
            assert task.prepare({"limits": {t.name: bad}}) != 0, (t.name, bad)


NARROW = [
    ({"tau_max_Nm": 2.0}, "tau_Nm", 2.001, Fault.TORQUE),
    ({"theta_max_rad": 0.1}, "theta_rad", 0.101, Fault.DEFLECTION),
    ({"omega_max_rad_s": 4.0}, "omega_load_rad_s", 4.001, Fault.SPEED),
    ({"rom_max_rad": 0.9}, "theta_load_rad", 1.101, Fault.RANGE_OF_MOTION),
    ({"rom_min_rad": 1.1}, "theta_load_rad", 0.899, Fault.RANGE_OF_MOTION),
]


@pytest.mark.parametrize("real", EVERY)
@pytest.mark.parametrize(("tunables", "name", "beyond", "fault"), NARROW)
def test_narrowed_limits_act(runners, real, tunables, name, beyond, fault):
    runner = runners[real]
    runner.prepare({})
    x = model.with_value(name, beyond)
    x["theta_motor_rad"] = single(x["theta_load_rad"] + 0.05)
    assert not np.any(model.ran(runner, x)["fault"][3:])
    runner.prepare(tunables)
    y, _ = runner.run(x)
    assert np.flatnonzero(y["fault"] == fault)[0] == model.AT
    runner.prepare({"u_max_Nm": 0.03, "u_rate_Nm_s": 10.0})
    y, _ = runner.run(model.calm())
    assert np.max(np.abs(y["u_Nm"])) == pytest.approx(0.03, abs=1e-9)
    assert np.max(np.abs(np.diff(y["u_Nm"]))) == pytest.approx(0.01, abs=1e-8)
    runner.prepare({})


@pytest.mark.parametrize("real", model.REALS)  # in q31 a Block's own prepare cuts to the ranges
def test_corrupt_or_reversed_tunables_latch(runners, real):
    runner = runners[real]
    for bad in ({"rom_min_rad": 2.0, "rom_max_rad": 1.0}, {"u_max_Nm": 0.5}, {"tau_max_Nm": np.nan},
                {"omega_max_rad_s": 100.0}, {"energy_max_J": 1e9}, {"rom_max_rad": 2.6},
                {"rom_min_rad": -0.3}, {"theta_max_rad": 0.34}, {"u_rate_Nm_s": np.nan},
                {"u_rate_Nm_s": 60.0}, {"tau_max_Nm": 0.0}):  # fmt: skip
        runner.prepare(bad)  # a Block's own prepare does not refuse: as if memory had changed
        y, _ = runner.run(model.calm())
        assert np.all(y["u_Nm"] == 0), bad
        assert np.all(y["fault"] == Fault.NOT_ARMED)
        assert np.all(y["status"] & model.BIT["TUNABLE_INVALID"])
    runner.prepare({})


# -- coefficients in memory ------------------------------------------------------------------------


def flipped(memory: Any) -> Iterator[int]:
    """Flips each single bit in turn, and puts it back."""
    view = np.frombuffer(memory, np.uint8)
    for bit in range(8 * len(view)):
        view[bit // 8] ^= 1 << bit % 8
        yield bit
        view[bit // 8] ^= 1 << bit % 8


class Memory:
    """The coefficients of a compiled Block, as they stand in memory."""

    def __init__(self, runner: CRunner) -> None:
        library = runner.library
        self.bytes = runner.coefficient_memory
        self.fields = {
            p.name: block_field(library.naming, runner.owner, "coeffs", p)
            for p in runner.owner.coefficients
        }
        kind = {"f64": "f8", "f32": "f4", "q31": "i4"}[library.real]
        self.numbers = np.frombuffer(self.bytes, kind)
        assert len(self.numbers) == len(self.fields)

    def put(self, name: str, value: float) -> float:
        """Put a number in; what the C then reads there, in its unit."""
        k = list(self.fields).index(name)
        with np.errstate(over="ignore"):
            self.numbers[k] = self.fields[name].encode(value)
        return self.value(name)

    def value(self, name: str) -> float:
        held = self.numbers[list(self.fields).index(name)]
        with np.errstate(invalid="ignore"):  # a flip can make a signalling NaN
            return float(self.fields[name].decode(held.astype(float)))

    def flips(self) -> Iterator[tuple[str, int]]:
        """Each single bit flipped in turn: the coefficient, the bit."""
        names, width = list(self.fields), 8 * self.numbers.itemsize
        for bit in flipped(self.bytes):
            yield names[bit // width], bit % width

    def valid(self) -> bool:
        """Whether all are inside their compiled ranges, and the range of motion is one."""
        inside = (f.port.low <= self.value(n) <= f.port.high for n, f in self.fields.items())
        return all(inside) and self.value("rom_min_rad") < self.value("rom_max_rad")


@pytest.mark.parametrize("real", EVERY)
def test_a_coefficient_outside_its_range_latches(runners, real):
    runner = runners[real]
    runner.prepare({})
    x = model.calm()
    runner.run({k: v[: model.AT] for k, v in x.items()})
    memory, state = Memory(runner), runner.state
    prepared = memory.numbers.copy()
    for name, f in memory.fields.items():
        span = f.port.high - f.port.low
        near = (f.port.low - 1e-4 * span, f.port.high + 1e-4 * span)
        for bad in (np.nan, np.inf, 1e6, -1e6, 0.0, *near):
            memory.put(name, bad)
            y, _ = runner.run({k: v[model.AT : model.AT + 3] for k, v in x.items()})
            assert np.all(np.abs(y["u_Nm"]) <= model.SHIPPED.u)
            if not f.port.low <= bad <= f.port.high:  # some angles may be 0
                assert np.all(y["u_Nm"] == 0), (name, bad)
                assert np.all(y["fault"] == Fault.TUNABLE_INVALID), (name, bad)
            runner.state = state
            memory.numbers[:] = prepared
    runner.prepare({})


FLIPS = {"f64": (832, 475), "f32": (416, 239), "q31": (416, 219)}


@pytest.mark.parametrize("real", EVERY)
def test_no_flipped_bit_of_a_coefficient_widens_a_limit_or_overflows(drive, real):
    """Full torque either way: how many of the flips latch, and what reaches the motor."""
    require_tool("gcc")
    system = block_system(limits(drive))
    runner = compile_system(system, real, (*UNDEFINED, "-fsanitize-recover=all")).block("limits")
    memory, steps = Memory(runner), 12
    found: dict[str, Any] = {"tried": 0, "latched": set(), "most": 0.0}
    with standard_error() as said:
        for sign in (1, -1):
            x = model.calm(model.AT + 2 * steps)
            x["u_command_Nm"][model.AT :] = single(sign * 0.8)  # 3.6 times the limit
            runner.reset()
            y, _ = runner.run({k: v[: model.AT + steps] for k, v in x.items()}, trace=False)
            assert y["u_Nm"][-1] == pytest.approx(sign * model.SHIPPED.u, abs=1e-9)
            state, rest = runner.state, {k: v[model.AT + steps :] for k, v in x.items()}
            rest["u_command_Nm"][steps // 2 :] *= -1
            for flip in memory.flips():
                runner.state = state
                y, _ = runner.run(rest, trace=False)
                found["tried"] += sign > 0
                found["most"] = max(found["most"], float(np.max(np.abs(y["u_Nm"]))))
                invalid = y["fault"] == Fault.TUNABLE_INVALID
                assert np.all(invalid) if not memory.valid() else not np.any(invalid), flip
                assert np.all(y["u_Nm"][y["fault"] != 0] == 0), flip
                if np.any(y["fault"]):
                    found["latched"].add(flip)
    assert (found["tried"], len(found["latched"])) == FLIPS[real]
    assert found["most"] == pytest.approx(model.SHIPPED.u, abs=1e-9)
    assert found["most"] <= model.SHIPPED.u
    assert [line for line in said if "runtime error" in line] == []


# Flips of the coefficients of the limits that latch, at full push one way and the other.
DRIVE_LATCHED = {"f32": (238, 238), "q31": (217, 217)}


@pytest.mark.ci
@pytest.mark.parametrize("real", ["f32", "q31"])
def test_no_flipped_bit_of_the_drives_coefficients_reaches_the_motor(drive, recorded, real):
    """Both tasks on encoder counts recorded in closed loop, eight ticks after each flip.

    The limits' own coefficients are seen at once, all others by the checksum in the next run of the
    control task, which is due 3 or 4 ticks later and released another one later.
    """
    require_tool("gcc")
    library = compile_device(drive, real, (*UNDEFINED, "-fsanitize-recover=all"))
    given, board = recorded, library.board(zeros_missing(drive.system))
    memory, coefficients = board.memory["state"], memoryview(board.memory["coeffs"])
    fields = library.dtype(f"{library.prefix}_coeffs_t").fields
    parts = {n: coefficients[at : at + kind.itemsize] for n, (kind, at) in fields.items()}

    def run(first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        rows = []
        for tick in range(first, last):
            board.release(tick)
            for task in drive.system.tasks:
                k, late = divmod(tick - task.phase, task.every)
                if late:
                    continue
                y = board.step(task.name, **{n: v[k] for n, v in given[task.name].items() if n})
                if "u_Nm" in y:
                    rows.append((float(y["u_Nm"]), int(y["fault"])))
        u, fault = zip(*rows, strict=True)
        return np.array(u), np.array(fault)

    most, tried, latched, tick = 0.0, 0, [], 0
    with standard_error() as said:
        for full, sign in ((131, 1), (867, -1)):
            run(tick, full)
            tick, state = full, bytes(memory)
            clean, fault = run(tick, tick + 8)
            assert np.max(sign * clean) > 0.16
            assert not np.any(fault)
            latched.append(0)
            for name, part in parts.items():
                for bit in flipped(part):
                    memory[:] = state
                    u, fault = run(tick, tick + 8)
                    assert np.all(u[fault != 0] == 0), (name, bit)
                    assert np.all(fault[5:] != 0), (name, bit)
                    most, tried = max(most, float(np.max(np.abs(u)))), tried + 1
                    latched[-1] += name == "limits" and bool(np.any(fault[:3]))
            memory[:] = state
    assert tried == 2 * 2272
    assert most <= model.SHIPPED.u
    assert tuple(latched) == DRIVE_LATCHED[real]
    assert [line for line in said if "runtime error" in line] == []
