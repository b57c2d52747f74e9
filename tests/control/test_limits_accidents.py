"""Limits before the motor: commands through the latches, bounds for undetectable faults."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.limits.block import command_stamp, limits
from esea_gen.control.limits.faults import Fault
from esea_gen.device import Device
from esea_gen.hostlib.library import compile_block
from esea_gen.language.stream import SPECIAL, single
from esea_gen.language.system import System, Task
from esea_gen.model.sensing import zeros_missing
from tests.conftest import ROOT
from tests.limits_model import REALS, SHIPPED, calm

# -- what cannot be detected stays bounded ---------------------------------------------------------


def rubber(delta: float) -> float:
    return 239.0 * delta**3 + 9.39 * delta


HOLDS_Nm_rad = {"limp": 0.0, "12 Nm/rad": 12.0, "60 Nm/rad": 60.0, "250 Nm/rad": 250.0}
HOLDS_Nm_rad |= {"clamped": 1e4}
LIES = {
    "sensors good": (),
    "load encoder frozen": ("load",),
    "motor-side encoder frozen": ("motor",),
    "torque estimate 0": ("torque",),
    "both encoders frozen": ("load", "motor"),
}


def accident(
    device: Device,
    hold_Nm_rad: float,
    seconds: float = 1.5,
    free: bool = False,
    sign: float = 1.0,
    **lies: float,
) -> dict:
    """A controller stuck at full torque, a limb, and sensors some of which lie.

    Two masses, drive friction and the elastomer's spring (thesis 5.1 to 5.3), integrated by
    semi-implicit Euler at 0.1 ms; the person holds with a spring and 1 Nms/rad of damping, the
    stiff one with a ratio of 0.4.
    """
    a, j = device.file.actuator, device.file.joint
    n, inertia, fv, fc = (q.value for q in (a.gear_ratio, a.J_kgm2, a.fv_Nms_rad, a.fc_Nm))
    runner = limits(device).simulator()
    start, dt = 1.0, 1e-4
    hold_Nms_rad = max(1.0, 0.8 * np.sqrt(hold_Nm_rad * j.Jh_kgm2.value))
    m = load = start
    wm = wl = ua = 0.0
    out: dict = {"trip": None, "fault": 0, "u": 0.0, "given": 0.0, "torque": 0.0, "speed": 0.0}
    for k in range(int(seconds * 1000)):
        seen_m = start if lies.get("motor") else m
        seen_l = start if lies.get("load") else load
        y = runner.step(
            u_command_Nm=0.0 if k < 6 else sign * a.u_max_Nm.value,
            control_beat=1.0 + (k // 5) % 255,
            mode=0.0 if k < 6 else 1.0,
            stop=0.0,
            rearm=0.0 if k < 3 else 1.0,
            request_ok=1.0,
            sensing_ok=1.0,
            clock_ok=1.0,
            late_level=0.0,
            coeffs_ok=1.0,
            doubt=0.0,
            theta_rad=seen_m - seen_l,
            theta_motor_rad=seen_m,
            omega_motor_rad_s=0.0 if lies.get("motor") else wm,
            theta_load_rad=seen_l,
            omega_load_rad_s=0.0 if lies.get("load") else wl,
            tau_Nm=0.0 if lies.get("torque") else rubber(seen_m - seen_l),
        )
        assert abs(y["u_Nm"]) <= SHIPPED.u
        if y["fault"] and k > 3 and out["trip"] is None:
            out["trip"], out["fault"] = k, y["fault"]
            out["given_at_trip"], out["torque_at_trip"] = out["given"], out["torque"]
        for _ in range(10):
            tau = rubber(m - load)
            ua += dt * (y["u_Nm"] - ua) / a.tau_c_s.value
            wm += dt * (n * ua - fv * wm - fc * np.tanh(wm / 0.05) - tau) / inertia
            person = 0.0 if free else hold_Nm_rad * (load - start) + hold_Nms_rad * wl
            wl += dt * (tau - person) / j.Jh_kgm2.value
            m, load = m + dt * wm, load + dt * wl
            out["given"] += dt * max(tau * wl, 0.0)
            out["torque"] = max(out["torque"], abs(tau))
            out["speed"] = max(out["speed"], abs(wl))
        out["u"] = max(out["u"], abs(y["u_Nm"]))
        if not -0.4 < load < 2.8:  # the mechanical stops of the joint
            break
    out["travel"] = load - start
    return out


def accident_row(device: Device, case: str) -> str:
    """A row of the page, of both directions: by person the torque when tripped, and the largest."""
    cells = []
    for hold in HOLDS_Nm_rad.values():
        lies = dict.fromkeys(LIES[case], 1.0)
        both = [accident(device, hold, free=not hold, sign=s, **lies) for s in (1, -1)]
        then = [y["torque_at_trip"] for y in both if y["trip"] is not None]
        trip = f"{max(then):.1f}" if len(then) == 2 else "not detected"
        cells.append(f"{trip}, {max(y['torque'] for y in both):.1f}")
    return f"| {case} | " + " | ".join(cells) + " |"


@pytest.mark.parametrize(
    "case", ["sensors good", *(pytest.param(c, marks=pytest.mark.ci) for c in list(LIES)[1:])]
)
def test_the_limits_alone_do_what_the_page_says(drive, case):
    assert accident_row(drive, case) in (ROOT / "docs" / "fault-injection.md").read_text(
        encoding="utf-8"
    )


def test_honest_sensors_end_an_accident(drive):
    for hold, free in ((20.0, False), (0.0, True)):
        y = accident(drive, hold, free=free)
        assert y["fault"] in (Fault.TORQUE, Fault.SPEED, Fault.RANGE_OF_MOTION, Fault.ENERGY)
        assert y["given_at_trip"] <= 15.0 * 1.02


@pytest.mark.parametrize("side", ["load", "motor"])
def test_one_frozen_encoder_shows_as_a_deflection(drive, side):
    y = accident(drive, 20.0, **{side: True})
    assert y["fault"] in (Fault.DEFLECTION, Fault.TORQUE)  # the estimate follows the deflection
    assert y["given_at_trip"] < 15.0


def test_a_dead_torque_estimate_leaves_the_deflection_limit(drive):
    y = accident(drive, 60.0, torque=True)
    assert y["fault"] == Fault.DEFLECTION
    assert y["torque_at_trip"] < 1.1 * rubber(0.3)


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.0, 1.1])
def test_a_wrong_calibration_scales_the_energy_limit_and_no_more(drive, gain):
    # Torque and speed of the limb in step, 1.5 Hz; the estimate is the true torque times gain.
    t = 1e-3 * np.arange(1500)
    x = calm(len(t))
    wave = np.sin(2 * np.pi * 1.5 * t)
    true = 7.0 / max(gain, 1.0) * wave
    x["tau_Nm"], x["omega_load_rad_s"] = single(gain * true), single(9.0 * wave)
    x["theta_load_rad"] = single(1.2 - 9.0 / (3 * np.pi) * np.cos(3 * np.pi * t))
    x["theta_motor_rad"] = x["theta_load_rad"]
    x["theta_rad"][:] = 0
    y, _ = limits(drive).simulator().run(x)
    tripped = int(np.flatnonzero(y["fault"] == Fault.ENERGY)[0])
    given = float(np.sum(1e-3 * np.maximum(true * x["omega_load_rad_s"], 0)[: tripped + 1]))
    assert given * gain == pytest.approx(15.0, abs=0.07)  # one period at 63 W beyond


def test_both_encoders_frozen_leave_only_the_torque_limit(drive):
    # Nothing that is measured moves: no fault, as the page says.  What is left is the motor's
    # largest torque, and with it the work over the way to the stop.
    y = accident(drive, 20.0, load=True, motor=True)
    assert y["trip"] is None
    assert y["u"] == SHIPPED.u
    # A step into a cubic spring overshoots at most fourfold: x k x^3 = 4 (k x^4 / 4).
    assert y["torque"] < 4 * 74 * 0.221
    y = accident(drive, 0.0, free=True, load=True, motor=True)
    assert y["trip"] is None
    assert y["given"] <= 74 * 0.221 * (y["travel"] + 0.3)


# -- the stamp, and both through the latches -------------------------------------------------------


@pytest.mark.parametrize("real", REALS)
def test_stamp(drive, real):
    runner = compile_block(command_stamp(drive), real)
    u = single(np.random.default_rng(1).uniform(-0.2, 0.2, 600))
    y, _ = runner.run({"u_command_Nm": u})
    assert np.array_equal(y["u_command_Nm"], u)
    assert np.array_equal(y["control_beat"], 1 + np.arange(600) % 255)
    assert not np.any(y["status"])
    for bad in (*SPECIAL, 1.0):
        y = runner.step(u_command_Nm=bad)
        assert (y["u_command_Nm"], y["control_beat"], y["status"]) == (0, 0, 1)
    runner.put_state({"beats": np.nan})
    assert runner.step(u_command_Nm=0.1)["status"] == 2


def two_tasks(device: Device) -> System:
    guard, stamp = limits(device), command_stamp(device)
    names = [p.name for p in guard.inputs if p.name not in ("u_command_Nm", "control_beat")]
    return System(
        "elbow_guarded",
        device.period_s,
        {"limits": guard, "stamp": stamp},
        (Task("sense", ("limits",)), Task("control", ("stamp",), 5, 0, 1)),
        {"limits.u_command_Nm": "stamp.u_command_Nm", "limits.control_beat": "stamp.control_beat"},
        {n: (f"limits.{n}",) for n in names} | {"u_command_Nm": ("stamp.u_command_Nm",)},
        {"u_Nm": "limits.u_Nm", "fault": "limits.fault", "status": "limits.status"},
    )


@pytest.mark.parametrize("dies", [None, "silent", "nan"])
def test_through_the_latches_of_two_tasks(drive, dies):
    system = two_tasks(drive)
    simulator, x = system.simulator(zeros_missing(system)), calm()
    names = [e.name for e in system.task_inputs(system.task("sense"))]
    faults = []
    for k in range(200):
        simulator.release(k)
        faults.append(simulator.step("sense", **{n: float(x[n][k]) for n in names})["fault"])
        if k % 5 == 0 and not (dies == "silent" and k >= 100):
            wrong = dies == "nan" and k >= 100
            simulator.step("control", u_command_Nm=np.nan if wrong else float(x["u_command_Nm"][k]))
    if dies is None:
        assert not any(faults[3:])
    else:
        # Silent: the run of tick 95 is seen at 96, stale 25 later.  NaN: seen at 101.
        assert faults[100] == 0
        assert faults.index(Fault.CONTROL_STALE) == (121 if dies == "silent" else 101)
