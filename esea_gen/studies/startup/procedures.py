"""The procedures: what a person does, what the motor is asked for, what ends it.

Each is safe with what is known before it: the first one steers by nothing and asks for little; the
others steer by the motor's encoder, whose sign the first one has found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.studies.startup.machine import Output
from esea_gen.studies.startup.motions import Command, Feel, GearPath, Steering, switching
from esea_gen.studies.startup.watch import Envelope, WatchedMachine

MARGIN_RAD, LEAST_SPAN_RAD = 0.1, 1.0
CLAMPED_RAD, CLAMPED_RAD_S = 0.15, 0.15
FEEL_SHARE, FEEL_RATE_NM_S, FEEL_RAD = 0.5, 0.1, 0.03
FRICTION_RAD_S = (0.4, 0.8, 1.4)
MAP_RAD_S, CARRY_RAD_S = 0.3, 0.6
SHAKE_NM_SHARE = 0.28  # of the envelope's torque


@dataclass(frozen=True)
class Procedure:
    """One procedure.

    output: how the output is held.
    setup, motion: what the person does, and what the drive then does.
    finds: what it is for.
    command: of the device, for a tick of so many seconds and a seed.
    """

    name: str
    title: str
    output: Output
    setup: str
    motion: str
    finds: str
    command: Callable[[Device, float, int], Command]


def require_drive(device: Device) -> None:
    """Refuse a device without a drive, or with several."""
    if device.drive is None:
        raise UserError(
            f"{device.origin}: the device has no drive to start up.",
            'Write extends = "elbow_drive" in it.',
        )
    if len(device.axes) > 1:
        raise UserError(
            f"{device.origin}: it has {len(device.axes)} axes; a start-up is of one drive.",
            "Give a device file of one axis alone.",
        )


def travel(device: Device) -> tuple[float, float]:
    """Within what the joint is turned, ends included."""
    s = device.file.safety
    assert s is not None
    low, high = s.rom_min_rad.value + MARGIN_RAD, s.rom_max_rad.value - MARGIN_RAD
    if high - low < LEAST_SPAN_RAD:
        raise UserError(
            f"{device.origin}: the joint may turn by {high - low:.2f} rad between "
            f"safety.rom_min_rad and rom_max_rad less {MARGIN_RAD:g} rad at either end; "
            f"{LEAST_SPAN_RAD:g} rad are needed to tell friction from the gear's disturbance.",
            "Widen the range for the start-up, with the joint empty.",
        )
    return low, high


def start_rad(device: Device, procedure: Procedure) -> float:
    """Where a person sets the joint up."""
    low, high = travel(device)
    return 0.5 * (low + high) if procedure.output == "clamped" else low


def _feel(device: Device, tick_s: float, _seed: int) -> Command:
    return Feel(FEEL_SHARE * Envelope.of(device).u_Nm, FEEL_RATE_NM_S, FEEL_RAD, tick_s)


def _against_rubber(device: Device, tick_s: float, _seed: int) -> Command:
    reach = min(CLAMPED_RAD, 0.75 * device.file.domain.theta_max_rad.value)
    legs = [(reach, CLAMPED_RAD_S), (-reach, CLAMPED_RAD_S)] * 3 + [(0.0, CLAMPED_RAD_S)]
    return Steering(device, GearPath.through(legs, tick_s), coupling=True)


def _to_and_fro(device: Device, tick_s: float, speeds: tuple[float, ...]) -> GearPath:
    low, high = travel(device)
    return GearPath.through([(end, v) for v in speeds for end in (high - low, 0.0)], tick_s)


def _turns(*speeds: float) -> Callable[[Device, float, int], Command]:
    return lambda device, tick_s, _seed: Steering(device, _to_and_fro(device, tick_s, speeds))


def _shaken(shortest_s: float, longest_s: float, times: int) -> Any:
    def command(device: Device, tick_s: float, seed: int) -> Command:
        path = _to_and_fro(device, tick_s, (CARRY_RAD_S,) * times)
        size = SHAKE_NM_SHARE * Envelope.of(device).u_Nm
        ends = round(shortest_s / tick_s), round(longest_s / tick_s)
        jumps = switching(len(path), *ends, size, seed)
        return Steering(device, path, added_Nm=jumps * (path.omega_rad_s != 0))

    return command


CLAMP = "Clamp the output at {at_deg:.0f} deg, nobody in the joint."
FREE = (
    "Leave the output free, the joint empty, at {at_deg:.0f} deg; stay clear of its whole travel."
)
PROCEDURES = (
    Procedure(
        "sign",
        "motor sign",
        "clamped",
        CLAMP,
        "A torque rises slowly until the motor's encoder has moved a little, then the other way.",
        "which way motor and encoders count",
        _feel,
    ),
    Procedure(
        "gain",
        "motor gain",
        "clamped",
        CLAMP + "  It still is, from the procedure before.",
        "The drive winds the rubber up slowly, three times both ways.",
        "the motor's torque over its command, and the cable's loss",
        _against_rubber,
    ),
    Procedure(
        "friction",
        "friction",
        "free",
        FREE,
        "The joint turns to and fro over its travel at three speeds.",
        "Coulomb and viscous friction",
        _turns(*FRICTION_RAD_S),
    ),
    Procedure(
        "inertia",
        "inertia and lag",
        "free",
        FREE,
        "The joint turns to and fro while the torque jumps.",
        "inertia of the motor's side, and lag of the torque",
        _shaken(0.02, 0.08, 2),
    ),
    Procedure(
        "delay",
        "delay",
        "free",
        FREE,
        "The same with other jumps, drawn anew.",
        "delay from the command to the encoder's first reaction",
        _shaken(0.025, 0.07, 2),
    ),
    Procedure(
        "disturbance",
        "gear's disturbance",
        "free",
        FREE,
        "The joint turns slowly to and fro over its travel.",
        "torque that gear and cable add over the motor's angle",
        _turns(MAP_RAD_S),
    ),
)
BY_NAME: Mapping[str, Procedure] = {p.name: p for p in PROCEDURES}


def guide(device: Device) -> list[str]:
    """What there is to do, as lines of text."""
    require_drive(device)
    tick_s = device.period_s
    e = Envelope.of(device)
    lines = [
        f"Start-up of {device.name} ({device.title})",
        f"Every command stays within {e.u_Nm:.3g} Nm and {e.u_rate_Nm_s:g} Nm/s at the motor; the "
        "motor is switched to no torque when",
        f"  the coupling is deflected by more than {e.deflection_rad:.3g} rad, the drive turns "
        f"faster than {e.omega_rad_s:g} rad/s at the joint,",
        f"  the joint is outside of {e.low_rad:.3g} to {e.high_rad:.3g} rad, or the drive does not "
        "follow its path.",
    ]
    for k, p in enumerate(PROCEDURES, 1):
        command = p.command(device, tick_s, 0)
        lasts = f"{len(command.path) * tick_s:.0f} s" if isinstance(command, Steering) else "3 s"
        setup = p.setup.format(at_deg=math.degrees(start_rad(device, p)))
        lines += [f"{k}. {p.title}: {p.finds}.", f"   {setup}", f"   {p.motion}  About {lasts}."]
    return lines


def run_procedure(watched: WatchedMachine, device: Device, procedure: Procedure, seed: int) -> Any:
    """Drive through one procedure."""
    draw = int(np.random.default_rng([seed, PROCEDURES.index(procedure)]).integers(1 << 30))
    command = procedure.command(device, watched.tick_s, draw)
    return watched.run(procedure.output, start_rad(device, procedure), command)


__all__ = [
    "BY_NAME",
    "PROCEDURES",
    "Procedure",
    "guide",
    "require_drive",
    "run_procedure",
    "start_rad",
    "travel",
]
