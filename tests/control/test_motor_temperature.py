"""The motor's temperature: the two-node model against closed forms, and what it takes away."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from esea_gen.control.limits.faults import Fault
from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.twin.recorded import record_drive
from tests.conftest import require_tool

# Order of a motor of the elbow's size; no data sheet's.
SHEET = {
    "k_t_Nm_A": 0.0369,
    "resistance_Ohm": 0.4,
    "winding_case_K_W": 1.5,
    "case_ambient_K_W": 4.0,
    "winding_s": 20.0,
    "case_s": 900.0,
    "ambient_C": 40.0,
    "derate_C": 110.0,
    "max_C": 125.0,
}
H, U_MAX = 5e-3, 0.221
FORMATS = ("f64", "f32", "q31")
NODES = ("winding_C", "case_C")


def device(**changed: float) -> Device:
    tables = {f"encoder.{side}": {"zero_rad": 0.0} for side in ("motor", "load")}
    lines = ["schema = 1", 'extends = "elbow_drive"', 'name = "warm"', 'title = "warm motor"']
    for table, numbers in (tables | {"motor_thermal": SHEET | changed}).items():
        lines.append(f"[{table}]")
        note = 'status = "assumed", source = "a test"'
        lines += [f"{k} = {{ value = {v}, {note} }}" for k, v in numbers.items()]
    return parse_device("\n".join(lines), "warm.toml")


@cache
def library(real: str, **changed: float) -> HostLibrary:
    require_tool("gcc")
    return compile_device(device(**changed), real)


def warmed(real: str, u_Nm: np.ndarray, state: tuple[float, float] | None = None, **changed: float):
    """Outputs at the end of each period."""
    runner = library(real, **changed).block("motor_temperature")
    runner.reset()
    if state:
        runner.put_state({"winding_C": state[0], "case_C": state[1]})
    return runner.run({"u_Nm": u_Nm}, trace=False)[0]


def capacities() -> tuple[float, float]:
    return (SHEET["winding_s"] / SHEET["winding_case_K_W"],
            SHEET["case_s"] / SHEET["case_ambient_K_W"])  # fmt: skip


def loss_W(u_Nm: float, winding_C: float) -> float:
    hot = 1 + 0.00393 * (winding_C - 25)
    return SHEET["resistance_Ohm"] * (u_Nm / SHEET["k_t_Nm_A"]) ** 2 * hot


def closed_form(u_Nm: float, start: tuple[float, float], time_s: np.ndarray) -> np.ndarray:
    """Two exponentials: the loss grows with the winding's temperature, so all of it is linear."""
    winding_J_K, case_J_K = capacities()
    flow, out = 1 / SHEET["winding_case_K_W"], 1 / SHEET["case_ambient_K_W"]
    slope = loss_W(u_Nm, 25 + 1 / 0.00393) / 2 * 0.00393
    rates = np.array([[(slope - flow) / winding_J_K, flow / winding_J_K],
                      [flow / case_J_K, -(flow + out) / case_J_K]])  # fmt: skip
    given = np.array([loss_W(u_Nm, 0.0) / winding_J_K, out * SHEET["ambient_C"] / case_J_K])
    steady = np.linalg.solve(rates, -given)
    lambdas, modes = np.linalg.eig(rates)
    shares = np.linalg.solve(modes, np.array(start) - steady)
    return steady[:, None] + modes @ (shares[:, None] * np.exp(lambdas[:, None] * time_s))


@pytest.mark.parametrize("real", FORMATS)
@pytest.mark.parametrize("u_Nm", [0.1, -0.1])
def test_a_step_of_torque_warms_by_two_exponentials(real, u_Nm):
    steps = 240_000
    for start in ((45.0, 45.0), (100.0, 70.0)):
        y = warmed(real, np.full(steps, u_Nm), start)
        every = slice(19, None, 2000)
        time_s = H * (1 + np.arange(steps))[every]
        winding, case = closed_form(u_Nm, start, time_s)
        assert np.max(np.abs(y["winding_C"][every] - winding)) < 0.25
        assert np.max(np.abs(y["case_C"][every] - case)) < 0.1


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_a_day_of_sessions_keeps_the_energy(real):
    """What the copper gives off is in winding and case, or gone to the air."""
    rng, chunk = np.random.default_rng(4), round(1200 / H)
    (winding_J_K, case_J_K), state = capacities(), (40.0, 40.0)
    given_J = gone_J = 0.0
    hottest = 0.0
    for session in range(24):  # twenty minutes each: reaches with pauses between, or a break
        t = H * np.arange(chunk)
        reach = 0.16 * np.sin(2 * np.pi * rng.uniform(0.2, 1) * t) * (t % 20 < rng.uniform(5, 15))
        u_Nm = reach * (session % 3 != 2)
        y = warmed(real, u_Nm, state)
        ends = slice(19, None, 20)
        winding, case = (np.r_[x, y[n][ends]] for x, n in zip(state, NODES, strict=True))
        square = np.mean(u_Nm.reshape(-1, 20) ** 2, axis=1)
        given_J += 0.1 * np.sum(loss_W(1.0, winding[:-1]) * square)
        gone_J += 0.1 * np.sum(case[:-1] - SHEET["ambient_C"]) / SHEET["case_ambient_K_W"]
        state, hottest = (float(winding[-1]), float(case[-1])), max(hottest, winding.max())
    held_J = winding_J_K * (state[0] - 40) + case_J_K * (state[1] - 40)
    assert given_J > 5000
    assert hottest > 50
    assert held_J + gone_J == pytest.approx(given_J, rel=1e-6 if real == "f64" else 2e-3)


@pytest.mark.parametrize("real", FORMATS)
def test_after_a_start_it_is_never_cooler_than_a_motor_that_went_on(real):
    """Whatever was before and whatever follows: the model that knows nothing is the warmer one."""
    rng, steps = np.random.default_rng(7), 60_000
    top = SHEET["case_ambient_K_W"] / (SHEET["case_ambient_K_W"] + SHEET["winding_case_K_W"])
    for _ in range(8):
        winding = rng.uniform(40, 125)
        case = rng.uniform(40, min(winding, 40 + top * 85))
        u = np.repeat(rng.uniform(-0.15, 0.15, 30), steps // 30)
        fresh, went_on = warmed(real, u), warmed(real, u, (winding, case))
        for name in NODES:
            assert np.all(fresh[name] >= went_on[name] - 1e-4)
        assert np.all(fresh["u_thermal_Nm"] <= went_on["u_thermal_Nm"] + 1e-6)


@pytest.mark.parametrize(("real", "sign"), [("f32", 1.0), ("f32", -1.0), ("q31", 1.0)])
def test_full_torque_for_an_hour_ends_below_the_largest_temperature(real, sign):
    """Closed over its own limit, in tenths of a second; it falls without a jump."""
    runner = library(real, start_C=40.0).block("motor_temperature")
    runner.reset()
    left, seen = U_MAX, []
    for _ in range(36_000):
        y, _ = runner.run({"u_Nm": np.full(20, sign * min(U_MAX, left))}, trace=False)
        left = float(y["u_thermal_Nm"][-1])
        seen.append((left, float(y["winding_C"][-1])))
    left, winding = np.array(seen).T
    assert winding.max() < SHEET["max_C"]
    assert left[0] == pytest.approx(U_MAX)
    assert 0.05 * U_MAX < left[-1] < 0.9 * U_MAX
    assert np.max(np.abs(np.diff(left))) < 0.05 * U_MAX
    # At rest at last: the loss that is left is what the resistances carry.
    steady = SHEET["ambient_C"] + loss_W(left[-1], winding[-1]) * 5.5
    assert winding[-1] == pytest.approx(steady, abs=1)


@pytest.mark.parametrize("real", FORMATS)
def test_a_hot_winding_takes_the_torque_and_then_latches(real):
    warm = device(start_C=40.0)
    given, board = record_drive(warm, 400).inputs, library(real, start_C=40.0).board()
    memory, rows = board.memory["state"], []

    def to(last: int, first: int = 0) -> None:
        for tick in range(first, last):
            board.release(tick)
            y = board.step("sense", **{n: v[tick] for n, v in given["sense"].items()})
            rows.append((float(y["u_Nm"]), int(y["fault"])))
            if tick % 5 == 0:
                x = {n: v[tick // 5] for n, v in given["control"].items() if n}
                board.step("control", **x)

    to(201)
    assert abs(rows[-1][0]) > 0.01
    assert rows[-1][1] == 0
    kept, field = bytes(memory), board.state.motor_temperature
    (name,) = (n for n in dir(field) if n.startswith("winding_"))
    kind = type(getattr(field, name))
    decode = next(f for f in library(real, start_C=40.0).block("motor_temperature").state_fields
                  if f.port.name == "winding_C")  # fmt: skip
    for winding, fault in ((124.5, 0), (126.0, Fault.MOTOR_HOT)):
        memory[:] = kept
        setattr(field, name, kind(decode.encode(winding)))
        to(220, 201)
        u, faults = zip(*rows[-8:], strict=True)
        share = 0.05 + 0.95 * max(0.0, (125 - winding) / 15)
        assert np.max(np.abs(u)) <= (0.0 if fault else share * U_MAX * 1.02)
        assert set(faults) == {int(fault)}
        assert not fault or rows[-12][1] == fault


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"derate_C": 124.5}, r"derate_C = 124.5 is not 1 K below max_C = 125"),
        ({"ambient_C": 70.0, "derate_C": 60.0}, "ambient_C = 70 is above motor_thermal.derate_C"),
        ({"start_C": 130.0}, "start_C = 130 is above motor_thermal.max_C = 125"),
        ({"winding_s": math.nan}, "winding_s"),
        ({"k_t_Nm_A": 0.0}, "k_t_Nm_A"),
    ],
)
def test_a_section_that_makes_no_sense_is_refused(changed, words):
    with pytest.raises(UserError, match=words):
        _ = device(**changed)
