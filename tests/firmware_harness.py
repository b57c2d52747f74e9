"""C test programs around the hand-written firmware, with visible registers and interrupts.

What only a processor has is taken away from a copy: its assembly, and the addresses of registers,
which a table stands for.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from esea_gen.board.emulator import EmulatorResult, run_tasks_in_emulator
from esea_gen.board.firmware import FirmwareImage
from esea_gen.device import Device
from esea_gen.emit.build import render_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.targets import BOARDS, firmware_folder

# Of the Cortex-M: assembly, the attribute of a handler without a frame, sections of the image.
ASSEMBLY = r'__asm__ volatile\((?:[^()"]|"[^"]*"|\([^()]*\))*\);'
NAKED = r"__attribute__\(\((?:naked|section[^)]*\)[^)]*)\)\)"
REGISTER = "#define ESEA_REG(address) (*(volatile uint32_t *)(address))"

REGISTERS = """
#include <stdint.h>
#include <stdio.h>
/* A register that is written or read: its address, and what stands there. */
typedef struct { uint32_t address, value; } register_t;
static register_t registers[64];
static uint32_t used;
volatile uint32_t *register_at(uint32_t address)
{
    uint32_t i;
    for (i = 0u; i < used; ++i)
        if (registers[i].address == address)
            return &registers[i].value;
    registers[used].address = address;
    return &registers[used++].value;
}
static void print_registers(void)
{
    uint32_t i;
    for (i = 0u; i < used; ++i)
        printf("%u %u\\n", registers[i].address, registers[i].value);
}
"""


def run_in_emulator(
    device: Device, image: FirmwareImage, inputs: dict, options: Sequence[str] = ()
) -> EmulatorResult:
    """The first task alone."""
    name = device.system.tasks[0].name
    return run_tasks_in_emulator(device, image, {name: inputs}, options=options)[name]


def without_processor(folder: Path) -> Path:
    """The firmware's sources in a folder, as a computer can compile them."""
    shutil.copytree(firmware_folder(), folder / "firmware", dirs_exist_ok=True)
    for path in (folder / "firmware").rglob("*.[ch]"):
        text = path.read_text(encoding="utf-8")
        text = re.sub(NAKED, "", re.sub(ASSEMBLY, ";", text))
        text = text.replace(
            REGISTER, "#define ESEA_REG(address) (*register_at((uint32_t)(address)))"
        )
        path.write_text(text, encoding="utf-8")
    return folder / "firmware"


def compiled(folder: Path, text: str, *flags: str | Path) -> Path:
    """A program with sanitizers."""
    source = folder / "harness.c"
    source.write_text(text, encoding="utf-8")
    armed = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-w")
    command = ["gcc", "-std=gnu99", "-O0", *armed, source, *flags, "-o", folder / "harness"]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "harness"


def said_by(program: Path, told: str = "") -> list[str]:
    """Lines that a program prints; it must end well."""
    done = subprocess.run(
        [program], input=told, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()


def registers_after_start(folder: Path, board: str) -> dict[int, int]:
    """What a board's start leaves in each register that it touches, every register 0 before."""
    firmware = without_processor(folder)
    own = firmware / BOARDS[board].folder / "clock.c"
    clock = f'#include "{own}"' if own.is_file() else ""
    text = f"""{REGISTERS}
#include "{firmware}/{BOARDS[board].folder}/board.c"
{clock}
uint32_t esea_stack_top[1];
void esea_cortex_m_received(uint8_t byte) {{ (void)byte; }}
void esea_reset_handler(void) {{}}
void esea_fault_handler(void) {{}}
void esea_slower_handler(void) {{}}
void esea_tick_handler(void) {{}}
int main(void)
{{
    esea_board_start();
    print_registers();
    return 0;
}}
"""
    flags = (f"-I{firmware}/port", f'-DESEA_BOARD_NAME="{board}"', *BOARDS[board].clock_defines)
    lines = said_by(compiled(folder, text, *flags))
    return {int(a): int(v) for a, v in (line.split() for line in lines)}


APPLICATION = """
#include <stdio.h>
#include <string.h>
#include "app.h"

static uint32_t peak;

static size_t no_bytes(uint8_t *bytes, size_t capacity) { (void)bytes; (void)capacity; return 0u; }
static void nothing(void) {}
static uint32_t zero(void) { return 0u; }
static void any(bool on) { (void)on; }
static uint32_t stack_peak(void) { return peak; }

/* Tells of every frame that the application sends. */
static void told(const uint8_t *bytes, size_t count)
{
    static mavlink_message_t buffer, message;
    static mavlink_status_t parser, status;
    size_t i;
    for (i = 0u; i < count; ++i)
        if (mavlink_frame_char_buffer(&buffer, &parser, bytes[i], &message, &status)
            == MAVLINK_FRAMING_OK) {
            if (message.msgid == MAVLINK_MSG_ID_HEARTBEAT)
                printf("heartbeat mode %u status %u\\n",
                       (unsigned)mavlink_msg_heartbeat_get_custom_mode(&message),
                       (unsigned)mavlink_msg_heartbeat_get_system_status(&message));
            else if (message.msgid == MAVLINK_MSG_ID_ESEA_INFO)
                printf("info fault %u\\n", (unsigned)mavlink_msg_esea_info_get_fault(&message));
            else if (message.msgid == MAVLINK_MSG_ID_STATUSTEXT) {
                char text[51] = "";
                mavlink_msg_statustext_get_text(&message, text);
                printf("text %s\\n", text);
            }
        }
}

static const esea_port_t port = {
    .name = "spy", .receive_buffer_bytes = 1u, .stack_bytes = 100u, .read = no_bytes,
    .write = told, .wait = nothing, .ticks = zero, .quiet = any, .pend = nothing,
    .lost_bytes = zero, .stack_peak_bytes = stack_peak,
};

static esea_app_t app;

#include "machine.c"
#include "schedule.c"
#include "send.c"
#include "app.c"
#include "streams.c"
#include "parameters.c"
#include "signing.c"
#include "reader.c"
#include "rainflow.c"
#include "life.c"
#include "keep.c"
#include "key.c"
#include "link.c"
#include "start.c"

int main(void)
{
    char what[16];
    unsigned a, b;
    while (scanf("%15s %u %u", what, &a, &b) == 3)
        if (!strcmp(what, "start"))
            esea_app_init(&app, &port);
        else if (!strcmp(what, "input")) {
            esea_link_in_t in;
            memset(&in, 0, sizeof in);
            replay_task(&app, a, b, &in);
        } else if (!strcmp(what, "fail"))
            esea_app_fail(&app, (ESEA_FAULT)a);
        else if (!strcmp(what, "peak"))
            peak = a;
        else if (!strcmp(what, "check"))
            esea_app_check_stack(&app);
        else if (!strcmp(what, "reset"))
            printf("reset %d\\n", esea_app_ask(&app, ESEA_EVENT_RESET) && esea_app_reset(&app));
        else if (!strcmp(what, "flip"))
            ((uint8_t *)&app.control.params)[a] ^= (uint8_t)b;
        else if (!strcmp(what, "info"))
            esea_send_info(&app);
    return 0;
}
"""

# By the linker in the place of every release that the application asks for, and of every tick of
# the device's own latches that it leads to.
SPY = """
#include <stdio.h>
#include ESEA_LINK_HEADER
void __real_esea_{name}_release(esea_{name}_state_t *state, uint32_t tick);
void __wrap_esea_{name}_release(esea_{name}_state_t *state, uint32_t tick)
{{
    printf("latches %u\\n", (unsigned)tick);
    __real_esea_{name}_release(state, tick);
}}
void __real_esea_link_release(esea_link_control_t *control, uint32_t tick);
void __wrap_esea_link_release(esea_link_control_t *control, uint32_t tick)
{{
    printf("release %u\\n", (unsigned)tick);
    __real_esea_link_release(control, tick);
}}
"""


def build_application(folder: Path, device: Device) -> Path:
    """A program that gives the application what its input says, and tells of all that it does.

    Its input: ``start``, ``input TASK TICK``, ``fail FAULT``, ``peak BYTES`` of the stack,
    ``check`` the stack, ``reset``, ``flip BYTE BITS`` of the params, ``info``; each with two
    numbers.  Its output: releases and frames, a line each.
    """
    without_processor(folder)
    for sub, texts in (
        ("f32", render_device(device, ["f32"])[0].files),
        ("dialect", render_dialect(device).files),
    ):
        for name, text in texts.items():
            target = folder / sub / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
    (folder / "spy.c").write_text(SPY.format(name=device.name))
    sources = [p for p in sorted((folder / "f32").glob("*.c")) if p.name != "main.c"]
    sources += [folder / "firmware" / "app" / name for name in ("blackbox.c", "store.c")]
    sources += [folder / "spy.c", folder / "dialect" / f"esea_{device.name}_link.c"]
    folders = (
        "dialect/mavlink",
        "dialect",
        "f32",
        "firmware/port",
        "firmware/app",
        "firmware/drivers",
        ".",
    )
    flags = [f"-I{folder / f}" for f in folders]
    flags += [f'-DESEA_LINK_HEADER="esea_{device.name}_link.h"']
    flags += [f"-Wl,--wrap=esea_{own}_release" for own in (device.name, "link")]
    return compiled(folder, APPLICATION, *sources, *flags, "-lm")
