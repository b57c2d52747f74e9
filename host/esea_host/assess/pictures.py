"""Pictures: the page of one assessment, and the pictures of the evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from esea_gen.plotting import BOUND, HELD_OUT, INK, MEASURED, MODEL, ROUNDING, STYLE
from esea_host.assess import NOTICE
from esea_host.assess.patients import DEG, Array
from esea_host.assess.probing import informative, next_movement
from esea_host.assess.session import Assessment
from esea_host.assess.words import conclusion, long_name

COLOURS = (MODEL, MEASURED, ROUNDING, BOUND)
MOST_LINES = 5


def session_page(session: Assessment, who: str = "") -> Figure:
    """One page for the file."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.27, 11.0))
        grid = figure.add_gridspec(
            3,
            2,
            left=0.16,
            right=0.95,
            top=0.715,
            bottom=0.07,
            hspace=0.62,
            wspace=0.5,
            height_ratios=(1, 1, 0.9),
        )
        figure.text(
            0.08, 0.955, "Knee: assessment of resistance to movement", fontsize=15, color=INK
        )
        figure.text(0.08, 0.932, who, fontsize=10, color=INK)
        figure.text(0.08, 0.908, NOTICE, fontsize=10, color=BOUND, weight="bold")
        for i, line in enumerate(conclusion(session)):
            figure.text(0.08, 0.875 - 0.021 * i, line, fontsize=9.5, color=INK)
        _bars(figure.add_subplot(grid[0, 0]), session)
        _history(figure.add_subplot(grid[0, 1]), session)
        _map(figure.add_subplot(grid[1, :]), session)
        _trail(figure.add_subplot(grid[2, :]), session)
    return figure


def _bars(ax: Axes, session: Assessment) -> None:
    p = session.probabilities
    # Mixtures are many: the likeliest are enough.
    shown = np.argsort(-p, kind="stable")[:12] if len(p) > 14 else np.arange(len(p))
    ax.barh(range(len(shown)), p[shown] * 100, color=MODEL)
    ax.set_yticks(range(len(shown)), [session.names[i] for i in shown])
    ax.invert_yaxis()
    ax.set_xlim(0, 100)
    ax.set_xlabel("probability [%]")
    ax.set_title("What is known now")


def _history(ax: Axes, session: Assessment) -> None:
    steps = np.array([list(e.probabilities.values()) for e in session.trail])
    top = np.argsort(-steps.max(axis=0), kind="stable")[:MOST_LINES]
    marks = ("o", "s", "^", "D", "v")
    for n, i in enumerate(sorted(top, key=lambda i: -steps[-1, i])):
        ax.plot(
            steps[:, i] * 100,
            marker=marks[n],
            ms=3.5,
            lw=1.2,
            color=(*COLOURS, INK)[n],
            label=session.names[i],
        )
    ax.set_ylim(-3, 103)
    ax.set_xlabel("step")
    ax.set_ylabel("probability [%]")
    ax.set_title("How it came to that")
    ax.legend(ncol=3, fontsize=7.5, loc="upper center", bbox_to_anchor=(0.42, -0.24))


def _map(ax: Axes, session: Assessment) -> None:
    grid = session.hypotheses.grid
    value = np.where(session.hypotheses.known, informative(session), np.nan)
    shape = len(grid.angle_rad), len(grid.rate_rad_s)
    drawn = ax.pcolormesh(
        grid.angle_rad / DEG,
        grid.rate_rad_s / DEG,
        value.reshape(shape).T,
        cmap="YlGnBu",
        vmin=0,
        shading="nearest",
        rasterized=True,
    )
    ax.figure.colorbar(drawn, ax=ax, label="expected information [nats]", pad=0.01)
    ax.grid(False)
    been = session.evidence.places()
    if len(been):
        ax.plot(been[:, 0] / DEG, been[:, 1] / DEG, "o", mfc="none", mec=BOUND, label="measured")
    best = next_movement(session).location
    ax.plot(best.angle_rad / DEG, best.rate_rad_s / DEG, "*", ms=11, color=MEASURED, label="next")
    ax.legend(ncol=2, loc="upper right", bbox_to_anchor=(1.0, -0.13))
    ax.set_xlabel("bending of the knee [°]")
    ax.set_ylabel("speed [°/s], + bending")
    ax.set_title("Where the next movement would tell most (dark); white: not in the data base")


def _trail(ax: Axes, session: Assessment) -> None:
    ax.axis("off")
    ax.set_title("Steps (the last ones)")
    for i, entry in enumerate(session.trail[-11:]):
        best = max(entry.probabilities, key=lambda n: entry.probabilities[n])
        details = "  ".join(
            f"{v:.1f} Nm" if k == "response_Nm" else f"{v}"
            for k, v in entry.details.items()
            if k not in ("data", "summary") and v != ""
        )
        text = f"{entry.number:>3}  {entry.what}: {details}"[:92]
        ax.text(0, 0.93 - 0.09 * i, text, fontsize=8, transform=ax.transAxes, color=INK)
        ax.text(
            1,
            0.93 - 0.09 * i,
            f"{long_name(best)} {entry.probabilities[best]:.0%}",
            fontsize=8,
            transform=ax.transAxes,
            ha="right",
            color=INK,
        )


def confusion_picture(result: Mapping[str, Any]) -> Figure:
    """Truth against what was said."""
    counts = np.array(result["confusion"])
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.7), layout="constrained")
        ax = figure.add_subplot()
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1)
        ax.grid(False)
        for (i, j), n in np.ndenumerate(counts):
            if n:
                ax.text(
                    j,
                    i,
                    f"{n:.0f}",
                    ha="center",
                    va="center",
                    fontsize=8.5,
                    color="white" if share[i, j] > 0.55 else INK,
                )
        ax.set_xticks(range(counts.shape[1]), result["answers"], rotation=45, ha="right")
        ax.set_yticks(range(counts.shape[0]), result["categories"])
        ax.set_xlabel("most probable after 12 movements")
        ax.set_ylabel("simulated patient")
        ax.set_title("Patients by what they have and what is said of them")
    return figure


def calibration_picture(result: Mapping[str, Any]) -> Figure:
    """Confidence against how often it was right."""
    curve = {k: np.array(v) for k, v in result["calibration_curve"].items()}
    seen = curve["count"] > 0
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.7, 4.2), layout="constrained")
        ax = figure.add_subplot()
        ax.plot([0, 100], [0, 100], color=INK, lw=0.8, ls="--", label="as it should be")
        size = 12 + 160 * curve["count"][seen] / curve["count"].max()
        ax.scatter(
            100 * curve["confidence"][seen],
            100 * curve["right"][seen],
            s=size,
            color=MODEL,
            alpha=0.8,
            label="answers (area: how many)",
            zorder=3,
        )
        ax.set_xlim(0, 102)
        ax.set_ylim(0, 102)
        ax.set_xlabel("probability that was shown [%]")
        ax.set_ylabel("how often it was right [%]")
        ax.set_title(f"Calibration: mean distance {result['calibration_error']:.3f}")
        ax.legend(loc="upper left")
    return figure


def motions_picture(result: Mapping[str, Any]) -> Figure:
    """Movements to 95 %."""
    names = {
        "expected": "expected\ninformation",
        "thesis": "thesis'\nmeasure",
        "fixed": "fixed\nprotocol",
        "random": "random",
    }
    rows = [(names[w], r) for w, r in result["motions"].items()]
    mean = np.array([r["mean"] for _, r in rows])
    ends: Array = np.array([r["interval"] for _, r in rows]).T
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.7, 4.2), layout="constrained")
        ax = figure.add_subplot()
        ax.bar(range(len(rows)), mean, color=HELD_OUT, edgecolor=MODEL)
        ax.errorbar(range(len(rows)), mean, np.abs(ends - mean), fmt="none", color=INK, capsize=4)
        ax.set_xticks(range(len(rows)), [n for n, _ in rows])
        ax.set_ylabel(f"movements to 95 % (at most {result['most_movements']})")
        ax.set_title("How many movements it takes")
    return figure


def loop_picture(found: Any) -> Figure:
    """Torque over angle, both ways."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        ax = figure.add_subplot()
        ax.plot(found.angle_rad / DEG, found.bending_Nm, color=MODEL, label="bending")
        ax.plot(
            found.angle_rad / DEG,
            found.straightening_Nm,
            color=MEASURED,
            ls="--",
            label="straightening",
        )
        ax.set_xlabel("bending of the knee [°]")
        ax.set_ylabel("torque beyond the leg's weight [Nm]")
        ax.legend()
        ax.set_title("Passive range of motion")
        figure.text(0.01, 0.005, NOTICE, fontsize=7, color=BOUND)
    return figure
