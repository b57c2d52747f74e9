"""What pages show as a Block's equations is what the Block computes."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
import sympy as sp

from esea_gen.control.limits.block import limits
from esea_gen.language.block import Block
from esea_gen.language.ports import Equation
from esea_gen.model.symbolic import to_casadi
from esea_gen.observe.human import extended_state
from tests.limits_model import SHIPPED, calm, changed
from tests.shown_equations import value

H = 1e-3
# Of docs/limits.md and the device file, typed again.
N, J, FV, FC, WIDTH, JH = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.22


def shown(block: Block) -> dict[str, Equation]:
    return {e.number: e for e in block.equations}


def test_a_formula_is_read_as_it_is_printed(elbow):
    # The reader itself, on the cubic spring: 10 * 0.2 + 100 * 0.008.
    (spring,) = [e for e in elbow.sensor.equations if e.number == "(3.2)"]
    assert value(spring, {"k_1": 10.0, "k_3": 100.0, "theta": 0.2}) == pytest.approx(2.8)


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
