"""Both inverses round the sensor's own step: closed forms of what they add, from any memory."""

from __future__ import annotations

import numpy as np
import pytest
from numpy import abs, clip, where

from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import FILTER_B, published_inverse
from tests.single_steps import COUNT, Steps, word

H, K1, K3, TAU, FULL, OMEGA = 1e-3, 9.39, 239.0, 20.0, 4.47, 25.0
THETA = float(np.float32(0.35))
PLAYS = 0.00233 * np.arange(1, 11)[:, None]
WEIGHTS = 0.106 * np.exp(-4.84 * PLAYS)


def sensed(device, s, theta, omega) -> dict[str, np.ndarray]:
    """Next state, outputs and labels of the sensor's step from the memory of an inverse."""
    step = torque_sensor(device).labelled_step
    held = [np.atleast_2d(getattr(s, n)) for n in ("primed", "theta_prev_rad", "tau_r_Nm")]
    found = step.map(COUNT).call([*held, s.play_rad, np.atleast_2d(theta), np.atleast_2d(omega)])
    arrays = (np.array(x) for x in found)
    return {n: x[0] if len(x) == 1 else x for n, x in zip(step.name_out(), arrays, strict=True)}


def root(load: np.ndarray) -> np.ndarray:
    """Real root of k3 x^3 + k1 x = load, by the hyperbolic sine of a third."""
    a = np.sqrt(K1 / (3 * K3))
    return 2 * a * np.sinh(np.arcsinh(load / (2 * K3 * a**3)) / 3)


@pytest.mark.parametrize("taps", [(), FILTER_B])
def test_a_step_of_the_published_inverse(elbow, taps):
    """(4.7) to (4.13), and the observer that closes over the sensor's step."""

    def together(s, u, rng):
        if taps:
            s["tau_r_Nm"] *= 0.1

    run = Steps(published_inverse(elbow, "b" if taps else None), together=together)
    s, u = run.s, run.u
    wanted = u.tau_Nm - (np.asarray(taps) @ s.difference_Nm if taps else 0)
    corrected = clip(wanted, -TAU, TAU)
    gamma = root(corrected)
    held = np.maximum(gamma - PLAYS, np.minimum(gamma + PLAYS, s.inverse_play_rad))
    total = np.sum(WEIGHTS * held, axis=0)
    theta = clip(total, -THETA, THETA)
    flags = [abs(u.tau_Nm) > FULL, (abs(wanted) > TAU) | (abs(total) > THETA)]
    expected = {"next_inverse_play_rad": held, "y_theta_rad": theta, "y_u_Nm": corrected}
    if taps:
        last = where(s.primed != 0, s.theta_prev_rad, theta)
        rate = (theta - last) / H
        model = sensed(elbow, s, theta, clip(rate, -OMEGA, OMEGA))
        missed = model["label_tau_Nm"] - corrected
        newest = clip(missed, -2 * TAU, 2 * TAU)
        names = ("primed", "theta_prev_rad", "tau_r_Nm", "play_rad")
        expected |= {f"next_{n}": model[f"next_{n}"] for n in names}
        expected["next_difference_Nm"] = np.vstack([newest, s.difference_Nm[:-1]])
        clipped = abs(model["label_tau_r_raw_Nm"]) > TAU
        flags.append((abs(rate) > OMEGA) | (abs(missed) > 2 * TAU) | clipped)
    run.compare(expected | {"y_status": word(~run.ok, ~run.whole, *flags)})


def test_a_step_of_the_exact_inverse(elbow):
    """The sensor shows what was asked for, or a flag says why not; a torn memory starts afresh."""

    def together(s, u, rng):
        # Play states with a common history but for some, motion of a limb, torque of a person.
        moves = rng.uniform(-1, 1, (10, COUNT)) * where(rng.random(COUNT) < 0.1, 1.2, 1)
        s["theta_prev_rad"] *= 0.5
        # The whole vector, of which this is the first element.
        s["play_rad"].base[:] = s["theta_prev_rad"] + np.cumsum(0.0197 * moves, axis=0)
        u["tau_Nm"] *= rng.choice([0.02, 0.15, 1.0], COUNT)

    run = Steps(exact_inverse(elbow), together=together)
    s, u, y = run.s, run.u, {n[2:]: x for n, x in run.found.items() if n.startswith("y_")}
    gaps = np.diff(np.vstack([s.theta_prev_rad, s.play_rad]), axis=0)
    whole = run.whole & np.all(abs(gaps) <= 0.0197 + 1e-5, axis=0)
    s.primed = where(whole, s.primed, 0)
    primed = s.primed != 0
    s.tau_r_Nm = where(primed, s.tau_r_Nm, 0)
    theta, omega = y["theta_rad"], y["omega_mid_rad_s"]
    mid = s.v_rad_s + H / 2 * s.a_rad_s2
    model = sensed(elbow, s, theta, omega)
    tau = model["label_tau_Nm"]
    missed = u.tau_Nm - tau
    expected = {
        "omega_mid_rad_s": clip(mid, -OMEGA, OMEGA),
        "theta_rad": where(run.ok, theta, where(primed, s.theta_prev_rad, 0)),
        "tau_model_Nm": clip(tau, -TAU, TAU),
        "residual_Nm": clip(missed, -400, 400),
        "step_rad": where(primed, theta - s.theta_prev_rad, 0),
    }
    for name, value in expected.items():
        # What a corrupt part makes of the rest is the called kernels' own.
        np.testing.assert_allclose(y[name][run.whole], value[run.whole], atol=1e-9, err_msg=name)
    up = [(y["status"].astype(int) >> i & 1).astype(bool) for i in range(8)]
    clamped = run.ok & ((abs(u.tau_Nm) > TAU) | (abs(theta) >= THETA))
    lost = run.ok & (abs(missed) > 5e-6 * TAU) & ~clamped
    for i, flag in ((0, ~run.ok), (1, ~whole), (4, abs(u.tau_Nm) > FULL), (5, clamped), (7, lost)):
        np.testing.assert_array_equal(up[i][run.whole], flag[run.whole], err_msg=str(i))
    reached = run.ok & run.whole & ~clamped
    assert reached.sum() > 0.3 * COUNT
    assert np.max(abs(missed[reached])) < 1e-9
