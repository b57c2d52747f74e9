"""Firmware's paths that a good run does not take: faults, resets, lost frames, a full buffer."""

from __future__ import annotations

from collections import deque
from random import Random

import pytest

from esea_gen.device import load_device
from tests import firmware_harness as rig
from tests.conftest import require_tool

# ESEA_FAULT and ESEA_STATE, MAV_STATE of MAVLink, as the messages' definition numbers them.
PREPARE_REFUSED, STACK_EXHAUSTED, PROCESSOR = 101, 102, 103
UNREFERENCED, FAULT = 5, 3
STANDBY, ACTIVE, CRITICAL, EMERGENCY = 3, 4, 5, 6

SENSE, CONTROL = 0, 1


@pytest.fixture(scope="module")
def application(tmp_path_factory):
    """What the drive's application says to a list of orders, started afresh."""
    require_tool("gcc")
    program = rig.build_application(tmp_path_factory.mktemp("app"), load_device("elbow_drive"))

    def run(*orders: tuple[str | int, ...]) -> list[str]:
        whole = [("start",), *orders]
        return rig.said_by(program, "\n".join([" ".join(map(str, (*o, 0, 0)[:3])) for o in whole]))

    return run


def inputs(*runs: tuple[int, int]) -> list[tuple[str, int, int]]:
    """Task and tick of each input."""
    return [("input", *r) for r in runs]


def released(lines: list[str], what: str = "release") -> list[int]:
    return [int(x.split()[1]) for x in lines if x.startswith(what)]


# -- faults ----------------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize(
    ("first", "later", "status"),
    [
        (STACK_EXHAUSTED, PROCESSOR, CRITICAL),
        (PROCESSOR, STACK_EXHAUSTED, EMERGENCY),
        (STACK_EXHAUSTED, PREPARE_REFUSED, CRITICAL),
    ],
)
def test_the_first_fault_is_told_whatever_follows(application, first, later, status):
    assert application(("fail", first), ("fail", later), ("info",)) == [
        f"heartbeat mode {UNREFERENCED} status {STANDBY}",
        f"heartbeat mode {FAULT} status {status}",
        f"heartbeat mode {FAULT} status {status}",
        f"info fault {first}",
    ]


def test_a_reset_clears_the_fault_and_a_later_one_is_the_first_again(application):
    orders = [("fail", STACK_EXHAUSTED), ("reset",), ("info",), ("fail", PROCESSOR), ("info",)]
    lines = application(*orders)
    assert [x for x in lines if x.startswith("info")] == ["info fault 0", f"info fault {PROCESSOR}"]


def test_while_a_fault_is_latched_no_input_is_released(application):
    used_up = [("peak", 100), ("check",), ("peak", 0)]
    lines = application(*inputs((SENSE, 0)), *used_up, *inputs((SENSE, 1)), ("info",))
    assert released(lines) == [0]
    # Latched once, then told in answer to the input.
    assert lines.count(f"heartbeat mode {FAULT} status {CRITICAL}") == 2
    assert lines[-1] == f"info fault {STACK_EXHAUSTED}"


def test_parameters_that_were_overwritten_are_not_used_after_a_reset(application):
    """Any bit of any word: the defaults stand, and it is said."""
    rng = Random(3)
    for _ in range(12):
        at, bits = rng.randrange(35 * 4), 1 << rng.randrange(8)
        lines = application(("flip", at, bits), ("reset",), ("reset",))
        assert lines.count("text parameters were corrupt: defaults") == 1
        assert lines.count("reset 1") == 2
    assert not [x for x in application(("reset",)) if x.startswith("text")]


# -- releases --------------------------------------------------------------------------------------


def test_both_tasks_of_a_tick_see_one_release(application):
    runs = [(SENSE, 4), (SENSE, 5), (CONTROL, 5), (SENSE, 6), (CONTROL, 10), (SENSE, 10)]
    assert released(application(*inputs(*runs))) == [4, 5, 6, 10]


@pytest.mark.parametrize(
    "ticks", [[0, 1, 2, 7, 8], [3, 1000], [2**32 - 1, 0, 1], [0, 2, 4, 6]], ids=str
)
def test_latches_are_released_at_the_tick_that_came_whatever_was_lost(application, ticks):
    assert released(application(*inputs(*[(SENSE, t) for t in ticks]))) == ticks


@pytest.mark.parametrize("gap", [1, 2, 3, 5, 6, 11, 1000])
@pytest.mark.parametrize("last", [0, 3, 2**32 - 2000])
def test_no_latch_is_left_out_after_lost_frames(application, gap, last):
    come = last + gap
    lines = application(*inputs((SENSE, last), (SENSE, come)))
    ticks = released(lines[lines.index(f"release {come}") :], "latches")
    # Latches fall due at most every five ticks: of the lost ones the last five bring all that was
    # pending, and this tick's own is the last.
    assert ticks[-1] == come
    assert {come - k for k in range(min(gap, 5))} <= set(ticks)
    # In order, each once, and none that was released before.
    assert ticks == sorted(set(ticks))
    assert ticks[0] > last


# -- the receive buffer of the boards --------------------------------------------------------------

RING = """
#include <stdint.h>
#include <stdio.h>
volatile uint32_t *register_at(uint32_t address) {{ (void)address; return 0; }}
#include "{firmware}/port/cortex_m.c"
uint32_t esea_data_load[1], esea_data_start[1], esea_data_end[1];
uint32_t esea_bss_start[1], esea_bss_end[1];
uint32_t esea_stack_limit[1], esea_stack_top[1];
const char esea_board_name[] = "ring";
uint32_t esea_board_clock_MHz = 16u;
void esea_board_start(void) {{}}
void esea_board_drivers(esea_port_t *port) {{ (void)port; }}
uint32_t esea_board_ticks(void) {{ return 0u; }}
void esea_board_send(uint8_t byte) {{ (void)byte; }}
void esea_app_init(esea_app_t *a, const esea_port_t *p) {{ (void)a; (void)p; }}
void esea_app_poll(esea_app_t *a) {{ (void)a; }}
void esea_app_tick(esea_app_t *a) {{ (void)a; }}
void esea_app_background(esea_app_t *a) {{ (void)a; }}
void esea_app_fail(esea_app_t *a, ESEA_FAULT f) {{ (void)a; (void)f; }}
int main(void)
{{
    static uint8_t bytes[4096];
    unsigned in, out, k, next = 0u;
    receiver.head = receiver.tail = START;
    while (scanf("%u %u", &in, &out) == 2) {{
        for (k = 0u; k < in; ++k)
            esea_cortex_m_received((uint8_t)(next++ * 7u));
        out = (unsigned)port_read(bytes, out);
        printf("%u:", (unsigned)port_lost_bytes());
        for (k = 0u; k < out; ++k)
            printf(" %u", bytes[k]);
        printf("\\n");
    }}
    return 0;
}}
"""


@pytest.mark.parametrize("start", [0, 2**32 - 700], ids=["from 0", "across the counter's wrap"])
def test_a_full_receive_buffer_keeps_what_it_has_and_counts_the_rest(tmp_path, start):
    require_tool("gcc")
    firmware = rig.without_processor(tmp_path)
    (tmp_path / "fake_link.h").write_text(
        "typedef int esea_link_control_t, mavlink_message_t, mavlink_status_t, esea_link_in_t;\n"
        "typedef int esea_link_out_t, esea_link_wanted_t, ESEA_FAULT;\n"
        "#define ESEA_FAULT_PROCESSOR 3\n#define ESEA_LINK_TASKS 1\n"
        "#define ESEA_LINK_MEASURED 1\n#define ESEA_LINK_TICK_US 1000\n"
        "typedef int mavlink_signing_t, mavlink_signing_streams_t;\n"
        "#define ESEA_LINK_STREAMS 1\n#define ESEA_LINK_STREAM_WORDS 1\n"
        "#define ESEA_LINK_KEY_WORDS 1\n#define ESEA_LINK_PARAMETERS 0u\n"
        "#define MAVLINK_MAX_PACKET_LEN 280\n"
        "#define ESEA_LINK_SYSTEM 1u\n#define ESEA_LINK_COMPONENT 1u\n"
        "#define ESEA_LINK_AXES 0u\n#define ESEA_LINK_COUPLINGS 0u\n#define ESEA_LINK_ENCODERS 0u\n"
    )
    rng = Random(5)
    orders = [(1023, 0), (1, 0), (1, 0), (5, 3), (4, 4096), (3000, 10), (0, 4096), (7, 7)]
    orders += [(rng.randrange(900), rng.randrange(900)) for _ in range(60)]
    flags = (f"-I{firmware}/app", f"-I{firmware}/port", f"-I{tmp_path}", f"-DSTART={start}u")
    program = rig.compiled(
        tmp_path, RING.format(firmware=firmware), *flags, '-DESEA_LINK_HEADER="fake_link.h"'
    )
    lines = rig.said_by(program, "\n".join(f"{a} {b}" for a, b in orders))
    # A queue of 1024 that refuses what does not fit.
    queue: deque[int] = deque()
    lost = sent = 0
    assert len(lines) == len(orders)
    for (arrived, taken), line in zip(orders, lines, strict=True):
        for _ in range(arrived):
            if len(queue) < 1024:
                queue.append(sent * 7 % 256)
            else:
                lost += 1
            sent += 1
        got = [queue.popleft() for _ in range(min(taken, len(queue)))]
        assert line.split() == [f"{lost}:", *map(str, got)]
    assert lost > 1000


# -- registers -------------------------------------------------------------------------------------

BAUD = 115200


def test_the_mps2_board_sends_at_115200_baud(tmp_path):
    require_tool("gcc")
    found = rig.registers_after_start(tmp_path, "mps2-an385")
    # CMSDK UART: the clock of 25 MHz over the baud rate; 16 at least.
    divisor = found[0x40004010]
    assert divisor == round(25e6 / BAUD)
    assert abs(25e6 / divisor / BAUD - 1) < 0.005
    assert found[0x40004008] == (1 << 0) | (1 << 1) | (1 << 3)
    assert found[0xE000E100] == 1
    assert found[0xE000E400] == 0x20
    assert (found[0x40000000], found[0x40000008]) == (1, 2**32 - 1)
