"""Tables of figures on the pages: none is edited by hand, a fixed sample is computed again."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

from tests.conftest import ROOT, load_file, require_tool

figures = load_file(ROOT / "docs" / "figures.py")


def test_every_table_is_as_its_commands_wrote_it():
    assert list(figures.problems(figures.blocks(ROOT / "docs"))) == []


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page with one table, and commands whose results are files."""
    monkeypatch.setattr(figures, "KEPT", tmp_path / "kept")
    table = figures.FigureTable(
        "small",
        ["esea-gen first", "esea-gen second"],
        ["LICENSE"],
        1.0,
        rows="sums.*",
        where={"kept": ["True"]},
        columns=(
            figures.FigureColumn("", "{key}"),
            figures.FigureColumn("one", "{x[0]:.2f}", (0,)),
            figures.FigureColumn("two", "{x[1000]:.1e}", (1,)),
        ),
    )
    monkeypatch.setattr(figures, "tables", lambda: {"small": table})
    (tmp_path / "a.md").write_text("# A\n\n<!-- figures:small -->\n<!-- /figures -->\nend\n")
    found = ({"a": {"x": [1.234], "kept": True}}, {"a": {"x": {"1000": 2e-5}, "kept": True}})
    found[0]["b"] = {"x": [0.0], "kept": False}
    texts = [json.dumps({"sums": f}) for f in found]
    lines = figures.draw(table, [json.loads(t, object_hook=figures.Entry) for t in texts])
    (block,) = figures.blocks(tmp_path).values()
    figures.write(block, lines, "2026-01-02")
    return tmp_path


def test_a_table_is_drawn_in_place_with_its_source(page):
    text = (page / "a.md").read_text()
    assert "|  | one | two |\n|---|---|---|\n| a | 1.23 | 2.0e-05 |\n\n" in text
    assert "*Simulated; 2026-01-02: `make figures TABLES=small`*" in text
    assert re.fullmatch(r"# A\n.*-->\nend\n", text, re.DOTALL)
    assert list(figures.problems(figures.blocks(page))) == []


def test_a_figure_within_a_sentence_is_drawn_in_place(page, monkeypatch):
    text, result = "{0[a][0]:.1f} of {0[b]!n}, {0[c]:.2f}", {"a": [7.44], "b": [[True, False]]}
    table = dataclasses.replace(figures.tables()["small"], columns=(), text=text)
    monkeypatch.setattr(figures, "tables", lambda: {"most": table})
    monkeypatch.setattr(figures, "result_of", lambda *_: result | {"c": None})
    (page / "a.md").write_text("At most <!-- figures:most --><!-- /figures --> here.\n")
    for _ in range(2):  # the second time in place of the first
        figures.write(figures.blocks(page)["most"], figures.computed(table), "2026-01-02")
    content = (page / "a.md").read_text()
    assert re.sub("<!--.*?-->", "", content) == "At most 7.4 of 1, – here.\n"
    assert list(figures.problems(figures.blocks(page))) == []
    (page / "a.md").write_text(content.replace("7.4", "7.3"))
    assert "most: edited by hand" in "\n".join(figures.problems(figures.blocks(page)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("1.23", "1.24", "a.md, small: edited by hand; run `make figures TABLES=small`"),
        ("; 2026-01-02: ", "; 2026-03-02: ", "edited by hand"),
        ("figures:small", "figures:other", "not in both"),
    ],
)
def test_an_edit_by_hand_is_reported(page, old, new, said):
    """Armed: one digit, a date, and a name that no command has."""
    path = page / "a.md"
    path.write_text(path.read_text().replace(old, new))
    assert said in "\n".join(figures.problems(figures.blocks(page)))


def test_a_block_without_end_is_an_error(page):
    path = page / "a.md"
    path.write_text(path.read_text().replace("<!-- /figures -->", ""))
    with pytest.raises(SystemExit, match=r"a\.md: a block of figures without its end"):
        figures.blocks(page)


@pytest.mark.parametrize(
    ("new", "scatter", "apart"),
    [
        ("| a 5 | 1.24 / 2.0e-5 |", 0.0, False),  # one unit of the last digit
        ("| a 5 | 1.26 / 2.0e-5 |", 0.0, True),
        ("| a 5 | 1.34 / 2.1e-5 |", 0.1, False),
        ("| a 5 | 1.37 / 2.0e-5 |", 0.1, True),
        ("| a 5 | 1.23 / 2.4e-5 |", 0.1, True),
        ("| b 5 | 1.23 / 2.0e-5 |", 0.1, True),
        ("| a 5 | 1.23 / 2.0e-5 |\n| c |", 0.1, True),
        ("| a 5 | – / 2.0e-5 |", 0.1, True),
    ],
)
def test_what_is_outside_the_scatter_is_a_difference(new, scatter, apart):
    assert bool(figures.differences("| a 5 | 1.23 / 2.0e-5 |", new, scatter)) is apart


def test_the_error_of_several_runs_names_those_that_ended():
    runs = [
        {"seed": s, "rms_true_Nm": e, "unstable": e is None}
        for s, e in ((0, 1.0), (0, 3.0), (1, 5.0), (2, None), (3, 4.0))
    ]
    assert figures.errors(runs) == "4.000 (1 of 5 ended)"
    assert figures.errors(runs[:3]) == "3.500"


@pytest.mark.ci
@pytest.mark.parametrize("name", [t.name for t in figures.tables().values() if t.sample])
def test_a_sample_of_the_tables_comes_out_again(name, tmp_path, monkeypatch):
    require_tool("gcc")
    if "fixed" in name:
        require_tool("arm-none-eabi-gcc")
        require_tool("qemu-system-arm")
    # Neither an earlier result nor a journal.
    monkeypatch.setattr(figures, "KEPT", tmp_path)
    table = figures.tables()[name]
    assert table.cpu_s <= 20
    old = figures.blocks(ROOT / "docs")[name].inner
    new = "\n".join(figures.computed(dataclasses.replace(table), jobs=1))
    assert figures.differences(old, new, table.scatter) == []
