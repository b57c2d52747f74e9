"""What people say: the exit survey, and open comments coded by two who work separately.

Columns of the survey: participant, group, comfort, naturalness, control, effort; an answer is a
number from -2 to 2 (first device against second, converted to spring against elastomer), or its
words ("much less" ... "much more") in a language that has texts.

Columns of the comments: comment, element, coder, theme, tone.  A comment may have several themes:
one row each.  Themes and tones are words; tones: positive, negative, neutral.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.errors import UserError
from esea_gen.pages import environment
from esea_gen.plotting import INK, STYLE
from esea_gen.tables import MARK, FileTable, read_table
from esea_host import statistics
from esea_host.interaction.design import ELEMENTS, FIRST, SPRING
from esea_host.interaction.published import TABLE_6_4, TABLE_6_5
from esea_host.statistics.checks import StatisticResult
from esea_host.study.words import Words, languages, words_of

QUESTIONS = ("comfort", "naturalness", "control", "effort")
LEVELS = {"much less": -2, "less": -1, "no different": 0, "more": 1, "much more": 2}
KEYS = ("much_less", "less", "no_different", "more", "much_more")
# Two hues that people with any common colour blindness tell apart; grey for no difference.
COLOURS = ("#8c510a", "#d8b365", "#d0d4d8", "#5ab4ac", "#01665e")


def read_rows(
    path: Path, needed: Sequence[str], gone: Collection[str] = ()
) -> tuple[FileTable, list[tuple[str, dict[str, str]]]]:
    """A table of texts, and each row with its place; gone: of the first column, who withdrew."""
    table = read_table(path, needed, name=path.name)
    table = table.kept([t not in gone for t in table.texts(needed[0])], "a person who withdrew")
    if not len(table):
        raise UserError(f"{path.name}: no rows.", "Add one row per entry.")
    columns = zip(*(table.texts(n) for n in needed), strict=True)
    rows = [dict(zip(needed, cells, strict=True)) for cells in columns]
    return table, [(table.at(k), row) for k, row in enumerate(rows)]


@dataclass(frozen=True)
class Question:
    """Answers to one question as spring against elastomer: negative is "spring less"."""

    name: str
    answers: tuple[int, ...]
    test: statistics.SignedRank | None
    p_holm: float

    @property
    def counts(self) -> tuple[int, ...]:
        """People by level, from much less to much more."""
        return tuple(self.answers.count(level) for level in LEVELS.values())

    @property
    def mean(self) -> float:
        return float(np.mean(self.answers))

    @property
    def published_mean(self) -> float:
        """Of the published study's ten people (section 6.6.2.1)."""
        return TABLE_6_4[self.name]

    def to_dict(self) -> dict[str, Any]:
        return {
            "question": self.name,
            "mean": self.mean,
            "published_mean": self.published_mean,
            "median": float(np.median(self.answers)),
            "counts": dict(zip(LEVELS, self.counts, strict=True)),
            "p": 1.0 if self.test is None else self.test.p,
            "p_holm": self.p_holm,
            "test": None if self.test is None else self.test.to_dict(),
        }


@dataclass(frozen=True)
class Survey(StatisticResult):
    """All four questions of all people.  read: how the file was read, and what was left out."""

    people: dict[str, str]
    questions: tuple[Question, ...]
    read: str = ""

    def lines(self) -> list[str]:
        out = [self.read] if self.read else []
        out += [f"survey, {len(self.people)} people, spring against elastomer (-2 to 2)"]
        for q in self.questions:
            p = "all alike" if q.test is None else f"p {q.test.p:.3g}, Holm {q.p_holm:.3g}"
            zeros = 0 if q.test is None else q.test.zeros
            out.append(
                f"  {q.name:12s} mean {q.mean:+.1f} (published {q.published_mean:+.1f})"
                f"  counts {'/'.join(map(str, q.counts))}  {p}"
                f"{f', {zeros} without a difference left out' if zeros else ''}"
            )
        return out


def answer(word: str, where: str) -> int:
    plain = " ".join(word.lower().replace("_", " ").split())
    every = [words_of(language) for language in languages()]
    known = {**LEVELS, "no difference": 0, "same": 0, "equal": 0}
    known |= {w(f"survey.{key}"): k - 2 for w in every for k, key in enumerate(KEYS)}
    if plain in known:
        return known[plain]
    try:
        level = float(plain)
    except ValueError:
        level = 99.0
    if level not in LEVELS.values():
        raise UserError(f"{where}: answer {word!r}.", f"Use -2 to 2 or {', '.join(LEVELS)}.")
    return int(level)


def survey_form(words: Words) -> str:
    """The questions as a page to print, for each participant after the second device."""
    template = environment().get_template("interaction/survey.html.j2")
    return template.render(language=words.language, words=words, levels=KEYS, questions=QUESTIONS)


def read_survey(
    path: Path, gone: Collection[str] = (), groups: Mapping[str, str] | None = None
) -> Survey:
    """gone: people who have withdrawn; groups: of people in the study, as the answers must say."""
    people: dict[str, str] = {}
    answers: dict[str, list[int]] = {q: [] for q in QUESTIONS}
    table, rows = read_rows(path, ("participant", "group", *QUESTIONS), gone)
    for where, row in rows:
        who, group = row["participant"], row["group"]
        if group not in FIRST:
            fix = "Give A (spring first) or B (elastomer first)."
            raise UserError(f"{where}: group {group!r}.", fix)
        if (known := (groups or {}).get(who, group)) != group:
            raise UserError(
                f"{where}: {who} in group {group}, in the study in {known}.", "Correct the group."
            )
        if who in people or not who:
            raise UserError(
                f"{where}: participant {who!r} is repeated or empty.", "Give one row each."
            )
        people[who] = group
        for q in QUESTIONS:
            # First against second device; for group B that is elastomer against spring.
            sign = 1 if FIRST[group] == SPRING else -1
            answers[q].append(sign * answer(row[q], f"{where}, {q}"))
    tests = {q: statistics.signed_rank(a) if any(a) else None for q, a in answers.items()}
    adjusted = statistics.holm([1.0 if t is None else t.p for t in tests.values()])
    return Survey(
        people,
        tuple(
            Question(q, tuple(answers[q]), tests[q], float(p))
            for q, p in zip(answers, adjusted, strict=True)
        ),
        table.report(),
    )


def diverging_bars(survey: Survey) -> Figure:
    """People by level, to either side of no difference."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 0.5 * len(survey.questions) + 1.5), layout="constrained")
        axes = figure.add_subplot()
        rows = list(range(len(survey.questions)))[::-1]
        for row, q in zip(rows, survey.questions, strict=True):
            left = -(q.counts[0] + q.counts[1] + q.counts[2] / 2)
            for count, colour in zip(q.counts, COLOURS, strict=True):
                axes.barh(row, count, left=left, color=colour, height=0.66)
                if count:
                    ink = "white" if colour in (COLOURS[0], COLOURS[-1]) else INK
                    at = left + count / 2
                    axes.text(at, row, str(count), ha="center", va="center", color=ink)
                left += count
        names = [f"{q.name}  (mean {q.mean:+.1f})" for q in survey.questions]
        axes.set_yticks(rows, names)
        axes.axvline(0, color=INK, linewidth=0.8, zorder=0)
        reach = max(
            sum(q.counts) - min(sum(q.counts[:2]), sum(q.counts[3:])) for q in survey.questions
        )
        axes.set_xlim(-reach - 0.5, reach + 0.5)
        mark = MARK * survey.read.endswith(MARK)
        axes.set_xlabel(f"people: spring less   |   spring more{mark}")
        axes.xaxis.set_major_formatter(lambda x, _: f"{abs(x):g}")
        axes.grid(visible=False, axis="y")
        handles = [
            mpl.patches.Patch(color=c, label=name) for c, name in zip(COLOURS, LEVELS, strict=True)
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=5)
    return figure


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
    theme_agreement: dict[str, statistics.Agreement | None]
    tone_agreement: statistics.Agreement | None
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


def _said(found: statistics.Agreement | None) -> str:
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
            raise UserError(f"{where}: {comment} has the theme {theme} twice.", "Keep one row.")
        given[comment, theme] = tone
    if len(codes) != 2:
        raise UserError(f"{path.name}: coders: {len(codes)}.", "Two must code the same comments.")
    one, other = codes.values()
    missing = {c for c, _ in one} ^ {c for c, _ in other}
    if missing:
        raise UserError(
            f"{path.name}: only one coder has {', '.join(sorted(missing))}.",
            "Let both code all comments.",
        )
    themes, both = sorted({t for _, t in (*one, *other)}), sorted(one.keys() & other.keys())
    tally = Counter((w, elements[c], t, v) for w in codes for (c, t), v in codes[w].items())
    counts = {
        w: {e: {t: {v: tally[w, e, t, v] for v in TONES} for t in themes} for e in ELEMENTS}
        for w in codes
    }
    coded = {t: [[str((c, t) in x) for c in elements] for x in (one, other)] for t in themes}
    differing = {k[0] for k in one.keys() | other.keys() if one.get(k) != other.get(k)}
    first, second = codes
    return Comments(
        (first, second),
        len(elements),
        counts,
        {theme: _kappa(*pair) for theme, pair in coded.items()},
        _kappa([one[k] for k in both], [other[k] for k in both]),
        tuple(sorted(differing)),
        table.report(),
    )


def _kappa(one: list[str], other: list[str]) -> statistics.Agreement | None:
    try:
        return statistics.cohens_kappa(one, other)
    except statistics.NoStatisticError:
        return None
