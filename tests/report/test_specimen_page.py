"""Specimen page: content, sources, rejected files."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.files import stamped
from esea_gen.identify import load_mapping, load_recordings
from tests.browser import browser, readable
from tests.report.test_report import Page
from tests.result_schemas import held
from tests.rigs import rig, written
from tests.typed import typed

pytestmark = pytest.mark.ci

SPECIMEN = """\
[specimen]
name = "A3"
serial = 71
material = "rubber <60 Shore A>"
geometry = "two rings of 20 mm"
measured = [2024-03-01, 2024-03-02]
[deflection]"""
CURVE = {
    key: {"value": value, "status": "identified", "source": "five rings, to their end"}
    for key, value in (("range_rad", 0.3), ("cycles", 1000.0), ("exponent", 5.0))
} | {"warn_share": {"value": 0.5, "status": "assumed", "source": "half"}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A mapping with its recording, and what identify wrote of it."""
    made = tmp_path_factory.mktemp("specimen")
    t, x, y = rig(*(0.05,) * 4, *(0.1,) * 4)
    path = written(made, t, x, y, ("[deflection]", SPECIMEN))
    done = CliRunner().invoke(app, ["identify", str(path), "--model", "stops", "--out", f"{made}"])
    assert done.exit_code == 0, done.output
    return made


@pytest.fixture
def at(folder, tmp_path, monkeypatch) -> Path:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(name: str, kind: str, content: dict) -> str:
    made = stamped(kind, {"simulated": False} | content)
    held(kind, made)
    Path(name).write_text(json.dumps(made))
    return name


def compared(chosen="slips", **other) -> str:
    identified = json.loads(Path("rig.json").read_text())
    rows = [
        {"model": m, "condition": c, "training": e / 2, "held_out": e, "operations": i}
        for m, i, error in (("stops", 330, 1.25), ("slips", 1700, 1.75))
        for c, e in (("last cycles", error), ("rig block 1", 4 * error))
    ]
    content = {k: identified[k] for k in ("mapping", "recordings", "full_scale_Nm")}
    content |= {"compare": rows, "chosen": chosen, "reasons": ["slips cost least."]}
    content |= {"terms": [], "notes": ["two were tried"]} | other
    return put("compared.json", "identify-compare", content)


def agreed(names=("A3", "B1")) -> str:
    pair = dict(zip(("bias_Nm", "low_Nm", "high_Nm"), (0.125, -0.25, 0.5), strict=True))
    a, b = names
    content = {
        "specimens": names,
        "rows": 18,
        "absolute": {"value": 0.875, "low": 0.5, "high": 0.96875},
        "consistent": {"value": 0.9375, "low": 0.75, "high": 0.984375},
        "agreements": [{"first": a, "second": b, **pair, "limit_error_Nm": 0.0625}],
        "apart_pct": {a: 5.25, b: 5.5},
        "published": "none",
    }
    return put("reliability.json", "reliability", content)


def life(serial=71, curve=CURVE, **other) -> str:
    halves = [0] * 48
    halves[3], halves[20] = 401, 6
    # Miner's sum of (3.3): the largest range of each class of 0.01 rad, 1000 cycles of 0.3 rad.
    most = sum(0.5 * h * (r / 0.3) ** 5 / 1000 for h, r in ((401, 0.04), (6, 0.21)))
    used = None if curve is None else {"least": most / 2, "most": most}
    one = {"serial": serial, "axis": 0, "seconds": 5400, "energy_J": 12.5, "full": 0}
    one |= {"halves": halves, "width_rad": 0.01, "life_used": used, "warns": False}
    content = {"device": "elbow", "simulated": True, "fatigue": curve, "couplings": [one]} | other
    return put("life.json", "host-life", content)


def page(line: str) -> str:
    done = CliRunner().invoke(app, f"specimen {line} --out page.html")
    assert done.exit_code == 0, done.output
    found = Page(Path("page.html").read_text())
    assert found.outward == []
    assert len(found.ids) == len(set(found.ids))
    return found.text


def test_the_page_names_every_part_that_is_not_known(at):
    text = page("map.toml rig.json")
    for command in (
        "esea-gen identify map.toml --compare --json compared.json",
        "esea-gen reliability SPECIMENS.toml --json reliability.json",
        "esea-host life ADDRESS --json life.json",
    ):
        # In the list on top, and where it would stand.
        assert text.count(command) == 2
    for part in ("the models were not compared", "two or more specimens", "no board told"):
        assert part in text
    for told in ("rubber <60 Shore A>", "two rings of 20 mm", "2024-03-01, 2024-03-02", "A3"):
        assert told in text
    assert "not said" not in text
    # And where the mapping says nothing of the specimen.
    path = at / "map.toml"
    path.write_text(path.read_text().replace(SPECIMEN, "[deflection]"))
    bare = page("map.toml rig.json")
    assert bare.count("not said") == 3 + 1  # material, geometry, days, and what to do about it


def test_intervals_and_bands_are_those_of_the_identification(at):
    content = json.loads((at / "rig.json").read_text())
    held("identify", content)
    (r,) = load_recordings(load_mapping(at / "map.toml"))
    scale, worth = content["full_scale_Nm"], {(w["torque"], w["rate"]): w for w in content["worth"]}
    training = np.concatenate([s.training for s in r.sets])
    unseen = np.concatenate([s.held_out for s in r.sets])
    assert worth[None, None]["band_Nm"] == content["uncertainty"]["band_Nm"]
    for name, low, high in (("5-25 %", 0.05, 0.25), ("75-100 %", 0.75, 1.0)):
        for key, rows in (("samples", training), ("held_out", unseen)):
            share = np.abs(r.tau_Nm[rows]) / scale
            assert worth[name, None][key] == int(np.sum((share > low) & (share <= high)))
    # Of a sine, by its true rate: the board's estimate lags and is smoothed.
    most = content["domain"]["omega_max_rad_s"]
    omega = np.abs(np.gradient(r.theta_rad, r.time_s))[training] / most
    rates = {"35-100 %", "> 100 %"}
    fast = sum(w["samples"] for (torque, rate), w in worth.items() if torque and rate in rates)
    assert fast == pytest.approx(np.sum(omega > 0.35), rel=0.03)
    text = page("map.toml rig.json")
    term = content["model"]["terms"][0]
    high = term["weight_Nm"] + 1.96 * term["sigma_Nm"]
    assert f"{high:.{max(0, 2 - math.floor(math.log10(high)))}f}" in text
    assert f"± {worth['5-25 %', None]['band_Nm']:.2g} N·m" in text


def test_what_earlier_commands_found_stands_as_they_said_it(at):
    text = page(f"map.toml {agreed()} {life()} rig.json {compared()}")
    assert "Not known yet" not in text
    for told in (
        "slips cost least. This page's torque model is another one: stops.",
        "5.00 (2.50)",
        "1 700",
        "ICC(2,1), absolute agreement 0.8750 0.5000 0.9688",
        "A3 − B1 0.125 −0.250 0.500 0.062",
        "A3 5.25 B1 5.50",
        "A simulated board counted this",
        "cycles 203.5",
        "1.50 h",
        "0.0300 0.0400 200.5",
        "1000 cycles of 0.3 rad end it, exponent 5; identified: five rings, to their end",
    ):
        assert told in text, told
    # 200.5 cycles of 0.04 rad and 3 of 0.21 rad, of 1000 cycles of 0.3 rad.
    assert "life used 0.0513 %" in text
    assert "made for this page" not in text


def test_a_life_without_a_curve_is_not_known(at):
    text = page(f"map.toml rig.json {life(curve=None)}")
    assert "life used not known the device file of elbow has no [fatigue]" in text
    assert "No fatigue curve" in text
    assert "203.5" in text


def change(name: str, **new) -> str:
    content = json.loads(Path(name).read_text())
    Path(name).write_text(json.dumps(content | new))
    return name


def without(name: str, key: str) -> str:
    content = json.loads(Path(name).read_text())
    del content[key]
    Path(name).write_text(json.dumps(content))
    return name


def other_recordings() -> str:
    rows = json.loads(Path("rig.json").read_text())["recordings"]
    return compared(recordings=[{**rows[0], "sha256": "0" * 16}])


def other_device() -> str:
    text = Path("rig.toml").read_text()
    assert "resolution_bits" in text
    weight = json.loads(Path("rig.json").read_text())["model"]["terms"][0]["weight_Nm"]
    assert repr(weight) in text
    Path("rig.toml").write_text(text.replace(repr(weight), repr(1.5 * weight)))
    return "rig.json"


@pytest.mark.parametrize(
    ("results", "says"),
    [
        (lambda: "none.json", "none.json: cannot be read (No such file"),
        (lambda: "rig.csv", "rig.csv: cannot be read as JSON"),
        (lambda: [Path("b.json").write_text('{"a": 1, "a": 2}'), "b.json"][1], "a name twice"),
        (
            lambda: change("rig.json", schema="friction"),
            "holds a result of 'friction'; expected: identify",
        ),
        (lambda: shutil.copy("rig.json", "b.json") + " rig.json", "is a result of 'identify' too"),
        (lambda: change("rig.json", schema_version=99), "has schema version 99"),
        (lambda: without("rig.json", "worth"), "rig.json: key worth is missing"),
        (lambda: change("rig.json", mean_rms=None), "rig.json: mean_rms = None"),
        (lambda: change(life(), couplings=[{"serial": 71}]), "key couplings[0].seconds is missing"),
        (lambda: agreed(("B1", "C7")), "the specimens B1, C7; map.toml has specimen 'A3'"),
        (lambda: life(serial=72), "contains coupling 72; map.toml has serial = 71"),
        (lambda: life(couplings=[]), "contains no coupling"),
        (other_recordings, "and map.toml have different recordings: rig.csv"),
        (lambda: "rig.json " + compared(full_scale_Nm=9.0), "its full scale is 9 Nm"),
        (other_device, "the device file beside it gives"),
        (lambda: shutil.copy("rig.json", "sub"), "its device file rig.toml is not beside it"),
    ],
)
def test_what_is_no_result_of_this_specimen_is_refused(at, results, says):
    (at / "sub").mkdir()
    done = typed("specimen", "map.toml", *results().split(), "--out", "page.html")
    assert done.returncode == 2
    assert says in " ".join(done.stderr.split())
    assert not (at / "page.html").exists()


def test_the_page_can_be_read_on_a_telephone(at, tmp_path):
    page(f"map.toml rig.json {agreed()} {life()} {compared()}")
    with browser(tmp_path / "profile") as b:
        readable(b, Path("page.html").read_text(), tmp_path)
