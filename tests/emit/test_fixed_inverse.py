"""Inverses in fixed point: roots by algebra, and the residual's bound."""

from __future__ import annotations

import dataclasses
import math
import re

import casadi as ca
import numpy as np
import pytest

import esea_gen
from esea_gen.emit.fixed.errors import Propagation, any_bound, step_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.spans import RangeError
from esea_gen.hostlib.library import block_system, compile_block, compile_system
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import published_inverse
from esea_gen.verify.fixed import compare_fixed
from esea_gen.verify.streams import streams

pytestmark = pytest.mark.ci

NOT_CONVERGED = 1 << 7


@pytest.fixture(scope="module")
def wrist():
    return esea_gen.load_device("wrist")


# -- facts -----------------------------------------------------------------------------------------


def test_what_algebra_knows_of_the_elbows_segment(elbow):
    """Its stiffest and softest segment, and the root of its largest load, from the file's numbers.

    Ten stops 0.0197 rad apart, of 10.3 Nm/rad falling by exp(-62.5 rad); the rate torque is kv
    times at most the whole deflection and a period's step of it.
    """
    facts = exact_inverse(elbow).facts
    r = 0.0197 * np.arange(1, 11)
    stops = 10.3 * np.exp(-62.5 * r)
    stiff = 9.39 + 51.6 + stops.sum()
    assert facts["linear_Nm_rad"] == pytest.approx((9.39, stiff), rel=2e-6)
    assert facts["tangent_Nm_rad"] == pytest.approx((9.39, stiff + 3 * 239 * 0.35**2), rel=2e-6)
    assert facts["set_point_rad"] == pytest.approx((-0.35, 0.35))
    load = 2 * 20 + 51.6 * (0.35 + 25 * 1e-3) + stops @ (0.35 + r)
    (root,) = (x.real for x in np.roots([239, 0, 9.39, -load]) if abs(x.imag) < 1e-9)
    assert facts["root_size_rad"] == pytest.approx((0, root), rel=1e-4)


@pytest.mark.parametrize("name", ["elbow", "knee"])
def test_no_fact_cuts_anything_that_can_be(name):
    """Every labelled value of the float64 step, from sound and from corrupt states alike."""
    device = esea_gen.load_device(name)
    for block in (device.inverse, published_inverse(device, "b")):
        rng = np.random.default_rng(3)
        coefficients = list(block.simulator().coefficients.values())
        names, checked = block.labelled_step.name_out(), 0
        count = 400
        sizes = [p.size for p in (*block.state, *block.inputs)]
        columns = []
        for p, size in zip((*block.state, *block.inputs), sizes, strict=True):
            wild = rng.uniform(-1, 1, (size, count)) * 10.0 ** rng.uniform(-6, 1, (1, count))
            columns.append(wild * max(abs(p.low), abs(p.high)))
        columns[[p.name for p in block.state].index("play_rad")][:, : count // 2] = columns[
            [p.name for p in block.state].index("theta_prev_rad")
        ][:, : count // 2]
        if "primed" in [p.name for p in block.state]:
            columns[[p.name for p in block.state].index("primed")][:] = 1.0
        tiled = [np.tile(np.reshape(c, (-1, 1)), (1, count)) for c in coefficients]
        mapped = block.labelled_step.map(count).call([ca.DM(a) for a in (*tiled, *columns)])
        found = dict(zip(names, mapped, strict=True))
        for label, (low, high) in block.facts.items():
            values = np.asarray(found[f"label_{label}"]).ravel()
            room = 1e-12 * max(abs(low), abs(high))
            assert np.all((values >= low - room) & (values <= high + room)), (block.name, label)
            checked += np.ptp(values) > 0
        assert checked >= len(block.facts) - 1


# -- the residual ----------------------------------------------------------------------------------


def test_the_torque_rises_by_the_slope_that_is_promised(elbow):
    """Any set-point beside the exact one leaves a residual of at least k1 times the distance."""
    solved = elbow.inverse.solved["set_point_rad"]
    sensor = elbow.sensor.labelled_step
    rng = np.random.default_rng(11)
    assert solved.slope == elbow.file.elastomer.k1_Nm_rad.value
    for _ in range(200):
        theta = rng.uniform(-0.3, 0.3)
        state = {
            "s_primed": 1.0,
            "s_theta_prev_rad": theta + rng.uniform(-0.01, 0.01),
            "s_tau_r_Nm": rng.uniform(-2, 2),
            "s_play_rad": theta + np.cumsum(rng.uniform(-0.0197, 0.0197, 10)),
        }
        omega, move = rng.uniform(-20, 20), 10.0 ** rng.uniform(-5, -2)
        torque = [
            float(sensor(**state, u_theta_rad=x, u_omega_rad_s=omega)["label_tau_Nm"])
            for x in (theta, theta + move)
        ]
        assert torque[1] - torque[0] >= solved.slope * move * (1 - 1e-9)


def test_a_set_point_off_the_exact_one_is_flagged(elbow):
    """The promise can fail to hold, and then shows: a wrong root, and the step says so."""
    block = elbow.inverse
    system = block_system(block)
    library = compile_system(system, "q31")
    t = np.arange(400) * elbow.period_s
    torque = 3.0 * np.sin(2 * np.pi * t)
    honest, _ = library.task("run").run({"tau_Nm": torque}, trace=False)
    assert not np.any(honest["status"] & NOT_CONVERGED)
    # The same program with a set-point that is off by 0.1 mrad and more.
    files = dict(library.files)
    (source,) = [n for n in files if n.endswith("_inverse.c")]
    (name, fraction) = re.search(r"int32_t (refined_q(\d+)) = ", files[source]).groups()
    off = round(1e-4 * 2 ** int(fraction))
    head, tail = files[source].split(f"{name} = ", 1)
    files[source] = f"{head}{name} = {off} + {tail}"
    lost, _ = _recompiled(system, files).task("run").run({"tau_Nm": torque}, trace=False)
    apart = np.abs(lost["theta_rad"] - honest["theta_rad"])
    bound = any_bound(plan_block(block)).outputs["theta_rad"]
    assert np.max(apart) > bound
    assert np.all(lost["status"][1:][apart[1:] > bound] & NOT_CONVERGED)


def _recompiled(system, files):
    from esea_gen.emit.formats import FORMATS
    from esea_gen.emit.render import Renderer
    from esea_gen.hostlib.library import HostLibrary

    renderer = Renderer(system, FORMATS["q31"], "-", "-", system.name)
    renderer.files = lambda: files
    return HostLibrary(system, renderer)


def test_what_leads_to_a_solved_value_does_not_count(elbow):
    plan = plan_block(elbow.inverse)
    step = Propagation(plan, {}, {})
    node = {name: i for i, (name, _) in plan.labels.items()}
    assert node["root_c_rad"] not in step.followed
    assert {node["set_point_rad"], node["residual_Nm"], node["omega_mid_rad_s"]} <= step.followed
    bound = any_bound(plan)
    assert bound.steps == 1
    # The residual allowed over the least slope is a floor of what is promised.
    assert bound.outputs["theta_rad"] > 1e-4 / 9.39
    assert bound.outputs["theta_rad"] < 2e-4 * 0.35
    assert any("residual_Nm" in a for a in bound.assumptions)


def test_the_way_is_widened_where_its_residual_would_be_large(wrist):
    """The knee's stiffness leaves 32 bits too coarse on the way; the elbow's does not."""
    knee = esea_gen.load_device("knee")
    block = knee.inverse
    plan = plan_block(block)
    followed = Propagation(plan, {}, {}).followed
    assert len(plan.wide - followed) > 100
    assert any("residual would fill" in why for why in plan.why_wide.values())
    assert not plan_block(wrist.inverse).wide - followed
    torque = 0.5 * knee.tau_full_scale_Nm * np.sin(0.01 * np.arange(2000))
    system = block_system(block)
    got, _ = compile_system(system, "q31").task("run").run({"tau_Nm": torque}, trace=False)
    exact, _ = compile_system(system, "f64").task("run").run({"tau_Nm": torque}, trace=False)
    assert not np.any(got["status"] & NOT_CONVERGED)
    assert np.max(np.abs(got["theta_rad"] - exact["theta_rad"])) < 1e-7
    narrow = Planner(block).plan({i: w for i, w in plan.why_wide.items() if i in followed})
    assert narrow.wide < plan.wide


@pytest.mark.parametrize("kind", ["exact", "b", "plays"])
def test_inverses_bit_for_bit_and_inside_their_bound(wrist, kind):
    block = (
        wrist.inverse
        if kind == "exact"
        else published_inverse(wrist, None if kind == "plays" else kind)
    )
    plan = plan_block(block)
    runner = compile_block(block, "q31")
    bound = any_bound(plan)
    for stream in streams(block, steps=120):
        found = compare_fixed(wrist, plan, runner, stream, bound)
        assert found.passed, (stream.name, found.problems)
        assert found.turned <= 1


# -- the analysis ----------------------------------------------------------------------------------


def test_cutting_a_labelled_value_tightens_its_bound(wrist):
    """The rate that feeds the viscosity, from a power of it with an infinite slope at zero."""
    plan = plan_block(wrist.inverse)
    block = plan.block
    own = {k: v for k, v in block.split.items() if k != "omega_mid_rad_s"}
    uncut = dataclasses.replace(plan, block=dataclasses.replace(block, split=own))
    bounds = []
    for p in (plan, uncut):
        try:
            bounds.append(step_bound(p).outputs["tau_model_Nm"])
        except RangeError:
            bounds.append(math.inf)
    assert bounds[0] < 0.5 * bounds[1]
