"""A board with Linux: the daemon, here and on an emulated Cortex-A9; flat library and package."""

from __future__ import annotations

import io
import re
import signal
import stat
import subprocess
import tarfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.board.emulator import run_tasks_in_emulator
from esea_gen.board.firmware import build_firmware
from esea_gen.cli import app
from esea_gen.emit.build import format_hash
from esea_gen.emit.dialect import load_dialect
from esea_gen.export.model import controller_model
from esea_gen.export.package import build_package
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError, PtyTransport, TcpTransport
from esea_gen.twin.recorded import record_drive
from tests.conftest import require_tool

pytestmark = pytest.mark.ci

TICKS = 450
LOADER = r"""
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define GET(name, call, given) \
    int32_t (*name) given = (int32_t (*) given)dlsym(library, PREFIX "_flat_" call); \
    if (!name) return 3

/* Rows of inputs in, rows of outputs out, as doubles. */
int main(int argc, char **argv)
{
    void *const library = dlopen(argv[1], RTLD_NOW);
    static const int zeroed[] = { ZEROED };
    double tunables[256], in[256], out[256], bad[256];
    int32_t counts[5];
    uint8_t text[32];

    if (argc < 2 || !library)
        return 2;
    GET(interface, "interface", (void));
    GET(content_hash, "content_hash", (uint8_t *, int32_t));
    GET(number, "counts", (int32_t *, int32_t));
    GET(defaults, "defaults", (double *, int32_t));
    GET(start, "start", (int32_t, const double *, int32_t));
    GET(change, "change", (int32_t, const double *, int32_t));
    GET(tick, "tick", (int32_t, int32_t, const double *, int32_t, double *, int32_t));
    fprintf(stderr, "%d %d", interface(), content_hash(text, 16));
    fprintf(stderr, " %d", content_hash(text, 17));
    fprintf(stderr, " %s %d %d", text, number(counts, 4), number(counts, 5));
    fprintf(stderr, " %d %d %d %d %d", counts[0], counts[1], counts[2], counts[3], counts[4]);
    fprintf(stderr, " %d %d", defaults(tunables, counts[1] - 1), defaults(tunables, counts[1]));
    fprintf(stderr, " %d", tick(0, 1, in, counts[0], out, counts[2]));
    fprintf(stderr, " %d", start(4, tunables, counts[1]));
    for (size_t i = 0; i < sizeof zeroed / sizeof zeroed[0]; ++i)
        tunables[zeroed[i]] = 1.0;
    memcpy(bad, tunables, sizeof bad);
    bad[4] = 1e6;
    fprintf(stderr, " %d %d", start(0, bad, counts[1]), start(0, tunables, counts[1]));
    fprintf(stderr, " %d %d", change(0, bad, counts[1]), change(1, tunables, counts[1]));
    fprintf(stderr, " %d\n", tick(0, 1, in, counts[0], out, counts[2] - 1));
    const size_t wide = (size_t)counts[0];
    for (int32_t k = 0; fread(in, sizeof in[0], wide, stdin) == wide; ++k) {
        if (tick(0, k == LOST ? 2 : 1, in, counts[0], out, counts[2]) != 0)
            return 4;
        fwrite(out, sizeof out[0], (size_t)counts[2], stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def device():
    return esea_gen.load_device("elbow_drive")


@pytest.fixture(scope="module")
def native(device, tmp_path_factory):
    require_tool("gcc")
    return build_firmware(device, "host", tmp_path_factory.mktemp("native"))


@pytest.fixture(scope="module")
def arm(device, tmp_path_factory):
    require_tool("arm-linux-gnueabi-gcc")
    require_tool("qemu-arm")
    return build_firmware(device, "myrio", tmp_path_factory.mktemp("arm"))


@contextmanager
def daemon(device, command, *options):
    """The running program and a way to open sessions with it."""
    with subprocess.Popen([*command, *map(str, options)], stderr=subprocess.PIPE, text=True) as run:
        try:
            kind, _, where = run.stderr.readline().split(" at ")[1].strip().partition(":")

            def session():
                host, _, port = where.rpartition(":")
                line = TcpTransport(int(port), host) if kind == "tcp" else PtyTransport(where)
                return Session(line, load_dialect(device), 10.0)

            session.where = where
            yield run, session
        finally:
            run.kill()


def told(run):
    """What the histogram says: its first line's numbers, and ticks by upper end."""
    run.send_signal(signal.SIGTERM)
    assert run.wait(10) == 0
    text = run.stderr.read()
    ticks, lost, latest = map(
        int, re.search(r"(\d+) ticks, (\d+) lost, latest (\d+)", text).groups()
    )
    return ticks, lost, latest, {int(e): int(n) for e, n in re.findall(r"[<=] +(\d+): (\d+)", text)}


def test_the_daemon_runs_by_itself_and_says_how_late_it_woke(device, native):
    with daemon(device, [native.elf], "tcp:0") as (run, session):
        one = session()
        assert one.info().board == "host"
        first = one.clock()
        assert first.state == 5  # UNREFERENCED
        run.send_signal(signal.SIGSTOP)
        time.sleep(0.06)
        run.send_signal(signal.SIGCONT)
        later = one.clock()
        assert later.tick - first.tick >= 60
        assert (
            later.lost_ticks - first.lost_ticks >= 50
        )  # known to the application, so to the limits
        run.send_signal(signal.SIGUSR1)
        assert "woke up late" in run.stderr.readline()
        one.close()
        session().close()  # the next host
        ticks, lost, latest, bins = told(run)
    assert sum(bins.values()) == ticks
    assert lost >= 50
    assert latest >= 50_000
    assert max(bins) == 1 << latest.bit_length()


def test_a_host_that_does_not_read_makes_room_for_one_that_does(device, native):
    with daemon(device, [native.elf], "tcp:0") as (run, session):
        deaf = session()
        for pattern in ("sense.*", "sense.*", "sense.*"):  # half a megabyte a second
            deaf.stream([pattern])
        while True:  # until the other is given up
            heard = session()
            with suppress(LinkError):
                assert heard.clock().tick > 1000
                break
            heard.close()
        deaf.close()
        heard.close()
        ticks, lost, _, _ = told(run)
    assert ticks > 5 * lost  # the clock went on meanwhile


def queues(run, session):
    """Bytes that wait in the daemon's connection: to the host, from it."""
    port = f"0100007F:{int(session.where.rpartition(':')[2]):04X}"
    found = re.findall(rf"{port} \S+ 01 (\w+):(\w+)", listening(run))
    return tuple(int(n, 16) for n in found[0])


def wait_full(run, session, looks):
    """Until what waits for the host stays as it is at so many looks in a row.

    Fewer than twenty: after a second the daemon hangs up on who does not read.
    """
    seen = [0]
    while seen[-1] == 0 or len(seen) < looks or set(seen[-looks:]) != {seen[-1]}:
        time.sleep(0.05)
        seen.append(queues(run, session)[0])


def fill(run, session):
    """A host that has everything streamed to it and reads none of it: the line is full."""
    deaf = session()
    for _ in range(3):
        deaf.stream(["sense.*"])
    wait_full(run, session, 4)
    return deaf


def test_a_stop_of_a_host_that_does_not_read_is_taken_at_once(device, native):
    with daemon(device, [native.elf], "tcp:0") as (run, session):
        deaf = fill(run, session)
        deaf.send(deaf.message("COMMAND_LONG", 1, 1, deaf.dialect.MAV_CMD_USER_4, 0, *[0.0] * 7))
        time.sleep(0.3)  # far less than the second for which such a host is borne with
        assert queues(run, session)[1] == 0  # what it said has been read
        deaf.close()
        assert session().clock().state == 10  # STOPPED
        told(run)


def test_what_a_host_is_too_slow_for_is_left_out_whole_and_counted(device, native):
    with daemon(device, [native.elf], "tcp:0") as (run, session):
        slow = fill(run, session)
        dropped = slow.traffic().stream_dropped
        for looks in (6, 8, 10, 12):  # a busy machine's line was still, not full; now it is empty
            if dropped == 0:
                wait_full(run, session, looks)
                dropped = slow.traffic().stream_dropped
        assert dropped > 0
        assert slow.counters.bad_frames == 0
        assert slow.counters.lost_frames == 0
        told(run)


def test_only_this_computer_is_listened_to_unless_told(device, native):
    with daemon(device, [native.elf], "tcp:0") as (run, session):
        session().close()
        (inode,) = re.findall(
            r"0100007F:\w{4} 00000000:0000 0A \S+ \S+ \S+ +0 +0 (\d+)", listening(run)
        )
        assert inode
    with daemon(device, [native.elf], "tcp:0.0.0.0:0") as (run, _):
        assert re.search(r"00000000:\w{4} 00000000:0000 0A", listening(run))


def listening(run):
    """Rows of the sockets that this process holds: others of the machine stand there, too."""
    held = set()
    for link in Path(f"/proc/{run.pid}/fd").iterdir():
        with suppress(FileNotFoundError):
            held.add(str(link.readlink()))
    rows = Path(f"/proc/{run.pid}/net/tcp").read_text().splitlines()[1:]
    return "\n".join(r for r in rows if f"socket:[{r.split()[9]}]" in held)


def refused(image, *options):
    command = [str(x) for x in (image.elf, *options)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    return done.stderr


def test_who_comes_beside_a_host_is_let_go_and_may_stop(device, native):
    """Nothing that it said before is left for later."""
    with daemon(device, [native.elf], "tcp:0") as (run, session):
        first = session()
        assert first.clock().state == 5
        second = session()
        time_of_it = second.message("ESEA_STAMP", 0, *first.time_now(0.0))
        values = (1, 1, second.dialect.MAV_CMD_USER_1, 0, *[0.0] * 7)
        reset = second.message("COMMAND_LONG", *values)
        second.send_bytes(second.pack(time_of_it) + second.pack(reset))
        before = first.clock().tick
        with pytest.raises(LinkError, match=r"commands this board .127\.0\.0\.1:\d+"):
            second.clock()
        first.close()
        first = session()
        assert first.clock().tick >= before
        second = session()
        second.send_bytes(b"\xfd\xff\0\0half a frame")
        second.stop()
        assert first.clock().state == 10
        told(run)


def test_a_file_that_is_kept_is_its_owners_alone(device, native, tmp_path):
    kept, link = tmp_path / "kept", tmp_path / "link"
    kept.touch(0o644)
    link.symlink_to(kept)
    assert "cannot keep anything" in refused(native, "tcp:0", "--keep", link)
    assert "a file of your own" in refused(native, "tcp:0", "--keep", "/dev/null")
    with daemon(device, [native.elf], "tcp:0", "--keep", kept):
        assert stat.S_IMODE(kept.stat().st_mode) == 0o600


def test_what_is_kept_outlasts_a_kill(device, native, tmp_path):
    kept = tmp_path / "kept"
    with daemon(device, [native.elf], "tcp:0", "--keep", kept) as (run, session):
        one = session()
        one.set_parameter("velocity.bandwidth_Hz", 20.0)
        one.save_parameters()
        one.close()
        # Two programs with one memory would spoil it.
        assert "cannot keep anything" in refused(native, "tcp:0", "--keep", kept)
        run.kill()
    with daemon(device, [native.elf], "tcp:0", "--keep", kept) as (_, session):
        assert session().parameter("velocity.bandwidth_Hz") == 20.0


@pytest.mark.parametrize(
    "address", ["tcp:70000", "tcp:", "tcp:here:0", "serial:/dev/null", "udp:1"]
)
def test_an_address_that_is_none_is_refused(native, address):
    assert "give tcp:PORT" in refused(native, address)


def test_the_daemon_on_a_cortex_a9(device, arm):
    with daemon(device, [require_tool("qemu-arm"), arm.elf], "pty") as (run, session):
        one = session()
        info = one.info()
        assert (info.board, info.content_hash) == ("myrio", format_hash(device, "f32"))
        before = one.clock().tick
        time.sleep(0.05)
        assert one.clock().tick > before
        one.close()
        assert told(run)[0] > 0


@pytest.fixture(scope="module")
def drive(device):
    return record_drive(device, TICKS)


def test_both_tasks_give_the_hosts_bits_on_a_cortex_a9(device, arm, drive):
    results = run_tasks_in_emulator(device, arm, drive.inputs)
    assert {t: r.steps for t, r in results.items()} == {"sense": TICKS, "control": TICKS // 5}
    assert all(r.identical and r.hash_matches for r in results.values())


@pytest.fixture(scope="module")
def packed(device, arm, tmp_path_factory):
    return build_package(device, arm, tmp_path_factory.mktemp("packed"))


def run_flat(device, drive, library, folder, lost=-1):
    """Loads the library as LabVIEW does and runs the recorded drive through it."""
    model = controller_model(device)
    zeroed = [str(i) for i, v in enumerate(model.of("tunable")) if v.name.endswith(".zeroed")]
    flags = (f'-DPREFIX="esea_{device.name}"', f"-DLOST={lost}", f"-DZEROED={','.join(zeroed)}")
    (folder / "loader.c").write_text(LOADER)
    gcc = require_tool("arm-linux-gnueabi-gcc")
    subprocess.run([gcc, *flags, "loader.c", "-o", "loader"], cwd=folder, check=True)
    inputs = model.of("input")
    held = {
        n: np.repeat(a, t.every)
        for t in device.system.tasks
        for n, a in drive.inputs[t.name].items()
    }
    rows = np.stack([held[v.name] for v in inputs], axis=1).astype("<f8")
    emulator = [require_tool("qemu-arm"), "-L", "/usr/arm-linux-gnueabi", "./loader", library]
    done = subprocess.run(
        emulator, cwd=folder, input=rows.tobytes(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    outputs = controller_model(device).of("output")
    columns = np.frombuffer(done.stdout, "<f8").reshape(len(rows), len(outputs)).T
    return done.stderr.decode().split(), {v.name: c for v, c in zip(outputs, columns, strict=True)}


def test_the_flat_library_gives_the_hosts_bits(device, drive, packed, tmp_path):
    said, seen = run_flat(device, drive, packed[0], tmp_path)
    digest = format_hash(device, "f32")
    counts = [str(len(controller_model(device).of(r))) for r in ("input", "tunable", "output")]
    # interface; hash too short, then whole; counts too short, then whole; defaults; not started; no
    # instance; the fifth tunable out of range, twice; instance 1 not started; outputs too short.
    assert said == [
        *("1", "-2", "0", digest, "-2", "0", *counts, "4", "1000"),
        *("-2", "0", "-3", "-1", "5", "0", "5", "-3", "-2"),
    ]
    compared = 0
    for task in device.system.tasks:
        for name, column in drive.outputs[task.name].items():
            for i, part in enumerate(np.atleast_2d(column.T)):
                shown = name if column.ndim == 1 else f"{name}[{i + 1}]"
                given = seen[shown][task.phase :: task.every]
                assert given.tobytes() == part.astype("<f8").tobytes(), shown
                compared += 1
    assert compared == len(seen)
    assert np.ptp(seen["tau_Nm"]) > 0.1  # in motion


def test_a_turn_left_out_is_seen_by_the_limits(device, drive, packed, tmp_path):
    _, seen = run_flat(device, drive, packed[0], tmp_path, lost=400)
    assert not seen["fault"][399]
    assert set(seen["fault"][400:]) == {13}  # CLOCK
    assert not seen["u_Nm"][400:].any()


def test_the_library_runs_on_an_older_system(packed):
    """NI's images have an older C library than the one that it is built with."""
    objdump = require_tool("arm-linux-gnueabi-objdump")
    told_ = subprocess.run(
        [objdump, "-T", packed[0]], capture_output=True, text=True, check=True
    ).stdout
    needed = {tuple(map(int, v.split("."))) for v in re.findall(r"GLIBC_([\d.]+)", told_)}
    assert needed
    assert max(needed) <= (2, 24)
    assert "abort" not in told_
    assert set(re.findall(r"F \.text\S*\s+\w+\s+(?:Base\s+)?(\w+)", told_)) == {
        f"esea_elbow_drive_flat_{n}"
        for n in (
            "interface",
            "version",
            "content_hash",
            "counts",
            "defaults",
            "start",
            "change",
            "tick",
        )
    }


def test_one_command_makes_all_of_it_the_same_every_time(arm, packed, tmp_path):
    asked = ["firmware", "elbow_drive", "--board", "myrio", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert {p.name for p in tmp_path.iterdir()} == {p.name for p in (arm.elf, *packed)}
    for one in (arm.elf, *packed):
        assert one.read_bytes() == (tmp_path / one.name).read_bytes(), one.name


def test_the_package_is_whole(device, arm, packed):
    package = packed[2]
    ar = require_tool("ar")

    def part(name):
        return subprocess.run([ar, "p", package, name], capture_output=True, check=True).stdout

    names = subprocess.run([ar, "t", package], capture_output=True, text=True, check=True).stdout
    assert names.split() == ["debian-binary", "control.tar.gz", "data.tar.gz"]
    assert part("debian-binary") == b"2.0\n"
    with tarfile.open(fileobj=io.BytesIO(part("control.tar.gz"))) as tar:
        control = tar.extractfile("./control").read().decode()
    assert f"Version: 0.1.0-{format_hash(device, 'f32')}\n" in control
    assert "Architecture: cortexa9-vfpv3\n" in control
    with tarfile.open(fileobj=io.BytesIO(part("data.tar.gz"))) as tar:
        assert {m.mtime for m in tar} | {m.uid for m in tar} == {0}
        files = {m.name: tar.extractfile(m).read() for m in tar if m.isfile()}
    assert files["./usr/lib/libesea_elbow_drive.so"] == packed[0].read_bytes()
    assert files["./usr/sbin/esea_elbow_drive"] == arm.elf.read_bytes()
    assert files["./usr/share/esea_elbow_drive/calls.md"] == packed[1].read_bytes()
