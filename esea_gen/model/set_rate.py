"""Rate of the deflection set-point in the middle of a step, from past set-points only."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Labels
from esea_gen.model.filters import tracking_observer
from esea_gen.model.forward import call_named, name_values


class SetRate:
    # The velocity Block itself, on the set-point; its mid-step rate needs past samples only.
    def __init__(self, device: DeviceData, bandwidth_Hz: float) -> None:
        block = self.block = tracking_observer(device)
        (tunable,) = block.tunables
        source = "docs/inverse.md: a set-point has no encoder noise, the fastest follows best"
        default = min(bandwidth_Hz, tunable.high)
        self.tunables = (replace(tunable, default=default, source=source, status="assumed"),)
        self.coefficients = block.coefficients
        self.state = tuple(p for p in block.state if p.name != "primed")

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        results = self.block.prepare.call([getattr(t, x.name) for x in self.tunables])
        return dict(zip((p.name for p in self.coefficients), results, strict=True))

    def _step(self, c: Any, s: Any, primed: ca.SX, theta: Any) -> dict[str, ca.SX]:
        values = {f"c_{p.name}": getattr(c, p.name) for p in self.coefficients}
        values |= {f"s_{p.name}": getattr(s, p.name) for p in self.state}
        values |= {"s_primed": primed, "u_theta_rad": theta}
        return call_named(self.block.labelled_step, values)

    def predict(self, c: Any, s: Any, primed: ca.SX) -> ca.SX:
        return self._step(c, s, primed, 0)["y_omega_mid_rad_s"]

    def advance(
        self, c: Any, s: Any, primed: ca.SX, theta: ca.SX, label: Labels
    ) -> dict[str, ca.SX]:
        results = self._step(c, s, primed, theta)
        name_values(self.block, "observer", results, label)
        return {p.name: results[f"next_{p.name}"] for p in self.state}

    def clipped(self, c: Any, s: Any, primed: ca.SX, theta: ca.SX) -> ca.SX:
        """Whether the stored value for the next step is clipped at its range."""
        results = self._step(c, s, primed, theta)
        limit = next(p.high for p in self.state if p.name == "v_rad_s")
        fast = ca.fabs(results["label_rate_raw_rad_s"]) > limit
        return ca.logic_or(fast, results["label_memory_clipped"])
