"""An analysis in words and columns, for a terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from esea_host.interaction.analysis import ElementComparison, InteractionAnalysis, printed


def lines(found: InteractionAnalysis, names: Mapping[str, str] | None = None) -> list[str]:
    """names: of the elements in a blinded analysis; beside published values one could tell them."""
    if names:
        known = [*_ours(found), *answer_lines(found)]
        words = re.compile("|".join(map(re.escape, names)))
        return [words.sub(lambda m: names[m[0]], line) for line in known]
    return [*_ours(found), *beside_lines(found), *answer_lines(found)]


def _ours(found: InteractionAnalysis) -> list[str]:
    out = [
        f"{found.folder}: {len(found.people)} people"
        + (", SIMULATED: no person took part" if found.simulated else "")
    ]
    out += found.read
    if found.left_out:
        out.append(f"left out, one element missing or withdrawn: {', '.join(found.left_out)}")
    for c in found.comparisons:
        out += ["", *comparison_lines(c, found.simulated)]
    for extra in (found.survey, found.comments):
        if extra is not None:
            out += ["", *extra.lines()]
    return out


def beside_lines(found: InteractionAnalysis) -> list[str]:
    """Tables 6.2 and 6.3: medians and p, ours and the published ones."""
    ours = "SIMULATED" if found.simulated else "here"
    out = []
    for title, key, names in (
        ("6.2", "inter_block", ("block_1", "block_2")),
        ("6.3", "inter_device", ("spring", "elastomer")),
    ):
        first, second = (n.replace("_", " ") for n in names)
        out += [
            "",
            f"Table {title}, {first} and {second}, medians in the thesis' convention",
            f"  {'':27s}{ours:>26s}{'published':>26s}",
        ]
        for c in found.comparisons:
            row = printed(c.task, c.metric)
            if row is not None:
                a, b = (c.thesis_medians[n] for n in names)
                p = (c.block if key == "inter_block" else c.device).p
                there = row[key]
                out.append(
                    f"  {c.task + ', ' + c.metric:27s}{a:9.4g}{b:9.4g}{p:8.2g}"
                    f"{there['first']:9.4g}{there['second']:9.4g}{there['p']:8.2g}"
                )
    return out


def answer_lines(found: InteractionAnalysis) -> list[str]:
    """How large a difference so many people could have shown."""
    first = found.comparisons[0]
    whose = "SIMULATED people" if found.simulated else "people"
    out = [
        "",
        f"How large a difference could {first.power.n} {whose} have shown, with 80 % power?",
        f"  {'':27s}{'one test':>11s}{'of ' + str(len(found.comparisons)):>11s}"
        f"{'of a median of':>16s}   unit",
    ]
    for c in found.comparisons:
        sizes = [c.power.difference, c.family_power.difference]
        said = "".join(f"{x:11.3g}" if math.isfinite(x) else f"{'none':>11s}" for x in sizes)
        out.append(
            f"  {c.task + ', ' + c.metric:27s}{said}{c.medians['spring']:16.4g}   {c.made.unit}"
        )
    if math.isfinite(first.power.dz):
        family = f"{first.family_power.dz:.2f}" if math.isfinite(first.family_power.dz) else "no"
        out.append(
            f"  {first.power.dz:.2f} standard deviations of the differences in one test, {family} "
            "in the family at the first step of Holm's procedure; a smaller one less often."
        )
    return out


def comparison_lines(c: ElementComparison, simulated: bool) -> list[str]:
    m, d, b = c.medians, c.device, c.block
    unit = "" if c.made.unit == "1" else f" {c.made.unit}"
    out = [
        f"{c.task}, {c.metric} ({c.made.convention}; {c.made.sign})"
        + (", SIMULATED" if simulated else ""),
        f"  spring {m['spring']:.4g}, elastomer {m['elastomer']:.4g}{unit};  p {d.p:.3g} "
        f"({d.method}), Holm {c.device_holm:.3g}",
        f"  difference {d.hodges_lehmann:.3g} ({d.low:.3g} to {d.high:.3g}, {d.confidence:.1%}), "
        f"rank-biserial {d.rank_biserial:.2f} ({d.rank_biserial_low:.2f} to "
        f"{d.rank_biserial_high:.2f})",
        f"  block 1 {m['block_1']:.4g}, block 2 {m['block_2']:.4g};  p {b.p:.3g}, Holm "
        f"{c.block_holm:.3g}",
    ]
    if c.crossover is not None:
        x = c.crossover
        out.append(
            f"  cross-over: element {x.treatment.estimate:.3g} (p {x.treatment.p:.3g}), period "
            f"{x.period.estimate:.3g} (p {x.period.p:.3g}), carry-over {x.carry_over.estimate:.3g} "
            f"(p {x.carry_over.p:.3g})"
        )
    if c.mixed is not None:
        out.append(f"  mixed model: element {c.mixed.treatment:.3g} +- {c.mixed.treatment_se:.2g}")
    out.append(
        f"  belief: spring above elastomer {c.bayes.probability_positive:.0%}, within 0.2 sd of "
        f"none {c.bayes.probability_equivalent:.0%}, "
        f"evidence for none {c.bayes.bayes_factor_01:.2g}"
    )
    out.append(f"  {c.power.sentence(unit.strip())}")
    out.append(f"  whole family: {c.family_power.sentence(unit.strip())}")
    out.append(
        f"  over {c.band.settings} settings: spring {c.band.spring[0]:.4g} to "
        f"{c.band.spring[1]:.4g}, elastomer {c.band.elastomer[0]:.4g} to "
        f"{c.band.elastomer[1]:.4g}, p {c.band.p[0]:.3g} to {c.band.p[1]:.3g}"
    )
    return out + [f"  note: {n}" for n in c.notes]
