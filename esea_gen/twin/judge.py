"""The figures of one run: errors of the true torque and of the sensed one, and how it ended."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from esea_gen.control.limits.faults import limit_status
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.twin.case import IMPEDANCE, Case
from esea_gen.twin.faults import EncoderFault
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.published import PLANTS
from esea_gen.twin.trajectories import RATE_HZ

# Of a run with an encoder's fault; the first three are None where it was never found.
ENCODER_FAULT = ("detected_ticks", "detected_fault", "torque_then_Nm", "peak_torque_Nm", "energy_J")
ROUGHNESS = ("command_above_20Hz_Nm", "noise_above_5Hz_Nm", "rate_limited_share")
# What a table of errors shows of them: heads, factors and units.
ROUGH_HEADS = ("cmd >20 Hz", "noise >5 Hz", "rate limit")
ROUGH_UNITS = ((1e3, ".1f", " mNm"), (1e3, ".1f", " mNm"), (1e2, ".1f", " %"))
COMMAND_HZ, NOISE_HZ = 20.0, 5.0  # no person follows; nor is there a wanted torque, in the studies
RATE_LIMITED = 1 << [f.name for f in limit_status(1.0).flags].index("RATE_LIMITED")
LIMITED = "rate_limited"  # of a run at another rate: the share of each ms
AFTER_S = 0.2  # how long the limb is still watched after a fault has been found
SWINGS_HZ = 4.0  # above what a person wants; the drive swings on its cable beyond
ENDED = {"unstable": "unstable", "tripped": "drive tripped", "fault": "fault latched"}
FIGURES: tuple[str, ...] = ("rms_true_Nm", "rms_model_Nm", "max_true_Nm", "rms_above_4Hz_Nm")
FIGURES += (*ENDED, "fault_reason", "limited_share", *ROUGHNESS, "largest_desired_Nm")
FIGURES += ("rms_normalised", "missed_runs")


def desired_torque(case: Case, run: ClosedLoopRun) -> Array:
    """The torque that a case asks for, from the true motion."""
    path = case.trajectory
    if case.mode != IMPEDANCE:
        return path.tau_desired_Nm
    gains = case.tunables["reference"]
    wanted = gains["Kp_Nm_rad"] * (path.theta_p_rad - run.plant["theta_l_rad"])
    return np.asarray(
        path.tau_desired_Nm
        + wanted
        + gains["Kd_Nms_rad"] * (path.omega_p_rad_s - run.plant["omega_l_rad_s"])
    )


def above(values: Array, cutoff_Hz: float = SWINGS_HZ) -> Array:
    """High-pass at a frequency: fourth order, forwards and backwards, without a shift."""
    from scipy.signal import butter, sosfiltfilt

    high = butter(4, cutoff_Hz, "highpass", fs=RATE_HZ, output="sos")
    return np.asarray(sosfiltfilt(high, values))


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rate_limited(limits_status: Array) -> Array:
    """1 where the limits' rate holds the command back, else 0."""
    return np.asarray(np.asarray(limits_status, np.int64) & RATE_LIMITED > 0, dtype=np.float64)


def roughness(u_Nm: Array, error_Nm: Array, limited: Array) -> dict[str, float]:
    """How rough a drive runs, sampled at 1 kHz.

    The command above 20 Hz, the torque above 5 Hz that the wanted one does not have, and the share
    of the time in which the limits' rate holds the command back.
    """
    values = rms(above(u_Nm, COMMAND_HZ)), rms(above(error_Nm, NOISE_HZ)), float(np.mean(limited))
    return dict(zip(ROUGHNESS, values, strict=True))


def rough_cells(figures: Mapping[str, float | None]) -> list[str]:
    """The three measures as a table shows them; a dash where one is not known."""
    known = [figures.get(k) for k in ROUGHNESS]
    return [
        "-" if x is None or math.isnan(x) else f"{factor * x:{form}}{unit}"
        for x, (factor, form, unit) in zip(known, ROUGH_UNITS, strict=True)
    ]


def judge(case: Case, run: ClosedLoopRun, u_max_Nm: float, torque: float = 1.0) -> dict[str, float]:
    w = case.trajectory.window
    desired = desired_torque(case, run)
    true, model = run.plant["tau_e_Nm"] - desired, run.controller["tau_Nm"] - desired
    speed = np.max(np.abs(run.plant["omega_g_rad_s"]))
    u = run.controller["u_Nm"][w]
    limited = run.controller.get(LIMITED, rate_limited(run.controller["limits_status"]))
    worst = float(np.max(np.abs(true[w])))
    error_Nm = torque * PLANTS.unstable.max_true_error_Nm
    out = {
        "rms_true_Nm": rms(true[w]),
        "rms_model_Nm": rms(model[w]),
        "max_true_Nm": worst,
        "rms_above_4Hz_Nm": rms(above(true[w])),
        "unstable": float(worst > error_Nm or speed > PLANTS.unstable.max_gear_speed_rad_s),
        "tripped": float(np.max(run.plant["tripped"]) > 0),
        "fault": float(np.max(run.controller["fault"][w]) > 0),
        "limited_share": float(np.mean(np.abs(u) >= 0.999 * u_max_Nm)),
        **roughness(u, true[w], limited[w]),
    }
    if (latched := np.flatnonzero(run.controller["fault"][w])).size:
        out["fault_reason"] = float(run.controller["fault"][w][latched[0]])
    if run.missed_runs:
        out["missed_runs"] = float(run.missed_runs)
    if case.mode == IMPEDANCE:
        largest = float(np.max(np.abs(desired[w])))
        out["largest_desired_Nm"] = largest
        if largest > 0:
            out["rms_normalised"] = out["rms_true_Nm"] / largest
    return out


def fault_figures(run: ClosedLoopRun, fault: EncoderFault) -> dict[str, float]:
    """Effect of a fault on the limb until its detection, and :data:`AFTER_S` longer."""
    tick_s = float(run.time_s[1] - run.time_s[0])
    first = round(fault.at_s / tick_s)
    if first >= len(run) - 1:
        raise UserError(f"{fault}: the run ends at {run.time_s[-1]:g} s.", "Let it begin earlier.")
    reason = run.controller["fault"]
    if reason[first]:
        raise UserError(
            f"{fault}: at {fault.at_s:g} s the latch is closed, with fault {reason[first]:g}.",
            "Let it begin later.",
        )
    latched = np.flatnonzero(reason[first:] > 0)
    found = first + int(latched[0]) if len(latched) else None
    last = len(run) if found is None else found + round(AFTER_S / tick_s)
    tau = run.plant["tau_e_Nm"][first:last]
    work = np.cumsum(tau * run.plant["omega_l_rad_s"][first:last]) * tick_s
    work = np.concatenate([[0.0], work])
    out = {
        "peak_torque_Nm": float(np.max(np.abs(tau))),
        "energy_J": float(np.max(work - np.minimum.accumulate(work))),
    }
    if found is not None:
        out["detected_ticks"] = float(found - first)
        out["detected_fault"] = float(reason[found])
        out["torque_then_Nm"] = float(abs(tau[found - first]))
    return out
