"""Pictures and pages, of one assessment and of the evaluation; nothing is fetched."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.pages import environment
from esea_gen.plotting import BOUND, HELD_OUT, INK, MEASURED, MODEL, ROUNDING, STYLE, svg
from esea_host.assess import MEASURED_NOTICE
from esea_host.assess.desk import conclusion, long_name, unit_of
from esea_host.assess.patients import DEG, Array
from esea_host.assess.probing import MEASURES, Comfort, informative, next_movement
from esea_host.assess.session import Assessment, AuditEntry

COLOURS = (MODEL, MEASURED, ROUNDING, BOUND)
MOST_LINES = 5
MEANING = (
    "Spastic-like: the leg resists more the faster it is moved.  Dystonic-like: it pulls towards a "
    "posture at any speed."
)


def session_page(
    session: Assessment, who: str = "", comfort: Comfort | None = None, measure: str = MEASURES[0]
) -> Figure:
    """One page for the file; measure: by which movements were chosen."""
    limits = comfort or Comfort()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.27, 11.69))
        grid = figure.add_gridspec(
            3,
            2,
            left=0.24,
            right=0.95,
            top=0.715,
            bottom=0.05,
            hspace=0.62,
            wspace=0.3,
            height_ratios=(1, 1, 0.95),
        )
        figure.text(
            0.06, 0.955, "Knee: assessment of resistance to movement", fontsize=15, color=INK
        )
        figure.text(0.06, 0.934, dated(session, who), fontsize=10, color=INK)
        notice = session.data.notice
        figure.text(0.06, 0.911, notice, fontsize=10, color=BOUND, weight="bold")
        for i, line in enumerate([*conclusion(session), allowed(limits)]):
            figure.text(0.06, 0.881 - 0.0195 * i, line, fontsize=9.5, color=INK)
        figure.text(0.06, 0.022, MEANING, fontsize=8, color=INK)
        _bars(figure.add_subplot(grid[0, 0]), session)
        _history(figure.add_subplot(grid[0, 1]), session)
        _map(figure.add_subplot(grid[1, :]), session, limits, measure)
        _trail(figure.add_subplot(grid[2, :]), session)
    return figure


def dated(session: Assessment, who: str) -> str:
    """Whose page, of when, and from which database."""
    began, last = (session.trail[i].time[:16].replace("T", " ") for i in (0, -1))
    when = f"{began} to {last[-5:] if last[:10] == began[:10] else last} UTC" if began else ""
    parts = who, when, f"database {session.data.digest[:12]}"
    return "   ".join(p for p in parts if p)


def allowed(c: Comfort) -> str:
    return (
        f"Moved only between {c.low_rad / DEG:.0f}° and {c.high_rad / DEG:.0f}° of bending, at up "
        f"to {c.rate_rad_s / DEG:.0f}°/s."
    )


def _bars(ax: Axes, session: Assessment) -> None:
    p = session.probabilities
    # Mixtures are many: the likeliest are enough.
    shown = np.argsort(-p, kind="stable")[:12] if len(p) > 14 else np.arange(len(p))
    ax.barh(range(len(shown)), p[shown] * 100, color=MODEL)
    ax.set_yticks(range(len(shown)), [long_name(session.names[i]) for i in shown], fontsize=8.5)
    ax.invert_yaxis()
    ax.set_xlim(0, 100)
    ax.set_xlabel("probability [%]")
    ax.set_title("Probabilities now")


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
            label=long_name(session.names[i]),
        )
    ax.set_ylim(-3, 103)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set(xlabel="step", ylabel="probability [%]", title="Probability history")
    ax.legend(ncol=2, fontsize=7.5, loc="upper center", bbox_to_anchor=(0.45, -0.2))


def _map(ax: Axes, session: Assessment, comfort: Comfort, measure: str) -> None:
    grid = session.hypotheses.grid
    value = informative(session, comfort, measure)
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
    ax.figure.colorbar(drawn, ax=ax, label=f"expected information [{unit_of(measure)}]", pad=0.01)
    ax.grid(False)
    been = session.evidence.places()
    if len(been):
        ax.plot(been[:, 0] / DEG, been[:, 1] / DEG, ".", ms=3, color=BOUND, label="passed")
    move = next_movement(session, comfort, value)
    angle, rate = move.at(np.linspace(0, move.duration_s, 100))
    ax.plot(angle / DEG, rate / DEG, color=MEASURED, lw=1, label="next movement")
    best = move.location
    ax.plot(best.angle_rad / DEG, best.rate_rad_s / DEG, "*", ms=11, color=MEASURED)
    ax.legend(ncol=2, loc="upper right", bbox_to_anchor=(1.0, -0.2))
    ax.set(
        xlabel="bending of the knee [°]",
        ylabel="speed [°/s], + bending",
        title="Most informative movement: dark. White: out of reach, comfort or data",
    )


def step_text(entry: AuditEntry) -> str:
    d = entry.details
    said = {
        "begin": "begun, all equally likely",
        "measured": f"{d.get('location')}: {d.get('response_Nm', 0):.1f} Nm beyond the weight",
        "felt": f"{d.get('location')}: resistance felt as {d.get('word')}",
        "clinician": "set by the clinician: "
        + ", ".join(f"{long_name(n)} {p:.0%}" for n, p in dict(d.get("set", {})).items())
        + (f" ({d['why']})" if d.get("why") else ""),
        "skipped": "skipped" + (f": {d['why']}" if d.get("why") else ""),
        "missed": f"{d.get('location')} was not passed; not asked for again",
        "left out": f"{d.get('location')} left out by the clinician",
        "outside the map": f"{d.get('location')} is not in the database",
        "undone": "last step taken back",
    }
    return said.get(entry.what, entry.what)


def _trail(ax: Axes, session: Assessment) -> None:
    ax.axis("off")
    ax.set_title("Steps (the last ones), and the most likely after each")
    for i, entry in enumerate(session.trail[-11:]):
        best = max(entry.probabilities, key=lambda n: entry.probabilities[n])
        y, now = 0.93 - 0.09 * i, f"{long_name(best)} {entry.probabilities[best]:.0%}"
        now = now if entry.what != "begin" else ""
        text = f"{entry.number:>3}  {step_text(entry)}"[:88]
        about: dict[str, Any] = {"fontsize": 8, "transform": ax.transAxes, "color": INK}
        ax.text(-0.24, y, text, **about)
        ax.text(1, y, now, ha="right", **about)


PAGES = (".html", ".png", ".pdf")


def checked_name(path: Path) -> None:
    if path.suffix not in PAGES:
        text = f"{', '.join(PAGES[:-1])} or {PAGES[-1]}"
        raise UserError(f"{path}: its name must end in {text}.", "Give another name.")


def write_session_page(
    path: Path,
    session: Assessment,
    who: str = "",
    comfort: Comfort | None = None,
    measure: str = MEASURES[0],
) -> None:
    """One page for the file: .html, .png or .pdf."""
    checked_name(path)
    page = session_page(session, who, comfort, measure)
    if path.suffix == ".html":
        figure = svg(page, "session", "Probabilities, history, map and steps")
        title = "Knee: assessment of resistance to movement"
        lines = [dated(session, who), *conclusion(session)]
        notice = session.data.notice
        write_whole(path, _render("session", notice, title=title, lines=lines, figure=figure))
        return
    buffer = io.BytesIO()
    page.savefig(buffer, format=path.suffix[1:], dpi=150)
    write_whole(path, buffer.getvalue())


@contextmanager
def drawn(width: float, height: float) -> Iterator[tuple[Figure, Axes]]:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure, figure.add_subplot()


def confusion_picture(result: Mapping[str, Any]) -> Figure:
    counts = np.array(result["confusion"])
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    with drawn(6.4, 4.7) as (figure, ax):
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1)
        ax.grid(False)
        for (i, j), n in np.ndenumerate(counts):
            if n:
                # The map is the same by night: so are its numbers, none of the page's colours.
                colour = "#fefefe" if share[i, j] > 0.55 else "#111111"
                ax.text(j, i, f"{n:.0f}", ha="center", va="center", fontsize=8.5, color=colour)
        ax.set_xticks(range(counts.shape[1]), result["answers"], rotation=45, ha="right")
        ax.set_yticks(range(counts.shape[0]), result["categories"])
        ax.set(
            xlabel="most probable after 12 movements",
            ylabel="simulated patient",
            title="Patients by true category and answer",
        )
    return figure


def calibration_picture(result: Mapping[str, Any]) -> Figure:
    curve = {k: np.array(v) for k, v in result["calibration_curve"].items()}
    seen = curve["count"] > 0
    with drawn(4.7, 4.2) as (figure, ax):
        ax.plot([0, 100], [0, 100], color=INK, lw=0.8, ls="--", label="ideal")
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
        ax.set(
            xlabel="shown probability [%]",
            ylabel="share of right answers [%]",
            title=f"Calibration: mean distance {result['calibration_error']:.3f}",
        )
        ax.legend(loc="upper left")
    return figure


def motions_picture(result: Mapping[str, Any]) -> Figure:
    names = {
        "expected": "expected\ninformation",
        "thesis": "thesis'\nmeasure",
        "fixed": "fixed\nprotocol",
        "random": "random",
    }
    rows = [(names[w], r) for w, r in result["motions"].items()]
    mean = np.array([r["mean"] for _, r in rows])
    ends: Array = np.array([r["interval"] for _, r in rows]).T
    with drawn(4.7, 4.2) as (figure, ax):
        ax.bar(range(len(rows)), mean, color=HELD_OUT, edgecolor=MODEL)
        ax.errorbar(range(len(rows)), mean, np.abs(ends - mean), fmt="none", color=INK, capsize=4)
        ax.set_xticks(range(len(rows)), [n for n, _ in rows])
        ax.set_ylabel(f"movements to 95 % (at most {result['most_movements']})")
        ax.set_title("Movements needed")
    return figure


def loop_picture(found: Any, simulated: bool = False) -> Figure:
    with drawn(6.4, 4.2) as (figure, ax):
        for torque_Nm, colour, style, label in (
            (found.bending_Nm, MODEL, "-", "bending"),
            (found.straightening_Nm, MEASURED, "--", "straightening"),
        ):
            ax.plot(found.angle_rad / DEG, torque_Nm, color=colour, ls=style, label=label)
        ax.set_xlabel("bending of the knee [°]")
        ax.set_ylabel("torque beyond the leg's weight [Nm]")
        ax.legend()
        ax.set_title(f"{'Simulated: ' * simulated}Passive range of motion")
        figure.text(0.01, 0.005, MEASURED_NOTICE, fontsize=7, color=BOUND)
    return figure


def _render(template: str, notice: str, **context: Any) -> str:
    return environment().get_template(f"assess/{template}.html.j2").render(notice=notice, **context)


def evaluation_page(result: Mapping[str, Any]) -> str:
    def row(text: str, key: str, aim: str, form: str = "{:.2f}") -> tuple[str, str, str, str]:
        low, high = result[f"{key}_interval"]
        ends = f"{form.format(low)} to {form.format(high)}"
        return text, form.format(result[key]), ends, aim

    rows = [
        row("Movements to 95 % against random", "motions_ratio", "at most 0.5"),
        row("Movements to 95 % against a fixed protocol", "motions_ratio_fixed", ""),
        row("Calibration error", "calibration_error", "at most 0.05", "{:.3f}"),
        row("None of these, people of no category", "none_rate_outside", "at least 0.9"),
        row("None of these or no sign, patients", "none_rate_inside", "at most 0.05"),
    ]
    figures = [
        svg(confusion_picture(result), "confusion", "Simulated patients by category and answer"),
        svg(calibration_picture(result), "calibration", "Shown probability against share right"),
        svg(motions_picture(result), "motions", "Movements to 95 percent, four ways"),
    ]
    title = "Knee assessment, evaluated on simulated patients"
    context = {"title": title, "r": result, "rows": rows, "figures": figures}
    return _render("evaluation", result["notice"], **context)
