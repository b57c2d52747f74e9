"""The exit survey: first device against second, converted to spring against elastomer.

Columns of the CSV: participant, group, comfort, naturalness, control, effort; an answer is a number
from -2 to 2, or its words ("much less" ... "much more") in a language that has texts.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.errors import UserError
from esea_gen.pages import environment
from esea_gen.plotting import INK, STYLE
from esea_host.interaction.design import FIRST, SPRING, checked_group, read_rows
from esea_host.interaction.published import TABLE_6_4
from esea_host.statistics import SignedRank, holm, signed_rank
from esea_host.statistics.checks import StatisticResult
from esea_host.study.words import Words, languages, words_of

QUESTIONS = ("comfort", "naturalness", "control", "effort")
LEVELS = {"much less": -2, "less": -1, "no different": 0, "more": 1, "much more": 2}
KEYS = ("much_less", "less", "no_different", "more", "much_more")
_SYNONYMS = {"no difference": 0, "same": 0, "equal": 0}
# Two hues that people with any common colour blindness tell apart; grey for no difference.
COLOURS = ("#8c510a", "#d8b365", "#d0d4d8", "#5ab4ac", "#01665e")


@dataclass(frozen=True)
class Question:
    """Answers to one question as spring against elastomer: negative is "spring less"."""

    name: str
    answers: tuple[int, ...]
    test: SignedRank | None
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
    known = {**LEVELS, **_SYNONYMS}
    known |= {w(f"survey.{key}"): k - 2 for w in every for k, key in enumerate(KEYS)}
    if plain in known:
        return known[plain]
    try:
        level = float(plain)
    except ValueError:
        level = 99.0
    if level not in LEVELS.values():
        raise UserError(f"{where}: answer {word!r}.", f"-2 to 2, or one of {', '.join(LEVELS)}.")
    return int(level)


def survey_form(words: Words) -> str:
    """The questions as a page to print, for each participant after the second device."""
    template = environment().get_template("interaction/survey.html.j2")
    return template.render(language=words.language, words=words, levels=KEYS, questions=QUESTIONS)


def spring_against_elastomer(level: int, group: str) -> int:
    """First against second device, as spring against elastomer: group B's sign flips."""
    return level if FIRST[group] == SPRING else -level


def read_survey(path: Path) -> Survey:
    people: dict[str, str] = {}
    answers: dict[str, list[int]] = {q: [] for q in QUESTIONS}
    table, rows = read_rows(path, ("participant", "group", *QUESTIONS))
    for where, row in rows:
        who, group = row["participant"], checked_group(row["group"], where)
        if who in people or not who:
            raise UserError(
                f"{where}: participant {who!r} again, or without a code.", "One row each."
            )
        people[who] = group
        for q in QUESTIONS:
            level = answer(row[q], f"{where}, {q}")
            answers[q].append(spring_against_elastomer(level, group))
    return survey_of(people, answers, table.report())


def survey_of(people: dict[str, str], answers: dict[str, list[int]], read: str) -> Survey:
    """Tests of answers that are already in the form spring against elastomer."""
    tests = {q: signed_rank(a) if any(a) else None for q, a in answers.items()}
    adjusted = holm([1.0 if t is None else t.p for t in tests.values()])
    return Survey(
        people,
        tuple(
            Question(q, tuple(answers[q]), tests[q], float(p))
            for q, p in zip(answers, adjusted, strict=True)
        ),
        read,
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
                    dark = colour in (COLOURS[0], COLOURS[-1])
                    axes.text(
                        left + count / 2,
                        row,
                        str(count),
                        ha="center",
                        va="center",
                        color="white" if dark else INK,
                    )
                left += count
        names = [f"{q.name}  (mean {q.mean:+.1f})" for q in survey.questions]
        axes.set_yticks(rows, names)
        axes.axvline(0, color=INK, linewidth=0.8, zorder=0)
        reach = max(
            sum(q.counts) - min(sum(q.counts[:2]), sum(q.counts[3:])) for q in survey.questions
        )
        axes.set_xlim(-reach - 0.5, reach + 0.5)
        axes.set_xlabel("people: spring less   |   spring more")
        axes.xaxis.set_major_formatter(lambda x, _: f"{abs(x):g}")
        axes.grid(visible=False, axis="y")
        handles = [
            mpl.patches.Patch(color=c, label=name) for c, name in zip(COLOURS, LEVELS, strict=True)
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=5)
    return figure
