"""The plots of the clinician's window: map, probabilities, and how they came."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg
from PySide6.QtCore import QRectF, Qt

from esea_host.assess.database import LocationGrid
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort, ProbingMovement
from esea_host.windows.frame import coloured
from esea_host.windows.plots import PlotPanel, legend
from esea_host.windows.theme import Theme

Floats = npt.NDArray[np.float64]
MOST_LINES, TITLE_PX = 5, 46
MARKS = ("o", "s", "t", "d", "+")


class _Plot(PlotPanel):
    # One plot in a widget of its own, with limits: upright at 90 deg, level at 0.
    def __init__(self, title: str, x: str, y: str, limits: Sequence[float] = ()) -> None:
        self.view = pg.PlotWidget()
        super().__init__(self.view.getPlotItem(), title, x, y)
        self.item.layout.setContentsMargins(1, 1, 8, 1)
        self.limits = [pg.InfiniteLine(angle=a) for a in limits]
        for line in self.limits:
            self.item.addItem(line, ignoreBounds=True)

    def show(self, theme: Theme) -> None:
        self.theme = theme
        self.view.setBackground(theme.ground)
        self.dress(theme)
        for line in self.limits:
            line.setPen(pg.mkPen(theme.limit, width=2, style=Qt.PenStyle.DashLine))

    def place_limits(self, *ends: float) -> None:
        for line, at in zip(self.limits, ends, strict=True):
            line.setValue(at)


class InformationMap(_Plot):
    """Angle x rate: expected information of a movement, limits, passed cells, the next one."""

    def __init__(self, grid: LocationGrid) -> None:
        labels = "bending of the knee [°]", "speed [°/s], + bending"
        super().__init__("Which movement would tell most", *labels, (90, 90, 0, 0))
        self._grid = grid
        self.image = pg.ImageItem()
        self.item.addItem(self.image)
        self._been = self.item.plot(pen=None, symbol="o", symbolSize=4, symbolPen=None)
        self._way, self._best = self.item.plot(), self.item.plot(pen=None, symbol="star")
        self._best.setSymbolSize(18)
        steps = np.diff(grid.angle_rad)[0] / DEG, np.diff(grid.rate_rad_s)[0] / DEG
        low = grid.angle_rad[0] / DEG - steps[0] / 2, grid.rate_rad_s[0] / DEG - steps[1] / 2
        size = steps[0] * len(grid.angle_rad), steps[1] * len(grid.rate_rad_s)
        self._place = QRectF(low[0], low[1], size[0], size[1])
        self.item.setXRange(low[0], low[0] + size[0], padding=0.02)
        self.item.setYRange(low[1], low[1] + size[1], padding=0.05)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        colours = ((28, 40, 56), (32, 120, 150), (240, 228, 66))
        if theme.name == "light":
            colours = ((247, 250, 220), (65, 160, 190), (8, 29, 88))
        self._colours = pg.ColorMap((0.0, 0.5, 1.0), colours)
        self._been.setSymbolBrush(theme.limit)
        self._way.setPen(pg.mkPen(theme.measured, width=2))
        self._best.setSymbolBrush(theme.measured)
        self._best.setSymbolPen(theme.ink)

    def draw(
        self, value: Floats, passed_deg: Floats, move: ProbingMovement, comfort: Comfort, unit: str
    ) -> None:
        shape = len(self._grid.angle_rad), len(self._grid.rate_rad_s)
        most = max(float(np.nanmax(value)), 1e-12)
        share = np.nan_to_num(value / most).reshape(shape)
        picture = self._colours.map(share, mode="byte").reshape(*shape, 4)
        picture[np.isnan(value).reshape(shape), 3] = 0
        self.image.setImage(picture, axisOrder="col-major")
        self.image.setRect(self._place)
        rate = comfort.rate_rad_s / DEG
        self.place_limits(comfort.low_rad / DEG, comfort.high_rad / DEG, -rate, rate)
        self._been.setData(passed_deg[:, 0], passed_deg[:, 1])
        angle, speed = move.at(np.linspace(0, move.duration_s, 80))
        self._way.setData(angle / DEG, speed / DEG)
        where = move.location
        self._best.setData([where.angle_rad / DEG], [where.rate_rad_s / DEG])
        strong = "yellow" if self.theme.name == "dark" else "dark"
        about = f"{strong}: most, {most:.2f} {unit}; empty: out of reach, comfort or data"
        title = f"<b>{self.title}</b> &nbsp; {coloured(about, self.theme.soft)}"
        self.item.setTitle(title, color=self.theme.ink, size="9pt")


class MovementLoop(_Plot):
    """Torque over angle of the movement under way, or of the last one, and the comfort range."""

    def __init__(self) -> None:
        super().__init__("This movement", "bending of the knee [°]", "torque [Nm]", (90, 90))
        self._curve = self.item.plot()
        self._now = self.item.plot(pen=None, symbol="o", symbolSize=9)
        self.item.setMouseEnabled(x=False, y=False)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        self._curve.setPen(pg.mkPen(theme.measured, width=2))
        self._now.setSymbolBrush(theme.ink)
        self._now.setSymbolPen(None)

    def draw(
        self, angle_deg: Floats, torque_Nm: Floats, now: tuple[float, float], comfort: Comfort
    ) -> None:
        ends = comfort.low_rad / DEG, comfort.high_rad / DEG
        self.place_limits(*ends)
        self._curve.setData(angle_deg, torque_Nm)
        self._now.setData(*([x] if np.isfinite(x) else [] for x in now))
        self.item.setXRange(ends[0] - 10, ends[1] + 10, padding=0)
        most = float(np.max(np.abs(torque_Nm), initial=15.0))
        self.item.setYRange(-most, most, padding=0.05)


class ProbabilityBars(_Plot):
    def __init__(self, names: list[str]) -> None:
        super().__init__("What is known now", "probability [%]", "")
        self._names = names
        self._bars = pg.BarGraphItem(x0=0, y=[0], height=0.7, width=[0])
        self.item.addItem(self._bars)
        self.item.setMouseEnabled(x=False, y=False)
        self.item.setXRange(0, 100, padding=0.06)
        self.item.invertY(True)
        self.item.getAxis("left").setWidth(165)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        self._bars.setOpts(brush=theme.wanted, pen=theme.wanted)

    def draw(self, probabilities: Floats) -> None:
        """Of mixtures, which are many, the likeliest are enough."""
        order = np.argsort(-probabilities, kind="stable")[:14]
        shown = np.sort(order) if len(probabilities) <= 14 else order
        rows = np.arange(len(shown))
        self._bars.setOpts(y=rows, width=100 * probabilities[shown])
        ticks = [(int(r), self._names[i]) for r, i in zip(rows, shown, strict=True)]
        self.item.getAxis("left").setTicks([ticks])
        self.item.setYRange(-0.6, len(shown) - 0.4, padding=0)


class HistoryPlot(_Plot):
    def __init__(self, names: list[str]) -> None:
        super().__init__("How it came to that", "step", "probability [%]")
        self._names = names
        self._lines = [self.item.plot(symbol=m) for m in MARKS]
        self.item.setYRange(0, 100, padding=0.04)
        self.item.setMouseEnabled(y=False)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        for line, colour in zip(self._lines, theme.curves, strict=False):
            line.setPen(pg.mkPen(colour, width=2))
            line.setSymbolBrush(colour)
            line.setSymbolPen(None)
            line.setSymbolSize(6)

    def draw(self, steps: Floats) -> None:
        """The likeliest of all steps, shape (steps, hypotheses), with their names."""
        top = np.argsort(-steps.max(axis=0), kind="stable")[:MOST_LINES]
        top = top[np.argsort(-steps[-1, top], kind="stable")]
        parts = []
        for i, line, colour in zip(top, self._lines, self.theme.curves, strict=False):
            line.setData(np.arange(len(steps)), 100 * steps[:, i])
            parts.append((self._names[i], colour))
        self.item.setXRange(0, max(5, len(steps) - 1), padding=0.03)
        names = "<br>".join(legend(parts[k : k + 3]) for k in (0, 3))
        title = f"<b>{self.title}</b><br>{names}"
        self.item.setTitle(title, color=self.theme.ink, size="8pt")
        # Three lines; a title is set to the height of one.
        self.item.titleLabel.setMaximumHeight(TITLE_PX)
        self.item.layout.setRowFixedHeight(0, TITLE_PX)
