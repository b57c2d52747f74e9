"""Inverse Blocks: the model's torque at the set-point is the request."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner, compile_block, compile_device
from esea_gen.language.block import Block
from esea_gen.language.ports import threshold
from esea_gen.language.stream import single
from esea_gen.model.cubic import cubic_root
from esea_gen.model.inverse import exact_inverse
from esea_gen.studies.uncertainty.motions import SIGNALS
from tests.model.test_elastomer import P

LIMIT_NM = {"f64": 1e-9, "f32": 1e-5}


class Pair:
    """An exact inverse and the sensor it inverts, both compiled."""

    def __init__(self, device: Device, real: str, block: Block | None = None) -> None:
        self.device, self.block = device, block or exact_inverse(device)
        self.inverse = compile_block(self.block, real)
        self.sensor: CRunner = compile_device(device, real).block("sensor")
        self.bits = {f.name: 1 << i for i, f in enumerate(self.block.status_port.flags)}

    def run(self, request):
        """Set-points, torque of the sensor fed with them, and both states."""
        self.inverse.reset()
        self.sensor.reset()
        y, s = self.inverse.run({"tau_Nm": request})
        f, q = self.sensor.run({"theta_rad": y["theta_rad"], "omega_rad_s": y["omega_mid_rad_s"]})
        return y, f["tau_Nm"].astype(float), s, q

    def error(self, request):
        """Largest |torque - request| where the request was not clamped, and the status words."""
        request = single(request)
        y, torque, _, _ = self.run(request)
        free = (y["status"] & self.bits["REQUEST_CLAMPED"]) == 0
        assert not np.any(y["status"] & self.bits["NOT_CONVERGED"])
        return float(np.max(np.abs(torque - request)[free], initial=0.0)), y


@pytest.fixture(scope="module")
def pairs(elbow) -> dict[str, Pair]:
    return {real: Pair(elbow, real) for real in ("f64", "f32")}


def with_dead_zone(elbow: Device, half_width_rad: float) -> Device:
    line = f'dead_zone_rad = {{ value = {half_width_rad}, status = "assumed", source = "a test" }}'
    return parse_device(elbow.toml().replace("[elastomer]\n", f"[elastomer]\n{line}\n"), "dz.toml")


def without_rate_terms(elbow: Device) -> Device:
    e = elbow.file.elastomer.model_copy(update={"maxwell": None})
    return Device(elbow.file.model_copy(update={"elastomer": e}), "quasistatic.toml")


# Histories: a few targets, each reached by a jump, a ramp or noise round it.
HISTORY = st.lists(
    st.tuples(
        st.floats(-12, 12, width=32),
        st.integers(1, 60),
        st.sampled_from(["jump", "ramp", "noise", "hold"]),
    ),
    min_size=1,
    max_size=8,
)


def history(pieces, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out, last = [], 0.0
    for target, steps, kind in pieces:
        if kind == "ramp":
            out.append(np.linspace(last, target, steps))
        elif kind == "noise":
            out.append(target + rng.normal(0, 1, steps))
        else:
            out.append(np.full(steps, target if kind == "jump" else last))
        last = float(out[-1][-1])
    return np.clip(np.concatenate(out), -15, 15)


@pytest.mark.ci
@pytest.mark.parametrize("real", ["f64", "f32"])
@settings(max_examples=60)
@given(HISTORY, st.integers(0, 99))
def test_forward_of_inverse_is_the_request(pairs, real, pieces, seed):
    pair = pairs[real]
    request = single(history(pieces, seed))
    y, torque, state, sensed = pair.run(request)
    free = (y["status"] & pair.bits["REQUEST_CLAMPED"]) == 0
    assert np.max(np.abs(torque - request)[free], initial=0) < LIMIT_NM[real]
    assert not np.any(y["status"] & pair.bits["NOT_CONVERGED"])
    assert np.array_equal(y["tau_model_Nm"], torque.astype(y["tau_model_Nm"].dtype))
    # Inverse and sensor hold the same memory, bit for bit.
    for name in ("theta_prev_rad", "tau_r_Nm", "play_rad", "primed"):
        assert state[name].tobytes() == sensed[name].tobytes()


@pytest.mark.parametrize("real", ["f64", "f32"])
@pytest.mark.parametrize("signal", range(5))
def test_published_signals(pairs, real, signal):
    # The last 15 s of each: the fast end of the sweeps.
    error, y = pairs[real].error(SIGNALS[signal].sample(1000.0)[-15000:])
    assert error < LIMIT_NM[real]
    assert not np.any(y["status"] & pairs[real].bits["REQUEST_CLAMPED"])


@pytest.mark.parametrize("signal", range(5))
def test_f32_set_points_satisfy_the_f64_model(pairs, signal):
    # The sensor in double precision, all history long: rounding does not add up.
    request = single(SIGNALS[signal].sample(1000.0)[-15000:])
    y, _, _, _ = pairs["f32"].run(request)
    sensor = pairs["f64"].sensor
    sensor.reset()
    f, _ = sensor.run({"theta_rad": y["theta_rad"], "omega_rad_s": y["omega_mid_rad_s"]})
    assert np.max(np.abs(f["tau_Nm"] - request)) < 1e-5


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_steps_noise_and_small_requests(pairs, real):
    rng = np.random.default_rng(4)
    requests = {
        "steps": np.repeat(rng.uniform(-6, 6, 100), 40),
        "noise": rng.normal(0, 2, 4000),
        "walk": np.clip(np.cumsum(rng.normal(0, 0.05, 8000)), -8, 8),
        "tiny": 1e-6 * rng.normal(0, 1, 2000),
        "zero": np.zeros(100),
    }
    for name, request in requests.items():
        error, _ = pairs[real].error(request)
        assert error < LIMIT_NM[real], name
    # Small requests keep their relative accuracy.
    assert pairs[real].error(requests["tiny"])[0] < 1e-12
    assert pairs[real].error(requests["zero"])[0] == 0.0


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_requests_out_of_reach_are_clamped(pairs, real):
    pair = pairs[real]
    request = np.concatenate([np.linspace(0, 60, 600), np.linspace(60, -150, 900), np.zeros(300)])
    error, y = pair.error(request)
    clamped = (y["status"] & pair.bits["REQUEST_CLAMPED"]) != 0
    assert error < LIMIT_NM[real]
    assert np.all(clamped[np.abs(single(request)) > 20.0])
    assert not np.any(clamped[-200:])
    limit = pair.device.sensor.inputs[0].high
    assert np.max(np.abs(y["theta_rad"])) <= np.float32(limit)
    # As far as it goes, in the direction asked for.
    far = np.abs(request) > 21
    assert np.all(np.sign(y["residual_Nm"][far]) == np.sign(request[far]))


def torque(theta: float, s: dict, omega: float, h: float) -> float:
    """The model written out again: torque of a candidate deflection, from a given memory."""
    r = P["omega"] * np.arange(1, 11)
    weight = P["alpha"] * np.exp(-P["beta"] * r)
    stop = np.clip(theta - s["play_rad"], -r, r)
    middle = s["theta_prev_rad"][0] + 0.5 * h * omega
    eta = (P["A"] * abs(middle) ** P["m"] + P["eps1"]) / (P["B"] * abs(omega) ** P["n"] + P["eps2"])
    x = h * P["kv"] / eta
    series = 1 + x / 2 + x * x / 6
    furthest = threshold(25 * h)
    move = np.clip(theta - s["theta_prev_rad"][0], -furthest, furthest)
    tau_r = (s["tau_r_Nm"][0] + P["kv"] * move * series) / (1 + x * series)
    return float(P["k3"] * theta**3 + P["k1"] * theta + np.clip(tau_r, -20, 20) + weight @ stop)


def test_the_set_point_is_the_root_that_bisection_finds(elbow):
    # An independent model and an independent solver, from the memory of a rough history.
    rng = np.random.default_rng(7)
    simulator = exact_inverse(elbow).simulator()
    simulator.step(tau_Nm=0.0)
    for request in np.cumsum(rng.normal(0, 0.3, 300)) % 8 - 4:
        before = simulator.state
        y = simulator.step(tau_Nm=float(request))

        def miss(x, memory=before, omega=y["omega_mid_rad_s"], request=request):
            return torque(x, memory, omega, 1e-3) - request

        assert y["theta_rad"] == pytest.approx(brentq(miss, -0.35, 0.35, xtol=1e-14), abs=1e-12)


@pytest.mark.ci
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_dead_zone(elbow, real):
    pair = Pair(with_dead_zone(elbow, 0.05), real)
    t = np.arange(4000) * 1e-3
    error, y = pair.error(3 * np.sin(2 * np.pi * 0.7 * t + 0.3))
    assert error < LIMIT_NM[real]
    assert np.max(np.abs(y["theta_rad"])) > 0.05
    assert pair.error(np.zeros(10))[1]["theta_rad"] == pytest.approx(0)


@pytest.mark.ci
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_model_without_rate_terms(elbow, real):
    pair = Pair(without_rate_terms(elbow), real)
    t = np.arange(3000) * 1e-3
    assert pair.error(4 * np.sin(2 * np.pi * 0.9 * t))[0] < LIMIT_NM[real]


def test_a_model_without_linear_stiffness_is_refused(elbow):
    device = parse_device(elbow.toml().replace("value = 9.39", "value = 0.0"), "soft.toml")
    with pytest.raises(UserError, match="no unique inverse"):
        exact_inverse(device)


def test_cubic_root():
    import casadi as ca

    load = np.concatenate([np.logspace(-12, 2, 400), -np.logspace(-12, 2, 400)])
    x = ca.SX.sym("x")
    root = np.asarray(ca.Function("f", [x], [cubic_root(239.0, 9.39, x)])(load.T)).ravel()
    assert 239.0 * root**3 + 9.39 * root == pytest.approx(load, rel=1e-13)
    assert float(ca.Function("f", [x], [cubic_root(0.0, 9.39, x)])(1.0)) == pytest.approx(1 / 9.39)
    # (4.13) at 4.5 Nm: the misprints corrected.
    assert float(ca.Function("f", [x], [cubic_root(239.0, 9.39, x)])(4.5)) == pytest.approx(
        0.2175, abs=5e-5
    )
