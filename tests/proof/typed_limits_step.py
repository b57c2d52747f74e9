"""A step of the limits whose numbers are typed, instead of computed by the emitted C."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from ..limits_model import FLAGS
from .limits_numbers import WIDE, Number
from .limits_step import Step
from .smt import whole

KEY = 5592405.5
NAN, INF = float("nan"), float("inf")
TINY = 2.0**-149


def up(x: float) -> float:
    return float(np.nextafter(np.float32(x), np.float32(np.inf)))


def down(x: float) -> float:
    return float(np.nextafter(np.float32(x), np.float32(-np.inf)))


# The largest float32 not above the device file's numbers; of a negative one the same, turned.
U, STEP, THETA = 0.22099998593330383, 0.04999999701976776, 0.29999998211860657
# A drive that runs in mode 1; its limits are narrowed to numbers without rounding.
RUNNING: dict[str, Any] = {
    "coef": {
        **{"u_max_Nm": 0.125, "tau_max_Nm": 4, "theta_max_rad": 0.25, "omega_max_rad_s": 8},
        **{"rom_min_rad": 0, "rom_max_rad": 2, "trip_low_rad": -0.125, "trip_high_rad": 2.125},
        **{"energy_max_J": 10, "u_step_Nm": 0.03125, "rom_gain_Nm_rad": 1, "brake_rad_s": 4},
        "speed_gain_Nms_rad": 1,
    },
    "before": {
        **{"key": KEY, "fault_stored": 0, "fault_mirror": 0, "rearm_last": 3, "rearm_mirror": -3},
        **{"u_last_Nm": 0.0625, "u_mirror_Nm": -0.0625, "beat_last": 7, "age": 2, "ticks": 5},
        "slot_J": 0.5,
        **{f"slots_J[{i}]": (i + 1) / 16 for i in range(10)},
    },
    "given": {
        **{"u_command_Nm": 0.1, "control_beat": 8, "mode": 1, "stop": 0, "rearm": 3},
        **{"request_ok": 1, "sensing_ok": 1, "clock_ok": 1, "coeffs_ok": 1, "late_level": 3},
        **{"theta_rad": 0.0625, "theta_motor_rad": 1.0625, "theta_load_rad": 1, "tau_Nm": 1},
        **{"omega_motor_rad_s": -0.5, "omega_load_rad_s": 1},
    },
    "after": {
        **{"key": KEY, "fault_stored": 0, "fault_mirror": 0, "rearm_last": 3, "rearm_mirror": -3},
        **{"u_last_Nm": 0.078125, "u_mirror_Nm": -0.078125, "beat_last": 8, "age": 0, "ticks": 6},
        "slot_J": 0.5,
        **{f"slots_J[{i}]": (i + 1) / 16 for i in range(10)},
    },
    "out": {"u_Nm": 0.078125, "u_cut_Nm": 0, "u_lag_Nm": 0, "energy_J": 1, "fault": 0},
}
CLOSED = {"key": 0, "fault_stored": 9, "fault_mirror": -9, "u_last_Nm": 0, "u_mirror_Nm": 0}
CUT = {
    **{f"after.{k}": v for k, v in CLOSED.items()},
    **{"out.u_Nm": 0, "out.fault": 9, "shown": ("FAULT_LATCHED",)},
}
WAS_CLOSED = {f"before.{k}": v for k, v in CLOSED.items()}
RELEASED = {
    **WAS_CLOSED,
    **{"given.mode": 0, "given.u_command_Nm": 0, "given.rearm": 4, "out.u_Nm": 0},
    **{"after.u_last_Nm": 0, "after.u_mirror_Nm": 0, "after.rearm_last": 4},
    "after.rearm_mirror": -4,
}
INITIAL = {
    **{"key": 0, "fault_stored": 1, "fault_mirror": -1, "rearm_last": -1, "rearm_mirror": 1},
    **dict.fromkeys(("u_last_Nm", "u_mirror_Nm", "beat_last", "ticks", "slot_J"), 0),
    "age": 25,  # no stamp has come for as long as is borne
    **{f"slots_J[{i}]": 0 for i in range(10)},
}
# No narrowing: the device file's own limits act.
WIDE_OPEN = {
    **{f"coef.{n}": 99 for n in ("tau_max_Nm", "theta_max_rad", "omega_max_rad_s")},
    **{"coef.trip_low_rad": -99, "coef.trip_high_rad": 99, "coef.energy_max_J": 99},
    "coef.u_step_Nm": 1,
}


class Told(Step):
    """A step whose numbers are typed instead of computed by the C."""

    def __init__(
        self, block: Any, limit: Any, changes: dict[str, Any], fraction: int | None = None
    ) -> None:
        self.block, self.limit, self.fraction = block, limit, fraction
        self.groups = {group: dict(values) for group, values in RUNNING.items()}
        self.shown: tuple[str, ...] = changes.get("shown", ())
        self.counted = changes.get("counters", [(3, 3), (0, 1)])
        for place, value in changes.items():
            group, dot, name = place.partition(".")
            if dot:
                assert name in self.groups[group]
                self.groups[group][name] = value

    def number(self, value: float) -> Number:
        if self.fraction is not None:
            raw = Fraction(value) * 2**self.fraction
            return Number(whole(raw.numerator // raw.denominator, WIDE), self.fraction)
        word = f"{int(np.float32(value).view(np.uint32)):032b}"
        return Number(f"(fp #b{word[0]} #b{word[1:9]} #b{word[9:]})", None)

    def _number(self, group: str, name: str, index: int | None, term: str | None) -> Number:
        values = self.groups[group]
        return self.number(values[name if name in values else f"{name}[{index or 0}]"])

    def coef(self, name: str) -> Number:
        return self._number("coef", name, None, None)

    def given(self, name: str) -> Number:
        return self._number("given", name, None, None)

    def before(self, name: str, index: int | None = None) -> Number:
        return self._number("before", name, index, None)

    def after(self, name: str, index: int | None = None) -> Number:
        return self._number("after", name, index, None)

    def out(self, name: str) -> Number:
        return self._number("out", name, None, None)

    def flag(self, name: str) -> str:
        assert name in FLAGS
        return "true" if name in self.shown else "false"

    @property
    def counters(self) -> list[tuple[str, str]]:
        return [(whole(a, 32), whole(b, 32)) for a, b in self.counted]

    @property
    def initial(self) -> list[tuple[Number, Number]]:
        return [(self._number("before", n, None, None), self.number(v)) for n, v in INITIAL.items()]
