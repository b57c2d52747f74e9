"""One substep of the drive's model in predictive control, in closed form where there is one."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.control.predictive.drive import drive_model
from esea_gen.control.predictive.horizon import Horizon


class Plain:
    """A tape that names nothing: what is written is the value."""

    def let(self, _name, value):
        return float(value)

    def keep(self, _name, value, _slopes=None):
        return float(value)

    def power(self, _name, base, exponent):
        return float(base) ** exponent

    def memory(self, _stretch):
        return 0.0


def substep(device, h, u=0.0, d4=0.0, load_1_kgm2=0.0, tau_h=0.0, **state):
    """Next state, from rest but for what is given."""
    model = drive_model(device, Horizon(delay_s=0.002))
    x = dict.fromkeys(("delta", "omega_m", "omega_l", "u_a", "tau_r", "tau_e"), 0.0) | state
    p = SimpleNamespace(d4_rad_s2=d4, load_1_kgm2=load_1_kgm2)
    w = SimpleNamespace(tau_h=tau_h)
    found = model.substep(Plain(), h, SimpleNamespace(**x), u, p, w)
    return {k: float(v) for k, v in found.items()}


@pytest.mark.parametrize("h", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("side", [1, -1])
def test_friction_is_an_implicit_midpoint_step(drive, h, side):
    """Exact for what is linear: viscous and creeping; sliding, with Coulomb's torque constant."""
    a = drive.file.actuator
    inertia, fv, fc = a.J_kgm2.value, a.fv_Nms_rad.value, a.fc_Nm.value
    width = a.coulomb_width_rad_s.value
    half = h / (2 * inertia)

    def after(omega: float) -> float:
        y = substep(drive, h, omega_m=omega)
        # Less half a kick by the torque at the substep's end.
        return y["omega_m"] + half * y["tau_e"]

    creeping = side * 1e-7 * width
    steep = half * (fv + fc / width)
    assert after(creeping) == pytest.approx(creeping * (1 - steep) / (1 + steep), rel=1e-9)
    sliding = side * 40 * width
    expected = (sliding * (1 - half * fv) - side * 2 * half * fc) / (1 + half * fv)
    assert after(sliding) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("h", [1e-3, 5e-3])
def test_lag_and_push_are_exact_for_a_command_that_stands(drive, h):
    """The command's mean over a substep, its value at the end; both halves of the kick."""
    a = drive.file.actuator
    inertia, ratio, tau_c = a.J_kgm2.value, a.gear_ratio.value, a.tau_c_s.value
    u, u_a, d4 = 0.1, -0.05, 3.0
    y = substep(drive, h, u=u, u_a=u_a, d4=d4)
    assert y["u_a"] == pytest.approx(u + (u_a - u) * math.exp(-h / tau_c), rel=1e-12)
    mean = u + (u_a - u) * tau_c / h * (1 - math.exp(-h / tau_c))
    kick = h * (ratio / inertia * mean + d4)
    first = 0.5 * kick
    fv, fc, width = a.fv_Nms_rad.value, a.fc_Nm.value, a.coulomb_width_rad_s.value
    # Friction as above, of what half the kick gives; linearly implicit in Coulomb's torque.
    z = np.clip(first / width, -3, 3)
    sig = z * (27 + z**2) / (27 + 9 * z**2)
    slope = fv + fc / width * (1 - sig * sig)
    lost = h / inertia * (fv * first + fc * sig) / (1 + 0.5 * h / inertia * slope)
    expected = first - lost + first - 0.5 * h / inertia * y["tau_e"]
    assert y["omega_m"] == pytest.approx(expected, rel=1e-9)
    # It moved by the mean speed.
    assert y["delta"] == pytest.approx(0.5 * h * (first + first - lost), rel=1e-9)


def test_the_load_is_kicked_by_half_before_and_after(drive):
    h, load_1_kgm2, tau_h = 2e-3, 20.0, 0.4
    y = substep(drive, h, load_1_kgm2=load_1_kgm2, tau_h=tau_h)
    first = 0.5 * h * load_1_kgm2 * tau_h
    assert y["delta"] == pytest.approx(-h * first, rel=1e-9)
    assert y["omega_l"] == pytest.approx(
        first + 0.5 * h * load_1_kgm2 * (y["tau_e"] + tau_h), rel=1e-9
    )
