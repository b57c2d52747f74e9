"""The fixed stream of a drive, tick by tick: a drive, a System and a horizon that are made up."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.verify import drive_stream as made
from esea_gen.verify.drive_stream import LET_GO_S, drive_stream


def thing(**parts):
    return SimpleNamespace(**parts)


def external(name, size=1):
    return thing(name=name, port=thing(size=size))


@pytest.mark.parametrize(
    ("angle_rad", "turns", "full", "count"),
    [
        (0.0, 1.0, 16.0, 0),
        (math.pi, 1.0, 16.0, 8),
        (0.99 * math.pi, 1.0, 16.0, 7),
        (2.5 * math.pi, 1.0, 16.0, 4),
        (-0.01, 1.0, 16.0, 15),
        (-math.pi, 1.0, 16.0, 8),
        (math.pi / 2, 6.0, 16.0, 8),  # one turn and a half
        (0.3, 6.0, 1024.0, math.floor(0.3 * 6 / (2 * math.pi) * 1024)),
    ],
)
def test_a_count_of_an_angle_goes_round(angle_rad, turns, full, count):
    assert made._count(angle_rad, turns, full) == count


@pytest.mark.parametrize("angle_rad", [np.inf, -np.inf, np.nan])
def test_what_is_no_angle_is_no_count(angle_rad):
    found = made._count(angle_rad, 1.0, 16.0)
    assert found == angle_rad or (np.isnan(found) and np.isnan(angle_rad))


@pytest.mark.parametrize(
    ("name", "axes", "bare"),
    [
        ("count_motor", ("",), "count_motor"),
        ("count_motor_left", ("left", "right"), "count_motor"),
        ("tau_right_Nm", ("left", "right"), "tau_Nm"),
        ("tau_preview_left_Nm[1]", ("left",), "tau_preview_Nm[1]"),
        ("count_leftover", ("left",), "count_leftover"),
        ("left_gain", ("left",), "left_gain"),
    ],
)
def test_names_without_their_axis(name, axes, bare):
    assert made._without_axis(name, axes) == bare


# From the first second, to before the second one.
TIMES_S = {
    "frame_error_load": [(2.6, 2.602, 2)],
    "frame_error_gear": [(1.1, 1.102, 1)],
    "mode": [(0.06, 1.6, 1), (1.6, 2.9, 2), (3.4, 9.0, 1)],
    "stop": [(2.9, 2.92, 1)],
    "rearm": [(0.03, 3.2, 1), (3.2, 9.0, 2)],
    "law": [(0.7, 1.3, 1), (2.0, 2.5, 1)],
    "omega_desired_rad_s": [],
    "theta_desired_rad": [(0.0, 10.0, 0.8)],
}


@pytest.fixture(scope="module")
def signals():
    ticks = np.arange(9600)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(made, "device_horizon", lambda device: thing(ends_s=(0.005, 0.0404, 2.0)))
        return made._told(thing(system=thing(base_period_s=1e-3)), ticks / 1000)


@pytest.mark.parametrize("name", TIMES_S)
def test_what_a_person_or_a_fault_does_comes_at_its_time(signals, name):
    ticks = np.arange(9600)
    expected = np.zeros(len(ticks))
    for begin_s, end_s, value in TIMES_S[name]:
        expected[(ticks >= round(1000 * begin_s)) & (ticks < round(1000 * end_s))] = value
    np.testing.assert_array_equal(signals[name], expected)


def test_what_is_wanted_swings_on_a_lattice_and_is_known_ahead(signals):
    wanted = signals["tau_desired_Nm"]
    for k in (0, 1, 357, 1000, 1071, 9599):
        assert wanted[k] == round(2048 * math.sin(2 * math.pi * 0.7 * k / 1000)) / 4096
    assert wanted.max() == 0.5
    for i, ahead in enumerate((5, 40, 2000)):
        found = signals[f"tau_preview_Nm[{i}]"]
        np.testing.assert_array_equal(found[:-ahead], wanted[ahead:])
        assert set(found[-ahead:]) == {wanted[-1]}
        assert set(signals[f"theta_preview_rad[{i}]"]) == {0.8}
        assert not signals[f"omega_preview_rad_s[{i}]"].any()
    assert set(signals) == {
        *TIMES_S,
        "tau_desired_Nm",
        *(f"{n}[{i}]" for i in range(3) for n in (
            "tau_preview_Nm", "theta_preview_rad", "omega_preview_rad_s",
        )),
    }  # fmt: skip


class Drive:
    """A drive that turns by a tenth of its torque, and by a hundredth of the joint's."""

    def __init__(self, numbers, period_s, start_rad) -> None:
        assert (numbers, period_s) == ({"gain": 3.0}, 0.5)
        self.theta_rad = start_rad

    def move(self, u_Nm, tau_Nm):
        self.theta_rad += u_Nm / 10 + tau_Nm / 100


GIVEN: list[tuple] = []


class Simulator:
    """Two tasks; the slower one commands the tick's number."""

    def __init__(self) -> None:
        self.tick = -1

    def release(self, tick):
        assert tick == self.tick + 1
        self.tick = tick

    def step(self, name, **given):
        GIVEN.append((self.tick, name, given))
        if name == "sense":
            return {"angle_rad": 1.0}
        return {"u_left_Nm": self.tick, "tau_left_Nm": np.float64(-2.0 * self.tick)}


def drive(axes=("left",)):
    ends = {"sense": ["count_motor_left", "count_load_left", "count_gear_left"]}
    inputs = {t: [external(n) for n in names] for t, names in ends.items()}
    inputs["law"] = [external("mode"), external("wish", 2)]
    tasks = [thing(name="sense", every=1, phase=0), thing(name="law", every=3, phase=1)]
    system = thing(
        base_period_s=0.5,
        tasks=tasks,
        inputs=[x for found in inputs.values() for x in found],
        outputs=[external(n) for n in ("angle_rad", "tau_left_Nm", "u_left_Nm")],
        task_inputs=lambda t: inputs[t.name],
        simulator=Simulator,
    )
    quantity = thing
    actuator = quantity(gear_ratio=quantity(value=6.0), encoder_bits=quantity(value=5.0))
    encoder = quantity(resolution_bits=quantity(value=10.0))
    return thing(
        system=system, axes=axes, file=thing(actuator=actuator, encoder=encoder),
        constants=lambda group: [thing(name="gain", value={"actuator": 3.0}[group])],
    )  # fmt: skip


def count(angle_rad, turns, full):
    return math.floor(angle_rad * turns / (2 * math.pi) * full) % full


def test_the_drive_answers_to_its_commands_until_the_joint_is_let_go(monkeypatch):
    steps = 14
    wishes = {"mode": np.arange(float(steps)), "wish[1]": np.arange(10.0, 10 + steps)}
    monkeypatch.setattr(made, "NominalDrive", Drive)
    monkeypatch.setattr(made, "_told", lambda device, time_s: dict(wishes))
    GIVEN.clear()
    deflection_rad, told = 0.05 * np.arange(steps) - 0.1, []
    stream = drive_stream(drive(), deflection_rad, lambda *run: told.append(run))
    assert LET_GO_S == 5.2
    side, sides = 0.8, []
    for k in range(steps):
        sides.append(side)
        if k in (1, 4, 7, 10):  # the law's runs, while the motor is listened to: until 5.2 s
            side += k / 10 - 2 * k / 100
    joint = [0.8 + 0.25 * (1 - math.cos(0.4 * math.pi * k)) for k in range(steps)]
    loads = [joint[k] if k < 11 else sides[k] - deflection_rad[k] for k in range(steps)]
    assert stream["count_motor_left"].tolist() == [count(a, 1, 1024) for a in sides]
    assert stream["count_load_left"].tolist() == [count(a, 1, 1024) for a in loads]
    assert stream["count_gear_left"].tolist() == [count(a, 6, 32) for a in sides]
    assert list(stream) == [
        *("count_motor_left", "count_load_left", "count_gear_left", "mode", "wish[0]", "wish[1]"),
    ]
    assert not stream["wish[0]"].any()
    runs = [(k, "sense") for k in range(steps)] + [(k, "law") for k in (1, 4, 7, 10, 13)]
    assert (
        [(t, n) for t, n, _ in told]
        == [(t, n) for t, n, _ in GIVEN]
        == sorted(runs, key=lambda run: (run[0], run[1] == "law"))
    )
    assert told[2][2] == {"u_left_Nm": 1, "tau_left_Nm": -2.0}
    for tick, name, given in GIVEN:
        if name == "law":
            assert (given["mode"], given["wish"].tolist()) == (tick, [0, 10 + tick])
        else:
            assert given["count_load_left"] == count(loads[tick], 1, 1024)
