"""Motor temperature: the two-node model against closed forms, and derating."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from esea_gen.control.limits.faults import Fault
from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.verify.coverage import branch_coverage
from esea_gen.verify.equivalence import verify
from esea_gen.verify.streams import at_the_limits, streams
from tests.devices.test_device import own

# Order of a motor of the elbow's size; no data sheet's.
R_WC, R_CA, C_W, C_C, R, K_T, PER_K = 1.5, 4.0, 13.0, 225.0, 0.4, 0.037, 3.93e-3
AMBIENT, DERATE, START, MAX = 40.0, 110.0, 120.0, 125.0
SHEET = {"k_t_Nm_A": K_T, "resistance_Ohm": R, "winding_case_K_W": R_WC, "case_ambient_K_W": R_CA,
             "winding_s": C_W * R_WC, "case_s": C_C * R_CA,
             "ambient_C": AMBIENT, "derate_C": DERATE, "max_C": MAX}  # fmt: skip
H, U_MAX = 5e-3, 0.221
NODES = ("winding_C", "case_C")
F64 = (pytest.param("f64", marks=pytest.mark.ci),)


def warm_text(**changed: float) -> str:
    zeros = {f"encoder.{side}": {"zero_rad": 0.0} for side in ("motor", "load")}
    return own(**zeros, motor_thermal=SHEET | changed)


def warm(**changed: float) -> Device:
    return parse_device(warm_text(**changed), "warm.toml")


@cache
def library(real: str) -> HostLibrary:
    return compile_device(warm(start_C=START), real)


def warmed(real: str, u_Nm: np.ndarray, state=None, measured_C=0.0) -> dict[str, np.ndarray]:
    runner = library(real).block("motor_temperature")
    runner.reset()
    if state is not None:
        runner.put_state(dict(zip(NODES, state, strict=True)))
    return runner.run({"u_Nm": u_Nm, "motor_C": measured_C + 0 * u_Nm}, trace=False)[0]


def loss_W(u_Nm, winding_C):
    return R * (u_Nm / K_T) ** 2 * (1 + PER_K * (winding_C - 25))


@pytest.mark.parametrize("real", [*F64, "f32", "q31"])
@pytest.mark.parametrize(("u_Nm", "start"), [(0.1, (45.0, 45.0)), (-0.1, (100.0, 70.0))])
def test_a_step_of_torque_warms_by_two_exponentials(real, u_Nm, start):
    """The loss grows with the winding's temperature in proportion, so that all of it is linear."""
    slope, out = loss_W(u_Nm, 1) - loss_W(u_Nm, 0), 1 / R_CA
    rates = [[(slope - 1 / R_WC) / C_W, 1 / R_WC / C_W], [1 / R_WC / C_C, -(1 / R_WC + out) / C_C]]
    steady = np.linalg.solve(rates, [-loss_W(u_Nm, 0) / C_W, -out * AMBIENT / C_C])
    lambdas, modes = np.linalg.eig(rates)
    steps, every = 240_000, slice(19, None, 2000)
    time_s = H * (1 + np.arange(steps))[every]
    shares = np.linalg.solve(modes, start - steady)
    expected = steady[:, None] + modes @ (shares[:, None] * np.exp(lambdas[:, None] * time_s))
    y = warmed(real, np.full(steps, u_Nm), start)
    for name, nodes, most_K in zip(NODES, expected, (0.25, 0.1), strict=True):
        assert np.max(np.abs(y[name][every] - nodes)) < most_K


@pytest.mark.parametrize("real", [*F64, "f32"])
def test_a_day_of_sessions_keeps_the_energy(real):
    """What the copper gives off is in winding and case, or gone to the air."""
    rng, t, state = np.random.default_rng(4), H * np.arange(round(1200 / H)), (40.0, 40.0)
    given_J = gone_J = 0.0
    for session in range(24):  # twenty minutes each: reaches with pauses between, or a break
        reach = 0.16 * np.sin(2 * np.pi * rng.uniform(0.2, 1) * t) * (t % 20 < rng.uniform(5, 15))
        u_Nm = reach * (session % 3 != 2)
        y = warmed(real, u_Nm, state)
        winding, case = (np.r_[x, y[n][19::20]] for x, n in zip(state, NODES, strict=True))
        square = np.mean(u_Nm.reshape(-1, 20) ** 2, axis=1)
        given_J += 0.1 * np.sum(loss_W(1.0, winding[:-1]) * square)
        gone_J += 0.1 * np.sum(case[:-1] - AMBIENT) / R_CA
        state = float(winding[-1]), float(case[-1])
    held_J = C_W * (state[0] - 40) + C_C * (state[1] - 40)
    assert given_J > 5000
    assert held_J + gone_J == pytest.approx(given_J, rel=1e-6 if real == "f64" else 2e-3)


@pytest.mark.parametrize("real", ["f32", "q31"])
def test_after_a_start_it_is_never_cooler_than_a_motor_that_went_on(real):
    """Whatever was before and whatever follows: the model that knows nothing is the warmer one."""
    rng, steps = np.random.default_rng(7), 60_000
    unknown = [p.init for p in warm().system.blocks["motor_temperature"].state[: len(NODES)]]
    for _ in range(8):
        winding = rng.uniform(40, MAX)
        case = rng.uniform(40, min(winding, 40 + (MAX - 40) * R_CA / (R_CA + R_WC)))
        u = np.repeat(rng.uniform(-0.15, 0.15, 30), steps // 30)
        fresh, went_on = warmed(real, u, unknown), warmed(real, u, (winding, case))
        assert all(np.all(fresh[n] >= went_on[n] - 1e-4) for n in NODES)
        assert np.all(fresh["u_thermal_Nm"] <= went_on["u_thermal_Nm"] + 1e-6)
        told = warmed(real, u, (winding, case), measured_C=rng.uniform(-60, 150))
        assert all(np.all(told[n] >= went_on[n] - 1e-4) for n in NODES)


@pytest.mark.ci
@pytest.mark.parametrize(("real", "sign"), [("f32", 1.0), ("f32", -1.0), ("q31", 1.0)])
def test_full_torque_for_an_hour_ends_below_the_largest_temperature(real, sign):
    """Closed over its own limit; the torque falls without a jump."""
    runner = library(real).block("motor_temperature")
    runner.put_state(dict.fromkeys(NODES, 40.0))
    left, winding = [U_MAX], []
    for _ in range(36_000):
        y, _ = runner.run(
            {"u_Nm": np.full(20, sign * left[-1]), "motor_C": np.zeros(20)}, trace=False
        )
        left.append(min(U_MAX, float(y["u_thermal_Nm"][-1])))
        winding.append(float(y["winding_C"][-1]))
    assert max(winding) < MAX
    assert 0.05 * U_MAX < left[-1] < 0.9 * U_MAX
    assert np.max(np.abs(np.diff(left))) < 0.05 * U_MAX
    steady = AMBIENT + loss_W(left[-1], winding[-1]) * (R_WC + R_CA)
    assert winding[-1] == pytest.approx(steady, abs=1)


@pytest.mark.parametrize("real", [*F64, "f32", "q31"])
@pytest.mark.parametrize(
    ("measured", "winding", "fault"),
    [
        (124.5, 124.5, Fault.NONE),
        (126.0, 126.0, Fault.MOTOR_HOT),
        *((x, START, Fault.NONE) for x in (np.nan, np.inf, 999.0, -999.0)),
    ],
)
def test_a_hot_winding_takes_the_torque_and_then_latches(real, recorded, measured, winding, fault):
    """The drive measures it; what no sensor of a winding reads changes nothing."""
    given, board, rows = recorded, library(real).board(), []
    for tick in range(280):
        board.release(tick)
        y = board.step("sense", **{n: v[tick] for n, v in given["sense"].items()})
        rows.append((abs(float(y["u_Nm"])), int(y["fault"])))
        if tick % 5 == 0:
            heard = {"motor_C": measured if tick > 175 else 0.0}
            board.step("control", **{n: v[tick // 5] for n, v in given["control"].items()} | heard)
    u, faults = np.array(rows).T
    share = 0.0 if fault else 0.05 + 0.95 * (MAX - winding) / (MAX - DERATE)
    most, later = np.max(u[150:176]), np.max(u[230:])
    assert winding == START or most > 1.2 * share * U_MAX
    assert later <= 1.02 * share * U_MAX
    assert later >= 0.9 * share * U_MAX
    assert np.all(faults[230:] == fault)


@pytest.mark.parametrize("real", [*F64, "f32", "q31"])
def test_one_wild_reading_warms_by_half_a_kelvin_and_a_real_rise_is_followed(real):
    """100 K/s at most, so 0.5 K in a control period of 5 ms."""
    u, start = np.zeros(400), (45.0, 45.0)
    alone = warmed(real, u, start)["winding_C"]
    for wild in (140.0, 299.0, 999.0, np.nan):
        spoilt = warmed(real, u, start, np.where(np.arange(400) == 100, wild, 44.0))["winding_C"]
        assert np.max(spoilt - alone) < 0.501
        assert spoilt[100] - alone[100] == pytest.approx(0.5 * (0 < wild < 300), abs=1e-3)
    rise = 45 + 90 * H * np.arange(400)
    followed = warmed(real, u, start, np.minimum(rise, 140.0))["winding_C"]
    assert followed == pytest.approx(np.minimum(rise, 140.0), abs=0.5)


@pytest.mark.ci
def test_the_emitted_c_is_the_model_and_every_branch_is_taken():
    device = warm(start_C=START)
    assert verify(device, blocks=["motor_temperature", "limits"]).passed
    block = device.system.blocks["motor_temperature"]
    tried = [*streams(block), at_the_limits(block, np.dtype(np.float32))]
    assert branch_coverage(block, tried, library("f32")).uncovered == []


def test_a_section_that_makes_no_sense_is_refused():
    for changed, words in (
        ({"derate_C": 124.5}, r"derate_C = 124.5 is not 1 K below max_C = 125"),
        ({"ambient_C": 70.0, "derate_C": 60.0}, "ambient_C = 70 is above motor_thermal.derate_C"),
        ({"start_C": 130.0}, "start_C = 130 is above motor_thermal.max_C = 125"),
        ({"winding_s": float("nan")}, "winding_s"),
        ({"k_t_Nm_A": 0.0}, "k_t_Nm_A"),
        ({"k_t_Nm_A": 37.0}, "by 7.8e-05 K, below its limit 5.*mNm/A"),
        ({"resistance_Ohm": 400.0}, r"by 273 K, above max_C less ambient_C \(85 K\)"),
    ):
        with pytest.raises(UserError, match=words):
            warm(**changed)
