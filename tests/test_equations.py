"""What pages show as a Block's equations is what the Block computes."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
import sympy as sp

from esea_gen.control.limits.block import limits
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.language.block import Block
from esea_gen.language.ports import Equation
from esea_gen.model.symbolic import to_casadi
from esea_gen.observe.disturbance import drive_observer
from esea_gen.observe.human import extended_state, lag_observer
from esea_gen.observe.rates import motor_rate, tangent

from .limits_model import SHIPPED, calm, changed
from .shown_equations import value

H = 1e-3
# Of docs/limits.md and the device file, typed again.
N, J, FV, FC, WIDTH, JH = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.22


def shown(block: Block) -> dict[str, Equation]:
    return {e.number: e for e in block.equations}


def test_a_formula_is_read_as_it_is_printed(elbow):
    # The reader itself, on the cubic spring: 10 * 0.2 + 100 * 0.008.
    (spring,) = [e for e in elbow.sensor.equations if e.number == "(3.2)"]
    assert value(spring, {"k_1": 10.0, "k_3": 100.0, "theta": 0.2}) == pytest.approx(2.8)


def test_of_the_drives_disturbance(drive):
    block = drive_observer(drive)
    rng = np.random.default_rng(1)
    # The motor's torque has settled: its mean over a step is the command.
    count, u, tau = 1500, 0.1, 0.7
    omega = np.full(count, 2.0)
    omega[-40:] += np.cumsum(rng.normal(0, 2e-3, 40))
    x = {"u_Nm": np.full(count, u), "omega_motor_rad_s": omega, "tau_Nm": np.full(count, tau)}
    y, _ = block.simulator({"bandwidth_1_s": 5.0}).run(x)
    told = shown(block)
    numbers = {"J": J, "n": N, "f_v": FV, "f_c": FC, "w_c": WIDTH, "tau_e": tau, "u_a": u}
    model = [value(told["(5.2)"], numbers | {"omega_m": w}) for w in omega[-40:]]
    for k in range(-39, 0):
        expected = value(
            told["(5.5)"],
            {
                "L": 5.0,
                "h": H,
                "d_4,k-1": y["d4_rad_s2"][k - 1],
                "omega_m,k": omega[k],
                "omega_m,k-1": omega[k - 1],
                "a_model": 0.5 * (model[k] + model[k - 1]),
            },
        )
        assert y["d4_rad_s2"][k] == pytest.approx(expected, rel=1e-9)
    # It moves, so that every term counts.
    assert np.ptp(y["d4_rad_s2"][-40:]) > 0.02


def test_of_the_persons_torque_behind_a_lag(drive):
    block = lag_observer(drive)
    rng = np.random.default_rng(2)
    omega = np.cumsum(rng.normal(0, 2e-3, 60))
    tau = np.full(60, 1.3)
    y, _ = block.simulator({"bandwidth_1_s": 4.0}).run({"omega_load_rad_s": omega, "tau_Nm": tau})
    for k in range(1, 60):
        expected = value(
            shown(block)["(5.10)"],
            {
                "L": 4.0,
                "h": H,
                "J_h": JH,
                "tau_e": 1.3,
                "tau_h,k-1": y["tau_h_Nm"][k - 1],
                "omega_l,k": omega[k],
                "omega_l,k-1": omega[k - 1],
            },
        )
        assert y["tau_h_Nm"][k] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert value(shown(block)["(5.3)"], {"tau_e": 1.3, "tau_h": -0.4}) == pytest.approx(0.9)


def test_of_the_extended_state_observer(drive):
    block, decay = extended_state(drive), drive.file.disturbance.decay_s.value
    told = shown(block)
    d = drive.file.disturbance
    gains = {
        "l_1": d.gain_theta.value,
        "l_2": d.gain_omega_1_s.value,
        "l_3": d.gain_tau_Nm_rad.value,
        "l_4": d.gain_rate_Nm_s_rad.value,
    }
    theta = 1.0 + 0.002 * np.sin(np.arange(80) * 0.31)
    tau = 0.8
    y, _ = block.simulator().run({"theta_load_rad": theta, "tau_Nm": np.full(80, tau)})
    step = {"h": H, "tau_e": tau, "J_h": JH}
    fade = {"h": H, "T_d": decay}
    for k in range(1, 80):
        # What was given out at the last sample, predicted, then corrected by this one.
        angle, rate, torque, slope = (
            float(y[name][k - 1])
            for name in (
                "theta_load_est_rad",
                "omega_load_rad_s",
                "tau_h_Nm",
                "tau_h_rate_Nm_s",
            )
        )
        ahead = [
            value(told["[eso 6]"], step | {"theta_l": angle, "omega_l": rate, "tau_h": torque}),
            value(told["[eso 7]"], step | {"omega_l": rate, "tau_h": torque}),
            value(told["[eso 8]"], fade | {"tau_h": torque, "rho": slope}),
            value(told["[eso 9]"], fade | {"rho": slope}),
        ]
        nu = value(told["[eso 1]"], {"theta_enc": theta[k], "theta_l": ahead[0]})
        names = ("theta_l", "omega_l", "tau_h", "rho")
        outputs = ("theta_load_est_rad", "omega_load_rad_s", "tau_h_Nm", "tau_h_rate_Nm_s")
        for i, (name, output, before) in enumerate(zip(names, outputs, ahead, strict=True)):
            given = {name: before, "nu": nu, f"l_{i + 1}": gains[f"l_{i + 1}"]}
            assert y[output][k] == pytest.approx(
                value(told[f"[eso {i + 2}]"], given), rel=1e-8, abs=1e-10
            )


def test_of_the_set_points_rates(drive):
    block = setpoint_rates(drive)
    told = shown(block)
    # From rest the set-point jumps by e: nothing but the gains moves what is held.
    start, e, bandwidth = 0.01, 2e-6, 40.0
    theta = np.full(20, start)
    theta[-1] += e
    y, _ = block.simulator({"bandwidth_Hz": bandwidth}).run({"theta_set_rad": theta})
    pole = math.exp(-2 * math.pi * H * bandwidth)
    alpha = value(told["[set 1]"], {"p": pole})
    update = value(told["[set 4]"], {"delta_p": start, "alpha": alpha, "e": e})
    assert y["delta_set_rad"][-1] == pytest.approx(update, rel=1e-12)
    assert y["delta_set_rad"][-1] - start == pytest.approx(alpha * e, rel=1e-6)
    beta = value(told["[set 2]"], {"p": pole, "q": 1 - pole, "h": H})
    assert y["delta_rate_rad_s"][-1] == pytest.approx(beta * e, rel=1e-6)
    gamma = value(told["[set 3]"], {"q": 1 - pole, "h": H})
    assert y["delta_acc_rad_s2"][-1] == pytest.approx(gamma * e, rel=1e-6)


@pytest.mark.parametrize("most_rad_s", [10.0, 8.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_of_the_limits_push_near_a_stop_and_near_the_speed_limit(drive, sign, most_rad_s):
    block, n = limits(changed(drive, omega_max_rad_s=most_rad_s)), SHIPPED
    names = {"U": n.u, "b" if sign > 0 else "a": n.high if sign > 0 else n.low, "m": n.margin}
    (largest,) = [e for e in block.equations if e.number == ("[lim 1]" if sign > 0 else "[lim 2]")]
    middle, end = 1.0, n.high if sign > 0 else n.low
    cut = set()
    places = [(middle, x) for x in (0.0, 0.79, 0.82, 0.85, 0.89, 0.95, -0.95)]
    places += [(end - sign * x, y) for x, y in ((0.05, 0.0), (0.12, 0.83), (-0.1, 0.0))]
    for theta, share in places:
        omega = share * most_rad_s
        x = calm()
        x["u_command_Nm"][6:] = sign * 0.5
        for name, v in (
            ("theta_load_rad", theta),
            ("theta_motor_rad", theta + 0.05),
            ("omega_load_rad_s", sign * omega),
            ("omega_motor_rad_s", sign * omega),
            ("tau_Nm", 0.0),
        ):
            x[name][:] = v
        y, _ = block.simulator().run(x)
        assert not y["fault"][60]
        expected = value(
            largest, names | {"W": most_rad_s, "omega": sign * omega, "theta_l": theta}
        )
        assert sign * y["u_Nm"][60] == pytest.approx(expected, abs=1e-6), (theta, omega)
        cut.add(round(expected, 3))
    # From nothing to the whole command.
    assert min(cut) == 0
    assert max(cut) == round(n.u, 3)
    assert len(cut) >= 5


def test_of_a_rate(drive):
    told = shown(motor_rate(drive))
    dampings = {f"k_{i}": value(told[f"[rate {i + 1}]"], {}) for i in (1, 2)}
    assert list(dampings.values()) == pytest.approx(
        [2 * math.cos(math.pi / 8), 2 * math.cos(3 * math.pi / 8)]
    )
    # Butterworth: |H|^2 = 1 / (1 + (w / w_c)^8), here on the real axis of s as H(s) H(-s).
    for s in (0.3, 0.7, 1.2):
        both = [
            value(told["[rate 1]"], dampings | {"s": x, "omega_c": 2.0}) for x in (2 * s, -2 * s)
        ]
        assert both[0] * both[1] == pytest.approx(1 / (1 + s**8))
    slope = value(told["[rate 4]"], {"theta_k": 1.5, "theta_k-1": 1.2, "h": 0.1})
    assert slope == pytest.approx(3.0)
    assert value(told["[rate 5]"], {"x": 0.3}) == pytest.approx(math.tan(0.3), rel=1e-6)
    assert tangent(0.3) == pytest.approx(math.tan(0.3), rel=1e-12)


def test_names_that_python_has_not_do_not_order_products(monkeypatch):
    # SymPy numbers them by a counter of the process, and sorts by the number's digits: the C of
    # one device would differ by what else had been built before.
    symbols = sp.symbols("lambda e' theta_d'' J w_c", real=True)
    values = {s: ca.SX.sym(f"x{k}") for k, s in enumerate(symbols)}
    rate, error, wanted, inertia, width = symbols
    expression = sp.expand((wanted + 2 * rate * error + rate**2 * error) * inertia / width)
    found = []
    for count in (5, 7, 8, 40, 97, 98, 998):
        monkeypatch.setattr(sp.Dummy, "_count", count)
        found.append(to_casadi(expression, values))
    assert len({str(x) for x in found}) == 1
    f = ca.Function("f", list(values.values()), [found[0]])
    assert float(f(2, 3, 5, 7, 11)) == pytest.approx((5 + 2 * 2 * 3 + 4 * 3) * 7 / 11)
