"""Open comments by theme and tone, coded by two people who do not see each other's codes.

Columns of the CSV: comment, element, coder, theme, tone.  A comment may have several themes: one
row each.  Themes and tones are words; tones: positive, negative, neutral.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_host.interaction.design import ELEMENTS, read_rows
from esea_host.interaction.published import TABLE_6_5
from esea_host.statistics import Agreement, NoStatisticError, cohens_kappa
from esea_host.statistics.checks import StatisticResult

TONES = ("positive", "negative", "neutral")


@dataclass(frozen=True)
class Comments(StatisticResult):
    """Counts by element, theme and tone, and how far the two coders agree.

    theme_agreement: Cohen's kappa of each theme, given or not, over all comments; tone_agreement:
    over comments and themes that both gave.  None where chance explains all agreement.
    disagreed: comments that the coders have to talk about.
    read: how the file was read, and what was left out.
    """

    coders: tuple[str, str]
    comments: int
    counts: dict[str, dict[str, dict[str, dict[str, int]]]]
    theme_agreement: dict[str, Agreement | None]
    tone_agreement: Agreement | None
    disagreed: tuple[str, ...]
    read: str = ""

    def to_dict(self) -> dict[str, Any]:
        return super().to_dict() | {"published": published_counts()}

    def lines(self) -> list[str]:
        out = [self.read] if self.read else []
        out += [f"{self.comments} comments, coded by {' and '.join(self.coders)}"]
        for theme, found in self.theme_agreement.items():
            out.append(f"  {theme:18s} kappa {_said(found)}")
        out.append(f"  {'tone':18s} kappa {_said(self.tone_agreement)}")
        out.append(
            "positive/negative/neutral by theme, spring and elastomer; published, table 6.5:"
        )
        for coder, counts in self.counts.items():
            out.append(f"  {coder}")
            out += _counted(counts)
        out += ["  published", *_counted(published_counts())]
        if self.disagreed:
            out.append(f"  to talk about: {', '.join(self.disagreed)}")
        return out


def published_counts() -> dict[str, dict[str, dict[str, int]]]:
    """Table 6.5 as this module counts: by element, theme and tone."""
    return {
        element: {t: dict(zip(TONES, row[k], strict=True)) for t, row in TABLE_6_5.items()}
        for k, element in enumerate(ELEMENTS)
    }


def _counted(counts: dict[str, dict[str, dict[str, int]]]) -> list[str]:
    themes = counts[ELEMENTS[0]]
    return [
        f"    {theme:18s} "
        + "   ".join("/".join(str(n) for n in counts[e][theme].values()) for e in ELEMENTS)
        for theme in themes
    ]


def _said(found: Agreement | None) -> str:
    if found is None:
        return "none: both give one code only"
    return f"{found.kappa:.2f} ({found.low:.2f} to {found.high:.2f}), {found.n} items"


def read_comments(path: Path) -> Comments:
    codes: dict[str, dict[tuple[str, str], str]] = {}
    elements: dict[str, str] = {}
    table, rows = read_rows(path, ("comment", "element", "coder", "theme", "tone"))
    for where, row in rows:
        comment, element, theme, tone = (row[k] for k in ("comment", "element", "theme", "tone"))
        if not (comment and row["coder"]):
            raise UserError(f"{where}: comment or coder without a name.", "Name both.")
        if element not in ELEMENTS or tone not in TONES or not theme:
            raise UserError(
                f"{where}: element {element!r}, theme {theme!r}, tone {tone!r}.",
                f"Elements: {', '.join(ELEMENTS)}.  Tones: {', '.join(TONES)}.",
            )
        if elements.setdefault(comment, element) != element:
            raise UserError(
                f"{where}: comment {comment} is about two elements.", "Split it in two."
            )
        given = codes.setdefault(row["coder"], {})
        if (comment, theme) in given:
            raise UserError(f"{where}: {comment} has the theme {theme} twice.", "Once a coder.")
        given[comment, theme] = tone
    if len(codes) != 2:
        raise UserError(f"{path.name}: {len(codes)} coders.", "Two, who code the same comments.")
    one, other = codes.values()
    missing = {c for c, _ in one} ^ {c for c, _ in other}
    if missing:
        raise UserError(
            f"{path.name}: only one coder has {', '.join(sorted(missing))}.",
            "Both code all of them.",
        )
    return replace(_compared((*codes,), one, other, elements), read=table.report())


def _compared(
    coders: tuple[str, ...],
    one: dict[tuple[str, str], str],
    other: dict[tuple[str, str], str],
    elements: dict[str, str],
) -> Comments:
    themes = sorted({theme for _, theme in (*one, *other)})
    both = sorted(one.keys() & other.keys())
    counts = {
        coder: {
            element: {
                theme: {
                    tone: sum(
                        elements[c] == element and (t, v) == (theme, tone)
                        for (c, t), v in given.items()
                    )
                    for tone in TONES
                }
                for theme in themes
            }
            for element in ELEMENTS
        }
        for coder, given in zip(coders, (one, other), strict=True)
    }
    differing = {c for c, _ in one.keys() ^ other.keys()} | {
        c for c, t in both if one[c, t] != other[c, t]
    }
    return Comments(
        (coders[0], coders[1]),
        len(elements),
        counts,
        {
            theme: _kappa(
                [str((c, theme) in one) for c in elements],
                [str((c, theme) in other) for c in elements],
            )
            for theme in themes
        },
        _kappa([one[k] for k in both], [other[k] for k in both]),
        tuple(sorted(differing)),
    )


def _kappa(one: list[str], other: list[str]) -> Agreement | None:
    try:
        return cohens_kappa(one, other)
    except NoStatisticError:
        return None
