"""What a dialect's files are made from, and MAVLink's generator on a small definition."""

from __future__ import annotations

import json
import math
from importlib import metadata
from types import SimpleNamespace

import pytest

from esea_gen.emit import dialect
from esea_gen.emit.build import MANIFEST, Bundle
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.messages import fault_codes, messages, status_words
from esea_gen.emit.parameters import link_parameters, parameter_metadata
from esea_gen.emit.roles import board_roles
from esea_gen.emit.states import STATES
from esea_gen.errors import UserError

PYMAVLINK = metadata.version("pymavlink")


def test_a_dialects_files_and_what_their_templates_are_given(drive, monkeypatch):
    system, asked = drive.system, {}

    def render(template: str, **context) -> str:
        asked[template] = context
        return f"text of {template}"

    told = {"command": "esea-gen build mine --controller smc --real f32"}
    renderer = SimpleNamespace(
        system=system, prefix="esea_mine", env=SimpleNamespace(globals=told), render=render
    )
    runs = []

    def generator(*given):
        runs.append(given)
        return {"python/p.py": "P", "mavlink/m.h": "M"}

    monkeypatch.setattr(dialect, "run_mavgen", generator)
    xml = "text of dialect/esea_dialect.xml.j2"
    assert dialect.dialect_files(renderer) == {
        "esea_mine.xml": xml,
        "esea_mine_parameters.json": parameter_metadata(system),
        "esea_mine_link.h": "text of dialect/esea_link.h.j2",
        "mavlink/esea_mine/version.h": "text of dialect/version.h.j2",
        "python/p.py": "P",
        "mavlink/m.h": "M",
    }
    assert runs == [("esea_mine", xml)]
    definition = asked["dialect/esea_dialect.xml.j2"]
    assert definition.pop("command") == "esea-gen build mine - -controller smc - -real f32"
    link = asked["dialect/esea_link.h.j2"]
    assert link == definition == asked["dialect/version.h.j2"]
    assert link["messages"] == messages(system)
    assert link["largest_payload"] == 17 + 4 * 59  # of a stream's samples
    assert link["longest_period"] == 5
    assert (link["first_id"], link["heartbeat_every"], link["key_part"]) == (42600, 1000, 58)
    assert link["streams"] == (6, 59, 20)
    # Half a degree, to three digits.
    assert link["zero_room"] == float(f"{math.radians(0.5):.3g}")
    assert link["states"] is STATES
    assert link["roles"] == board_roles(system)
    assert link["faults"] == fault_codes(system)
    assert link["parameters"] == link_parameters(system)
    assert link["status_words"] == status_words(system)


def test_a_dialect_is_rendered_in_single_precision_with_its_manifest(drive, monkeypatch):
    seen = []
    monkeypatch.setattr(dialect, "device_hash", lambda device: "4567")
    monkeypatch.setattr(dialect, "Renderer", lambda *given: seen.append(given))
    monkeypatch.setattr(dialect, "dialect_files", lambda renderer: {"b": "2", "a": "1"})
    found = dialect.render_dialect(drive)
    command = "esea-gen build elbow_drive"
    assert seen == [(drive.system, FORMATS["f32"], "4567", command, drive.title)]
    assert found.folder == "dialect"
    files = dict(found.files)
    told = json.loads(files.pop(MANIFEST))
    assert files == {"a": "1", "b": "2"}
    assert (told["kind"], told["content_hash"], told["command"]) == ("dialect", "4567", command)
    assert told["versions"]["pymavlink"] == PYMAVLINK
    assert list(told["files"]) == ["a", "b"]


DEFINITION = """<?xml version="1.0"?>
<mavlink>
  <version>3</version>
  <messages>
    <message id="300" name="{name}">
      <description>Any.</description>
      <field type="uint32_t" name="count">How many.</field>
    </message>
  </messages>
</mavlink>
"""


def test_mavlinks_generator_is_run_on_a_definition():
    found = dialect.run_mavgen("tried", DEFINITION.format(name="TRIED"))
    assert list(found) == sorted(found)
    assert "tried.xml" not in found
    own = {n for n in found if n.startswith("mavlink/tried/")}
    assert own == {f"mavlink/tried/{n}.h" for n in ("mavlink", "mavlink_msg_tried", "tried")}
    assert {n for n in found if n.startswith("python/")} == {"python/tried.py"}
    assert "mavlink/protocol.h" in found
    assert "class MAVLink_tried_message" in found["python/tried.py"]
    assert "#define MAVLINK_MSG_ID_TRIED 300" in found["mavlink/tried/mavlink_msg_tried.h"]
    module = dialect.load_module("tried", found["python/tried.py"])
    assert module.__name__ == "tried"
    sender = module.MAVLink(None, 1, 2)
    frame = module.MAVLink_tried_message(5).pack(sender)
    assert frame[0] == 0xFD  # the second version of the protocol


def test_a_definition_that_the_generator_refuses_is_told():
    with pytest.raises(RuntimeError, match=r"^mavgen refuses other\.xml:\n") as told:
        dialect.run_mavgen("other", "<mavlink><messages></mavlink>")
    # In the generator's own words, each on its line.
    lines = str(told.value).splitlines()
    assert "Validating other.xml" in lines
    assert any("Opening and ending tag mismatch" in line for line in lines)


def test_without_the_generator_it_is_said_what_to_install(monkeypatch):
    def missing(*asked):
        raise UserError(" ".join(asked), "Install it.")

    monkeypatch.setattr(dialect, "from_extra", missing)
    for ask in (dialect.mavlink, lambda: dialect.run_mavgen("third", DEFINITION)):
        with pytest.raises(UserError, match=r"^pymavlink link A MAVLink dialect Install"):
            ask()


def test_a_devices_module_is_loaded_from_its_dialect(monkeypatch):
    class Tiny:
        name = "tiny"

    device = Tiny()
    bundle = Bundle("dialect", {"python/esea_tiny.py": "VALUE = 7\n"})
    monkeypatch.setattr(dialect, "render_dialect", lambda d: bundle)
    made = dialect.load_dialect(device)
    assert (made.VALUE, made.__name__) == (7, "esea_tiny")
    assert dialect.load_dialect(device) is made
