"""Tables of figures on the pages: none is edited by hand, a fixed sample is computed again."""

from __future__ import annotations

import dataclasses
import json

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
