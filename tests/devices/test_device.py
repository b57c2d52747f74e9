"""Device files: accepted content, and messages on the rest."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.device import Device, copy_device, load_device, parse_device
from esea_gen.devices.file import shipped_controllers, shipped_devices
from esea_gen.errors import UserError
from esea_gen.language.ports import Tunable
from esea_gen.observe.human import error_matrix
from tests.own_device import own_text as own

ELBOW = shipped_devices()["elbow"].read_text()


def refuse(text: str) -> str:
    with pytest.raises(UserError) as caught:
        parse_device(text, "mine.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("k1_Nm_rad =", "k1_Nmm_rad =", ["unknown key elastomer.k1_Nmm_rad", "k1_Nm_rad"]),
        ("theta_max_rad =", "theta_max_deg =", ["domain.theta_max_deg", "'deg'", "theta_max_rad"]),
        ("value = 9.39", "value = -9.39", ["k1_Nm_rad = -9.39 Nm/rad", "limit 0 Nm/rad"]),
        ("value = 9.39", "value = 9390.0", ["limit 1000", "Give a value from 0 to 1000 Nm/rad"]),
        ("value = 9.39", 'value = "9.39"', ["elastomer.k1_Nm_rad.value", "valid number"]),
        ("value = 9.39", "value = nan", ["elastomer.k1_Nm_rad.value", "finite"]),
        ("value = 10,", "value = 10.5,", ["elastomer.stops", "10.5", "whole"]),
        ('status = "assumed"', 'status = "guessed"', ["status", "guessed", "published"]),
        ("[velocity]", "[speed]", ["unknown key speed", "velocity"]),
        ('name = "elbow"', 'name = "My Elbow"', ["name", "My Elbow", "pattern"]),
        ("schema = 1", "schema = ", ["not valid TOML"]),
        ("schema = 1", "schema = 1\nschema = 1", ["not valid TOML", "schema"]),
        ("thesis table 3.2", "x */ #error", ["source", "*/", "comment"]),
        ('title = "Elbow', 'title = "a\\u000aElbow', ["title", "control character"]),
    ],
)
def test_what_is_wrong_is_said(old: str, new: str, words: list[str]):
    assert old in ELBOW
    message = refuse(ELBOW.replace(old, new, 1))
    for word in [*words, "mine.toml"]:
        assert word in message, message


def test_all_problems_at_once_each_with_its_line():
    text = ELBOW.replace("value = 9.39", 'value = "9"').replace("schema = 1", "schema = 2")
    text = text.replace("alpha_Nm_rad =", "alpa_Nm_rad =") + "[sped]\n"
    lines = text.splitlines()
    said = refuse(text).splitlines()
    wanted = ["schema = 2", 'value = "9"', "alpa_Nm_rad", "[sped]"]
    places = [1 + next(i for i, x in enumerate(lines) if w in x) for w in wanted]
    assert said[0] == "mine.toml: 4 problems. "
    assert [int(re.match(r"- mine.toml, line (\d+): ", x)[1]) for x in said[1:]] == sorted(places)
    assert sum("alpha_Nm_rad" in x for x in said) == 1  # misspelt, and not missing besides
    # Bounds are looked at once the form is right, relations once the bounds are.
    text = ELBOW.replace("value = 9.39", "value = -1.0").replace("value = 10,", "value = 10.5,")
    low, whole = refuse(text).splitlines()[1:]
    assert re.search(r"line \d+: .*below its limit 0", low)
    assert "10.5" in whole
    with pytest.raises(UserError, match=r"at line 3.*\): title title"):
        parse_device("schema = 1\n\ntitle title\n", "mine.toml")


def told(text: str, name: str = "mine.toml") -> dict[str, str]:
    """What is said of a device's gains, by section."""
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        parse_device(text, name)
    return {str(n.message).split(": ")[1]: str(n.message) for n in notes}


def test_gains_of_another_rate_or_stiffness_are_told_of():
    """Which, designed for what, what it is here, and the command that helps; own ones are not."""
    assert told(own(elastomer={"k1_Nm_rad": 10.0}, joint={"Jh_kgm2": 0.21})) == {}  # near enough
    stiff = {"k1_Nm_rad": 20.0, "k3_Nm_rad3": 250.0}
    said = told(own(timing={"control_rate_Hz": 500.0}, elastomer=stiff))
    assert set(said) == {"sliding_mode", "passivity"}
    for words in (
        "lambda_1_s = 15, phi_rad_s = 1.5 are elbow_drive's",
        "timing.control_rate_Hz = 200 (here 500), elastomer.k1_Nm_rad = 9.39 (here 20)",
        "esea-gen tune --controller mine.toml",
    ):
        assert words in said["sliding_mode"]
    assert "esea-gen passivity --controller mine.toml" in said["passivity"]
    given = {"lambda_1_s": 15.0, "phi_rad_s": 1.5}
    assert set(told(own(timing={"control_rate_Hz": 500.0}, sliding_mode=given))) == {"passivity"}
    # A copy that was edited has the elbow's weights of predictive control as well.
    copied = copy_device(load_device("elbow_mpc"), "mine").toml()
    assert told(copied) == {}
    copied = copied.replace("value = 200.0", "value = 100.0", 1)
    assert set(told(copied)) == {"predictive", "passivity"}  # of the laws in force
    assert "elbow_mpc's" in told(copied)["predictive"]
    with pytest.warns(UserWarning, match=r"--controller mpc@wrist_drive\. To"):
        load_device("wrist_drive", "mpc")
    heavy = own(actuator={"J_kgm2": 0.05})  # a user's own of a shipped name
    assert "--controller elbow_drive.toml. To" in told(heavy, "elbow_drive.toml")["sliding_mode"]


def test_a_bandwidth_of_another_encoder_is_told_of():
    """Where another one suits by half as much again; not of a drive, whose loop has a say."""
    mine = own("[encoder]\n", "elbow")
    for bits, suited in ((10, "8.6 Hz"), (12, ""), (16, ""), (18, "26 Hz"), (20, "34 Hz")):
        entry = f'resolution_bits = {{ value = {bits}, status = "assumed", source = "mine" }}\n'
        said = told(mine + entry)
        assert set(said) == ({"velocity"} if suited else set())
        if suited:
            assert f"for {bits} bits {suited} suits" in said["velocity"]
    assert told(own(encoder={"resolution_bits": 20})) == {}
    own_choice = 'bandwidth_Hz = { value = 15.0, status = "assumed", source = "mine" }'
    assert told(mine + entry + "[velocity]\n" + own_choice) == {}


def test_the_shipped_devices_and_controllers_have_their_own_gains():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in shipped_devices():
            load_device(name)
        for name in shipped_controllers():
            load_device("elbow_drive", name)


@pytest.mark.filterwarnings("ignore:.*designed for")
@pytest.mark.parametrize(("rate_Hz", "inertia_kgm2"), [(2000.0, 0.22), (500.0, 0.5)])
def test_gains_for_another_rate_have_the_same_poles_in_time(rate_Hz, inertia_kgm2):
    """Of the observer's own error matrix; and a heavier limb wants more torque, nothing else."""
    numbers = {"timing": {"sense_rate_Hz": rate_Hz}, "joint": {"Jh_kgm2": inertia_kgm2}}
    if rate_Hz < 1000:
        numbers["timing"] |= {"control_rate_Hz": 250.0, "control_release_s": 1 / rate_Hz}
    said = told(own(**numbers))["disturbance"]
    found = re.findall(r"(gain_\w+) = ([\d.e+]+)[,.] ", said.split("poles")[1])
    gains = {k: float(v) for k, v in found}
    assert len(gains) == 4
    again = parse_device(own(**numbers, disturbance=gains), "mine.toml")
    poles_1_s, wanted_1_s = (
        np.sort_complex(np.log(np.linalg.eigvals(error_matrix(d)).astype(complex)) / d.period_s)
        for d in (again, load_device("elbow_drive"))
    )
    assert poles_1_s == pytest.approx(wanted_1_s, rel=0.01)  # gains are printed with four digits


def test_equal_devices_share_their_blocks_and_others_do_not():
    one, again = load_device("elbow_drive"), load_device("elbow_drive")
    assert again.system is one.system
    assert again.sensor is one.sensor
    # Another number, another file, other laws: each alone changes what is built or said.
    text = one.toml()
    other = parse_device(text.replace("9.39", "9.38"), one.origin)
    assert other.elastomer.k1_Nm_rad.value != one.elastomer.k1_Nm_rad.value
    assert other.system is not one.system
    assert parse_device(text, "elbow_drive.toml").system is one.system
    assert parse_device(text, "my.toml").system is not one.system
    law = replace(one.laws[0], title="another")
    assert Device(one.file, one.origin, (law,)).system is not one.system


def test_relations_between_values():
    wide = ELBOW.replace("value = 0.20071286397934789", "value = 0.9").replace(
        "value = 0.2007128639793479", "value = 0.9"
    )
    assert "domain.theta_max_rad = 0.9 is above limits.theta_rad = 0.35" in refuse(wide)
    slow = ELBOW.replace("sense_rate_Hz = { value = 1000.0", "sense_rate_Hz = { value = 100.0")
    assert "velocity.bandwidth_Hz = 15 Hz is above its limit" in refuse(slow)


@settings(max_examples=25)
@given(st.text(max_size=200))
def test_any_text_gives_a_clear_error(text: str):
    with pytest.raises(UserError, match=r"any\.toml"):
        parse_device(text, "any.toml")  # no text this short is a whole device file


# -- tunables at their bounds ---------------------------------------------------------------------


@pytest.mark.parametrize("bound", [0.001, 0.1, 0.221, 0.7, math.pi, 100.0, 1e-6, 1e5 / 3])
def test_the_named_bound_is_inside_and_two_roundings_beyond_is_not(bound: float):
    rounding = bound * 2.0**-23
    for sign in (1, -1):
        ends = sorted((sign * bound, sign * bound / 2))
        t = Tunable("x", sign * bound, *ends, "x")
        assert t.low <= t.default <= t.high
        # A float32 number, as far from the named bound as one rounding at most.
        assert float(np.float32(t.default)) == t.default == pytest.approx(sign * bound, rel=2**-23)
        # What float32 makes of the bound may lie beyond it, and is the bound too.
        assert t.low <= t.taken(float(np.float32(sign * bound))) <= t.high
        for beyond in (sign * (bound + 2.1 * rounding), math.nan, sign * math.inf):
            assert not t.low <= t.taken(beyond) <= t.high
            with pytest.raises(ValueError, match="outside"):
                Tunable("x", beyond, *ends, "x")
    inside = bound * 0.9
    assert Tunable("x", inside, 0.0, bound, "x").taken(inside) == inside
