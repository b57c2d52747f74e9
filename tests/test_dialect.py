"""The MAVLink dialect: definition, C headers, Python module and the binding between them."""

from __future__ import annotations

import json
import re
import struct
import subprocess
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from esea_gen.control.limits.faults import Fault
from esea_gen.device import load_device
from esea_gen.emit import dialect
from esea_gen.emit.build import MANIFEST, Bundle, differences, render_device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.messages import messages
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import System, Task

from .conftest import ROOT

STANDARD = (
    "HEARTBEAT", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_VALUE", "PARAM_SET",
    "COMMAND_LONG", "COMMAND_ACK", "TIMESYNC", "STATUSTEXT", "SETUP_SIGNING", "PARAM_ERROR",
)  # fmt: skip
CFLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


@pytest.fixture(scope="module")
def elbow():
    return load_device("elbow")


@pytest.fixture(scope="module")
def bundle(elbow):
    return dialect.render_dialect(elbow)


@pytest.fixture(scope="module")
def module(elbow):
    return dialect.load_dialect(elbow)


def definition(bundle):
    return ElementTree.fromstring(bundle.files["esea_elbow.xml"])


def compile_and_run(folder, files, main):
    """Compile a program beside rendered files, and give what it prints."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "program.c").write_text(main)
    sources = [n for n in files if n.endswith(".c") and n != "main.c"]
    # The warnings are for the binding; those of the control files are tested with these.
    checked = [*CFLAGS, "-isystem", "mavlink", "-I.", "-c", "program.c"]
    linked = ["-std=c99", "program.o", *sources, "-o", "program"]
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


def test_every_port_is_a_field_with_its_unit_range_and_meaning(elbow, bundle):
    root = definition(bundle)
    fields = {
        (m.get("name"), f.get("name")): f for m in root.iter("message") for f in m.iter("field")
    }
    system = elbow.system
    for task in system.tasks:
        sides = (("IN", system.task_inputs(task)), ("OUT", system.task_outputs(task)))
        for side, ports in sides:
            for x in ports:
                f = fields[f"ESEA_{task.name.upper()}_{side}", x.name]
                assert x.port.meaning in f.text
                if x.port.flags:
                    assert f.get("type") == "uint32_t"
                    assert f.get("display") == "bitmask"
                else:
                    assert f.get("type") == "float"
                    assert f"[{x.port.unit}]" in f.text
                    assert f"{x.port.high:.9g}" in f.text
    assert fields["ESEA_SENSE_IN", "theta_rad"].get("units") == "rad"
    # MAVLink's schema does not know the newton metre: the description carries it.
    assert fields["ESEA_SENSE_OUT", "tau_Nm"].get("units") is None


def test_status_bits_are_named(elbow, bundle):
    enums = {e.get("name"): e for e in definition(bundle).iter("enum")}
    for x in elbow.system.outputs:
        if x.port.flags:
            entries = list(enums[f"ESEA_ELBOW_{x.name.upper()}"].iter("entry"))
            assert [int(e.get("value")) for e in entries] == [
                1 << i for i in range(len(x.port.flags))
            ]
            for entry, flag in zip(entries, x.port.flags, strict=True):
                assert entry.get("name").endswith(flag.name)


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


def test_manifest_lists_every_file_and_pymavlink(bundle):
    manifest = json.loads(bundle.files[MANIFEST])
    assert manifest["kind"] == bundle.folder == "dialect"
    assert manifest["versions"]["pymavlink"]
    assert set(manifest["files"]) == set(bundle.files) - {MANIFEST}


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


def two_rates() -> System:
    """A fast task that reads, through a latch, a vector that a slow task writes."""

    def block(name, period_s, ports, step):
        return Block.define(
            name,
            f"Test block {name}",
            period_s=period_s,
            state=(Port("x_rad", -10.0, 10.0, "state"),),
            step=step,
            **ports,
        )

    pair = Port("pair_rad", -10.0, 10.0, "two values", size=2)
    scalar = Port("a_rad", -10.0, 10.0, "one value")
    slow = block(
        "slow",
        0.004,
        {"inputs": (pair,), "outputs": (replace(pair, name="mean_rad"),)},
        lambda c, s, u, guard, label: (
            {"x_rad": s.x_rad},
            {"mean_rad": [u.pair_rad[0] * 0.5, u.pair_rad[1] * 0.5]},
        ),
    )
    fast = block(
        "fast",
        0.001,
        {
            "inputs": (scalar, replace(pair, name="mean_rad")),
            "outputs": (replace(scalar, name="b_rad"),),
        },
        lambda c, s, u, guard, label: (
            {"x_rad": s.x_rad},
            {"b_rad": u.a_rad + u.mean_rad[0] + u.mean_rad[1]},
        ),
    )
    return System(
        "toy",
        0.001,
        {"fast": fast, "slow": slow},
        (Task("quick", ("fast",)), Task("lazy", ("slow",), every=4, phase=1, release=2)),
        wires={"fast.mean_rad": "slow.mean_rad"},
        inputs={"a_rad": ("fast.a_rad",), "pair_rad": ("slow.pair_rad",)},
        outputs={"b_rad": "fast.b_rad"},
    )


def test_tasks_of_two_rates_release_their_latches_on_time(tmp_path):
    system = two_rates()
    renderer = Renderer(system, FORMATS["f32"], "0" * 16, "-", "-")
    files = renderer.files() | dialect.dialect_files(renderer)
    main = """
    #include <stdio.h>
    #include "esea_toy_link.h"
    static esea_link_control_t control;
    static void run(uint32_t task, uint32_t tick, const esea_link_in_t *in)
    {
        esea_link_out_t out;
        esea_link_release(&control, tick);
        esea_link_step(task)(&control, in, &out);
        if (task == 0u)
            printf("%.3f ", (double)out.quick.b_rad);
    }
    int main(void)
    {
        esea_link_in_t quick, lazy;
        uint32_t tick;
        if (esea_link_init(&control) != 0u || ESEA_LINK_TASKS != 2u || esea_link_every(1u) != 4u)
            return 1;
        for (tick = 0u; tick < 12u; ++tick) {
            quick.quick.a_rad = 0.125f;
            lazy.lazy.pair_rad[0] = (float)tick;
            lazy.lazy.pair_rad[1] = 0.5f;
            run(0u, tick, &quick);
            if (tick % 4u == 1u)
                run(1u, tick, &lazy);
        }
        /* A jump in the sequence is caught up in bounded work. */
        run(0u, 4000000000u, &quick);
        return 0;
    }
    """
    simulator = system.simulator()
    expected = []
    for tick in range(12):
        simulator.release(tick)
        step = simulator.step("quick", a_rad=0.125)
        expected.append(f"{step['b_rad']:.3f}")
        if tick % 4 == 1:
            simulator.step("lazy", pair_rad=np.array([tick, 0.5]))
    printed = compile_and_run(tmp_path, files, main).decode().split()
    assert printed[:12] == expected
    assert len(set(expected)) > 2
    assert len(printed) == 13


def test_one_numbering_of_faults_in_the_link_the_header_and_the_docs():
    """Numbers of the link's enum, typed in the documentation, and of the header."""
    elbow_drive = load_device("elbow_drive")
    bundle = dialect.render_dialect(elbow_drive)
    listed = re.findall(
        r'value="(\d+)" name="ESEA_FAULT_(\w+)"', bundle.files["esea_elbow_drive.xml"]
    )
    link = {name: int(value) for value, name in listed}
    assert len(link) == len(set(link.values())) == len(Fault) + 9
    header = render_device(elbow_drive, ["f32"])[0].files["esea_elbow_drive.h"]
    in_c = dict(re.findall(r"#define ESEA_ELBOW_DRIVE_FAULT_(\w+) (\d+)u", header))
    assert {n: int(v) for n, v in in_c.items()} == {n: v for n, v in link.items() if v < 100}
    firmware = (ROOT / "docs" / "firmware.md").read_text()
    board = dict(re.findall(r"^\| `(\w+)` \| (\d+) \|", firmware, re.MULTILINE))
    assert {n: int(v) for n, v in board.items() if 100 < int(v) < 1000} == {
        n: v for n, v in link.items() if v > 100
    }
    limits = (ROOT / "docs" / "limits.md").read_text()
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \| \| (\d+) \| ([^|]+) \|", limits, re.MULTILINE)
    numbers = [int(n) for row in rows for n in (row[0], row[2])]
    assert sorted(numbers) == sorted(v for v in link.values() if v < 100)


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
        "f32/empty.c: empty file missing or left over",
        "--- (missing)\n+++ f32/missing.c (as generated now)\n@@ -0,0 +1 @@\n+new",
        "--- f32/old.c (on disk)\n+++ (not generated)\n@@ -1 +0,0 @@\n-left over",
    ]
