"""Stored choice of the plan search: the same plan, never one of other content."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest

import esea_gen
from esea_gen.cache import cache_folder, code_digest
from esea_gen.emit.fixed import kept
from esea_gen.emit.fixed.kept import ROOMS
from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.fixed.search import search
from esea_gen.emit.render import environment
from esea_gen.hostlib.compiler import compile_sources


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "esea-gen"


def fresh(block):
    """The Block without what was planned of it before: devices of equal content share theirs."""
    return dataclasses.replace(block)


def sensor():
    return fresh(esea_gen.load_device("elbow").sensor)


def digest(block) -> str | None:
    return kept.content_digest(Planner(block))


class NobodyReads:
    def __getattribute__(self, name):
        raise AssertionError(name)


def test_a_kept_choice_gives_the_plan_that_the_search_found(folder, monkeypatch):
    # Nothing of the Block that is left out of the digest is read on the way.
    unread = dict.fromkeys(kept.NOT_READ, NobodyReads())
    found = kept.plan_block(dataclasses.replace(sensor(), **unread))
    assert found.wide
    assert len(list(folder.iterdir())) == 1

    def refuse(planner):
        raise AssertionError("searched again")

    monkeypatch.setattr(kept, "search", refuse)
    again = kept.plan_block(sensor())
    for name in ("fields", "prepare", "init", "step", "facts", "wide", "why_wide", "labels"):
        assert getattr(again, name) == getattr(found, name), name


@pytest.fixture(scope="module")
def entry(tmp_path_factory):
    """A Block, and the name and text of what is kept of it."""
    block = fresh(esea_gen.load_device("elbow").velocity)
    base = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(base))
        kept.plan_block(block)
    (path,) = (base / "esea-gen").iterdir()
    return block, path.name, path.read_text()


@pytest.mark.ci
@pytest.mark.parametrize("text", ["", "{", "[1]", '{"x": "y"}', '{"99999": "no such value"}'])
def test_an_entry_that_is_none_is_searched_for_again(folder, entry, text):
    block, name, good = entry
    assert text != good
    folder.mkdir()
    (folder / name).write_text(text)
    kept.plan_block(fresh(block))
    (path,) = folder.iterdir()
    assert path.read_text() == good


def test_other_content_has_another_digest(folder, monkeypatch):
    block = sensor()
    base = digest(block)
    assert digest(sensor()) == base
    port = dataclasses.replace(block.inputs[0], high=0.349)
    others = [
        dataclasses.replace(block, inputs=(port, *block.inputs[1:])),
        dataclasses.replace(block, facts={**block.facts, "x": (0.0, 1.0)}),
        dataclasses.replace(block, period_s=block.period_s / 2),
        esea_gen.load_device("elbow").velocity,
    ]
    found = [digest(b) for b in others]
    monkeypatch.setattr(kept, "code_digest", lambda rooms: "other code")
    found.append(digest(block))
    assert len({base, *found}) == len(found) + 1


def test_the_search_reads_no_code_but_that_of_the_digest():
    """What is planned comes from the Block; how, from two rooms, whose change plans anew."""
    planner = Planner(esea_gen.load_device("elbow").velocity)
    root = Path(esea_gen.__file__).parent
    read = set()

    def note(frame, event, arg):
        read.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        search(planner)
    finally:
        sys.setprofile(None)
    own = (Path(name) for name in read if Path(name).is_relative_to(root))
    assert {path.relative_to(root).parts[0] for path in own} == set(ROOMS)
    assert code_digest(ROOMS) != code_digest(("emit",)) != code_digest()


def test_a_cache_without_room_costs_time_and_nothing_else(folder, monkeypatch):
    source = {"a.c": "int given(void) { return 5; }"}
    kept_as = compile_sources(source)
    kept_as.unlink()
    kept_as.mkdir()  # no file can take its place
    assert compile_sources(source).is_file()
    folder.rename(folder.with_name("moved"))
    folder.write_text("no folder")
    monkeypatch.setattr(environment().bytecode_cache, "folder", folder)
    assert environment().get_template("bench/bare.ld.j2")
    assert cache_folder().is_dir()
