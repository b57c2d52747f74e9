"""Emitted C beside its Blocks: time, threads, copies of the state, identity.

The device is the elbow's drive: sensing every ms, control every 5 ms, released after 1 ms.  Counts
were recorded in closed loop, so that a real command reaches the motor.
"""

import re
import shutil
import subprocess
from functools import cache

import numpy as np
import pytest

from esea_gen.control.limits.faults import Fault
from esea_gen.device import load_device
from esea_gen.emit.build import render_device
from esea_gen.hostlib.library import compile_device
from esea_gen.model.sensing import zeros_missing
from tests.conftest import require_tool

AT = 201  # the command is large here, and no fault


@pytest.fixture(scope="module")
def library(drive):
    """The drive's C by number format, each compiled once; every board has a state of its own."""
    return cache(lambda real: compile_device(drive, real))


def zeroed(compiled):
    return compiled.board(zeros_missing(compiled.system))


class Run:
    """The drive's C or its symbols, tick by tick, with a schedule that a test bends."""

    def __init__(self, board, given):
        self.board, self.given = board, given
        self.u, self.fault = [], []

    def tick(self, tick, *, data=None, control=True, late=False, stop=False):
        """One base tick; ``late``: the control run of this tick comes two ticks later."""
        self.board.release(tick)
        k = tick if data is None else data
        x = {n: v[k] for n, v in self.given["sense"].items()}
        y = self.board.step("sense", **(x | {"stop": 1.0} if stop else x))
        if tick % 5 == 0 and control and not late:
            self.control(k)
        if tick % 5 == 2 and late:
            self.control(k)
        self.u.append(float(y["u_Nm"]))
        self.fault.append(int(y["fault"]))
        return self.u[-1], self.fault[-1]

    def control(self, k):
        self.board.step("control", **{n: v[k // 5] for n, v in self.given["control"].items() if n})

    def until(self, last):
        for tick in range(last):
            self.tick(tick)
        assert self.fault[-1] == 0
        assert abs(self.u[-1]) > 0.01
        return self


@pytest.fixture(params=[pytest.param("f64", marks=pytest.mark.ci), "f32", "q31", "symbols"])
def run(request, drive, library, recorded):
    if request.param == "symbols":
        return Run(drive.system.simulator(zeros_missing(drive.system)), recorded)
    require_tool("gcc")
    return Run(zeroed(library(request.param)), recorded)


# -- time ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("next_tick", [AT - 1, AT - 2, 0, AT + 1, AT + 200])
def test_a_tick_out_of_order_latches_at_once(run, next_tick):
    run.until(AT)
    assert run.tick(next_tick, data=AT) == (0.0, Fault.CLOCK)
    assert run.tick(next_tick + 1, data=AT + 1) == (0.0, Fault.CLOCK)


def test_the_first_tick_may_be_any(run):
    for tick in range(5000, 5000 + AT):
        run.tick(tick, data=tick - 5000)
    assert run.fault[-1] == 0


def test_late_control_runs_are_bridged_eleven_times_and_then_latch(run):
    """Each run ends two ticks after its start, one after its release; stamps keep coming."""
    run.until(200)
    # By hand: at the n-th late release stand 16 n - 5 (n - 1): 126 at the 11th, 137 at the 12th.
    late_at = [201 + 5 * n for n in range(12)]  # releases of the runs that start at 200, 205, ...
    for tick in range(200, 260):
        run.tick(tick, late=True)
    first = 200 + int(np.flatnonzero(run.fault[200:])[0])
    assert first == late_at[-1]
    assert run.fault[first] == Fault.LATE
    assert run.u[first] == 0


@pytest.mark.parametrize(("every", "latches"), [(20, False), (10, True)])
def test_late_runs_now_and_then(run, every, latches):
    """16 for each late run less 1 a tick: one in 20 ticks never adds up, one in 10 does.

    By hand: after run n of one in 10 stand n * 16 - (n - 1) * 10; the 19th makes 124, the 20th 130,
    above 128.
    """
    run.until(200)
    for tick in range(200, 200 + 22 * every):
        start = tick // 5 * 5
        run.tick(tick, late=(start - 200) % every < 5)
    found = np.flatnonzero(np.array(run.fault[200:]) == Fault.LATE)
    # The recorded motion goes on: nothing else may latch.
    assert set(run.fault[200:]) <= ({0, int(Fault.LATE)} if latches else {0})
    assert found[:1].tolist() == ([19 * every + 1] if latches else [])


def test_the_watch_counts(library, recorded):
    require_tool("gcc")
    board = zeroed(library("f32"))
    run = Run(board, recorded).until(200)
    run.tick(203, data=200)  # three lost
    for tick in (204, 206, 207):
        run.tick(tick, data=200, control=False)  # the run of 205 was lost with its tick
    watch = board.state.watch
    assert (watch.n_clock, watch.tick, watch.known) == (2, 207, 1)
    assert watch.n_sense_late == 0
    run.tick(208, data=200)
    run.tick(209, data=200)
    run.tick(210, data=200, control=False)
    run.tick(211, data=200)
    assert watch.n_control_late == 1
    board.release(212)  # no sensing at 212
    board.release(213)
    assert watch.n_sense_late == 1


# -- copies of the state ---------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["f32", "q31"])
def test_no_part_of_an_old_state_releases_the_latch(library, recorded, real):
    """An old state whole, up to any byte or from it on, and the rest as it is after a stop."""
    require_tool("gcc")
    board = zeroed(library(real))
    run, memory = Run(board, recorded).until(AT), board.library.ffi.buffer(board.state)
    old = bytes(memory)
    for tick in range(AT, AT + 3):
        run.tick(tick, stop=True)
    now = bytes(memory)
    for cut in range(len(now) + 1):
        for torn in (old[:cut] + now[cut:], now[:cut] + old[cut:]):
            memory[:] = torn
            u, fault = zip(*(run.tick(AT + k) for k in range(3, 9)), strict=True)
            assert not any(u), cut
            assert all(fault), cut
            assert torn != old or set(fault) == {Fault.CLOCK}


@pytest.mark.parametrize("real", ["f32", "q31"])
def test_resume_starts_latched_and_keeps_the_estimates(library, recorded, real):
    require_tool("gcc")
    board = zeroed(library(real))
    run = Run(board, recorded).until(AT)
    kept = bytes(board.library.ffi.buffer(board.state))
    velocity = board.library.ffi.buffer(board.library.ffi.addressof(board.state, "velocity"))
    before = bytes(velocity)
    run.tick(AT, stop=True)
    board.library.ffi.buffer(board.state)[:] = kept
    assert bytes(velocity) == before
    board.call("resume", *board.coeffs, board.state)
    assert bytes(velocity) == before
    for k in range(5):
        assert run.tick(9000 + k, data=AT) == (0.0, Fault.NOT_ARMED)
    assert board.state.watch.n_clock == 0


# -- coefficients ----------------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["f32", "f64", "q31"])
def test_a_changed_word_of_the_coefficients_latches(library, recorded, real):
    """Every word of them, by every byte: seen by the next control run, 4 ticks on, and released."""
    require_tool("gcc")
    board = zeroed(library(real))
    run = Run(board, recorded).until(AT)
    ffi = board.library.ffi
    (coeffs,) = board.coeffs
    # Not the limits' own: those latch at once, with their own reason.
    members = [n for n in dir(coeffs) if n not in ("limits", "check")]
    state = bytes(ffi.buffer(board.state))
    for name in members:
        part = ffi.buffer(ffi.addressof(coeffs, name))
        for at in range(len(part)):
            held = part[at]
            ffi.buffer(board.state)[:] = state
            part[at] = bytes([held[0] ^ 0x10])
            for k in range(6):
                u, fault = run.tick(AT + k)
            part[at] = held
            assert u == 0, (name, at)
            assert fault != 0, (name, at)


def test_a_change_that_no_block_notices_has_a_name(library, recorded):
    require_tool("gcc")
    board = zeroed(library("f32"))
    run = Run(board, recorded).until(AT)
    # The checksum itself: nothing else reads it.
    board.coeffs[0].check ^= 1
    found = [run.tick(AT + k)[1] for k in range(7)]
    # Control runs at 205, its word is released at 206.
    assert found == [0, 0, 0, 0, 0, Fault.COEFFICIENTS, Fault.COEFFICIENTS]


# -- identity --------------------------------------------------------------------------------------


def written(device, real, folder):
    folder.mkdir()
    for name, text in render_device(device, [real])[0].files.items():
        if not name.startswith("reference/"):
            (folder / name).write_text(text)
    return folder


def linked(folder, objects, header):
    """The example of one folder against the objects of another."""
    sources = sorted(p for p in objects.glob("*.c") if p.name != "main.c")
    command = [
        "gcc", "-std=c99", "-O1", "-ffp-contract=off", f"-I{header}", str(folder / "main.c"),
    ]  # fmt: skip
    made = []
    for source in sources:
        made.append(folder / f"{source.stem}.o")
        subprocess.run(
            ["gcc", "-std=c99", "-O0", "-c", f"-I{objects}", str(source), "-o", str(made[-1])],
            check=True,
        )
    return subprocess.run(
        [*command, *map(str, made), "-lm", "-o", str(folder / "image")],
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_header_links_with_its_own_c_only(tmp_path):
    require_tool("gcc")
    device = load_device("elbow")
    f32, f64 = (written(device, real, tmp_path / real) for real in ("f32", "f64"))
    assert linked(f32, f32, f32).returncode == 0
    mixed = linked(f32, f64, f32)
    assert mixed.returncode != 0
    assert re.search(r"undefined reference to `esea_elbow_init_f32_[0-9a-f]{16}'", mixed.stderr)


def test_two_devices_in_one_image(tmp_path):
    require_tool("gcc")
    folders = [written(load_device(n), "f32", tmp_path / n) for n in ("elbow", "knee")]
    program = tmp_path / "both.c"
    program.write_text("""
#include <stdio.h>
#include "esea_elbow.h"
#include "esea_knee.h"
int main(void)
{
    puts(ESEA_ELBOW_IDENTITY);
    puts(ESEA_KNEE_IDENTITY);
    return 0;
}
""")
    sources = {}
    for folder in folders:
        sources |= {p.name: p for p in folder.glob("*.c") if p.name != "main.c"}
    subprocess.run(
        ["gcc", "-std=c99", *(f"-I{f}" for f in folders), str(program), *map(str, sources.values()),
         "-o", str(tmp_path / "both")],
        check=True,
    )  # fmt: skip
    told = subprocess.run([str(tmp_path / "both")], capture_output=True, text=True, check=True)
    assert [re.sub("[0-9a-f]{16}", "HASH", x) for x in told.stdout.split("\n")[:2]] == [
        "f32 HASH"
    ] * 2


# -- threads ---------------------------------------------------------------------------------------

HARNESS = r"""
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include "esea_elbow_drive.h"

/* Relaxed on purpose: what orders the tasks' data is the generated C, not this harness. */
#define TELL(word, value) __atomic_store_n(&(word), (value), __ATOMIC_RELAXED)
#define ASK(word) __atomic_load_n(&(word), __ATOMIC_RELAXED)

static const esea_elbow_drive_sense_in_t stream[] = {
#include "stream.h"
};
enum { TICKS = sizeof stream / sizeof stream[0] };
static esea_elbow_drive_params_t params;
static esea_elbow_drive_coeffs_t coeffs;
static esea_elbow_drive_state_t state;
static uint32_t asked, done;

static void *control(void *none)
{
    esea_elbow_drive_control_in_t in;
    esea_elbow_drive_control_out_t out;
    uint32_t run = 0u;

    memset(&in, 0, sizeof in);
    while (run < (TICKS + 4u) / 5u) {
        if (ASK(asked) == run)
            continue;
        esea_elbow_drive_control_step(&coeffs, &state, &in, &out);
        TELL(done, ++run);
    }
    return none;
}

int main(void)
{
    esea_elbow_drive_sense_out_t out;
    pthread_t thread;
    uint32_t tick;

    esea_elbow_drive_default_params(&params);
    params.encoder_motor.zeroed = params.encoder_load.zeroed = 1.0f;
    if (esea_elbow_drive_prepare(&params, &coeffs) != 0u)
        return 2;
    esea_elbow_drive_init(&coeffs, &state);
    if (pthread_create(&thread, NULL, control, NULL) != 0)
        return 2;
    for (tick = 0u; tick < TICKS; ++tick) {
        esea_elbow_drive_release(&state, tick);
        if (tick % ESEA_ELBOW_DRIVE_CONTROL_EVERY == 0u)
            TELL(asked, tick / ESEA_ELBOW_DRIVE_CONTROL_EVERY + 1u);
        esea_elbow_drive_sense_step(&coeffs, &state, &stream[tick], &out);
        printf("%a %u\n", (double)out.u_Nm, (unsigned)out.fault);
        while (ASK(done) != tick / ESEA_ELBOW_DRIVE_CONTROL_EVERY + 1u) {
        }
    }
    pthread_join(thread, NULL);
    return 0;
}
"""


def threaded(drive, library, recorded, folder, *flags):
    source = written(drive, "f32", folder)
    board = zeroed(library("f32"))
    packed = board.library.task("sense").pack({n: v[:400] for n, v in recorded["sense"].items()})
    rows = ["{ " + ", ".join(f"{float(v).hex()}f" for v in row) + " }," for row in packed]
    (source / "stream.h").write_text("\n".join(rows) + "\n")
    (source / "main.c").write_text(HARNESS)
    image = source / "image"
    subprocess.run(
        ["gcc", "-std=gnu11", "-O2", "-flto", "-ffp-contract=off", *flags, f"-I{source}",
         *map(str, sorted(source.glob("*.c"))), "-lpthread", "-o", str(image)],
        check=True, capture_output=True,
    )  # fmt: skip
    # Address layout that the thread sanitizer's shadow does not know is left out.
    fixed = [shutil.which("setarch"), "-R"] if shutil.which("setarch") else []
    return subprocess.run(
        [*fixed, str(image)], capture_output=True, text=True, check=False, timeout=120
    )


def sequential(library, recorded):
    run = Run(zeroed(library("f32")), recorded)
    for tick in range(400):
        run.tick(tick)
    return [f"{u.hex()} {f}" for u, f in zip(run.u, run.fault, strict=True)]


def same(lines, expected):
    def parsed(rows):
        return [(float.fromhex(a), int(b)) for a, b in (row.split() for row in rows)]

    return parsed(lines) == parsed(expected)


@pytest.mark.ci
@pytest.mark.parametrize("flags", [(), ("-fsanitize=thread", "-g")], ids=["lto", "lto, tsan"])
def test_tasks_in_threads_give_the_same_bits_and_no_race(drive, library, recorded, tmp_path, flags):
    require_tool("gcc")
    done = threaded(drive, library, recorded, tmp_path / "c", *flags)
    assert done.returncode == 0, done.stderr[:2000]
    assert "WARNING: ThreadSanitizer" not in done.stderr
    assert same(done.stdout.splitlines(), sequential(library, recorded))
