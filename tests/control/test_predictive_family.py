"""Predictive control of a rubber that is a member of the elastomer family."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.control.predictive.drive import drive_model
from esea_gen.control.predictive.horizon import Horizon, linearise
from esea_gen.control.predictive.rubber_ahead import FamilyAhead, rubber_ahead
from esea_gen.device import Device, parse_device
from esea_gen.identify.family.identification import family_device
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.rubber import rubber_sensor
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy, simulate_case
from tests.control.test_predictive import Plain, check_linearisation
from tests.model.test_family_device import EVERY, drive

LINEAR, CUBIC = Rise("power", 1), Rise("power", 3)
# The seismic bearing of docs/torque-model-errors.md, weights rounded.
BEARING = FittedMember(
    Member(
        "slips, worn",
        "bearing",
        (
            Term("spring", LINEAR),
            Term("spring", LINEAR, softening=Softening("strain", 0.3)),
            Term("spring", LINEAR, softening=Softening("path", 40.0)),
            Term("spring", CUBIC),
            Term("spring", CUBIC, softening=Softening("path", 40.0)),
            Term("slip", LINEAR, (0.03,)),
            Term("slip", LINEAR, (0.3,), softening=Softening("path", 8.0)),
            Term("slip", CUBIC, (0.03,)),
            Term("slip", CUBIC, (0.1,)),
            Term("slip", CUBIC, (0.3,)),
        ),
    ),
    0.1967,
    (0.076, 3.40, 1.75, 1.16, 0.45, 13.1, 0.88, 4.11, 0.85, 0.69),
)


@pytest.fixture(scope="module")
def devices(elbow) -> dict[str, Device]:
    """The elbow's drive with each rubber."""
    found = {"every": EVERY, "bearing": BEARING}
    return {
        n: parse_device(drive(family_device(elbow, f, "drawn"), "elbow_mpc"), f"{n}.toml")
        for n, f in found.items()
    }


def sensor_at(device: Device, period_s: float):
    """The torque sensor Block, running at another rate."""
    timing = device.file.timing
    rate = timing.sense_rate_Hz.model_copy(update={"value": 1 / period_s})
    new = timing.model_copy(update={"sense_rate_Hz": rate})
    return rubber_sensor(Device(device.file.model_copy(update={"timing": new}), device.origin))


class Values:
    """A tape that names nothing: what is written is the value."""

    def let(self, _name, value):
        return ca.SX(value)

    keep = power = lambda self, _name, value, *_: ca.SX(value)


def moves(rng, seconds: float, h: float) -> np.ndarray:
    """A person's motion in the trained range, with turns large and small."""
    t = np.arange(0, seconds, h)
    parts = [rng.uniform(0.2, 1) / f * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in
             (0.7, 2.3, 6.1)]  # fmt: skip
    motion = np.sum(parts, axis=0)
    return 0.18 * motion / np.abs(motion).max()


def predicted(
    rubber: FamilyAhead, told: dict, deflections: np.ndarray, h: float, tunables: dict
) -> np.ndarray:
    """Torque along deflections, from what the sensor tells at the first one."""
    prepared = rubber.temperature["prepare"](SimpleNamespace(**tunables)) if tunables else {}
    p = SimpleNamespace(**prepared)
    x = rubber.start(SimpleNamespace(**told), 0.0) | {"delta": ca.SX(deflections[0])}
    torque = []
    for delta in deflections[1:]:
        found = rubber.step(Values(), h, SimpleNamespace(**x), ca.SX(delta), None, p)
        x = {k: ca.SX(v) for k, v in found.items()} | {"delta": ca.SX(delta)}
        torque.append(float(x["tau_e"]))
    return np.array(torque)


def told_by(simulator, out) -> dict:
    """What the wires bring from the sensor."""
    memory = {n: np.array(v).ravel() for n, v in simulator.state.items()}
    return memory | {"tau_Nm": out["tau_Nm"].ravel()[-1:]}


def both(
    device: Device, h: float, sense_s: float, seed: int, carried=lambda told: told, **tunables
):
    """Predicted torque over 0.3 s of a known motion, and the sensor's, at each substep's end."""
    rng = np.random.default_rng(seed)
    fine = round(h / sense_s)
    coarse = moves(rng, 2.3, h)
    at = np.arange(0, len(coarse) - 1 + 1e-9, 1 / fine)
    motion = np.interp(at, np.arange(len(coarse)), coarse)
    simulator, start = sensor_at(device, sense_s).simulator(tunables), round(2.0 / h)
    zero = np.zeros(start * fine + 1)
    out, _ = simulator.run({"theta_rad": motion[: len(zero)], "omega_rad_s": zero})
    told = carried(told_by(simulator, out))
    rest = motion[len(zero) :]
    after = simulator.run({"theta_rad": rest, "omega_rad_s": 0 * rest})[0]["tau_Nm"].ravel()
    mine = predicted(rubber_ahead(device), told, coarse[start:], h, tunables)
    return mine, after[fine - 1 :: fine]


@pytest.mark.ci
@pytest.mark.parametrize("name", ["every", "bearing"])
@pytest.mark.parametrize("h", [0.002, 0.005])
def test_the_prediction_of_a_known_motion_is_what_the_sensor_says(devices, name, h):
    """To rounding where the sensor runs at the substeps' ends, softening and all."""
    mine, sensed = both(devices[name], h, h, 3)
    assert len(mine) > 50
    assert np.ptp(sensed) > 0.5
    assert mine == pytest.approx(sensed, abs=1e-12)


class FamilyPlain(Plain):
    """The plant with the sensor Block for its rubber, differentiated as a whole by CasADi."""

    @classmethod
    def drawn(cls, rng, device, delta: float) -> dict:
        simulator = rubber_sensor(device).simulator()
        motion = moves(rng, 0.5, device.period_s)
        motion += (delta - motion[-1]) * np.linspace(0, 1, len(motion)) ** 2
        out, _ = simulator.run({"theta_rad": motion, "omega_rad_s": 0 * motion})
        told = told_by(simulator, out)
        return {k: v if v.size > 1 else float(v[0]) for k, v in told.items()}

    def first(self, given: dict) -> dict:
        return {"rubber": given, "tau": given["tau_Nm"]}

    def torque(self, s: dict):
        return s["tau"]

    def remember(self, s: dict, delta, h: float) -> dict:
        block = sensor_at(self.device, h)
        memory = dict(s["rubber"]) | {"primed": 1.0, "theta_prev_rad": s["delta"]}
        found = block.step(*[ca.SX(memory[p.name]) for p in block.state], delta, ca.SX(0))
        kept = {p.name: x for p, x in zip(block.state, found, strict=False)}
        return {"delta": delta, "rubber": kept, "tau": found[len(block.state)]}


@pytest.mark.ci
@pytest.mark.parametrize("name", ["every", "bearing"])
@pytest.mark.parametrize("seed", [1, 2])
def test_sensitivities_and_command_against_the_sensor_as_plant(devices, name, seed):
    """Jacobian, Hessian, command; and the Jacobian against central differences."""
    horizon = Horizon(intervals=4, substeps=2, delay_s=0.002)
    assert np.mean(check_linearisation(devices[name], horizon, seed, plain=FamilyPlain)) > 0.8


@pytest.mark.parametrize("name", ["every", "bearing"])
def test_a_substep_with_the_cable_against_central_differences(devices, name):
    """Every state and the input; within the sensor's range and beyond it."""
    device, h = devices[name], 0.005
    model = drive_model(device, Horizon(delay_s=0.002), impedance=True, train="cable")
    lin = linearise(model, h, model.u_max)
    rng, n = np.random.default_rng(4), len(model.states)
    p = np.array([0.3, 20.0, 0.5, 4.5, 1.0, 0.1, 0.01, 0.006])[: len(model.parameters)]
    ports = {q.name: q for q in model.inputs}

    def following(x, u):
        named, _ = lin.before(x, u, p, 0.2)
        return np.array(lin.onward(x, u, p, 0.2, named, 0.0)).ravel()

    for beyond in (False, True):
        told = FamilyPlain.drawn(rng, device, 0.1)
        told |= {q: rng.normal() * 0.3 for q in ports if q not in told and ports[q].size == 1}
        told["slip"] = 0.9 * told["slip"]  # off its corner, where the sides differ
        told["delta_rad"] = 0.5 if beyond else 0.1
        start = model.start(SimpleNamespace(**{k: ca.SX(v) for k, v in told.items()}), 0.0)
        x, u = np.array([float(start[s]) for s in model.states]), 0.1
        named, _ = lin.before(x, u, p, 0.2)
        _, k = lin.after(x, u, p, 0.2, named, 0.0, 0.0)
        for i in range(n + 1):
            e, size = np.zeros(n), 1e-7
            if i < n:
                e[i] = 1.0
                mine = lin.column(e, k, 0.0)[0]
                ends = (following(x + size * e, u), following(x - size * e, u))
            else:
                mine = lin.newest(e, k, 0.0)[0]
                step = size * model.u_max
                ends = (following(x, u + step), following(x, u - step))
            difference = (ends[0] - ends[1]) / (2 * size)
            assert np.array(mine).ravel() == pytest.approx(difference, rel=1e-5, abs=1e-6)


@pytest.mark.ci
def test_the_closed_loop_is_three_times_as_close_as_sliding_mode(elbow, tmp_path):
    """True torque error of the tuning case on the bearing's rubber, simulated: 0.042, 0.149 Nm."""
    rig, error = family_device(elbow, BEARING, "drawn"), {}
    for base in ("elbow_mpc", "elbow_drive"):
        path = tmp_path / f"{base}.toml"
        path.write_text(drive(rig, base))
        case = load_study("tuning", ClosedLoopStudy).cases()[0].name
        found = simulate_case("tuning", case, 0, controller=str(path), person="none")
        assert not found["unstable"] + found["tripped"]
        error[base] = found["rms_true_Nm"]
    assert error["elbow_mpc"] < 0.05
    assert error["elbow_mpc"] < error["elbow_drive"] / 3
