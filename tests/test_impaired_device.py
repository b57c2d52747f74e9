"""The limits behind the simulated impairment: one instance an axis, latched, and still passive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.control.faults import Fault
from esea_gen.control.impaired import WIRES, motor_side
from esea_gen.control.impairment import impairment
from esea_gen.control.limits import limits
from esea_gen.device import parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.language.system import System, Task
from esea_gen.verify.sim import SimBoard
from esea_host.people.person import Limb
from esea_host.wrist.rig import Rig, impaired_device

from .conftest import require_tool

pytestmark = pytest.mark.ci

LIMB = Limb(0.003, 0.0, 0.05, 0.0, -1.4, 1.0)
REST = (8.0, 0.3, 0.0, 0.0, 3.0)
FULL_NM = 4.47
SPRING = {"Kd_Nms_rad": 0.0, "Kv_Nms_rad": 0.0}
WAY_IN = 40  # steps at rest: released, then constrained


@pytest.fixture(scope="module")
def device():
    require_tool("gcc")
    return impaired_device()


@pytest.fixture(scope="module")
def chain(device):
    """Impairment, motor side and limits of one axis, with everything else given from outside."""
    blocks = {"impairment": impairment(device), "side": motor_side(device)}
    blocks["limits"] = limits(device)
    wires = {r: w for r, w in WIRES.items() if w.split(".")[0] in blocks}
    shared = {
        "theta_load_rad": ("impairment.theta_rad", "side.theta_load_rad", "limits.theta_load_rad"),
        "omega_load_rad_s": (
            *("impairment.omega_rad_s", "side.omega_load_rad_s"),
            "limits.omega_load_rad_s",
        ),
        "theta_rad": ("side.theta_rad", "limits.theta_rad"),
    }
    fed = {*wires, *(s for sinks in shared.values() for s in sinks)}
    inputs = shared | {
        p.name: (f"{n}.{p.name}",)
        for n, b in blocks.items()
        for p in b.inputs
        if f"{n}.{p.name}" not in fed
    }
    outputs = {x: f"limits.{x}" for x in ("u_Nm", "fault", "status")}
    outputs["tau_set_Nm"] = "impairment.tau_set_Nm"
    task = Task("sense", tuple(blocks))
    return System("chain", device.period_s, blocks, (task,), wires, inputs, outputs)


@pytest.fixture(scope="module", params=["f64", "f32"])
def library(chain, request):
    return compile_system(chain, request.param)


def along(library, tunables=None, **given):
    """What the C makes of a path, from a wrist that was released and constrained at rest."""
    steps = len(given["theta_load_rad"]) + WAY_IN
    x = {n.name: np.zeros(steps) for n in library.system.inputs}
    for name in ("request_ok", "clock_ok", "coeffs_ok"):
        x[name][:] = 1.0
    x["control_beat"] = 1.0 + np.arange(steps) // 5 % 255
    x["rearm"][10:] = 1.0
    x["constrained"][20:] = 1.0
    for name, values in given.items():
        x[name][WAY_IN:] = values
    runner = library.task("sense")
    assert runner.prepare(tunables or {}) == 0
    y, _ = runner.run(x, trace=False)
    assert not np.any(y["fault"][20:WAY_IN])
    return {k: np.asarray(v[WAY_IN:], dtype=float) for k, v in y.items()}


def moved(library, theta, rate, tunables=None, **given):
    return along(library, tunables, theta_load_rad=theta, omega_load_rad_s=rate, **given)


def closed_paths(count):
    """Random harmonics over 4 s, up to the ends of what the limits let by."""
    rng, t = np.random.default_rng(8), np.arange(4000) / 4000 * 2 * np.pi
    for _ in range(count):
        theta, rate = np.zeros(4000), np.zeros(4000)
        for k in range(1, 9):
            a, phase = rng.normal() / k, rng.uniform(0, 2 * np.pi)
            theta += a * np.sin(k * t + phase)
            rate += a * k * np.cos(k * t + phase) * np.pi / 2
        scale = min(rng.uniform(0.2, 2.15) / np.abs(theta).max(), 19.5 / np.abs(rate).max())
        yield theta * scale, rate * scale


def given_J(y, rate):
    return float(np.sum(y["u_Nm"] * rate) * 1e-3)


@pytest.mark.parametrize("gains", [{}, SPRING, {"Kp_Nm_rad": 0.0, "Kd_Nms_rad": 0.0}])
def test_behind_the_limits_no_closed_path_gives_energy(library, gains):
    held_back = 0
    for theta, rate in closed_paths(25):
        y = moved(library, theta, rate, {"impairment": gains})
        assert not y["fault"].any()
        # The sum over steps of up to 0.02 rad misses as much of a spring that begins within one.
        assert given_J(y, rate) <= 0.01
        assert np.all(np.abs(y["u_Nm"]) <= FULL_NM + 1e-6)
        # What the limits take off never turns a push round, and never makes it larger.
        assert np.all(y["u_Nm"] * y["tau_set_Nm"] >= 0)
        assert np.all(np.abs(y["u_Nm"]) <= np.abs(y["tau_set_Nm"]))
        held_back += int(np.sum(np.abs(y["u_Nm"]) < np.abs(y["tau_set_Nm"]) - 1e-3))
    # Resistance alone fades where it would push on towards an end of the range of motion.
    assert bool(held_back) == ("Kp_Nm_rad" in gains)


def test_a_wall_that_lets_go_late_gives_energy(library):
    """Armed: a spring that may change by 90 Nm/s only, at 8 Hz, is found by the same sum."""
    t = np.arange(1000) * 1e-3
    theta = 5 * math.pi / 180 + 0.03 * (1 + np.sin(2 * np.pi * 8 * t))
    rate = 0.03 * 2 * np.pi * 8 * np.cos(2 * np.pi * 8 * t)
    spring = moved(library, theta, rate, {"impairment": SPRING})
    assert abs(given_J(spring, rate)) < 1e-3
    late = moved(library, theta, rate, {"impairment": SPRING, "limits": {"u_rate_Nm_s": 90.0}})
    assert given_J(late, rate) > 0.1


def test_what_the_wall_asks_beyond_is_held_and_a_larger_torque_trips(library):
    theta = np.linspace(0.0, 1.7, 2000)
    y = moved(library, theta, np.full(2000, 0.85), tau_Nm=np.full(2000, -FULL_NM))
    deep = theta > 5 * math.pi / 180 + FULL_NM / 114.6
    assert y["u_Nm"][deep] == pytest.approx(-FULL_NM)
    assert not y["fault"].any()
    over = np.where(np.arange(2000) < 1500, -FULL_NM, -8.01)
    y = moved(library, theta, np.full(2000, 0.85), tau_Nm=over)
    assert not y["fault"][:1500].any()
    assert set(y["fault"][1500:]) == {float(Fault.TORQUE)}
    assert not y["u_Nm"][1500:].any()


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("theta_load_rad", math.nan, Fault.INPUT_INVALID),
        ("theta_load_rad", 2.21, Fault.RANGE_OF_MOTION),
        ("omega_load_rad_s", 20.1, Fault.SPEED),
        ("theta_rad", 0.31, Fault.DEFLECTION),
        ("tau_Nm", -8.01, Fault.TORQUE),
        ("control_beat", 7.0, Fault.CONTROL_STALE),
        ("stop", math.nan, Fault.STOP),
        ("clock_ok", 0.0, Fault.CLOCK),
        ("late_level", 129.0, Fault.LATE),
        ("coeffs_ok", 0.0, Fault.COEFFICIENTS),
        ("request_ok", 0.0, Fault.INPUT_INVALID),
    ],
)
def test_each_cause_ends_the_torque_and_stays(library, name, value, reason):
    """A wrist that turns in the wall; from step 100 on something is wrong, until step 200."""
    given = {
        "theta_load_rad": np.full(300, 0.3),
        "omega_load_rad_s": np.full(300, 1.0),
        "control_beat": 1.0 + (np.arange(300) + WAY_IN) // 5 % 255,
        **dict.fromkeys(("clock_ok", "coeffs_ok", "request_ok"), np.ones(300)),
    }
    bad = given.get(name, np.zeros(300)).copy()
    bad[100:200] = value
    y = along(library, **{**given, name: bad})
    first = 126 if reason is Fault.CONTROL_STALE else 100
    assert y["u_Nm"][:100] == pytest.approx(-FULL_NM)
    assert not y["u_Nm"][first:].any()
    assert set(y["fault"][first:]) == {float(reason)}


# -- on the board, through the link ----------------------------------------------------------------


def u_Nm(board):
    return [board.values[board.places[f"u_{a}_Nm"]] for a in ("flexion", "deviation")]


@pytest.mark.ci
def test_nothing_acts_before_somebody_has_released_it(device):
    board = SimBoard(device)
    board.set_parameter("request.constrained", 1.0)
    for k in range(60):
        board.drivers[2] = 0.3 * (k > 30)
        board.step()
        assert u_Nm(board) == [0.0, 0.0]
    assert board.values[board.places["acts_flexion"]] == 1.0
    assert board.values[board.places["fault_flexion"]] == Fault.NOT_ARMED


def test_a_stop_ends_both_axes_at_once_and_only_rest_and_a_request_release_them(device):
    rig = Rig((LIMB, LIMB))
    board, into = rig.board, [(8.0, 0.3, 0.3, 0.3, 3.0), REST]
    board.set_parameter("impairment_flexion.Kd_Nms_rad", 1.5)
    rig.advance([REST] * 2, True)
    for _ in range(60):
        rig.advance(into, True)
    assert u_Nm(board)[0] < -1.0
    board.stop()
    board.step()
    assert u_Nm(board) == [0.0, 0.0]
    assert (rig.faults, board.state_now) == ([Fault.STOP] * 2, "STOPPED")
    rig.release()  # the stop still stands
    assert rig.faults == [Fault.STOP] * 2
    board.release()
    rig.release()  # the stop is gone, the wall still asks for torque
    assert rig.faults[0] == Fault.STOP
    board.set_parameter("request.constrained", 0.0)
    for _ in range(100):
        rig.frame([REST] * 2)
    rig.release()
    assert rig.faults == [0, 0]
    rig.advance([REST] * 2, False)
    rig.advance([REST] * 2, True)
    assert rig.acts


def test_a_stop_line_and_a_broken_encoder_do_the_same(device):
    rig = Rig((LIMB, LIMB))
    rig.advance([REST] * 2, True)
    rig.board.drivers[0] = math.nan
    rig.board.step()
    assert rig.faults == [Fault.INPUT_INVALID, 0]
    rig.board.lib.sim_stop_line(True)
    rig.board.step()
    assert rig.faults == [Fault.INPUT_INVALID, Fault.STOP]
    with pytest.raises(UserError, match="limits of the simulated wrist have latched: input"):
        rig.advance([REST] * 2, True)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("u_max_Nm", r"safety"),
        ("control_rate_Hz", r"control_rate_Hz is missing"),
        ("rom_max_rad", r"safety.rom_max_rad = 3 is not below joint.theta_max_rad = 3.14"),
    ],
)
def test_an_impairment_without_limits_is_refused(device, line, words):
    text = device.toml()
    lines = text.splitlines(keepends=True)
    at = next(k for k, x in enumerate(lines) if x.startswith(line))
    if line == "u_max_Nm":
        first = next(k for k, x in enumerate(lines) if x.startswith("[safety]"))
        end = next(k for k in range(first + 1, len(lines)) if lines[k].startswith("["))
        del lines[first:end]
    elif line == "rom_max_rad":
        lines[at] = lines[at].replace("2.0", "3.0")
    else:
        del lines[at]
    with pytest.raises(UserError, match=words):
        _ = parse_device("".join(lines), "x").system
