"""The simulated impairment: its C, its proof of passivity, and the printed law that is not."""

from __future__ import annotations

import math
import subprocess

import numpy as np
import pytest
import sympy as sp
from sympy.printing.smtlib import smtlib_code

from esea_gen.control import impairment as law
from esea_gen.device import load_device, parse_device
from esea_gen.emit.formats import FORMATS
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.language.system import System, Task
from esea_gen.verify.bounds import bounds_or_rule
from esea_gen.verify.compare import compare
from esea_gen.verify.coverage import branch_coverage
from esea_gen.verify.memories import other_memories
from esea_gen.verify.runs import CasadiOracle
from esea_gen.verify.streams import at_the_limits, streams
from tests.conftest import require_tool
from tests.own_device import own_device


@pytest.fixture(scope="module")
def device():
    return own_device(base="wrist_drive", name="published", impairment={"wall": "published"})


@pytest.fixture(scope="module")
def block(device):
    return law.impairment(device)


@pytest.fixture(scope="module")
def system(device, block):
    feeds = {p.name: (f"impairment.{p.name}",) for p in block.inputs}
    outputs = {p.name: f"impairment.{p.name}" for p in block.outputs}
    task = Task("sense", ("impairment",))
    return System("impaired", device.period_s, {"impairment": block}, (task,), {}, feeds, outputs)


# -- the C -----------------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_c_is_the_law_and_every_side_is_taken(device, block, system, real):
    library = compile_system(system, real)
    single = real == "f32"
    bounds, rule = bounds_or_rule(device, block) if single else ({}, None)
    oracle = None if single else CasadiOracle(system)
    for stream in streams(block):
        found = compare(device, block, library, stream, bounds, oracle, rule)
        assert found.problems == []
        assert single or found.bit_identical
        for name, error in found.errors.items():
            assert error <= found.limits[name]
    dtype = FORMATS[real].dtype
    tried = [*streams(block), at_the_limits(block, dtype), *other_memories(block, dtype)]
    cover = branch_coverage(block, tried, library)
    assert cover.uncovered == []
    assert cover.ratio == 1.0


def constrained(block, **tunables):
    simulator = block.simulator(tunables)
    simulator.step(theta_rad=0.0, omega_rad_s=0.0, constrained=1.0)
    return simulator


def test_it_is_switched_at_rest_outside_the_wall_only(block):
    s = block.simulator()
    assert s.step(theta_rad=0.0, omega_rad_s=0.5, constrained=1.0)["acts"] == 0
    assert int(s.step(theta_rad=0.2, omega_rad_s=0.0, constrained=1.0)["status"]) & 16
    assert s.step(theta_rad=0.0, omega_rad_s=0.05, constrained=1.0)["acts"] == 1
    assert s.step(theta_rad=0.2, omega_rad_s=0.0, constrained=0.0)["acts"] == 1
    assert s.step(theta_rad=0.0, omega_rad_s=0.0, constrained=0.0)["acts"] == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -4.0])
def test_no_torque_without_a_valid_angle(block, bad):
    y = constrained(block).step(theta_rad=bad, omega_rad_s=0.0, constrained=1.0)
    assert y["tau_set_Nm"] == 0
    assert int(y["status"]) & 1


# -- passivity -------------------------------------------------------------------------------------


# The only power there is; SMT-LIB has none.
CUBE = "(define-fun pow ((x Real) (n Int)) Real (* x x x))\n"


def answer(power: sp.Expr) -> str:
    """Whether z3 finds reals at which a law gives more than its storage loses."""
    stored = (
        sp.Piecewise((sp.Min(law.SPRING, law.TAU_MAX), law.THETA > law.WALL), (0, True)) * law.OMEGA
    )
    symbols = [law.THETA, law.OMEGA, law.WALL, law.KP, law.KP3, law.KD, law.KV, law.TAU_MAX]
    plain = {s: sp.Symbol(str(s).replace("_", "")) for s in symbols}
    excess = (power - stored).rewrite(sp.Piecewise).subs(plain)
    table = {plain[s]: float for s in symbols}
    facts = [plain[s] >= 0 for s in (law.KP, law.KP3, law.KD, law.KV)] + [plain[law.TAU_MAX] > 0]
    text = smtlib_code(
        [*facts, excess < 0], symbol_table=table, log_warn=lambda _: None, auto_declare=True
    )
    done = subprocess.run(
        [require_tool("z3"), "-in", "-T:60"],
        input=CUBE + text + "\n(check-sat)\n",
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def saturated(x: sp.Expr) -> sp.Expr:
    return sp.Max(sp.Min(x, law.TAU_MAX), -law.TAU_MAX)


@pytest.mark.ci
def test_the_law_is_passive_for_all_numbers():
    """Taken power >= dS/dt, S the integral of min(Kp s + Kp3 s^3, tau_max), for all numbers."""
    wall = sp.Piecewise((law.PUSH, law.THETA > law.WALL), (0, True))
    assert answer(-saturated(law.RESISTANCE - wall) * law.OMEGA) == "unsat"


def test_the_printed_law_is_not():
    """Armed: for a negative speed its damping feeds the motion."""
    printed = -sp.sign(law.OMEGA) * (
        law.KP * (law.THETA - law.WALL) + law.KD * law.OMEGA + law.KV * law.OMEGA
    )
    power = -saturated(
        sp.Piecewise(
            (printed, law.THETA > law.WALL), (-sp.sign(law.OMEGA) * law.KV * law.OMEGA, True)
        )
    )
    assert answer((power * law.OMEGA).rewrite(sp.Piecewise)) == "sat"


def closed_path(rng, steps=4000):
    """A smooth closed path of random harmonics, and its exact rate, at 1 kHz."""
    t = np.arange(steps) / steps * 2 * np.pi
    theta, rate = np.zeros(steps), np.zeros(steps)
    for k in range(1, 6):
        a, phase = rng.normal() * 0.12 / k, rng.uniform(0, 2 * np.pi)
        theta += a * np.sin(k * t + phase)
        rate += a * k * np.cos(k * t + phase) * 2 * np.pi / (steps * 1e-3)
    return theta, rate


@pytest.mark.parametrize(
    "gains", [{"Kp3_Nm_rad3": 60.0}, {"Kd_Nms_rad": 0.0, "Kv_Nms_rad": 0.0}, {"Kv_Nms_rad": 0.0}]
)
def test_no_closed_path_gives_energy(block, gains):
    rng = np.random.default_rng(5)
    for _ in range(20):
        theta, rate = closed_path(rng)
        s = constrained(block, **gains)
        y, _ = s.run({"theta_rad": theta, "omega_rad_s": rate, "constrained": np.ones(len(theta))})
        given_J = float(np.sum(y["tau_set_Nm"] * rate) * 1e-3)
        # A pure spring gives back what it took; the sum over 4000 steps is that near to it.
        assert given_J <= 2e-4
        if gains and not any(gains.values()) and len(gains) == 2:
            assert abs(given_J) < 2e-4


def test_a_section_that_does_not_fit_is_refused(device):
    with pytest.raises(UserError, match=r"impairment\.bandwidth_Hz = 60 Hz is above its limit"):
        parse_device(device.toml().replace("{ value = 1000.0", "{ value = 500.0"), "x")
    with pytest.raises(UserError, match=r"section \[impairment\] is missing"):
        law.impairment(load_device("wrist"))
