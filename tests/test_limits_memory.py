"""Limits before the motor: corrupt memory never ends the latch, and tunables never widen."""

from __future__ import annotations

import numpy as np
import pytest

import esea_gen
from esea_gen.control.faults import Fault
from esea_gen.control.latch import RELEASED_KEY
from esea_gen.control.limits import limits
from esea_gen.device import Device
from esea_gen.hostlib.library import compile_system
from esea_gen.hostlib.runner import CRunner
from esea_gen.language.stream import single

from .conftest import require_tool
from .limits_model import (
    AT,
    BIT,
    REALS,
    SHIPPED,
    alone,
    calm,
    compiled,
    ran,
    recover,
    with_value,
)


@pytest.fixture(scope="module")
def drive() -> Device:
    return esea_gen.load_device("elbow_drive")


@pytest.fixture(scope="module")
def runners(drive) -> dict[str, CRunner]:
    return {real: compiled(drive, real) for real in REALS}


# -- corrupt memory --------------------------------------------------------------------------------


def quiet(steps: int) -> dict[str, np.ndarray]:
    """Off, nothing commanded, no cause left: only a request is missing."""
    x = {k: v[:steps].copy() for k, v in calm().items()}
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


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("since_start", [True, False])
def test_no_flipped_bit_ends_the_latch(runners, real, since_start):
    runner = runners[real]
    before = quiet(12) if since_start else with_value("tau_Nm", 9.0)
    y = ran(runner, before)
    assert y["fault"][-1] == (Fault.NOT_ARMED if since_start else Fault.TORQUE)
    prepared = runner.state
    after = quiet(8)
    after["rearm"][:] = before["rearm"][-1]
    beats = before["control_beat"][-1] + 1 + np.arange(8) // 4
    after["control_beat"] = single(beats)
    tried = 0
    for what, state in flips(runner, prepared):
        runner.state = state
        y, _ = runner.run(after, trace=False)
        assert np.all(y["fault"] != 0), what
        assert np.all(y["u_Nm"] == 0), what
        assert np.all(y["fault"] == np.round(y["fault"])), what
        tried += 1
    assert tried > 21 * (32 if real == "f32" else 64) - 1
    # Armed: the same run with a request does release.
    runner.state = prepared
    after["rearm"][2:] = (after["rearm"][0] + 1) % 8
    assert runner.run(after, trace=False)[0]["fault"][2] == 0


@pytest.mark.parametrize("real", REALS)
def test_flipped_bits_while_running(runners, real):
    runner = runners[real]
    x = calm()
    ran(runner, {k: v[:AT] for k, v in x.items()})
    prepared = runner.state
    rest = {k: v[AT : AT + 6] for k, v in x.items()}
    clean = runner.run(rest, trace=False)[0]["u_Nm"]
    guarded = ("key", "fault_", "rearm_", "u_last", "u_mirror")
    for what, state in flips(runner, prepared):
        runner.state = state
        y, _ = runner.run(rest, trace=False)
        assert np.all(np.abs(y["u_Nm"]) <= SHIPPED.u), what
        if what.startswith(guarded):
            zero = state[what.split()[0]][0] == prepared[what.split()[0]][0]  # -0.0 is 0.0
            if zero:
                assert np.array_equal(y["u_Nm"], clean), what
            else:
                assert np.all(y["fault"] == Fault.STATE_CORRUPT), what
                assert y["status"][0] & BIT["STATE_REPAIRED"], what
                assert np.all(y["u_Nm"] == 0), what
        elif np.any(y["fault"]):
            assert np.all(y["u_Nm"][y["fault"] != 0] == 0), what
        else:
            assert np.array_equal(y["u_Nm"], clean), what


@pytest.mark.parametrize("real", REALS)
def test_memory_of_random_bytes_or_zeros_is_latched(runners, real):
    runner = runners[real]
    runner.reset()
    rng = np.random.default_rng(5)
    x = {k: v[20:26] for k, v in calm().items()}
    shape = runner.state
    for k in range(1500):
        raw = rng.bytes(shape.nbytes) if k else bytes(shape.nbytes)
        runner.state = np.frombuffer(raw, shape.dtype)
        y, s = runner.run(x)
        assert np.all(y["u_Nm"] == 0)
        assert np.all(y["fault"] == Fault.STATE_CORRUPT)
        assert np.all(s["key"] == 0)
        assert all(np.all(np.isfinite(v.astype(float))) for v in (*y.values(), *s.values()))


@pytest.mark.parametrize("real", REALS)
def test_corrupt_state_is_a_fault_that_a_person_can_clear(runners, real):
    for port in (f.port for f in runners[real].state_fields):
        for bad in (np.nan, np.inf, -np.inf, 1e30):
            x = calm()
            recover(x, 140)
            runner = runners[real]
            head = ran(runner, {k: v[:AT] for k, v in x.items()})
            assert head["fault"][-1] == 0
            state = runner.state
            state[port.name] = bad
            runner.state = state
            y, _ = runner.run({k: v[AT:] for k, v in x.items()})
            assert y["status"][0] & BIT["STATE_REPAIRED"]
            assert np.all(y["fault"][:42] == Fault.STATE_CORRUPT), port.name
            assert np.all(y["u_Nm"][:44] == 0)
            assert y["fault"][42] == 0
            assert abs(y["u_Nm"][44]) <= 0.05 + 1e-7


@pytest.mark.parametrize("real", REALS)
def test_what_corrupt_memory_says_of_the_last_request_is_no_ground_for_an_edge(runners, real):
    # The memory says 0 where the request stands at 1, in a step whose own request cannot be read.
    runner = runners[real]
    before = quiet(12)
    before["rearm"][:] = 1
    ran(runner, before)
    state = runner.state
    state["rearm_last"] = 0.0
    runner.state = state
    after = quiet(8)
    after["control_beat"] = single(before["control_beat"][-1] + 1 + np.arange(8) // 4)
    after["rearm"][:] = 1
    after["rearm"][0] = np.nan
    y, _ = runner.run(after, trace=False)
    assert np.all(y["fault"] == Fault.STATE_CORRUPT)
    assert not np.any(y["status"] & BIT["REARM_REFUSED"])


@pytest.mark.parametrize("real", REALS)
def test_a_flipped_sign_gives_no_energy_credit(runners, real):
    runner = runners[real]
    x = calm(500)
    x["tau_Nm"][200:] = 7.5
    x["omega_load_rad_s"][200:] = 7.0
    ran(runner, {k: v[:400] for k, v in x.items()})
    state = runner.state
    state["slots_J"] = -state["slots_J"]
    runner.state = state
    y, _ = runner.run({k: v[400:] for k, v in x.items()}, trace=False)
    assert np.flatnonzero(y["fault"] == Fault.ENERGY)[0] == 85  # the 286th period at 52.5 mJ


def test_the_key_is_far_from_latched():
    for kind, bits in ((np.float32, np.uint32), (np.float64, np.uint64)):
        assert bin(int(np.array(RELEASED_KEY, kind).view(bits))).count("1") == 16


# -- tunables --------------------------------------------------------------------------------------


def test_tunables_only_narrow(drive):
    block = limits(drive)
    assert {t.name for t in block.tunables} == {
        "u_max_Nm", "u_rate_Nm_s", "tau_max_Nm", "theta_max_rad", "rom_min_rad", "rom_max_rad",
        "omega_max_rad_s", "energy_max_J",
    }  # fmt: skip
    safety = drive.file.safety
    for t in block.tunables:
        most = getattr(safety, "energy_J" if t.name == "energy_max_J" else t.name).value
        assert t.default == pytest.approx(most, rel=1e-6)
        assert t.default == (t.low if t.name == "rom_min_rad" else t.high)
        assert (t.low >= most) if t.name == "rom_min_rad" else (t.high <= most)
    with pytest.raises(ValueError, match="outside"):
        block.simulator({"u_max_Nm": 0.222})


@pytest.mark.parametrize("real", REALS)
def test_no_message_can_widen(drive, real):
    require_tool("gcc")
    task = compile_system(alone(drive, limits(drive)), real).task("run")
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


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(("tunables", "name", "beyond", "fault"), NARROW)
def test_narrowed_limits_act(runners, real, tunables, name, beyond, fault):
    runner = runners[real]
    runner.prepare({})
    x = with_value(name, beyond)
    x["theta_motor_rad"] = single(x["theta_load_rad"] + 0.05)
    assert not np.any(ran(runner, x)["fault"][3:])
    runner.prepare(tunables)
    y, _ = runner.run(x)
    assert np.flatnonzero(y["fault"] == fault)[0] == AT
    runner.prepare({"u_max_Nm": 0.03, "u_rate_Nm_s": 10.0})
    y, _ = runner.run(calm())
    assert np.max(np.abs(y["u_Nm"])) == np.float32(0.03) or np.max(y["u_Nm"]) == 0.03
    assert np.max(np.abs(np.diff(y["u_Nm"]))) == pytest.approx(0.01, abs=1e-8)
    runner.prepare({})


@pytest.mark.parametrize("real", REALS)
def test_corrupt_or_reversed_tunables_latch(drive, runners, real):
    runner = runners[real]
    for bad in ({"rom_min_rad": 2.0, "rom_max_rad": 1.0}, {"u_max_Nm": 0.5}, {"tau_max_Nm": np.nan},
                {"omega_max_rad_s": 100.0}, {"energy_max_J": 1e9}, {"rom_max_rad": 2.6},
                {"rom_min_rad": -0.3}, {"theta_max_rad": 0.34}, {"u_rate_Nm_s": np.nan},
                {"u_rate_Nm_s": 60.0}, {"tau_max_Nm": 0.0}):  # fmt: skip
        runner.prepare(bad)  # a Block's own prepare does not refuse: as if memory had changed
        y, _ = runner.run(calm())
        assert np.all(y["u_Nm"] == 0), bad
        assert np.all(y["fault"] == Fault.NOT_ARMED)
        assert np.all(y["status"] & BIT["TUNABLE_INVALID"])
    # While running.
    runner.prepare({})
    x = calm()
    runner.run({k: v[:AT] for k, v in x.items()})
    memory = np.frombuffer(runner.library.ffi.buffer(runner._coeffs[0]), runner._state_type["key"])
    ports = limits(drive).coefficients
    assert len(memory) == len(ports)
    for k, port in enumerate(ports):
        saved, state = memory[k], runner.state
        for bad in (np.nan, np.inf, 1e6, -1e6, 0.0):
            memory[k] = bad
            y, _ = runner.run({k: v[AT : AT + 3] for k, v in x.items()})
            assert np.all(np.abs(y["u_Nm"]) <= SHIPPED.u)
            if not port.low <= bad <= port.high:  # some angles may be 0
                assert np.all(y["u_Nm"] == 0), (port.name, bad)
                assert np.all(y["fault"] == Fault.TUNABLE_INVALID), (port.name, bad)
            runner.state = state
        memory[k] = saved
