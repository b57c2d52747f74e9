"""The Block that keeps every law passive, on the twin: limp hands, and a law that runs away."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest

import esea_gen
from esea_gen.analysis.passivity import Hand
from esea_gen.devices import BEST_CONTROLLER
from esea_gen.studies.passivity.push import PUSH_RAD_S, PushRun, judge_push, push_case, run_push
from esea_gen.studies.passivity.study import WRIST_HANDS
from esea_gen.twin.case import IMPEDANCE, TORQUE, Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import run_case
from tests.conftest import without
from tests.control.test_passive_block import ENERGY_J, LAG_S, RATIO, SHIPPED, U_MAX, H, J


@pytest.fixture(scope="module")
def bare(tmp_path_factory) -> str:
    """The same device without the section, and so without the Block."""
    text = SHIPPED.read_text(encoding="utf-8")
    path = tmp_path_factory.mktemp("bare") / "bare.toml"
    text = without(text, "passivity").replace('name = "elbow_drive"', 'name = "bare"')
    path.write_text(text, encoding="utf-8")
    return str(path)


# Inertia and stiffness of limp hands, gains and the plant's seed: at 0 Nm or gains of 0; the
# thesis' gains, with hands that let go and that hold on; plants drawn with a backlash of 18 mrad
# (0), 9 % less inertia (0), 18 % more lag (1) and a cable of 110 Nm/rad (3).
GRIPS = ((0.05, 10.0), (0.1, 20.0), (0.1, 30.0), (0.2, 30.0), (0.4, 100.0), (0.05, 1000.0))
LIMP = [(grip, (0.0, 0.0), ("real", 0)) for grip in GRIPS]
HELD = [
    (grip, gains, ("real", 0))
    for gains in ((0.75, 0.25), (1.5, 0.25))
    for grip in ((0.05, 0.0), (0.1, 0.0), (0.2, 30.0))
]
LET_GO = [((inertia, 0.0), (kp, 0.0), ("real", 0)) for inertia in (0.05, 0.1) for kp in (0.08, 0.7)]
DRAWN = [
    ((0.1, 30.0), (0.0, 0.0), ("random", 0)),
    ((0.1, 30.0), (2.8, 0.1), ("random", 0)),
    ((0.2, 100.0), (3.0, 0.0), ("random", 0)),
    ((0.1, 0.0), (0.75, 0.25), ("random", 1)),
    ((0.05, 10.0), (1.5, 0.25), ("random", 3)),
]


LAWS = [BEST_CONTROLLER, "cascade", "smc"]


def verdicts(controller: str, mode: int, asked: list) -> list[bool]:
    """Whether each limp hand swings up, is stopped, or gets over a hundredth of the push."""
    device = controller_device(controller)
    found = []
    for (inertia, stiffness), (kp, kd), (plant, seed) in asked:
        hand = Hand("limp", inertia, 0.0, stiffness)
        case = push_case(device, hand, kp, kd, 0.5, mode)
        run = run_case(case, Setting(controller, plant, "ideal"), seed)
        figures, push_J = judge_push(run, hand, kp, U_MAX), 0.5 * inertia * 0.25
        bad = figures.swings_up(push_J) or figures.stopped or figures.generated_J > 0.01 * push_J
        found.append(bad)
    return found


@pytest.mark.parametrize("mode", [TORQUE, IMPEDANCE])
@pytest.mark.parametrize("controller", LAWS)
def test_limp_hands_get_nothing_at_gains_of_zero(controller, mode):
    assert not any(verdicts(controller, mode, LIMP))


@pytest.mark.parametrize("asked", [HELD, LET_GO, DRAWN], ids=["thesis", "let go", "drawn plants"])
@pytest.mark.parametrize("controller", LAWS)
def test_limp_hands_get_nothing_from_a_rendered_spring(controller, asked):
    assert not any(verdicts(controller, IMPEDANCE, asked))


@pytest.mark.ci
@pytest.mark.parametrize("mode", [TORQUE, IMPEDANCE])
@pytest.mark.parametrize("controller", ["smc", "mpc"])
def test_without_the_block_they_swing_up(controller, bare, mode):
    assert sum(verdicts(f"{controller}@{bare}", mode, LIMP)) >= 3


@pytest.mark.ci
def test_without_the_block_they_swing_up_on_drawn_plants_too(bare):
    """Predictive control renders these springs passively by itself, with the gap closed."""
    assert sum(verdicts(f"smc@{bare}", IMPEDANCE, DRAWN)) >= 3


OPEN = """
from dataclasses import replace
from esea_gen.control.laws.predictive import LAW as SHIPPED
from esea_gen.observe import cable


def parts(base):
    cable.CLOSED_IN, usual = 3, cable.CLOSED_IN
    try:
        return SHIPPED.parts(base)
    finally:
        cable.CLOSED_IN = usual


LAW = replace(SHIPPED, name="open", parts=parts, section="")
"""


@pytest.mark.slow
def test_with_the_gap_open_a_hand_that_let_go_drifts_in_it(tmp_path):
    """The check that the test above can fail: why impedance mode closes the gap."""
    path = tmp_path / "open.py"
    path.write_text(OPEN, encoding="utf-8")
    assert sum(verdicts(f"{path}:LAW", IMPEDANCE, HELD + LET_GO)) >= 2


STUCK = """
from esea_gen.control.law import Law, Parts
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, around
import casadi as ca


def parts(base):
    def step(c, s, u, guard, label):
        return {"runs": s.runs}, {"u_command_Nm": ca.if_else(u.mode > 0.5, 0.221, 0.0)}

    block = Block.define(
        "stuck",
        "All torque, whatever is measured",
        period_s=base.control_period_s,
        state=(Port("runs", 0, 1, "nothing"),),
        inputs=(Port.count("mode", 2, "mode"),),
        outputs=(around("u_command_Nm", 0.221, "command"),),
        step=step,
    )
    return Parts(control={"stuck": block}, command="stuck.u_command_Nm")


LAW = Law("stuck", "All torque, whatever is measured", parts)
"""


def runaway_on_the_twin(controller: str, hand: Hand) -> tuple[float, float]:
    """True energy given to the limb, and to coupling and limb with the drive's own; largest."""
    device = esea_gen.load_device("elbow_drive")
    run = run_case(
        push_case(device, hand, 0.0, 0.0, 0.5, TORQUE), Setting(controller, "real", "ideal"), 0
    )
    tau = run.plant["tau_e_Nm"]
    limb = np.cumsum(tau * run.plant["omega_l_rad_s"]) * H
    both = np.cumsum(tau * run.plant["omega_m_rad_s"]) * H
    return float(np.max(limb)), float(np.max(both + 0.5 * J * run.plant["omega_g_rad_s"] ** 2))


@pytest.mark.ci
def test_a_law_that_runs_away_gives_no_more_than_the_energy(tmp_path, bare):
    """True values, cable and all; what is measured late and wrong has 10 % here."""
    path = tmp_path / "stuck.py"
    path.write_text(STUCK, encoding="utf-8")
    for hand in (Hand("light", 0.1), Hand("arm", 0.4), Hand("held", 0.22, 1.0, 20.0)):
        limb, both = runaway_on_the_twin(f"{path}:LAW", hand)
        assert limb <= ENERGY_J
        assert both <= 1.1 * ENERGY_J
        without, _ = runaway_on_the_twin(f"{path}:LAW@{bare}", hand)
        assert without > 1.02 * ENERGY_J


@pytest.mark.ci
@pytest.mark.parametrize("controller", LAWS)
@pytest.mark.parametrize("plant", ["real", "ideal"])
def test_the_drive_does_as_the_proof_assumes(controller, plant):
    """The motor's torque stays below the model's, and given and held grow by its work at most."""
    device = esea_gen.load_device("elbow_drive")
    hand = Hand("limp", 0.1, 0.0, 30.0)
    run = run_case(push_case(device, hand, 0.0, 0.0), Setting(controller, plant, "ideal"), 0)
    sent, given = run.controller["u_Nm"], run.plant["u_a_Nm"]
    keep, v = math.exp(-H / LAG_S), 0.0
    most = []
    for u in sent:
        most.append(v)
        v = abs(u) + (v - abs(u)) * keep
    assert np.all(np.abs(given) <= np.array(most) + 0.02 * U_MAX)
    tau, speed = run.plant["tau_e_Nm"], run.plant["omega_g_rad_s"]
    held = np.cumsum(tau * run.plant["omega_m_rad_s"]) * H + 0.5 * J * speed**2
    work = np.cumsum(RATIO * given * speed) * H
    # Down from any earlier tick: friction only takes.  The gear's disturbance and the cable give
    # back what they hold.
    grown = held - work
    assert np.max(grown - np.minimum.accumulate(grown)) < 0.02


# On the plant `real`, and on a drawn one with hands that swing at 4 Hz with half the damping and at
# 20 Hz with all of it; without the Block and with all of the load's acceleration, a light hand on a
# soft spring gets ten times its push.
@pytest.mark.ci
def test_the_rendered_wrist_is_passive(tmp_path):
    def passive(controller, axis, hand, plant="real", seed=0):
        push_J = 0.5 * hand.inertia_kgm2 * PUSH_RAD_S**2
        run = run_push(3.0, 0.05, asdict(hand), controller, plant, PUSH_RAD_S, seed, axis=axis)
        return not PushRun(**run).swings_up(push_J) and run["generated_J"] < 0.01 * push_J

    for axis in ("flexion", "deviation"):
        for hand in (*WRIST_HANDS[:3], WRIST_HANDS[-1]):
            assert passive("wrist_drive", axis, hand), (axis, hand)
    assert WRIST_HANDS[-1].scaled(2.0).stiffness_Nm_rad == 120.0
    for hand in (WRIST_HANDS[2], WRIST_HANDS[4]):
        assert passive("wrist_drive", "deviation", hand, "random", 204), hand
    text = SHIPPED.with_name("wrist_drive.toml").read_text(encoding="utf-8")
    bare = tmp_path / "bare.toml"
    text = without(text, "passivity").replace('name = "wrist_drive"', 'name = "bare"')
    text = text.replace("load_share = { value = 0.85", "load_share = { value = 1.0")
    bare.write_text(text, encoding="utf-8")
    assert not passive(str(bare), "flexion", WRIST_HANDS[1])
