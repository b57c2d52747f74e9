"""Small findings of a made-up device, for what its page says: numbers that differ, one by one."""

from __future__ import annotations

from types import SimpleNamespace as Of

import numpy as np

from esea_gen.devices.numbers import Quantity
from esea_gen.report.board import BoardRun
from esea_gen.report.findings import Findings, Run
from esea_gen.verify.verdict import Comparison, Verification


def said(value, status="published", source="a table"):
    return Quantity(value=value, status=status, source=source)


def port(name, low=-1.0, high=1.0, unit="", flags=()):
    return Of(name=name, low=low, high=high, unit=unit, flags=flags)


def flag(name, meaning):
    return Of(name=name, meaning=meaning)


def output(name, of, flags=(), instance="sensor"):
    return Of(name=name, port=port(of, flags=flags), signals=[Of(port=of, instance=instance)])


def comparison(block, stream, real, errors=None, limits=None, **more):
    return Comparison(block, stream, real, more.pop("steps", 7), errors or {}, limits or {}, **more)


VELOCITY = Of(
    name="velocity",
    title="Rate",
    kind="block",
    inputs=[port("theta_rad", -0.5, 0.25, "rad")],
    outputs=[port("omega_rad_s")],
    state=[port("theta_prev_rad")],
    equations=[],
)
SENSOR = Of(
    name="sensor",
    title="Torque",
    kind="block",
    inputs=[port("theta_rad", -0.5, 0.25, "rad"), port("omega_rad_s", -3.0, 9.0, "rad/s")],
    outputs=[port("tau_Nm"), port("tau_spring_Nm"), port("status", flags=(flag("HOT", "warm"),))],
    state=[port("tau_r_Nm")],
    equations=[],
)
FULL = {"tau_Nm": 4.0, "tau_spring_Nm": 8.0, "omega_rad_s": 20.0, "theta_prev_rad": 0.5}
QUANTITIES = (
    ("elastomer.k1_Nm_rad", said(9.5, "identified", "a fit")),
    ("elastomer.k3_Nm_rad3", said(-200.0, "assumed", "a guess")),
    ("timing.sense_rate_Hz", said(1000.0, "assumed", "a choice")),
    ("domain.theta_max_rad", said(0.2)),
)


def a_device(**changes):
    outputs = [output("joint_tau_Nm", "tau_Nm"), output("joint_omega_rad_s", "omega_rad_s")]
    outputs.append(output("joint_status", "status", (flag("COLD", "too cold"), flag("FAR", "far"))))
    domain = {"theta_max_rad": said(0.2), "omega_max_rad_s": said(7.0)}
    file = Of(elastomer=Of(), encoder=Of(resolution_bits=said(14.0)), domain=Of(**domain))
    made = {
        "name": "elbow",
        "title": "An elbow",
        "tau_full_scale_Nm": 4.0,
        "period_s": 0.002,
        "rate_terms": True,
        "shipped": True,
        "laws": (),
        "given": ("elbow_drive", ""),
        "file": file,
        "quantities": lambda: iter(QUANTITIES),
        "system": Of(kinds=[VELOCITY, SENSOR], outputs=outputs, tasks=[Of(name="sense")]),
    }
    return Of(**(made | changes))


COMPARISONS = [
    comparison("sensor", "sweep", "f64", {"tau_Nm": 0.08, "tau_r_Nm": 9.0}, {"tau_Nm": 0.12}),
    comparison("velocity", "steps", "f64", {"omega_rad_s": 0.1}, {"omega_rad_s": 0.2}),
    comparison("velocity", "steps", "f32", {"omega_rad_s": 0.3}, {"omega_rad_s": 0.5}),
    comparison("sensor", "rough", "f32", {"tau_Nm": 0.02, "tau_r_Nm": 2.0}, {"tau_Nm": 0.06}),
    comparison("sensor", "sweep", "f32", {"tau_Nm": 0.01}, {"tau_Nm": 0.04}),
]


def a_verification(comparisons=COMPARISONS, bounds=None, scales=None):
    return Verification("elbow", "abc", list(comparisons), bounds or {}, FULL, scales or {})


def a_mapping(name="elbow", period=None, scale="identified"):
    return Of(
        origin="rig.toml",
        mapping=Of(
            device=Of(name=name, title="The other one"),
            deflection=Of(scale_rad_per_m=said(12.5, scale, "a ruler")),
            torque=Of(scale_Nm_per_N=said(0.25, "assumed", "an arm")),
            sampling=Of(period_s=period),
        ),
    )


def findings(**changes):
    made = {
        "device": a_device(),
        "verification": a_verification(),
        "bundles": (),
        "board": BoardRun("netduinoplus2", "A board"),
        "command": "esea-gen report elbow",
    }
    return Findings(**(made | changes))


def a_set(label="up", amplitude=0.3, training=(), held_out=(), cycles=None):
    rows = {k: np.array(v, int) for k, v in (("training", training), ("held_out", held_out))}
    return Of(label=label, amplitude_rad=amplitude, cycles=cycles or {}, **rows)


def a_run(label="a", recording=None, status=(0, 1, 2, 3, 2), tau=(1.0, 2.0, -3.0, 0.5, 0.0)):
    """Two seconds between samples; float64 is 0.25 less than float32, by the rate 0.5."""
    tau = np.array(tau, np.float32)
    words = np.array(status, np.float32)
    omega = np.array([2, 4, 6, 8, 10], np.float32)
    f32 = {"joint_tau_Nm": tau, "joint_omega_rad_s": omega, "joint_status": words}
    f64 = {
        "joint_tau_Nm": tau - np.array([0.125, 0, 0, 0.25, 0]),
        "joint_omega_rad_s": omega + np.array([0, 0, 0.5, 0, 0.25]),
        "joint_status": words,
    }
    parts = {"tau_spring_Nm": 2 * tau, "tau_hysteresis_Nm": 0 * tau, "tau_rate_Nm": -tau}
    sensor = {
        real: {"tau_Nm": o["joint_tau_Nm"], **parts} for real, o in (("f32", f32), ("f64", f64))
    }
    t = 2.0 * np.arange(5)
    return Run(label, t, 0.1 * np.arange(5), {"f32": f32, "f64": f64}, sensor, recording)


def a_recording(sets, timed=True):
    t = np.array([1.0, 2.0, 3.0])
    return Of(time_s=t, theta_rad=0.5 * t, tau_Nm=-t, sets=tuple(sets), timed=timed)


def case(name, rms, **more):
    made = {"name": name, "rms_true_Nm": rms, "rms_model_Nm": 0.5, "max_true_Nm": 3.0}
    return made | {"unstable": False} | more


class Study:
    """A closed-loop study that is over."""

    def __init__(self, title, *cases, thesis=None, content=None):
        self.study = Of(title=title, thesis_Nm=thesis or {})
        self.cases = lambda: list(cases)
        self.to_dict = lambda: content or {}
        self.figure = lambda: f"figure of {title}"
