"""What closed-loop studies say by default: the torque's error by case, how runs ended, signals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.studies.outcome import Simulation
from esea_gen.twin.case import Case
from esea_gen.twin.judge import ENDED, desired_torque
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.off import NOTHING, off_families
from esea_gen.twin.trajectories import RATE_HZ

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_S = 10.0
SHOUTED = "unstable"  # of the ways to end, the one that is the controller's own
Panel = tuple[str, Array, Array, Array, Array]


def label(done: Simulation) -> str:
    off = f", {done.setting.off}" if done.setting.off != NOTHING else ""
    return f"{done.setting.controller}, {done.setting.plant}{off}{_more(done)}"


def _more(done: Simulation) -> str:
    axis = f", {done.setting.axis}" if done.setting.axis else ""
    return axis + (", adapted" if done.setting.adapted else "")


def to_dict(done: Simulation) -> dict[str, Any]:
    """JSON-ready: the setting, ``cases``, and percentiles by case where there are several seeds."""
    s, names = done.setting, ("controller", "plant", "off", "adapted", "axis")
    content: dict[str, Any] = {
        "experiment": done.study.name,
        "title": done.study.title,
        **{k: v for k in names if (v := getattr(s, k))},
        "person": done.person,
        "format": s.real,
        "content_hash": done.monte_carlo.configuration.parts["controller_hash"],
        "seeds": done.seeds,
        "cases": done.cases(),
        "ended_runs": len(done.ended()),
    }
    if len(done.seeds) > 1:
        content["percentiles"] = {
            n: {k: p.to_dict() for k, p in done.monte_carlo.summary({"case": n}).items()}
            for n in done.by_case()
        }
    return content


def table(done: Simulation, *, normalised: bool = False) -> list[str]:
    """A line a case, of the medians over the seeds; the thesis' measure for impedance, too."""
    s, runs = done.setting, len(done.seeds)
    off = f", off: {off_families()[s.off].meaning}" if s.off != NOTHING else ""
    heads = ["RMS true", "RMS model", "max true", "thesis", "limited"]
    lines = [
        f"{done.study.title}: {s.controller}, plant {s.plant}, person {done.person}{off}"
        f"{_more(done)}, {runs} run{'s' if runs > 1 else ''} a case",
        f"{'case':32}" + "".join(f"{h:>11}" for h in heads + ["of largest"] * normalised),
    ]
    for name, entries in done.by_case().items():
        lines += _case_lines(name, entries, normalised)
    total, ended = len(done.monte_carlo.results), len(done.ended())
    if ended:
        lines.append(
            f"{ended} of {total} runs were unstable, tripped, latched or failed; what is given "
            "of their errors includes the time after that"
        )
    every = np.array([e["rms_true_Nm"] for e in done.cases() if e["rms_true_Nm"] is not None])
    if runs > 1 and len(every):
        low, middle, high = np.percentile(every, [5, 50, 95])
        lines.append(
            f"all runs: RMS true 5 % {low:.4f}, median {middle:.4f}, 95 % {high:.4f}, mean "
            f"{every.mean():.4f}, max {every.max():.4f} Nm; medians above"
        )
    return lines


def _case_lines(name: str, entries: list[dict[str, Any]], normalised: bool) -> list[str]:
    def median(key: str) -> float:
        found = [e[key] for e in entries if e.get(key) is not None]
        return float(np.median(found)) if found else math.nan

    row = "".join(f"{median(k):>11.4f}" for k in ("rms_true_Nm", "rms_model_Nm", "max_true_Nm"))
    thesis = entries[0]["thesis_rms_Nm"]
    row += f"{thesis:>11.3f}" if thesis else f"{'-':>11}"
    row += f"{100 * median('limited_share'):>10.1f}%"
    if normalised:
        share = median("rms_normalised")
        row += f"{'-':>11}" if math.isnan(share) else f"{100 * share:>10.1f}%"
    words = {k: text.upper() if k == SHOUTED else text for k, text in ENDED.items()}
    words |= {"ran_away": "left the plant's ranges", "failure": "failed"}
    counts = [(sum(bool(e.get(k)) for e in entries), text) for k, text in words.items()]
    said = ", ".join(f"{n} {text}" for n, text in counts if n)
    reasons = dict.fromkeys(e["failure"] for e in entries if e.get("failure"))
    return [f"{name:32}{row}  {said}".rstrip(), *(f"  failed: {reason}" for reason in reasons)]


def figure(done: Simulation) -> Figure:
    """Torque in time of a few cases, RMS by case of more, percentiles over several seeds."""
    from esea_gen.analysis import plots

    if len(done.seeds) > 1:
        by_name = {n: done.monte_carlo.summary({"case": n}) for n in done.by_case()}
        rows = [(n, p["rms_true_Nm"]) for n, p in by_name.items() if "rms_true_Nm" in p]
        if not rows:
            raise UserError("No run finished: there is nothing to draw.", "See the table.")
        return plots.percentile_bars(rows)
    panels = [
        panel(done.study.case(name), run)
        for name, run in done.kept.items()
        if isinstance(run, ClosedLoopRun)
    ]
    if len(panels) == 1:
        ((name, *curves),) = panels
        return plots.torque_tracking(*curves, title=f"{name}: {label(done)}")
    if panels:
        return plots.torque_cases(panels, title=label(done))
    entries = done.cases()
    ours, thesis = (
        np.array([math.nan if e[k] is None else e[k] for e in entries])
        for k in ("rms_true_Nm", "thesis_rms_Nm")
    )
    known = thesis if np.isfinite(thesis).any() else None
    return plots.rms_by_case([e["name"] for e in entries], label(done), ours, known)


def panel(case: Case, run: ClosedLoopRun, *, whole: bool = False) -> Panel:
    """Name, time, desired, true and sensed torque of a case; the first 10 s that are judged."""
    w = case.trajectory.window
    w = slice(0, None) if whole else slice(w.start, min(w.stop, w.start + round(SHOWN_S * RATE_HZ)))
    return (
        case.name,
        run.time_s[w],
        desired_torque(case, run)[w],
        run.plant["tau_e_Nm"][w],
        run.controller["tau_Nm"][w],
    )
