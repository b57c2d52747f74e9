"""Content and writing of an output folder, with small stand-ins for devices."""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest

from esea_gen.devices.file import DeviceData
from esea_gen.emit.build import MANIFEST, Bundle, build_command, differences, write_bundles
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
    shipped = DeviceData.shipped
    argument = DeviceData.argument


MINE = Made(name="mine", origin="folder/mine.toml")


def test_the_command_that_builds_a_device_again():
    for device, expected in (
        (Made(), "esea-gen build elbow_drive"),
        (Made(controller="smc,mpc"), "esea-gen build elbow_drive --controller smc,mpc"),
        (MINE, "esea-gen build folder/mine.toml"),
        (Made(name="mine", origin="my arm.toml"), "esea-gen build 'my arm.toml'"),
        (Made(name="mine", origin="mine.toml"), "esea-gen build mine.toml"),
        # A shipped device's name in a file of another name, and the other way round.
        (Made(origin="copy.toml"), "esea-gen build copy.toml"),
        (Made(name="mine"), "esea-gen build elbow_drive.toml"),
    ):
        assert build_command(device) == expected


def bundle(folder: str, **files: str) -> Bundle:
    named = {n.replace("_", "/", 1) + ".c": t for n, t in files.items()}
    return Bundle(folder, named | {MANIFEST: json.dumps({"files": named})})


def tree(out) -> dict[str, str]:
    return {
        p.relative_to(out).as_posix(): p.read_bytes().decode()
        for p in out.rglob("*")
        if p.is_file() and p.name != MANIFEST
    }


def test_folders_are_written_whole_and_take_the_place_of_older_ones(tmp_path):
    out = tmp_path / "deep" / "er"
    first = [bundle("f32", a="1\n", deep_b="é\n"), bundle("f64", c="3")]
    assert write_bundles(first, out) == [out / "f32", out / "f64"]
    assert tree(out) == {
        "f32/a.c": "1\n", "f32/deep/b.c": "é\n", "f64/c.c": "3",
    }  # fmt: skip
    (out / "q31").mkdir()  # an empty one is nobody's
    assert write_bundles([bundle("f32", z="9"), bundle("q31", d="4")], out) == [
        out / "f32",
        out / "q31",
    ]
    assert tree(out) == {
        "f32/z.c": "9", "f64/c.c": "3", "q31/d.c": "4",
    }  # fmt: skip
    assert sorted(p.name for p in out.iterdir()) == ["f32", "f64", "q31"]


def test_nothing_is_written_where_one_folder_is_not_ours(tmp_path):
    (tmp_path / "f64").mkdir()
    (tmp_path / "f64" / "notes.txt").write_text("mine")
    (tmp_path / "q31").write_text("a file")
    both = [bundle("f32", a="1"), bundle("f64", a="1")]
    with pytest.raises(UserError, match=r"f64 has files .* did not write \(notes\.txt"):
        write_bundles(both, tmp_path)
    with pytest.raises(UserError, match="q31 is a file"):
        write_bundles([bundle("f32", a="1"), bundle("q31", a="1")], tmp_path)
    assert tree(tmp_path) == {"f64/notes.txt": "mine", "q31": "a file"}
    # What stands beside our files is somebody's own, too.
    (tmp_path / "f64" / MANIFEST).write_text('{"files": ["b.c"]}')
    (tmp_path / "f64" / "a.c").write_text("mine, by the name of one of ours")
    with pytest.raises(UserError, match=r"did not write \(a\.c, notes\.txt"):
        write_bundles(both[1:], tmp_path)


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
    (tmp_path / "f32" / "left.c").write_bytes(b"\xe0")
    (tmp_path / "f64" / "c.c").unlink()
    assert differences(made, tmp_path) == [
        "--- f32/a.c (on disk)\n+++ f32/a.c (as generated now)\n@@ -1,2 +1,2 @@\n one\n-2\n+two",
        "f32/empty.c: missing",
        "f32/left.c: not generated",
        "--- (missing)\n+++ f64/c.c (as generated now)\n@@ -0,0 +1 @@\n+x",
    ]
