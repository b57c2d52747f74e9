"""The start-up routine, procedure by procedure, and what comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from esea_gen.control.linear_loop import check_loop
from esea_gen.control.sliding_mode import LEAD
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.studies.registry import Study
from esea_gen.studies.startup.checks import checks_of
from esea_gen.studies.startup.device_text import updated_device
from esea_gen.studies.startup.drive_model import DriveModel, identify_drive
from esea_gen.studies.startup.machine import Machine, SimulatedMachine
from esea_gen.studies.startup.margins import MarginCheck, check_margins
from esea_gen.studies.startup.outcome import Refusal, Startup
from esea_gen.studies.startup.procedures import PROCEDURES, require_drive, run_procedure, travel
from esea_gen.studies.startup.recordings import read_recordings
from esea_gen.studies.startup.sign import SignCheck
from esea_gen.studies.startup.watch import DriveRecording, StoppedError, WatchedMachine
from esea_gen.studies.startup.waves import strongest_waves
from esea_gen.twin.off import NOTHING, chosen_families, deviation, refuse_unknown
from esea_gen.twin.parameters import SINES
from esea_gen.twin.people import PlantVariant
from esea_gen.twin.plant import TICK_S
from esea_gen.twin.run import plant_variant
from esea_gen.twin.stepped import SteppedPlant

LAW = "sliding_mode"


class StartupStudy(Study):
    """Start a drive up: sign, gain, friction, inertia, lag, delay, gear's disturbance; margins."""

    name = "startup"
    title = "Start-up of a drive"


@dataclass(frozen=True)
class SimulatedDrive:
    """The virtual exoskeleton that stands in for the machine.

    plant: ``ideal``, ``real`` or ``random``.
    seed: of the plant and of the procedures' jumps.
    off: in what the plant differs from the device file, as :mod:`esea_gen.twin.off` names it.
    motor_gain: motor's torque over its command; below 0 it turns the other way.
    delay_s: from command to torque, beside what the family brings.
    """

    plant: str = "real"
    seed: int = 0
    off: str = NOTHING
    motor_gain: float = 1.0
    delay_s: float = 0.0

    def words(self) -> str:
        """For tables and sources."""
        parts = [f"simulated: plant {self.plant}, seed {self.seed}"]
        if self.off != NOTHING:
            parts.append(self.off)
        if self.motor_gain != 1:
            parts.append(f"motor gain {self.motor_gain:g}")
        if self.delay_s:
            parts.append(f"delay {1e3 * self.delay_s:g} ms")
        return ", ".join(parts)

    def made(self, device: Device) -> SteppedPlant:
        """The plant, output and joint as each procedure asks."""
        variant = plant_variant(device, self.plant, "none", self.seed)
        families = chosen_families(self.off)
        if len(families) != 1:
            raise UserError(
                f"--off {self.off}: these are {len(families)} families; a start-up is of one "
                "machine.",
                f"Give one of {', '.join(families)}.",
            )
        off = deviation(families[0], device, self.seed)
        if off.missed_share:
            raise UserError(
                f"--off {self.off}: runs of the control task are missed; a start-up has none.",
                "Give another family.",
            )
        probe = SteppedPlant(variant)
        refuse_unknown(self.off, off, {t.name for _, t in probe.system.tunables})
        return SteppedPlant(
            variant.having(None, **off.values),
            motor_gain=self.motor_gain,
            delay_s=self.delay_s + TICK_S * off.delay_ticks,
        )


def simulated_truth(plant: SteppedPlant) -> dict[str, float]:
    """What the estimates of a simulated plant are to be, by their names."""
    known: dict[str, float] = {t.name: t.default for _, t in plant.system.tunables}
    known |= plant.variant.values
    cable = plant.variant.cable
    found = {
        "gain": plant.gain,
        # The procedures cannot tell the coupling's motor-side part from what drives it.
        "J_kgm2": known["J_kgm2"] + (known["motor_side_inertia_kgm2"] if cable else 0.0),
        "fv_Nms_rad": known["fv_Nms_rad"] + (known["motor_side_damping_Nms_rad"] if cable else 0.0),
        "fc_Nm": known["fc_Nm"],
        "tau_c_s": known["tau_c_s"],
        "delay_s": plant.delay_s,
        "delay_again_s": plant.delay_s,
        "cable_loss": known["cable_loss"] if cable else 0.0,
        "joint_ratio": 1.0,
    }
    stiffness = known["cable_stiffness_Nm_rad"] if cable else math.inf
    found["cable_give_rad_Nm"] = 1 / stiffness
    found["backlash_rad"] = known["cable_backlash_rad"] if cable else 0.0
    return found


def true_map_Nm(variant: PlantVariant, default_j: float, gear_rad: Array) -> Array:
    """Torque of a simulated gear's disturbance, as a map has it, its mean taken off."""
    v = variant.values
    rms = v.get("gear_disturbance_rms_rad_s2", 0.0)
    total = np.zeros(len(gear_rad))
    for i in range(1, SINES + 1):
        wave, phase = v.get(f"wave_{i}_1_rad", 0.0), v.get(f"phase_{i}_rad", 0.0)
        total += np.sin(wave * gear_rad + phase)
    torque = -v.get("J_kgm2", default_j) * math.sqrt(2 / SINES) * rms * total
    return np.asarray(torque - np.mean(torque))


def _fit_for_it(device: Device, machine: Machine) -> None:
    require_drive(device)
    if abs(device.period_s - machine.tick_s) > 1e-9:
        raise UserError(
            f"{device.origin}: timing.sense_rate_Hz = {1 / device.period_s:g} Hz; this machine has "
            f"a tick every {1e3 * machine.tick_s:g} ms.",
            f"Give {1 / machine.tick_s:g} Hz.",
        )
    travel(device)


def start_up(
    device: Device,
    machine: Machine,
    source: str,
    *,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
    truth: Mapping[str, float] | None = None,
    true_map: Callable[[Array], Array] | None = None,
) -> Startup:
    """All procedures on a machine, one after the other, and what they find.

    source: of the numbers, in words.
    truth, true_map: of a simulated plant; only shown beside what was found.
    """
    _fit_for_it(device, machine)
    watched = WatchedMachine(machine, device)
    recordings: dict[str, DriveRecording] = {}
    sign: SignCheck | None = None
    refusal: Refusal | None = None
    for p in PROCEDURES:
        say(p.title)
        try:
            recordings[p.name] = run_procedure(watched, device, p, seed)
        except StoppedError as stopped:
            refusal = Refusal(p.name, stopped.reason, stopped.fix)
            break
        if p.name == "sign":
            sign = SignCheck.of(recordings[p.name])
            problem = sign.problem()
            if problem is not None:
                refusal = Refusal(p.name, *problem)
                break
    base = Startup(device, source, watched.total_s, sign, refusal, truth=dict(truth or {}))
    base = replace(base, recordings=recordings)
    return base if refusal is not None else _found(base, say, true_map)


def start_up_recorded(
    device: Device, folder: Path, say: Callable[[str], None] = lambda _: None
) -> Startup:
    """The numbers from recordings of all procedures, as :func:`write_recordings` wrote them."""
    require_drive(device)
    recordings = read_recordings(folder, [p.name for p in PROCEDURES], device.period_s)
    sign = SignCheck.of(recordings["sign"])
    problem = sign.problem()
    refusal = None if problem is None else Refusal("sign", *problem)
    total_s = sum(len(r) * r.tick_s for r in recordings.values())
    base = Startup(device, f"recordings in {folder.name}", total_s, sign, refusal)
    return base if refusal is not None else _found(replace(base, recordings=recordings), say)


def _found(
    base: Startup,
    say: Callable[[str], None],
    true_map: Callable[[Array], Array] | None = None,
) -> Startup:
    device, source, recordings = base.device, base.source, base.recordings
    say("least squares")
    model = identify_drive(device, recordings)
    d = model.disturbance
    updated = updated_device(device, model, f"start-up, {source}")
    say("margins")
    margins, problem = judged_gains(updated, model)
    return replace(
        base,
        model=model,
        waves=strongest_waves(d.gear_rad, d.torque_Nm, float(np.mean(d.half_Nm))),
        checks=checks_of(device, model),
        updated=updated,
        margins=margins,
        as_it_stands=None if margins is None else check_margins(device, model),
        law_problem=problem,
        true_map_Nm=None if true_map is None else true_map(d.gear_rad),
    )


def judged_gains(
    updated: Device, model: DriveModel
) -> tuple[MarginCheck | None, tuple[str, str] | None]:
    """Margins of a device's gains on the drive that was found, and what else is against them."""
    names = [law.name for law in updated.laws]
    if names != [LAW]:
        return None, (
            f"the margins are known of {LAW} alone, and the device has {', '.join(names)}: "
            "nothing is said of its gains",
            "Build and simulate the device file that --out writes, with --off delay and rubber.",
        )
    try:
        check_loop(updated, LEAD)
    except UserError as refused:
        return check_margins(updated, model), (refused.what, refused.fix)
    return check_margins(updated, model), None


def start_up_simulated(
    device: Device, drive: SimulatedDrive, say: Callable[[str], None] = lambda _: None
) -> Startup:
    """The routine in the virtual exoskeleton."""
    if drive.seed < 0:
        raise UserError(f"seed = {drive.seed}.", "Give 0 or more.")
    require_drive(device)
    assert device.file.actuator is not None
    plant = drive.made(device)
    j = device.file.actuator.J_kgm2.value
    return start_up(
        device,
        SimulatedMachine(plant),
        drive.words(),
        seed=drive.seed,
        say=say,
        truth=simulated_truth(plant),
        true_map=lambda angles: true_map_Nm(plant.variant, j, angles),
    )


__all__ = [
    "SimulatedDrive",
    "StartupStudy",
    "judged_gains",
    "simulated_truth",
    "start_up",
    "start_up_recorded",
    "start_up_simulated",
]
