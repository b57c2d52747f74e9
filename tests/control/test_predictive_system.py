"""Predictive control as a device asks for it: parabola, future, one layer, verification."""

from __future__ import annotations

import re

import numpy as np
import pytest

from esea_gen.control.laws.predictive import device_horizon
from esea_gen.control.predictive.ahead import ahead
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.emit.build import render_device
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.observe.extrapolation import parabola_weights
from esea_gen.studies.responses import StepStudy
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import compiled_loop, plant_variant, previews, run_case
from esea_gen.twin.trajectories import Trajectory
from esea_gen.verify.compare import compare_program, program_streams
from esea_gen.verify.equivalence import verify
from esea_gen.verify.gates import TARGETS, check_objects
from esea_gen.verify.runs import run_executor
from esea_gen.verify.verdict import Verification
from tests.conftest import require_tool
from tests.control.test_predictive_loop import rms
from tests.own_device import own_device
from tests.proof.sanitize import GivenRenderer

pytestmark = pytest.mark.ci

SHORT = {"intervals": 4, "interval_s": 0.02, "substeps": 2, "Q": 300.0, "R": 1.0}


@pytest.fixture(scope="module")
def small():
    """A short horizon: quick to compile and to run in Python."""
    return own_device(name="small", predictive=SHORT | {"future": "given"})


# -- the person's torque by the thesis' parabola ---------------------------------------------------


def test_the_parabola_is_the_least_squares_fit():
    past = np.random.default_rng(0).normal(size=11)  # newest first
    t = -0.05 * np.arange(11)
    wanted = np.polyfit(t, past, 2)[::-1]
    assert parabola_weights() @ past == pytest.approx(wanted, rel=1e-9)
    # At the next eleven values: the extrapolation's own matrix, from the normal equations.
    ahead_s = 0.05 * np.arange(1, 12)
    design = np.stack([np.ones(11), t, t**2], axis=1)
    future = np.stack([np.ones(11), ahead_s, ahead_s**2], axis=1)
    by_normal_equations = future @ np.linalg.solve(design.T @ design, design.T @ past)
    assert future @ (parabola_weights() @ past) == pytest.approx(by_normal_equations, rel=1e-9)


# -- what is wanted along the horizon --------------------------------------------------------------


def wanted(**more):
    base = {
        "mode": 1.0,
        "offset_Nm": 0.0,
        "keep": np.exp(-0.001 / 0.2),
        "tau_range_Nm": 3.0,
        "Kp_Nm_rad": 2.0,
        "Kd_Nms_rad": 0.25,
        "damping_Nms_rad": 0.0,
        "theta_load_rad": 0.4,
        "omega_load_rad_s": 0.0,
    }
    return base | more


# The rubber is its model.
AS_IT_IS = {"wish_gain": 1.0, "wish_shift_Nm": 0.0}


def test_a_known_future_starts_where_the_torque_is(small):
    simulator = ahead(small, Horizon(4, 0.02, 2, 0.002), given=True, one_layer=True).simulator()
    future = np.array([0.5, 0.6, 0.7, 0.8])
    out = simulator.step(
        **wanted(offset_Nm=-1.2, **AS_IT_IS),
        tau_preview_Nm=future,
        theta_preview_rad=np.full(4, 0.5),
        omega_preview_rad_s=np.zeros(4),
    )
    # The offset of a change of mode, as it will have faded by the end of each interval.
    ends = 0.002 + 0.02 * np.arange(1, 5)
    assert out["tau_d_Nm"] == pytest.approx(future - 1.2 * np.exp(-ends / 0.2), rel=1e-9)
    # No gains in torque mode, those of the law in impedance mode.
    assert (out["Kp_Nm_rad"], out["Kd_Nms_rad"]) == (0, 0)
    law = simulator.step(
        **wanted(mode=2.0, **AS_IT_IS),
        tau_preview_Nm=future,
        theta_preview_rad=np.full(4, 0.5),
        omega_preview_rad_s=np.zeros(4),
    )
    assert (law["Kp_Nm_rad"], law["Kd_Nms_rad"]) == (2.0, 0.25)
    assert law["theta_d_rad"] == pytest.approx(0.5)


def test_an_invalid_future_turns_it_off(small):
    block = small.system.blocks["ahead"]
    given_now = {p.name: np.zeros(p.size) if p.size > 1 else 0.5 for p in block.inputs}
    given_now |= {"mode": 1.0, "tau_range_Nm": 3.0} | AS_IT_IS
    assert block.simulator().step(**given_now)["mode"] == 1
    for bad in (np.nan, np.inf, 1e9):
        given_now["tau_preview_Nm"] = np.array([0, bad, 0, 0])
        out = block.simulator().step(**given_now)
        assert (out["mode"], out["status"]) == (0, 1)


def test_switching_on_is_bumpless_though_the_future_is_known(monkeypatch):
    # 2 Nm are wanted all along; switched on at 0.5 s, the torque rises as the offset fades, by the
    # reference's time constant of 0.2 s.
    monkeypatch.setattr("esea_gen.twin.run.ON_S", 0.5)
    n = 1500
    rest = np.zeros(n)
    path = Trajectory("on", rest, rest, rest, rest + 2.0, 1000, n, True)
    tau = run_case(Case("on", path), Setting("mpc", "real", "none"), 0).plant["tau_e_Nm"]
    assert abs(tau[500]) < 0.02
    for after_s in (0.2, 0.4, 0.8):
        wanted_Nm = 2.0 * (1 - np.exp(-after_s / 0.2))
        assert tau[500 + round(1000 * after_s)] == pytest.approx(wanted_Nm, abs=0.06)
    # A plan that knew of 2 Nm but not of the offset would be there within the horizon.
    assert tau[600] < 1.0


# -- impedance in one layer ------------------------------------------------------------------------


def held_torque(controller: str, kp: float, offset_rad: float) -> float:
    """Torque on a load that is held fast at 0 while another angle is wanted."""
    found = controller_device(controller)
    variant = plant_variant(found, "ideal", "none", 0)
    n = 3000
    t = np.arange(n) / 1000
    rest = np.zeros(n)
    path = StepStudy().cases()[0].trajectory
    signals = {
        **dict.fromkeys(("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2"), rest),
        **dict.fromkeys(("tau_desired_Nm", "omega_desired_rad_s", "stop"), rest),
        **dict.fromkeys(("frame_error_motor", "frame_error_load", "frame_error_gear"), rest),
        "theta_desired_rad": rest + offset_rad,
        "mode": np.where(t < 0.06, 0.0, 2.0),
        "rearm": (t >= 0.03) * 1.0,
    }
    ends = len(previews(path, device_horizon(found))["tau_preview_Nm"][0])
    signals |= {
        "tau_preview_Nm": np.zeros((n, ends)),
        "theta_preview_rad": np.full((n, ends), offset_rad),
        "omega_preview_rad_s": np.zeros((n, ends)),
    }
    loop = compiled_loop(found, variant.cable, "f32")
    run = loop.run(
        {k: v for k, v in signals.items() if k in loop.signals or "_p_" in k},
        variant.values,
        {"reference": {"Kp_Nm_rad": kp, "Kd_Nms_rad": 0.1}, "predictive": {"load_free": 0.0}},
    )
    assert run.controller["fault"][-1] == 0
    return float(np.mean(run.plant["tau_e_Nm"][-500:]))


@pytest.mark.parametrize(("kp", "offset_rad"), [(1.5, 0.8), (3.0, -0.5), (2.5, 0.5)])
def test_the_rendered_stiffness_is_the_one_asked_for(kp, offset_rad):
    # Closed form at rest: the torque on the load pulls towards the wanted angle.
    assert held_torque("mpc", kp, offset_rad) == pytest.approx(kp * offset_rad, abs=0.03)
    assert held_torque("mpc-no-preview", kp, offset_rad) == pytest.approx(kp * offset_rad, abs=0.03)


def test_a_stiffness_asks_for_no_more_than_the_torque_range():
    # 3 Nm/rad over 1.9 rad would be 5.7 Nm: held to the range, which two layers clip at too.
    reach = controller_device("mpc").tau_full_scale_Nm
    assert held_torque("mpc", 3.0, 1.9) == pytest.approx(reach, rel=0.05)


def test_one_layer_is_better_than_two(tmp_path):
    text = (controller_device("mpc").toml()).replace('"one_layer"', '"cascade"')
    assert 'impedance = "cascade"' in text
    two = tmp_path / "two_layers.toml"
    two.write_text(text.replace('name = "mpc"', 'name = "two_layers"'))
    # Medians over four seeds: 0.039 in one layer, 0.088 in two, 0.039 sliding mode.
    one = rms("impedance", "mpc", case=2)
    assert one < 0.05
    assert one < 0.6 * rms("impedance", str(two), case=2)
    # Transparent, both are the same law but for the damping that is added: a torque that holds in
    # two layers, a gain along the horizon in one.
    assert rms("impedance", "mpc") == pytest.approx(rms("impedance", str(two)), rel=0.25)


# -- as published ----------------------------------------------------------------------------------


def test_predictive_control_as_printed_stands_as_in_the_thesis():
    # Torque on a fixed output and impedance: MPC better; backdriven: sliding mode better.
    printed = controller_device("mpc-published")
    asked = printed.file.predictive
    assert (asked.intervals.value, asked.interval_s.value) == (10, 0.05)
    assert (asked.Q.value, asked.R.value, asked.person) == (35, 1, "parabola")
    assert printed.file.timing.control_rate_Hz.value == 20
    assert rms("tuning", "mpc-published") < 0.5 * rms("tuning", "smc-published")
    assert rms("backdriven", "mpc-published", case=3) > rms("backdriven", "smc-published", case=3)
    assert rms("impedance", "mpc-published", case=2) < rms("impedance", "smc-published", case=2)
    # Without preview it lags by most of the horizon; trials gave 0.6 to 0.7.
    assert 0.5 < rms("tuning", "mpc-published-no-preview") < 0.8


# -- the device file -------------------------------------------------------------------------------


def test_the_object_code_passes_the_gates_of_a_drive_with_a_program(small):
    require_tool("arm-none-eabi-gcc")
    report = check_objects(small, "cortex-m4f")
    assert report.passed, report.problems
    # Armed: a large local array in the program is too much.
    files = dict(render_device(small, ["f32"])[0].files)
    name = "esea_small_predictive.c"
    head = re.search(r"\nstatic void predictive_step\([^{]*{\n", files[name])
    head = head or re.search(r"\nvoid esea_small_predictive_step\([^{]*{\n", files[name])
    assert head
    waste = "    volatile float waste[256];\n    waste[0] = 0.0f;\n"
    files[name] = files[name][: head.end()] + waste + files[name][head.end() :]
    problems = check_objects(small, "cortex-m4f", files=files).problems
    assert any("above the limit" in p for p in problems)


# -- verification ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def executed(small):
    """The streams of the program, each with what the executor makes of it."""
    program = small.system.blocks["predictive"]
    return [(s, run_executor(program, s)) for s in program_streams(program, steps=30)]


def found_by(small, executed, real: str, files=None) -> Verification:
    program = small.system.blocks["predictive"]
    assert program.kind == "program"
    assert small.system.blocks["sensor"].kind == "block"
    library = (
        compile_device(small, real)
        if files is None
        else HostLibrary(small.system, GivenRenderer(small, real, files))
    )
    comparisons = [
        compare_program(small, program, library, s, expected) for s, expected in executed
    ]
    return Verification("small", "", comparisons, {}, {}, {})


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_a_program_is_verified_against_its_executor(small, executed, real):
    found = found_by(small, executed, real)
    assert found.passed, [c.problems for c in found.comparisons]
    assert len(found.comparisons) == 8
    if real == "f64":
        assert all(c.bit_identical for c in found.comparisons)
    else:
        assert max(c.errors["u_Nm"] for c in found.comparisons) > 0


@pytest.mark.parametrize(
    ("real", "pattern", "fault"),
    [
        # An input of the rollout, the plan, and the status word.
        ("f64", r"(state->u = .*);", "{0} + 1e-15;"),
        ("f32", r"(state->plan\[0\] = .*);", "{0} * 0.98f;"),
        ("f32", r"(out->status = )(.*);", "{0}0u * {1};"),
    ],
)
def test_a_deliberate_fault_is_found(small, executed, real, pattern, fault):
    files = dict(render_device(small, [real])[0].files)
    name = "esea_small_predictive.c"
    text = files[name]
    m = [x for x in re.finditer(pattern, text) if "= 0.0" not in x[0]][-1]
    files[name] = text[: m.start()] + fault.format(*m.groups()) + text[m.end() :]
    assert not found_by(small, executed, real, files).passed


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["mpc", "mpc-published"])
def test_the_shipped_controllers_pass_verification(controller):
    assert verify(controller_device(controller)).passed


@pytest.mark.parametrize("controller", ["mpc", "mpc-published"])
@pytest.mark.parametrize("target", TARGETS)
def test_the_shipped_controllers_pass_the_gates(controller, target):
    report = check_objects(controller_device(controller), target)
    assert report.passed, report.problems
