"""One step of the virtual exoskeleton, typed a second time in NumPy: any plant, person and memory.

The torque sensor's own step stands for the rubber; it is typed again in ``test_model_steps.py``.
What acts at the speed of the step's end is solved for that speed, as in ``test_twin_mechanics.py``.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.twin.plant import plant_block, true_sensor

COUNT, H, RATIO = 600, 2e-4, 74.0
Q = H / 2
TURN = 2 * math.pi
RANGES = {
    "J_kgm2": (0.3, 1.0),
    "fv_Nms_rad": (0.1, 1.0),
    "fc_Nm": (0.1, 1.0),
    "coulomb_width_rad_s": (0.05, 1.0),
    "tau_c_s": (0.001, 0.05),
    "u_max_Nm": (0.05, 0.3),
    "cable_stiffness_Nm_rad": (50, 400),
    "cable_damping_Nms_rad": (0.5, 9.0),
    "cable_backlash_rad": (0.0, 0.04),
    "cable_loss": (0.05, 0.4),
    "cable_loss_width_rad_s": (0.1, 2.0),
    "motor_side_inertia_kgm2": (0.002, 0.02),
    "motor_side_damping_Nms_rad": (0.05, 0.9),
    **{f"wave_{i}_1_rad": (5.0 * i, 9.0 * i) for i in range(1, 7)},
    **{f"phase_{i}_rad": (-3.0, 3.0) for i in range(1, 7)},
    "gear_disturbance_rms_rad_s2": (0.2, 2.0),
    "elastomer_scale": (0.5, 2.0),
    "hysteresis_scale": (0.0, 3.0),
    "relaxation_Nm_rad": (1.0, 90.0),
    "relaxation_s": (0.01, 0.5),
    "coupling_stop_rad": (0.1, 0.3),
    "coupling_stop_Nm_rad": (20.0, 400.0),
    "coupling_stop_Nms_rad": (0.5, 9.0),
    "joint_min_rad": (-0.6, 0.0),
    "joint_max_rad": (1.5, 2.5),
    "joint_stop_Nm_rad": (20.0, 500.0),
    "joint_stop_Nms_rad": (0.5, 20.0),
    "trip_speed_rad_s": (2.0, 4.0),
    "trip_torque_Nm": (0.1, 0.3),
    "trip_window_s": (0.01, 0.1),
    "Jh_kgm2": (0.05, 0.4),
    "spring_Nm_rad": (5.0, 40.0),
    "damping_Nms_rad": (0.5, 3.0),
    "feedforward": (0.0, 1.0),
    "own_damping_Nms_rad": (0.1, 0.9),
    "gravity_Nm": (0.5, 2.5),
    "torque_noise_Nm": (0.1, 0.5),
    "torque_noise_Hz": (1.0, 90.0),
    "clamped": (0.0, 1.0),
}


def called(function, values) -> list[np.ndarray]:
    results = function.map(COUNT).call([np.atleast_2d(x) for x in values])
    return [np.squeeze(np.array(r), axis=0) if r.shape[0] == 1 else np.array(r) for r in results]


def drawn(block, sensor, n):
    """Tunables, state and inputs: near stops, gaps and thresholds on either side."""
    rng = np.random.default_rng(5)

    def u(low, high):
        return rng.uniform(low, high, COUNT)

    t = {p.name: u(*RANGES[p.name]) for p in block.tunables}
    t["clamped"] = np.where(u(0, 1) < 0.2, 1.0, 0.0)
    load = np.where(u(0, 1) < 0.5, u(0, 1.5), u(-1, 3))
    delta = u(-0.4, 0.4)
    theta = np.array([load + delta + u(-0.06, 0.06), load + delta, load])[-n:]
    s = {
        "u_a_Nm": u(-0.4, 0.4),
        "theta_rad": theta,
        "omega_rad_s": np.array([u(-4, 4) for _ in range(n)]),
        "alpha_rad_s2": np.array([u(-900, 900) for _ in range(n)]),
        "relaxation_Nm": u(-1, 1),
        "noise_Nm": u(-1, 1),
        "heat": u(0, 0.1),
        "tripped": np.where(u(0, 1) < 0.8, 0, rng.integers(0, 3, COUNT)).astype(float),
        "sums_J": np.array([u(-1, 1) for _ in range(5)]),
    }
    for p in sensor.state:
        s[p.name] = np.array([u(-0.1, 0.1) for _ in range(p.size)]) if p.size > 1 else u(-1, 1)
    s |= {"primed": np.ones(COUNT), "theta_prev_rad": delta}
    v = {
        "u_Nm": u(-0.4, 0.4),
        "theta_p_rad": u(-1, 3),
        "omega_p_rad_s": u(-3, 3),
        "alpha_p_rad_s2": u(-20, 20),
        "noise": u(-2, 2),
    }
    return t, s, v


def beyond(x, low, high):
    return x - np.clip(x, low, high)


def pushed(over, rate, k, d):
    """Spring and damper that only push: torque, and the damper while they do."""
    torque = k * over + d * rate
    pushes = torque * over > 0
    return np.where(pushes, torque, 0), np.where(pushes, d, 0)


def moved_parts(c, v_g, v_m, wound, on_gear, slope_g, tau_e):
    """Speeds of gear and motor-side part at the end, and the heat between them in W, and energy."""
    half = c.cable_backlash_rad / 2
    gap = beyond(wound, -half, half)
    k = c.cable_stiffness_Nm_rad
    tau_c, d_c = pushed(gap, v_g - v_m, k, c.cable_damping_Nms_rad)
    width = c.cable_loss_width_rad_s
    rub = np.tanh(v_m / width)
    lost = c.cable_loss * abs(tau_c)
    kept = 1 - c.cable_loss * rub * np.sign(tau_c)
    own = c.motor_side_damping_Nms_rad
    slope_m = own + lost * (1 - rub**2) / width
    # Changes x, y of both speeds: J x / q = on_gear - tau_c - slope x - d_c (x - y), and so on.
    m = c.motor_side_inertia_kgm2
    left = np.array(
        [[c.J_kgm2 / Q + slope_g + d_c, -d_c], [-d_c * kept, m / Q + slope_m + d_c * kept]]
    )
    right = np.array([on_gear - tau_c, tau_c - lost * rub - own * v_m - tau_e])
    x, y = np.linalg.solve(left.transpose(2, 0, 1), right.T[:, :, None])[:, :, 0].T
    w_g, w_m = v_g + x, v_m + y
    heat = w_m * (lost * rub + own * v_m + slope_m * y)
    heat += (w_g - w_m) * (tau_c + d_c * (x - y) - k * gap)
    return w_g, w_m, heat, (m * w_m**2 + k * gap**2) / 2


class Typed:
    """One step, in the order of its text: motor and drift, coupling, limb, gear, works."""

    def __init__(self, cable, t, s, u):
        self.c, self.s, self.u = (SimpleNamespace(**x) for x in (t, s, u))
        c, s, self.free = self.c, self.s, 1 - self.c.clamped
        wanted = np.where(s.tripped > 0, 0, np.clip(self.u.u_Nm, -c.u_max_Nm, c.u_max_Nm))
        self.u_a = wanted + (s.u_a_Nm - wanted) * np.exp(-H / c.tau_c_s)
        middle = s.omega_rad_s + Q * s.alpha_rad_s2
        middle[-1] *= self.free
        self.cable, self.bodies = cable, "gml"[0 if cable else 1 :]
        self.v = dict(zip(self.bodies, middle, strict=True))
        self.x = dict(zip(self.bodies, s.theta_rad + H * middle, strict=True))
        for values in (self.v, self.x):
            values.setdefault("g", values["m"])

    def coupling(self, sensor):
        """(3.1) with a second Maxwell branch, whose rate is held, and the stop."""
        c, s = self.c, self.s
        delta, rate = self.x["m"] - self.x["l"], self.v["m"] - self.v["l"]
        held = [np.atleast_2d(getattr(s, p.name)) for p in sensor.state]
        sensed = called(sensor.step, [*held, delta, rate])
        names = [p.name for p in (*sensor.state, *sensor.outputs)]
        shown = dict(zip(names, sensed, strict=True))
        fades = np.exp(-H / c.relaxation_s)
        self.branch = fades * s.relaxation_Nm
        self.branch += c.relaxation_Nm_rad * c.relaxation_s * (1 - fades) * rate
        model = shown["tau_Nm"] + (c.hysteresis_scale - 1) * shown["tau_hysteresis_Nm"]
        self.rubber = c.elastomer_scale * model + self.branch
        self.jaw = beyond(delta, -c.coupling_stop_rad, c.coupling_stop_rad)
        self.tau_jaw, _ = pushed(self.jaw, rate, c.coupling_stop_Nm_rad, c.coupling_stop_Nms_rad)
        self.tau_e = self.rubber + self.tau_jaw
        return {f"next_{p.name}": shown[p.name] for p in sensor.state}

    def limb(self):
        """(5.3): person, gravity and the joint's stops."""
        c, u, x, v = self.c, self.u, self.x["l"], self.v["l"]
        fades, tick = (np.exp(-TURN * t * c.torque_noise_Hz) for t in (H, 1e-3))
        gain = c.torque_noise_Nm * (1 - fades) * np.sqrt((1 + tick) / (1 - tick))
        self.noise = fades * self.s.noise_Nm + gain * u.noise
        feed = c.Jh_kgm2 * u.alpha_p_rad_s2 + c.own_damping_Nms_rad * u.omega_p_rad_s
        feed += c.gravity_Nm * np.sin(u.theta_p_rad)
        held = c.spring_Nm_rad * (u.theta_p_rad - x) + c.damping_Nms_rad * u.omega_p_rad_s
        held += c.feedforward * feed - c.gravity_Nm * np.sin(x) + self.noise
        slope = c.damping_Nms_rad + c.own_damping_Nms_rad
        self.stop = beyond(x, c.joint_min_rad, c.joint_max_rad)
        self.tau_stop, d = pushed(self.stop, v, c.joint_stop_Nm_rad, c.joint_stop_Nms_rad)
        pulls = self.tau_e + held - slope * v - self.tau_stop
        self.w_l = v + Q * self.free * pulls / (c.Jh_kgm2 + Q * (slope + d))
        self.tau_h = held - slope * self.w_l

    def gear(self):
        """(5.1), (5.2): what is left of the drive, friction as a line over the speed."""
        c, x, v = self.c, self.x, self.v
        waves = [getattr(c, f"wave_{i}_1_rad") * x["g"] for i in range(1, 7)]
        sines = [np.sin(w + getattr(c, f"phase_{i}_rad")) for i, w in enumerate(waves, 1)]
        self.d4 = c.gear_disturbance_rms_rad_s2 / np.sqrt(3) * np.sum(sines, axis=0)
        smooth = np.tanh(v["g"] / c.coulomb_width_rad_s)
        rubs = c.fv_Nms_rad * v["g"] + c.fc_Nm * smooth
        steep = c.fv_Nms_rad + c.fc_Nm * (1 - smooth**2) / c.coulomb_width_rad_s
        pulls = RATIO * self.u_a + c.J_kgm2 * self.d4 - rubs
        if self.cable:
            self.w_g, self.w_m, heat, self.energy = moved_parts(
                c, v["g"], v["m"], x["g"] - x["m"], pulls, steep, self.tau_e
            )
        else:
            self.w_g = v["m"] + Q * (pulls - self.tau_e) / (c.J_kgm2 + Q * steep)
            self.w_m, heat, self.energy = self.w_g, 0.0, 0.0
        self.heat = heat + self.w_g * (rubs + steep * (self.w_g - v["g"]))

    def powers(self):
        """In W at the end of the step, in the order of the works."""
        c = self.c
        heat = self.heat + (self.w_m - self.w_l) * (
            self.tau_jaw - c.coupling_stop_Nm_rad * self.jaw
        )
        return {
            "motor": RATIO * self.u_a * self.w_g,
            "loss": heat + self.w_l * (self.tau_stop - c.joint_stop_Nm_rad * self.stop),
            "elastomer": self.rubber * (self.w_m - self.w_l),
            "person": self.tau_h * self.w_l,
            "disturbance": c.J_kgm2 * self.d4 * self.w_g,
        }

    def stored(self):
        c = self.c
        moving = c.J_kgm2 * self.w_g**2 + c.Jh_kgm2 * self.w_l**2
        bent = c.coupling_stop_Nm_rad * self.jaw**2 + c.joint_stop_Nm_rad * self.stop**2
        return self.energy + (moving + bent) / 2

    def trip(self):
        c, s = self.c, self.s
        warm = s.heat + (1 - np.exp(-H / c.trip_window_s)) * (self.u_a**2 - s.heat)
        hot = np.where(warm > c.trip_torque_Nm**2, 2, 0)
        fresh = np.where(abs(self.w_g) > c.trip_speed_rad_s, 1, hot)
        return warm, np.where(s.tripped > 0, s.tripped, fresh)


def expected(run, sensor):
    memory = run.coupling(sensor)
    run.limb()
    run.gear()
    speeds = dict(zip("gml", (run.w_g, run.w_m, run.w_l), strict=True))
    power, (warm, tripped), s = run.powers(), run.trip(), run.s
    bodies = run.bodies
    return {
        "next_u_a_Nm": run.u_a,
        "next_theta_rad": np.array([run.x[b] for b in bodies]),
        "next_omega_rad_s": np.array([speeds[b] for b in bodies]),
        "next_alpha_rad_s2": np.array([(speeds[b] - run.v[b]) / Q for b in bodies]),
        "next_relaxation_Nm": run.branch,
        "next_noise_Nm": run.noise,
        "next_heat": warm,
        "next_tripped": tripped,
        "next_sums_J": s.sums_J + H * np.array(list(power.values())),
        **memory,
        **{f"theta_{b}_rad": run.x[b] for b in "gml"},
        **{f"omega_{b}_rad_s": speeds[b] for b in "gml"},
        "tau_e_Nm": run.tau_e,
        "u_a_Nm": run.u_a,
        "tau_h_Nm": run.free * run.tau_h,
        "d4_rad_s2": run.d4,
        "stored_J": run.stored(),
        **{f"work_{n}_J": s.sums_J[i] + Q * p for i, (n, p) in enumerate(power.items())},
        "tripped": tripped,
        "plant_status": 0,
    }


@pytest.mark.parametrize("cable", [True, False])
def test_a_step_of_the_plant(cable):
    device = load_device("elbow_drive")
    block, sensor = plant_block(device, cable), true_sensor(device, H)
    tunables, s, u = drawn(block, sensor, 3 if cable else 2)
    prepared = called(block.prepare, list(tunables.values()))
    results = called(block.step, [*prepared, *(s[p.name] for p in block.state), *u.values()])
    names = [f"next_{p.name}" for p in block.state] + [p.name for p in block.outputs]
    found = dict(zip(names, results, strict=True))
    run = Typed(cable, tunables, s, u)
    wanted = expected(run, sensor)
    assert set(wanted) == set(found)
    for name, value in wanted.items():
        atol = 1e-6 if "alpha" in name else 1e-9
        typed = np.broadcast_to(value, found[name].shape)
        np.testing.assert_allclose(found[name], typed, rtol=1e-7, atol=atol, err_msg=name)
    tripped, jaw, stop = wanted["tripped"], run.jaw, run.stop
    for met in (tripped == 1, tripped == 2, jaw > 0, jaw < 0, stop > 0, stop < 0, run.tau_jaw == 0):
        assert 10 < met.sum() < COUNT - 10
