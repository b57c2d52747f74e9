"""The site builds, agrees with the program, and its worked example gives its results."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import esea_gen
from esea_gen.hostlib.library import compile_system
from esea_gen.identify.recording.mapping import parse_mapping
from esea_gen.model.sensing import zeros_missing
from tests.browser import browser
from tests.conftest import ROOT, load_file, require_module, require_tool
from tests.typed import typed

DOCS = ROOT / "docs"
SNIPPET = re.compile(r'^--8<-- "(.+?)(?::(\w+))?"$', re.MULTILINE)

made = load_file(DOCS / "made_pages.py")
controller = load_file(ROOT / "examples" / "controller.py")


# -- the worked example ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def system(elbow):
    return controller.controlled(elbow)


@pytest.fixture(scope="module")
def model(system):
    return controller.run(system.simulator(zeros_missing(system)), controller.stream())


def test_the_streams_invalid_samples_are_seen(model):
    status = model["impedance_status"].astype(int)
    invalid = np.flatnonzero(status & 1)
    assert invalid.tolist() == [0, 140, 240]  # ticks 0, 700 and 1200
    assert np.all(model["u_Nm"][invalid] == 0)
    assert int(model["sensor_status"][333]) & 1
    assert not np.any(status & 2)
    assert np.count_nonzero(model["u_Nm"]) == len(status) - len(invalid)


def test_the_law_computed_a_second_time(elbow, model):
    """By hand, in plain floats, with the torque that the latch must have held."""
    inputs = controller.stream()
    k, d, g, h = 4.0, 0.2, 1.0, controller.EVERY * elbow.period_s
    last, expected = None, []
    for n, tick in enumerate(range(0, len(inputs["phi_rad"]), controller.EVERY)):
        ref, phi = inputs["phi_ref_rad"][tick], inputs["phi_rad"][tick]
        if not (abs(ref) <= controller.PHI_MAX_RAD and abs(phi) <= controller.PHI_MAX_RAD):
            expected.append(0.0)
            last = phi if abs(phi) <= controller.PHI_MAX_RAD else last
            continue
        torque = model["tau_Nm"][tick - 1] if n else 0.0
        wanted = k * (ref - phi) - d * ((phi - last) if last is not None else 0) / h
        expected.append(float(np.clip(wanted + g * (wanted - torque), -20, 20)))
        last = phi
    assert model["u_Nm"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("late", range(controller.EVERY))
def test_symbols_do_not_depend_on_preemption(system, model, late):
    ended = controller.run(system.simulator(zeros_missing(system)), controller.stream(), late)
    for name, values in ended.items():
        assert np.array_equal(values, model[name][: len(values)])


@pytest.mark.parametrize("late", [0, 2, controller.EVERY - 1])
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_c_does_what_the_symbols_say(system, model, real, late):
    require_tool("gcc")
    inputs = controller.stream()
    library = compile_system(system, real)
    c = controller.run(library.board(zeros_missing(library.system)), inputs, late)
    on_time = controller.run(library.board(zeros_missing(library.system)), inputs)
    for name, values in c.items():
        assert len(values) >= len(model[name]) - 1
        assert np.array_equal(values, on_time[name][: len(values)]), name
        if real == "f64" or name.endswith("status"):
            assert np.array_equal(values, model[name][: len(values)]), name
        else:
            assert values == pytest.approx(model[name][: len(values)], abs=5e-5), name


@pytest.mark.ci
def test_the_example_prints_what_the_page_says(tmp_path):
    require_tool("gcc")
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "controller.py", "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    shown = re.search(r"```text\n(.*?)```", (DOCS / "own-system.md").read_text(), re.DOTALL)
    assert done.stdout == shown.group(1)
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["f32", "f64"]
    assert "[pd 1]" in (tmp_path / "out" / "f32" / "esea_elbow_pd_impedance.c").read_text()


@pytest.mark.parametrize(
    ("page", "example", "least"),
    [("own-system.md", "controller.py", 5), ("add-a-controller.md", "proportional.py", 3)],
)
def test_the_page_shows_the_example_file_and_nothing_else(page, example, least):
    page = (DOCS / page).read_text(encoding="utf-8")
    # Fenced as `{ .python }`: the formatter would take the include for an expression.
    assert "```py" not in page
    blocks = re.findall(r"``` \{ \.python \}\n(.*?)```", page, re.DOTALL)
    assert len(blocks) >= least
    source = (ROOT / "examples" / example).read_text(encoding="utf-8")
    names = re.findall(r"--8<-- \[start:(\w+)\]", source)
    assert names == re.findall(r"--8<-- \[end:(\w+)\]", source)
    shown = [SNIPPET.fullmatch(b.strip()) for b in blocks]
    assert all(shown), "Python on this page is included from the example, not typed"
    assert {m.group(1) for m in shown} == {f"examples/{example}"}
    assert [m.group(2) for m in shown] == names  # all of it, in its order


@pytest.mark.ci
def test_the_page_on_laws_followed_literally_touches_one_file(tmp_path):
    """In a folder of its own, with nothing but the file that the page shows."""
    require_tool("gcc")
    page = (DOCS / "add-a-controller.md").read_text(encoding="utf-8")
    (tmp_path / "examples").mkdir()
    law = tmp_path / "examples" / "proportional.py"
    source = (ROOT / "examples" / "proportional.py").read_text(encoding="utf-8")
    shown = re.findall(r'--8<-- "examples/proportional.py:(\w+)"', page)
    parts = [re.search(rf"\[start:{n}\]\n(.*?)# --8<-- \[end:{n}\]", source, re.S) for n in shown]
    head = "from __future__ import annotations\nfrom types import SimpleNamespace\n"
    law.write_text(head + "from typing import Any\n" + "".join(p.group(1) for p in parts))
    (commands,) = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
    lines = [line.split() for line in commands.splitlines()]
    assert {line[1] for line in lines} == {"simulate", "build", "verify", "coverage"}
    before = package_files()
    for line in lines:
        done = typed(*line[1:], cwd=tmp_path)
        assert done.returncode == 0, (line, done.stdout, done.stderr)
    written = [p for p in tmp_path.rglob("*") if p.is_file() and "out" not in p.parts]
    touched = [p for p in written if "__pycache__" not in p.parts]
    assert touched == [law]  # one file, and nothing of the package
    assert package_files() == before
    assert "proportional" in (tmp_path / "out/proportional/f32/esea_elbow_drive.h").read_text()


def package_files() -> dict[Path, int]:
    folder = ROOT / "esea_gen"
    return {p: p.stat().st_mtime_ns for p in folder.rglob("*.py")}


# -- other code on the pages ----------------------------------------------------------------------


def test_the_c_on_the_page_compiles_and_runs(tmp_path):
    gcc = require_tool("gcc")
    page = (DOCS / "call-the-c.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    (tmp_path / "use.c").write_text(program)
    folder = ROOT / "generated" / "elbow" / "f32"
    sources = [p for p in folder.glob("*.c") if p.name != "main.c"]
    flags = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
    command = [gcc, *flags, f"-I{folder}", "use.c", *sources, "-o", "use"]
    subprocess.run(command, cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "use"], capture_output=True, text=True, check=True).stdout
    # The model itself, with the same tunable.
    simulator = esea_gen.load_device("elbow").system.simulator({"velocity": {"bandwidth_Hz": 20.0}})
    for k in range(100):
        out = simulator.step("sense", theta_rad=float(np.float32(0.001) * np.float32(k)))
    assert said == f"tau_Nm {out['tau_Nm']:.3f}\n"


def test_the_files_that_the_page_names_are_there():
    page = (DOCS / "c-interface.md").read_text(encoding="utf-8")
    for real in ("f64", "f32"):
        manifest = json.loads((ROOT / "generated" / "elbow" / real / "manifest.json").read_text())
        for path in [*manifest["files"], "manifest.json"]:
            name = f"{path.partition('/')[0]}/" if "/" in path else path
            for block in ("sensor", "smoothing", "velocity"):
                name = name.replace(f"_{block}.", "_<block>.")
            name = name.replace("esea_elbow", "esea_<device>")
            name = re.sub(r"^esea_f32(_tables)?\.h$", r"\1.h", name)
            assert f"`{name}" in page, path


def test_the_mapping_on_the_page_is_accepted():
    page = (DOCS / "identify.md").read_text(encoding="utf-8")
    (mapping,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert len(parse_mapping(mapping, "mine.toml").condition) == 3


# -- words and rooms ------------------------------------------------------------------------------

CODE = re.compile(r"`([^`]+)`")
SOURCES = [ROOT / name for name in ("esea_gen", "host", "firmware")]


def glossary() -> list[list[str]]:
    """Cells of every entry."""
    lines = (DOCS / "glossary.md").read_text(encoding="utf-8").splitlines()
    rows = [[c.strip() for c in x.strip("|").split("|")] for x in lines if x.startswith("| ")]
    return [row for row in rows if row[0] != "term"]


def unknown_words(rows: list[list[str]]) -> list[str]:
    """Words set as code in the first two columns that no source file holds."""
    files = [p for folder in SOURCES for p in folder.rglob("*") if p.is_file()]
    suffixes = {".py", ".toml", ".c", ".h"}
    texts = [p.read_text(encoding="utf-8") for p in files if p.suffix in suffixes]
    source = set(re.findall(r"(?:--)?\w+", "\n".join(texts)))
    return [w for row in rows for w in CODE.findall(" ".join(row[:2])) if w not in source]


def unknown_places(rows: list[list[str]]) -> list[str]:
    """Files of the last column that are not there."""
    places = [w for row in rows for w in CODE.findall(row[3])]
    return [w for w in places if not any((d / w).exists() for d in (ROOT, ROOT / "esea_gen"))]


def rooms() -> list[str]:
    """Rooms in the order that imports are held to, the highest first."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    return [room for layer in layers for room in sorted(layer.split(" | "))]


def test_the_glossary_speaks_of_what_is_there():
    rows = glossary()
    assert 20 < len(rows) <= 40  # what the field has a word for stands nowhere
    assert all(len(row) == 4 and row[0] and row[2] and row[3] for row in rows)
    assert len({row[0] for row in rows}) == len(rows)
    assert unknown_words(rows) == []
    assert unknown_places(rows) == []


def test_the_rooms_on_the_page_are_those_that_imports_are_held_to():
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("\n## Rooms\n")[2]
    assert re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == rooms()


# -- docstrings -----------------------------------------------------------------------------------


def undocumented(item) -> list[str]:
    return [p for p in item.parameters() if p not in made.documented(item.doc)]


def test_every_public_parameter_is_documented():
    missing = [
        f"{item.name}: {', '.join(names)}"
        for module in made.modules()
        for item in made.items(module)
        if (names := undocumented(item))
    ]
    assert not missing, "no word about\n" + "\n".join(missing)


def test_everything_public_has_a_docstring():
    found = [item for module in made.modules() for item in made.items(module)]
    assert len(found) > 120
    assert [i.name for i in found if not i.doc] == []


# -- the site -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    for module in ("zensical", "mkdocstrings", "griffe_pydantic"):
        require_module(module)
    folder = tmp_path_factory.mktemp("site")
    for name in ("esea_gen", "host", "examples", "CHANGELOG.md"):
        (folder / name).symlink_to(ROOT / name)
    shutil.copytree(DOCS, folder / "docs", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "mkdocs.yml", folder)
    made.write_pages(folder / "docs")
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "out" / "site"


def text_of(path: Path) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", path.read_text(encoding="utf-8")))


@pytest.mark.ci
def test_every_device_key_is_on_the_site(site):
    keys = list(made.device_keys())
    assert {"schema", "k1_Nm_rad", "maxwell", "eps2", "resolution_bits"} <= set(keys)
    page = (site / "device-file.html").read_text(encoding="utf-8")
    missing = [k for k in keys if f"<code>{k}</code>" not in page and f".{k}]" not in page]
    assert [k for k in missing if f"<code>[{k}]</code>" not in page] == []


@pytest.mark.ci
def test_the_site_says_which_keys_a_file_needs(site):
    rows = re.findall(
        r"<tr>\s*<td><code>(\w+)</code></td>(.*?)</tr>",
        (site / "device-file.html").read_text(encoding="utf-8"),
        re.DOTALL,
    )
    needed = {key: re.findall(r"<td>(yes|no)</td>", cells) for key, cells in rows}
    for key in ("schema", "name", "k1_Nm_rad", "sense_rate_Hz", "eps2", "lambda_1_s"):
        assert needed[key] == ["yes"], key
    for key in ("extends", "axes", "dead_zone_rad", "setpoint_filter_Hz", "zero_rad"):
        assert needed[key] == ["no"], key


@pytest.mark.ci
def test_every_command_and_option_is_on_the_site(site):
    page = text_of(site / "command-line.html")
    names = made.commands()
    assert {"esea-gen build", "esea-gen reproduce chapter4", "esea-gen traces accept"} <= set(names)
    for name, command in names.items():
        assert f"{name} " in page
        for p in command.params:
            wanted = p.opts[0] if p.opts[0].startswith("-") else str(p.metavar or p.name)
            assert wanted in page, (name, wanted)
    assert "generated/<device>" in page


@pytest.mark.ci
def test_everything_public_is_on_the_site(site):
    pages = "".join(p.read_text(encoding="utf-8") for p in (site / "api").glob("*.html"))
    named = set(re.findall(r'id="(esea_(?:gen|host)[^"]+)"', pages))
    assert {item.name for module in made.modules() for item in made.items(module)} - named == set()


@pytest.mark.ci
def test_the_site_fetches_nothing(site):
    for page in site.rglob("*.html"):
        fetched = re.findall(
            r'<(?:script|img|link|iframe)\b[^>]*\b(?:src|href)="(?:https?:)?//[^"]+"',
            page.read_text(encoding="utf-8"),
        )
        assert fetched == [], page


@pytest.mark.ci
def test_the_site_holds_the_example_and_no_leftover(site):
    assert "def impedance(device: Device) -> Block:" in text_of(site / "own-system.html")
    assert "def proportional(base: Base) -> Block:" in text_of(site / "add-a-controller.html")
    for path in site.rglob("*.html"):
        assert "--8<--" not in path.read_text(encoding="utf-8"), path
    assert not list(site.rglob("*.py"))
    assert not (ROOT / "site").exists()


@pytest.mark.ci
def test_every_page_in_docs_is_in_the_menu(site):
    index = (site / "index.html").read_text(encoding="utf-8")
    for page in DOCS.glob("*.md"):
        assert re.search(rf'href="(?:\./)?{page.stem}\.html"', index), page.name
        words = page.read_text("utf-8").split()
        assert len(words) <= 900 or "*Made" in words, page.name  # but reference from the program


@pytest.mark.ci
def test_pages_fit_a_telephone_and_a_desk(site, tmp_path):
    """No page scrolls sideways; on a desk no table does, and identifiers in cells stay whole."""
    wide = """[...document.querySelectorAll('.md-typeset__scrollwrap')].filter(
        w => w.scrollWidth > w.clientWidth + 1).length"""
    split = """[...document.querySelectorAll('td code')].filter(
        c => /^\\w+$/.test(c.innerText) && c.getClientRects().length > 1).length"""
    with browser(tmp_path) as b:
        for page in ("index", "device-file", "states", "first-controller"):
            for width in (400, 1366, 1920):
                b.opened(site / f"{page}.html", width, "light")
                assert b.evaluate("document.documentElement.scrollWidth") == width, page
                assert b.evaluate(split) == 0, (page, width)
                assert width == 400 or b.evaluate(wide) == 0, (page, width)
