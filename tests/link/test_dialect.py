"""The MAVLink dialect: definition, C headers, Python module and the binding between them."""

from __future__ import annotations

import re
import struct
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.control.limits.faults import OPTIONAL, Fault
from esea_gen.device import load_device
from esea_gen.emit import dialect
from esea_gen.emit.build import Bundle, differences, render_device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.messages import messages
from esea_gen.emit.parameters import fnv1a, link_parameters
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError

STANDARD = (
    "HEARTBEAT", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_VALUE", "PARAM_SET",
    "COMMAND_LONG", "COMMAND_ACK", "TIMESYNC", "STATUSTEXT", "SETUP_SIGNING", "PARAM_ERROR",
)  # fmt: skip
CFLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


@pytest.fixture(scope="module")
def bundle(elbow):
    return dialect.render_dialect(elbow)


@pytest.fixture(scope="module")
def module(elbow):
    return dialect.load_dialect(elbow)


def compile_and_run(folder, files, main):
    """Compile a program beside rendered files, and give what it prints."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "program.c").write_text(main)
    binding = "esea_elbow_link.c"
    sources = [n for n in files if n.endswith(".c") and n not in ("main.c", binding)]
    # The warnings are for the binding; those of the control files are tested with these.
    checked = [*CFLAGS, "-isystem", "mavlink", "-I.", "-c", "program.c", binding]
    linked = ["-std=c99", "program.o", "esea_elbow_link.o", *sources, "-o", "program"]
    for arguments in (checked, linked):
        command = ["gcc", *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return subprocess.run([folder / "program"], capture_output=True, check=True).stdout


def test_standard_messages_are_the_standard_ones(module):
    from pymavlink.dialects.v20 import common

    by_name = {c.msgname: c for c in common.mavlink_map.values()}
    ours = {c.msgname: c for c in module.mavlink_map.values()}
    assert ours["HEARTBEAT"].crc_extra == 50
    for name in STANDARD:
        for attribute in ("id", "crc_extra", "fieldnames", "fieldtypes", "ordered_fieldnames"):
            assert getattr(ours[name], attribute) == getattr(by_name[name], attribute), name
        assert ours[name].unpacker.format == by_name[name].unpacker.format


def test_standard_enums_keep_their_numbers(module):
    from pymavlink.dialects.v20 import common

    for enum, entries in module.enums.items():
        for value, entry in entries.items():
            if entry.name.startswith("MAV_") and not entry.name.endswith("ENUM_END"):
                assert common.enums[enum][value].name == entry.name


def test_own_ids_are_in_no_public_dialect(module):
    from pymavlink.dialects.v20 import all as public

    own = [c.id for c in module.mavlink_map.values() if c.msgname not in STANDARD]
    assert len(own) == 12
    assert not set(own) & set(public.mavlink_map)


def test_rendering_is_deterministic_and_carries_no_date_or_path(elbow, bundle):
    dialect.run_mavgen.cache_clear()
    assert dialect.render_dialect(elbow).files == bundle.files
    version = bundle.files["mavlink/esea_elbow/version.h"]
    assert '#define MAVLINK_BUILD_DATE ""' in version
    longest = max(m.payload_bytes for m in messages(elbow.system))
    assert f"MAX_DIALECT_PAYLOAD_SIZE {longest}" in version
    for text in bundle.files.values():
        assert "/tmp" not in text
        assert "/home" not in text


def test_largest_payload_is_mavlinks_own(module, elbow):
    longest = max(c.unpacker.size for c in module.mavlink_map.values())
    assert longest == max(m.payload_bytes for m in messages(elbow.system))


def test_too_many_values_for_a_frame_are_refused(elbow):
    system = elbow.system
    wide = SimpleNamespace(
        name="wide",
        blocks=system.blocks,
        feed=system.feed,
        base_period_s=system.base_period_s,
        tasks=system.tasks,
        task_inputs=system.task_inputs,
        task_outputs=lambda task: tuple(
            replace(system.outputs[0], name=f"tau_{i}_Nm") for i in range(62)
        ),
    )
    with pytest.raises(UserError, match="ESEA_SENSE_OUT has 64 fields in 256 bytes"):
        messages(wide)


# Values whose bits are easy to lose: signed zero, subnormals, NaN with a payload, infinity.
BITS = (0x00000000, 0x80000000, 0x00000001, 0x3DCCCCCD, 0x7F800000, 0xFFC12345, 0x7F7FFFFF)


def test_bits_survive_from_c_to_python(bundle, module, elbow, tmp_path):
    files = Renderer(elbow.system, FORMATS["f32"], "0" * 16, "-", "-").files() | bundle.files
    words = ", ".join(f"0x{b:08x}u" for b in BITS)
    main = f"""
    #include <stdio.h>
    #include <string.h>
    #include "esea_elbow_link.h"
    int main(void)
    {{
        static const uint32_t bits[] = {{ {words} }};
        uint8_t frame[MAVLINK_MAX_PACKET_LEN];
        mavlink_status_t status;
        mavlink_message_t message;
        uint32_t i;
        memset(&status, 0, sizeof status);
        for (i = 0u; i < sizeof bits / sizeof bits[0]; ++i) {{
            esea_link_out_t out;
            memset(&out, 0, sizeof out);
            memcpy(&out.sense.tau_Nm, &bits[i], 4u);
            memcpy(&out.sense.omega_rad_s, &bits[i], 4u);
            out.sense.sensor_status = bits[i];
            esea_link_encode(0u, i, 7u, &out, &status, &message);
            fwrite(frame, 1u, mavlink_msg_to_send_buffer(frame, &message), stdout);
        }}
        return 0;
    }}
    """
    frames = compile_and_run(tmp_path, files, main)
    found = module.MAVLink(None).parse_buffer(frames)
    assert [m.sequence for m in found] == list(range(len(BITS)))
    for message, bits in zip(found, BITS, strict=True):
        assert message.get_type() == "ESEA_SENSE_OUT"
        assert message.step_ticks == 7
        assert message.sensor_status == bits
        for value in (message.tau_Nm, message.omega_rad_s):
            assert struct.unpack("<I", struct.pack("<f", value))[0] == bits


def test_bits_survive_from_python_to_c(bundle, module, elbow, tmp_path):
    files = Renderer(elbow.system, FORMATS["f32"], "0" * 16, "-", "-").files() | bundle.files
    sender = module.MAVLink(None, 255, 190)
    frames = b"".join(
        module.MAVLink_esea_sense_in_message(
            2**32 - 1 - i, float(np.uint32(b).view(np.float32))
        ).pack(sender)
        for i, b in enumerate(BITS)
    )
    main = f"""
    #include <stdio.h>
    #include <string.h>
    #include "esea_elbow_link.h"
    int main(void)
    {{
        static const uint8_t bytes[] = {{ {", ".join(map(str, frames))} }};
        mavlink_message_t message;
        mavlink_status_t status;
        size_t i;
        memset(&status, 0, sizeof status);
        for (i = 0u; i < sizeof bytes; ++i) {{
            esea_link_in_t in;
            uint32_t task, sequence, bits;
            if (mavlink_frame_char_buffer(&message, &status, bytes[i], NULL, NULL) == 0)
                continue;
            if (!esea_link_decode(&message, &task, &sequence, &in))
                return 1;
            memcpy(&bits, &in.sense.theta_rad, 4u);
            printf("%u %u %u\\n", (unsigned)task, (unsigned)sequence, (unsigned)bits);
        }}
        return 0;
    }}
    """
    rows = compile_and_run(tmp_path, files, main).decode().split("\n")[:-1]
    assert rows == [f"0 {2**32 - 1 - i} {b}" for i, b in enumerate(BITS)]


def test_one_numbering_of_faults_in_the_link_and_the_header():
    """Numbers of the link's enum and of the header."""
    elbow_drive = load_device("elbow_drive")
    bundle = dialect.render_dialect(elbow_drive)
    listed = re.findall(
        r'value="(\d+)" name="ESEA_FAULT_(\w+)"', bundle.files["esea_elbow_drive.xml"]
    )
    link = {name: int(value) for value, name in listed}
    assert len(link) == len(set(link.values())) == len(Fault) - len(OPTIONAL) + 11
    header = render_device(elbow_drive, ["f32"])[0].files["esea_elbow_drive.h"]
    in_c = dict(re.findall(r"#define ESEA_ELBOW_DRIVE_FAULT_(\w+) (\d+)u", header))
    assert {n: int(v) for n, v in in_c.items()} == {n: v for n, v in link.items() if v < 100}


def test_what_differs_is_shown_with_two_lines_around(tmp_path):
    lines = [f"line {k}" for k in range(20)]
    kept = {"same.h": "x\n", "changed.c": "\n".join(lines), "missing.c": "new\n", "empty.c": ""}
    (tmp_path / "f32").mkdir()
    lines[9] = "what somebody wrote"
    (tmp_path / "f32" / "changed.c").write_text("\n".join(lines))
    (tmp_path / "f32" / "same.h").write_text("x\n")
    (tmp_path / "f32" / "old.c").write_text("left over\n")
    assert differences([Bundle("f32", kept)], tmp_path) == [
        "--- f32/changed.c (on disk)\n+++ f32/changed.c (as generated now)\n@@ -8,5 +8,5 @@\n"
        " line 7\n line 8\n-what somebody wrote\n+line 9\n line 10\n line 11",
        "f32/empty.c: missing",
        "--- (missing)\n+++ f32/missing.c (as generated now)\n@@ -0,0 +1 @@\n+new",
        "f32/old.c: not generated",
    ]


def test_keys_are_published_hashes_and_ids_are_short_and_unlike():
    # Of the authors' own list of FNV-1a in 32 bits.
    for text, value in (("", 0x811C9DC5), ("a", 0xE40C292C), ("foobar", 0xBF9CF968)):
        assert fnv1a(text) == value
    for name in ("elbow", "elbow_drive", "elbow_mpc", "wrist"):
        found = link_parameters(load_device(name).system)
        assert len({p.id for p in found}) == len({p.key for p in found}) == len(found)
        assert all(re.fullmatch(r"[.\-a-zA-Z0-9_]{1,16}", p.id) for p in found)


# -- MAVLink's generator ---------------------------------------------------------------------------

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
    assert "#define MAVLINK_MSG_ID_TRIED 300" in found["mavlink/tried/mavlink_msg_tried.h"]
    module = dialect.load_module("tried", found["python/tried.py"])
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
