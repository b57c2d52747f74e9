"""The predictive torque and impedance controller of a device (thesis chapter 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import Any, Literal

import casadi as ca

from esea_gen.control.predictive.cable_model import CableModel
from esea_gen.control.predictive.horizon import Horizon, Model, Tape
from esea_gen.control.predictive.program import predictive_program
from esea_gen.control.predictive.rubber_ahead import rubber_ahead
from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.ports import Port, Tunable, around, clip
from esea_gen.language.program import Program
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

Q_BEST, R_BEST = 500.0, 1.0
# A motion that lasts needs its motor torque's rate: with all of it in the cost the torque lags.
EFFORT_SHARE = 0.3
# R counts as this share of Q at least.
LEAST_SHARE = 1e-4
PATH = {"theta_d": "theta_d_rad", "omega_d": "omega_d_rad_s"}
GAINS = {"Kp_Nm_rad": "stiffness to the path", "Kd_Nms_rad": "damping to the path"}

# Who tells of the person's torque and of the rates: the extended-state observer with the tracking
# observer of the deflection; or as published, (5.10) with a parabola, and filtered differences.
Person = Literal["extended_state", "parabola"]
# Whether gear and motor side are one inertia or have the cable between them.
DriveTrain = Literal["rigid", "cable"]


EQUATIONS = """
    (5.1) | u_a' | (u_c - u_a) / tau_c | lag of the motor
    (5.2) | omega_m' | (n * u_a - f_v * omega_m - f_c * sig - tau_e) / J + d_4 | motor side
    [sig] | sig | z * (27 + z**2) / (27 + 9 * z**2) | within 0.024 of tanh(omega_m / omega_w)
    [z] | z | Max(-3, Min(3, omega_m / omega_w)) | rate over the width of Coulomb friction
    (5.3) | omega_l' | (tau_e + tau_h) / J_h | load side
"""
COST = """
    [cost] | c_k | Q * e**2 + R * ((u_c - u_a) / tau_c - p * v)**2 | v: of the last plan"""
TORQUE_COST = "[error] | e | tau_e - tau_d | what the cost weighs" + COST
IMPEDANCE_COST = (
    """(5.24) | e | tau_e - tau_d + K_p * (theta_l - theta_d) \
    + K_d * (omega_l - omega_d) | what the cost weighs"""
    + COST
)


# A substep: the motor's lag exactly (5.1); half a kick by motor, coupling and person; friction by a
# linearly implicit midpoint step; drift; the coupling at the new deflection; half a kick with the
# new torque.  The sign of Kp and Kd is that of a stiffness; (5.24) prints the other one.
def drive_model(device: DeviceData, horizon: Horizon, **choice: Any) -> Model:
    """Plant (5.1 to 5.3), elastomer and cost of a device, as :class:`DriveChoice` says."""
    plant = _Drive(device, horizon, DriveChoice(**choice))
    own = {f.name: getattr(plant, f.name) for f in fields(Model) if hasattr(plant, f.name)}
    return Model(**own, **plant.rubber.stop_operators)


@dataclass(frozen=True)
class DriveChoice:
    preview: bool = False  # what is wanted is known for every interval
    impedance: bool = False
    person: Person = "extended_state"
    weights: tuple[float, float] = (Q_BEST, R_BEST)
    train: DriveTrain = "rigid"


class _Drive:
    in_force, enable = "u_in_force_Nm", "mode"

    def __init__(self, device: DeviceData, horizon: Horizon, choice: DriveChoice) -> None:
        drive = self.drive = drive_of(device)
        self.impedance, self.published = choice.impedance, choice.person == "parabola"
        a = drive.actuator
        self.ratio, self.inertia = a.gear_ratio.value, a.J_kgm2.value
        self.fv, self.fc = a.fv_Nms_rad.value, a.fc_Nm.value
        self.width = a.coulomb_width_rad_s.value
        self.effort_share = 1.0 if self.published else EFFORT_SHARE
        self.tau_c, self.u_max = a.tau_c_s.value, drive.u_Nm
        self.rubber = rubber_ahead(device)
        self.cable: CableModel | None = None
        if choice.train == "cable":
            if self.published:
                raise UserError(
                    f'{device.origin}: predictive.drive = "cable" takes the rate of the motor\'s '
                    'own encoder, person = "parabola" filtered differences, as published.',
                    'Write person = "extended_state" or drive = "rigid".',
                )
            self.cable = CableModel(device, self.rubber.soft_Nm_rad)
        self.constants = (
            *(c for section in ("actuator", "joint") for c in device.constants(section)),
            *self.rubber.constants(),
            *(self.cable.constants(device) if self.cable else ()),
            *self.rubber.choices,
        )
        angle, turned = ("theta_l",) * self.impedance, ("turned",) * (self.cable is not None)
        moving = ("omega_m", "omega_l", "u_a")
        self.states = (*angle, "delta", *turned, *moving, *self.rubber.states, "tau_e")
        self.forecasts = {"tau_h": self.human}
        cost = IMPEDANCE_COST if self.impedance else TORQUE_COST
        self.equations = equations(EQUATIONS + cost)
        self._weights(choice.weights)
        self._inputs(horizon.intervals if choice.preview else 1, choice.preview)

    def _weights(self, weights: tuple[float, float]) -> None:
        warm = self.rubber.temperature
        rated = "weight of the motor torque's rate; less than Q/10000 counts as that"
        self.tunables = (
            Tunable("Q", weights[0], 0.01, 1e5, "weight of the torque error", "trials; thesis: 35"),
            Tunable("R", weights[1], 1e-4, 1e4, rated, "thesis: 1"),
            Tunable("load_free", 1.0, 0.0, 1.0, "1 free load side, 0 held fast", "the rig"),
            *warm.get("tunables", ()),
        )
        self.coefficients = (
            Port("root_q", 0.0, 1e3, "root of Q"),
            Port("root_r", 0.0, 1e6, "root of R over the motor's lag"),
            Port("load_1_kgm2", 0.0, 1e4, "1 / Jh, 0 when held fast"),
            *warm.get("coefficients", ()),
        )
        gains = tuple(GAINS) if self.impedance else ()
        gap = ("gap_rad", "give_rad_Nm") if self.cable else ()
        own = (c.name for c in self.coefficients)
        self.parameters = ("d4_rad_s2", *own, *gains, *gap)

    def _inputs(self, many: int, preview: bool) -> None:
        """Measured inputs, and desired values with their references."""
        drive, u_max = self.drive, self.u_max
        low, high, fast = drive.theta_low_rad, drive.theta_high_rad, drive.omega_rad_s
        angle = Port("theta_l_rad", low, high, "load side's angle")
        rate = around("omega_rad_s", drive.rate_rad_s, "deflection's rate")
        if self.published:
            rate = around("omega_m_rad_s", fast, "motor side's rate")
        elif self.cable:
            rate = around("omega_gear_rad_s", fast, "gear's rate, at the joint")
        curve = around("tau_h_curve_Nm_s2", 1e5, "second derivative")
        self.references = {"tau_d": ("tau_d_Nm", preview)}
        self.inputs: tuple[Port, ...] = (
            around("delta_rad", drive.delta_rad, "deflection"),
            *(self.cable.ports() if self.cable else ()),
            rate,
            *((angle,) if self.impedance else ()),
            around("omega_l_rad_s", fast, "load side's rate"),
            around("u_a_Nm", u_max, "motor torque now, at the shaft", equation="(5.1)"),
            around("u_in_force_Nm", u_max, "command until the new one takes effect"),
            *self.rubber.ports(),
            around("d4_rad_s2", drive.d4_rad_s2, "drive's disturbance", 1, "(5.5)"),
            around("tau_h_Nm", drive.tau_h_Nm, "torque of the person"),
            around("tau_h_rate_Nm_s", 1e4, "rate of the person's torque"),
            *((curve,) if self.published else ()),
            Port.choice("mode", Mode, "0: the command is 0"),
            around("tau_d_Nm", drive.tau_Nm, "desired torque on the load", many),
        )
        if self.impedance:
            self.references |= {k: (n, preview) for k, n in PATH.items()}
            self.inputs += (
                Port("theta_d_rad", low, high, "desired angle of the joint", many),
                around("omega_d_rad_s", fast, "desired rate of the joint", many),
                *(
                    Port(name, 0.0, field_facts(f"impedance.{name}")["high"], text, 1, "(5.24)")
                    for name, text in GAINS.items()
                ),
            )

    def start(self, u: SimpleNamespace, tau_memory: Any) -> dict[str, Any]:
        angle = {"theta_l": u.theta_l_rad} if self.impedance else {}
        if self.cable:
            omega_m = u.omega_gear_rad_s
        else:
            omega_m = u.omega_m_rad_s if self.published else u.omega_l_rad_s + u.omega_rad_s
        return angle | {
            "delta": u.delta_rad,
            **({"turned": u.delta_rad + u.wound_rad} if self.cable else {}),
            "omega_m": omega_m,
            "omega_l": u.omega_l_rad_s,
            "u_a": u.u_a_Nm,
            **self.rubber.start(u, tau_memory),
        }

    def substep(
        self, t: Tape, h: float, x: SimpleNamespace, u: Any, p: SimpleNamespace, w: SimpleNamespace
    ) -> dict[str, Any]:
        """Lag (5.1), half a kick, friction, drift, the coupling, half a kick (5.2, 5.3)."""
        keep = math.exp(-h / self.tau_c)
        mean = (1 - keep) * self.tau_c / h
        half = 0.5 * h
        push = t.let(
            "push", half * (self.ratio / self.inertia * (u + mean * (x.u_a - u)) + p.d4_rad_s2)
        )
        omega_1 = t.let("omega_1", x.omega_m + push - half / self.inertia * x.tau_e)
        pull = half * p.load_1_kgm2
        load_1 = t.let("load_1", x.omega_l + pull * (x.tau_e + w.tau_h))
        coulomb, tau_e = self.fc, x.tau_e
        if self.cable:
            tau_e = self.cable.pull(t, tau_e)
            coulomb = self.cable.coulomb(t, self.fc, tau_e)
        omega_2, sig = self.friction(t, h, omega_1, coulomb)
        moved = half * (omega_1 + omega_2) - h * load_1
        turned = {}
        if self.cable:
            turned["turned"] = t.let("turned_next", x.turned + moved)
            carried = tau_e + (coulomb - self.fc) * sig
            delta = self.cable.follow(t, x, turned["turned"], carried, p)
        else:
            moved = t.let("moved", moved)
            delta = t.let("delta_next", x.delta + moved)
        rubber = self.rubber.step(t, h, x, delta, None if self.cable else moved, p)
        angle = {"theta_l": x.theta_l + h * load_1} if self.impedance else {}
        return angle | {
            "delta": delta,
            **turned,
            "omega_m": omega_2 + push - half / self.inertia * rubber["tau_e"],
            "omega_l": load_1 + pull * (rubber["tau_e"] + w.tau_h),
            "u_a": u + keep * (x.u_a - u),
            **rubber,
        }

    def friction(self, t: Tape, h: float, omega_1: Any, coulomb: Any) -> tuple[Any, Any]:
        """Friction's part of (5.2), one linearly implicit midpoint step of omega_m; its sign."""
        half = 0.5 * h
        # Pade's approximant of tanh, which reaches 1 with no slope, takes a fifth of the time.
        z = t.keep("scaled", clip(omega_1 * (1 / self.width), -3.0, 3.0), {})
        part = t.keep("part", 1 / (3 + z * z), {})
        steep = ((9 - z * z) * part * (1 / 3)) ** 2 * (1 / self.width)
        sig = t.keep("sig", z * (3 + (1 / 9) * z * z) * part, {omega_1: lambda _: steep})
        damping = 1 + half / self.inertia * (self.fv + coulomb / self.width * (1 - sig * sig))
        eased = t.keep("eased", 1 / damping)
        loss = h / self.inertia

        def lost_by(lost: Any) -> Any:
            by_sig = loss * (coulomb + lost * (coulomb / self.width) * sig)
            return eased * (loss * self.fv + by_sig * steep)

        slopes = {omega_1: lost_by}
        if self.cable:
            slopes[coulomb] = lambda lost: (
                eased * (loss * sig - lost * (half / self.inertia / self.width) * (1 - sig * sig))
            )
        lost = t.keep("lost", loss * (self.fv * omega_1 + coulomb * sig) * eased, slopes)
        return t.let("omega_2", omega_1 - lost), sig

    def error(self, x: SimpleNamespace, p: SimpleNamespace, ref: SimpleNamespace) -> list[Any]:
        e_tau = x.tau_e - ref.tau_d
        if self.impedance:
            e_tau = e_tau + p.Kp_Nm_rad * (x.theta_l - ref.theta_d)
            e_tau = e_tau + p.Kd_Nms_rad * (x.omega_l - ref.omega_d)
        return [p.root_q * e_tau]

    def effort(self, x: SimpleNamespace, u: Any, p: SimpleNamespace) -> list[Any]:
        """The motor torque's rate, by (5.1)."""
        return [p.root_r * (u - x.u_a)]

    def human(self, u: SimpleNamespace, p: SimpleNamespace, s: Any) -> Any:
        if not self.published:
            return u.tau_h_Nm + u.tau_h_rate_Nm_s * s
        tau = u.tau_h_Nm + s * (u.tau_h_rate_Nm_s + 0.5 * s * u.tau_h_curve_Nm_s2)
        # A parabola knows no end: a person does.
        return clip(tau, -self.drive.tau_h_Nm, self.drive.tau_h_Nm)

    def shape(self, t: float) -> float:
        """Inputs of the forecast from the time since the measurement."""
        fade = self.drive.disturbance.decay_s.value
        # The extended-state observer's own model: the rate decays, the torque settles.
        return t if self.published else fade * (1 - math.exp(-t / fade))

    def prepare(self, c: SimpleNamespace) -> dict[str, Any]:
        warm = self.rubber.temperature
        return (warm["prepare"](c) if warm else {}) | {
            "root_q": ca.sqrt(c.Q),
            # In single precision the Hessian is not positive any more with much less: of steps over
            # the inputs' whole ranges 1 % at a share of 1e-7, 80 % at 1e-9, none at 1e-4.
            "root_r": ca.sqrt(ca.fmax(c.R, LEAST_SHARE * c.Q)) / self.tau_c,
            "load_1_kgm2": c.load_free * (1 / self.drive.joint.Jh_kgm2.value),
        }


def predictive_controller(
    device: DeviceData,
    *,
    horizon: Horizon | None = None,
    period_s: float | None = None,
    cap: int | None = None,
    **choice: Any,
) -> Program:
    """The controller of a device, as :class:`DriveChoice` says."""
    drive = drive_of(device)
    period = drive.control_period_s if period_s is None else period_s
    if horizon is None:
        release = device.file.timing.control_release_s
        horizon = Horizon(delay_s=period if release is None else release.value)
    model = drive_model(device, horizon, **choice)
    title = f"Predictive {'impedance' if choice.get('impedance') else 'torque'} control"
    return predictive_program(model, horizon, period_s=period, title=title, cap=cap)
