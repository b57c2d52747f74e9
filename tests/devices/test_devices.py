"""All shipped devices, the dead zone, several axes, and new device files."""

from __future__ import annotations

import re
import tomllib
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from jsonschema import Draft7Validator

import esea_gen
from esea_gen.device import parse_device
from esea_gen.devices.fields import SCHEMA_FILE
from esea_gen.devices.file import shipped_devices
from esea_gen.devices.schema import json_schema
from esea_gen.emit.walker import walk
from esea_gen.errors import UserError
from esea_gen.hostlib import compile_device
from esea_gen.language.ports import unit_of
from esea_gen.verify.bounds import derive_bounds
from esea_gen.verify.compare import compare
from esea_gen.verify.runs import CasadiOracle
from esea_gen.verify.streams import domain_chirp, recorded_stream, streams
from tests.cli.test_cli import refused, run

BOARDS = ("elbow_board", "knee_board", "wrist_board")  # from counts of encoders
NAMES = ("elbow", "knee", "knee_printed", "wrist", *BOARDS)  # those that measure
DRIVES = ("elbow_drive", "elbow_mpc", "wrist_drive")

READINGS = ("knee", "knee_printed")
DEAD_ZONE = np.deg2rad(2.81)


def beyond(theta):
    """Equations 8.7 and 8.8 as printed."""
    return np.sign(theta) * np.maximum(np.abs(theta) - DEAD_ZONE, 0)


@pytest.fixture(scope="module", params=NAMES)
def device(request):
    return esea_gen.load_device(request.param)


# -- every shipped device ----------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_reads_back_equal_and_conforms_to_the_schema(name):
    drive = esea_gen.load_device(name)
    assert parse_device(drive.toml(), "again.toml").digest == drive.digest
    assert conforms(tomllib.loads(drive.toml()), json_schema()) == []
    # The file as it is written gives only what differs from the device that it extends.
    short = tomllib.loads(shipped_devices()[name].read_text())
    assert conforms(short, json_schema()) == []
    assert conforms({k: v for k, v in short.items() if k != "extends"}, json_schema()) != []
    assert conforms(short | {"extends": "nothing"}, json_schema()) != []


def test_it_reads_back_equal_and_has_its_file_name(device):
    assert parse_device(device.toml(), "again.toml").digest == device.digest
    assert device.origin == f"{device.name}.toml"
    for key, q in device.quantities():
        assert q.source, key


# The elbow: test_equivalence.  The wrist has the elbow's bits: below.  As printed the knee is the
# same C with two other constants.
@pytest.mark.ci
@pytest.mark.parametrize(("name", "reals"), [("knee", "f64 f32"), ("knee_printed", "f64")])
def test_its_c_equals_its_model(name, reals):
    device = esea_gen.load_device(name)
    libraries = {real: compile_device(device, real) for real in reals.split()}
    oracle = CasadiOracle(device.system)
    chirp = recorded_stream(device, domain_chirp(device, 1.0))
    for block in device.system.kinds:
        bounds = derive_bounds(device, block) if "f32" in libraries else {}
        for bound in bounds.values():
            for port, error in bound.outputs.items():
                if unit_of(port) == "Nm":
                    assert error < 0.1 * device.tau_full_scale_Nm, port
            if block.name == "sensor":
                assert bound.assumptions == ()  # the dead zone's edge is decided alike
        for real, library in libraries.items():
            peer = oracle if real == "f64" else None
            for stream in [*streams(block, steps=600), chirp[block.name]]:
                result = compare(device, block, library, stream, bounds, peer)
                assert result.passed, (result.block, result.stream, real, result.problems)
                if real == "f64":
                    assert result.bit_identical


# -- knee --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", READINGS)
def test_knee_static_torque_is_the_published_one(name):
    # spec/8: 31.0 Nm at 15 deg; 47.8 Nm needs about 18.4 deg.
    degrees = np.linspace(0, 20, 4001)
    theta = np.deg2rad(degrees)
    out, _ = (
        esea_gen.load_device(name)
        .sensor.simulator()
        .run({"theta_rad": theta, "omega_rad_s": 0 * theta})
    )
    torque = out["tau_spring_Nm"] + out["tau_hysteresis_Nm"]
    assert np.interp(15, degrees, torque) == pytest.approx(31.0, abs=0.05)
    assert np.interp(47.8, torque, degrees) == pytest.approx(18.4, abs=0.05)


@pytest.mark.parametrize(("name", "peak_Nm"), [("knee", 0.24), ("knee_printed", 0.04)])
def test_knee_rate_torque_in_both_readings(name, peak_Nm):
    # spec/8: peak tau_r at 15 deg and 3 Hz.
    amplitude, f_Hz = np.deg2rad(15), 3.0
    t = np.arange(0, 1, 1e-3)
    omega = 2 * np.pi * f_Hz
    inputs = {
        "theta_rad": amplitude * np.sin(omega * t),
        "omega_rad_s": amplitude * omega * np.cos(omega * (t - 5e-4)),
    }
    out, _ = esea_gen.load_device(name).sensor.simulator().run(inputs)
    assert np.max(np.abs(out["tau_rate_Nm"])) == pytest.approx(peak_Nm, abs=0.005)


@cache
def knee_sensor(dead_zone: bool = True):
    text = esea_gen.load_device("knee").toml()
    bare = re.sub(r"\ndead_zone_rad.*", "", text)
    return parse_device(text if dead_zone else bare, "knee.toml").sensor


inside = st.floats(-0.999 * DEAD_ZONE, 0.999 * DEAD_ZONE)
anywhere = st.floats(-0.39, 0.39)
rates = st.floats(-20, 20)


@settings(max_examples=40)
@given(arrays(float, 20, elements=inside), arrays(float, 20, elements=rates))
def test_inside_the_dead_zone_there_is_no_torque(theta, omega):
    out, _ = (
        esea_gen.load_device("knee")
        .sensor.simulator()
        .run({"theta_rad": theta, "omega_rad_s": omega})
    )
    for port in ("tau_Nm", "tau_spring_Nm", "tau_rate_Nm", "tau_hysteresis_Nm"):
        assert not np.any(out[port])


@settings(max_examples=40)
@given(arrays(float, 20, elements=anywhere), arrays(float, 20, elements=rates))
def test_the_dead_zone_is_a_shift_of_the_deflection(theta, omega):
    # Spring and hysteresis are those of the device without a dead zone at delta; torque is odd.
    sensors = {"with": knee_sensor(), "mirror": knee_sensor(), "without": knee_sensor(False)}
    inputs = {"theta_rad": theta, "omega_rad_s": omega}
    run_of = {
        "with": inputs,
        "mirror": {k: -v for k, v in inputs.items()},
        "without": {"theta_rad": beyond(theta), "omega_rad_s": omega},
    }
    out = {n: s.simulator().run(run_of[n])[0] for n, s in sensors.items()}
    for port in ("tau_spring_Nm", "tau_hysteresis_Nm"):
        assert out["with"][port] == pytest.approx(out["without"][port], abs=2e-6)
    for port in ("tau_Nm", "tau_spring_Nm", "tau_rate_Nm", "tau_hysteresis_Nm"):
        assert out["with"][port] == pytest.approx(-out["mirror"][port], abs=1e-12)


@settings(max_examples=60)
@given(arrays(float, 6, elements=anywhere), rates, anywhere, anywhere)
def test_torque_rises_strictly_beyond_the_dead_zone(history, omega, one, other):
    # The viscosity holds nothing of theta(k): one torque, one deflection outside the dead zone.
    a, b = sorted((one, other))
    if beyond(b) - beyond(a) < 1e-6:
        return
    simulator = knee_sensor().simulator()
    simulator.run({"theta_rad": history, "omega_rad_s": 0 * history})
    state, torque = simulator.state, []
    for theta in (a, b):
        simulator.state = state
        y = simulator.step(theta_rad=theta, omega_rad_s=omega)
        torque.append(y["tau_spring_Nm"] + y["tau_rate_Nm"] + y["tau_hysteresis_Nm"])
    assert torque[1] > torque[0]


def test_the_dead_zone_is_checked(elbow):
    assert "dead_zone_rad" not in elbow.canonical()  # nothing changes for a device without it
    text = esea_gen.load_device("knee").toml()
    key = re.compile(r"dead_zone_rad = \{ value = [\d.]+")
    for value, words in (
        ("0.2", "elastomer.dead_zone_rad = 0.2 rad is above its limit 0.10472 rad"),
        ("-0.01", "below its limit 0 rad"),
    ):
        with pytest.raises(UserError, match=re.escape(words)):
            parse_device(key.sub(f"dead_zone_rad = {{ value = {value}", text), "x.toml")
    narrow = text.replace("value = 0.2617993877991494", "value = 0.04")
    with pytest.raises(UserError, match=r"not below domain\.theta_max_rad = 0\.04"):
        parse_device(narrow, "x.toml")
    # A dead zone of 0 is none.
    zero = parse_device(key.sub("dead_zone_rad = { value = 0.0", text), "x.toml").sensor
    without = parse_device(re.sub(r"\ndead_zone_rad.*", "", text), "x.toml").sensor
    assert walk(zero.step) == walk(without.step)


# -- wrist -------------------------------------------------------------------------------------


def test_wrist_axes_are_independent_elbows(elbow):
    wrist = esea_gen.load_device("wrist")
    rng = np.random.default_rng(3)
    theta = {
        f"theta_{axis}_rad": np.float32(np.cumsum(rng.normal(0, 0.002, 400)))
        for axis in ("flexion", "deviation")
    }
    both, _ = compile_device(wrist, "f32").task("sense").run(theta, trace=False)
    for axis in ("flexion", "deviation"):
        one, _ = (
            compile_device(elbow, "f32")
            .task("sense")
            .run({"theta_rad": theta[f"theta_{axis}_rad"]}, trace=False)
        )
        for port, name in (
            ("tau_Nm", f"tau_{axis}_Nm"),
            ("omega_rad_s", f"omega_{axis}_rad_s"),
            ("sensor_status", f"sensor_{axis}_status"),
        ):
            assert both[name].tobytes() == one[port].tobytes()


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ('["flexion", "flexion"]', "names an axis twice"),
        ('["Flexion"]', "lower case letters"),
        ('["x_1"]', "lower case letters"),
        ('"flexion"', "lower case letters"),
        ('["a", "b", "c", "d", "e", "f", "g"]', "up to 6 names"),
    ],
)
def test_wrong_axes_are_said(axes, words):
    text = esea_gen.load_device("wrist").toml()
    with pytest.raises(UserError, match=words):
        parse_device(text.replace('["flexion", "deviation"]', axes), "x.toml")


# -- new device files and their schema ---------------------------------------------------------


def test_new_writes_a_file_that_builds(tmp_path):
    done = run("new", "shoulder", "--from", "knee", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == [SCHEMA_FILE, "shoulder.toml"]
    text = (tmp_path / "shoulder.toml").read_text()
    assert text.startswith(f"#:schema ./{SCHEMA_FILE}\n")
    device = esea_gen.load_device(tmp_path / "shoulder.toml")
    assert device.name == "shoulder"
    values = {k: q.value for k, q in esea_gen.load_device("knee").quantities()}
    assert {k: q.value for k, q in device.quantities()} == values
    for key, q in device.quantities():
        assert q.status == "assumed", key
        assert q.source.startswith("copied from knee: "), key
    # A comment above every key.
    lines = text.splitlines()
    for i, line in enumerate(lines):
        if re.match(r"\w+ = \{", line):
            assert lines[i - 1].startswith("# "), line
    assert (
        run("build", "shoulder.toml", "--real", "f32", "--out", "o", cwd=tmp_path).returncode == 0
    )
    assert (tmp_path / "o/f32/esea_shoulder.c").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["new", "taken"], ["taken.toml exists already", "--out"]),
        (["new", "mine", "--out", "taken.toml"], ["taken.toml exists already"]),
        (["new", "My-Device"], ["'My-Device'", "lower case letter"]),
        (["new", "a234567890123456"], ["up to 14"]),
        (["new", "mine\n"], ["lower case letter"]),
        (["new", "elbow"], ["'elbow' is a shipped device"]),
        (["new", "mine", "--from", "ellbow"], ["Did you mean elbow"]),
        (["new", "mine", "--out", "taken.toml/x.toml"], ["taken.toml"]),
    ],
)
def test_new_refuses_and_leaves_nothing(tmp_path, arguments, words):
    (tmp_path / "taken.toml").write_text("precious")
    message = refused(run(*arguments, cwd=tmp_path))
    for word in words:
        assert word in message
    assert [p.name for p in tmp_path.iterdir()] == ["taken.toml"]
    assert (tmp_path / "taken.toml").read_text() == "precious"


def conforms(value, schema) -> list[str]:
    return [e.message for e in Draft7Validator(schema).iter_errors(value)]


def test_shipped_files_conform_to_the_schema(device):
    assert conforms(tomllib.loads(device.toml()), json_schema()) == []
    assert conforms(tomllib.loads(shipped_devices()[device.name].read_text()), json_schema()) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("value = 83.0", "value = -83.0"),
        ("value = 83.0", "value = 8300.0"),
        ("value = 83.0", 'value = "83"'),
        ('status = "published"', 'status = "guessed"'),
        ("k1_Nm_rad =", "k1_Nmm_rad ="),
        ("stops = { value = 10,", "stops = { value = 10.5,"),
        ('name = "knee"', 'name = "My Knee"'),
        ("schema = 1", "schema = 2"),
        ("[velocity]", "[speed]"),
        ("value = 0.04904375198104066", "value = 0.2"),
        ("value = 83.0, ", "value = 83.0, why = 1, "),
    ],
)
def test_schema_and_reader_refuse_the_same(old, new):
    text = esea_gen.load_device("knee").toml()
    assert old in text
    text = text.replace(old, new, 1)
    assert conforms(tomllib.loads(text), json_schema())
    with pytest.raises(UserError):
        parse_device(text, "x.toml")


def test_schema_describes_every_key():
    def check(node, where):
        assert node.get("description"), where
        for key, sub in node.get("properties", {}).items():
            check(sub, f"{where}.{key}")

    check(json_schema(), "device")
