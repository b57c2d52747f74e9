"""What the numbers mean, in words that a physiotherapist uses."""

from __future__ import annotations

from esea_host.assess.hypotheses import NONE, disorder_of
from esea_host.assess.patients import DISORDERS, RELAXED
from esea_host.assess.session import Assessment

GRADES = {1: "very mild", 2: "mild", 3: "moderate", 4: "marked", 5: "severe"}


def long_name(name: str) -> str:
    """A category as it is said."""
    if "+" in name:
        return " with ".join(long_name(n) for n in sorted(name.split("+"), reverse=True))
    if name == RELAXED:
        return "no sign of either"
    what = disorder_of(name)
    if what is None or what[0] not in DISORDERS:
        return name
    grade = GRADES.get(round(what[1]), f"{what[1]:g}")
    return f"{grade} {DISORDERS[what[0]]}"


def strength(p: float) -> str:
    """How sure, in a word."""
    words = ((0.95, "very likely"), (0.8, "likely"), (0.5, "more likely than not"))
    return next((w for least, w in words if p >= least), "possible")


def conclusion(session: Assessment) -> list[str]:
    """What is known now, and how sure that is."""
    ranked = sorted(session.by_name().items(), key=lambda x: -x[1])
    (first, p), (second, q) = ranked[0], ranked[1]
    made = len(session.evidence)
    out = []
    if first == NONE:
        out.append(f"The leg answers like none of the known categories ({strength(p)}, {p:.0%}).")
        out.append(
            "Look for another cause: contracture, rigidity, tremor, a leg that is not relaxed."
        )
    else:
        out.append(f"Most like: {long_name(first)} ({strength(p)}, {p:.0%}).")
        out.append(f"Second: {long_name(second)} ({q:.0%}).")
    names = session.severity() if made else {}
    for what, s in names.items():
        if s["probability"] >= 0.1:
            out.append(
                f"If {DISORDERS.get(what, what)} ({s['probability']:.0%}): severity "
                f"{s['mean']:.1f} of 5, between {s['low']:g} and {s['high']:g} with 90 %."
            )
    movements = "movement" if made == 1 else "movements"
    out.append(
        f"{made} {movements} so far; the probabilities "
        + ("have stopped changing." if session.settled else "are still changing.")
    )
    if any(e.what == "clinician" for e in session.trail):
        out.append("The clinician set probabilities by hand; see the steps.")
    return out
