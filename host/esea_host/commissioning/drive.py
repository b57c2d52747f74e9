"""Evaluation of a drive that was turned by hand or pushed, from a board's recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.signal import fftconvolve, lfilter

from esea_gen.device import Device
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.identify.drive.regression import Estimate, fit_linear
from esea_gen.language.system import System, Task
from esea_host.commissioning.bench import Capture
from esea_host.commissioning.startup import RATIO_OFF, DriveRecording, StartupCheck
from esea_host.recording.layout import Array

AGAIN = "Repeat it; check for loose parts and contact with the joint."
LEAST_TURN_RAD = 0.5
CELLS = 64  # in which errors over the travel are looked at
TABLE = 16  # values of a correction, over the encoder's turn
# Of a joint encoder: 0.3 deg at the deflection is some 3 % of full scale where the rubber is soft.
ERROR_RAD = math.radians(0.3)
LEAST_WORK_SHARE = 0.1
FOLLOWS = 0.25  # of the gear's motion, at least, where a side is to have moved with it
STANDS = 0.1  # of it, at most, where a side is clamped
FILTER_S, RUBBER_S = 0.042, 0.024  # widths of the Hann windows
SLOW_RAD_S = 0.1  # below, friction is neither Coulomb's full value nor known to be less
EVERY_S, BLOCK_S = 0.005, 0.5  # samples that are used; blocks for the intervals
AGAINST = (
    "The motor turns against its command: swap two of its phases, or the sign of the torque in the "
    "drive's settings, never both."
)
SLOWEST_RAD_S, MOST_BEND_RAD_S2, LEAST_ROWS = 0.1, 1.5, 10


# -- encoders -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JudgedEncoders:
    checks: tuple[StartupCheck, ...]
    problem: tuple[str, str] | None
    found: dict[str, Any]
    at_rad: Array  # angles of the joint; errors: of each side there, offset and ratio taken off
    errors: dict[str, Array]
    limit_rad: float = ERROR_RAD


def _moved(*angles: Array) -> list[float]:
    # Until the one that went furthest was there: another may stand still.
    far = int(np.argmax(np.max([np.abs(x - x[0]) for x in angles], axis=0)))
    return [float(x[far] - x[0]) for x in angles]


def _direction(gear: float, motor: float, load: float) -> tuple[str, str] | None:
    seen = (
        f"while the joint was turned the motor's encoder moved by {gear:+.3f} rad at the joint, "
        f"the motor side's by {motor:+.3f} rad, the load side's by {load:+.3f} rad"
    )
    if max(abs(gear), abs(motor), abs(load)) < LEAST_TURN_RAD:
        return (
            seen,
            f"Turn the joint by at least {LEAST_TURN_RAD:g} rad, positive direction first.",
        )
    for name, value, fix in (
        ("motor's own encoder", gear, "Check its cable and the drive's coupling to the joint."),
        ("motor-side encoder", motor, "Check its magnet and cable."),
        ("load-side encoder", load, "Check its magnet and cable."),
    ):
        if abs(value) < 0.5 * LEAST_TURN_RAD:
            return f"{seen}: the {name} hardly moved", fix
    turned = "set encoder.{0}.direction to its opposite and calibrate its zero again."
    if gear < 0 and motor < 0 and load < 0:
        return (
            seen,
            "All count down: was the joint turned in the positive direction?  If it was, "
            + (
                turned.format("motor")
                + "  The same for encoder.load; swap the motor's A and B channels."
            ),
        )
    if load < 0 < motor:
        return seen, "The load-side encoder counts the other way: " + turned.format("load")
    if motor < 0 < load:
        return seen, "The motor-side encoder counts the other way: " + turned.format("motor")
    if gear < 0:
        return seen, "The motor's own encoder counts the other way: swap its A and B channels."
    if motor < 0:
        return seen, "Both joint encoders count the other way: " + turned.format("motor and .load")
    return None


def _steady(r: DriveRecording) -> Array:
    # Rows in which the drive turns evenly: little of the torque is inertia's.
    smooth = np.convolve(np.gradient(r.gear_rad, r.tick_s), np.ones(51) / 51, "same")
    bent = np.abs(np.gradient(smooth, r.tick_s)) > MOST_BEND_RAD_S2
    return np.asarray((np.abs(smooth) > SLOWEST_RAD_S) & ~bent)


def _ratio(r: DriveRecording, angle_rad: Array, tau_Nm: Array) -> float:
    # Motion of a side over that of the motor's encoder, less what torque does to cable and rubber.
    rows = np.flatnonzero(_steady(r))[::3]
    tau = tau_Nm[rows]
    terms = np.column_stack([r.gear_rad[rows], np.ones(len(rows)), tau, np.sign(tau)])
    return float(np.linalg.lstsq(terms, angle_rad[rows], rcond=None)[0][0])


def _error(r: DriveRecording, tau_Nm: Array, edges: Array) -> Array:
    # Of the motor side over the travel, in cells.  Torque winds the cable up and lies in its gap:
    # that comes with friction's sign both ways over every cell, so least squares tell it apart.
    cell = np.digitize(r.gear_rad, edges) - 1
    rows = np.flatnonzero(_steady(r) & (cell >= 0) & (cell < len(edges) - 1))[::3]
    terms = np.zeros((len(rows), len(edges) + 1))
    terms[np.arange(len(rows)), cell[rows]] = 1.0
    terms[:, -2], terms[:, -1] = tau_Nm[rows], np.sign(tau_Nm[rows])
    off = r.motor_rad[rows] - r.gear_rad[rows]
    found = np.linalg.lstsq(terms, off, rcond=None)[0][:-2]
    seen = np.bincount(cell[rows], minlength=len(edges) - 1) >= LEAST_ROWS
    return np.where(seen, found, np.nan)


def _over_travel(r: DriveRecording, tau_Nm: Array) -> tuple[Array, Array, tuple[str, str] | None]:
    # Middles of the cells, the error there less offset and ratio, and what was wrong with the turn.
    low, high = np.percentile(r.gear_rad, [2, 98])
    edges = np.linspace(float(low), float(high), CELLS + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    error = _error(r, tau_Nm, edges)
    seen = np.isfinite(error)
    if seen.sum() < CELLS / 2:
        what = f"only {seen.sum()} of {CELLS} parts of the travel were traversed evenly"
        return middle, error, (what, "Turn it slowly and evenly, twice.")
    error -= np.polyval(np.polyfit(middle[seen], error[seen], 1), middle)
    return middle, error, None


def judged_encoders(device: Device, c: Capture, r: DriveRecording) -> JudgedEncoders:
    """Direction and ratio of both joint encoders, error over the travel of the motor side's.

    The load side's error cannot be told from the rubber's deflection; the known mass shows it.
    """
    moved = _moved(r.gear_rad, r.motor_rad, r.load_rad)
    names = "motor_encoder_rad", "motor_side_rad", "load_side_rad"
    found: dict[str, Any] = {f"moved_{n}": v for n, v in zip(names, moved, strict=True)}
    problem = _direction(*moved)
    if problem is not None:
        return JudgedEncoders((), problem, found, np.zeros(0), {})
    checks = []
    for side, angle in (("motor", r.motor_rad), ("load", r.load_rad)):
        ratio = _ratio(r, angle, c["tau_Nm"])
        found[f"{side}_ratio"] = ratio
        checks.append(
            StartupCheck(
                "encoders", f"{side} side: error of its ratio to the motor's encoder",
                100 * abs(ratio - 1), 100 * RATIO_OFF, "%",
                "Correct actuator.gear_ratio or actuator.encoder_bits in the device file, or the "
                "encoder's correction.",
            )
        )  # fmt: skip
    middle, error, problem = _over_travel(r, c["tau_Nm"])
    if problem is not None:
        return JudgedEncoders((), problem, found, middle, {})
    worst = float(np.nanmax(np.abs(error)))
    table = _correction(device, c, "motor", middle, error)
    found |= {"motor_error_rad": worst, "motor_correction_rad": table}
    checks.append(
        StartupCheck(
            "encoders", "motor side: largest error over the travel", worst, ERROR_RAD, "rad",
            "Put into the device file: encoder.motor.correction_rad with the values "
            f"{[round(x, 5) for x in table]}; outside of the travel they are not valid.",
        )
    )  # fmt: skip
    return JudgedEncoders(tuple(checks), None, found, middle, {"motor": error})


def judged_sides(r: DriveRecording, tau_Nm: Array) -> JudgedEncoders:
    """Direction of both encoders of a joint without a motor, and each against the other."""
    moved = _moved(r.motor_rad, r.load_rad)
    found: dict[str, Any] = dict(zip(("moved_motor_rad", "moved_load_rad"), moved, strict=True))
    seen = (
        f"while both sides were turned together the motor side's encoder moved by {moved[0]:+.3f} "
        f"rad, the load side's by {moved[1]:+.3f} rad"
    )
    fix = ""
    if max(map(abs, moved)) < LEAST_TURN_RAD:
        fix = f"Turn both by at least {LEAST_TURN_RAD:g} rad, positive direction first."
    elif min(map(abs, moved)) < 0.5 * LEAST_TURN_RAD:
        fix = "Check magnet and cable of the encoder that hardly moved; turn both sides."
    elif min(moved) < 0:
        names = [n for n, v in zip(("motor", "load"), moved, strict=True) if v < 0]
        fix = (
            f"If the joint was turned in the positive direction, set the direction of "
            f"encoder.{' and encoder.'.join(names)} to its opposite and zero again."
        )
    if fix:
        return JudgedEncoders((), (seen, fix), found, np.zeros(0), {})
    ratio = _ratio(r, r.load_rad, tau_Nm)
    sides = DriveRecording(r.tick_s, r.u_Nm, r.motor_rad, r.load_rad, r.load_rad)
    middle, error, problem = _over_travel(sides, tau_Nm)
    if problem is not None:
        return JudgedEncoders((), problem, found, middle, {})
    worst = float(np.nanmax(np.abs(error)))
    found |= {"ratio": ratio, "difference_rad": worst}
    checks = (
        StartupCheck(
            "encoders", "error of the ratio of load side to motor side",
            100 * abs(ratio - 1), 100 * RATIO_OFF, "%",
            "Turn both sides together; check both magnets and encoder.resolution_bits.",
        ),
        StartupCheck(
            "encoders", "largest difference of the sides over the travel", worst, 2 * ERROR_RAD,
            "rad", "Centre the magnets; this does not show which of the two is off.",
        ),
    )  # fmt: skip
    return JudgedEncoders(checks, None, found, middle, {"load": error}, 2 * ERROR_RAD)


def _correction(device: Device, c: Capture, side: str, at: Array, error: Array) -> list[float]:
    # What is to be added to the raw angle at equal steps of the encoder's turn, on top of what is
    # added already; 0 where the joint never was.
    own = getattr(device.file.encoder, side)
    turned = own is not None and own.direction is not None and own.direction.value < 0
    sign = -1.0 if turned else 1.0
    before = own.correction_rad.values if own is not None and own.correction_rad else (0.0,) * TABLE
    turn = 2 * math.pi
    bits = round(device.file.encoder.resolution_bits.value)
    raw = np.unwrap(c[f"count_{side}"] * turn / (1 << bits))
    theta = c[f"theta_{side}_rad"]
    order = np.argsort(theta)
    nodes = np.arange(TABLE) * turn / TABLE
    known = np.isfinite(error)
    raws = np.interp(at[known], theta[order], raw[order])
    wanted = -sign * error[known]
    rising = np.argsort(raws)
    table = []
    for k, node in enumerate(nodes):
        turns = np.round((raws.mean() - node) / turn)
        place = node + turn * turns
        inside = raws.min() - turn / TABLE <= place <= raws.max() + turn / TABLE
        more = float(np.interp(place, raws[rising], wanted[rising])) if inside else 0.0
        table.append(float(before[k * len(before) // TABLE]) + more)
    return table


# -- motor sign -----------------------------------------------------------------------------------


def gear_torque_Nm(device: Device, r: DriveRecording) -> Array:
    """Torque of the motor at the joint, by (5.1), of commands held for a tick."""
    a = device.file.actuator
    assert a is not None
    decay = math.exp(-r.tick_s / a.tau_c_s.value)
    return np.asarray(a.gear_ratio.value * lfilter([0, 1 - decay], [1, -decay], r.u_Nm))


def commanded_work(device: Device, r: DriveRecording) -> tuple[float, float]:
    """Work that the commanded torque did on the drive, and that in either direction, in J.

    Whatever friction, rubber and disturbance do, its sign is the motor's: right if positive.
    """
    steps = gear_torque_Nm(device, r)[1:] * np.diff(r.gear_rad)
    return float(steps.sum()), float(np.abs(steps).sum())


def motor_sign(
    r: DriveRecording, wanted_Nm: Array, most_Nm: float, work_J: float, either_J: float
) -> tuple[str, str] | None:
    """Error in the directions and its fix; None if all agree."""
    share = work_J / either_J if either_J else math.nan
    if not share >= LEAST_WORK_SHARE:
        told = f"the command did {work_J:+.3g} J of work on the drive, {either_J:.3g} J either way"
        if share < 0:
            return told, AGAINST
        return told, "It hardly moved: check that the drive is enabled and no brake is on."
    # Swapped encoders wind the coupling up until a limit acts: it may have ended before.
    turned, sensed, stood = map(np.ptp, (r.gear_rad, r.load_rad, r.motor_rad))
    if sensed > FOLLOWS * turned and stood < STANDS * turned:
        told = f"the load side's encoder moved by {sensed:.4f} rad, the motor side's by {stood:.4f}"
        return told, "The joint's two encoders are swapped: exchange their connectors."
    held = [np.flatnonzero(wanted_Nm * s > 0.98 * most_Nm) for s in (1, -1)]
    if not all(len(h) > 10 for h in held):
        return "It ended before both directions were held.", AGAIN
    # Less the zero after each: where friction left the drive must not count.
    n = min(map(len, held))
    first, second = held[0][-n:][(n - 1) // 2 : -1], held[1][-n:][1 + (n - 1) // 2 :]
    gear, motor, load = (
        float(np.mean(x[first]) - np.mean(x[second])) for x in (r.gear_rad, r.motor_rad, r.load_rad)
    )
    scale = abs(gear)
    seen = (
        f"with the command from {-most_Nm:+.3f} to {most_Nm:+.3f} Nm the motor's encoder moved by "
        f"{gear:+.4f} rad at the joint, the motor side's by {motor:+.4f} rad, the load side's by "
        f"{load:+.4f} rad"
    )
    if abs(load) > STANDS * scale:
        return seen, "The output moved: clamp it."
    if abs(motor) < FOLLOWS * scale:
        return seen, (
            "The motor turns and the coupling does not follow: check cable, its tension and "
            "the motor-side encoder."
        )
    if gear > 0 > motor:
        return seen, (
            "The motor-side encoder counts the other way: set encoder.motor.direction to its "
            "opposite and calibrate its zero again."
        )
    if gear < 0 < motor:
        return seen, "The motor's own encoder counts the other way: swap its A and B channels."
    if gear < 0:
        return seen, AGAINST
    return None


# -- friction -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TurnedFriction:
    """Friction of a drive that somebody turned with its motor off."""

    fc: Estimate
    fv: Estimate
    time_s: Array
    rubber_Nm: Array
    model_Nm: Array


def window(width_s: float, tick_s: float) -> Array:
    n = 2 * max(round(0.5 * width_s / tick_s), 1) + 1
    w = np.hanning(n + 2)[1:-1]
    return np.asarray(w / w.sum())


@lru_cache(maxsize=4)
def _rubber(device: Device) -> HostLibrary:
    sensor = device.sensor
    system = System(
        "rubber",
        sensor.period_s,
        {"sensor": sensor},
        (Task("sense", ("sensor",)),),
        {},
        {p.name: (f"sensor.{p.name}",) for p in sensor.inputs},
        {p.name: f"sensor.{p.name}" for p in sensor.outputs},
    )
    return compile_system(system, "f64")


def rubber_torque_Nm(device: Device, deflection_rad: Array, tick_s: float) -> Array:
    """Torque of the rubber by the device's own sensor, from a quantised deflection."""
    w = window(RUBBER_S, tick_s)
    half = len(w) // 2
    padded = np.pad(deflection_rad, half, mode="edge")
    smooth = np.convolve(padded, w, "valid")
    limit = device.file.limits.theta_rad.value
    inputs = {
        "theta_rad": np.clip(smooth, -limit, limit),
        "omega_rad_s": np.gradient(smooth, tick_s),
    }
    found, _ = _rubber(device).task("sense").run(inputs, trace=False)
    return np.asarray(found["tau_Nm"])


def turned_friction(device: Device, r: DriveRecording) -> TurnedFriction:
    """Coulomb and viscous friction, from (5.2) with no motor torque; the cable's loss is in it.

    Every term goes through one symmetric filter, so that the equation still holds afterwards.
    """
    h, w = r.tick_s, window(FILTER_S, r.tick_s)
    omega, alpha = np.gradient(r.gear_rad, h), np.zeros_like(r.gear_rad)
    alpha[1:-1] = np.diff(r.gear_rad, 2) / h**2
    wound = r.motor_rad - r.load_rad
    rubber = rubber_torque_Nm(device, wound - float(wound[0]), h)
    rate = fftconvolve(omega, w, "same")
    near = np.convolve(np.abs(rate) < SLOW_RAD_S, np.ones(2 * len(w) + 1), "same") > 0
    evenly = np.zeros(len(rate), dtype=bool)
    evenly[len(w) : -len(w) : round(EVERY_S / h)] = True
    used = np.flatnonzero(evenly & ~near)

    def term(x: Array) -> Array:
        return np.asarray(fftconvolve(x, w, "same")[used])

    turning = -term(rubber)
    columns = [term(x) for x in (alpha, omega, np.where(rate < 0, -1.0, 1.0))]
    terms = np.column_stack([*columns, np.ones(len(used))])
    fit = fit_linear(terms, turning, (used * h / BLOCK_S).astype(int))
    fv, fc = fit.estimates()[1:3]
    return TurnedFriction(fc, fv, used * h, turning, terms @ fit.values)
