"""Which columns of a board's streams the live view shows of an axis."""

from __future__ import annotations

from collections.abc import Sequence

from esea_gen.model.sensing import of_axis
from esea_host.windows.feed import LiveFeed
from esea_host.windows.meanings import LimitFlag, limit_flags, mode_text
from esea_host.windows.plots import ShownSignal, signal_of

Wanted = Sequence[tuple[str, str, str]]
# Title, unit, and of each signal its column, unit and label.
PANELS = (
    (
        ("Torque", "Nm"),
        ("tau_desired_Nm", "Nm", "wanted"),
        ("tau_set_Nm", "Nm", "set"),
        ("tau_Nm", "Nm", "measured"),
    ),
    (("Deflection", "deg"), ("theta_rad", "rad", "deflection")),
    (("Joint", "deg"), ("theta_load_rad", "rad", "angle")),
    (("Motor", "Nm"), ("u_Nm", "Nm", "command")),
)
LOOP = (("theta_rad", "rad", "deflection"), ("tau_Nm", "Nm", "measured torque"))


class AxisColumns:
    """The columns of all streams, found by the axis that they are of."""

    def __init__(self, feed: LiveFeed) -> None:
        self._feed, self._device = feed, feed.device.identity.device
        self.axes, self.drives = self._device.axes, bool(self._device.laws)
        self.all = {(n, c.name): c for n, r in feed.rings.items() for c in r.layout.columns}
        self._streams: dict[str, str] = {}
        for stream, name in self.all:  # a task's inputs come before its outputs
            self._streams.setdefault(name, stream)

    def signals(self, wanted: Wanted, axis: str) -> list[ShownSignal]:
        own = [(of_axis(name, axis), unit, label) for name, unit, label in wanted]
        return [
            signal_of(self._streams[n], n, u, label) for n, u, label in own if n in self._streams
        ]

    def panels(self, axis: str) -> list[tuple[tuple[str, str], list[ShownSignal]]]:
        found = [(head, self.signals(wanted, axis)) for head, *wanted in PANELS]
        return [(head, signals) for head, signals in found if signals]

    def flags(self, axis: str) -> list[tuple[str, LimitFlag]]:
        found = limit_flags(self._device, axis)
        return [(self._streams[f.word], f) for f in found if f.word in self._streams]

    def mode(self, axis: str) -> str:
        name = of_axis("mode_held", axis)
        newest = self._feed.rings[self._streams[name]].newest() if name in self._streams else None
        return "" if newest is None else mode_text(self._device, float(newest[name]))
