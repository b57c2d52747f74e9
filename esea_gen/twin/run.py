"""Runs of a controller's compiled C, as it ships, against a plant and a person."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from esea_gen.control.horizon import Horizon
from esea_gen.control.laws.predictive import device_horizon
from esea_gen.device import Device
from esea_gen.errors import choose
from esea_gen.language.ports import Array
from esea_gen.twin.case import IMPEDANCE, OFF, Case, Setting
from esea_gen.twin.closed_loop import ClosedLoop, ClosedLoopRun
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.off import deviation, refuse_unknown
from esea_gen.twin.people import PlantVariant, ideal_plant, random_person, random_plant, real_plant
from esea_gen.twin.published import PEOPLE
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

PLANT_NAMES = ("ideal", "real", "random")
PERSON_NAMES = ("none", "ideal", "uncertain", "uncertain-no-feedforward", "random")
# The controller is off at first and armed meanwhile, as after a start of the firmware; a slow
# control task must have given two commands before.
ARM_S, ON_S = 0.03, 0.06
ARM_PERIODS, ON_PERIODS = 2.5, 3.0
# The thesis weighs the impedance experiment otherwise than the torque experiments.
PRINTED_IMPEDANCE = {"Q": 1.0, "R": 0.005}


def plant_variant(device: Device, plant: str, person: str, seed: int) -> PlantVariant:
    """A plant with a person.

    person: one of ``PERSON_NAMES``; none fixes the output.
    """
    choose("plant", plant, PLANT_NAMES)
    choose("person", person, PERSON_NAMES)
    made = {
        "ideal": lambda: ideal_plant(device),
        "real": lambda: real_plant(device, seed=seed),
        "random": lambda: random_plant(device, seed),
    }[plant]()
    if person == "none":
        return made.having(PEOPLE["none"], clamped=1.0)
    return made.having(random_person(seed) if person == "random" else PEOPLE[person])


@lru_cache(maxsize=8)
def compiled_loop(device: Device, cable: bool, real: str) -> ClosedLoop:
    """Loop of a device and a plant, compiled once in a process."""
    variant = real_plant(device) if cable else ideal_plant(device)
    return ClosedLoop(device.system, variant, real)


def previews(path: Trajectory, horizon: Horizon) -> dict[str, Array]:
    """What a predictive controller with a known future is given.

    return: ``tau_preview_Nm``, ``theta_preview_rad`` and ``omega_preview_rad_s``, each of shape
        (ticks, intervals): the values at the end of every interval; the last ones hold.
    """
    # The control task reads what was measured a tick ago.
    ticks = np.rint(np.array(horizon.ends_s) * RATE_HZ).astype(int) - 1
    n = len(path.tau_desired_Nm)
    at = np.minimum(np.arange(n)[:, None] + ticks, n - 1)
    given = {
        "tau_preview_Nm": path.tau_desired_Nm,
        "theta_preview_rad": path.theta_p_rad,
        "omega_preview_rad_s": path.omega_p_rad_s,
    }
    return {name: np.asarray(values[at]) for name, values in given.items()}


def told(device: Device, loop: ClosedLoop, path: Trajectory, mode: int) -> dict[str, Array]:
    """What a controller is told along a path: off at first, armed, then the mode; the first law."""
    n = len(path.tau_desired_Nm)
    t = np.arange(n) / RATE_HZ
    slow_s = device.system.tasks[-1].every / RATE_HZ
    signals = path.signals() | {
        "mode": np.where(t < max(ON_S, ON_PERIODS * slow_s), OFF, mode).astype(float),
        "rearm": (t >= max(ARM_S, ARM_PERIODS * slow_s)).astype(float),
    }
    rest = ("stop", "frame_error_motor", "frame_error_load", "frame_error_gear", "law")
    given = {name: np.zeros(n) for name in rest} | previews(path, device_horizon(device))
    return signals | {k: v for k, v in given.items() if k in loop.signals}


def run_case(case: Case, setting: Setting, seed: int) -> ClosedLoopRun:
    """Run one case."""
    device = controller_device(setting.controller)
    person = "none" if case.trajectory.clamped else setting.person
    variant = plant_variant(device, setting.plant, person, seed)
    loop = compiled_loop(device, variant.cable, setting.real)
    return run_on(loop, device, variant, case, setting, seed)


def run_on(
    loop: ClosedLoop,
    device: Device,
    variant: PlantVariant,
    case: Case,
    setting: Setting,
    seed: int,
) -> ClosedLoopRun:
    """Run one case on a loop that is compiled already.

    loop: the device's System, or one that shows more of it, with a plant.
    """
    fixed = case.trajectory.clamped
    signals = told(device, loop, case.trajectory, case.mode)
    merged = {k: dict(v) for k, v in setting.tunables.items()}
    if "predictive" in device.system.blocks:
        chosen = {"load_free": 0.0 if fixed else 1.0}
        if case.mode == IMPEDANCE and setting.controller.startswith("mpc-published"):
            chosen |= PRINTED_IMPEDANCE
        merged["predictive"] = chosen | merged.get("predictive", {})
    for instance, values in case.tunables.items():
        merged.setdefault(instance, {}).update(values)
    # A variant knows only what its plant has: the rigid one has no cable to twist.
    known = {x.name for b in loop.plant.blocks.values() for x in b.tunables}
    extra = {k: v for k, v in case.plant.items() if k in known}
    fault = parse_fault(setting.fault) if setting.fault else None
    off = deviation(setting.off, device, seed)
    refuse_unknown(setting.off, off, known)
    n = len(case.trajectory.tau_desired_Nm)
    return loop.run(
        signals,
        {**variant.values, **extra, **off.values},
        merged,
        seed=seed,
        delay_ticks=off.delay_ticks,
        missed=off.missed(n, seed),
        fault=fault,
    )
