"""Check of copied gains against the values that they were designed for.

A gain equal to a shipped device's, source included, is that device's: extended, copied, or from a
controller.  If rate, stiffness or inertia differ, a warning reports it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.devices.fields import LAW_SECTIONS

Document = Mapping[str, Any]
NEAR = 0.1  # share by which what a gain was designed for may differ and nothing is said
BANDWIDTH_NEAR = 1.5  # factor by which a bandwidth may differ from the suited one, likewise
LOOP = (
    "timing.control_rate_Hz",
    "elastomer.k1_Nm_rad",
    "elastomer.k3_Nm_rad3",
    "actuator.J_kgm2",
    "actuator.tau_c_s",
)
OBSERVER_GAINS = ("gain_theta", "gain_omega_1_s", "gain_tau_Nm_rad", "gain_rate_Nm_s_rad")


@dataclass(frozen=True)
class Designed:
    """Gains of a section, their design values, and the check whether they suit this device."""

    section: str
    gains: tuple[str, ...]
    for_numbers: tuple[str, ...]
    command: str = ""


RATIO = "actuator.gear_ratio"
# What of a rotor's is felt at the joint, by the power of the ratio with which it goes.
REFLECTED = {"J_kgm2": 2, "fv_Nms_rad": 2, "fc_Nm": 1}
DESIGNED = (
    Designed("actuator", tuple(REFLECTED), (RATIO,)),
    Designed("disturbance", OBSERVER_GAINS, ("timing.sense_rate_Hz", "joint.Jh_kgm2")),
    Designed("sliding_mode", ("lambda_1_s", "phi_rad_s"), LOOP, "tune"),
    Designed("predictive", ("interval_s", "Q", "R"), LOOP, "simulate tuning"),
    Designed(
        "passivity", ("damping_Nms_rad", "Kp_max_Nm_rad", "Kd_max_Nms_rad"), LOOP, "passivity"
    ),
)


def tell_of_gains(origin: str, device: Document, shipped: Mapping[str, Document], by: str) -> None:
    """Warn of gains that were designed for other numbers than the device's; by: its controllers."""
    stem, plant = origin.removesuffix(".toml"), ("actuator", "elastomer", "joint")
    own_file = any(device.get(s) != shipped.get(stem, {}).get(s) for s in plant)
    name = f"{by}@" * bool(by) + (origin if own_file else stem)  # as commands take it
    laws = device.get("laws", LAW_SECTIONS)  # one of a file may use any section
    idle = () if ".py:" in str(laws) else LAW_SECTIONS.keys() - set(laws)
    for group in (g for g in DESIGNED if g.section not in idle):
        told: dict[tuple[str, tuple[str, ...]], list[str]] = {}  # by device, numbers that differ
        for gain in group.gains:
            own = _entry(device, group.section, gain)
            bases = [k for k, d in shipped.items() if _from(own, _entry(d, group.section, gain))]
            others = {
                k: tuple(n for n in group.for_numbers if _differs(device, shipped[k], n))
                for k in bases
            }
            if others and all(others.values()):
                nearest = min(others, key=lambda k: len(others[k]))
                told.setdefault((nearest, others[nearest]), []).append(gain)
        for (base, numbers), gains in told.items():
            said = _said(name, device, (base, shipped[base]), group, gains, numbers)
            warnings.warn(f"{origin}: {said}", stacklevel=2)


def suited_bandwidth_Hz(bits: float) -> float:
    """Bandwidth of the velocity estimate that suits an encoder of so many bits."""
    suited = min(15.0 * 2 ** ((bits - 14) / 5), 100.0)
    return float(round(suited, 0 if suited > 20 else 1))


def tell_of_bandwidth(origin: str, device: Document, shipped: Mapping[str, Document]) -> None:
    """Warn of a velocity estimate's bandwidth that is a shipped device's, of another encoder."""
    own = _entry(device, "velocity", "bandwidth_Hz")
    if not any(_from(own, _entry(d, "velocity", "bandwidth_Hz")) for d in shipped.values()):
        return
    bits = _number(device, "encoder.resolution_bits")
    suited = suited_bandwidth_Hz(bits)
    if not 1 / BANDWIDTH_NEAR <= suited / own["value"] <= BANDWIDTH_NEAR:
        warnings.warn(
            f"{origin}: velocity: bandwidth_Hz = {own['value']:g} is a shipped device's, designed "
            f"for encoders of 12 and 14 bits; for {bits:g} bits {suited:g} Hz suits (esea-gen "
            "reproduce chain). To end this warning, give your value in the file, with its "
            "source.",
            stacklevel=2,
        )


def _entry(document: Document, section: str, key: str) -> Any:
    return document.get(section, {}).get(key)


def _from(own: Any, other: Any) -> bool:
    # What `esea-gen new` copies has a source that ends in the other's.
    if not own or not other:
        return False
    return bool(own["value"] == other["value"]) and own["source"].endswith(other["source"])


def _number(document: Document, dotted: str) -> float:
    entry = _entry(document, *dotted.split("."))
    return float(entry["value"]) if entry else math.nan


def _differs(device: Document, base: Document, dotted: str) -> bool:
    there = _number(base, dotted)
    # What either has not is another number.
    return not abs(_number(device, dotted) - there) <= NEAR * abs(there)


def _said(
    name: str,
    device: Document,
    base: tuple[str, Document],
    group: Designed,
    gains: Sequence[str],
    numbers: Sequence[str],
) -> str:
    other, document = base
    stated = ", ".join(f"{g} = {_number(device, f'{group.section}.{g}'):g}" for g in gains)
    others = ", ".join(
        f"{n} = {_number(document, n):g} (here {_number(device, n):g})" for n in numbers
    ).replace("nan", "none")
    if group.command:
        fix = f"See what they give here: esea-gen {group.command} --controller {name}"
    elif group.section == "actuator":
        ratio = _number(device, RATIO) / _number(document, RATIO)
        same = {g: _number(device, f"actuator.{g}") * ratio ** REFLECTED[g] for g in gains}
        fix = "The same motor behind this gear: " + ", ".join(
            f"{g} = {v:.3g}" for g, v in same.items()
        )
    else:
        scaled = observer_gains(document, device)
        fix = "The same poles in time: " + ", ".join(
            f"{g} = {v:.4g}" for g, v in zip(OBSERVER_GAINS, scaled, strict=True)
        )
    return (
        f"{group.section}: {stated} are {other}'s, designed for {others}. {fix}. "
        "To end this warning, give your value in the file, with its source."
    )


def observer_gains(base: Document, device: Document) -> tuple[float, ...]:
    """Gains that give a device's extended-state observer the poles in time of another one's."""
    gains = np.array([_number(base, f"disturbance.{g}") for g in OBSERVER_GAINS])
    model, h = _observer_model(base)
    poles = np.linalg.eigvals(model - np.outer(gains, model[0])).astype(complex)
    model, step = _observer_model(device)
    wanted = np.real(np.poly(poles ** (step / h)))
    seen = np.array([np.linalg.matrix_power(model, n)[0] for n in range(4)])
    placed: Any = np.zeros((4, 4))
    for c in wanted:
        placed = placed @ model + c * np.eye(4)
    # Of the predictor's gain, A K, to the corrector's.
    last = np.linalg.solve(seen, [0.0, 0.0, 0.0, 1.0])
    return tuple(float(x) for x in np.linalg.solve(model, placed @ last))


def _observer_model(document: Document) -> tuple[Any, float]:
    h = 1.0 / _number(document, "timing.sense_rate_Hz")
    inertia, decay = _number(document, "joint.Jh_kgm2"), _number(document, "disturbance.decay_s")
    return observer_model(h, inertia, decay), h


def observer_model(h: float, inertia: float, decay: float) -> Any:
    """Angle, rate, torque and rate of the torque, one period on."""
    keep = math.exp(-h / decay)
    model = np.eye(4)
    model[0, 1:3] = h, h * h / (2 * inertia)
    model[1, 2] = h / inertia
    model[2, 3], model[3, 3] = decay * (1 - keep), keep
    return model
