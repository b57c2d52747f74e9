"""A drive of one's own in a dozen numbers: zeros, relations, scaling, and how it is asked for."""

from __future__ import annotations

import math
import re
import warnings
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from esea_gen.cli import app
from esea_gen.device import copy_device, load_device, parse_device
from esea_gen.devices.scaled import POWERS
from esea_gen.devices.short import QUESTIONS, short_text
from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.run import run_case
from esea_gen.twin.trajectories import fixed_sinusoid
from tests.devices.test_device import own, told

ELBOW = dict(load_device("elbow_mpc").quantities())
WRIST = dict(load_device("wrist_drive").quantities())
# Those two drives' rotors, by which their inertia at the joint is a rotor's behind the gear.
ROTORS = {"elbow_drive": 0.663 / 74**2, "wrist_drive": 0.05 / 36**2}


def answers(numbers, rotor_kgm2: float) -> dict[str, float]:
    return {
        q.name: rotor_kgm2 if q.name == "rotor_kgm2" else numbers[q.key].value for q in QUESTIONS
    }


def short(numbers, rotor_kgm2: float, **other: float):
    given = answers(numbers, rotor_kgm2) | other
    return parse_device(short_text("mine", "elbow_mpc", given), "mine.toml")


# -- zeros ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", ["elbow_drive", "wrist_drive", "elbow_mpc"])
def test_no_zero_is_taken_over(base):
    """Neither by a file that extends, nor by a copy; a zero of one's own stays."""
    head = f'schema = 1\nextends = "{base}"\nname = "mine"\ntitle = "mine"\n'
    zero = '[encoder.load]\nzero_rad = { value = 0.1, status = "identified", source = "rig" }\n'
    for device in (parse_device(head, "mine.toml"), copy_device(load_device(base), "mine")):
        sides = device.file.encoder.motor, device.file.encoder.load
        assert [side.zero_rad for side in sides] == [None, None]
    assert parse_device(head + zero, "mine.toml").file.encoder.load.zero_rad.value == 0.1
    assert load_device(base).file.encoder.load.zero_rad is None  # C without a zero does not arm


@pytest.mark.ci
def test_a_board_whose_encoders_have_no_zero_does_not_arm():
    """An unloaded joint, one encoder 3 deg off, the firmware: no torque until it is zeroed."""
    from esea_gen.board.sim import SimBoard

    board = SimBoard(parse_device(own(), "mine.toml"))
    try:
        board.measure(count_motor=0, count_load=round(3 / 360 * 2**12), count_gear=0)
        board.ticks(50)
        assert board.state_now == "UNREFERENCED"
        with pytest.raises(LinkError, match="UNREFERENCED"):
            board.arm()
        board.ticks(50)
        assert not board.motor_on
        board.zero()
        board.ticks(400)
        assert board.state_now == "READY"
        board.arm()
        board.ticks(5)
        assert board.motor_on
    finally:
        board.close()


@pytest.mark.ci
@pytest.mark.parametrize("name", ["elbow_drive", "elbow_mpc", "wrist_drive"])
def test_a_shipped_drives_board_takes_no_zero_from_the_device_file(name):
    """Theirs is the virtual exoskeleton's: a board with nothing stored waits to be zeroed."""
    from esea_gen.board.sim import SimBoard

    with closing(SimBoard(load_device(name))) as board:
        board.ticks(100)
        with pytest.raises(LinkError, match="UNREFERENCED"):
            board.arm()


# -- relations ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sections", "section", "words"),
    [
        # The elbow's inertia behind another gear, as it came and as somebody typed it.
        ({"actuator": {"gear_ratio": 20.0}}, "actuator", "the joint by 6.7 rad/s^2, below 10"),
        ({"actuator": {"gear_ratio": 20.0, "J_kgm2": 0.663}}, "actuator", "a rotor of 0.0017"),
        ({"actuator": {"u_max_Nm": 0.05}, "safety": {"u_max_Nm": 0.05}}, "actuator", "3.7 Nm"),
        ({"safety": {"u_max_Nm": 5.0}, "actuator": {"u_max_Nm": 5.0}}, "actuator", "above 10"),
        ({"actuator": {"tau_c_s": 0.5}}, "actuator", "follow up to 0.32 Hz"),
        ({"safety": {"tau_max_Nm": 4.0}}, "safety", "trips below full scale"),
        ({"elastomer": {"k1_Nm_rad": 1.0, "k3_Nm_rad3": 1.0}}, "safety", "never trips"),
        ({"joint": {"Jh_kgm2": 0.01}}, "joint", "at 4.9 Hz, above 3.5: sliding mode and cascade"),
        ({"elastomer": {"k1_Nm_rad": 83.0}}, "domain", "errors in % of full scale mislead"),
        ({"elastomer": {"k1_Nm_rad": 1000.0}}, "timing", "is 8 times the resonance"),
    ],
)
def test_what_is_unwise_is_told(sections, section, words):
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        parse_device(own(**{"timing": {"control_rate_Hz": 100.0}} | sections), "mine.toml")
    found = [str(n.message) for n in notes if f": {section}: " in str(n.message)]
    assert any(words in text for text in found), found


def test_an_inherited_inertia_names_what_the_same_motor_has():
    said = told(own(actuator={"gear_ratio": 37.0}))["actuator"]
    assert "J_kgm2 = 0.663, fv_Nms_rad = 0.5551, fc_Nm = 0.4688 are elbow_drive's" in said
    assert "J_kgm2 = 0.166, fv_Nms_rad = 0.139, fc_Nm = 0.234" in said  # a quarter, and half
    assert "actuator" not in told(own(actuator={"gear_ratio": 74.0}))


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"actuator": {"rotor_kgm2": 2e-4}}, r"J_kgm2 = 0\.663 is below .* 1\.0952\. Give J_kgm2"),
        ({"timing": {"sense_rate_Hz": 3000.0}}, r"not a whole number .* Give 3003\.003 Hz"),
        ({"actuator": {"fc_Nm": 17.0}}, r"fc_Nm = 17 is not below .* 16\.354: the motor cannot"),
        (
            {"timing": {"control_rate_Hz": 10.0}},
            r"10 Hz is 4\.1 times the resonance .* \(2\.42 Hz\), below its limit 6: .*48\.5 Hz",
        ),
    ],
)
def test_what_no_drive_can_be_is_refused(sections, words):
    with pytest.raises(UserError, match=words):
        parse_device(own(**sections), "mine.toml")


# -- scaling --------------------------------------------------------------------------------------


def test_the_elbow_in_its_own_numbers_is_the_elbow():
    made = dict(short(ELBOW, ROTORS["elbow_drive"]).quantities())
    for key in POWERS:
        assert made[key].value == pytest.approx(ELBOW[key].value, rel=2e-4), key


def test_the_elbow_scaled_to_a_wrist_has_what_was_designed_for_the_wrist():
    """The wrist's drive was designed by trials of its own."""
    made = dict(short(WRIST, ROTORS["wrist_drive"]).quantities())
    for key in (
        "actuator.J_kgm2",
        "disturbance.gain_tau_Nm_rad",
        "disturbance.gain_rate_Nm_s_rad",
        "passivity.Kp_max_Nm_rad",
        "sliding_mode.lambda_1_s",
        "sliding_mode.J_unc_kgm2",
        "safety.u_rate_Nm_s",
        "safety.energy_J",
    ):
        assert made[key].value == pytest.approx(WRIST[key].value, rel=0.1), key


def test_a_number_that_the_file_gives_is_left_as_it_is():
    text = short_text("mine", "elbow_drive", answers(ELBOW, 3e-4) | {"gear_ratio": 50.0})
    own_J = 'J_kgm2 = { value = 0.9, status = "identified", source = "rig" }\n'
    made = parse_device(text.replace("[actuator]\n", f"[actuator]\n{own_J}"), "mine.toml")
    assert made.file.actuator.J_kgm2.source == "rig"
    derived = parse_device(text, "mine.toml").file.actuator
    assert derived.J_kgm2.value == pytest.approx(0.75)
    assert derived.J_kgm2.status == "assumed"
    # A shaft that turns quicker than its encoder can be followed makes a slower drive.
    quick = short(ELBOW, 1e-6, gear_ratio=300.0).file
    assert quick.actuator.omega_max_rad_s.value == pytest.approx(0.8 * math.pi * 1000 / 600, 1e-3)


MPC = 'extends = "elbow_mpc"\n[predictive]\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scaled = true\n", r"scaled = True without extends"),
        ('extends = "elbow"\nscaled = true\n', r"elbow has no actuator\.gear_ratio to scale from"),
        ('extends = "elbow_drive"\nscaled = 1\n', r"scaled = 1"),
        ('extends = "elbow_drive"\nscalde = true\n', r"unknown key scalde.*Did you mean scaled"),
        ('extends = "elb"\n', r"extends = 'elb' is not a shipped device"),
        ('extends = "elbow_drive"\nlaws = "smc"\n', r"line 5: laws = 'smc'.*written FILE\.py:LAW"),
        ('extends = "elbow_drive"\nlaws = ["foo"]\n', r"Unknown law in mine\.toml: 'foo'"),
        ('extends = "elbow"\n[impairment]\n', r"wall_rad is missing .* shipped wrist_drive\.toml"),
        ('extends = "elbow_drive"\n[joint]\nJh_kgm2 = 5\n', r"Jh_kgm2 = 5: .*A number is written"),
        ('extends = "elbow_drive"\n[joint]\nJh_kgm2 = <"0,5">', r"point and no quotes: 0\.5"),
        (f"{MPC}long_intervals = <50>", r"mine\.toml: .*long_intervals = 50 is not below .* 6"),
        (f"{MPC}long_intervals = <0>\nintervals = <2>\ninterval_s = <1e-3>", r"0\.002 s, is below"),
    ],
)
def test_a_wrong_key_is_refused(text, words):
    text = text.replace("<", "{ value = ").replace(">", ', status = "assumed", source = "x" }')
    with pytest.raises(UserError, match=words):
        _ = parse_device(f'schema = 1\nname = "mine"\ntitle = "mine"\n{text}', "mine.toml").system


# -- how it is asked for --------------------------------------------------------------------------


def asked(monkeypatch, tmp_path, *words: str, typed: str | None = None) -> str:
    """What is printed or raised; with ``typed`` somebody is there to answer."""
    from typer.testing import CliRunner

    monkeypatch.chdir(tmp_path)
    if typed is not None:
        lines = iter(typed.splitlines())
        monkeypatch.setattr("esea_gen.cli.generate.terminal", lambda: True)
        monkeypatch.setattr("builtins.input", lambda _: next(lines, None) or "")
    done = CliRunner().invoke(app, ["new", "mine", "--short", *words])
    return done.output + str(done.exception or "")


GIVE = [w for k, v in answers(WRIST, 4e-5).items() for w in ("--give", f"{k}={v:g}")]


def test_without_a_terminal_what_is_missing_is_listed_and_nothing_written(monkeypatch, tmp_path):
    said = asked(monkeypatch, tmp_path, *GIVE[:-4])
    assert "2 of 12 numbers are missing" in said
    assert "--give encoder_bits=17" in said
    assert "control_rate_Hz in Hz, 10 to 10000" in said
    for wrong, words in (
        ("gear_ratio=x", "gear_ratio = 'x' is not a number"),
        ("gear_ratio=0.5", "gear_ratio = 0.5 is below its limit 1"),
        ("gear_ratio=1_0", "gear_ratio = '1_0' is not a number"),
        ("k1_Nm_rad=0", "k1_Nm_rad = 0 is invalid"),
        ("encoder_bits=12.5", "not a whole number"),
        ("gear_rato=74", "Did you mean gear_ratio"),
    ):
        assert words in asked(monkeypatch, tmp_path, "--give", wrong)
    # Sixty turns of a second: each number is right, and they are no drive.
    assert "rom" in asked(monkeypatch, tmp_path, *GIVE[:2], "--give", "rom_min_rad=2", *GIVE[4:])
    assert not list(tmp_path.iterdir())


def test_the_file_is_short_and_loads(monkeypatch, tmp_path):
    assert "device file: mine.toml" in asked(monkeypatch, tmp_path, *GIVE)
    text = (tmp_path / "mine.toml").read_text()
    assert len(re.findall(r"value = ", text)) == len(QUESTIONS) == 12
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing in it is designed for other numbers
        device = load_device(tmp_path / "mine.toml")
    assert device.file.actuator.J_kgm2.value == pytest.approx(4e-5 * 36**2, rel=1e-3)
    assert np.isfinite(device.sensor.simulator().step(theta_rad=0.1, omega_rad_s=0.0)["tau_Nm"])


def test_the_published_law_is_made_where_no_lead_but_1_is_stable(tmp_path):
    slow = answers(WRIST, 4e-5) | {"control_rate_Hz": 200}
    (tmp_path / "mine.toml").write_text(short_text("mine", "elbow_mpc", slow))
    smc = load_device(tmp_path / "mine.toml", "smc-published").system.blocks["smc"]
    assert {t.name: t.high for t in smc.tunables}["lead"] == 1


@pytest.mark.ci
def test_a_drive_of_a_tenth_of_the_torque_errs_by_a_tenth(tmp_path):
    """The same equations in other units: no threshold is of the elbow's torque alone."""
    path = fixed_sinusoid(1.7, 0.6)
    error_Nm = {}
    for share in (1.0, 0.1):
        numbers = answers(ELBOW, ROTORS["elbow_drive"] * share)
        numbers |= {
            n: share * numbers[n] for n in ("u_max_Nm", "k1_Nm_rad", "Jh_kgm2", "tau_max_Nm")
        }
        (tmp_path / "mine.toml").write_text(short_text("mine", "elbow_mpc", numbers))
        scaled = replace(path, tau_desired_Nm=share * path.tau_desired_Nm)
        setting = Setting(controller=str(tmp_path / "mine.toml"), plant="ideal")
        run = run_case(Case("sine", scaled), setting, seed=0)
        error = (run["tau_e_Nm"] - scaled.tau_desired_Nm)[scaled.window]
        error_Nm[share] = float(np.sqrt(np.mean(error**2)))
    assert error_Nm[0.1] == pytest.approx(0.1 * error_Nm[1.0], rel=0.05)


def test_on_a_terminal_each_number_is_asked_until_it_is_one(monkeypatch, tmp_path):
    said = asked(
        monkeypatch, tmp_path, typed="a lot\n0.35\n\n2.2\n40\n83\n50\n1.5\n3e-4\n\n\n\n250"
    )
    assert "12 of 12. Rate of the control task" in said
    assert "Jh_kgm2 = 'a lot' is not a number" in said
    made = load_device(tmp_path / "mine.toml").file
    (tmp_path / "mine.toml").unlink()
    said = asked(monkeypatch, tmp_path, typed="0.35\n2\n1\n" + "\n" * 9)
    assert "Nothing was written. To correct a number" in said  # the answers are not lost
    assert "--give Jh_kgm2=0.35" in said
    assert made.joint.Jh_kgm2.value == 0.35
    assert made.safety.rom_min_rad.value == -0.15  # Enter takes the typical one
    assert made.timing.control_rate_Hz.value == 250


@pytest.mark.parametrize(
    ("kit", "peak_A", "status"),
    [
        ("c1", 20.0, "published"),
        ("n1", 22.5, "published"),
        ("c1 --give u_max_Nm=.2", 7.3, "assumed"),
    ],
)
def test_of_a_motor_that_is_named_only_the_joint_is_asked(
    monkeypatch, tmp_path, kit, peak_A, status
):
    """The maker's words: torque constant 3/2 / sqrt(3) * 60 / (2 pi) over Kv, of the mj5208 304."""
    said = asked(monkeypatch, tmp_path, "--motor", *f"moteus-{kit}".split(), typed="\n" * 8)
    assert "8 numbers; Enter accepts the one in brackets" in said
    assert "Gear ratio from motor shaft to joint: gear_ratio, 1 to 1000, such as 30" in said
    a = load_device(tmp_path / "mine.toml").file.actuator
    constant = 1.5 / math.sqrt(3) * 60 / (2 * math.pi) / 304
    assert a.u_max_Nm.value == pytest.approx(peak_A * constant, rel=1e-2)
    assert (a.u_max_Nm.status, a.gear_ratio.status) == (status, "assumed")
    assert a.J_kgm2.value == pytest.approx(5.6e-5 * 30**2)
    settings = dict(
        line.split()[-2:]
        for line in (tmp_path / "mine.toml").read_text().splitlines()
        if "conf set" in line
    )
    assert settings["servo.timeout_mode"] == "0"
    assert float(settings["servo.max_current_A"]) == pytest.approx(peak_A, rel=1e-2)
    ratio = float(settings["motor_position.rotor_to_output_ratio"])
    assert ratio * a.gear_ratio.value == pytest.approx(1, rel=1e-6)


def test_a_motor_that_is_not_stored_or_gives_less_is_refused(monkeypatch, tmp_path):
    for words, said in (
        (("--motor", "moteus-c2"), "Unknown motor 'moteus-c2'. Did you mean moteus-c1?"),
        (("--motor", "moteus-c1", "--give", "u_max_Nm=1"), "above moteus-c1's limit 0.5461"),
        (("--motor", "moteus-c1"), "8 of 12 numbers are missing"),
        (("--motor", "moteus-c1", "--motor", "moteus-n1"), "--motor is given 2 times"),
        ((*GIVE[:2], *GIVE[:2]), "--give Jh_kgm2 is given twice"),
    ):
        assert said in asked(monkeypatch, tmp_path, *words)
    assert not list(tmp_path.iterdir())
