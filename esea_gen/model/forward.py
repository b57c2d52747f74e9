"""Call the torque sensor's kernel on symbols, for both inverses."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Labels
from esea_gen.language.ports import Port, around, threshold
from esea_gen.model.elastomer import torque_sensor

# A request may be this many times the torque limit and still be clamped instead of refused.
REQUEST_ROOM = 10.0


def call_named(function: ca.Function, values: Mapping[str, Any]) -> dict[str, ca.SX]:
    results = function.call([ca.SX(values[name]) for name in function.name_in()])
    return dict(zip(function.name_out(), results, strict=True))


def name_values(block: Block, prefix: str, values: Mapping[str, ca.SX], label: Labels) -> None:
    """Give the labelled values of a called step their names in the Block that calls it."""
    for name, comment in block.labels:
        label(f"{prefix}_{name}", values[f"label_{name}"], comment)


class Forward:
    """The sensor Block's kernel, called on symbols: the one place where the model comes in."""

    def __init__(self, device: DeviceData) -> None:
        self.block = torque_sensor(device)
        names = {p.name for p in self.block.state}
        self.state = self.block.state
        self.tau_r_high = next(p.high for p in self.block.state if p.name == "tau_r_Nm")
        self.has_rate = "x" in {n for n, _ in self.block.labels}
        if names != {"primed", "theta_prev_rad", "tau_r_Nm", "play_rad"}:
            raise ValueError(f"the sensor's state {sorted(names)} is not what its inverse knows")

    def step(self, state: Mapping[str, Any], theta: Any, omega: Any) -> dict[str, ca.SX]:
        """Next state (``next_...``), outputs (``y_...``) and labelled values (``label_...``)."""
        values = {f"s_{k}": v for k, v in state.items()}
        values |= {"u_theta_rad": theta, "u_omega_rad_s": omega}
        return call_named(self.block.labelled_step, values)

    def clipped(self, end: Mapping[str, ca.SX]) -> ca.SX:
        """Whether a step clipped the Maxwell element's torque."""
        return ca.fabs(end["label_tau_r_raw_Nm"]) > self.tau_r_high

    def of(self, s: SimpleNamespace) -> dict[str, Any]:
        return {p.name: getattr(s, p.name) for p in self.state}


def request_port(tau_lim: float) -> Port:
    room = REQUEST_ROOM * tau_lim
    return around("tau_Nm", room, "desired interaction torque", on_invalid=0.0)


def rate_facts(
    device: DeviceData, values: Mapping[str, Any], rate: str
) -> dict[str, tuple[float, float]]:
    # share(x) = s / (1 + x s), s = 1 + x/2 + x^2/6, is at most 1 and falls, its derivative having
    # the sign of s' - s^2 < 0; x is largest at the largest rate and no deflection.
    omega = threshold(device.file.limits.omega_rad_s.value)
    drag = values["B"] * omega ** values["n"] + values["eps2"]
    x = device.period_s * values["kv_Nm_rad"] * drag / values["eps1_Nms_rad"]
    s = 1 + x * (0.5 + x / 6)
    return {rate: (-omega, omega), "rate_share": (s / (1 + x * s) * (1 - 1e-6), 1.0)}


def rate_split(forward: Forward, rate: str) -> dict[str, tuple[float, ...]]:
    # As the sensor, whose viscosity spans orders of magnitude; but its rate is no input here.
    own = dict(forward.block.split)
    if forward.has_rate:
        own[rate] = own.pop("u_omega_rad_s")
    return own
