"""Texts of the windows: complete in every language, none left in the source, a study's own."""

from __future__ import annotations

import ast
import os
import re
from pathlib import Path
from string import Formatter

import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.study.folder import StudyFolder
from esea_host.study.protocol import load_protocol, parse_protocol
from esea_host.study.words import ENGLISH, TEXTS, KeyedText, keyed, languages, words_of
from esea_host.windows.study.adverse import CHOICES
from tests.conducted import EXAMPLE, TRACKING, beginning, of_tasks, opening
from tests.conftest import ROOT

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
HOST = ROOT / "host" / "esea_host"
SHOWN = [*(HOST / "windows" / "study").glob("*.py"), HOST / "study" / "conductor.py"]
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
    assert [k for k, t in texts.items() if not t or t != t.strip() or "  " in t] == [
        "operator.stop"
    ]


def test_german_is_german():
    """No English left; typographic quotes and dots; a number does not part from its unit."""
    texts = words_of("de").texts
    same = {k for k in EN if texts[k] == EN[k]} - {"scene.paused", "gauge.deg", "operator.pause"}
    assert same == set()
    for key, text in texts.items():
        assert '"' not in text and "..." not in text, key
        assert not re.search(r"\} (s|min|%|kg|m)\b", text), key
        assert not re.search(r"\b(du|dein|dich|dir)\b", text), key  # Sie


SOURCE = "\n".join(p.read_text() for p in sorted(HOST.rglob("*.py")))


def test_every_text_that_the_source_names_is_there():
    named = set(re.findall(r'keyed\(\s*"([\w.]+)"', SOURCE))
    named |= {f"scene.{k}" for k in re.findall(r'\bText\("(\w+)"', SOURCE)}
    named |= {f"event.{k}" for k in re.findall(r'TaskEvent\("(\w+)"', SOURCE)}
    tasks = re.findall(r'@register\nclass .*\n(?:    """.*"""\n\n)?    name = "(.*)"', SOURCE)
    assert len(tasks) == 10
    assert len(named) > 40
    assert {*named, *(f"task.{t}" for t in tasks)} <= EN.keys()


def test_every_text_is_named_by_the_source():
    """But board states and axes, which come from the device."""
    known = ("format", "board", "gauge")
    named = {k for k in EN if f'"{k}"' in SOURCE or f'"{k.partition(".")[2]}"' in SOURCE}
    assert {k for k in EN.keys() - named if k.partition(".")[0] not in known} == set()


def test_no_text_of_a_window_is_left_in_the_source():
    """No literal of several words in the files that draw both windows and tell of the session."""
    left = []
    for path in SHOWN:
        tree = ast.parse(path.read_text())
        documents = {
            id(node.value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                bare = re.sub(r"<[^<>]*>?|&\w+;|\w+-?\w*:\s*\S*;?", "", node.value)
                if id(node) not in documents and re.search(r"[A-Za-z]{2,},? [A-Za-z]", bare):
                    left.append(f"{path.name}, line {node.lineno}: {node.value!r}")
    assert left == []
