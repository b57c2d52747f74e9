"""Predictive control: rollout, sensitivities and command against a second derivation."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from esea_gen.control.predictive.box_qp import packed
from esea_gen.control.predictive.drive import predictive_controller
from esea_gen.control.predictive.horizon import Horizon, Model, Tape
from esea_gen.control.predictive.program import FLAGS, predictive_program
from esea_gen.control.predictive.rubber_ahead import SMOOTH_RAD, SMOOTH_RAD_S
from esea_gen.device import load_device, parse_device
from esea_gen.hostlib.library import CRunner, HostLibrary
from esea_gen.language.ports import Port, Tunable
from tests.rendered_program import render_program

BIT = {f.name: 1 << i for i, f in enumerate(FLAGS)}


def compiled(program, real: str) -> CRunner:
    renderer = render_program(program, real)
    return HostLibrary(renderer.system, renderer).block(program.name)


def pade(x):
    """Of tanh, up to where it reaches 1."""
    smooth = ca.fmin(ca.fmax(x, -3), 3)
    return smooth * (27 + smooth**2) / (27 + 9 * smooth**2)


class Plain:
    """The same plant written a second time: stop operators in their clip form (3.5 to 3.7), the
    torque summed from its parts, nothing split or shared; derivatives by CasADi over all of it."""

    def __init__(self, device, horizon: Horizon, q: float, r: float, free: float = 1.0, **law):
        f, e = device.file, device.file.elastomer
        self.device, self.z, self.q, self.r, self.law = device, horizon, q, r, law
        self.a, self.e = f.actuator, e
        self.load = free / f.joint.Jh_kgm2.value
        self.fade = f.disturbance.decay_s.value
        if e is not None:
            self.numbers(e)

    def numbers(self, e):
        self.radius = [e.omega_rad.value * (i + 1) for i in range(int(e.stops.value))]
        self.weight = [
            e.alpha_Nm_rad.value * math.exp(-e.beta_1_rad.value * x) for x in self.radius
        ]
        self.dead = e.dead_zone_rad.value if e.dead_zone_rad else 0.0

    def beyond(self, delta):
        return ca.fmax(delta - self.dead, 0) + ca.fmin(delta + self.dead, 0)

    @staticmethod
    def outside(device, delta: float) -> float:
        zone = device.file.elastomer.dead_zone_rad
        return float(np.sign(delta) * max(abs(delta) - (zone.value if zone else 0.0), 0.0))

    @classmethod
    def drawn(cls, rng, device, delta: float) -> dict:
        """What the sensor tells of the rubber."""
        return {"play_rad": cls.outside(device, delta) - nested(rng, device)}

    def torque(self, s: dict):
        d = self.beyond(s["delta"])
        hysteresis = sum(w * x for w, x in zip(self.weight, s["stops"], strict=True))
        return self.e.k3_Nm_rad3.value * d**3 + self.e.k1_Nm_rad.value * d + s["tau_r"] + hysteresis

    def first(self, given: dict) -> dict:
        """The rubber's memory at the measurement."""
        return {
            "tau_r": given.get("tau_rate_Nm", 0.0),
            "stops": [self.beyond(given["delta_rad"]) - x for x in given["play_rad"]],
        }

    def remember(self, s: dict, delta, h: float) -> dict:
        """And after a step to a deflection."""
        m = self.e.maxwell
        change = self.beyond(delta) - self.beyond(s["delta"])
        stops = [
            ca.fmax(ca.fmin(x + change, r), -r)
            for x, r in zip(s["stops"], self.radius, strict=True)
        ]
        tau_r = s["tau_r"]
        if m:
            mid, rate = self.beyond(s["delta"]) + change / 2, change / h
            eta = (
                m.A_Nms_rad.value * (mid**2 + SMOOTH_RAD**2) ** (m.m.value / 2)
                + m.eps1_Nms_rad.value
            ) / (m.B.value * (rate**2 + SMOOTH_RAD_S**2) ** (m.n.value / 2) + m.eps2.value)
            x = h * m.kv_Nm_rad.value / eta
            tau_r = (tau_r + m.kv_Nm_rad.value * change * (1 + x / 2 + x**2 / 6)) / (
                1 + x + x**2 / 2 + x**3 / 6
            )
        return {"delta": delta, "tau_r": tau_r, "stops": stops}

    def advance(self, s: dict, u, tau_h, d4, h: float) -> dict:
        a = self.a
        inertia = a.J_kgm2.value
        keep = math.exp(-h / a.tau_c_s.value)
        mean = u + (s["u_a"] - u) * (1 - keep) * a.tau_c_s.value / h
        tau = self.torque(s)
        om = s["om"] + h / 2 * ((a.gear_ratio.value * mean - tau) / inertia + d4)
        ol = s["ol"] + h / 2 * self.load * (tau + tau_h)
        sig = pade(om / a.coulomb_width_rad_s.value)
        drag = (a.fv_Nms_rad.value * om + a.fc_Nm.value * sig) / inertia
        stiff = (
            a.fv_Nms_rad.value + a.fc_Nm.value / a.coulomb_width_rad_s.value * (1 - sig**2)
        ) / inertia
        om_2 = om - h * drag / (1 + h / 2 * stiff)
        memory = self.remember(s, s["delta"] + h * ((om + om_2) / 2 - ol), h)
        tau = self.torque(memory)
        return {
            **memory,
            "om": om_2 + h / 2 * ((a.gear_ratio.value * mean - tau) / inertia + d4),
            "ol": ol + h / 2 * self.load * (tau + tau_h),
            "tl": s["tl"] + h * ol,
            "u_a": u + keep * (s["u_a"] - u),
        }

    def residuals(self, given: dict, z) -> list:
        """Residuals of the cost, first the errors, then the efforts, for inputs z (casadi SX)."""
        hz, u_max = self.z, self.a.u_max_Nm.value
        u_max = predictive_controller(self.device).outputs[0].high if u_max else u_max
        s = {
            "delta": given["delta_rad"],
            "om": given["omega_m_rad_s"]
            if "omega_m_rad_s" in given
            else given["omega_l_rad_s"] + given["omega_rad_s"],
            "ol": given["omega_l_rad_s"],
            "tl": given.get("theta_l_rad", 0.0),
            "u_a": given["u_a_Nm"],
            **self.first(given),
        }

        def human(t: float) -> float:
            if "tau_h_curve_Nm_s2" in given:
                parabola = (0.5 * given["tau_h_curve_Nm_s2"], given["tau_h_rate_Nm_s"])
                return float(np.clip(np.polyval([*parabola, given["tau_h_Nm"]], t), -20, 20))
            return given["tau_h_Nm"] + given["tau_h_rate_Nm_s"] * self.fade * (
                1 - math.exp(-t / self.fade)
            )

        d4 = given["d4_rad_s2"]
        # In steps no longer than those of the horizon.
        count = math.ceil(hz.delay_s * hz.substeps / hz.interval_s - 1e-9)
        for _ in range(count):
            late = hz.delay_s / count
            s = self.advance(s, given["u_in_force_Nm"], human(hz.delay_s / 2), d4, late)
        errors, efforts, end = [], [], hz.delay_s
        for k in range(hz.intervals):
            u = u_max * z[k]
            many = lasts(hz, k)
            weight, length = math.sqrt(many), many * hz.interval_s
            efforts.append(weight * math.sqrt(self.r) / self.a.tau_c_s.value * (u - s["u_a"]))
            for _ in range(hz.substeps):
                s = self.advance(s, u, human(end + 0.5 * length), d4, length / hz.substeps)
            end += length
            wanted = np.broadcast_to(given["tau_d_Nm"], hz.intervals)[k]
            e = self.torque(s) - wanted
            if self.law:
                path = np.broadcast_to(given["theta_d_rad"], hz.intervals)[k]
                rate = np.broadcast_to(given["omega_d_rad_s"], hz.intervals)[k]
                e += self.law["Kp"] * (s["tl"] - path)
                e += self.law["Kd"] * (s["ol"] - rate)
            errors.append(weight * math.sqrt(self.q) * e)
        return errors + efforts

    def problem(self, given: dict, plan: np.ndarray):
        """Residuals and Jacobian at a plan, the Jacobian also by central differences."""
        z = ca.SX.sym("z", self.z.intervals)
        r = ca.vertcat(*self.residuals(given, z))
        f = ca.Function("r", [z], [r, ca.jacobian(r, z)])
        value, jacobian = (np.array(x) for x in f(plan))
        step = 1e-6
        difference = np.empty_like(jacobian)
        for j in range(len(plan)):
            d = np.zeros(len(plan))
            d[j] = step
            ends = (np.array(f(plan + d)[0]), np.array(f(plan - d)[0]))
            difference[:, j] = (ends[0] - ends[1])[:, 0] / (2 * step)
        return value[:, 0], jacobian, difference


def nested(rng, device) -> np.ndarray:
    """A memory that some history can have left: each stop within reach of the one before."""
    e = device.file.elastomer
    gap, state, last = e.omega_rad.value, [], 0.0
    for i in range(int(e.stops.value)):
        r = gap * (i + 1)
        # Often at its bound: there the derivative switches.
        last = float(np.clip(last + rng.choice([-1, 1, rng.uniform(-1, 1)]) * gap, -r, r))
        state.append(last)
    return np.array(state)


def situation(rng, device, program, plain=Plain) -> dict:
    delta = rng.uniform(-0.2, 0.2)
    calm = 10 ** rng.uniform(-2, 0)
    given = {
        "delta_rad": delta,
        "omega_rad_s": rng.normal() * calm,
        "omega_l_rad_s": rng.normal() * calm,
        "u_a_Nm": rng.uniform(-0.1, 0.1),
        "u_in_force_Nm": rng.uniform(-0.2, 0.2),
        "tau_rate_Nm": rng.normal() * 0.3,
        **plain.drawn(rng, device, delta),
        "d4_rad_s2": rng.normal() * 0.5,
        "tau_h_Nm": rng.normal() * 2 * calm,
        "tau_h_rate_Nm_s": rng.normal() * 5 * calm,
        "mode": 1.0,
        "theta_l_rad": rng.uniform(0, 2),
        "theta_d_rad": rng.uniform(0, 2),
        "omega_d_rad_s": rng.normal() * calm,
        "omega_m_rad_s": rng.normal() * calm,
        "tau_h_curve_Nm_s2": rng.normal() * 30 * calm,
    }
    ports = {p.name: p for p in program.inputs}
    for name, middle, size in (
        ("tau_d_Nm", 0.0, 1.0),
        ("theta_d_rad", 1.0, 0.5),
        ("omega_d_rad_s", 0.0, calm),
    ):
        if name in ports:
            drawn = middle + size * np.clip(rng.normal(size=ports[name].size), -3, 3)
            given[name] = drawn if len(drawn) > 1 else float(drawn[0])
    return {k: v for k, v in given.items() if k in ports}


def lasts(horizon: Horizon, k: int) -> int:
    return 1 if k < horizon.intervals - horizon.long_intervals else 2


def warm(plan: np.ndarray, horizon: Horizon, period_s: float) -> np.ndarray:
    lengths = [horizon.interval_s * lasts(horizon, k) for k in range(len(plan) - 1)]
    share = np.minimum(1, period_s / np.array(lengths))
    return np.append(plan[:-1] + share * (plan[1:] - plan[:-1]), plan[-1])


def check_linearisation(
    device,
    horizon: Horizon,
    seed: int,
    q=300.0,
    r=1.0,
    preview=False,
    law=(),
    person="extended_state",
    plain=Plain,
):
    """Rows of the Jacobian, Hessian and command against :class:`Plain`."""
    rng = np.random.default_rng(seed)
    program = predictive_controller(
        device, horizon=horizon, preview=preview, impedance=bool(law), person=person
    )
    executor = program.simulator({"Q": q, "R": r})
    second = plain(device, horizon, q, r, **dict(law))
    given = situation(rng, device, program, plain)
    if law:
        given |= {"Kp_Nm_rad": law["Kp"], "Kd_Nms_rad": law["Kd"]}
    plan = rng.uniform(-0.5, 0.5, horizon.intervals)
    executor.state = {"plan": plan}
    out = executor.step(**given)
    start = warm(plan, horizon, program.period_s)
    value, jacobian, difference = second.problem(given, start)
    n = horizon.intervals
    mine = np.zeros((2 * n, n))
    for block, name in ((0, "error_0"), (n, "effort_0")):
        rows = executor.array(f"{name}_rows")
        for k in range(n):
            for j in range(k + 1):
                mine[block + k, j] = rows[packed(k, j)]
    scale = np.max(np.abs(jacobian))
    assert np.max(np.abs(mine - jacobian)) < 1e-9 * scale
    # The clip's corners are the only places where differences may disagree.
    smooth = np.abs(jacobian - difference) < 1e-6 * scale
    hessian = np.array([[executor.array("qp_H")[packed(i, j)] for j in range(n)] for i in range(n)])
    assert hessian == pytest.approx(jacobian.T @ jacobian, rel=1e-9, abs=1e-12 * scale**2)
    if person == "extended_state":
        value[n:] *= 0.3  # of the last plan's effort 0.7 is left free
    gradient = jacobian.T @ (value - jacobian @ start)
    assert executor.array("qp_f") == pytest.approx(gradient, rel=1e-8, abs=1e-10 * scale**2)
    best = lsq_linear(
        jacobian, jacobian @ start - value, (-1, 1), tol=1e-14, lsq_solver="exact", method="bvls"
    ).x
    assert executor.state["plan"] == pytest.approx(best, abs=1e-6)
    assert out["status"] == 0
    assert out["u_Nm"] == pytest.approx(best[0] * program.outputs[0].high, abs=1e-7)
    return smooth


@pytest.fixture(scope="module")
def program(drive):
    return predictive_controller(drive)


@pytest.fixture(scope="module")
def runners(program):
    return {real: compiled(program, real) for real in ("f64", "f32")}


@pytest.mark.parametrize("seed", range(3))
def test_sensitivities_and_command_against_a_second_derivation(drive, seed):
    assert np.mean(check_linearisation(drive, Horizon(6, long_intervals=3), seed)) > 0.9


@pytest.mark.ci
@settings(max_examples=12)
@given(
    st.integers(2, 12),
    st.integers(0, 11),
    st.sampled_from([0.005, 0.02, 0.05]),
    st.integers(1, 10),
    st.floats(0, 1),
    st.floats(1, 1e3),
    st.floats(0.01, 10),
    st.booleans(),
    st.booleans(),
    st.sampled_from(["extended_state", "parabola"]),
    st.integers(0, 10**6),
)
def test_any_grid_delay_weights_and_option(
    n, longer, interval_s, substeps, late, q, r, preview, impedance, person, seed
):
    # From no delay to all of the horizon; the tied operators' stated passes are checked as it runs.
    delay_s = round(late * min(0.1, n * interval_s), 4)
    horizon = Horizon(n, interval_s, substeps, delay_s, min(longer, n - 1))
    law = {"Kp": 1.5, "Kd": 0.25} if impedance else {}
    check_linearisation(load_device("elbow_drive"), horizon, seed, q, r, preview, law, person)


@pytest.mark.parametrize("seed", [3, 4])
def test_impedance_in_one_layer(drive, seed):
    check_linearisation(
        drive, Horizon(intervals=6), seed, q=1.0, r=0.005, preview=True, law={"Kp": 1.5, "Kd": 0.25}
    )


def other(base: str, name: str):
    """A device with the elastomer of another one and the elbow's drive."""
    from esea_gen.devices.file import shipped_devices

    text = shipped_devices()["elbow_drive"].read_text()
    text = text.replace('extends = "elbow"', f'extends = "{base}"')
    return parse_device(text.replace('name = "elbow_drive"', f'name = "{name}"'), f"{name}.toml")


@pytest.mark.ci
@pytest.mark.parametrize("base", ["wrist", "knee"])
def test_other_devices(base):
    # The knee has a dead zone and no rate terms or both, as its file says.
    device = other(base, f"{base}_drive")
    horizon = Horizon(intervals=4)
    for seed in (1, 2, 3):
        check_linearisation(device, horizon, seed)


def mass_on_a_rail(n: int, **more) -> Model:
    """A made-up plant without memory: a mass with drag; two errors and a quadratic drag term."""

    def substep(t: Tape, h, x, u, p, w):
        v = t.let("v_next", x.v + h * t.let("force", u - p.drag * x.v * ca.sqrt(x.v**2 + 1)))
        return {"s": x.s + h * v, "v": v}

    return Model(
        states=("s", "v"),
        start=lambda u, tau: {"s": u.s_rad, "v": u.v_rad_s},
        substep=substep,
        error=lambda x, p, ref: [p.root * (x.s - ref.wanted), 0.2 * x.v],
        effort=lambda x, u, p: [0.05 * u],
        inputs=(
            Port("s_rad", -10, 10, "place"),
            Port("v_rad_s", -10, 10, "speed"),
            Port("u_before_Nm", -2, 2, "command in force"),
            Port("wanted_rad", -10, 10, "wanted place", n),
        ),
        in_force="u_before_Nm",
        references={"wanted": ("wanted_rad", True)},
        parameters=("drag", "root"),
        u_max=2.0,
        tunables=(
            Tunable("drag", 0.0, 0.0, 1.0, "quadratic drag"),
            Tunable("weight", 4.0, 0.1, 100.0, "weight of the place"),
        ),
        coefficients=(Port("drag", 0, 1, "drag"), Port("root", 0, 10, "root of the weight")),
        prepare=lambda t: {"drag": t.drag, "root": ca.sqrt(t.weight)},
        **more,
    )


@pytest.mark.ci
@pytest.mark.parametrize("n", [2, 30, 100])
def test_a_made_up_linear_plant_has_the_closed_solution(n):
    # Without drag the plant is linear, so that one iteration is the exact optimum, from matrices.
    h, m = 0.02, 3
    horizon = Horizon(intervals=n, interval_s=h * m, substeps=m, delay_s=0.0)
    program = predictive_program(mass_on_a_rail(n), horizon, period_s=0.02, name="rail")
    rng = np.random.default_rng(n)
    given = {"s_rad": 1.5, "v_rad_s": -0.4, "u_before_Nm": 0.0, "wanted_rad": rng.normal(size=n)}
    step = np.linalg.matrix_power(np.array([[1, h], [0, 1]]), m)
    push = sum(np.linalg.matrix_power([[1, h], [0, 1]], i) @ [[h * h], [h]] for i in range(m))
    rows, want = [], []
    for k in range(1, n + 1):
        base = np.linalg.matrix_power(step, k) @ [1.5, -0.4]
        gain = np.zeros((2, n))
        for j in range(k):
            gain[:, [j]] = np.linalg.matrix_power(step, k - 1 - j) @ push * 2.0
        rows += [2.0 * gain[0], 0.2 * gain[1]]
        want += [2.0 * (given["wanted_rad"][k - 1] - base[0]), -0.2 * base[1]]
    rows, want = np.vstack([*rows, 0.1 * np.eye(n)]), np.append(want, np.zeros(n))
    for real, off, lost in (("f64", 1e-9, 1e-12), ("f32", 3e-4, 1e-5)):
        runner = compiled(program, real)
        assert runner.step(**given)["status"] == 0
        plan = runner.state["plan"][0].astype(float)
        # First-order conditions prove the minimum of a strictly convex problem.
        gradient = rows.T @ (rows @ plan - want)
        assert np.max(np.abs(np.clip(plan - gradient / np.diag(rows.T @ rows), -1, 1) - plan)) < off
        assert np.any(np.abs(plan) == 1)
        if real == "f64":
            best, double = np.sum((rows @ plan - want) ** 2), runner
        assert np.sum((rows @ plan - want) ** 2) <= best * (1 + lost)
    if n == 2:
        simulator = program.simulator()
        simulator.step(**given)
        assert np.array_equal(simulator.state["plan"], double.state["plan"][0])


SPECIAL = [np.nan, np.inf, -np.inf, 3e38, -3e38]


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_nothing_invalid_passes(drive, program, runners, real):
    rng = np.random.default_rng(2)
    runner = runners[real]
    limit = program.outputs[0].high
    for name in [p.name for p in program.inputs]:
        for value in SPECIAL:
            given = situation(rng, drive, program)
            if np.ndim(given[name]):
                given[name] = given[name].copy()
                given[name][rng.integers(len(given[name]))] = value
            else:
                given[name] = value
            runner.reset()
            out = runner.step(**given)
            assert out["u_Nm"] == 0.0, (name, value)
            assert out["status"] & BIT["INPUT_INVALID"]
            assert not np.any(runner.state["plan"])
            assert runner.step(**situation(rng, drive, program))["status"] == 0
    for field in runner.state.dtype.names:
        for value in SPECIAL:
            given = situation(rng, drive, program)
            runner.reset()
            fresh = runner.step(**given)
            runner.reset()
            state = runner.state
            if state[field].dtype.kind != "f":
                continue
            if state[field].ndim > 1:
                state[field][0, rng.integers(state[field].shape[1])] = value
            else:
                state[field] = value
            runner.state = state
            out = runner.step(**given)
            assert abs(out["u_Nm"]) <= limit, (field, value)
            # A corrupt plan is told of; work arrays carry nothing into a step.
            if field == "plan":
                assert out["status"] == BIT["STATE_REPAIRED"]
            else:
                assert out["status"] == 0
            assert out["u_Nm"] == fresh["u_Nm"]


@pytest.mark.ci
@pytest.mark.parametrize("fault", ["flat", "not a number", "cap"])
def test_a_deliberate_fault_of_the_qp_gives_a_safe_command_and_an_honest_status(fault):
    from dataclasses import replace

    n = 4
    model = mass_on_a_rail(n)
    if fault == "flat":  # a cost that does not depend on the input: the Hessian is 0
        model = replace(
            model, error=lambda x, p, ref: [0.0 * x.v], effort=lambda x, u, p: [0.0 * u]
        )
    elif fault == "not a number":  # the root of a negative number, deep in the rollout
        model = replace(model, error=lambda x, p, ref: [ca.sqrt(x.s - 50.0)])
    horizon = Horizon(n, 0.1, 2, 0.0)
    cap = 0 if fault == "cap" else None
    program = predictive_program(model, horizon, period_s=0.02, name="rail", cap=cap)
    given = {"s_rad": 9.0, "v_rad_s": 1.0, "u_before_Nm": 0.0, "wanted_rad": np.full(n, -9.0)}
    steps = [program.simulator().step(**given)]
    steps += [compiled(program, real).step(**given) for real in ("f64", "f32")]
    for out in steps:
        assert abs(float(out["u_Nm"])) <= 2.0
        if fault == "cap":
            assert int(out["status"]) == BIT["CAP_REACHED"] | BIT["NOT_OPTIMAL"]
        else:
            assert out["u_Nm"] == 0.0
            assert int(out["status"]) & BIT["NOT_CONVEX"]
    # The same plant without the fault asks for all that there is.
    sound = predictive_program(mass_on_a_rail(n), horizon, period_s=0.02, name="rail")
    out = sound.simulator().step(**given)
    assert (out["status"], out["u_Nm"]) == (0, -2.0)
