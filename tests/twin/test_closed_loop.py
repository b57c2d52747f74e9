"""Controller and plant in one C loop: the same bits as stepping both symbolically."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.language.block import Block
from esea_gen.language.ports import Tunable, clip
from esea_gen.language.system import System, Task
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.people import ideal_plant, random_plant, real_plant
from esea_gen.twin.plant import start_state
from esea_gen.twin.trajectories import backdriven, fixed_sinusoid
from tests.made_up import made, port

STEP_RAD = 2 * math.pi / 4096


def wrapped(counts):
    """A difference of counts, by the shorter way round."""
    return counts - 4096 * (counts > 2048) + 4096 * (counts < -2048)


def front(name: str = "front") -> Block:
    """Deflection from the joint encoders, and the command of the slow law, limited."""

    def step(c, s, u, guard, label):
        turns = wrapped(u.count_motor - u.count_load)
        return {"last_Nm": u.command_Nm}, {
            "theta_rad": STEP_RAD * turns,
            "u_Nm": clip(u.command_Nm, -0.221, 0.221),
            "pair": [u.count_gear, s.last_Nm],
        }

    counts = (
        port("count_motor", 0, 4095),
        port("count_load", 0, 4095),
        port("count_gear", 0, 131071),
    )
    inputs = (*counts, port("command_Nm", -10, 10))
    outputs = port("theta_rad", -7, 7), port("u_Nm", -1, 1), port("pair", -200000, 200000, 2)
    return made(step, (port("last_Nm", -10, 10),), inputs, outputs, name=name)


def law(vector: bool = False) -> Block:
    """A proportional law on the deflection, every 5 ms."""

    def step(c, s, u, guard, label):
        wanted = u.tau_desired_Nm - 20.0 * u.theta_rad
        more = ca.sum1(u.offsets) if vector else 0.0
        total = s.total + 0.005 * wanted
        return {"total": clip(total, -1, 1)}, {
            "command_Nm": (u.tau_desired_Nm + c.gain * (wanted + total)) / 74 + more
        }

    inputs = port("theta_rad", -7, 7), port("tau_desired_Nm", -20, 20, on_invalid=0.0)
    inputs += (port("offsets", -1, 1, 3),) if vector else ()
    return made(
        *(step, (port("total", -1, 1),), inputs, (port("command_Nm", -10, 10),)),
        tunables=(Tunable("gain", 0.5, 0.0, 20.0, "proportional gain"),),
        coefficients=(port("gain", 0, 20),),
        prepare=lambda t: {"gain": 1 * t.gain},
        **{"name": "law", "period_s": 5e-3},
    )


def controller(release: int | None = 1, phase: int = 0, vector: bool = False, **change) -> System:
    arguments = {
        "name": "pcontrol",
        "base_period_s": 1e-3,
        "blocks": {"front": front(), "law": law(vector)},
        "tasks": (Task("sense", ("front",)), Task("control", ("law",), 5, phase, release)),
        "wires": {"law.theta_rad": "front.theta_rad", "front.command_Nm": "law.command_Nm"},
        "inputs": {f"count_{k}": (f"front.count_{k}",) for k in ("motor", "load", "gear")}
        | {"tau_desired_Nm": ("law.tau_desired_Nm",)}
        | ({"offsets": ("law.offsets",)} if vector else {}),
        "outputs": {n: f"front.{n}" for n in ("u_Nm", "theta_rad", "pair")}
        | {"command_Nm": "law.command_Nm"},
    }
    return System(**(arguments | change))


@pytest.fixture(scope="module")
def loop(drive) -> ClosedLoop:
    return ClosedLoop(controller(), real_plant(drive))


def signals_of(trajectory, ticks: int | None = None) -> dict:
    names = ("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "tau_desired_Nm")
    return {n: trajectory.signals()[n][:ticks] for n in names}


# -- the loop, a second time in Python ------------------------------------------------------------


def by_hand(board, loop: ClosedLoop, signals: dict, values: dict, start_rad: float):
    """The same schedule with one Python call a step; the plant is run symbolically."""
    owners = {t.name: i for i, t in loop.plant.tunables}
    grouped: dict = {}
    for k, v in values.items():
        grouped.setdefault(owners[k], {})[k] = v
    plant = loop.plant.simulator(grouped)
    first, plant_now = start_state(loop.plant.blocks["plant"], start_rad)
    plant.blocks["plant"].state = first
    plant_now = {
        x.name: plant_now.get(x.name, 0.0) for x in loop.plant.task_outputs(loop.plant.tasks[0])
    }
    steps, h = round(1e-3 / loop.variant.step_s), loop.variant.step_s
    held = {t.name: {} for t in loop.controller.tasks}
    rows = []
    for k in range(TICKS):
        angles = {n: plant_now[n] for n in ("theta_m_rad", "theta_l_rad", "theta_g_rad")}
        seen = plant.step("encode", **angles)
        board.release(k)
        for task in loop.controller.tasks:
            if k >= task.phase and (k - task.phase) % task.every == 0:
                known = plant_now | seen | {n: signals[n][k] for n in loop.signals}
                given = {x.name: known[x.name] for x in loop.controller.task_inputs(task)}
                held[task.name] = board.step(task.name, **given)
        rows.append(
            {**plant_now, **seen, **{k: v for out in held.values() for k, v in out.items()}}
        )
        theta, omega, alpha = (
            signals[n][k] for n in ("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2")
        )
        for j in range(1, steps + 1):
            t = j * h
            plant_now = plant.step(
                "move",
                u_Nm=float(held["sense"]["u_Nm"]),
                theta_p_rad=theta + t * (omega + 0.5 * t * alpha),
                omega_p_rad_s=omega + t * alpha,
                alpha_p_rad_s2=alpha,
                noise=signals["noise"][k],
            )
    return rows


TICKS = 250


def stream() -> dict:
    signals = signals_of(backdriven(0.25), TICKS)
    signals["tau_desired_Nm"] = np.float32(2 * np.sin(np.arange(TICKS) / 20)).astype(float)
    signals["noise"] = np.random.default_rng(3).standard_normal(TICKS)
    return signals


@pytest.mark.parametrize(
    ("real", "release", "phase"), [("f64", 1, 0), ("f64", None, 2), ("f32", 3, 4)]
)
def test_bit_for_bit(drive, real, release, phase):
    system, variant = controller(release, phase), random_plant(drive, 11)
    tunables = {"law": {"gain": 3.0}}
    both = ClosedLoop(system, variant, real)
    run = both.run(stream(), controller_tunables=tunables)
    board = (
        system.simulator(tunables)
        if real == "f64"
        else compile_system(system, real).board(tunables)
    )
    expected = by_hand(board, both, stream(), dict(variant.values), 0.0)
    for name in run:
        late = phase if name == "command_Nm" else 0
        assert np.array_equal(run[name], np.array([row.get(name, 0.0) for row in expected])), name
        assert np.all(run[name][:late] == 0)
    assert np.ptp(run["tau_e_Nm"]) > 0.1
    assert np.ptp(run["u_Nm"]) > 0.01
    if (release, phase) == (1, 0):
        # Armed: with the latch released one tick later it is another loop.
        other = controller(2).simulator(tunables)
        late_rows = by_hand(other, both, stream(), dict(variant.values), 0.0)
        assert not np.array_equal(run["u_Nm"], [row["u_Nm"] for row in late_rows])


# -- what goes in and what comes out --------------------------------------------------------------


def test_a_run_follows_the_torque(drive, loop):
    trajectory = fixed_sinusoid(1.5, 0.25)
    run = loop.run(signals_of(trajectory), {"clamped": 1.0})
    assert len(run) == 32000
    assert run.time_s[-1] == pytest.approx(31.999)
    w = trajectory.window
    assert np.corrcoef(run["tau_e_Nm"][w], trajectory.tau_desired_Nm[w])[0, 1] > 0.7
    assert np.all(run["theta_l_rad"] == 0)
    assert not np.any(run["tripped"])
    # The controller sees what the encoders count.
    counts = wrapped(run["count_motor"] - run["count_load"])
    assert run["theta_rad"] == pytest.approx(counts * STEP_RAD, abs=1e-6)
    assert run["theta_rad"] == pytest.approx(run["theta_m_rad"] - run["theta_l_rad"], abs=0.0016)
    assert run["pair"].shape == (32000, 2)
    assert np.array_equal(run["pair"][:, 0], run["count_gear"])
    assert set(run.keys()) == set(run.plant) | set(run.controller)


def test_row_k_is_time_k(loop):
    run = loop.run(
        {"tau_desired_Nm": np.zeros(5), "theta_p_rad": np.full(5, 0.7)}, {"gravity_Nm": 0.0}
    )
    assert run["theta_l_rad"][0] == run["theta_m_rad"][0] == 0.7
    assert run["count_load"][0] == math.floor(0.7 / STEP_RAD)
    assert run["tau_e_Nm"][0] == 0


def test_runs_start_afresh_and_follow_the_seed(loop):
    s = signals_of(backdriven(0.2), 2000)
    a, b, c = loop.run(s, seed=1), loop.run(s, seed=1), loop.run(s, seed=2)
    assert all(np.array_equal(a[n], b[n]) for n in a)
    assert not np.array_equal(a["tau_h_Nm"], c["tau_h_Nm"])
    quiet = [loop.run(s, {"torque_noise_Nm": 0.0}, seed=k)["tau_h_Nm"] for k in (1, 2)]
    assert np.array_equal(*quiet)


def test_signals_may_be_vectors_and_may_hold_anything(drive):
    loop = ClosedLoop(controller(vector=True), real_plant(drive))
    assert loop.signals == {"tau_desired_Nm": 1, "offsets": 3}
    n = 400
    offsets = np.tile([0.01, 0.02, -0.005], (n, 1))
    tau = np.zeros(n)
    tau[100:200] = np.nan
    signals = {"tau_desired_Nm": tau, "offsets": offsets}
    run = loop.run(signals)
    assert run["command_Nm"][0] == pytest.approx(0.025, rel=1e-6)
    assert all(np.all(np.isfinite(run[k])) for k in run)
    with pytest.raises(UserError, match=r"offsets has shape \(400,\), not \(400, 3\)"):
        loop.run(signals | {"offsets": tau})


def test_a_command_out_of_range_is_no_command(drive):
    def step(c, s, u, guard, label):
        return {}, {"u_Nm": 1000 * u.command_Nm}

    ports = (port("command_Nm", -1, 1),), (port("u_Nm", -1000, 1000),)
    block = made(step, (), *ports, name="front")
    system = System(
        "broken",
        1e-3,
        {"front": block},
        (Task("sense", ("front",)),),
        {},
        {"command_Nm": ("front.command_Nm",)},
        {"u_Nm": "front.u_Nm", "tau_e_Nm": "front.u_Nm"},
    )
    command = np.full(100, 1e-4)
    command[50:] = 0.9
    run = ClosedLoop(system, ideal_plant(drive)).run({"command_Nm": command})
    assert np.all(run["u_Nm"][50:] == 900)
    assert not np.any(run["plant_status"][:51])
    assert np.all(run["plant_status"][51:] == 1)
    decay = np.exp(-np.arange(50) * 1e-3 / 0.03488)
    assert run["u_a_Nm"][50:] == pytest.approx(run["u_a_Nm"][50] * decay, rel=1e-9)
    # An array that both have must be asked for by its owner.
    with pytest.raises(KeyError, match="both"):
        run["tau_e_Nm"]
    with pytest.raises(KeyError, match="nothing"):
        run["nothing"]
    assert np.array_equal(run.controller["tau_e_Nm"], run["u_Nm"])
    assert np.max(np.abs(run.plant["tau_e_Nm"])) < 5


def test_a_plant_too_stiff_for_its_step_is_reported(loop):
    values = {"motor_side_inertia_kgm2": 1.1e-4, "coupling_stop_Nm_rad": 9e4, "clamped": 1.0}
    with pytest.raises(RuntimeError, match="left its ranges"):
        loop.run({"tau_desired_Nm": np.full(3000, 9.0)}, values | {"coupling_stop_rad": 0.02})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"signals": {}}, "tau_desired_Nm is neither an output of the plant nor among"),
        ({"signals": {"nonsense": np.zeros(9)}}, "Signal nonsense feeds nothing"),
        ({"signals": {"noise": np.zeros(9), "theta_p_rad": np.zeros(8)}}, "8"),
        ({"signals": {"theta_p_rad": np.full(9, np.nan)}}, "9 that are not finite"),
        ({"signals": {"tau_desired_Nm": np.zeros((9, 2))}}, r"has shape \(9, 2\)"),
        ({"plant_tunables": {"mass": 1.0}}, "no tunable mass"),
        ({"plant_tunables": {"J_kgm2": -1.0}}, "plant.J_kgm2 = -1 is outside"),
        ({"plant_tunables": {"J_kgm2": math.nan}}, "plant.J_kgm2 = nan is outside"),
        ({"plant_tunables": {"joint_encoder_bits": 10.5}}, "not a whole number"),
        ({"controller_tunables": {"law": {"gain": 99.0}}}, "law.gain = 99 is outside 0 to 20"),
        ({"controller_tunables": {"low": {"gain": 1.0}}}, "no tunable low.gain"),
        ({"ticks": 0}, "0 ticks"),
    ],
)
def test_wrong_runs_are_refused(loop, change, words):
    good = {"signals": {"tau_desired_Nm": np.zeros(9)}}
    if set(change.get("signals", {})) - {"tau_desired_Nm"}:
        change = {"signals": {**good["signals"], **change["signals"]}}
    with pytest.raises(UserError, match=words):
        loop.run(**(good | change))


def test_wrong_loops_are_refused(drive):
    plant = ideal_plant(drive)
    with pytest.raises(UserError, match="no scalar output u_Nm"):
        ClosedLoop(controller(outputs={"theta_rad": "front.theta_rad"}), plant)
    with pytest.raises(UserError, match="no number format 'f16'"):
        ClosedLoop(controller(), plant, "f16")
    with pytest.raises(UserError, match="cannot be named 'twin'"):
        ClosedLoop(controller(name="twin"), plant)
