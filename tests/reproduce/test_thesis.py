"""The thesis, recomputed: nothing is left out, a verdict follows its numbers, a row its command."""

from __future__ import annotations

import dataclasses
import json
import math
import re

import pytest
import typer
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.reproduce import thesis
from esea_gen.reproduce.measures import Measures

ITEMS, MISPRINTS = thesis.published()
# Counted in the thesis: figures and tables of a chapter.
FIGURES = {3: 11, 4: 7, 5: 10, 6: 2, 7: 13, 8: 9}
TABLES = {3: 7, 4: 5, 5: 1, 6: 5, 7: 4, 8: 3}


@pytest.fixture(scope="module")
def quiet():
    return Measures(lambda _: None)


def test_no_table_and_no_figure_is_left_out():
    wanted = {f"Figure {c}.{i}" for c, n in FIGURES.items() for i in range(1, n + 1)}
    wanted |= {f"Table {c}.{i}" for c, n in TABLES.items() for i in range(1, n + 1)}
    assert {p.id for p in ITEMS if not p.id.startswith("Text ")} == wanted
    assert len({p.id for p in ITEMS}) == len(ITEMS)
    assert [p.chapter for p in ITEMS] == sorted(p.chapter for p in ITEMS)


def test_every_row_has_what_its_kind_needs():
    for p in ITEMS:
        assert p.kind in ("numbers", "inputs", "claims", *thesis.WORDS), p.id
        if p.kind in ("numbers", "inputs", "claims"):
            assert p.published, p.id
            assert p.measure, p.id
            assert p.command, p.id
        if p.kind == "claims":  # where it is printed, and the words
            assert re.match(r"\d\.\d(\.\d)*: .*'.{20,}'", p.says), p.id
        if p.kind in ("data", "people"):
            assert p.because, p.id
        if p.kind == "people" or p.chapter == 5:
            assert p.simulated or not p.measure, p.id
        if p.measure and not p.measure.startswith("host."):
            assert callable(getattr(Measures, p.measure)), p.id
    for m in MISPRINTS:
        assert not m.measure or callable(getattr(Measures, m.measure)), m.place


def test_the_command_behind_each_row_is_there():
    """By the commands themselves: each word up to the first argument, and each option."""
    from esea_host.cli import app as host

    tools = {"esea-gen": typer.main.get_command(app), "esea-host": typer.main.get_command(host)}
    for p in ITEMS:
        if not p.command:
            continue
        tool, *words = p.command.split()
        command = tools[tool]
        while words and hasattr(command, "commands"):
            name = words.pop(0)
            assert name in command.commands, p.command
            command = command.commands[name]
        known = {o for parameter in command.params for o in parameter.opts}
        assert {w for w in words if w.startswith("--")} <= known, p.command


NUMBER = thesis.Printed("Table 9.1", "", "numbers", within=0.05, published={"a": 2.0, "b": 0.0})


@pytest.mark.parametrize(
    ("changed", "ours", "verdict"),
    [
        ({}, {"a": 2.09, "b": 0.0}, thesis.REPRODUCED),
        ({}, {"a": 2.11, "b": 0.0}, thesis.UNEXPLAINED),
        ({}, {"a": 2.0, "b": 1e-9}, thesis.UNEXPLAINED),
        ({"because": "x", "most": 0.1}, {"a": 2.11, "b": 0.0}, thesis.DIFFERS),
        ({"because": "x", "most": 0.1}, {"a": 2.21, "b": 0.0}, thesis.UNEXPLAINED),
        ({"because": "x", "most": 0.1}, {"a": math.nan, "b": 0.0}, thesis.UNEXPLAINED),
        ({"kind": "inputs", "within": 0.0}, {"a": 2.0, "b": 0.0}, thesis.TAKEN),
        ({"kind": "inputs", "within": 0.0}, {"a": 2.0 + 1e-15, "b": 0.0}, thesis.UNEXPLAINED),
        ({"kind": "claims"}, {"a": 2, "b": 0}, thesis.REPRODUCED),
        ({"kind": "claims"}, {"a": 1, "b": 0}, thesis.UNEXPLAINED),
        ({"kind": "claims", "because": "x"}, {"a": 1, "b": 0}, thesis.UNEXPLAINED),
        ({"kind": "claims", "because": "x", "least": 1}, {"a": 1, "b": 0}, thesis.DIFFERS),
        ({"kind": "claims", "because": "x", "least": 1}, {"a": 0, "b": 0}, thesis.UNEXPLAINED),
    ],
)
def test_a_verdict_follows_its_numbers(changed, ours, verdict):
    """Armed: a reason explains no more than it says, and nothing but a number is reproduced."""
    assert thesis.judge_printed(dataclasses.replace(NUMBER, **changed), ours).verdict == verdict


def test_what_no_code_can_know_is_never_called_reproduced():
    for p in ITEMS:
        if p.kind in thesis.WORDS:
            told = thesis.judge_printed(p, dict(p.published)).verdict
            assert thesis.REPRODUCED not in told.split(), p.id


def test_numbers_that_follow_from_what_is_printed(quiet):
    """Against numbers worked out by hand, and an independent recomputation."""
    minutes = quiet("session_minutes")
    # 5 exercises of 20 cycles at 0.2, 0.5, 0.75 Hz, and 5 of 10 cycles at 0.2 Hz.
    assert minutes["60 % active"] == pytest.approx((5 * (100 + 40 + 20 / 0.75) + 5 * 50) / 60)
    assert minutes["80 % rest"] == pytest.approx(27 * 12 / 60)
    assert quiet("cubic_root")["root at 4.5 Nm / rad"] == pytest.approx(0.2175, abs=5e-5)
    gains = quiet("filter_b_gain")
    assert gains["sum of the coefficients"] == pytest.approx(1.028)
    assert gains["gain at 50 Hz"] == pytest.approx(0.55 / 1.028, rel=0.01)
    assert gains["gain at 160 Hz"] == pytest.approx(0.89 / 1.028, rel=0.01)
    assert quiet("knee_swapped") == {
        "knee_printed": pytest.approx(0.04, abs=0.005),
        "knee": pytest.approx(0.24, abs=0.005),
    }
    assert quiet("knee_speed")["as amplitude / deg/s"] == pytest.approx(245, abs=0.1)


def line(metric, unit, first, second):
    from esea_host.wrist.analysis import TableLine

    return dataclasses.asdict(TableLine(metric, unit, 10, first, second))


@pytest.fixture
def host_files(tmp_path):
    """What the host's commands write, cut down: from its own types where it has them."""
    from esea_host.wrist.analysis import TABLES

    tables = {t: [line(c.metric, c.unit, 1.0, 2.0) for c in s.lines] for t, s in TABLES.items()}
    for t, study in TABLES.items():
        if study.rms is not None:
            tables[t].append(line("RMS speed error of the peak", "%", None, 30.0))
    wrist = {
        "simulated": True,
        "participants": 10,
        "tables": tables,
        "sides": {t: study.sides for t, study in TABLES.items()},
    }
    medians = {"spring": 5.0, "elastomer": 6.0, "block_1": 7.0, "block_2": 8.0}
    both = {
        "simulated": True,
        "people": ["P01"] * 10,
        "comparisons": [
            {"task": t, "metric": m, "thesis_medians": medians}
            for t in ("tracking", "pong")
            for m in ("RMS acceleration", "VDV", "LDLJ", "SPARC")
        ],
    }
    ways = ("expected", "thesis", "random")
    assess = {
        "patients": {"inside": 10},
        "motions": {w: {"mean": 4.0} for w in ways},
        "ways": {w: {"accuracy": 0.8} for w in ways},
    }
    paths = []
    for name, content in (("wrist", wrist), ("interaction", both), ("assess", assess)):
        paths.append(tmp_path / f"{name}.json")
        paths[-1].write_text(json.dumps(content))
    return paths


def test_results_of_virtual_people_stand_beside_and_prove_nothing(host_files):
    result = thesis.recompute(chapters=(6, 7, 8), given=host_files)
    people = [j for j in result.judged if j.printed.kind == "people"]
    assert len(people) == 7
    for j in people:
        assert j.verdict == thesis.WORDS["people"]
        assert j.to_dict()["simulated"] is True
        assert j.ours["number of virtual people"] == 10
        # Every published number has ours beside it, by the same name.
        assert set(j.printed.published) <= set(j.ours), j.printed.id
    without = thesis.recompute(chapters=(6,))
    assert all("not run here" in j.verdict for j in without.judged if j.printed.kind == "people")


def test_other_files_are_refused(host_files, tmp_path):
    for text, said in (
        ("{", "read as JSON"),
        ("[1]", "not a result"),
        ('{"x": 1}', "not a result"),
    ):
        path = tmp_path / "other.json"
        path.write_text(text)
        with pytest.raises(UserError, match=said):
            thesis.HostResults.read([path])
    path.write_text(json.dumps(json.loads(host_files[0].read_text()) | {"simulated": False}))
    with pytest.raises(UserError, match="people took part"):
        thesis.HostResults.read([path])
    path.write_text(json.dumps({"simulated": True, "tables": {}}))
    with pytest.raises(UserError, match="wrist_ru"):
        thesis.HostResults.read([path])("wrist_ru")


def test_the_command_writes_the_page(tmp_path):
    page, data = tmp_path / "page.html", tmp_path / "all.json"
    call = ["reproduce", "all", "--chapter", "8", "--page", str(page), "--json", str(data)]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0, done.output
    content = json.loads(data.read_text())
    assert content["schema_version"] == 1
    assert {i["chapter"] for i in content["items"]} == {8}
    assert sum(content["counts"].values()) == len(content["items"]) == FIGURES[8] + TABLES[8]
    text = page.read_text()
    for i in content["items"]:
        assert f'<h3 id="{i["id"].replace(" ", "-")}">' in text
    assert not re.search(r'(?:src|href)="(?!#)', text), "one file, which fetches nothing"
    assert "esea-gen reproduce all --chapter 8" in text


@pytest.mark.slow
def test_the_whole_thesis():
    result = thesis.recompute()
    assert result.explained
    assert {j.printed.chapter for j in result.judged} == set(thesis.CHAPTERS)
    verdicts = {j.printed.id: j.verdict for j in result.judged}
    for name in ("Text 3.4", "Figure 4.6", "Figure 4.7", "Figure 5.7", "Figure 5.8", "Figure 5.9"):
        assert verdicts[name] == thesis.REPRODUCED, name
    for name in ("Table 4.4", "Table 4.5", "Figure 5.5", "Text 5.4", "Figure 5.6", "Table 3.5"):
        assert verdicts[name] == thesis.DIFFERS, name
