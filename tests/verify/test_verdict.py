"""What a verification is judged by and says: full scales, ranges, and sums over comparisons."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.emit.step_errors import Bound
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port
from esea_gen.language.stream import Stream
from esea_gen.verify.bounds import (
    forward_residual,
    full_scales,
    residual_flag,
)
from esea_gen.verify.runs import run_symbolic
from esea_gen.verify.verdict import LASTING, Comparison, Verification

NOT_CONVERGED = Flag("NOT_CONVERGED", "too far", compares=("residual_Nm",), threshold=0.01)
CLAMPED, INVALID = Flag("REQUEST_CLAMPED", "too much"), Flag("INPUT_INVALID", "no number")


def valued(**values: float) -> SimpleNamespace:
    return SimpleNamespace(**{k: SimpleNamespace(value=v) for k, v in values.items()})


def device(u_max_Nm: float | None = None) -> SimpleNamespace:
    actuator = None if u_max_Nm is None else valued(u_max_Nm=u_max_Nm)
    domain = valued(theta_max_rad=0.25, omega_max_rad_s=2.5)
    file = SimpleNamespace(actuator=actuator, domain=domain)
    return SimpleNamespace(file=file, tau_full_scale_Nm=4.0)


def inverse(inputs=None, flags=(INVALID, CLAMPED, NOT_CONVERGED), residual="residual_Nm") -> Block:
    """Looks like an inverse: a torque turned into a deflection and its rate."""
    return Block.define(
        *("inverse", "made up"),
        period_s=1e-3,
        state=(Port("tau_r_Nm", -7, 9, "memory"), Port("theta_prev_rad", -1, 1, "memory")),
        inputs=inputs or (Port("tau_Nm", -9, 9, "wanted"),),
        outputs=(
            Port("theta_rad", -0.5, 0.75, "angle"),
            Port("omega_mid_rad_s", -8, 8, "rate"),
            Port(residual, -3, 3, "missed"),
            Port("u_motor_Nm", -6, 6, "at the motor"),
            Port("status", 0, 7, "status", flags=flags),
        ),
        step=lambda c, s, u, guard, label: (
            vars(s),
            {"theta_rad": 0, "omega_mid_rad_s": 0, residual: 0, "u_motor_Nm": 0, "status": 0},
        ),
    )


def test_what_counts_as_all_of_it():
    expected = {
        "theta_rad": 0.75,
        "omega_mid_rad_s": 8.0,
        "residual_Nm": 3.0,
        "u_motor_Nm": 4.0,
        "tau_r_Nm": 4.0,
        "theta_prev_rad": 1.0,
    }
    assert full_scales(device(), inverse()) == expected
    # Of a torque at the motor the motor's largest, where that is less.
    assert full_scales(device(0.5), inverse()) == expected | {"u_motor_Nm": 0.5}
    assert full_scales(device(5.0), inverse()) == expected


def test_a_block_is_judged_by_its_residual_where_it_is_an_inverse():
    assert residual_flag(inverse()) == NOT_CONVERGED
    other = Flag("NOT_CONVERGED", "too far", compares=("residual_Nm", "theta_rad"))
    for block in (
        inverse((Port("tau_Nm", -9, 9, "wanted"), Port("more", 0, 1, "more"))),
        inverse((Port("tau_other_Nm", -9, 9, "wanted"),)),
        inverse(flags=(INVALID, CLAMPED)),
        inverse(flags=(INVALID, CLAMPED, other)),
        inverse(residual="missed_Nm"),
    ):
        assert residual_flag(block) is None


def test_the_residual_said_and_computed(elbow):
    # Set-points of a slow swing; what the sensor makes of them is what was wanted, less an error.
    t = np.arange(60) * 1e-3
    theta, omega = 0.05 * np.sin(9 * t), 0.45 * np.cos(9 * t)
    word = np.zeros(60, np.uint32)
    word[:5], word[40] = 1, 2  # no number at first; out of reach once
    sensor = Stream("sensor", {"theta_rad": theta[5:], "omega_rad_s": omega[5:]})
    tau = run_symbolic(elbow.sensor, sensor)[0]["tau_Nm"]
    wanted = np.concatenate([np.full(5, 8.0), tau])
    wanted[40] += 5.0
    wanted[30] -= 0.25
    said = np.full(60, 0.01)
    said[:5] = said[40] = 9.0
    said[20] = -0.125
    outputs = {
        "theta_rad": theta,
        "omega_mid_rad_s": omega,
        "residual_Nm": said,
        "status": word,
    }
    stream = Stream("asked", {"tau_Nm": wanted})
    assert forward_residual(elbow, inverse(), stream, outputs) == (0.125, pytest.approx(0.25))
    put = Stream("asked", {"tau_Nm": wanted}, {3: {"tau_r_Nm": np.zeros(1)}})
    assert forward_residual(elbow, inverse(), put, outputs) == (0.125, 0.0)
    none = outputs | {"status": np.ones(60, np.uint32)}
    assert forward_residual(elbow, inverse(), stream, none) == (0.0, 0.0)


def comparison(block: str, real: str, errors: dict, **more) -> Comparison:
    return Comparison(block, "walk", real, 10, errors, {"y": 1.0}, **more)


@pytest.mark.parametrize(
    ("more", "passed"),
    [
        ({"bit_identical": True}, True),
        ({"bit_identical": False}, False),
        ({"status_differences": 1}, False),
        ({"problems": ["wrong"]}, False),
        ({"turned": 3, "beyond": 2, "drift": {"y": 9.0}}, True),
    ],
)
def test_one_comparison_and_all_of_them(more, passed):
    both = [comparison("a", "f64", {}), comparison("a", "f32", {}, **more)]
    told = Verification("d", "-", both, {}, {}).to_dict()
    assert [c["passed"] for c in told["comparisons"]] == [True, passed]
    assert told["passed"] == passed


def test_the_worst_of_each_port_and_bounds_that_tell_nothing():
    def bound(**outputs: float) -> Bound:
        return Bound("f32", math.inf, outputs, {}, "linear", ())

    comparisons = [
        comparison("a", "f32", {"y": 0.5, "z": 0.1}, residual=(0.3, 0.4)),
        comparison("a", "f32", {"y": 0.25, "z": 0.2}),
        comparison("a", "f64", {"y": 9.0}),
        comparison("b", "f32", {"y": 8.0}),
    ]
    bounds = {"a": {"all": bound(y=3.0, z=2.0), "inside": bound(y=2.0, z=4.0)}, "b": {}}
    scales = {"a": {"y": 2.0, "z": 4.0}, "b": {"y": 1.0}}
    found = Verification("d", "-", comparisons, bounds, {"y": 2.0}, scales)
    assert found.worst("f32", "a") == {"y": 0.5, "z": 0.2}
    # The narrowest bound of y is all of its scale, of z a half.
    assert found.telling_nothing("a") == {"y": 100.0}
    told = found.to_dict()
    assert told["bounds_that_tell_nothing_percent"] == {"a": {"y": 100.0}}
    assert told["comparisons"][0]["residual_limit_Nm"] == 0.4
    assert told["f32_bounds"]["a"]["inside"]["holds_for"] == LASTING
    bounds["a"]["inside"].outputs["y"] = 1.9
    assert found.telling_nothing("a") == found.telling_nothing("b") == {}


def test_one_verdict_line_names_what_is_not_proven_and_what_failed():
    def verdict(wide: float, **more) -> str:
        both = [comparison("a", "f64", {"y": 0.0}, bit_identical=True)]
        both.append(comparison("a", "f32", {"y": 0.5}, **more))
        bounds = {"a": {"all": Bound("f32", math.inf, {"y": wide}, {}, "linear", ())}}
        return Verification("d", "-", both, bounds, {}, {"a": {"y": 2.0}}).verdict()

    assert verdict(1.0).startswith("verdict: PASS. a: f64 equals CasADi's C bit for bit; f32")
    assert "at most 25 % of full scale from the model (a.y)." in verdict(1.0)
    assert "PASS, 1 output tested but not proven" in verdict(22.0)
    assert verdict(22.0).endswith("a.y (1100 % of full scale).")
    failed = verdict(22.0, problems=["wrong"])
    assert failed == "verdict: FAIL. The C differs from the symbolic model in a f32."
    assert {len(x.splitlines()) for x in (verdict(1.0), verdict(22.0), failed)} == {1}
