"""The emitted C, through cffi, against the symbolic Block."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from esea_gen.device import load_device
from esea_gen.devices.file import shipped_devices
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.language.block import Block
from esea_gen.language.stream import SPECIAL, Stream
from esea_gen.verify.compare import compare
from esea_gen.verify.equivalence import verify
from esea_gen.verify.runs import CasadiOracle, run_c, run_symbolic
from esea_gen.verify.streams import domain_chirp, recorded_stream, streams


@pytest.fixture(scope="module")
def verified(elbow):
    wave = 0.15 * np.sin(np.arange(3000) * 2e-3)
    return verify(elbow, recorded={"a recording": wave})


def test_everything_agrees(verified):
    assert verified.passed, [c for c in verified.comparisons if not c.passed]
    tried = {c.stream for c in verified.comparisons}
    assert {"thresholds", "jumps", "invalid inputs", "corrupt states", "a recording"} <= tried


def test_f64_is_casadis_own_c_bit_for_bit(verified):
    double = [c for c in verified.comparisons if c.real == "f64"]
    assert len(double) == 30
    assert all(c.bit_identical for c in double)
    for c in double:
        for name, error in c.errors.items():
            assert error <= 1e-12 * verified.full_scale[name]


def test_f32_stays_within_the_derived_bound(verified):
    f32 = [c for c in verified.comparisons if c.real == "f32"]
    for c in f32:
        for name, error in c.errors.items():
            assert error <= c.limits[name], (c.block, c.stream, name)
    # The tighter bound, of the identified domain, is used where the stream stays there.
    inside = {c.limits["tau_Nm"] for c in f32 if c.block == "sensor"}
    assert len(inside) == 2
    assert min(inside) < 0.0005 * verified.full_scale["tau_Nm"]


def changed(elbow, real: str, old: str, new: str) -> HostLibrary:
    """The device's C with one place changed: a mutant."""
    renderer = Renderer(elbow.system, FORMATS[real], "-", "-", elbow.title)
    files = renderer.files()
    name = "esea_elbow_sensor.c"
    assert files[name].count(old) >= 1, old
    files[name] = files[name].replace(old, new, 1)
    renderer.files = lambda: files  # type: ignore[method-assign]
    return HostLibrary(elbow.system, renderer)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("real", "old", "new"),
    [
        ("f64", "9.39", "9.390000000000002"),  # the last bit of one constant
        ("f64", "tau_s_Nm + tau_r_Nm", "tau_s_Nm - tau_r_Nm"),
        ("f64", "theta_rad <= 0.3499999940395355", "theta_rad < 0.3499999940395355"),
        ("f32", "9.39f", "9.4f"),
        ("f32", "esea_fmax(", "esea_fmin("),
        ("f32", "state->play_rad[9] = play_10_rad", "state->play_rad[9] = play_9_rad"),
        ("f32", "theta_rad_ok && omega_rad_s_ok", "theta_rad_ok || omega_rad_s_ok"),
    ],
)
def test_the_comparison_sees_a_fault(elbow, verified, real, old, new):
    library = changed(elbow, real, old, new)
    bounds = verified.bounds["sensor"]
    oracle = CasadiOracle(elbow.system) if real == "f64" else None
    tried = streams(elbow.sensor)
    tried.append(recorded_stream(elbow, domain_chirp(elbow, 2.0))["sensor"])
    results = [compare(elbow, elbow.sensor, library, s, bounds, oracle) for s in tried]
    assert not all(r.passed for r in results)


loaded = cache(load_device)
TRIED: dict[tuple[str, ...], str] = {}
EXPECTED: dict[tuple[str, str, str, int], np.ndarray] = {}


def written(block: Block) -> tuple[str, ...]:
    """A Block's functions in full."""
    return tuple(f.serialize() for f in (block.prepare, block.init, block.step))


@pytest.mark.ci
@pytest.mark.parametrize("real", ["f64", "f32"])
@pytest.mark.parametrize("name", sorted(shipped_devices()))
def test_nan_and_infinity_into_every_input_and_state(name, real):
    device = loaded(name)
    # A Program's own tests do the same: what of its state carries nothing is not looked at.
    blocks = [b for b in device.system.kinds if b.kind == "block"]
    # Devices have Blocks in common, to the last number: each is tried in the first that has it.
    blocks = [b for b in blocks if TRIED.setdefault((real, *written(b)), name) == name]
    library = compile_device(device, real) if blocks else None
    for block, value in product(blocks, SPECIAL):
        runner = library.block(block.name)
        quiet = {p.name: np.full((6, p.size) if p.size > 1 else 6, 0.01) for p in block.inputs}
        cases = []
        for p in block.inputs:
            hit = {k: v.copy() for k, v in quiet.items()}
            hit[p.name][3] = value
            cases.append((Stream("input", hit), block.status_port.flags[0].name))
        for p in block.state:
            for element in range(p.size):
                state = np.full(p.size, float(p.init))
                state[element] = value
                cases.append((Stream("state", quiet, {3: {p.name: state}}), "STATE_REPAIRED"))
        names = [f.name for f in block.status_port.flags]
        for k, (stream, flag) in enumerate(cases):
            runner.reset()
            y, s = run_c(runner, stream)
            said = EXPECTED.get((name, block.name, repr(value), k))
            if said is None:  # the symbols know no number format
                said = run_symbolic(block, stream)[0]["status"].astype(np.uint32)
                EXPECTED[name, block.name, repr(value), k] = said
            for a in (*y.values(), *s.values()):
                assert np.all(np.isfinite(a))
            assert int(y["status"][3]) >> names.index(flag) & 1
            assert np.array_equal(y["status"], said)
            # The counter in the state saw the same steps.
            counted = runner.state[f"n_{flag.lower()}"][0]
            assert counted == np.sum(y["status"].astype(int) >> names.index(flag) & 1)


@settings(max_examples=30)
@given(
    arrays(np.float32, 40, elements=st.floats(-0.5, 0.5, width=32) | st.just(np.nan)),
    arrays(np.float32, 40, elements=st.floats(-30, 30, width=32) | st.just(np.inf)),
)
def test_any_stream_gives_the_same_bits_in_f64(elbow, elbow_f64, theta, omega):
    stream = Stream("any", {"theta_rad": theta.astype(float), "omega_rad_s": omega.astype(float)})
    expected, states = run_symbolic(elbow.sensor, stream)
    got, got_states = run_c(elbow_f64.block("sensor"), stream)
    for name, value in got.items():
        assert value.astype(float).tobytes() == expected[name].tobytes()
    for name, value in states.items():
        assert got_states[name].astype(float).tobytes() == value.tobytes()


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_task_is_its_blocks_wired(elbow, elbow_f64, elbow_f32, real):
    library = elbow_f64 if real == "f64" else elbow_f32
    theta = domain_chirp(elbow, 2.0)
    got, _ = library.task("sense").run({"theta_rad": theta})
    rates, _ = library.block("velocity").run({"theta_rad": theta})
    given = {"theta_rad": theta, "omega_rad_s": rates["omega_mid_rad_s"]}
    smooth, _ = library.block("smoothing").run(given)
    torque, _ = library.block("sensor").run(given | {"theta_rad": smooth["theta_smooth_rad"]})
    assert got["tau_Nm"].tobytes() == torque["tau_Nm"].tobytes()
    assert got["sensor_status"].tobytes() == torque["status"].tobytes()
    if real == "f64":
        simulator = elbow.system.simulator()
        expected = [simulator.step("sense", theta_rad=x)["tau_Nm"] for x in theta]
        assert np.array_equal(got["tau_Nm"], expected)


def test_tunables_are_checked_and_work(elbow, elbow_f64):
    task = elbow_f64.task("sense")
    assert task.prepare({"velocity": {"bandwidth_Hz": 500.0}}) == 1
    assert task.prepare({"velocity": {"bandwidth_Hz": np.nan}}) == 1
    assert task.prepare({"velocity": {"bandwidth_Hz": 40.0}}) == 0
    theta = domain_chirp(elbow, 1.0)
    got, _ = task.run({"theta_rad": theta})
    simulator = elbow.system.simulator({"velocity": {"bandwidth_Hz": 40.0}})
    expected = [simulator.step("sense", theta_rad=x)["omega_rad_s"] for x in theta]
    assert got["omega_rad_s"] == pytest.approx(expected, abs=1e-12)


def test_bounds_exist_for_every_block(elbow, verified):
    assert verified.bounds.keys() == {b.name for b in elbow.system.kinds}
    for bounds in verified.bounds.values():
        narrow, wide = bounds["identified domain"], bounds["port ranges"]
        for name, value in wide.outputs.items():
            assert 0 < value < np.inf or name == "status"
            assert narrow.outputs[name] <= 1.5 * value
