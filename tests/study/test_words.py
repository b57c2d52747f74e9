"""Texts of the windows: complete in every language, and a study's own."""

from __future__ import annotations

import json
import re
from pathlib import Path
from string import Formatter

import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_gen.trust import TaskCode
from esea_host.cli import app
from esea_host.study.folder import StudyFolder
from esea_host.study.protocol import load_protocol, parse_protocol
from esea_host.study.words import ENGLISH, KeyedText, keyed, languages, words_of
from tests.conducted import EXAMPLE, TRACKING, of_tasks, opening, until
from tests.conftest import ROOT

HOST = ROOT / "host" / "esea_host"
EN = words_of(ENGLISH).texts


def places(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name is not None}


# -- what is shipped -------------------------------------------------------------------------------


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_language_has_the_same_texts_with_the_same_places(language):
    assert languages() == ["de", "en"]
    texts = words_of(language).texts
    assert texts.keys() == EN.keys()
    assert [k for k in EN if places(texts[k]) != places(EN[k])] == []
    assert [k for k, t in texts.items() if not t or t != t.strip() or "  " in t] == []


def test_german_is_german():
    """No English left; typographic quotes and dots; a number does not part from its unit."""
    texts = words_of("de").texts
    same = {k for k in EN if texts[k] == EN[k]} - {"scene.paused", "gauge.deg", "operator.pause"}
    assert same == set()
    for key, text in texts.items():
        assert not re.search(r'"|\.\.\.', text), key
        assert not re.search(r"\} (s|min|%|kg|m)\b", text), key
        assert not re.search(r"\b(du|dein|dich|dir)\b", text), key  # Sie


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_participant_reads_no_word_of_the_operators(language):
    words = (
        r"(?i)\b(board|motor|arm|torque|trial|block|fault|limit|link|drehmoment|durchgang|grenze)"
    )
    seen = {
        k: t for k, t in words_of(language).texts.items() if k.startswith(("scene.", "banner."))
    }
    assert {k for k, t in seen.items() if re.search(words, t)} == set()


SURVEY = ROOT / "templates" / "interaction" / "survey.html.j2"
SOURCE = "\n".join(p.read_text() for p in (*sorted(HOST.rglob("*.py")), SURVEY))


def test_every_text_that_the_source_names_is_there():
    named = set(re.findall(r'keyed\(\s*"([\w.]+)"', SOURCE))
    named |= {f"scene.{k}" for k in re.findall(r'\bText\("(\w+)"', SOURCE)}
    named |= {f"event.{k}" for k in re.findall(r'TaskEvent\("(\w+)"', SOURCE)}
    tasks = re.findall(r'@register\nclass .*\n(?:    """.*"""\n\n)?    name = "(.*)"', SOURCE)
    assert len(tasks) == 10
    assert len(named) > 40
    assert {*named, *(f"task.{t}" for t in tasks)} <= EN.keys()


# -- a language of one's own -----------------------------------------------------------------------


def in_toml(texts: dict[str, str]) -> str:
    """As a file: a table for each text."""
    lines = []
    for key, text in texts.items():
        table, _, name = key.partition(".")
        lines.append(f"[{table}]\n" if f"[{table}]\n" not in lines else "")
        lines.append(f'"{name}" = {json.dumps(text, ensure_ascii=False)}\n')
    return "".join(lines)


def wrapped(texts) -> dict[str, str]:
    """Every text in a language that nobody speaks: in brackets."""
    return {k: t if k.startswith("format.") else f"⟦{t}⟧" for k, t in texts.items()}


def study_with(folder: Path, language: str, name: str, texts: str) -> Path:
    """A protocol beside a file of texts."""
    folder.mkdir(exist_ok=True)
    asked = f'language = "{language}"\ntexts = ["{name}"]\n[conditions.near]'
    text = EXAMPLE.read_text().replace("[conditions.near]", asked)
    (folder / "steady_hold.py").write_bytes((EXAMPLE.parent / "steady_hold.py").read_bytes())
    (folder / name).write_text(texts)
    (folder / "hold.toml").write_text(text)
    return folder / "hold.toml"


def test_a_study_may_say_it_in_its_own_words(tmp_path):
    own = '[scene]\nreach = "Halten Sie den Griff."\nmine = "Noch {left}."\n'
    protocol = load_protocol(study_with(tmp_path, "de", "hold.de.toml", own))
    study = StudyFolder.create(tmp_path / "s", protocol, simulated=True)
    assert study.content_at_first().keys() == {
        "protocol.toml",
        "tasks/steady_hold.py",
        "texts/hold.de.toml",
    }
    again = StudyFolder.open(tmp_path / "s").protocol.words()
    assert again.language == "de"
    assert again.scene("reach", {}) == "Halten Sie den Griff."
    assert again.scene("mine", {"left": 2.5}) == "Noch 2,5."
    assert again("operator.close") == "Schließen"
    assert protocol.words("en").scene("reach", {}) == "Catch the green target."
    assert study.problems() == []
    (tmp_path / "s" / "texts" / "hold.de.toml").write_text('[scene]\nreach = "Los!"\n')
    assert StudyFolder.open(tmp_path / "s").problems() == [
        "texts/hold.de.toml: changed since the study was created"
    ]


def test_texts_that_the_operator_alone_reads_are_english_where_a_language_lacks_them(tmp_path):
    """Files that were complete for an earlier version go on."""
    since = {"operator.escape_closed", "operator.is_over", "operator.needs_reason"}
    older = in_toml({k: t for k, t in wrapped(EN).items() if k not in since})
    file = study_with(tmp_path, "fr", "hold.fr.toml", older)
    with pytest.warns(UserWarning, match="3 texts .* shown in English"):
        words = load_protocol(file).words()
    assert words("operator.is_over") == "session is over"
    assert words("operator.close") == "⟦Close⟧"


@pytest.mark.parametrize(
    ("language", "texts", "told"),
    [
        ("de", '[operator]\nclos = "Zu"\n', "no text 'operator.clos'. Did you mean"),
        ("de", '[scene]\nrest = "Pause"\n', "scene.rest has nothing in braces. Put seconds there"),
        ("de", '[scene]\nmine = "{x.__class__}"\n', "is not a place"),
        ("de", '[scene]\nmine = "{x:>99999999}"\n', "is not a place"),
        ("de", '[scene]\nmine = "{x"\n', "expected '}'"),
        ("de", 'reach = "Los!"\n', "reach is not text"),
        ("de", "[scene]\nreach = 5\n", "scene.reach is not text"),
        ("fr", '[scene]\nreach = "Allez !"\n', "texts of the language 'fr' are missing"),
        ("it", '[scene]\nreach = "Allez !"\n', "no texts in the language 'it'"),
    ],
)
def test_wrong_texts_are_refused_before_a_study_is_made(tmp_path, language, texts, told):
    name = "hold.fr.toml" if language == "fr" else "hold.de.toml"
    file = study_with(tmp_path, language, name, texts)
    with pytest.raises(UserError, match=re.escape(told)):
        load_protocol(file)


def test_a_keyed_text_is_english_in_the_record_and_what_it_holds_is_translated_too():
    said = keyed("happened.trial_ended_why", number=3, state=keyed("state.failed"), reason="Krampf")
    assert said == "trial 3 failed: Krampf"
    assert words_of("de").of(said) == "Durchgang 3 misslungen: Krampf"
    assert words_of("de").of("failed") == "failed"
    assert isinstance(said, KeyedText)


def test_nothing_in_the_operators_window_is_of_another_language(begin, qtbot):
    """In a language of brackets, nothing is outside of brackets but what the protocol says."""
    from PySide6.QtGui import QAction
    from PySide6.QtWidgets import QAbstractButton, QComboBox, QLabel, QLineEdit, QListWidget

    texts = in_toml(wrapped(EN)).encode()
    made = TaskCode(Path("all.xx.toml"), texts, "")
    given = of_tasks(f"rest_s = 5\n{TRACKING}", TRACKING)
    protocol = parse_protocol(given.text, given.origin, texts=[made])
    conductor = begin(protocol, at=[(1, 0.3), (2, 0.5)])
    conductor.arrive()
    _, operator = opening(qtbot)(conductor, language="xx")
    operator.written.setText("Wadenkrampf")
    operator.note()
    operator.repeat_block()
    operator.adverse.open()
    operator.adverse.record()
    operator.stop()
    conductor.go.set()
    until(lambda: conductor.over)
    operator.refresh()
    seen = [operator.windowTitle(), *(a.text() for a in operator.findChildren(QAction))]
    seen += [w.text() for kind in (QLabel, QAbstractButton) for w in operator.findChildren(kind)]
    bar = operator.bar  # the state's text goes on beside it
    for label in (bar.state, bar.words):
        seen.remove(label.text())
    seen.append(f"{bar.state.text()}: {bar.words.text()}")
    seen += [w.placeholderText() for w in operator.findChildren(QLineEdit)]
    for box in operator.findChildren(QComboBox):
        seen += [box.itemText(k) for k in range(box.count())]
    for events in operator.findChildren(QListWidget):
        seen += [events.item(k).text() for k in range(events.count())]
    table = operator.trials
    for k in range(1, table.columnCount()):
        seen.append(table.horizontalHeaderItem(k).text())
        for r in range(table.rowCount()):
            seen += [table.item(r, k).text(), table.item(r, k).toolTip()]
    assert len(seen) > 100
    names = "P01|calibration|interaction.tracking|tracking|esea-host|Wadenkrampf"
    left = []
    for text in seen:
        rest = re.sub(r"<[^<>]*>|&nbsp;", "", text)
        while (less := re.sub(r"⟦[^⟦⟧]*⟧", "", rest)) != rest:
            rest = less
        left += [text] if re.search("[A-Za-z]{2}", re.sub(names, "", rest)) else []
    assert left == []


def test_the_survey_is_asked_and_answered_in_german(tmp_path):
    from esea_host.interaction.survey import answer

    folder, page = tmp_path / "s", tmp_path / "fragen.html"
    StudyFolder.create(folder, of_tasks(TRACKING), simulated=True)
    call = ["study", "survey", str(folder), str(page), "--language", "de"]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0, done.output
    text = page.read_text()
    assert '<html lang="de">' in text
    for words in ("Mit dem ersten Gerät war es …", "gut zu steuern", "viel weniger"):
        assert words in text
    assert [answer(w, "") for w in ("Viel weniger", "nicht anders", "much more")] == [-2, 0, 2]
