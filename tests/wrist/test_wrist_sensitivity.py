"""Sensitivity of the wrist study: shifts, changed conclusions, the page."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_host.cli import app
from esea_host.people.person import PersonModel
from esea_host.wrist import sensitivity as shifted
from esea_host.wrist.analysis import TableLine, WristResult
from esea_host.wrist.sensitivity import SPANS, conclusion, effects_of


@pytest.mark.parametrize(
    ("effect", "said"),
    [(None, "none"), (0.0, "neither"), (0.49, "neither"), (0.5, "less"), (-0.5, "more")],
)
def test_a_conclusion_is_three_quarters_of_the_ranks(effect, said):
    assert conclusion(effect) == said


def answered(effect):
    lines = (
        TableLine("peak speed", "deg/s", 4, 1.0, 2.0, effect=effect),
        TableLine("same", "Hz", 4, 1.0, 1.0, note="every difference is 0"),
        TableLine("RMS speed error", "%", 4, note="one value a person: nothing to compare"),
        TableLine("nobody's", "deg", 0, note="nobody has both values"),
    )
    return WristResult(True, 4, dict.fromkeys(("7.1 validation, RU", "7.4 states"), lines), {}, {})


def test_effects_are_those_of_the_tables():
    assert effects_of(answered(-1.0)) == {
        **{"7.1 RU peak speed": -1.0, "7.1 RU same": 0.0, "7.1 RU nobody's": None},
        **{"7.4 peak speed": -1.0, "7.4 same": 0.0, "7.4 nobody's": None},
    }


def test_each_run_shifts_its_number_alone_and_the_page_tells(monkeypatch, tmp_path):
    """The people of each run as they are asked for; who hesitates longer gives another result."""
    asked = []

    def run(folder, participants, seed, jobs, model=None, protocol=None, cluster=None):
        asked.append(model)
        file = protocol.file
        copies = [b.copies for s in file.session for b in s.block if b.name == "acquisition"]
        assert (participants, file.seed, copies) == (4, 7, [1, 1])
        assert not folder.exists()
        folder.mkdir(parents=True)
        return []

    monkeypatch.setattr(shifted, "run_study", run)
    monkeypatch.setattr(
        shifted, "analyse", lambda _: answered(1.0 if asked[-1].delay_s > 0.16 else -1.0)
    )
    to, page = tmp_path / "x.json", tmp_path / "x.html"
    words = ["study", "virtual", "wrist", "--sensitivity", "--participants", "4", "--seed", "7"]
    words += ["--keep", str(tmp_path / "kept")]
    done = CliRunner().invoke(app, [*words, "--json", str(to), "--report", str(page)])
    assert done.exit_code == 0, done.output
    before = list(asked)
    again = CliRunner().invoke(app, words)
    assert (again.exit_code, asked) == (0, before)  # what is there is not run again
    usual = PersonModel()
    wanted = [replace(usual, **{x.field: end}) for x in SPANS for end in (x.low, x.high)]
    assert asked == [usual, *wanted]
    assert all(m != usual for m in wanted)
    runs = json.loads(to.read_text())["runs"]
    assert [r["end"] for r in runs if r["changed"]] == ["high"]
    assert runs[2]["changed"] == ["7.1 RU peak speed: more to less", "7.4 peak speed: more to less"]
    assert "SIMULATED" in done.output
    assert "17 of 18 runs change nothing" in done.output
    text = page.read_text()
    assert "SIMULATED" in text
    assert text.count("<svg") == 1
    assert "more to less" in text


def test_every_low_end_is_below_the_model_and_every_high_end_above():
    usual = PersonModel()
    for x in SPANS:
        low, middle, high = map(np.array, (x.low, getattr(usual, x.field), x.high))
        assert np.all(low < middle), x.name
        assert np.all(middle < high), x.name
