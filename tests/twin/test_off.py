"""Model mismatch: each family changes its property and no other."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from esea_gen.device import with_numbers
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.language.system import System, Task
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import TORQUE, Setting
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.hand_plant import twin_system
from esea_gen.twin.off import deviation, off_families
from esea_gen.twin.people import ideal_plant
from esea_gen.twin.run import compiled_loop, plant_variant, run_case, told
from tests.made_up import made, port
from tests.studies.test_experiments import shorter
from tests.twin.test_plant import P_NM_RAD, R_RAD, Rig
from tests.typed import typed

pytestmark = pytest.mark.ci

EVERY = list(off_families())


@pytest.fixture(scope="module")
def rigid(drive) -> Rig:
    return Rig(drive, False)


# -- the plant does what a family says ------------------------------------------------------------

# So heavy and smooth that a motion is what it was started with.
HEAVY = {"J_kgm2": 100.0, "fv_Nms_rad": 0.0, "fc_Nm": 0.0, "clamped": 1.0}


def moved(rig: Rig, seconds: float, rate_rad_s: float, start_rad: float = 0.0, **values: float):
    """Deflections and torques of a coupling that is turned at one rate, load side held."""
    initial = {"theta_m_rad": start_rad, "omega_m_rad_s": rate_rad_s}
    out = rig.run(np.zeros(round(seconds / rig.step_s)), initial, **(HEAVY | values))
    return out["theta_m_rad"] - out["theta_l_rad"], out["tau_e_Nm"]


@pytest.mark.parametrize(
    ("name", "scale"), [("rubber-20", 0.8), ("rubber-10", 0.9), ("rubber+10", 1.1)]
)
def test_static_torque_of_another_rubber(drive, rigid, name, scale):
    # 0.1 rad from rest: 9.39 * 0.1 + 239 * 0.1**3 of the spring, nothing yet of the rest.
    _, torque = moved(rigid, rigid.step_s, 0.0, 0.1, **deviation(name, drive, 0).values)
    assert torque[0] == pytest.approx(scale * 1.178, rel=1e-5)


def test_twice_the_hysteresis(drive, rigid):
    values = deviation("hysteresis-x2", drive, 0).values
    (delta, once), (_, twice) = moved(rigid, 0.1, 1.0), moved(rigid, 0.1, 1.0, **values)
    stops = [P_NM_RAD @ np.clip(x, -R_RAD, R_RAD) for x in delta]
    assert delta[-1] == pytest.approx(0.1, rel=0.01)
    assert twice - once == pytest.approx(stops, abs=1e-3)
    assert stops[-1] > 0.1


@pytest.mark.parametrize("constant_s", [5.0, 0.05, 0.011])
def test_a_second_relaxation_time(drive, rigid, constant_s):
    # Of a spring of 3 Nm/rad and a dashpot in line at a constant rate.
    values = dict(deviation("relaxation", drive, 0).values)
    assert values == {"relaxation_Nm_rad": 3.0, "relaxation_s": 5.0}
    large = with_numbers(drive, {"domain.tau_full_scale_Nm": 2 * 4.47})
    assert deviation("relaxation", large, 0).values["relaxation_Nm_rad"] == 6.0
    values["relaxation_s"] = constant_s
    (delta, alone), (_, both) = moved(rigid, 0.1, 1.0), moved(rigid, 0.1, 1.0, **values)
    t = rigid.step_s * np.arange(1, len(delta) + 1)
    assert both - alone == pytest.approx(3.0 * constant_s * (1 - np.exp(-t / constant_s)), abs=2e-4)


@pytest.mark.parametrize(("name", "deg"), [("encoder-0.26deg", 0.26), ("encoder-1deg", 1.0)])
def test_an_encoder_that_is_wrong_once_a_turn(drive, name, deg):
    values = dict(deviation(name, drive, 3).values)
    runner = compile_system(twin_system(drive), "f64").task("encode")
    assert runner.prepare({"encoders": values}) == 0
    n = 40_009  # no divisor in common with the counts of a turn
    theta = 2 * np.pi * (np.arange(n) + 0.5) / n
    counts, _ = runner.run({f"theta_{k}_rad": theta for k in "mlg"}, trace=False)
    steps = 2 ** int(drive.file.encoder.resolution_bits.value)
    phases = []
    for side in ("motor", "load"):
        read = 2 * np.pi * (counts[f"count_{side}"] + 0.5) / steps
        lines = np.fft.rfft(np.angle(np.exp(1j * (read - theta)))) / (n / 2)
        assert np.degrees(abs(lines[1])) == pytest.approx(deg, rel=0.01)
        assert np.degrees(np.abs(lines[2:50]).max()) < 0.003
        phases.append(np.angle(lines[1]))
    assert abs(phases[0] - phases[1]) > 0.1  # each its own
    assert deviation(name, drive, 4).values["motor_phase_1_rad"] != values["motor_phase_1_rad"]


# -- delay and missed runs in the loop ------------------------------------------------------------


def counting() -> System:
    """The command is a signal; a slow task counts its runs."""

    def sense(c, s, u, guard, label):
        return {}, {"u_Nm": 1 * u.ask_Nm}

    def slow(c, s, u, guard, label):
        return {"runs": s.runs + 1}, {"runs_done": s.runs + 1}

    asked, runs = port("ask_Nm", -1, 1, on_invalid=0.0), port("runs", 0, 1e6)
    unused, done = port("tau_e_Nm", -1e5, 1e5), port("runs_done", 0, 1e6)
    front = made(sense, (), (asked,), (port("u_Nm", -1, 1),), name="front")
    return System(
        "counting",
        1e-3,
        {
            "front": front,
            "slow": made(slow, (runs,), (unused,), (done,), name="slow", period_s=5e-3),
        },
        (Task("sense", ("front",)), Task("control", ("slow",), 5)),
        {},
        {"ask_Nm": ("front.ask_Nm",), "tau_e_Nm": ("slow.tau_e_Nm",)},
        {"u_Nm": "front.u_Nm", "runs_done": "slow.runs_done"},
    )


@pytest.fixture(scope="module")
def loop(drive) -> ClosedLoop:
    return ClosedLoop(counting(), ideal_plant(drive, "none"), "f64")


@pytest.mark.parametrize(("name", "ms"), [("none", 0), ("delay+1ms", 1), ("delay+10ms", 10)])
def test_a_command_arrives_later(drive, loop, name, ms):
    ticks = deviation(name, drive, 0).delay_ticks
    asked = 0.1 * np.random.default_rng(1).standard_normal(300)
    asked[:50] = 0.0
    plain = loop.run({"ask_Nm": asked})["u_a_Nm"]
    assert np.flatnonzero(plain)[0] == 51  # commanded in tick 50, seen at the next
    late = loop.run({"ask_Nm": asked}, delay_ticks=ticks)["u_a_Nm"]
    assert np.flatnonzero(late)[0] == 51 + ms
    assert np.array_equal(late[ms:], plain[: 300 - ms])


def test_missed_runs_do_not_run(loop):
    missed = np.zeros(100, bool)
    missed[[10, 11, 12, 40, 45]] = True  # due are 0, 5, 10, ...
    run = loop.run({"ask_Nm": np.zeros(100)}, missed=missed)
    due = np.arange(100) % 5 == 0
    assert np.array_equal(run["runs_done"], np.cumsum(due & ~missed))
    assert run.missed_runs == 3
    assert loop.run({"ask_Nm": np.zeros(100)}).missed_runs == 0
    for bad in ({"missed": missed[1:]}, {"delay_ticks": -1}):
        with pytest.raises(UserError, match="Give a delay from 0, and one value a tick"):
            loop.run({"ask_Nm": np.zeros(100)}, **bad)


@pytest.mark.ci
@pytest.mark.parametrize("controller", ["smc", "mpc"])
@pytest.mark.parametrize(("in_a_row", "latches"), [(4, False), (5, True)])
def test_how_many_missed_runs_are_bridged(controller, in_a_row, latches):
    # docs/robustness.md states the number: four.
    drive = controller_device(controller)
    case = shorter(TuningCase().cases()[0], 4)
    loop = compiled_loop(drive, True, "f32")
    variant = plant_variant(drive, "real", "none", 0)
    missed = np.zeros(4000, bool)
    missed[2000 : 2000 + 5 * in_a_row] = True
    signals = told(drive, loop, case.trajectory, TORQUE)
    run = loop.run(signals, variant.values, seed=0, missed=missed)
    assert run.missed_runs == in_a_row
    assert bool(run.controller["fault"][1900] > 0) is False
    assert bool(run.controller["fault"][-1] > 0) is latches


# -- everything at once ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY[1:])
def test_every_family_is_felt(name):
    # From the path's start on; 10 ms more are felt within seconds.
    case = shorter(TuningCase().cases()[0], 3)
    plain = run_case(case, Setting("smc"), 2)["tau_e_Nm"]
    assert np.max(np.abs(run_case(case, Setting("smc", off=name), 2)["tau_e_Nm"] - plain)) > 1e-3


# -- what is said of it ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--off", "ruber"], "unknown family 'ruber'. Did you mean rubber?"),
        (["--off", ""], "--off is empty. Leave --off out for none"),
        (["--off", " "], "--off is empty"),
        (["--off", "none,missd"], "Did you mean missed?"),
        (
            ["--off", "backlash", "--plant", "ideal"],
            "has no cable_backlash_rad: its cable is rigid",
        ),
    ],
)
def test_bad_input_is_explained(arguments, said):
    done = typed("simulate", "tuning", *arguments)
    assert done.returncode == 2, done.stderr
    assert said in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


@pytest.mark.ci
def test_one_command_makes_the_table(tmp_path):
    file, sheet = tmp_path / "off.json", tmp_path / "off.csv"
    command = (
        "simulate tuning --off rubber-10,missed-10% --controller smc --controller mpc --jobs 1"
    )
    done = typed(*command.split(), "--json", file, "--csv", sheet)
    assert done.returncode == 0, done.stderr
    assert "simulated" in done.stdout
    rows = json.loads(file.read_text())["off"]
    assert [(r["off"], r["controller"]) for r in rows] == [
        (n, c) for n in ("rubber-10", "missed-10%") for c in ("smc", "mpc")
    ]
    # A tenth of what the elastomer has of 1.7 Nm is missing, whoever controls.
    wrong = 0.1 * 1.7 / math.sqrt(2)
    assert [r["rms_true_Nm"] for r in rows[:2]] == pytest.approx([wrong, wrong], rel=0.2)
    assert [r["fault"] for r in rows] == [0, 0, 0, 0]
    assert sheet.read_text().count("\n") == 5
