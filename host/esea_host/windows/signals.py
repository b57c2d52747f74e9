"""The signals of the live view by axis: those plotted, those shown large.  No window needed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from esea_gen.model.sensing import of_axis
from esea_host.windows.feed import Floats, LiveFeed, Stretch
from esea_host.windows.meanings import LimitFlag, limit_flags, mode_text

DEG = 180 / math.pi
DASH = "\u2013"  # for a number that is unknown or not valid
LIT_S = 0.3  # an indicator stays lit so long that it is seen
Shown = Mapping[str, Stretch]
# What is shown large, of which plot; degrees with one place, torque with two.
READOUTS = {"Torque": "torque [Nm]", "Joint": "angle [deg]", "Motor": "command [Nm]"}
# Besides, of devices that tell it: caption and scale.
NUMBERS = {"winding_C": ("winding [\u00b0C]", 1.0), "capacity": ("torque left [%]", 100.0)}
# Of a plot its title, unit and limits, then of each signal its column, unit and label.
PANELS = (
    (
        ("Torque", "Nm", "-tau_max_Nm", "tau_max_Nm"),
        ("tau_desired_Nm", "Nm", "wanted"),
        ("tau_set_Nm", "Nm", "set"),
        ("tau_Nm", "Nm", "measured"),
    ),
    (("Deflection", "deg", "-theta_max_rad", "theta_max_rad"), ("theta_rad", "rad", "deflection")),
    (("Joint", "deg", "rom_min_rad", "rom_max_rad"), ("theta_load_rad", "rad", "angle")),
    (("Motor", "Nm", "-u_max_Nm", "u_max_Nm"), ("u_Nm", "Nm", "command")),
)
Head = tuple[str, str, str, str]


@dataclass(frozen=True)
class ShownSignal:
    """A column of a stream; scale: from the column's unit to the shown one."""

    stream: str
    column: str
    label: str
    unit: str
    scale: float = 1.0

    @property
    def name(self) -> str:
        return f"{self.stream}.{self.column}"

    def values(self, shown: Shown) -> Floats:
        return np.asarray(shown[self.stream].rows[self.column], np.float64) * self.scale


def signal_of(stream: str, column: str, unit: str, label: str = "") -> ShownSignal:
    """A signal; angles in degrees."""
    if unit.startswith("rad"):
        name = (label or column).replace("_rad", "_deg")
        return ShownSignal(stream, column, name, unit.replace("rad", "deg", 1), DEG)
    return ShownSignal(stream, column, label or column, "" if unit == "1" else unit)


class AxisColumns:
    def __init__(self, feed: LiveFeed) -> None:
        self._feed, self._device = feed, feed.device.identity.device
        self.axes, self.drives = self._device.axes, bool(self._device.laws)
        self.all = {(n, c.name): c for n, r in feed.rings.items() for c in r.layout.columns}
        self._streams: dict[str, str] = {}
        for stream, name in self.all:  # a task's inputs come before its outputs
            self._streams.setdefault(name, stream)

    def signals(self, wanted: Sequence[tuple[str, str, str]], axis: str) -> list[ShownSignal]:
        """Those of an axis that the device has."""
        own = [(of_axis(name, axis), unit, label) for name, unit, label in wanted]
        return [signal_of(self._streams[n], n, u, of) for n, u, of in own if n in self._streams]

    def limits(self, head: Head, axis: str) -> tuple[float, float]:
        """Limits of a plot in its unit, as last reported by the board; NaN before."""
        found = []
        for name in head[2:]:
            sign, own = (-1.0, name[1:]) if name[0] == "-" else (1.0, name)
            instance = f"limits_{axis}" if axis else "limits"
            value = self._feed.values.get(f"{instance}.{own}", math.nan)
            found.append(sign * value * (DEG if head[1] == "deg" else 1.0))
        return found[0], found[1]

    def panels(self, axis: str) -> list[tuple[Head, list[ShownSignal]]]:
        """The head of each plot that has signals, and these."""
        found = [(head, self.signals(wanted, axis)) for head, *wanted in PANELS]
        return [(head, signals) for head, signals in found if signals]

    def known(self, head: Head) -> bool:
        """Whether the newest values of a plot are to be relied on."""
        return not (self._feed.silent or (self._feed.unzeroed and head[0] != "Motor"))

    def readouts(self, axis: str, newest: Shown) -> Iterator[tuple[str, str]]:
        """Large readouts: caption and number; a dash if unknown."""

        def last(signal: ShownSignal, places: int, scale: float = 1.0) -> str:
            values = signal.values(newest)
            known = len(values) and not self._feed.silent and math.isfinite(values[-1])
            return f"{scale * values[-1]:.{places}f}" if known else DASH

        for head, signals in self.panels(axis):
            if head[0] in READOUTS:
                number = last(signals[-1], 1 if head[1] == "deg" else 2)
                yield READOUTS[head[0]], number if self.known(head) else DASH
        for name, (caption, scale) in NUMBERS.items():
            for signal in self.signals([(name, "", "")], axis):
                yield caption, last(signal, 0, scale)

    def flags(self, axis: str) -> list[tuple[str, LimitFlag]]:
        """Possible flags of an axis, each with its stream."""
        found = limit_flags(self._device, axis)
        return [(self._streams[f.word], f) for f in found if f.word in self._streams]

    def mode(self, axis: str) -> str:
        """The mode in force, in words; empty where there is none."""
        name = of_axis("mode_held", axis)
        newest = self._feed.rings[self._streams[name]].newest() if name in self._streams else None
        return "" if newest is None else mode_text(float(newest[name]))
