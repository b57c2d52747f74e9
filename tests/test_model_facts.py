"""What Blocks of the model declare for the analysis of errors, by hand from the elbow's numbers."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.model.drive import NominalDrive
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.family_inverse import family_inverse
from esea_gen.model.family_sensor import family_step
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import play_parameters, published_inverse
from esea_gen.model.rubber import stiffness_range_Nm_rad

from .test_family_steps import FITTED, REACH, SCALE

K1, K3, KV = 9.39, 239.0, 51.6
RADII = [0.0197 * i for i in range(1, 11)]
WEIGHTS = [10.3 * math.exp(-62.5 * r) for r in RADII]
# The Maxwell element where it is least stiff: at the fastest rate and no deflection.
X = 1e-3 * KV * (0.732 * 25**0.77 + 0.013) / 0.0288
S = 1 + X / 2 + X * X / 6
LEAST_SHARE = S / (1 + X * S)


@pytest.fixture(scope="module")
def device():
    return load_device("elbow")


def root(linear, load):
    (real,) = (z.real for z in np.roots([K3, 0, linear, -load]) if abs(z.imag) < 1e-12)
    return real


def test_stiffness_of_the_published_model(device):
    soft, stiff = stiffness_range_Nm_rad(device)
    assert (soft, stiff) == pytest.approx((K1, K1 + sum(WEIGHTS) + KV))


def test_facts_of_the_exact_inverse(device):
    block = exact_inverse(device)
    low, high = K1, K1 + KV + sum(WEIGHTS)
    # Request and relaxed torque; the rate torque from zero, and a step of it; every stop.
    load = 2 * 20 + KV * (0.35 + 25e-3)
    load += sum(
        w * (0.35 + r + 2e-5 * i) for i, (w, r) in enumerate(zip(WEIGHTS, RADII, strict=True), 1)
    )
    a, b, half = low / (3 * K3), high / (3 * K3), load / (2 * K3)
    expected = {
        "linear_Nm_rad": (low, high),
        "tangent_Nm_rad": (low, high + 3 * K3 * 0.35**2),
        "set_point_rad": (-0.35, 0.35),
        "omega_mid_rad_s": (-25, 25),
        "rate_share": (LEAST_SHARE, 1),
        "root_a_rad2": (a, b),
        "root_c_rad": (math.sqrt(a), math.cbrt(half + math.sqrt(b**3 + half**2))),
        "root_ratio_rad": (0, math.sqrt(b)),
        "root_size_rad": (0, root(low, load)),
    }
    assert set(block.facts) == set(expected)
    for name, ends in expected.items():
        assert block.facts[name] == pytest.approx(ends, rel=3e-6), name
        # Rounding of these numbers never cuts off what can be.
        inside = name not in ("set_point_rad", "omega_mid_rad_s", "rate_share")
        assert not inside or (block.facts[name][0] <= ends[0] and ends[1] <= block.facts[name][1])
    assert block.facts["rate_share"][0] < LEAST_SHARE
    (solved,) = block.solved.items()
    assert solved[0] == "set_point_rad"
    assert (solved[1].residual, solved[1].most) == ("residual_Nm", pytest.approx(1e-4, rel=1e-6))
    assert (solved[1].slope, solved[1].jump) == (K1, 0)


def test_cuts_of_the_inverses_are_the_sensor_s(device):
    cuts = torque_sensor(device).split
    rate, place = cuts["u_omega_rad_s"], cuts["s_theta_prev_rad"]
    assert exact_inverse(device).split == {"s_theta_prev_rad": place, "omega_mid_rad_s": rate}
    found = dict(published_inverse(device, "a").split)
    # The envelope turns from linear to cubic where its two parts are alike.
    bend = 2 * K3 * (K1 / (3 * K3)) ** 1.5
    assert found.pop("corrected_Nm") == pytest.approx((20e-6, 0.1 * bend, bend, 4 * bend))
    assert found == {"s_theta_prev_rad": place, "omega_rad_s": rate}
    assert published_inverse(device).split == {}


def test_facts_of_the_published_inverse(device):
    a, half = K1 / (3 * K3), 20 / (2 * K3)
    roots = {
        "root_c_rad": (math.sqrt(a), math.cbrt(half + math.sqrt(a**3 + half**2))),
        "root_ratio_rad": (0, math.sqrt(a)),
        "root_size_rad": (0, root(K1, 20)),
    }
    more = {
        "corrected_Nm": (-20, 20),
        "omega_rad_s": (-25, 25),
        "rate_share": (LEAST_SHARE, 1),
    }
    for name, expected in ((None, roots), ("b", roots | more)):
        found = published_inverse(device, name).facts
        assert set(found) == set(expected)
        for key, ends in expected.items():
            assert found[key] == pytest.approx(ends, rel=3e-6), key


def test_facts_of_a_member_s_inverse(device):
    block = family_inverse(device, FITTED, steps=3)
    most = 1.01 * FITTED.most_Nm(0.35)
    # No step is longer than twice the bracket from -0.7 to 0.7 rad.
    moves = {f"move_{k}_rad": (-1.4014, 1.4014) for k in (1, 2, 3)}
    expected = moves | {"set_point_rad": (-0.35, 0.35)}
    assert set(block.facts) == set(expected)
    for name, ends in expected.items():
        assert block.facts[name] == pytest.approx(ends, rel=1e-6), name
    # Strain softens the bent spring; its torque may fall with the deflection at a first sample.
    bent = -0.3 * 0.4 / (math.sqrt(0.3) + math.sqrt(0.4)) ** 4
    slope = min(f * (1 + 0.5 * bent) for f in FITTED.factors) / SCALE
    (solved,) = block.solved.values()
    assert (solved.residual, solved.most) == ("residual_Nm", pytest.approx(1e-5 * most, rel=1e-6))
    assert solved.slope == pytest.approx(slope)
    own = {"omega_mid_rad_s": 1000.0, "tau_model_Nm": slope, "residual_Nm": slope}
    model = family_step(device, FITTED, "virgin")
    assert solved.follows == pytest.approx(own | model.state_slopes())


def test_how_fast_each_memory_follows_the_deflection(device):
    found = family_step(device, FITTED, "virgin").state_slopes()
    cubic = 3 * REACH**2
    assert found == pytest.approx(
        {
            "reached": 5,
            "band": 5,
            "kept": 5 / 3,  # of the shortest path
            "primed": 0,
            "theta_prev_rad": 1,
            "relaxed_Nm": 5 * max(0.8, 0.03 + 0.05 * cubic),
            "play": 5,
            "slip": 2 * 5 * cubic,
        }
    )


def test_the_nominal_drive_by_hand():
    numbers = {
        "tau_c_s": 0.02,
        "fv_Nms_rad": 0.5,
        "fc_Nm": 0.3,
        "coulomb_width_rad_s": 0.05,
        "gear_ratio": 70.0,
        "J_kgm2": 0.6,
    }
    drive = NominalDrive(numbers, 0.004, 1.25)
    assert (drive.omega_rad_s, drive.u_a_Nm) == (0, 0)
    u_a = omega = 0.0
    theta = 1.25
    for u, tau in ((0.1, 0.7), (-0.05, -1.1), (0.02, 0.4), (0.0, 0.0)):
        found = drive.move(u, tau)
        u_a = u + (u_a - u) * math.exp(-0.2)
        loss = 0.5 * omega + 0.3 * math.tanh(20 * omega)
        omega += 0.004 * (70 * u_a - loss - tau) / 0.6
        theta += 0.004 * omega
        assert (drive.u_a_Nm, drive.omega_rad_s) == pytest.approx((u_a, omega))
        assert found == drive.theta_rad == pytest.approx(theta)
    with pytest.raises(TypeError):
        NominalDrive(numbers, 0.004, 1.25, 3.0)  # it starts at rest


def test_parameters_of_the_plays(device):
    less = SimpleNamespace(file=SimpleNamespace(inverse=None))
    table = {"kappa_rad": 0.106, "phi_1_rad": 4.84, "chi_rad": 0.00233}
    assert {c.name: c.value for c in play_parameters(less)} == table
    own = SimpleNamespace(value=0.2, source="mine", status="identified")
    given = SimpleNamespace(kappa_rad=None, phi_1_rad=own, chi_rad=None)
    found = play_parameters(SimpleNamespace(file=SimpleNamespace(inverse=given)))
    assert [(c.value, c.source, c.status) for c in found] == [
        (0.106, "thesis table 4.2", "published"),
        (0.2, "mine", "identified"),
        (0.00233, "thesis table 4.2", "published"),
    ]
    own = published_inverse(device, kappa=0.3, phi=2.0, chi=0.01)
    assert [c.value for c in own.constants[:3]] == [0.3, 2.0, 0.01]
    assert {c.source for c in own.constants[:3]} == {"argument"}
