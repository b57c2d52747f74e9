"""MAVLink's core headers stand once beside the folders of several devices."""

from __future__ import annotations

import hashlib
import json
from importlib import resources

from esea_gen.emit.build import Bundle
from esea_gen.emit.dialect import core_bundle, without_core


def test_a_folder_loses_the_core_headers_and_nothing_else():
    own = {"mavlink/elbow/elbow.h": "a", "protocol.h": "b", "manifest.json": "c"}
    core = {f"mavlink/{n}": "d" for n in ("protocol.h", "checksum.h", "mavlink_types.h")}
    left = without_core(Bundle("elbow/mavlink", own | core))
    assert (left.folder, left.files) == ("elbow/mavlink", own)
    assert without_core(Bundle("elbow/f32", own)).files == own


def test_the_core_is_every_header_of_pymavlink_with_its_digest():
    source = resources.files("pymavlink") / "generator" / "C" / "include_v2.0"
    headers = {p.name: p.read_bytes() for p in source.iterdir() if p.name.endswith(".h")}
    files = dict(core_bundle().files)
    manifest = json.loads(files.pop("manifest.json"))
    assert {n: t.encode() for n, t in files.items()} == headers
    assert manifest["files"] == {n: hashlib.sha256(b).hexdigest() for n, b in headers.items()}
