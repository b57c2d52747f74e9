"""Tunables as parameters of the link: names and keys; and roles of what is outside."""

from __future__ import annotations

import re

import casadi as ca
import pytest

from esea_gen.device import load_device
from esea_gen.emit.parameters import fnv1a, link_parameters
from esea_gen.emit.roles import MotorAxis, board_roles
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task


def test_keys_are_published_hashes_and_ids_are_short_and_unlike():
    # Of the authors' own list of FNV-1a in 32 bits.
    for text, value in (("", 0x811C9DC5), ("a", 0xE40C292C), ("foobar", 0xBF9CF968)):
        assert fnv1a(text) == value
    for name in ("elbow", "elbow_drive", "elbow_mpc", "wrist"):
        found = link_parameters(load_device(name).system)
        assert len({p.id for p in found}) == len({p.key for p in found}) == len(found)
        assert all(re.fullmatch(r"[.\-a-zA-Z0-9_]{1,16}", p.id) for p in found)


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
