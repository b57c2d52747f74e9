"""FMUs: simulated by FMPy, they give the bits of the host library's C; errors are reported."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.export.fmu import MANIFEST, check_fmu, make_fmu
from esea_gen.export.model import block_model, controller_model, twin_model
from esea_gen.hostlib import compile_device
from esea_gen.identify import recorded_deflections
from esea_gen.twin.case import TORQUE
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.people import real_plant
from esea_gen.twin.run import told
from esea_gen.twin.trajectories import Trajectory
from tests.conftest import ROOT, require_module, require_tool

pytestmark = pytest.mark.ci

TICK_S = 1e-3
N = 250


class Slave:
    """One FMU in FMPy, whatever its version."""

    def __init__(self, path: Path, name: str = "one", token: str = "") -> None:
        import fmpy

        self.folder = Path(fmpy.extract(str(path)))
        self.said: list[str] = []
        about = fmpy.read_model_description(str(path))
        self.two = about.fmiVersion == "2.0"
        kind = fmpy.fmi2.FMU2Slave if self.two else fmpy.fmi3.FMU3Slave
        self.known = {v.name: v for v in about.modelVariables}
        self.fmu = kind(
            guid=token or about.guid,
            modelIdentifier=about.coSimulation.modelIdentifier,
            unzipDirectory=str(self.folder),
            instanceName=name,
        )
        self._instantiate()
        self.time = 0.0

    def _instantiate(self) -> None:
        import fmpy

        if not self.two:
            self.fmu.instantiate(
                loggingOn=True, logMessage=lambda _e, _s, _c, text: self.said.append(text.decode())
            )
            return
        calls = fmpy.fmi2.fmi2CallbackFunctions()
        # C's variable arguments cannot be read here: the text is the one after the format.
        logger = fmpy.fmi2.fmi2CallbackLoggerTYPE
        calls.logger = logger(lambda *given: self.said.append(str(given[-1])))
        self.fmu.instantiate(callbacks=calls, loggingOn=True)

    def start(self, at_s: float = 0.0, **values: float) -> Slave:
        if self.two:
            self.fmu.setupExperiment(startTime=at_s)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=at_s)
        self.put(**values)
        self.fmu.exitInitializationMode()
        self.time = at_s
        return self

    def put(self, **values: float) -> None:
        for name, x in values.items():
            place, whole, kind = self._place(name.replace("__", "."))
            getattr(self.fmu, f"set{kind}")([place], [int(x) if whole else float(x)])

    def get(self, name: str) -> float:
        place, _, kind = self._place(name)
        return getattr(self.fmu, f"get{kind}")([place])[0]

    def _place(self, name: str) -> tuple[int, bool, str]:
        v = self.known[name]
        whole = v.type in ("Integer", "UInt32")
        words = ("Integer", "Real") if self.two else ("UInt32", "Float64")
        return v.valueReference, whole, words[not whole]

    def step(self, h_s: float = TICK_S) -> None:
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=h_s)
        self.time += h_s

    @property
    def outputs(self) -> list[str]:
        return [n for n, v in self.known.items() if v.causality == "output"]


def written(folder: Path, made, name: str) -> Path:
    path = folder / f"{name}.fmu"
    path.write_bytes(made.packed())
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    require_tool("gcc")
    require_module("fmpy")
    return tmp_path_factory.mktemp("fmu")


@pytest.fixture(scope="module")
def sensor(folder, elbow):
    """The torque sensor, in both versions."""
    model = block_model(elbow, "sensor")
    return {fmi: written(folder, make_fmu(model, fmi), f"sensor{fmi}") for fmi in ("2", "3")}


@pytest.fixture(scope="module")
def loop(folder, drive):
    """The controller, the virtual exoskeleton, and a run of both by ours."""
    plant = real_plant(drive, seed=3)
    t = np.arange(N) * TICK_S
    still = np.zeros(N)
    moved = Trajectory(
        "there", 0.5 + 0.3 * t**2, 0.6 * t, 0.6 + still, 2 * np.sin(20 * t), 0, N, False
    )
    compiled = ClosedLoop(drive.system, plant, "f32")
    noise = np.random.default_rng(5).standard_normal(N)
    signals = told(drive, compiled, moved, TORQUE) | {"noise": noise}
    run = compiled.run(signals)
    twin = twin_model(plant, TICK_S, drive.title, drive.digest)
    return {"run": run, "signals": signals} | {
        (which, fmi): written(folder, make_fmu(model, fmi), f"{which}{fmi}")
        for which, model in (("controller", controller_model(drive)), ("twin", twin))
        for fmi in ("2", "3")
    }


def test_fmpy_finds_nothing_wrong(sensor, loop):
    from fmpy.validation import validate_fmu

    for path in (*sensor.values(), loop["controller", "3"], loop["twin", "2"]):
        assert validate_fmu(str(path)) == []
        assert check_fmu(path)["identifier"]
    import fmpy
    from lxml import etree

    schema = Path(fmpy.__file__).parent / "schema/fmi3/fmi3BuildDescription.xsd"
    with zipfile.ZipFile(sensor["3"]) as archive:
        built = etree.fromstring(archive.read("sources/buildDescription.xml"))
    etree.XMLSchema(etree.parse(str(schema))).assertValid(built)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_the_recorded_rubber_gives_the_host_librarys_bits(sensor, elbow, elbow_f32, fmi):
    """By FMPy's own simulation of a table of inputs."""
    from fmpy import simulate_fmu

    theta = recorded_deflections(elbow, ROOT / "tests/data/hdrb/hdrb.toml")
    theta_rad = next(iter(theta.values()))[200:900]
    omega_rad_s = np.gradient(theta_rad, TICK_S)
    given = {"theta_rad": theta_rad, "omega_rad_s": omega_rad_s}
    expected, _ = elbow_f32.block("sensor").run(given, trace=False)
    time_s = np.arange(len(theta_rad)) * TICK_S
    table = np.rec.fromarrays([time_s, *given.values()], names=["time", *given])
    seen = simulate_fmu(
        str(sensor[fmi]),
        stop_time=time_s[-1],
        output_interval=TICK_S,
        input=table,
        output=list(expected),
    )
    assert len(seen) == len(time_s)
    for name, column in expected.items():
        # What is read at a time was made by the ticks before it.
        assert np.array_equal(seen[name][1:], column[:-1].astype(float)), name
    assert np.ptp(seen["tau_Nm"]) > 0.1


def first_difference(loop, late: bool) -> tuple[int, str] | None:
    """Tick and name of what differs first from our run, with the two FMUs in step.

    late: the plant moves before the controller has run, which takes its last command instead.
    """
    run, signals = loop["run"], loop["signals"]
    zeroed = {f"encoder_{side}.zeroed": 1.0 for side in ("motor", "load")}
    controller = Slave(loop["controller", "3"]).start(**zeroed)
    twin = Slave(loop["twin", "2"]).start(start_rad=signals["theta_p_rad"][0])
    path = ("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "noise")
    for k in range(N):
        for name in run.plant:
            if twin.get(name) != run.plant[name][k]:
                return k, name
        controller.put(**{n: twin.get(n) for n in ("count_motor", "count_load", "count_gear")})
        controller.put(**{n: x[k] for n, x in signals.items() if n not in path})
        command = controller.get("u_Nm")
        controller.step()
        for name in run.controller:
            if controller.get(name) != float(run.controller[name][k]):
                return k, name
        command = command if late else controller.get("u_Nm")
        twin.put(u_Nm=command, **{n: signals[n][k] for n in path})
        twin.step()
    return None


def test_both_in_step_are_our_closed_loop_to_the_bit(loop):
    assert first_difference(loop, late=False) is None
    assert np.ptp(loop["run"]["u_Nm"]) > 0.1
    assert loop["run"]["fault"][-1] == 0


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_state_is_come_back_to_and_crosses_to_another_instance(sensor, fmi):
    fmu = Slave(sensor[fmi]).start()

    def on(slave, steps):
        for k in range(steps):
            slave.put(theta_rad=0.1 * np.sin(0.3 * k), omega_rad_s=float(k % 7))
            slave.step()
        return slave.get("tau_Nm")

    on(fmu, 25)
    kept, then = fmu.fmu.getFMUState(), fmu.time
    packed = bytes(fmu.fmu.serializeFMUstate(kept) if fmu.two else fmu.fmu.serializeFMUState(kept))
    first = on(fmu, 25)
    fmu.fmu.setFMUState(kept)
    fmu.time = then
    assert on(fmu, 25) == first
    other = Slave(sensor[fmi], "other").start()
    unpack = other.fmu.deSerializeFMUstate if fmu.two else other.fmu.deserializeFMUState
    other.fmu.setFMUState(unpack(packed))
    other.time = then
    assert on(other, 25) == first
    damaged = bytearray(packed)
    damaged[-20] ^= 1
    with pytest.raises(Exception, match=r"."):
        unpack(bytes(damaged))
    with pytest.raises(Exception, match=r"."):
        unpack(packed[:-1])
    if not fmu.two:
        assert other.said == ["deserialize: the state is damaged", other.said[1]]
        assert "bytes, not" in other.said[1]


# What makes an output change at every tick, and that output.
MOVING: dict[str, tuple[dict[str, float], str]] = {
    "twin": ({"omega_p_rad_s": 1.0}, "omega_g_rad_s"),
    "controller": (
        {"count_motor": 100, "count_load": 200, "count_gear": 50, "mode": 1, "tau_desired_Nm": 0.5},
        "tau_h_Nm",
    ),
}


def test_a_tunable_holds_from_the_next_step_on_and_keeps_its_bounds(folder, elbow, elbow_f32):
    fmu = Slave(written(folder, make_fmu(block_model(elbow, "velocity"), "3"), "velocity"))
    (tunable,) = elbow.velocity.tunables
    about = fmu.known[tunable.name]
    assert (about.causality, about.variability) == ("parameter", "tunable")
    assert (about.unit, float(about.start)) == (tunable.unit, tunable.default)
    board = elbow_f32.block("velocity")
    fmu.start()
    for value in (tunable.default, tunable.low):
        kept = board.state
        board.prepare({tunable.name: value})
        board.state = kept
        fmu.put(**{tunable.name: value})
        for k in range(20):
            given = {p.name: 0.01 * k * k for p in elbow.velocity.inputs}
            fmu.put(**given)
            fmu.step()
            for name, expected in board.step(**given).items():
                assert fmu.get(name) == float(expected)
    with pytest.raises(Exception, match=r"."):
        fmu.put(**{tunable.name: 2 * tunable.high})
    assert fmu.said[-1].startswith(f"{tunable.name} = {2 * tunable.high:.9g} is outside ")
    assert fmu.get(tunable.name) == tunable.low
    with pytest.raises(Exception, match=r"."):
        fmu.fmu.setFloat64([fmu.known["status"].valueReference], [1.0])
    assert fmu.said[-1] == "status is of another type"
    output = next(n for n in fmu.outputs if n != "status")
    with pytest.raises(Exception, match=r"."):
        fmu.put(**{output: 1.0})
    assert fmu.said[-1] == f"{output} is an output"


def rewritten(path: Path, target: Path, change) -> Path:
    """A copy of an archive with its files changed."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(target, "w") as new:
        for name, content in change({n: old.read(n) for n in old.namelist()}).items():
            new.writestr(name, content)
    return target


def test_another_content_is_refused(sensor, loop, tmp_path):
    """Armed: a description or a binary of another export, by the check and by the FMU itself."""
    for path in (sensor["3"], sensor["2"]):
        with pytest.raises(Exception, match="instantiate"):
            Slave(path, token="0" * 32)
    with zipfile.ZipFile(loop["controller", "3"]) as archive:
        about = archive.read("modelDescription.xml")
    mixed = rewritten(
        sensor["3"], tmp_path / "a.fmu", lambda f: f | {"modelDescription.xml": about}
    )
    with pytest.raises(UserError, match=r"modelDescription\.xml was changed"):
        check_fmu(mixed)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: {n: c for n, c in f.items() if "sources/model.h" not in n}, "is missing"),
        (lambda f: f | {"resources/more.txt": b"x"}, "was added"),
        (lambda f: f | {"sources/esea_f32.c": b""}, "was changed"),
        (lambda f: {n: c for n, c in f.items() if n != MANIFEST}, "not written by esea-gen"),
    ],
)
def test_a_changed_fmu_is_noticed(sensor, tmp_path, change, said):
    with pytest.raises(UserError, match=said):
        check_fmu(rewritten(sensor["3"], tmp_path / "a.fmu", change))


def test_damage_is_noticed_wherever_it_is(sensor, tmp_path):
    """A flipped bit is told, but where nothing is read: a second copy of a file's date or mode."""
    whole = sensor["2"].read_bytes()
    path = tmp_path / "a.fmu"
    found = 0
    places = range(100, len(whole), 701)
    for at in places:
        damaged = bytearray(whole)
        damaged[at] ^= 0x10
        path.write_bytes(damaged)
        try:
            check_fmu(path)
        except UserError as error:
            found += "a.fmu: " in str(error)
        else:
            with zipfile.ZipFile(path) as now, zipfile.ZipFile(sensor["2"]) as then:
                assert now.namelist() == then.namelist()
                assert all(now.read(n) == then.read(n) for n in then.namelist())
    assert found >= 0.9 * len(places)
    for end in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(UserError, match=r"a\.fmu: "):
            check_fmu(path)


def test_an_archive_that_would_fill_the_memory_is_not_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros", bytes(1 << 26))
        archive.writestr("more", b"1")
    with pytest.raises(UserError, match=r"a\.fmu: more than 64 MiB unpacked"):
        check_fmu(tmp_path / "a.fmu")


DRIVER = """
#include <assert.h>
#include <stdlib.h>
#include "fmi3Functions.h"
#define TOKEN "%s"
static int told;
static void say(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String m)
{ (void)e, (void)s, (void)c, (void)m; ++told; }
int main(void)
{
    const fmi3ValueReference in[2] = { 0, 1 }, far = 1000000;
    fmi3Float64 x[2] = { 0.01, 0.1 }, at;
    fmi3Boolean b1, b2, b3;
    fmi3FMUState state = NULL, other = NULL;
    size_t size;
    int k;
    fmi3Byte *bytes;
    fmi3Instance i;

    i = fmi3InstantiateCoSimulation("i", TOKEN, "", 0, 0, 0, 0, NULL, 0, NULL, say, NULL);
    assert(i != NULL);
    assert(fmi3InstantiateCoSimulation("j", "x", "", 0, 0, 0, 0, NULL, 0, NULL, say, NULL) == NULL);
    assert(fmi3DoStep(i, 0, 0.001, 1, &b1, &b2, &b3, &at) == fmi3Error);
    assert(fmi3EnterInitializationMode(i, 0, 0, 0, 0, 0) == fmi3OK);
    assert(fmi3ExitInitializationMode(i) == fmi3OK);
    for (k = 0; k < 20; ++k) {
        assert(fmi3SetFloat64(i, in, 2, x, 2) == fmi3OK);
        assert(fmi3DoStep(i, 0.001 * k, 0.001, 1, &b1, &b2, &b3, &at) == fmi3OK);
    }
    assert(fmi3GetFloat64(i, &far, 1, x, 1) == fmi3Error);
    assert(fmi3GetFMUState(i, &state) == fmi3OK && fmi3GetFMUState(i, &state) == fmi3OK);
    assert(fmi3SerializedFMUStateSize(i, state, &size) == fmi3OK);
    bytes = malloc(size + 1);
    /* At an odd address: nothing may rest on how the caller's bytes lie. */
    assert(fmi3SerializeFMUState(i, state, bytes + 1, size) == fmi3OK);
    assert(fmi3DeserializeFMUState(i, bytes + 1, size, &other) == fmi3OK);
    assert(fmi3SetFMUState(i, other) == fmi3OK && fmi3Reset(i) == fmi3OK);
    assert(fmi3FreeFMUState(i, &state) == fmi3OK && fmi3FreeFMUState(i, &other) == fmi3OK);
    assert(fmi3DoStep(i, 0, 1e300, 1, &b1, &b2, &b3, &at) == fmi3Error);
    free(bytes);
    fmi3FreeInstance(i);
    return told == 4 ? 0 : 1;
}
"""


def test_no_leak_and_no_undefined_behaviour(sensor, tmp_path):
    """The whole interface under the compiler's sanitizers; armed: an instance that is not freed."""
    import fmpy

    with zipfile.ZipFile(sensor["3"]) as archive:
        archive.extractall(tmp_path)
    source = tmp_path / "sources"
    driver, built = DRIVER % check_fmu(sensor["3"])["token"], tmp_path / "driver"
    flags = ("-std=c99", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    plain = ("-DFMI3_OVERRIDE_FUNCTION_PREFIX", f"-I{Path(fmpy.__file__).parent / 'c-code'}")
    for text, said in ((driver, ""), (driver.replace("fmi3FreeInstance(i);", ""), "leaked")):
        (source / "driver.c").write_text(text)
        subprocess.run(["gcc", *flags, *plain, "-o", built, *source.glob("*.c")], check=True)
        done = subprocess.run([built], capture_output=True, text=True, check=False)
        assert (done.returncode == 0) == (not said), done.stderr
        assert said in done.stderr


def test_the_command(tmp_path, monkeypatch, elbow, drive):
    require_tool("gcc")
    monkeypatch.chdir(tmp_path)
    known = {"elbow": elbow, "elbow_drive": drive}  # loaded once, like their content hash
    monkeypatch.setattr(esea_gen, "load_device", lambda name, controller=None: known[name])
    run, here = CliRunner().invoke, ["--platforms", "host"]
    done = run(app, ["export", "fmu", "elbow", "--block", "velocity", "--fmi", "2", *here])
    assert done.exit_code == 0, done.output
    assert "esea_elbow_velocity.fmu" in done.output
    assert "content" in done.output
    assert "intact; FMI 2.0, f32" in run(app, ["export", "check", "esea_elbow_velocity.fmu"]).output
    for call, said in (
        (["elbow", "--block", "nobody"], "no Block 'nobody'"),
        (["elbow", "--fmi", "1"], "unsupported version"),
        (["elbow", "--platforms", "mac"], "Give all or host"),
        (["elbow", "--real", "q31"], "no number format"),
        (["elbow", "--plant", "real"], "has no drive"),
        (["elbow", "--plant", "real", "--block", "sensor"], "ask for two"),
        (["elbow", "--seed", "3"], "need --plant"),
        (["elbow_drive", "--plant", "raal"], "Did you mean real"),
    ):
        failed = run(app, ["export", "fmu", *call])
        assert isinstance(failed.exception, UserError), failed.output
        assert said in str(failed.exception)
    assert "No such file" in str(run(app, ["export", "check", "none.fmu"]).exception)
    monkeypatch.setitem(sys.modules, "fmpy", None)
    bare = run(app, ["export", "fmu", "elbow", "--block", "velocity", *here])
    assert 'pip install "esea-gen[fmu]"' in str(bare.exception)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["elbow_drive", "elbow_mpc"])
def test_every_block_gives_the_host_librarys_bits(name, tmp_path):
    """Vectors and Programs among them; numbers beyond the ports' ranges too."""
    from fmpy.validation import validate_fmu

    device = esea_gen.load_device(name)
    library = compile_device(device, "f32")
    rng = np.random.default_rng(7)
    for block in device.system.kinds:
        path = written(tmp_path, make_fmu(block_model(device, block.name), "3"), block.name)
        assert validate_fmu(str(path)) == [], block.name
        fmu, ours = Slave(path).start(), library.block(block.name)
        for _ in range(20):
            drawn = {p: rng.uniform(1.1 * p.low, 1.1 * p.high, p.size) for p in block.inputs}
            given = {
                p.name: (np.rint(x) if p.whole else x).astype(np.float32) for p, x in drawn.items()
            }
            flat = {
                (f"{n}[{i + 1}]" if len(v) > 1 else n): float(x)
                for n, v in given.items()
                for i, x in enumerate(v)
            }
            fmu.put(**flat)
            fmu.step(block.period_s)
            shaped = {n: v if len(v) > 1 else v[0] for n, v in given.items()}
            for n, value in ours.step(**shaped).items():
                for i, x in enumerate(np.atleast_1d(value)):
                    at = f"{n}[{i + 1}]" if np.ndim(value) else n
                    at = f"out.{at}" if f"out.{at}" in fmu.known else at
                    seen = fmu.get(at)
                    assert seen == float(x) or (np.isnan(seen) and np.isnan(x)), (block.name, at)
