"""What an output folder holds and how it is written, with small stand-ins for devices."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import pytest

from esea_gen.emit import build
from esea_gen.emit.build import (
    MANIFEST,
    Bundle,
    build_command,
    device_formats,
    device_hash,
    differences,
    format_hash,
    manifest,
    render_device,
    write_bundles,
)
from esea_gen.emit.render import versions
from esea_gen.emit.walker import UnsupportedOperationError
from esea_gen.errors import UserError


@dataclass(frozen=True)
class Made:
    """What is asked of a device here."""

    name: str = "elbow_drive"
    origin: str = "elbow_drive.toml"
    controller: str = ""
    digest: str = "d"
    title: str = "T"
    system: str = "s"


MINE = Made(name="mine", origin="folder/mine.toml")


def test_the_command_that_builds_a_device_again():
    for device, expected in (
        (Made(), "esea-gen build elbow_drive"),
        (Made(controller="smc,mpc"), "esea-gen build elbow_drive --controller smc,mpc"),
        (MINE, "esea-gen build folder/mine.toml"),
        (Made(name="mine", origin="mine.toml"), "esea-gen build mine.toml"),
        # A shipped device's name in a file of another name, and the other way round.
        (Made(origin="copy.toml"), "esea-gen build copy.toml"),
        (Made(name="mine"), "esea-gen build elbow_drive.toml"),
    ):
        assert build_command(device) == expected


def test_formats_of_a_device():
    assert device_formats(Made()) == ["f64", "f32", "q31"]
    assert device_formats(Made(origin="copy.toml")) == ["f64", "f32"]
    assert device_formats(Made(name="elbow", origin="elbow.toml")) == ["f64", "f32"]


@pytest.fixture
def hashed(monkeypatch) -> list[tuple]:
    """What is hashed, in turn; the hash says of which formats."""
    calls = []

    def said(system, digest, title, formats):
        names = tuple(f.name for f in formats)
        calls.append((system, digest, title, names))
        return "+".join(names)

    monkeypatch.setattr(build, "content_hash", said)
    return calls


def test_a_hash_covers_the_default_formats_and_its_own(hashed):
    device = Made(digest="hash of formats")
    assert device_hash(device) == "f64+f32"
    assert hashed == [("s", "hash of formats", "T", ("f64", "f32"))]
    assert device_hash(device, "f32") == format_hash(device, "f64") == "f64+f32"
    assert len(hashed) == 1  # once for each set of formats
    assert device_hash(device, "q31") == format_hash(device, "q31") == "f64+f32+q31"
    assert len(hashed) == 2


def test_a_folder_is_what_the_renderer_gives_and_a_manifest(hashed, monkeypatch):
    asked = []

    class Renderer:
        def __init__(self, *given):
            asked.append(given)

        def folder(self):
            if asked[-1][1].name == "q31":
                raise UnsupportedOperationError("no such operation", "Take f32.")
            return {"a.c": "int a;\n"}

    monkeypatch.setattr(build, "Renderer", Renderer)
    device = Made(digest="a folder")
    found = render_device(device, ["f32", "f64"])
    assert [b.folder for b in found] == ["f32", "f64"]
    assert [(s, f.name, *rest) for s, f, *rest in asked] == [
        ("s", real, "f64+f32", f"esea-gen build elbow_drive --real {real}", "T")
        for real in ("f32", "f64")
    ]
    assert sorted(found[1].files) == ["a.c", MANIFEST]
    told = json.loads(found[1].files[MANIFEST])
    assert (told["kind"], told["command"]) == ("f64", "esea-gen build elbow_drive --real f64")
    with pytest.raises(UserError, match=r"elbow_drive\.toml: no such operation") as refused:
        render_device(device, ["f32", "q31"])
    assert refused.value.fix == "Take f32."
    with pytest.raises(UserError, match="number format"):
        render_device(device, ["f16"])


def test_a_manifest_says_what_a_folder_is_and_holds():
    files = {"b.h": "two\n", "a.c": "é"}
    found = manifest(MINE, "0123", "dialect", "do it", files, {"pymavlink": "2.4"})
    assert list(found) == [MANIFEST]
    text = found[MANIFEST]
    assert json.loads(text) == {
        "device": "mine",
        "kind": "dialect",
        "content_hash": "0123",
        "device_sha256": "d",
        "versions": versions() | {"pymavlink": "2.4"},
        "command": "do it",
        "files": {
            "a.c": hashlib.sha256("é".encode()).hexdigest(),
            "b.h": hashlib.sha256(b"two\n").hexdigest(),
        },
    }
    assert list(json.loads(text)["files"]) == ["a.c", "b.h"]
    assert text.startswith('{\n  "device"')
    assert text.endswith("}\n")
    plain = json.loads(manifest(MINE, "", "", "", {})[MANIFEST])
    assert plain["versions"] == versions()


def bundle(folder: str, **files: str) -> Bundle:
    named = {n.replace("_", "/", 1) + ".c": t for n, t in files.items()}
    return Bundle(folder, named | {MANIFEST: "{}\n"})


def tree(out) -> dict[str, str]:
    return {
        p.relative_to(out).as_posix(): p.read_bytes().decode()
        for p in out.rglob("*")
        if p.is_file()
    }


def test_folders_are_written_whole_and_take_the_place_of_older_ones(tmp_path):
    out = tmp_path / "deep" / "er"
    first = [bundle("f32", a="1\n", deep_b="é\n"), bundle("f64", c="3")]
    assert write_bundles(first, out) == [out / "f32", out / "f64"]
    assert tree(out) == {
        "f32/a.c": "1\n", "f32/deep/b.c": "é\n", "f32/manifest.json": "{}\n",
        "f64/c.c": "3", "f64/manifest.json": "{}\n",
    }  # fmt: skip
    (out / "q31").mkdir()  # an empty one is nobody's
    assert write_bundles([bundle("f32", z="9"), bundle("q31", d="4")], out) == [
        out / "f32",
        out / "q31",
    ]
    assert tree(out) == {
        "f32/z.c": "9", "f32/manifest.json": "{}\n", "f64/c.c": "3", "f64/manifest.json": "{}\n",
        "q31/d.c": "4", "q31/manifest.json": "{}\n",
    }  # fmt: skip
    assert sorted(p.name for p in out.iterdir()) == ["f32", "f64", "q31"]


def test_a_file_stands_in_folders_of_any_depth(tmp_path):
    write_bundles([Bundle("f32", {"a/b/c.h": "1", MANIFEST: "{}"})], tmp_path)
    assert tree(tmp_path) == {"f32/a/b/c.h": "1", f"f32/{MANIFEST}": "{}"}


def test_nothing_is_written_where_one_folder_is_not_ours(tmp_path):
    (tmp_path / "f64").mkdir()
    (tmp_path / "f64" / "notes.txt").write_text("mine")
    (tmp_path / "q31").write_text("a file")
    both = [bundle("f32", a="1"), bundle("f64", a="1")]
    with pytest.raises(UserError, match=r"f64 holds files .* did not write \(notes\.txt"):
        write_bundles(both, tmp_path)
    with pytest.raises(UserError, match="q31 is a file"):
        write_bundles([bundle("f32", a="1"), bundle("q31", a="1")], tmp_path)
    assert tree(tmp_path) == {"f64/notes.txt": "mine", "q31": "a file"}
    # With a manifest of ours it is ours, whatever else was put there.
    (tmp_path / "f64" / MANIFEST).write_text("{}")
    write_bundles(both, tmp_path)
    assert set(tree(tmp_path)) == {
        "f32/a.c", "f32/manifest.json", "f64/a.c", "f64/manifest.json", "q31",
    }  # fmt: skip


def test_what_differs_is_told_file_by_file(tmp_path):
    made = [
        bundle("f32", a="one\ntwo\n", deep_b="same\n", empty=""),
        bundle("f64", c="x\n", d="y\n"),
    ]
    write_bundles(made, tmp_path)
    assert differences(made, tmp_path) == []
    cache = tmp_path / "f32" / "__pycache__"
    cache.mkdir()
    (cache / "old.pyc").write_text("x")
    assert differences(made, tmp_path) == []
    (tmp_path / "f32" / "a.c").write_text("one\n2\n")
    (tmp_path / "f32" / "empty.c").unlink()
    (tmp_path / "f32" / "left.c").write_text("old\n")
    (tmp_path / "f32" / "over.c").write_text("")
    (tmp_path / "f64" / "c.c").unlink()
    assert differences(made, tmp_path) == [
        "--- f32/a.c (on disk)\n+++ f32/a.c (as generated now)\n@@ -1,2 +1,2 @@\n one\n-2\n+two",
        "f32/empty.c: empty file missing or left over",
        "--- f32/left.c (on disk)\n+++ (not generated)\n@@ -1 +0,0 @@\n-old",
        "f32/over.c: empty file missing or left over",
        "--- (missing)\n+++ f64/c.c (as generated now)\n@@ -0,0 +1 @@\n+x",
    ]
