"""Amplitude over frequency, of what the time plots show."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_host.windows.history import Floats, Stretch
from esea_host.windows.plots import Shown, ShownSignal, SignalPlot
from esea_host.windows.theme import Theme

MOST_ROWS, LEAST_ROWS, LEAST_PX = 8192, 64, 230


def amplitudes(stretch: Stretch, values: Floats) -> tuple[Floats, Floats]:
    """Frequencies in Hz and the amplitude of the sine at each, of the newest rows without a gap."""
    holes = np.flatnonzero(stretch.after_gap)
    first = int(holes[-1]) if len(holes) else 0
    y, time_s = values[first:], stretch.time_s[first:]
    if len(y) < LEAST_ROWS or not np.isfinite(y).all():
        return np.zeros(0), np.zeros(0)
    # Welch's estimate with a Hann window: a sine of amplitude a shows as a, whatever the window.
    fs_Hz = (len(y) - 1) / (time_s[-1] - time_s[0])
    f_Hz, power = scipy.signal.welch(y, fs_Hz, "hann", min(len(y), MOST_ROWS), scaling="spectrum")
    return f_Hz[1:], np.sqrt(2 * power[1:])


class SpectrumPlot(SignalPlot):
    """Spectra of some signals, both axes logarithmic."""

    LOWEST_WIDTH, CURVE = 1.0, {}

    def __init__(self, area: Any, row: int) -> None:
        super().__init__(area.addPlot(row=row, col=0), "Spectrum", "Hz")
        self.item.setLogMode(x=True, y=True)
        self.item.setVisible(False)
        self._layout, self._row = area.ci.layout, row

    def toggle(self) -> None:
        on = not self.item.isVisible()
        self.item.setVisible(on)
        self._layout.setRowMinimumHeight(self._row, LEAST_PX if on else 0)

    def show(self, signals: list[ShownSignal], theme: Theme, colours: list[str]) -> None:
        self.left = f"amplitude [{', '.join(sorted({s.unit for s in signals}))}]"
        super().show(signals, theme, colours)

    def draw(self, shown: Shown) -> None:
        for signal, drawn in zip(self.signals, self.curves, strict=True):
            f_Hz, size = amplitudes(shown[signal.stream], signal.values(shown))
            drawn.setData(f_Hz, np.maximum(size, 1e-12))
