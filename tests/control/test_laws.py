"""Control laws are a table: shipped ones, several in one System, one from outside, several axes."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

import esea_gen
from esea_gen.control.law import Law, Parts
from esea_gen.control.law_switch import law_switch
from esea_gen.control.system import control_system
from esea_gen.device import load_device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device
from esea_gen.model.drive import NominalDrive
from esea_gen.model.sensing import zeros_missing
from esea_gen.observe.human import lag_observer
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Setting
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.people import real_plant
from esea_gen.twin.published import PEOPLE
from esea_gen.twin.run import run_case, run_on
from tests import typed
from tests.conftest import ROOT, require_tool
from tests.own_device import own_device, own_text

EXAMPLE = f"{ROOT / 'examples' / 'proportional.py'}:LAW"
CHANGE_S = (3.4, 5.0)


# -- the table -------------------------------------------------------------------------------------


def test_a_devices_own_number_stands_over_its_controllers():
    for added, slope in (({}, 9.0), ({"lambda_1_s": 11.0}, 11.0)):
        device = own_device('controller = "smc-published"\n', sliding_mode=added)
        found = device.file.sliding_mode
        assert (found.lambda_1_s.value, found.setpoint_acceleration) == (slope, "zero")


def without(text: str, *sections: str) -> str:
    for name in sections:
        text = re.sub(rf"^\[{name}\]\n(?:(?!\[).*\n)*", "", text, flags=re.MULTILINE)
    return text


def test_predictive_control_needs_no_sliding_mode():
    text = (ROOT / "esea_gen" / "devices" / "elbow_drive.toml").read_text()
    text = without(text, "sliding_mode", "inverse").replace('"elbow_drive"', '"mine"', 1)
    assert "[sliding_mode]" not in text
    mine = parse_device(text.replace('"elbow"', '"elbow"'), "mine.toml")
    assert mine.drive is not None
    assert mine.laws == ()  # a drive that nothing moves yet
    with pytest.raises(UserError, match=r"has a drive but no control law.*--controller"):
        _ = mine.system
    sections = (ROOT / "esea_gen" / "devices" / "controllers" / "mpc.toml").read_text()
    moved = parse_device(text + sections[sections.index("[predictive]") :], "mine.toml")
    assert [law.name for law in moved.laws] == ["predictive"]
    assert "predictive" in moved.system.blocks


# -- from one law to another -----------------------------------------------------------------------


def test_a_change_is_joined_and_fades(drive):
    """Against the closed form, in plain floats."""
    switch = law_switch(drive, ["a", "b"]).simulator({"fade_s": 0.05})
    keep = math.exp(-drive.drive.control_period_s / 0.05)
    a, b = 0.1, -0.05
    assert switch.step(law=0, u_a_Nm=a, u_b_Nm=b)["u_command_Nm"] == a
    for k in range(8):
        out = switch.step(law=1, u_a_Nm=a, u_b_Nm=b)
        assert out["u_command_Nm"] == pytest.approx(b + (a - b) * keep**k, abs=1e-15)
        assert out["law_held"] == 1
    # Back before it has faded: from where it is.
    before = out["u_command_Nm"]
    assert switch.step(law=0, u_a_Nm=a, u_b_Nm=b)["u_command_Nm"] == pytest.approx(
        before, abs=1e-15
    )


@pytest.mark.parametrize("law", [math.nan, math.inf, -1.0, 2.0])
def test_what_is_no_law_leaves_the_one_in_force(drive, law):
    switch = law_switch(drive, ["a", "b"]).simulator()
    switch.step(law=1, u_a_Nm=0.1, u_b_Nm=0.2)
    out = switch.step(law=law, u_a_Nm=0.1, u_b_Nm=0.2)
    assert out["law_held"] == 1
    assert out["status"] & 1


def test_the_check_of_the_law_in_force_decides(drive):
    switch = law_switch(drive, ["a", "b"], checked=["b"]).simulator()
    given = {"u_a_Nm": 0.0, "u_b_Nm": 0.0}
    assert switch.step(law=0, ok_b=0, **given)["request_ok"] == 1
    assert switch.step(law=1, ok_b=1, **given)["request_ok"] == 1
    assert switch.step(law=1, ok_b=0, **given)["request_ok"] == 0


@pytest.fixture(scope="module")
def both():
    return load_device("elbow_drive", "smc,mpc")


@pytest.fixture(scope="module")
def loop(both):
    """Its loop with the real plant."""
    require_tool("gcc")
    variant = real_plant(both, seed=0).having(PEOPLE["none"], clamped=1.0)
    return ClosedLoop(both.system, variant, "f32")


def tuning(device, loop, law):
    """The tuning case on the real plant, laws changed at given times."""
    (case,) = load_study("tuning", ClosedLoopStudy).cases()
    variant = loop.variant

    def with_law(signals, *rest, **more):
        told = signals | {"law": np.broadcast_to(law, len(signals["mode"])).astype(float)}
        return ClosedLoop.run(loop, told, *rest, **more)

    loop.run = with_law
    return case, run_on(loop, device, variant, case, Setting("smc,mpc", "real", "none", "f32"), 0)


@pytest.mark.ci
def test_two_laws_in_one_system_change_without_a_bump(both, loop, tmp_path):
    assert [law.name for law in both.laws] == ["sliding_mode", "predictive"]
    (case,) = load_study("tuning", ClosedLoopStudy).cases()
    t = np.arange(len(case.trajectory.tau_desired_Nm)) * 1e-3
    case, run = tuning(both, loop, ((t >= CHANGE_S[0]) & (t < CHANGE_S[1])).astype(float))
    assert set(run.controller["law_held"].tolist()) == {0.0, 1.0}
    u, window = (
        run.controller["u_Nm"],
        slice(int(1e3 * CHANGE_S[0]) - 100, int(1e3 * CHANGE_S[1]) + 200),
    )
    # A step of the command where laws change is no larger than where they do not.
    jumps = np.abs(np.diff(u))
    near = np.zeros(len(jumps), dtype=bool)
    for change in CHANGE_S:
        near[int(1e3 * change) - 2 : int(1e3 * change) + 12] = True
    assert jumps[near].max() <= np.quantile(jumps[window][~near[window]], 0.999)
    # Armed: the laws themselves are further apart than that at the change.
    first = int(1e3 * CHANGE_S[0]) + 10
    alone = tuning(both, loop, 1.0)[1].controller["u_Nm"]
    assert abs(alone[first] - u[first - 12]) > 1.5 * jumps[near].max()
    # Until the first change it is the sliding mode alone, to the bit; the torque follows always.
    # Predictive control beside it asks for a release after 2 ms, and for a quicker decay.
    alone_at_2_ms = tmp_path / "smc.toml"
    slower = {"timing": {"control_release_s": 0.002}, "disturbance": {"decay_s": 0.1}}
    alone_at_2_ms.write_text(own_text('laws = ["sliding_mode"]\n', **slower))
    single = run_case(case, Setting(str(alone_at_2_ms), "real", "none", "f32"), 0)
    until = int(1e3 * CHANGE_S[0])
    assert np.array_equal(u[:until], single.controller["u_Nm"][:until])
    error = run.plant["tau_e_Nm"] - case.trajectory.tau_desired_Nm
    assert np.sqrt(np.mean(error[case.trajectory.window] ** 2)) < 0.1
    assert not run.controller["fault"][case.trajectory.window].any()


def test_laws_that_want_a_block_otherwise_do_not_go_together(drive):
    def other(name: str) -> Law:
        def parts(base):
            human = {"human": lag_observer(base.device) if name == "a" else base.blocks["drive"]}
            return Parts({name: drive.system.blocks["smc"]}, f"{name}.u_command_Nm", replaced=human)

        return Law(name, "", parts)

    with pytest.raises(UserError, match=r"the laws a and b both have a Block 'human' of their own"):
        control_system(drive, [other("a"), other("b")], drive.velocity, drive.sensor, lambda: None)
    # What both want alike they have once.
    blocks = list(load_device("elbow_drive", "smc,cascade").system.blocks)
    assert blocks.count("lead") == blocks.count("set_trend") == 1
    assert {"smc", "cascade"} <= set(blocks)


# -- several axes ----------------------------------------------------------------------------------


@pytest.mark.ci
def test_two_active_axes_need_no_second_wiring(drive):
    """Each axis does what the drive of one axis does, bit for bit; a stop stops both."""
    require_tool("gcc")
    zeros = {f"encoder.{side}": {"zero_rad": 0.0} for side in ("motor", "load")}
    pair = own_device('axes = ["flexion", "deviation"]\n', name="pair", **zeros)
    one, two = (compile_device(d, "f32").board(zeros_missing(d.system)) for d in (drive, pair))
    sense, control = drive.system.tasks
    rng = np.random.default_rng(5)
    bits = 2 ** int(drive.file.encoder.resolution_bits.value)
    stopped = 0
    # The drive obeys: motor and motion may not contradict each other.
    numbers = {c.name: c.value for c in drive.constants("actuator")}
    motor = NominalDrive(numbers, drive.period_s, 0.8)
    shaft = 2 ** int(numbers["encoder_bits"])
    for tick in range(900):
        wave = 0.02 * math.sin(0.01 * tick)
        turned = motor.theta_rad / (2 * math.pi)
        given = {
            "count_motor": float(round(turned * bits)),
            "count_load": float(round((0.8 + wave) / (2 * math.pi) * bits)),
            "count_gear": float(round(turned * numbers["gear_ratio"] * shaft) % shaft),
            "frame_error_motor": 0.0,
            "frame_error_load": 0.0,
            "frame_error_gear": 0.0,
            "mode": float(tick > 60),
            "stop": float(tick == 700),
            "rearm": float(tick > 30),
            "tau_desired_Nm": float(np.float32(rng.uniform(-0.5, 0.5))),
            "theta_desired_rad": 0.8,
            "omega_desired_rad_s": 0.0,
        }
        one.release(tick)
        two.release(tick)
        for task in (sense, control):
            if tick % task.every:
                continue
            names = [x.name for x in drive.system.task_inputs(task)]
            single = one.step(task.name, **{n: given[n] for n in names})
            faults = []
            for axis in pair.axes:
                own = pair.system.task(f"{task.name}_{axis}")
                asked = {
                    x.name: given[x.name.replace(f"_{axis}", "")]
                    for x in pair.system.task_inputs(own)
                }
                assert len(asked) == len(names)
                out = two.step(own.name, **asked)
                for name, value in out.items():
                    assert value == single[name.replace(f"_{axis}", "")], name
                faults += [out[f"fault_{axis}"]] if task is sense else []
            if task is sense:
                motor.move(float(single["u_Nm"]), float(single["tau_Nm"]))
                stopped += tick >= 700 and min(faults) > 0
    assert stopped == 200


# -- a law from outside the package ----------------------------------------------------------------


@pytest.mark.ci
def test_every_command_takes_a_law_from_outside(tmp_path):
    require_tool("gcc")
    outside = ("elbow_drive", "--controller", EXAMPLE)
    code, shown, _ = typed.command("build", *outside, "--out", tmp_path / "c")
    assert code == 0
    header = (tmp_path / "c" / "f32" / "esea_elbow_drive.h").read_text()
    assert "--controller proportional.py:LAW" in header  # no path of this machine
    assert str(tmp_path) not in header
    for command in (
        ("verify", "--real", "f32", "--block", "proportional"),
        ("coverage", "--block", "proportional"),
    ):
        code, shown, error = typed.command(command[0], *outside, *command[1:])
        assert code == 0, (command, shown, error)
        assert "proportional" in shown


@pytest.mark.parametrize(
    ("controller", "said"),
    [
        ("sliding_mod", r"Unknown controller 'sliding_mod'.*Did you mean sliding_mode\?"),
        ("nope.toml", r"There is no controller 'nope.toml'"),
        ("mine.py", r"the law is not named"),
        ("nowhere.py:LAW", r"there is no file nowhere\.py"),
        (EXAMPLE.replace(":LAW", ":LAV"), r"no law 'LAV' in it.*Did you mean LAW\?"),
        ("broken.py:LAW", r"broken\.py, line 1: cannot be imported \(ZeroDivisionError"),
        ("leaves.py:LAW", r"leaves\.py, line 1: cannot be imported \(SystemExit"),
        ("fails.py:LAW", r"fails\.py, line 2: law x: division by zero \(ZeroDivisionError\)"),
        ("smc,smc", r"names one twice"),
    ],
)
def test_a_law_that_is_not_there_is_named(monkeypatch, tmp_path, controller, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.py").write_text("1 / 0\n")
    (tmp_path / "leaves.py").write_text("raise SystemExit(3)\n")
    law = "from esea_gen.control.law import Law\nLAW = Law('x', '', lambda base: 1 / 0)\n"
    (tmp_path / "fails.py").write_text(law)
    code, _, error = typed.command("build", "elbow_drive", "--controller", controller)
    assert code == 2
    assert re.search(said, error), error


def test_a_device_that_only_measures_has_no_controller():
    with pytest.raises(UserError, match="no drive that a controller could move"):
        load_device("elbow", "sliding_mode")
    with pytest.raises(UserError, match=r"\[actuator\] is missing"):
        load_device("elbow", "mpc")
    assert esea_gen.load_device("elbow").drive is None


def test_a_law_without_a_wire_says_which(drive):
    stray = law_switch(drive, ["a", "b"])
    law = Law("stray", "", lambda base: Parts(control={"s": stray}, command="s.u_command_Nm"))
    with pytest.raises(ValueError, match=r"no wire for s\.law"):
        control_system(drive, [law], drive.velocity, drive.sensor, lambda: drive.inverse)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("controller", "board"),
    [("mpc", "netduinoplus2"), pytest.param("smc,mpc", "mps2-an500", marks=pytest.mark.slow)],
)
def test_the_emulated_board_runs_every_law(tmp_path, controller, board):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    found = tmp_path / "a.json"
    arguments = ("emulate", "elbow_drive", "--controller", controller, "--seconds", "0.1")
    arguments += ("--board", board)
    code, shown, error = typed.command(*arguments, "--json", found)
    assert code == 0, (shown, error)
    tasks = json.loads(found.read_text())["tasks"]
    assert {n: t["steps"] for n, t in tasks.items()} == {"sense": 100, "control": 20}
    assert all(t["identical"] for t in tasks.values())
