"""Rate of the deflection set-point in the middle of a step, from past set-points only."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, get_args

import casadi as ca

from esea_gen.language.ports import Port, Tunable, around, clip, threshold
from esea_gen.model.filters import tracking_observer
from esea_gen.model.forward import call_named

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData


Rate = Literal["observer", "extrapolated"]


class RateSource:
    tunables: tuple[Tunable, ...] = ()
    coefficients: tuple[Port, ...] = ()
    state: tuple[Port, ...] = ()
    prepare: Any = None

    def predict(self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX) -> ca.SX:
        raise NotImplementedError

    def advance(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> dict[str, ca.SX]:
        raise NotImplementedError

    def clipped(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> ca.SX:
        """Whether what is kept for the next step is clipped at its range."""
        raise NotImplementedError


class _Extrapolated(RateSource):
    # The last difference belongs to the middle of the last step; on by one step, linearly.
    def __init__(self, device: DeviceData) -> None:
        self.h = device.period_s
        high = device.file.limits.omega_rad_s.value
        self.limit = threshold(high)
        self.state = (
            around("w1_rad_s", high, "rate of the set-point in the last step"),
            around("w2_rad_s", high, "rate of the set-point in the step before"),
        )

    def predict(self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX) -> ca.SX:
        return clip(2 * s.w1_rad_s - s.w2_rad_s, -self.limit, self.limit)

    def advance(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> dict[str, ca.SX]:
        w = ca.if_else(primed, clip((theta - last) / self.h, -self.limit, self.limit), 0)
        return {"w1_rad_s": w, "w2_rad_s": ca.if_else(primed, s.w1_rad_s, 0)}

    def clipped(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> ca.SX:
        return ca.logic_and(primed, ca.fabs((theta - last) / self.h) > self.limit)


class _Observer(RateSource):
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

    def _step(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: Any
    ) -> dict[str, ca.SX]:
        values = {f"c_{p.name}": getattr(c, p.name) for p in self.coefficients}
        values |= {f"s_{p.name}": getattr(s, p.name) for p in self.state}
        values |= {"s_primed": primed, "u_theta_rad": theta}
        return call_named(self.block.labelled_step, values)

    def predict(self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX) -> ca.SX:
        return self._step(c, s, primed, 0)["y_omega_mid_rad_s"]

    def advance(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> dict[str, ca.SX]:
        results = self._step(c, s, primed, theta)
        return {p.name: results[f"next_{p.name}"] for p in self.state}

    def clipped(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> ca.SX:
        results = self._step(c, s, primed, theta)
        limit = next(p.high for p in self.state if p.name == "v_rad_s")
        fast = ca.fabs(results["label_rate_raw_rad_s"]) > limit
        return ca.logic_or(fast, results["label_memory_clipped"])


def rate_source(device: DeviceData, rate: Rate, bandwidth_Hz: float) -> RateSource:
    if rate not in get_args(Rate):
        raise ValueError(f"rate must be one of {get_args(Rate)}, got {rate!r}")
    return _Observer(device, bandwidth_Hz) if rate == "observer" else _Extrapolated(device)
