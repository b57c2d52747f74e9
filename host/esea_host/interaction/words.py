"""An analysis in words and columns, for a terminal."""

from __future__ import annotations

from esea_host.interaction.analysis import ElementComparison, InteractionAnalysis, printed


def lines(found: InteractionAnalysis) -> list[str]:
    """The whole answer."""
    out = [
        f"{found.folder}: {len(found.people)} people"
        + (", SIMULATED: no person took part" if found.simulated else "")
    ]
    if found.left_out:
        out.append(f"left out, one element missing: {', '.join(found.left_out)}")
    for c in found.comparisons:
        out += ["", *comparison_lines(c)]
    for extra in (found.survey, found.comments):
        if extra is not None:
            out += ["", *extra.lines()]
    return out


def comparison_lines(c: ElementComparison) -> list[str]:
    """One metric of one task."""
    m, d, b = c.medians, c.device, c.block
    unit = "" if c.made.unit == "1" else f" {c.made.unit}"
    out = [
        f"{c.task}, {c.metric} ({c.made.convention}; {c.made.sign})",
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
    beside = printed(c.task, c.metric)
    if beside is not None:
        ours, row = c.thesis_medians, beside["inter_device"]
        out.append(
            f"  thesis' convention: spring {ours['spring']:.4g}, elastomer "
            f"{ours['elastomer']:.4g}; published {row['first']:g}, {row['second']:g}, "
            f"p {row['p']:g}"
        )
    return out + [f"  note: {n}" for n in c.notes]
