"""The cable between gear and motor side: its observer, and its part in predictive control."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from esea_gen.control.predictive import cable_model
from esea_gen.control.predictive.drive import drive_model, predictive_controller
from esea_gen.control.predictive.horizon import Horizon, linearise
from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import drive_observer_by_gear
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Setting
from esea_gen.twin.judge import judge
from esea_gen.twin.run import run_case
from tests.own_device import own_device, q

STEP = 2 * math.pi / 4096  # of a joint encoder


# -- the observer ----------------------------------------------------------------------------------


def cable(k: float, gap: float, zero: float, seconds: float = 7.0, torque=1.7):
    """A cable whose torque swings: at an end of its gap while it carries, from end to end between.

    return: what the Block is given, without the encoders' steps, and the true winding.
    """
    t = np.arange(round(seconds * 1000)) / 1000
    tau = torque * np.sin(2 * math.pi * 0.6 * t)
    # Nothing is carried while the gear goes through the gap, for 50 ms each time.
    phase = np.sin(2 * math.pi * 0.6 * t)
    edge = math.sin(2 * math.pi * 0.6 * 0.025)
    carried = np.sign(phase) * np.maximum(np.abs(phase) - edge, 0) * torque
    lies = 0.5 * gap * np.clip(phase / edge, -1, 1)
    motor = 0.4 + 0.06 * tau
    # A tenth of what it carries rubs on the way, against the motion.
    rate = np.gradient(motor, 1e-3)
    wound = lies + (carried + 0.1 * np.abs(carried) * np.clip(rate / 0.05, -1, 1)) / k
    given = {
        "theta_gear_rad": motor + wound - zero,
        "gear_usable": np.ones(len(t)),
        "theta_motor_rad": motor,
        "motor_usable": np.ones(len(t)),
        "tau_Nm": carried,
        "omega_gear_rad_s": rate,
        "mode": np.ones(len(t)),
        "theta_rad": 0.06 * tau,
    }
    return given, wound


@pytest.mark.parametrize(
    ("k", "gap", "zero", "torque"),
    [(150, 0.01, 0.0, 3), (100, 0.02, 0.3, 1.7), (300, 0.004, -1.2, 4), (1e5, 0.0, 1.0, 1.7)],
)
def test_gap_stiffness_and_winding_are_learnt_whatever_the_zero(drive, k, gap, zero, torque):
    given, wound = cable(k, gap, zero, torque=torque)
    y, _ = cable_observer(drive).simulator().run(given)
    late = slice(-1700, None)
    assert np.all(y["status"] == 0)
    assert y["gap_rad"][late] == pytest.approx(gap, abs=4e-4)
    assert y["give_rad_Nm"][late] == pytest.approx(1 / k, abs=4e-4)
    assert y["wound_rad"][late] == pytest.approx(wound[late], abs=5e-4)


def test_the_steps_of_the_encoder_average_out(drive):
    given, wound = cable(150, 0.01, 0.2)
    steps = (np.floor(given["theta_motor_rad"] / STEP) + 0.5) * STEP - given["theta_motor_rad"]
    true_rad = given["theta_rad"]
    given["theta_motor_rad"] = given["theta_motor_rad"] + steps
    given["theta_rad"] = true_rad + steps
    y, _ = cable_observer(drive).simulator().run(given)
    missed = (y["wound_rad"] - wound)[-1700:]
    raw = (given["theta_gear_rad"] + 0.2 - given["theta_motor_rad"] - wound)[-1700:]
    assert np.std(missed) < 0.6 * np.std(raw)
    assert np.abs(y["gap_rad"][-1700:] - 0.01).max() < 1e-3
    assert np.std((y["delta_rad"] - true_rad)[-1700:]) < 0.6 * np.std(steps)


# -- the prediction --------------------------------------------------------------------------------


def integrated(device: Device, start: dict, u_Nm: float, ends: np.ndarray, stiffness=150.0):
    """Torque at the ends, by integration of gear, motor-side part and elastomer, load held fast.

    Typed again from (3.1) to (3.11), (5.1) and (5.2) with the numbers of plants.toml.
    """
    a, e = device.file.actuator, device.file.elastomer
    m = e.maxwell
    r = e.omega_rad.value * np.arange(1, int(e.stops.value) + 1)
    weight = e.alpha_Nm_rad.value * np.exp(-e.beta_1_rad.value * r)

    def torque(y):
        return e.k1_Nm_rad.value * y[2] + e.k3_Nm_rad3.value * y[2] ** 3 + y[5] + weight @ y[6:]

    def rates(_, y):
        gear, w_g, motor, w_m, u_a, tau_r = y[:6]
        stops = y[6:]
        wound = gear - motor
        over = max(wound - 0.005, 0) + min(wound + 0.005, 0)
        pull = stiffness * over + (w_g - w_m if over else 0.0)
        pull = pull if pull * over > 0 else 0.0
        lost = 0.1 * abs(pull) * math.tanh(w_m / 0.03)
        rub = a.fv_Nms_rad.value * w_g + a.fc_Nm.value * math.tanh(
            w_g / a.coulomb_width_rad_s.value
        )
        eta = (m.A_Nms_rad.value * abs(motor) ** m.m.value + m.eps1_Nms_rad.value) / (
            m.B.value * abs(w_m) ** m.n.value + m.eps2.value
        )
        held = (np.abs(stops) >= r) & (stops * w_m > 0)
        return [
            w_g,
            (a.gear_ratio.value * u_a - rub - pull) / a.J_kgm2.value,
            w_m,
            (pull - lost - 0.02 * w_m - torque(y)) / 0.003,
            (u_Nm - u_a) / a.tau_c_s.value,
            m.kv_Nm_rad.value * (w_m - tau_r / eta),
            *np.where(held, 0.0, w_m),
        ]

    first = [start["delta"] + start["wound"], start["omega"], start["delta"], start["omega"]]
    first += [start["u_a"], 0.0, *np.zeros(len(r))]
    # Nothing is faster than 3000 /s; corners of friction and stops are met to a step.
    done = solve_ivp(rates, (0, ends[-1]), first, "RK45", ends, rtol=1e-3, atol=1e-4, max_step=2e-4)
    assert done.success
    return np.array([torque(y) for y in done.y.T])


def predicted(device: Device, start: dict, u_Nm: float, train: str, **cable_is) -> np.ndarray:
    """Torque at the ends of the horizon, by the model that the controller carries."""
    horizon = Horizon(delay_s=0.002)
    model = drive_model(device, horizon, train=train)
    given = {
        "delta_rad": start["delta"],
        "omega_rad_s": start["omega"],
        "omega_gear_rad_s": start["omega"],
        "wound_rad": start["wound"],
        "gap_rad": 0.01,
        "give_rad_Nm": 1 / 150,
        "u_a_Nm": start["u_a"],
        "u_in_force_Nm": u_Nm,
        "play_rad": start["delta"] * np.ones(10),  # no memory yet
    } | cable_is
    u = SimpleNamespace(**{p.name: given.get(p.name, 0.0) for p in model.inputs})
    values = {"d4_rad_s2": 0.0, "root_q": 1.0, "root_r": 1.0, "load_1_kgm2": 0.0}
    p = np.array([{**vars(u), **values}[n] for n in model.parameters])
    weight, r = np.array(model.stops.p), np.array(model.stops.r)
    stops = np.zeros(len(r))
    x = model.start(u, 0.0)
    x = np.array([float(x[n]) for n in model.states])
    delta, torques = start["delta"], []
    late, usual = (linearise(model, h, 1.0) for h in (horizon.delay_s, horizon.substep_s))
    for k in range(1 + horizon.intervals * horizon.substeps):
        lin = usual if k else late
        named, ahead = lin.before(x, u_Nm, p, 0.0)
        stops = np.clip(stops + float(ahead) - delta, -r, r)
        delta = float(ahead)
        x = np.array(lin.onward(x, u_Nm, p, 0.0, named, weight @ stops))[:, 0]
        if k and k % horizon.substeps == 0:
            torques.append(x[model.states.index("tau_e")])
    return np.array(torques)


# Towards zero from either side, through the gap and on; from within it; and without it.
STARTS = [
    ({"delta": 0.06, "wound": 0.005 + 0.92 / 150, "omega": 0.0, "u_a": 0.012}, -0.12),
    ({"delta": -0.06, "wound": -0.005 - 0.92 / 150, "omega": 0.0, "u_a": -0.012}, 0.12),
    ({"delta": 0.0, "wound": -0.004, "omega": 0.1, "u_a": 0.0}, 0.05),
    ({"delta": 0.04, "wound": 0.005 + 0.53 / 150, "omega": 0.2, "u_a": 0.05}, 0.08),
]


@pytest.mark.parametrize(("start", "u_Nm"), STARTS)
def test_the_prediction_is_that_of_three_inertias(drive, start, u_Nm):
    true = integrated(drive, start, u_Nm, np.array(Horizon(delay_s=0.002).ends_s))
    off = predicted(drive, start, u_Nm, "cable") - true
    rigid = predicted(drive, start, u_Nm, "rigid") - true
    assert rms(off) < 0.03
    assert rms(rigid) > 4 * rms(off)


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def test_a_command_leads_out_of_the_gap(drive, monkeypatch):
    # At rest in its middle nothing is carried: what is wanted must still be asked of the motor.
    def asked_for() -> float:
        program = predictive_controller(drive, train="cable")
        rest = {p.name: np.zeros(p.size) for p in program.inputs}
        rest = {n: v if len(v) > 1 else 0.0 for n, v in rest.items()}
        given = rest | {"mode": 1.0, "gap_rad": 0.01, "give_rad_Nm": 1 / 150, "tau_d_Nm": 1.0}
        return program.simulator({"load_free": 0.0}).step(**given)["u_Nm"]

    assert asked_for() > 0.05
    # The check that this can fail: a gap that carries nothing at all.
    monkeypatch.setattr(cable_model, "GAP_SHARE", 0.0)
    assert asked_for() == 0


# -- the drive's disturbance, by the motor's own encoder -------------------------------------------


def test_the_disturbance_is_what_the_gear_shows_beyond_motor_friction_and_loss(drive):
    # Constant acceleration under a constant torque and no command, by hand from (5.2).
    a, cab = drive.file.actuator, drive.file.cable
    n, tau = 400, 1.5
    t = np.arange(n) / 1000
    omega = 2.0 + 3.0 * t
    block = drive_observer_by_gear(drive)
    y, _ = block.simulator().run(
        {"u_Nm": np.zeros(n), "omega_gear_rad_s": omega, "tau_Nm": np.full(n, tau)}
    )
    coulomb = a.fc_Nm.value + cab.loss.value * tau
    explained = -(a.fv_Nms_rad.value * omega + coulomb + tau) / a.J_kgm2.value
    lag = 1 / cab.drive_1_s.value
    drift = a.fv_Nms_rad.value * 3.0 / a.J_kgm2.value
    assert y["d4_rad_s2"][-1] == pytest.approx(3.0 - explained[-1] - drift * lag, abs=5e-3)
    assert block.tunables[0].default == cab.drive_1_s.value
    assert block.tunables[0].high == 500


# -- the device file, and the loop -----------------------------------------------------------------


def predictive(text: str) -> Device:
    numbers = "".join(
        f"{name} = {q(value)}\n"
        for name, value in (
            ("intervals", 10.0), ("interval_s", 0.02), ("substeps", 4.0), ("Q", 300.0), ("R", 1.0)
        )
    )  # fmt: skip
    return own_device(f'laws = ["predictive"]\n[predictive]\n{numbers}{text}')


def test_what_does_not_go_together_is_refused():
    text = predictive('drive = "cable"\n').toml()
    bare = parse_device(text[: text.index("\n[cable]")], "bare.toml")
    with pytest.raises(UserError, match=r"bare.toml: section \[cable\] is missing"):
        _ = bare.system
    with pytest.raises(UserError, match="as published"):
        _ = predictive('drive = "cable"\nperson = "parabola"\n').system
    with pytest.raises(UserError, match=r"cable.backlash_rad = 0.05 is above cable.backlash_most"):
        own_device(cable={"backlash_rad": 0.05})
    elbow = text[: text.index("\n[redundancy]")]
    with pytest.raises(UserError, match=r"section \[redundancy\] is missing"):
        parse_device(elbow + text[text.index("\n[cable]") :], "mine.toml")


@pytest.mark.ci
def test_the_tuning_case_on_the_real_plant(tmp_path):
    (case,) = TuningCase().cases()
    rigid = tmp_path / "rigid.toml"
    rigid.write_text(predictive('drive = "rigid"\nfuture = "given"\n').toml())
    found = {}
    for name in ("mpc", str(rigid)):
        run = run_case(case, Setting(name, "real", "none"), 0)
        found[name] = judge(case, run, 0.221)["rms_true_Nm"]
    assert found["mpc"] < 0.028
    assert found[str(rigid)] > 0.035
