"""Firmware: the application natively under sanitizers, and the image in the emulator."""

from __future__ import annotations

import os
import re
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from esea_gen.board.emulator import RunningBoard, find_qemu, first_difference
from esea_gen.board.firmware import build_firmware, double_arithmetic, double_helpers
from esea_gen.device import parse_device
from esea_gen.emit.build import render_device
from esea_gen.errors import UserError
from esea_gen.hostlib import compile_device
from esea_gen.link.kept import kept_values
from esea_gen.link.transport import LinkError
from esea_gen.targets import BOARDS, find_board, firmware_folder
from tests.firmware_harness import run_in_emulator

STEPS = 2000


def need(*tools: str) -> None:
    """Skip without the tools; with ESEA_REQUIRE_TOOLS=1, fail."""
    missing = [t for t in tools if shutil.which(t) is None]
    if missing and os.environ.get("ESEA_REQUIRE_TOOLS") == "1":
        pytest.fail(f"not installed: {', '.join(missing)}")
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)}")


def chirp(steps: int = STEPS) -> np.ndarray:
    """Deflection that sweeps, reverses, jumps out of range, and is at times no number at all."""
    t_s = np.arange(steps) * 1e-3
    theta_rad = (0.2 * np.sin(2 * np.pi * (0.2 + 1.5 * t_s) * t_s)).astype(np.float32)
    bad = [np.nan, np.inf, -np.inf, -np.nan, 3.4e38, -0.0, 1e-40, 0.4, -0.34999999]
    theta_rad[np.linspace(steps // 10, steps - 5, len(bad)).astype(int)] = bad
    return theta_rad


def altered(device, find: str, put: str) -> dict[str, str]:
    """The device's f32 files with one place changed, in whichever file it stands."""
    files = dict(render_device(device, ["f32"])[0].files)
    changed = {n: re.sub(find, put, t, count=1) for n, t in files.items() if n.endswith(".c")}
    hit = [n for n, t in changed.items() if t != files[n] and n != "main.c"]
    assert hit, f"no file has {find}"
    files[hit[0]] = changed[hit[0]]
    return files


STEP_BODY = r"(void esea_elbow_sense_step\([^{]*\{)"


@pytest.fixture(scope="module")
def native(elbow, tmp_path_factory):
    need("gcc")
    return build_firmware(elbow, "host", tmp_path_factory.mktemp("host"))


@pytest.fixture(scope="module")
def image(elbow, tmp_path_factory):
    need("arm-none-eabi-gcc")
    return build_firmware(elbow, "netduinoplus2", tmp_path_factory.mktemp("image"))


@pytest.fixture
def board(elbow, native):
    with RunningBoard(elbow, native) as running:
        yield running


def expected_of(elbow, theta_rad):
    return compile_device(elbow, "f32").task("sense").run({"theta_rad": theta_rad}, trace=False)[0]


def step(board, sequence: int, theta_rad: float):
    board.send(board.dialect.MAVLink_esea_sense_in_message(sequence, theta_rad))
    return board.wait_for("ESEA_SENSE_OUT")


# -- the application, natively, with address and undefined-behaviour sanitizers -------------------


def test_board_says_ready_before_the_host_speaks(board):
    assert board.state() == "READY"
    assert board.heartbeat.system_status == board.dialect.MAV_STATE_STANDBY


def test_every_bit_equals_the_host_library(elbow, native):
    result = run_in_emulator(elbow, native, {"theta_rad": chirp()})
    assert result.identical, result.first_difference
    assert result.hash_matches
    assert result.steps == STEPS
    assert result.instructions == {}


def test_first_input_starts_running_and_reset_stops(board):
    first = step(board, 0, 0.1)
    step(board, 1, -0.1)
    assert step(board, 2, 0.1).tau_Nm != first.tau_Nm
    assert board.info().steps == 3
    assert board.command(board.dialect.MAV_CMD_REQUEST_MESSAGE, 0) == 0
    board.wait_for("HEARTBEAT")
    assert board.state() == "REPLAY"
    board.reset()
    assert board.info().steps == 0
    assert step(board, 0, 0.1).tau_Nm == first.tau_Nm


def test_invalid_deflection_is_flagged_and_does_not_poison_the_state(board, elbow):
    stream = np.float32([0.05, np.nan, 0.05, np.inf, 0.06])
    expected = expected_of(elbow, stream)
    for k, theta_rad in enumerate(stream):
        out = step(board, k, float(theta_rad))
        assert out.tau_Nm == expected["tau_Nm"][k]
        flag = board.dialect.ESEA_ELBOW_SENSOR_STATUS_INPUT_INVALID
        assert bool(out.sensor_status & flag) == (not np.isfinite(theta_rad))


def test_noise_is_passed_over(board, elbow):
    rng = np.random.default_rng(7)
    # Without the two start bytes noise cannot hide a frame, so that no input is lost.
    noise = bytes(b for b in rng.integers(0, 256, 5000).astype(np.uint8) if b not in (0xFD, 0xFE))
    for k, theta_rad in enumerate(np.float32([0.01, 0.02, 0.03])):
        board.send_bytes(noise)
        assert step(board, k, float(theta_rad)).sequence == k
    assert board.info().sequence_gaps == 0


def test_noise_with_start_bytes_costs_frames_but_not_the_link(board):
    board.send_bytes(np.random.default_rng(8).integers(0, 256, 20000).astype(np.uint8).tobytes())
    board.send_bytes(bytes(600))  # whatever frame the noise began is over after these
    assert board.command(board.dialect.MAV_CMD_USER_1) == board.dialect.MAV_RESULT_ACCEPTED
    info = board.info()
    assert info.bad_frames + info.unknown_messages > 0
    assert info.steps == 0


def test_unknown_messages_are_counted(board):
    from pymavlink.dialects.v20 import common

    stranger = common.MAVLink(None, 255, 190)
    board.send_bytes(common.MAVLink_system_time_message(1, 2).pack(stranger))
    # Of the dialect, but spoken by boards only.
    told = board.dialect.MAVLink_esea_sense_out_message
    board.send(told(*[0] * len(told.fieldnames)))
    assert board.info().unknown_messages == 2


def test_sequence_gap_is_counted_and_the_step_taken(board):
    for sequence in (0, 1, 5, 6, 6, 2**32 - 1, 0):
        assert step(board, sequence, 0.0).sequence == sequence
    info = board.info()
    assert info.sequence_gaps == 3  # 1 to 5, 6 to 6, 6 to 2**32 - 1; the wrap to 0 is none
    assert info.steps == 7


def test_commands_are_answered_by_their_result(board):
    dialect = board.dialect
    assert board.command(401) == dialect.MAV_RESULT_UNSUPPORTED
    request = dialect.MAV_CMD_REQUEST_MESSAGE
    assert board.command(request, float("nan")) == dialect.MAV_RESULT_DENIED
    assert board.command(request, 31.0) == dialect.MAV_RESULT_DENIED
    # A command for another system is not answered.
    board.send(dialect.MAVLink_command_long_message(9, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0))
    with pytest.raises(LinkError, match="silent"):
        board.receive(timeout_s=0.2)


def test_exhausted_stack_latches_a_fault_and_no_step_is_taken(elbow, native):
    with RunningBoard(elbow, native, options=["--stack-exhausted"]) as board:
        assert board.state() == "FAULT"
        assert board.heartbeat.system_status == board.dialect.MAV_STATE_CRITICAL
        assert board.fault().startswith("STACK_EXHAUSTED")
        with pytest.raises(LinkError, match="STACK_EXHAUSTED"):
            board.run_tasks({"sense": {"theta_rad": chirp(10)}})
        assert board.info().steps == 0
        with pytest.raises(LinkError, match="cannot reset: STACK_EXHAUSTED"):
            board.reset()


def test_refused_default_latches_a_fault(elbow, tmp_path):
    need("gcc")
    control = altered(elbow, r"(params->velocity\.bandwidth_Hz = )[\d.]+f", r"\g<1>1e9f")
    with RunningBoard(elbow, build_firmware(elbow, "host", tmp_path, control)) as board:
        assert board.fault().startswith("PREPARE_REFUSED")


# -- comparison ------------------------------------------------------------------------------------


def test_first_difference_compares_bits_not_values():
    zero = {"a_Nm": np.float32([0.0, 1.0, np.nan]), "word": np.uint32([1, 2, 3])}
    assert first_difference(zero, zero) is None
    found = first_difference(zero | {"a_Nm": np.float32([-0.0, 1.0, np.nan])}, zero)
    assert (found.step, found.output, found.board) == (0, "a_Nm", "0x80000000")
    assert first_difference(zero | {"word": np.uint32([1, 2, 7])}, zero).step == 2
    with pytest.raises(ValueError, match="against"):
        first_difference(zero, {"a_Nm": zero["a_Nm"]})
    with pytest.raises(ValueError, match="float64"):
        first_difference(zero | {"a_Nm": np.zeros(3)}, zero)


def test_one_unit_in_the_last_place_of_one_constant_is_found(elbow, tmp_path):
    need("gcc")
    # The sensor's final clip at 20 Nm would never bite: alter the cubic stiffness instead.
    files = dict(render_device(elbow, ["f32"])[0].files)
    text = files["esea_elbow_sensor.c"]
    assert re.search(r"\b239\.0f\b", text), "the cubic stiffness stands in the sensor's step"
    bumped = np.nextafter(np.float32(239.0), np.float32(300.0))
    files["esea_elbow_sensor.c"] = text.replace("239.0f", f"{bumped:.9g}f", 1)
    image = build_firmware(elbow, "host", tmp_path, files)
    result = run_in_emulator(elbow, image, {"theta_rad": chirp(300)})
    assert not result.identical
    assert result.first_difference.output in ("tau_Nm", "tau_spring_Nm")
    assert result.to_dict()["first_difference"]["board"].startswith("0x")


# -- the build ------------------------------------------------------------------------------------


def test_unknown_board_is_refused_with_the_list(elbow, tmp_path):
    with pytest.raises(UserError, match="netduinoplus2"):
        build_firmware(elbow, "arduino", tmp_path)


def test_more_bits_than_the_boards_encoders_send_are_refused(drive, tmp_path):
    """Before the compiler; and the C has the same limits."""
    text = drive.toml()
    for key, now, most in (("resolution_bits", 12, 14), ("encoder_bits", 17, 24)):
        wide = text.replace(f"\n{key} = {{ value = {now}", f"\n{key} = {{ value = {most + 1}", 1)
        assert wide != text
        said = rf"\.{key} = {most + 1} is above {most}, .* Give {most} .*mps2-an500"
        with pytest.raises(UserError, match=said):
            build_firmware(parse_device(wide, "mine.toml"), "netduinoplus2", tmp_path)
    drivers = (firmware_folder() / "boards/netduinoplus2/drivers.c").read_text()
    in_c = re.findall(r"#if ESEA_(?:ENCODER|GEAR)_BITS > (\d+)\n#error", drivers)
    assert [int(x) for x in in_c] == [n for _, n in find_board("netduinoplus2").most_bits]


def test_missing_tools_are_named_with_their_package(elbow, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="gcc-arm-none-eabi libnewlib-arm-none-eabi"):
        build_firmware(elbow, "netduinoplus2", tmp_path)
    with pytest.raises(UserError, match="qemu-system-arm"):
        find_qemu()


def test_output_is_whole_or_not_at_all(elbow, tmp_path):
    need("gcc")
    broken = altered(elbow, STEP_BODY, r"\1 not C at all;")
    out = tmp_path / "out"
    with pytest.raises(RuntimeError, match="esea_elbow"):
        build_firmware(elbow, "host", out, broken)
    assert not out.exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        build_firmware(elbow, "host", tmp_path / "file")


def test_image_is_the_same_bytes_again(elbow, image, tmp_path):
    again = build_firmware(elbow, "netduinoplus2", tmp_path)
    assert again.elf.read_bytes() == image.elf.read_bytes()


def test_image_needs_neither_double_nor_heap(image):
    assert double_helpers(image.elf) == []
    listed = subprocess.run(
        ["arm-none-eabi-nm", "-P", image.elf], capture_output=True, text=True, check=True
    ).stdout
    names = {line.split()[0] for line in listed.splitlines()}
    assert not names & {"malloc", "free", "_sbrk", "printf", "sqrtf", "powf", "sinf"}
    assert "esea_elbow_sense_step" in names


@pytest.mark.parametrize(
    ("code", "symbol"),
    [
        ("double f(double a, double b) { return a * b; }", "__aeabi_dmul"),
        ("float f(float a) { return a * 0.1; }", "__aeabi_f2d"),
        ("float sinf(float); float f(float a) { return sinf(a); }", "sinf"),
        ("void *malloc(unsigned); void *f(void) { return malloc(4); }", "malloc"),
    ],
)
def test_gate_against_double_and_libraries_is_armed(tmp_path, code, symbol):
    need("arm-none-eabi-gcc", "arm-none-eabi-nm")
    (tmp_path / "a.c").write_text(code)
    flags = BOARDS["netduinoplus2"].compile_flags
    command = ["arm-none-eabi-gcc", *flags, "-O2", "-c", "a.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert f"a.o: {symbol}" in double_arithmetic([tmp_path / "a.o"])


# -- the image in the emulator ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def emulated(elbow, image):
    need("qemu-system-arm")
    return run_in_emulator(elbow, image, {"theta_rad": chirp()})


def test_emulated_stream_equals_the_host_bit_for_bit(emulated, elbow):
    assert emulated.identical, emulated.first_difference
    assert emulated.steps == STEPS
    # The stream did go through the guards, and through torque.
    assert np.count_nonzero(expected_of(elbow, chirp())["sensor_status"]) > 5
    assert np.abs(emulated.outputs["tau_Nm"]).max() > 1
    for name in ("sequence_gaps", "bad_frames", "unknown_messages", "lost_bytes"):
        assert getattr(emulated, name) == 0


@pytest.mark.ci
def test_instruction_count_repeats_and_agrees_with_a_second_way(elbow, image, emulated, tmp_path):
    need("gcc", "arm-none-eabi-nm")
    plugin = tmp_path / "count.so"
    source = firmware_folder() / "tools" / "count_instructions.c"
    subprocess.run(["gcc", "-shared", "-fPIC", source, "-o", plugin], check=True)
    listed = subprocess.run(
        ["arm-none-eabi-nm", "-S", image.elf], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split() for line in listed.splitlines()]
    control = {
        r[3]: (int(r[0], 16), int(r[1], 16))
        for r in rows
        if len(r) == 4 and r[2] in "tT" and re.match(r"esea_(elbow_(?!f32_)|f32_)|exp2", r[3])
    }
    low = min(at for at, _ in control.values())
    high = max(at + size for at, size in control.values())
    entry = control["esea_elbow_sense_step"][0]
    log = tmp_path / "log"
    arguments = f"{plugin},entry={entry},low={low},high={high},each=1"
    again = run_in_emulator(
        elbow,
        image,
        {"theta_rad": chirp()},
        options=["-d", "plugin", "-D", str(log), "-plugin", arguments],
    )
    assert np.array_equal(again.step_instructions, emulated.step_instructions)
    # Before the stream come the self-test and runs on the board's own clock.
    runs = np.array([int(n) for n in re.findall(r"run (\d+)", log.read_text())])[-STEPS:]
    # The timer's count has the call's argument set-up in it: the same few at every step.
    call = emulated.step_instructions - runs
    assert 0 <= call[0] <= 8
    assert np.array_equal(call, np.full(STEPS, call[0]))


def test_emulated_reset_and_noise(elbow, image):
    need("qemu-system-arm")
    stream = {"theta_rad": chirp(60)}
    with RunningBoard(elbow, image) as board:
        first, _ = board.run_tasks({"sense": stream})
        board.send_bytes(b"\x00\x55\xaa noise that is no frame" * 20)
        board.send_bytes(struct.pack("<BB", 0xFD, 4) + bytes(40))
        board.reset()
        second, _ = board.run_tasks({"sense": stream})
        info = board.info()
        said = kept_values(board)
    assert first_difference(first["sense"], second["sense"]) is None
    assert info.steps == 60
    assert info.bad_frames + info.unknown_messages > 0
    # QEMU knows no PLL: the image stays at its first clock, and says so whenever it is asked.
    assert said[2] == ("clock: 16 MHz, the PLL did not lock",)


@pytest.mark.parametrize(
    "fault",
    [
        "__builtin_trap();",
        "*(volatile unsigned *)0x60000000 = 1u;",
        # Behind the compiler's back: what it sees is bounded, and refused at the build.
        '__asm__ volatile("mov r3, sp; sub.w sp, sp, #9216; push {r3}; mov sp, r3" ::: "r3");',
    ],
    ids=["undefined instruction", "no memory there", "stack overflow"],
)
def test_processor_fault_is_told_and_halts(elbow, tmp_path, fault):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    control = altered(elbow, STEP_BODY, rf"\1 {fault}")
    image = build_firmware(elbow, "netduinoplus2", tmp_path, control)
    with pytest.raises(LinkError, match="fault exception"), RunningBoard(elbow, image) as board:
        step(board, 0, 0.1)


def test_emulator_that_does_not_start_says_why(elbow, image):
    need("qemu-system-arm")
    nowhere = replace(image, elf=Path("no-such-image.elf"))
    with pytest.raises(LinkError, match=r"no-such-image\.elf"), RunningBoard(elbow, nowhere):
        pass


@pytest.mark.ci
def test_a_cortex_m7_gives_the_hosts_bits_though_it_has_doubles(elbow, tmp_path):
    need("gcc", "arm-none-eabi-gcc", "arm-none-eabi-objdump", "qemu-system-arm")
    image = build_firmware(elbow, "mps2-an500", tmp_path)
    run = run_in_emulator(elbow, image, {"theta_rad": chirp(300)})
    assert run.identical, run.first_difference
    assert run.board == "mps2-an500"
    # Of double arithmetic there is no helper to miss: its instructions would be the slip.
    text = subprocess.run(
        ["arm-none-eabi-objdump", "-d", image.elf], capture_output=True, text=True, check=True
    ).stdout
    assert ".f32" in text
    assert not re.search(r"\bv(add|sub|mul|div|sqrt|fma|mla)\.f64\b", text)


@pytest.mark.ci
def test_objects_that_were_kept_give_the_same_image(elbow, image, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    first = build_firmware(elbow, "netduinoplus2", tmp_path / "first")
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "cache").rglob("*.o")}
    assert len(kept) > 20
    again = build_firmware(elbow, "netduinoplus2", tmp_path / "again")
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "cache").rglob("*.o")} == kept
    assert first.elf.read_bytes() == again.elf.read_bytes() == image.elf.read_bytes()
    assert again.stack_bounds_bytes == image.stack_bounds_bytes
    # Another sensor is another object, and another header makes every object anew.
    build_firmware(elbow, "netduinoplus2", tmp_path / "c", altered(elbow, "0.001f", "0.0011f"))
    assert 0 < len(set((tmp_path / "cache").rglob("*.o")) - set(kept)) < 4
