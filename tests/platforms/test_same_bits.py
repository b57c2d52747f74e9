"""Other compilers and other computers, emulated, give the bits that gcc gives here."""

from __future__ import annotations

import re
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.board.emulator import run_tasks_in_emulator
from esea_gen.board.firmware import build_firmware
from esea_gen.cache import cache_folder
from esea_gen.devices.file import shipped_devices
from esea_gen.export.fmu import check_fmu, every_platform, make_fmu
from esea_gen.export.model import block_model, controller_model
from esea_gen.hostlib import compile_device
from esea_gen.hostlib.compiler import compile_sources, zig
from esea_gen.targets import PLATFORMS
from esea_gen.twin.recorded import record_drive
from esea_gen.verify.compare import program_streams
from esea_gen.verify.streams import streams
from tests.conftest import require_module, require_tool

pytestmark = [pytest.mark.platforms, pytest.mark.ci]
HERE = Path(__file__).parent
WINE = "/usr/lib/wine/wine64"  # Debian's package of that name puts no command on the path
# As FMUs are compiled: for other ones zig compiles all of Windows' library once more.
FLAGS = ("-O2", "-s")
# What compiles, and what runs it here; "" is what the system has.
WHERE = {
    "clang": ("", ()),
    "zig": ("x86_64-linux", ()),
    "aarch64": ("aarch64-linux", ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu")),
    "windows": ("x86_64-windows", (WINE,)),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    require_tool("gcc")
    require_module("ziglang")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WINEDEBUG", "-all")
        patch.setenv("WINEPREFIX", str(tmp_path_factory.mktemp("wine")))
        yield tmp_path_factory.mktemp("same")


@pytest.fixture
def only(tmp_path, monkeypatch):
    """The path leads to these tools alone."""

    def lead(*names: str) -> None:
        for name, path in [(n, require_tool(n)) for n in names]:
            (tmp_path / name).symlink_to(path)
        monkeypatch.setenv("PATH", str(tmp_path))

    return lead


def run(folder: Path, where: str, source: str, library: Path, *more: str, given: bytes) -> bytes:
    """What a program says that loads a library, on another computer."""
    platform, emulator = WHERE[where]
    for word in emulator[:1]:
        require_tool(word)
    target = PLATFORMS[platform or "x86_64-linux"].zig
    program = folder / f"{where}-{source}.exe"
    if not program.exists():
        import fmpy

        headers = f"-I{Path(fmpy.__file__).parent / 'c-code'}"
        command = [*zig(target), *FLAGS, headers, HERE / source, "-o", program]
        subprocess.run([*command, *([] if where == "windows" else ["-ldl"])], check=True)
    command = [*emulator, program, library, *more]
    return subprocess.run(command, input=given, capture_output=True, check=True).stdout


@cache
def tried(name: str, real: str):
    """A library of gcc's, and for each Block what goes into ``run_blocks.c`` and what comes out."""
    device = esea_gen.load_device(name)
    library = compile_device(device, real)
    calls = {}
    for block in device.system.kinds:
        program = block.kind == "program"
        runner, ffi = library.block(block.name), library.ffi
        stream = program_streams(block)[0] if program else streams(block, 5, 400)[-1]
        packed = runner.pack({n: x[: 20 if program else None] for n, x in stream.inputs.items()})
        types = [f"{runner.stem}_{kind}_t" for kind in ("params", "coeffs", "state", "in", "out")]
        sizes = [ffi.sizeof(t) for t in types[2:]]
        params = b""
        if block.tunables:
            sizes = [ffi.sizeof(t) for t in types[:2]] + sizes
            values = {
                t: library.naming.tunable(block, t, x) for t, x in block.default_tunables().items()
            }
            params = bytes(ffi.buffer(ffi.new(f"{types[0]} *", values)))
        out = np.zeros(len(packed), library.dtype(types[4]))
        runner.run_into(packed, out, out[:0])
        numbers = [*([] if params else [0, 0]), *sizes, len(packed)]
        head = f"{runner.stem} {' '.join(map(str, numbers))}\n".encode()
        calls[block.name] = (head + params + packed.tobytes(), out)
    return library, calls


def differing(folder: Path, name: str, real: str, where: str, *flags: str) -> dict[str, float]:
    """Blocks that give other bits elsewhere, and the largest difference."""
    library, calls = tried(name, real)
    target = PLATFORMS[WHERE[where][0]].zig if WHERE[where][0] else ""
    built = compile_sources(library.sources, (*FLAGS, *flags), library.link, target)
    said = run(folder, where, "run_blocks.c", built, given=b"".join(x for x, _ in calls.values()))
    found = {}
    for block, (_, ours) in calls.items():
        theirs = np.frombuffer(said[: ours.nbytes], ours.dtype)
        said = said[ours.nbytes :]
        if theirs.tobytes() != ours.tobytes():
            found[block] = max(
                np.nanmax(np.abs(theirs[n].astype(float) - ours[n].astype(float)))
                for n in ours.dtype.names
            )
    assert said == b""
    return found


@pytest.mark.parametrize(("where", "real"), [*((w, "f32") for w in WHERE), ("windows", "q31")])
def test_every_block_gives_the_same_bits(folder, only, real, where):
    tried("elbow_drive", real)
    if where == "clang":
        only("clang", "ld")
    assert differing(folder, "elbow_drive", real, where) == {}


def test_a_compiler_that_fuses_is_noticed(folder):
    """Armed: multiplication and addition rounded once, as aarch64 can."""
    assert differing(folder, "elbow_drive", "f32", "aarch64", "-ffp-contract=fast")


@pytest.mark.slow
@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("name", sorted(shipped_devices()))
def test_every_device_gives_the_same_bits(folder, only, name, where):
    """In f64 on Windows ``tanh``, ``exp`` and ``pow`` come from another C library."""
    # The predictive controller's ranges exceed 64 bits.
    reals = ("f32", "f64") if name == "elbow_mpc" else ("f32", "q31", "f64")
    for real in reals:
        tried(name, real)
    if where == "clang":
        only("clang", "ld")
    found = {real: differing(folder, name, real, where) for real in reals}
    if where == "windows":
        sources = tried(name, "f64")[0].sources
        for block, most in found.pop("f64").items():
            assert re.search(r"\b(exp|pow|tanh)\(", sources[f"esea_{name}_{block}.c"])
            assert most < 1e-16
    assert not any(found.values()), found


def test_an_fmu_has_the_same_bytes_wherever_it_is_made(only, tmp_path, monkeypatch):
    """In other folders, with and without a compiler of the system's."""
    require_module("ziglang")
    model = block_model(esea_gen.load_device("elbow"), "velocity")
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / "zig"))  # platforms' libraries
    made = []
    for place in (tmp_path / "here", tmp_path / "a longer name"):
        place.mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(place))
        monkeypatch.setenv("ZIG_LOCAL_CACHE_DIR", str(place))
        monkeypatch.setenv("XDG_CACHE_HOME", str(place))
        made.append(make_fmu(model, "3", every_platform()).packed())
        only()
    assert made[0] == made[1]


def test_one_fmu_for_five_platforms(folder):
    """Windows' binary against Linux', to the bit; of macOS' no more than the file's format."""
    model = controller_model(esea_gen.load_device("elbow_drive"))
    made = make_fmu(model, "3", every_platform())
    path = folder / "drive.fmu"
    path.write_bytes(made.packed())
    token = check_fmu(path)["token"]
    outputs = [v for v in model.of("output") if not v.whole]
    counts = [v for v in model.of("input") if v.name.startswith("count_")]
    inputs = [v for v in model.of("input") if not v.whole] + counts
    ends = [(max(v.low, -1e3), min(v.high, 1e3)) for v in inputs]
    walk = np.random.default_rng(3).normal(0, [0.01 + v.whole for v in inputs], (500, len(inputs)))
    given = np.clip(np.cumsum(walk, axis=0), *np.array(ends).T).tobytes()
    words = [f"{'iw'[v.whole]}{v.reference}" for v in inputs] + [f"o{v.reference}" for v in outputs]
    said = {}
    for where in ("zig", "windows"):
        platform = PLATFORMS[WHERE[where][0]]
        library = folder / f"{where}{platform.suffix}"
        library.write_bytes(
            made.files[f"binaries/{platform.name}/{model.identifier}{platform.suffix}"]
        )
        more = (token, str(model.tick_s), *words)
        said[where] = run(folder, where, "run_fmu.c", library, *more, given=given)
    assert said["zig"] == said["windows"]
    assert np.ptp(np.frombuffer(said["zig"]).reshape(500, -1), axis=0).max() > 0
    both = make_fmu(model, "2", every_platform()).files
    (mac,) = (content for n, content in both.items() if n.endswith(".dylib"))
    require_tool("clang")  # whose package brings LLVM's tools
    (folder / "both.dylib").write_bytes(mac)
    tool = next(Path("/usr/lib").glob("llvm-*/bin/llvm-nm"))
    listed = subprocess.run(
        [tool, "--arch=all", folder / "both.dylib"], capture_output=True, check=True
    ).stdout
    assert listed.count(b" T _fmi2DoStep\n") == 2


def test_the_daemon_of_a_64_bit_arm_gives_the_hosts_bits(folder):
    require_tool("qemu-aarch64")
    device = esea_gen.load_device("elbow_drive")
    image = build_firmware(device, "raspberry-pi", folder)
    results = run_tasks_in_emulator(device, image, record_drive(device, 200).inputs)
    assert {t: r.steps for t, r in results.items()} == {"sense": 200, "control": 40}
    assert all(r.identical and r.hash_matches for r in results.values())


@pytest.mark.parametrize("words", ["simulate step", "demo"])
def test_python_and_pip_alone_are_enough(folder, only, tmp_path, monkeypatch, words):
    only()
    monkeypatch.chdir(tmp_path)
    if words == "demo":
        from esea_host.cli import app

        words = "demo --headless --seconds 1"
    else:
        from esea_gen.cli import app
    done = CliRunner().invoke(app, words.split())
    assert done.exit_code == 0, done.output
