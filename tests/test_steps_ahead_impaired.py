"""Wishes along a horizon, and impairments, typed a second time in NumPy: single steps, any memory.

As in ``test_control_steps.py``; with the ranges of an impaired device's ports, worked out by hand.
"""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from esea_gen.control.impairment import impairment
from esea_gen.control.predictive.ahead import ahead
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.device import load_device, parse_device

from .conftest import without
from .single_steps import COUNT, Steps, word
from .test_passive_block import SHIPPED

where, clip = np.where, np.clip
H, TAU, FULL = 1e-3, 20.0, 4.47
LOW, HIGH = -0.6 - 0.35, 3.0 + 0.35  # of the elbow's joint, a deflection beyond either end
GRID = Horizon(5, 0.023, 2, 0.004)
ENDS = 0.004 + 0.023 * np.arange(1, 6)[:, None]


@pytest.fixture(scope="module")
def bare():
    """The shipped drive, neither kept passive nor adapted."""
    text = without(without(SHIPPED.read_text(encoding="utf-8"), "passivity"), "adaptation")
    return parse_device(text, "bare.toml")


def near(s, u, rng):
    """An offset that fades within the horizon, not at once; a joint that stays in its range."""
    k = rng.random(COUNT) < 0.8
    u["keep"][k] = rng.uniform(0.95, 1, k.sum())
    for name in ("theta_load_rad", "theta_wanted_rad"):
        if name in u:
            u[name][:] = rng.uniform(0, 2.5, COUNT)
    if "Kp_Nm_rad" in u:
        u["Kp_Nm_rad"][:] = 20 * 10 ** rng.uniform(-7, 0, COUNT)


VARIANTS = {
    "all of a future": {"given": True, "one_layer": True},
    "a torque ahead": {"given": False, "one_layer": True, "torque_given": True},
    "nothing ahead": {"given": False, "one_layer": True},
    "two layers": {"given": True, "one_layer": False},
    "two layers, a torque ahead": {"given": False, "one_layer": False, "torque_given": True},
}


@pytest.mark.parametrize("which", VARIANTS)
@pytest.mark.parametrize("whose", ["drive", "bare"])
def test_a_step_of_what_is_wanted_ahead(request, whose, which):
    device, options = request.getfixturevalue(whose), VARIANTS[which]
    run = Steps(ahead(device, GRID, **options), together=near)
    u, ok, passive = run.u, run.ok, whose == "drive"
    law = u.mode > 1.5
    known = options.get("torque_given", options["given"])
    assert hasattr(u, "wish_gain") == (passive and options["given"])
    wish = u.tau_preview_Nm if known else u.tau_wanted_Nm * np.ones((5, 1))
    if passive and options["given"]:
        wish = wish * u.wish_gain + u.wish_shift_Nm
    ticks = np.rint(ENDS / H)
    most = u.tau_range_Nm
    tau = clip(wish + u.offset_Nm * u.keep**ticks, -most, most)
    expected = {
        "y_mode": where(ok, u.mode, 0),
        "y_request_ok": ok,
        "y_status": word(~ok),
    }
    damping = u.damping_Nms_rad if passive else 0
    if not options["one_layer"]:
        if passive:
            tau = clip(tau - damping * u.omega_load_rad_s, -most, most)
        run.compare(expected | {"y_tau_d_Nm": where(law, u.tau_set_Nm, tau)})
        return
    stiff = where(law, u.Kp_Nm_rad, 0)
    reach = most / np.maximum(stiff, 1e-4)
    if options["given"]:
        omega, theta = u.omega_preview_rad_s, u.theta_preview_rad
    else:
        omega = u.omega_wanted_rad_s * np.ones((5, 1))
        theta = clip(u.theta_wanted_rad + ENDS * omega, LOW, HIGH)
    if passive:
        tau = clip(tau - damping * omega, -TAU, TAU)
    coasting = clip(u.theta_load_rad + ENDS * u.omega_load_rad_s, LOW, HIGH)
    run.compare(
        expected
        | {
            "y_tau_d_Nm": tau,
            "y_theta_d_rad": clip(theta, coasting - reach, coasting + reach),
            "y_omega_d_rad_s": omega,
            "y_Kp_Nm_rad": stiff,
            "y_Kd_Nms_rad": clip(where(law, u.Kd_Nms_rad, 0) + damping, 0, 5),
        }
    )
    assert 50 < np.sum(law & (abs(theta - coasting) > reach).any(axis=0)) < COUNT


# -- impaired --------------------------------------------------------------------------------------


def test_a_step_of_the_impairment():
    """(7.1) and (7.2) with the sign of the damping put right; switched at rest outside the wall."""

    def together(s, u, rng):
        k = rng.random(COUNT) < 0.5
        u["omega_rad_s"][k] = rng.uniform(-0.2, 0.2, k.sum())
        u["theta_rad"][k] = rng.uniform(-0.1, 0.3, k.sum())

    run = Steps(impairment(load_device("wrist_drive")), together=together)
    t, s, u, ok = run.t, run.s, run.u, run.ok
    for name, x in vars(t).items():
        np.testing.assert_allclose(getattr(run.c, name), x, rtol=1e-6)
    depth = u.theta_rad - t.wall_rad
    still = ok & (abs(u.omega_rad_s) <= 0.1) & (depth <= 0)
    asked = u.constrained > 0.5
    on = where(still, asked, s.on > 0.5)
    push = where(depth > 0, np.maximum(t.Kp_Nm_rad * depth + t.Kd_Nms_rad * u.omega_rad_s, 0), 0)
    raw = -t.Kv_Nms_rad * u.omega_rad_s - push
    acts = on & ok
    held = acts & (abs(raw) > t.tau_max_Nm)
    run.compare(
        {
            "next_on": on,
            "y_tau_set_Nm": where(acts, clip(raw, -t.tau_max_Nm, t.tau_max_Nm), 0),
            "y_acts": acts,
            "y_usable": ok & run.whole,
            "y_status": word(~ok, ~run.whole, acts & (depth > 0), held, ok & (asked != on)),
        }
    )


def test_what_tries_an_impairment():
    """A wrist that rests, is constrained, goes into the wall and out, and is released at rest."""
    device = load_device("wrist_drive")
    block = impairment(device)
    (stream,) = block.streams.events(block, np.random.default_rng(1))
    x = stream.inputs
    names = ("theta_rad", "omega_rad_s", "constrained")
    assert set(x) == set(names)
    angle, rate, asked = (x[n] for n in names)
    moves = slice(200, 4200)
    y, _ = block.simulator().run(x)
    acts, status = y["acts"], y["status"].astype(int)
    parts = {
        "at rest": (0, 200, 0.0, 1),
        "at rest again": (4200, 4400, 0.0, 1),
        "released in the wall": (4400, 4600, 5 * pi / 180 + 0.01, 0),
        "released outside it": (4600, 4800, 0.0, 0),
        "constrained again": (4800, 5000, 0.0, 1),
    }
    assert len(angle) == 5000
    for name, (a, b, where_rad, wanted) in parts.items():
        assert angle[a:b] == pytest.approx(where_rad, abs=1e-6), name
        assert not rate[a:b].any()
        assert set(asked[a:b]) == {wanted}
    assert set(asked[moves]) == {1}
    assert acts[:4600].all()
    assert not acts[4600:4800].any()
    assert acts[4800:].all()
    # In the wall, held at the allowed torque, and waiting to be switched.
    for bit in (4, 8, 16):
        assert 0 < np.sum(status & bit > 0) < 5000
    assert np.flatnonzero(status & 16).tolist() == list(range(4400, 4600))
