"""Tables of figures on the pages: not edited by hand, a fixed sample recomputed."""

from __future__ import annotations

import json

import pytest

from tests.conftest import ROOT, load_file, require_tool

figures = load_file(ROOT / "docs" / "figures.py")


def test_every_table_is_as_its_commands_wrote_it():
    assert list(figures.problems(ROOT / "docs")) == []


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page with one table, and commands whose results are files."""
    monkeypatch.setattr(figures, "KEPT", tmp_path / "kept")
    columns = (("", "{key}"), ("one", "{x[0]:.2f}", (0,)), ("two", "{x[1000]:.1e}", (1,)))
    what = {"commands": ["esea-gen first", "esea-gen second"], "inputs": ["LICENSE"], "cpu_s": 1.0}
    shown = {"rows": "sums.*", "columns": [figures.FigureColumn(*c) for c in columns]}
    table = figures.FigureTable("small", **what, **shown, where={"kept": ["True"]})
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
        ("\nend", "\nThe RMS error is 0.12 Nm.", "a.md: `RMS error is 0.12 Nm` is typed by hand"),
        ("\nend", "\n26 of 27 pairs are passive.", "`26 of 27` is typed by hand"),
    ],
)
def test_an_edit_by_hand_is_reported(page, old, new, said):
    """Armed: one digit, a date, a name that no command has, numbers outside a block."""
    path = page / "a.md"
    path.write_text(path.read_text().replace(old, new))
    assert said in "\n".join(figures.problems(page))


@pytest.mark.ci
@pytest.mark.parametrize("name", [t.name for t in figures.tables().values() if t.sample])
def test_a_sample_of_the_tables_comes_out_again(name, tmp_path, monkeypatch):
    if "fixed" in name:
        require_tool("arm-none-eabi-gcc")
        require_tool("qemu-system-arm")
    # Neither an earlier result nor a journal.
    monkeypatch.setattr(figures, "KEPT", tmp_path)
    table = figures.tables()[name]
    assert table.cpu_s <= 20
    old = figures.blocks(ROOT / "docs")[name].inner
    assert figures.differences(old, "\n".join(figures.computed(table, jobs=1)), table.scatter) == []
