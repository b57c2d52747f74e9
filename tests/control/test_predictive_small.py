"""Predictive control of a small made-up plant with a memory, against the plant typed in floats."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, nextafter

import casadi as ca
import numpy as np
import pytest

from esea_gen.control.predictive.horizon import Horizon, Model, Stops, Tape
from esea_gen.control.predictive.program import FLAGS, predictive_program
from esea_gen.language.ports import Port, Tunable

BIT = {f.name: 1 << i for i, f in enumerate(FLAGS)}
U_MAX = 1.5
R, P = (0.02, 0.05, 0.11), (4.0, 2.5, 1.25)


def plant(n: int, **more) -> Model:
    """A spring with stop operators against a mass: all linear but for the stops."""

    def substep(t: Tape, h, x, u, p, w):
        d = t.let("d_next", x.d + h * x.v)
        tau = t.memory(d)
        force = t.let("force", u + w.push - 2 * w.pull - p.drag * x.v - tau - 3 * d)
        return {"d": d, "v": x.v + h * force}

    return Model(
        states=("d", "v"),
        start=lambda u, tau: {"d": u.d_rad, "v": u.pair_rad_s[0] - u.pair_rad_s[1] + 0.1 * tau},
        substep=substep,
        error=lambda x, p, ref: [p.root * (x.d - ref.wanted), 0.3 * (x.v - ref.held)],
        effort=lambda x, u, p: [p.lean * (u - 0.5 * x.v)],
        inputs=(
            Port("d_rad", -1, 1, "deflection"),
            Port("pair_rad_s", -2, 2, "two speeds", 2),
            Port("play_rad", -1, 1, "play states", 3),
            Port("u_now_Nm", -2, 2, "command in force"),
            Port("wanted_rad", -1, 1, "wanted place", n),
            Port("held_rad_s", -1, 1, "wanted speed"),
            Port("push_Nm", -1, 1, "push"),
            Port("lean", 0, 1, "weight of the effort"),
            Port("mode", 0, 1, "whether to act"),
        ),
        in_force="u_now_Nm",
        enable="mode",
        references={"wanted": ("wanted_rad", True), "held": ("held_rad_s", False)},
        forecasts={
            "push": lambda u, p, t: u.push_Nm + p.drag * t,
            "pull": lambda u, p, t: u.push_Nm * t,
        },
        shape=lambda t: 3 * t,
        parameters=("drag", "root", "lean"),
        u_max=U_MAX,
        stops=Stops(R, P),
        play="play_rad",
        deflection=lambda u: u.d_rad,
        tunables=(
            Tunable("drag", 0.4, 0.0, 1.0, "drag"),
            Tunable("weight", 900.0, 0.1, 1000.0, "weight of the place"),
        ),
        coefficients=(Port("drag", 0, 1, "drag"), Port("root", 0, 40, "root of the weight")),
        prepare=lambda t: {"drag": t.drag, "root": ca.sqrt(t.weight)},
        **more,
    )


def situation(n: int) -> dict:
    return {
        "d_rad": 0.031,
        "pair_rad_s": np.array([0.7, 0.31]),
        # Stops at 0.011, -0.015 and -0.031.
        "play_rad": np.array([0.02, 0.046, 0.062]),
        "u_now_Nm": -0.6,
        "wanted_rad": 0.05 * np.sin(1.7 * np.arange(n) + 0.4),
        "held_rad_s": 0.13,
        "push_Nm": 0.37,
        "lean": 0.21,
        "mode": 1.0,
    }


PERIOD_S = 0.03


def test_a_plan_is_kept_while_the_law_acts_on_sound_numbers():
    z = Horizon(3, 0.07, 2, 0.02)
    program = predictive_program(plant(3), z, period_s=PERIOD_S)

    def step(plan, **changes):
        simulator = program.simulator()
        simulator.state = {"plan": np.array(plan, float)}
        out = simulator.step(**(situation(3) | changes))
        return float(out["u_Nm"]), int(out["status"]), simulator.state["plan"].tolist()

    afresh = step([0, 0, 0])
    assert afresh[0] != 0
    assert step([0.5, 0, 0], mode=0.5) == (0, 0, [0, 0, 0])
    assert step([0.5, 0, 0], mode=nextafter(0.5, 1))[0] != 0
    # A plan is sound up to its ends.
    for k in range(3):
        for side in (1, -1):
            plan = [0.0, 0.0, 0.0]
            plan[k] = side
            assert step(plan)[1] == 0
            plan[k] = side * nextafter(1, inf)
            assert step(plan) == (afresh[0], BIT["STATE_REPAIRED"], afresh[2])
            plan[k] = nan
            assert step(plan) == (afresh[0], BIT["STATE_REPAIRED"], afresh[2])
    for name in ("d_rad", "push_Nm", "lean", "u_now_Nm", "held_rad_s"):
        assert step([0.5, 0, 0], **{name: nan}) == (0, BIT["INPUT_INVALID"], [0, 0, 0])
    for name in ("pair_rad_s", "play_rad", "wanted_rad"):
        for i in range(len(situation(3)[name])):
            wrong = situation(3)[name].copy()
            wrong[i] = 9.0
            assert step([0.5, 0, 0], **{name: wrong}) == (0, BIT["INPUT_INVALID"], [0, 0, 0])


def test_a_command_is_told_with_what_is_known_of_it():
    z = Horizon(3, 0.07, 2, 0.02)
    for cap, status in ((0, BIT["CAP_REACHED"] | BIT["NOT_OPTIMAL"]), (None, 0)):
        program = predictive_program(plant(3), z, period_s=PERIOD_S, cap=cap)
        simulator = program.simulator()
        # Places far away on either side: at the bounds in the end.
        out = simulator.step(**(situation(3) | {"wanted_rad": np.array([1.0, -1.0, 1.0])}))
        assert out["status"] == status
        assert out["iterations"] == simulator.array("qp_iterations")[0]
        assert (out["residual"] > 1e-3) == (cap == 0)
        assert out["u_Nm"] == pytest.approx(U_MAX * simulator.state["plan"][0])
    flat = {"error": lambda x, p, ref: [ca.SX(0)], "effort": lambda x, u, p: [0 * u]}
    program = predictive_program(replace(plant(3), **flat), z, period_s=PERIOD_S)
    out = program.simulator().step(**situation(3))
    assert (out["u_Nm"], out["status"] & BIT["NOT_CONVEX"]) == (0, BIT["NOT_CONVEX"])
