"""Runs of a controller's compiled C, as it ships, against a plant and a person."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from esea_gen.control.laws.predictive import device_horizon
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.device import Device
from esea_gen.errors import UserError, choose
from esea_gen.language.ports import Array
from esea_gen.model.sensing import of_axis
from esea_gen.twin.case import IMPEDANCE, OFF, Case, Setting
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.encoders import ENCODERS
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.hand import hand_variant
from esea_gen.twin.hand_plant import tunable_places
from esea_gen.twin.judge import LIMITED, rate_limited
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.off import deviation, refuse_unknown
from esea_gen.twin.people import PlantVariant, limb_of, named_plant, random_person
from esea_gen.twin.published import PEOPLE
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

PERSON_NAMES = ("none", "ideal", "uncertain", "uncertain-no-feedforward", "random")
# The controller is off at first and armed meanwhile, as after a start of the firmware; a slow
# control task must have given two commands before.
ARM_S, ON_S = 0.03, 0.06
ARM_PERIODS, ON_PERIODS = 2.5, 3.0
# What is 0 all along; of an axis that a case does not move, what is wanted too.
ZERO = ("stop", "law", "constrained", "motor_C", *(f"frame_error_{s}" for s in ENCODERS))
WANTED = ("tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s")
# The thesis weighs the impedance experiment otherwise than the torque experiments.
PRINTED_IMPEDANCE = {"Q": 1.0, "R": 0.005}


def plant_variant(device: Device, plant: str, person: str, seed: int) -> PlantVariant:
    if len(device.axes) > 1:
        return _stepped(device, hand_variant(device, plant, person, seed))
    choose("person", person, PERSON_NAMES)
    made = _stepped(device, named_plant(plant, device, seed))
    if person == "none":
        return made.having(PEOPLE["none"], clamped=1.0)
    named = random_person(seed) if person == "random" else PEOPLE[person]
    return made.having(limb_of(device, named))


@lru_cache(maxsize=8)
def compiled_loop(device: Device, cable: bool, real: str) -> ClosedLoop:
    """Loop of a device and a plant, compiled once in a process."""
    variant = plant_variant(device, "real" if cable else "ideal", "none", 0)
    return ClosedLoop(device.system, variant, real)


def _stepped(device: Device, variant: PlantVariant) -> PlantVariant:
    # The plant takes whole steps in a tick of the device, none longer than its own.
    steps = math.ceil(device.period_s / variant.step_s - 1e-6)
    step_s = device.period_s / steps
    return variant if math.isclose(step_s, variant.step_s) else replace(variant, step_s=step_s)


def previews(path: Trajectory, horizon: Horizon, tick_s: float = 1 / RATE_HZ) -> dict[str, Array]:
    """Previews for a predictive controller with a known future."""
    ticks = np.rint(np.array(horizon.ends_s) * RATE_HZ).astype(int) - round(tick_s * RATE_HZ)
    n = len(path.tau_desired_Nm)
    at = np.minimum(np.arange(n)[:, None] + ticks, n - 1)
    given = {
        "tau_preview_Nm": path.tau_desired_Nm,
        "theta_preview_rad": path.theta_p_rad,
        "omega_preview_rad_s": path.omega_p_rad_s,
    }
    return {name: np.asarray(values[at]) for name, values in given.items()}


def told(
    device: Device, loop: ClosedLoop, path: Trajectory, mode: int, axis: str = ""
) -> dict[str, Array]:
    """Inputs of a controller along a path: off at first, armed, then the mode; the first law."""
    n = len(path.tau_desired_Nm)
    t = np.arange(n) / RATE_HZ
    slow_s = device.system.tasks[-1].every * device.period_s
    given = path.signals()
    signals = {k if k in loop.signals else of_axis(k, axis): v for k, v in given.items()} | {
        "mode": np.where(t < max(ON_S, ON_PERIODS * slow_s), OFF, mode).astype(float),
        "rearm": (t >= max(ARM_S, ARM_PERIODS * slow_s)).astype(float),
    }
    known = previews(path, device_horizon(device), device.period_s)
    future = {of_axis(k, a): v * (a == axis) for k, v in known.items() for a in device.axes}
    zero = {of_axis(k, a): np.zeros(n) for k in (*ZERO, *WANTED) for a in ("", *device.axes)}
    signals = {k: v for k, v in (zero | future).items() if k in loop.signals} | signals
    ticks = round(n / RATE_HZ / device.period_s)
    return {k: _resampled(v, RATE_HZ * device.period_s, ticks) for k, v in signals.items()}


def _resampled(values: Array, ratio: float, count: int) -> Array:
    # What holds at each of ``count`` moments, ``ratio`` old samples apart; unchanged at ratio 1.
    at = (np.arange(count) * ratio + 1e-6).astype(int)
    return np.asarray(values[np.minimum(at, len(values) - 1)])


def axis_of(device: Device, setting: Setting) -> str:
    """Name of the axis that a setting's cases move; empty of a device with one."""
    if not setting.axis:
        return device.axes[0]
    if device.axes == ("",):
        raise UserError(f"axis {setting.axis}: {device.origin} has one axis.", "Leave --axis out.")
    choose("axis", setting.axis, device.axes)
    return setting.axis


def run_case(case: Case, setting: Setting, seed: int) -> ClosedLoopRun:
    device = controller_device(setting.controller)
    person = "none" if case.trajectory.clamped else setting.person
    variant = plant_variant(device, setting.plant, person, seed)
    loop = compiled_loop(device, variant.cable, setting.real)
    return run_on(loop, device, variant, case, setting, seed)


def run_on(
    loop: ClosedLoop, device: Device, variant: PlantVariant, case: Case, setting: Setting, seed: int
) -> ClosedLoopRun:
    """Run one case on a loop that is compiled already."""
    fixed = case.trajectory.clamped
    axis = axis_of(device, setting)
    signals = told(device, loop, case.trajectory, case.mode, axis)
    merged = {k: dict(v) for k, v in setting.tunables.items()}
    for name in (b for b in device.system.blocks if b.partition("_")[0] == "predictive"):
        chosen = {"load_free": 0.0 if fixed else 1.0}
        if case.mode == IMPEDANCE and setting.controller.startswith("mpc-published"):
            chosen |= PRINTED_IMPEDANCE
        merged[name] = chosen | merged.get(name, {})
    for instance, values in case.tunables.items():
        merged.setdefault(f"{instance}_{axis}" if axis else instance, {}).update(values)
    # A variant knows only what its plant has: the rigid one has no cable to twist.
    known = tunable_places(loop.plant)
    both = ((n, v) for k, v in case.plant.items() for n in (k, of_axis(k, axis)))
    extra = {n: v for n, v in both if n in known}
    fault = parse_fault(setting.fault) if setting.fault else None
    off = deviation(setting.off, device, seed)
    values = {of_axis(k, a): v for k, v in off.values.items() for a in device.axes}
    refuse_unknown(f"--off {setting.off}", values, known)
    n, ratio = len(case.trajectory.tau_desired_Nm), RATE_HZ * device.period_s
    missed = off.missed(n, seed)
    run = loop.run(
        signals,
        {**variant.values, **extra, **values},
        merged,
        seed=seed,
        delay_ticks=math.ceil(off.delay_ticks / ratio - 1e-9),  # at least as late as it says
        missed=None if missed is None else _resampled(missed, ratio, round(n / ratio)),
        fault=fault,
        axis=axis,
    ).of_axis(axis)
    if device.period_s == 1 / RATE_HZ:
        return run
    # Judged at the rate of the trajectories, whatever the device's.
    plant, controller = (
        {k: _resampled(v, 1 / ratio, n) for k, v in part.items()}
        for part in (run.plant, run.controller)
    )
    # The limit may act in every second tick: the mean of all up to the next moment.
    at = _resampled(np.arange(len(run), dtype=float), 1 / ratio, n).astype(int)
    acts = np.add.reduceat(rate_limited(run.controller["limits_status"]), at)
    controller[LIMITED] = acts / np.maximum(1, np.diff(at, append=len(run)))
    return replace(run, plant=plant, controller=controller, time_s=np.arange(n) / RATE_HZ)
