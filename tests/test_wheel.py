"""The wheel, installed where nothing of the checkout is in reach, works from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests.conftest import ROOT, require_module

pytestmark = pytest.mark.ci

# No network: the dependencies are those of this environment, seen through one line of a .pth file.
# A path added in this way brings no .pth files of its own, so that a checkout which is installed
# there for development stays out of reach.


def call(*command: object, cwd: Path) -> str:
    # The environment is as a user has it: nothing may lead back to the checkout.
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False, env=env
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    require_module("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    call(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """Folder of the commands of an environment that has the wheel."""
    folder = tmp_path_factory.mktemp("installed") / "venv"
    call(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    site = Path(
        call(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder
        ).strip()
    )
    places = dict.fromkeys(sysconfig.get_path(p) for p in ("purelib", "platlib"))
    (site / "dependencies.pth").write_text("".join(f"{p}\n" for p in places))
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python)
    options = ("install", "--quiet", "--no-deps", "--no-index", "--force-reinstall")
    call(*pip, *options, "--ignore-installed", wheel, cwd=folder)
    return folder / "bin"


def test_wheel_holds_what_is_needed_and_no_more(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    for source, target in (
        ("templates", "_templates"),
        ("firmware", "_firmware"),
        ("tests/data/hdrb", "_samples/hdrb"),
    ):
        wanted = {
            f"esea_gen/{target}/{p.relative_to(ROOT / source).as_posix()}"
            for p in (ROOT / source).rglob("*")
            if p.is_file()
        }
        assert wanted
        assert wanted <= set(names)
    here = {
        p.relative_to(ROOT).as_posix()
        for p in (ROOT / "esea_gen").rglob("*")
        if p.is_file() and "__pycache__" not in p.parts
    }
    assert here <= set(names)
    assert {"esea_gen/py.typed", "esea_host/assess/knee.npz"} <= set(names)
    assert {n.split("/")[0] for n in names} == {"esea_gen", "esea_host", "esea_gen-0.1.0.dist-info"}
    assert not [n for n in names if n.endswith((".pyc", ".so", ".o", ".elf"))]
    assert any(n.endswith("licenses/LICENSE") for n in names)


def test_it_is_the_wheel_that_runs(installed, tmp_path):
    where = call(
        installed / "python", "-c", "import esea_gen; print(esea_gen.__file__)", cwd=tmp_path
    )
    assert Path(where.strip()).is_relative_to(installed.parent)


def test_build_gives_the_committed_bytes(installed, tmp_path):
    call(installed / "esea-gen", "build", "elbow", cwd=tmp_path)

    def content(folder: Path) -> dict[str, bytes]:
        return {
            p.relative_to(folder).as_posix(): p.read_bytes()
            for p in folder.rglob("*")
            if p.is_file() and "__pycache__" not in p.parts
        }

    built, committed = content(tmp_path / "generated/elbow"), content(ROOT / "generated" / "elbow")
    # Of some folders only the manifest is committed, with the hash of every file.
    assert {n for n in committed if n.startswith("f32/")} == {n for n in built if "f32/" in n}
    assert [n for n in committed if built.get(n) != committed[n]] == []
    assert "current" in call(installed / "esea-gen", "check", "elbow", cwd=tmp_path)


def test_the_first_minute_needs_no_file_of_ones_own(installed, tmp_path):
    """The recording that comes along is found from any folder."""
    program = (
        "from esea_gen.files import sample_folder; "
        "found = sample_folder() / 'hdrb'; print(found.is_dir(), found)"
    )
    there, path = call(installed / "python", "-c", program, cwd=tmp_path).split()
    assert there == "True"
    assert Path(path).is_relative_to(installed.parent)


def test_firmware_builds(installed, tmp_path):
    call(installed / "esea-gen", "firmware", "elbow", "--board", "host", "--out", "o", cwd=tmp_path)
    assert (tmp_path / "o" / "esea_elbow_host.elf").is_file()


def test_library_works(installed, tmp_path):
    program = (
        "import esea_gen; from esea_gen.hostlib import compile_device; "
        "d = esea_gen.load_device('elbow'); c = compile_device(d, 'f32').task('sense'); "
        "print(d.system.simulator().step('sense', theta_rad=0.1)['tau_Nm'], "
        "c.step(theta_rad=0.1)['tau_Nm'])"
    )
    model, c = map(float, call(installed / "python", "-c", program, cwd=tmp_path).split())
    assert model == pytest.approx(c, rel=1e-5)
