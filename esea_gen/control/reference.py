"""Set torque from desired torque and impedance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.control.adaptation import gain_port, shift_limit_Nm
from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, Tunable, around, clip, status_port, threshold
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream, single
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations, to_casadi
from esea_gen.observe import drive_of

KP, KD = sp.symbols("K_p K_d", nonnegative=True)
THETA_D, OMEGA_D, THETA_L, OMEGA_L, TAU_D = sp.symbols(
    "theta_d omega_d theta_l omega_l tau_d", real=True
)
# (5.24) with the sign of a stiffness: the coupling's torque acts + on the load.
IMPEDANCE_LAW = TAU_D + KP * (THETA_D - THETA_L) + KD * (OMEGA_D - OMEGA_L)

EQUATIONS = """
    (5.24), sign of a stiffness | tau_law | law | impedance law
    [blend] | tau_set | tau_law + o{k-1} * exp(-h / T_b) | \
        offset from where the torque was at the change of mode, fading
"""

BLEND_S, BLEND_LOW_S, BLEND_HIGH_S = 0.2, 0.02, 5.0


def largest_gains(device: DeviceData) -> tuple[float, float]:
    """Largest allowed stiffness and damping: the passive range, where that is computed."""
    passive = device.file.passivity
    if passive is not None:
        return threshold(passive.Kp_max_Nm_rad.value), threshold(passive.Kd_max_Nms_rad.value)
    kp, kd = (field_facts(f"impedance.{k}")["high"] for k in ("Kp_Nm_rad", "Kd_Nms_rad"))
    return kp, kd


# From off, the difference between measured torque and law becomes an offset that decays with
# blend_s; from one law to another the set torque goes on from where it was.  An invalid input or
# corrupt state means off for that step, and request_ok 0, on which the limits latch.
def reference(device: DeviceData) -> Block:
    """Torque from mode, desired torque and impedance law, starting at the present torque."""
    return Block.of(_Reference(device))


def adapted_inputs(device: DeviceData) -> tuple[Port, ...]:
    if device.file.adaptation is None:
        return ()
    return (
        gain_port(device),
        around("wish_shift_Nm", shift_limit_Nm(device), "torque added to the desired torque"),
    )


def impaired_inputs(device: DeviceData) -> tuple[Port, ...]:
    if device.file.impairment is None:
        return ()
    full = threshold(device.tau_full_scale_Nm)
    return (
        around("tau_impairment_Nm", full, "torque of the impairment"),
        Port.flag("impairment_ok", "0: the impairment cannot be computed"),
    )


class _Reference:
    def __init__(self, device: DeviceData) -> None:
        self.drive = drive_of(device)
        self.device, self.h = device, device.period_s
        self.adapted = device.file.adaptation is not None
        self.impaired = device.file.impairment is not None
        self.tau_lim, self.omega_lim = self.drive.tau_Nm, self.drive.omega_rad_s
        self.full_scale = threshold(device.tau_full_scale_Nm)
        self.kp, self.kd = self.drive.impedance.Kp_Nm_rad, self.drive.impedance.Kd_Nms_rad
        self.kp_high, self.kd_high = largest_gains(device)
        angle = self.drive.theta_high_rad - self.drive.theta_low_rad
        # The widest that the law can ask for, and its offset from any measured torque.
        self.widest = threshold(
            1.01 * (2 * self.tau_lim + self.kp_high * angle + 2 * self.kd_high * self.omega_lim)
        )
        # As a wish, which the adaptation turns: by its least gain.
        least = gain_port(device).low if self.adapted else 1.0
        self.wish_lim = threshold(1.01 * self.widest / least)
        self.name = "reference"
        self.title = "Set torque from mode, wanted torque and impedance law"
        self.constants = (*device.constants("impedance"), *device.constants("domain"))
        text = "from the law to where the torque was; impedance: "
        text += "the law of the mode that was left does not count"
        self.state = (
            Port.choice("mode_last", Mode, "mode of the last step"),
            around("offset_Nm", self.widest, text),
            around("tau_set_Nm", self.full_scale, "set torque of the last step"),
        )
        self.equations = equations(EQUATIONS, law=IMPEDANCE_LAW)
        self.streams = STREAMS
        full = self.full_scale
        pulls = "stiffness: higher pulls harder to the desired angle"
        resists = "damping: higher resists motion other than the desired one"
        blends = "time constant from the measured torque to a new law: longer is gentler"
        soon = "a fifth of a second is felt as smooth and over before a movement is"
        narrow = "largest |set torque|: may only be narrowed below the identified range"
        source = "domain.tau_full_scale_Nm"
        self.tunables = (
            self.kp.tunable("Kp_Nm_rad", 0.0, self.kp_high, pulls),
            self.kd.tunable("Kd_Nms_rad", 0.0, self.kd_high, resists),
            Tunable("blend_s", BLEND_S, BLEND_LOW_S, BLEND_HIGH_S, blends, soon),
            Tunable("tau_range_Nm", full, 0.01 * full, full, narrow, source, safer="low"),
        )
        self.coefficients = (
            Port("Kp_Nm_rad", 0.0, self.kp_high, "stiffness", equation="(5.24)"),
            Port("Kd_Nms_rad", 0.0, self.kd_high, "damping", equation="(5.24)"),
            Port("keep", 0.0, 1.0, "share of the offset kept in a step"),
            Port("tau_range_Nm", 0.0, self.full_scale, "largest |set torque|"),
        )
        low, high = self.drive.theta_low_rad, self.drive.theta_high_rad
        self.inputs = (
            Port.choice("mode", Mode, "desired mode"),
            around("tau_desired_Nm", self.tau_lim, "desired interaction torque"),
            Port("theta_desired_rad", low, high, "desired angle of the joint"),
            around("omega_desired_rad_s", self.omega_lim, "desired rate of the joint"),
            Port("theta_load_rad", low, high, "load side's angle"),
            around("omega_load_rad_s", self.omega_lim, "load side's rate"),
            around("tau_Nm", self.tau_lim, "measured interaction torque on the load"),
            Port.flag("wish_ok", "1 while the desired values are valid"),
            *adapted_inputs(self.device),
            *impaired_inputs(self.device),
        )
        clipped = "the set torque was clipped at tau_range_Nm"
        self.outputs = (
            around("tau_set_Nm", self.full_scale, "set torque, for the inverse"),
            around("tau_hold_Nm", self.wish_lim, "desired torque that alone gives the set torque"),
            around("tau_blend_Nm", self.wish_lim, "part of it that comes from the decaying offset"),
            Port.choice("mode", Mode, "active mode in this step"),
            Port.flag("request_ok", "1 while all inputs and the state are valid"),
            status_port(
                "status of this set torque",
                "an input was NaN or outside its range; the limits latch",
                "the state was corrupt; the limits latch",
                Flag("CLIPPED", clipped, True, ("tau_set_Nm",), self.full_scale),
                Flag("ENTERED", "a law took over in this step, from the present torque"),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return {
            "Kp_Nm_rad": t.Kp_Nm_rad,
            "Kd_Nms_rad": t.Kd_Nms_rad,
            "keep": ca.exp(-self.h / t.blend_s),
            "tau_range_Nm": t.tau_range_Nm,
        }

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        sound = ca.logic_and(ca.logic_and(guard.inputs_ok, guard.state_ok), u.wish_ok)
        if self.impaired:
            sound = ca.logic_and(sound, u.impairment_ok)
        mode = label("mode_taken", ca.if_else(sound, u.mode, Mode.OFF), "off when not sound")
        tau_d = u.tau_desired_Nm
        if self.adapted:
            tau_d = clip(tau_d * u.wish_gain + u.wish_shift_Nm, -self.tau_lim, self.tau_lim)
            tau_d = label("tau_adapted_Nm", tau_d, "[adapt 2] wish for the rubber at hand")
        if self.impaired:
            total = clip(tau_d + u.tau_impairment_Nm, -self.tau_lim, self.tau_lim)
            tau_d = label("tau_impaired_Nm", total, "(7.1) the impairment on top")
        values = {
            TAU_D: tau_d,
            KP: ca.if_else(mode == Mode.IMPEDANCE, c.Kp_Nm_rad, 0),
            KD: ca.if_else(mode == Mode.IMPEDANCE, c.Kd_Nms_rad, 0),
            THETA_D: u.theta_desired_rad,
            OMEGA_D: u.omega_desired_rad_s,
            THETA_L: u.theta_load_rad,
            OMEGA_L: u.omega_load_rad_s,
        }
        law = to_casadi(IMPEDANCE_LAW, values)
        law = label("law_Nm", law, "(5.24) with the sign of a stiffness")
        on = mode != Mode.OFF
        changed = label("changed", mode != s.mode_last, "the mode is another than a step ago")
        # From one law to another the set torque goes on from where it was: the measured one would
        # make a step of the tracking error.  It fades in that step already, so that neither a
        # rounding error nor an old wish lives on through one change after another.
        gone_on = ca.if_else(changed, s.tau_set_Nm - law, s.offset_Nm) * c.keep
        from_off = ca.logic_and(changed, s.mode_last == Mode.OFF)
        offset = ca.if_else(from_off, u.tau_Nm - law, gone_on)
        offset = label("offset_Nm", offset, "from the law to where the torque was, fading")
        wanted = label("wanted_Nm", ca.if_else(on, law + offset, u.tau_Nm))
        faded = ca.if_else(on, offset, 0)
        limited = clip(wanted, -c.tau_range_Nm, c.tau_range_Nm)
        tau_set = label(
            "tau_set_Nm", ca.if_else(guard.inputs_ok, limited, s.tau_set_Nm), "invalid input: hold"
        )
        held, gain = tau_set, 1.0
        if self.impaired:
            held = held - u.tau_impairment_Nm
        if self.adapted:
            held, gain = held - u.wish_shift_Nm, u.wish_gain
        next_state = {"mode_last": mode, "offset_Nm": faded, "tau_set_Nm": tau_set}
        outputs = {
            "tau_set_Nm": tau_set,
            "tau_hold_Nm": label("hold_Nm", held / gain, "but for the impairment"),
            "tau_blend_Nm": faded / gain,
            "mode": mode,
            "request_ok": sound,
            "status": guard.status(
                ca.logic_and(guard.inputs_ok, ca.fabs(wanted) > c.tau_range_Nm),
                ca.logic_and(on, changed),
            ),
        }
        return next_state, outputs


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Modes held for a while, so that offsets fade; samples that are not a number in between.
    steps = 3000
    t = np.arange(steps)
    x = {
        p.name: single(0.5 * (p.low + p.high) + 0.3 * (p.high - p.low) * np.sin(t / (40.0 + 7 * i)))
        for i, p in enumerate(block.inputs)
    }
    x["mode"] = np.array([1.0, 2.0, 0.0, 2.0, 1.0, 0.0])[t // 250 % 6]
    for p in block.inputs:
        hit = rng.random(steps) < 0.002
        x[p.name][hit] = rng.choice(SPECIAL, int(hit.sum()))
    return [Stream("modes held", x, rough=True)]


STREAMS = OwnStreams(_events)
