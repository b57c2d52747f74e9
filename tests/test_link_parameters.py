"""Tunables as parameters of the link: short names, keys, metadata; and roles of what is outside."""

from __future__ import annotations

import hashlib
import json

import casadi as ca
import pytest

from esea_gen.emit.parameters import fnv1a, link_parameters, parameter_metadata
from esea_gen.emit.roles import MotorAxis, board_roles
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task


def test_keys_are_published_hashes():
    # Of the authors' own list of FNV-1a in 32 bits.
    for text, value in (("", 0x811C9DC5), ("a", 0xE40C292C), ("foobar", 0xBF9CF968)):
        assert fnv1a(text) == value


def system(**tunables: tuple[str, ...]) -> System:
    """An instance of its own Block for each name, with these tunables, wired to nothing."""
    blocks = {}
    for k, (instance, names) in enumerate(tunables.items()):

        def step(c, _s, u, _guard, _label, names=names):
            return {}, {"y_Nm": u.x_Nm * sum(getattr(c, n) for n in names)}

        blocks[instance] = Block.define(
            f"kind{k}",
            "Any",
            period_s=0.001,
            tunables=tuple(
                Tunable(n, 1.0, 0.5, 2.0, f"meaning of {n}", "Zürich", "assumed") for n in names
            ),
            coefficients=tuple(Port(n, 0.5, 2.0, n) for n in names),
            prepare=lambda t, names=names: {n: 1 * getattr(t, n) for n in names},
            state=(),
            inputs=(Port("x_Nm", -1.0, 1.0, "in"),),
            outputs=(Port("y_Nm", -99.0, 99.0, "out"),),
            step=step,
        )
    inputs = {f"x{k}": (f"{i}.x_Nm",) for k, i in enumerate(blocks)}
    outputs = {f"y{k}": f"{i}.y_Nm" for k, i in enumerate(blocks)}
    return System("any", 0.001, blocks, (Task("run", tuple(blocks)),), {}, inputs, outputs)


def test_an_id_is_the_first_spelling_of_sixteen_characters():
    wanted = {
        ("gain", "k_Nm"): "gain.k_Nm",
        ("velocity", "band_Hz"): "velocity.band_Hz",  # sixteen
        ("velocity", "bandw_Hz"): "velocity.bandw",  # its unit goes first
        ("velocity", "bandwidth_Hz"): "vlcty.bandwidth",  # then the instance's vowels
        ("abcdefgh", "observation"): "abcdefgh.obsrvtn",  # then the tunable's
        ("sliding_mode", "boundary_layer_rad"): "sldng_m.bndry_lyr",
        ("reference", "approaching_limits_here"): "rfrnc.apprchng_lmts_hr",
    }
    tunables: dict[str, tuple[str, ...]] = {}
    for instance, name in wanted:
        tunables[instance] = (*tunables.get(instance, ()), name)
    found = {(p.instance, p.tunable.name): p for p in link_parameters(system(**tunables))}
    assert {k: p.id for k, p in found.items()} == {k: v[:16] for k, v in wanted.items()}
    one = found["velocity", "bandwidth_Hz"]
    assert (one.name, one.key) == ("velocity.bandwidth_Hz", fnv1a("velocity.bandwidth_Hz"))
    assert (one.enum_name, one.unit) == ("ESEA_PARAM_VELOCITY_BANDWIDTH_HZ", "Hz")
    assert (found["abcdefgh", "observation"].unit, one.block, one.fixed) == ("1", "kind1", False)


def test_two_ids_that_are_alike_end_in_a_digest():
    names = ("approaching_limits", "approaching_limit_is")
    made = link_parameters(system(controller=names, gain=("k",)))
    for p in made[:2]:
        digest = hashlib.sha256(p.name.encode()).hexdigest()[:3]
        assert p.id == f"cntrllr.appr_{digest}"
    assert [p.id for p in made[2:]] == ["gain.k"]


def test_metadata_of_a_parameter():
    text = parameter_metadata(system(gain=("k_Nm", "share")))
    assert text.startswith('{\n  "version": 3,\n  "parameters": [\n    {\n      "name"')
    assert text.endswith("}\n")
    assert "Zürich" in text
    found = json.loads(text)
    assert found["version"] == 3
    first, second = found["parameters"]
    assert first == {
        "name": "gain.k_Nm",
        "type": "Float",
        "shortDesc": "gain.k_Nm",
        "longDesc": "meaning of k_Nm. Default assumed: Zürich.",
        "units": "Nm",
        "default": 1.0,
        "min": 0.5,
        "max": 2.0,
        "group": "gain",
        "readOnly": False,
    }
    assert (second["name"], second["units"]) == ("gain.share", "")


# -- roles -----------------------------------------------------------------------------------------


def sensing(drive: bool, flags: tuple[str, ...] = ("INPUT_INVALID",), count: int = 1) -> System:
    """Encoders, what differs of them, a torque of that, and with a drive what wants and rearms."""
    flag = Flag("INPUT_INVALID", "bad")
    words = tuple(Flag(f, "bad") for f in flags)

    def angle(_c, _s, u, guard, _label):
        y = u.count * 1e-3 + 0 * u.frame_error
        return {}, {"theta_rad": y, "status": flag_word([ca.logic_not(guard.inputs_ok)])}

    encoder = Block.define(
        "encoder",
        "Encoder",
        period_s=0.001,
        tunables=(Tunable("zero_rad", 0.0, -1, 1, "zero"), Tunable("zeroed", 0.0, 0, 1, "known")),
        coefficients=(Port("zero_rad", -1.0, 1.0, "zero"),),
        prepare=lambda t: {"zero_rad": t.zero_rad * t.zeroed},
        state=(),
        inputs=(Port("count", 0, 4095, "count"), Port("frame_error", 0, 1, "bad frame")),
        outputs=(Port("theta_rad", -9.0, 9.0, "angle"), Port("status", 0, 1, "w", flags=(flag,))),
        step=angle,
    )

    def torque(_c, _s, u, guard, _label):
        bits = [ca.logic_not(guard.inputs_ok)] * len(words)
        return {}, {"tau_Nm": 4 * u.theta_rad, "status": flag_word(bits)}

    sensor = Block.define(
        "sensor",
        "Sensor",
        period_s=0.001,
        state=(),
        inputs=(Port("theta_rad", -0.25, 0.375, "deflection"),),
        outputs=(
            Port("tau_Nm", -9.0, 9.0, "torque"),
            Port("status", 0, 2 ** len(words) - 1, "w", flags=words),
        ),
        step=torque,
    )
    blocks: dict[str, Block] = {"encoder_motor": encoder}
    inputs = {"count_motor": ("encoder_motor.count",),
              "frame_error_motor": ("encoder_motor.frame_error",)}  # fmt: skip
    outputs = {"theta_motor_rad": "encoder_motor.theta_rad", "motor_status": "encoder_motor.status"}
    for k in range(count):
        blocks[f"sensor_{k}"] = sensor
        inputs[f"theta_{k}_rad"] = (f"sensor_{k}.theta_rad",)
        outputs |= {f"tau_{k}_Nm": f"sensor_{k}.tau_Nm", f"status_{k}": f"sensor_{k}.status"}
    if drive:

        def latch(_c, _s, u, _guard, _label):
            return {}, {"u_Nm": u.stop * u.rearm * 0.5, "tau_set_Nm": u.wish_Nm, "fault": 1}

        blocks["limits"] = Block.define(
            "limits",
            "Limits",
            period_s=0.001,
            state=(),
            inputs=(
                Port("stop", 0, 1, "stop"),
                Port("rearm", 0, 255, "rearm"),
                Port("wish_Nm", -9.0, 9.0, "wish"),
            ),
            outputs=(
                Port("u_Nm", -200.0, 200.0, "command"),
                Port("tau_set_Nm", -9.0, 9.0, "wish"),
                Port("fault", 0, 1, "why"),
            ),
            step=latch,
        )
        inputs |= {n: (f"limits.{n}",) for n in ("stop", "rearm")}
        inputs["tau_desired_bend_Nm"] = ("limits.wish_Nm",)
        outputs |= {
            "u_bend_Nm": "limits.u_Nm",
            "tau_set_bend_Nm": "limits.tau_set_Nm",
            "fault_bend": "limits.fault",
        }
    return System("any", 0.001, blocks, (Task("sense", tuple(blocks)),), {}, inputs, outputs)


def test_with_a_motor_all_but_counts_and_frames_is_wanted():
    roles = board_roles(sensing(True))
    assert roles.drive
    assert [x.name for x in roles.measured] == ["count_motor", "frame_error_motor"]
    assert roles.wanted_names == ("theta_0_rad", "stop", "rearm", "tau_desired_bend_Nm")
    assert roles.axes == (
        MotorAxis("sense", "u_bend_Nm", "tau_set_bend_Nm", "fault_bend", "tau_desired_bend_Nm", ()),
    )
    (zeroed,) = roles.encoders
    assert (zeroed.instance, zeroed.block, zeroed.theta, zeroed.status) == (
        "encoder_motor", "encoder", "theta_motor_rad", "motor_status",
    )  # fmt: skip
    plain = board_roles(sensing(False))
    assert not plain.drive
    assert (plain.wanted, plain.encoders) == ((), roles.encoders)
    assert [x.name for x in plain.measured] == ["count_motor", "frame_error_motor", "theta_0_rad"]


@pytest.mark.parametrize("flags", [("INPUT_INVALID", "OTHER"), ("OTHER", "ENCODER_UNUSABLE")])
def test_a_couplings_life_is_counted_from_its_deflection_and_torque(flags):
    (found,) = board_roles(sensing(True, flags)).couplings
    assert (found.sensor, found.side, found.theta, found.tau) == (
        "sensor_0", "in", "theta_0_rad", "tau_0_Nm",
    )  # fmt: skip
    assert (found.block, found.status) == ("sensor", "status_0")
    assert found.flags == tuple(f for f in flags if f != "OTHER")
    assert found.most_rad == 0.25  # the nearer end
    assert len(board_roles(sensing(False, count=6)).couplings) == 4


def torque_of(smoothed: str, told: tuple[str, ...], given=("angle_rad", "x_rad")) -> System:
    """A twist, a torque of it, and between them what smooths it, by the name of its input."""
    flags = (Flag("ENCODER_UNUSABLE", "bad"), Flag("OTHER", "other"), Flag("INPUT_INVALID", "bad"))

    def part(name: str, given: str, made: str, high: float) -> Block:
        def step(_c, _s, u, _guard, _label):
            x = getattr(u, given)
            return {}, {made: 0.5 * x, "status": flag_word([x > 0, x > 1, x > 2])}

        outputs = (Port(made, -0.75, high, "out"), Port("status", 0, 7, "w", flags=flags))
        ports = (Port(given, -9.0, 9.0, "in"),)
        return Block.define(
            f"{name}_kind",
            "Any",
            period_s=0.001,
            state=(),
            inputs=ports,
            outputs=outputs,
            step=step,
        )

    blocks = {
        "twist": part("twist", "angle_rad", "theta_rad", 0.5),
        "smooth": part("smooth", smoothed, "theta_rad", 0.25),
        "sensor": part("sensor", "theta_rad", "tau_Nm", 8.0),
        "other": part("other", "x_rad", "tau_Nm", 8.0),
    }
    wires = {f"smooth.{smoothed}": "twist.theta_rad", "sensor.theta_rad": "smooth.theta_rad"}
    inputs = dict(zip(given, (("twist.angle_rad",), ("other.x_rad",)), strict=True))
    outputs = {t.replace(".", "_"): t for t in told}
    return System("any", 0.001, blocks, (Task("sense", tuple(blocks)),), wires, inputs, outputs)


TOLD = ("sensor.tau_Nm", "sensor.status", "twist.theta_rad", "twist.status", "smooth.status")


@pytest.mark.parametrize(
    ("smoothed", "told", "expected"),
    [
        # What is told of the deflection that the sensor is given, else of what that is made from.
        ("theta_rad", TOLD, ("twist", 0.5)),
        ("theta_rad", (*TOLD, "smooth.theta_rad"), ("smooth", 0.25)),
        ("filtered_rad", (*TOLD, "smooth.theta_rad"), ("smooth", 0.25)),
        ("filtered_rad", TOLD, None),
        ("theta_rad", ("other.tau_Nm", "other.status", *TOLD[1:]), None),
        ("theta_rad", (*TOLD[:3], "smooth.status"), None),
        ("theta_rad", (*TOLD[:2], "smooth.status"), None),
    ],
)
def test_a_coupling_is_told_of_by_the_deflection_nearest_to_its_sensor(smoothed, told, expected):
    found = board_roles(torque_of(smoothed, told)).couplings
    if expected is None:
        assert found == ()
        return
    (coupling,) = found
    instance, most_rad = expected
    assert (coupling.sensor, coupling.side, coupling.tau) == ("sensor", "out", "sensor_tau_Nm")
    assert (coupling.theta, coupling.status, coupling.block) == (
        f"{instance}_theta_rad", f"{instance}_status", f"{instance}_kind",
    )  # fmt: skip
    assert coupling.flags == ("ENCODER_UNUSABLE", "INPUT_INVALID")
    assert coupling.most_rad == most_rad


def test_without_a_motor_all_but_a_stop_is_measured():
    roles = board_roles(torque_of("theta_rad", TOLD, ("stop", "rearming")))
    assert (roles.drive, roles.wanted_names) == (False, ("stop",))
    assert [x.name for x in roles.measured] == ["rearming"]


def test_only_a_calibration_sets_a_zero():
    fixed = {p.name: p.fixed for p in link_parameters(sensing(True))}
    assert fixed == {"encoder_motor.zero_rad": True, "encoder_motor.zeroed": True}
