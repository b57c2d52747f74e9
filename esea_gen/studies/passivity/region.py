"""The map over gains and hands that the pushes make."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.passivity import Hand
from esea_gen.files import plain
from esea_gen.language.ports import Array
from esea_gen.studies.passivity.push import PushRun

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Bools = npt.NDArray[np.bool_]
# Share of the push's energy that may come out before it counts.  Of the default map's runs half
# give out less than 0.01 %, nearly all others more than 3 %; docs/stability.md has what it changes.
TOLERANCE = 0.01
KINDS = {"unstable with a hand": "#efc9b0", "stable with every hand": "#cfdde8", "passive": None}


@dataclass(frozen=True)
class PushMap:
    """Energy generated over gains (p, d) and hands (h), in runs that a push started."""

    kp_Nm_rad: Array
    kd_Nms_rad: Array
    hands: tuple[Hand, ...]
    generated_J: Array  # (p, d, h), infinite where the plant ran away
    index: Array  # generated over exchanged energy
    diverging: Bools  # also where limits or drive ended the motion
    tolerance: float  # share of the push's energy
    push_J: Array  # that the push would give each hand alone, (h,)
    stopped: Bools

    @property
    def stable(self) -> Bools:
        """No hand makes it swing up, shape (p, d)."""
        return np.asarray(~np.any(self.diverging, axis=2))

    @property
    def passive(self) -> Bools:
        """No hand gets more out than the tolerance, and nothing had to stop it; shape (p, d)."""
        quiet = np.all(self.generated_J <= self.tolerance * self.push_J, axis=2)
        return np.asarray(quiet & self.stable)

    @property
    def limits_acted(self) -> Bools:
        """Limits or drive ended the motion with some hand, shape (p, d)."""
        return np.asarray(np.any(self.stopped, axis=2))

    def to_dict(self) -> dict[str, Any]:
        content = {k: v for k, v in vars(self).items() if k != "stopped"}
        derived = {k: getattr(self, k) for k in ("stable", "passive", "limits_acted")}
        found: dict[str, Any] = plain(content | derived, null=True)
        return found

    def table(self) -> list[str]:
        lines = [
            "P passive, s stable with every hand, . swings up with one, L limits or drive had to "
            "stop one",
            f"{'Kp | Kd':>10}" + "".join(f"{d:>8.3g}" for d in self.kd_Nms_rad),
        ]
        for i, kp in enumerate(self.kp_Nm_rad):
            marks = "".join(f"{self.mark(i, j):>8}" for j in range(len(self.kd_Nms_rad)))
            lines.append(f"{kp:>10.3g}{marks}")
        return lines

    def mark(self, i: int, j: int) -> str:
        if self.limits_acted[i, j]:
            return "L"
        return "P" if self.passive[i, j] else "s" if self.stable[i, j] else "."

    def figure(self, marks: Sequence[tuple[float, float]], title: str) -> Figure:
        """Where the port is passive, stable with every hand, or unstable with one; gains in use."""
        import matplotlib as mpl
        from matplotlib.colors import ListedColormap
        from matplotlib.patches import Patch
        from matplotlib.ticker import NullLocator

        from esea_gen.analysis.plots import cell_edges, finished, new_figure
        from esea_gen.plotting import BOUND, INK, MODEL, STYLE

        colours = [c or MODEL for c in KINDS.values()]
        x, y = self.kd_Nms_rad, self.kp_Nm_rad
        with mpl.rc_context(STYLE | {"axes.grid": False}):
            figure, axes = new_figure(6.4, 4.6)
            axes.pcolormesh(
                cell_edges(x),
                cell_edges(y),
                self.stable.astype(int) + self.passive,
                cmap=ListedColormap(colours),
                vmin=0,
                vmax=2,
                edgecolors="white",
                linewidth=0.4,
            )
            box = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8}
            for kp, kd in marks:
                axes.plot([kd], [kp], "o", color=INK, mfc="white", mew=1.5, ms=6, zorder=3)
                way, side = (-8, "right") if kd > 0.5 * (x[0] + x[-1]) else (8, "left")
                there: dict[str, Any] = {"xytext": (way, 4), "textcoords": "offset points"}
                axes.annotate(f"{kp:g}, {kd:g}", (kd, kp), ha=side, bbox=box, **there)
            axes.set(xlabel="damping Kd, N·m·s/rad", ylabel="stiffness Kp, N·m/rad", title=title)
            # The gains rise as squares: so the cells are equal, and those in use in no corner.
            for axis, gains in ((axes.xaxis, x), (axes.yaxis, y)):
                getattr(axes, f"set_{axis.axis_name}scale")("function", functions=(_root, _square))
                axis.set_ticks(list(gains), [f"{g:.2g}" for g in gains])
                axis.set_minor_locator(NullLocator())
            i, j = np.nonzero(self.limits_acted)
            axes.plot(x[j], y[i], "x", color=BOUND, ms=5, mew=1)
            handles = [Patch(fc=c, label=t) for c, t in zip(colours, KINDS, strict=True)]
            figure.legend(handles=handles, loc="outside lower center", ncols=3)
            return finished(figure)


def _root(x: Array) -> Array:
    return np.asarray(np.sign(x) * np.sqrt(np.abs(x)))


def _square(x: Array) -> Array:
    return np.asarray(np.sign(x) * np.square(x))


def push_map(
    kp_Nm_rad: Sequence[float] | Array,
    kd_Nms_rad: Sequence[float] | Array,
    hands: Sequence[Hand],
    runs: Mapping[tuple[float, float, str], PushRun],
    push_rad_s: float,
    tolerance: float = TOLERANCE,
) -> PushMap:
    """The map from its runs, by gains and the hand's name: every combination."""
    kp, kd = np.asarray(kp_Nm_rad, dtype=float), np.asarray(kd_Nms_rad, dtype=float)
    energy = np.array([0.5 * h.inertia_kgm2 * push_rad_s**2 for h in hands])
    shape = (len(kp), len(kd), len(hands))
    generated, index = np.zeros(shape), np.zeros(shape)
    diverging, stopped = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    for at in np.ndindex(*shape):
        i, j, h = at
        r = runs[float(kp[i]), float(kd[j]), hands[h].name]
        stopped[at] = r.stopped
        diverging[at] = r.stopped or r.swings_up(float(energy[h]))
        generated[at] = math.inf if r.ran_away else r.generated_J
        index[at] = r.generated_J / r.exchanged_J if r.exchanged_J > 0 else 0.0
    return PushMap(kp, kd, tuple(hands), generated, index, diverging, tolerance, energy, stopped)
