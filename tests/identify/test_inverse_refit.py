"""The inverse of the device file: its choice, its refit to recordings, and how it is verified."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.device import Device, load_device, parse_device
from esea_gen.devices.file import render_toml
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, block_system, compile_block, compile_device
from esea_gen.identify.inverse import judge_inverse, refit_inverse
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording
from esea_gen.language.stream import Stream, single
from esea_gen.model.published_inverse import published_inverse
from esea_gen.reproduce.torque_model import sensed_torque
from esea_gen.verify.bounds import forward_residual
from esea_gen.verify.compare import compare
from esea_gen.verify.equivalence import verify
from esea_gen.verify.runs import run_c
from esea_gen.verify.streams import streams
from tests.conftest import ROOT

pytestmark = pytest.mark.ci

HDRB = ROOT / "tests" / "data" / "hdrb" / "hdrb.toml"
SOURCE = 'status = "identified", source = "a test"'


def with_inverse(elbow: Device, *lines: str, old: str = "", new: str = "") -> Device:
    text = elbow.toml().replace(old, new) if old else elbow.toml()
    return parse_device(text + "\n[inverse]\n" + "\n".join(lines) + "\n", "mine.toml")


# -- choice ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "old", "new", "said"),
    [
        (('kind = "exact"', 'filter = "b"'), "", "", "inverse.filter = 'b' has no meaning"),
        (('kind = "published"',), "value = 9.39", "value = 0.0", "no unique inverse"),
        (('kind = "exact"',), "value = 9.39", "value = 0.0", "no unique inverse"),
        (
            ('kind = "published"', f"kappa_rad = {{ value = 0.0, {SOURCE} }}"),
            "",
            "",
            "inverse.kappa_rad = 0: the set-point would be 0",
        ),
        (
            ('kind = "published"', f"phi_1_rad = {{ value = 5.1, {SOURCE} }}"),
            "",
            "",
            "inverse.phi_1_rad = 5.1 1/rad is above its limit 5",
        ),
        (
            ('kind = "published"', 'filter = "a"'),
            "sense_rate_Hz = { value = 1000.0",
            "sense_rate_Hz = { value = 500.0",
            "made for 1000 Hz, but timing.sense_rate_Hz = 500 Hz",
        ),
        (
            ('kind = "published"',),
            "[elastomer]\n",
            f"[elastomer]\ndead_zone_rad = {{ value = 0.05, {SOURCE} }}\n",
            "the published envelope (4.13) has no dead zone",
        ),
        (('kind = "best"',), "", "", "inverse.kind = 'best'"),
    ],
)
def test_what_cannot_be_is_refused(elbow, lines, old, new, said):
    with pytest.raises(UserError) as caught:
        with_inverse(elbow, *lines, old=old, new=new)
    assert said in str(caught.value)
    assert "mine.toml" in str(caught.value)
    assert caught.value.fix


# -- refit ----------------------------------------------------------------------------------------


def recording(label: str, theta, tau, trained: float = 0.7) -> Recording:
    n = len(theta)
    at = np.arange(n)
    cut = int(trained * n)
    whole = DataSet(label, float(np.abs(theta).max()), at[:cut], at[cut:], {}, None, None, None)
    return Recording(label, f"{label}.csv", "0" * 16, at * 1e-3, theta, tau, True, 0, (), (whole,))


def made_by_the_inverse(elbow: Device, noise_rad: float = 0.0) -> Recording:
    runner = compile_block(published_inverse(elbow, kappa=0.12, phi=3.0, chi=0.004))
    t = np.arange(8000) * 0.0125
    tau = 4 * np.sin(2 * np.pi * 0.05 * t) * (0.5 + 0.5 * np.sin(2 * np.pi * 0.013 * t))
    theta = runner.run({"tau_Nm": tau}, trace=False)[0]["theta_rad"]
    return recording("own", theta + noise_rad * np.random.default_rng(3).normal(size=len(t)), tau)


def test_data_of_the_inverse_itself_give_its_parameters_back(elbow):
    fit = refit_inverse(elbow, [made_by_the_inverse(elbow)], "a test")
    assert fit.values["kappa_rad"] == pytest.approx(0.12, rel=1e-6)
    assert fit.values["phi_1_rad"] == pytest.approx(3.0, rel=1e-5)
    assert fit.values["chi_rad"] == pytest.approx(0.004, rel=1e-6)
    assert fit.sets.mean_rms(True) < 1e-9
    assert fit.published.mean_rms(True) > 1e-3
    section = fit.device.file.inverse
    assert section.kind == "published"
    assert section.chi_rad.status == "identified"
    assert section.chi_rad.source.startswith("a test")
    # Written and read back, it is the same device and the same inverse.
    again = parse_device(render_toml(fit.device.file), "again.toml")
    assert again.canonical() == fit.device.canonical()
    assert again.inverse.name == "inverse_plays"


@pytest.fixture(scope="module")
def noisy(elbow):
    data = made_by_the_inverse(elbow, 1e-3)
    return data, refit_inverse(elbow, [data], "a test", population=16)


def test_standard_deviations_cover_and_phi_is_called_unidentifiable(elbow, noisy):
    data, fit = noisy
    for key, truth in (("kappa_rad", 0.12), ("phi_1_rad", 3.0), ("chi_rad", 0.004)):
        assert abs(fit.values[key] - truth) < 4 * fit.sigma[key]
    # chi shows sharply, phi only in company of kappa.
    assert fit.sigma["chi_rad"] < 0.01 * 0.004
    assert fit.sigma["phi_1_rad"] > 0.05 * 3
    assert fit.correlation["phi_1_rad kappa_rad"] > 0.95
    assert fit.phi_range_1_rad == (0.0, 5.0)
    assert any("phi is not identifiable" in n for n in fit.notes)
    assert fit.sets.mean_rms(True) == pytest.approx(1e-3, rel=0.05)
    assert json.loads(json.dumps(fit.to_dict(), allow_nan=False)) == fit.to_dict()
    assert refit_inverse(elbow, [data], "a test", population=16).to_dict() == fit.to_dict()


def excitations(elbow: Device) -> list[Recording]:
    """The three of the thesis, from the forward model; every sample trains."""
    sensor = compile_device(elbow, "f64").block("sensor")
    t = np.arange(100_000) * 1e-3
    out = [("slow", np.deg2rad(10) * np.sin(2 * np.pi * 0.01 * t))]
    for amplitude, top_Hz in ((5, 1.5), (10, 1.0)):
        end_s = top_Hz / (0.5 / 60)
        s = np.arange(round(end_s * 1e3)) * 1e-3
        sweep = np.deg2rad(amplitude) * np.sin(np.pi * top_Hz / end_s * s * s)
        out.append((f"sweep {amplitude}", sweep))
    return [
        recording(label, theta[::10], sensed_torque(elbow, sensor, theta)[::10], 1.0)
        for label, theta in out
    ]


def test_refit_on_the_published_excitations_is_near_table_4_2(elbow):
    fit = refit_inverse(elbow, excitations(elbow), "the forward model")
    ours, theirs = fit.sets.mean_rms(False), fit.published.mean_rms(False)
    # Measured: 1.77 % of the largest deflection against 1.78 % by table 4.2.
    assert 0.95 * theirs < ours < 1.02 * theirs
    assert ours < 0.02 * elbow.file.domain.theta_max_rad.value
    assert fit.values["kappa_rad"] == pytest.approx(0.106, rel=0.03)
    assert fit.values["chi_rad"] == pytest.approx(0.00233, rel=0.2)
    assert any("phi" in n for n in fit.notes)


def test_the_search_is_no_local_one(noisy):
    # Any other (phi, chi) with its own best kappa is worse: a brute force over the bounds.
    data, fit = noisy
    tau, theta, at = data.tau_Nm, data.theta_rad, data.sets[0].training
    best = np.inf
    envelope = np.interp(tau, 239 * (x := np.linspace(-0.3, 0.3, 20001)) ** 3 + 9.39 * x, x)
    for chi in np.geomspace(1e-4, 0.1, 30):
        r = chi * np.arange(1, 11)
        play, plays = np.zeros(10), np.empty((len(tau), 10))
        for k, g in enumerate(envelope):
            play = np.maximum(g - r, np.minimum(g + r, play))
            plays[k] = play
        for phi in (0.0, 2.5, 5.0):
            unit = (plays @ np.exp(-phi * r))[at]
            kappa = unit @ theta[at] / (unit @ unit)
            best = min(best, float(np.sqrt(np.mean((kappa * unit - theta[at]) ** 2))))
    assert fit.sets.mean_rms(False) <= best * (1 + 1e-6)


def test_refit_refuses_what_it_cannot_do(elbow):
    data = made_by_the_inverse(elbow)
    with pytest.raises(UserError, match=r"a torque of 39.9 Nm is above elbow's limits\.tau_Nm"):
        refit_inverse(elbow, [replace(data, tau_Nm=10 * data.tau_Nm)], "a test")
    held = replace(data.sets[0], training=data.sets[0].training[:0])
    with pytest.raises(UserError, match="No recording trains"):
        refit_inverse(elbow, [replace(data, sets=(held,))], "a test")
    line = f"[elastomer]\ndead_zone_rad = {{ value = 0.05, {SOURCE} }}\n"
    zoned = parse_device(elbow.toml().replace("[elastomer]\n", line), "dz.toml")
    with pytest.raises(UserError, match="has no dead zone"):
        refit_inverse(zoned, [data], "a test")


def test_identify_with_inverse_writes_the_section(tmp_path):
    arguments = ["identify", str(HDRB), "--inverse", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "i.json")])
    assert done.exit_code == 0, done.output
    assert "play operators refitted" in done.output
    device = load_device(tmp_path / "hdrb.toml")
    assert device.inverse.name == "inverse_plays"
    content = json.loads((tmp_path / "i.json").read_text())["inverse"]
    assert content["parameters"]["chi_rad"]["value"] == device.file.inverse.chi_rad.value
    statuses = [getattr(device.file.inverse, k).status for k in content["parameters"]]
    sure = [p["sigma"] < p["value"] for p in content["parameters"].values()]
    assert [s == "identified" for s in statuses] == sure == [False, False, True]
    # On real rubber, on cycles not seen: far better than the elbow's own table.
    means = content["mean_rms"]
    assert means["held_out_percent"] < 0.5 * content["mean_rms_published"]["held_out_percent"]
    assert means["held_out_percent"] < 7
    # The same per cent on the terminal, each under its name.
    for what, found in (("refitted", means), ("table 4.2", content["mean_rms_published"])):
        told = re.search(rf"^  {what} +training +(\S+) %, held out +(\S+) % of", done.output, re.M)
        assert told is not None, done.output
        assert [float(x) for x in told.groups()] == pytest.approx(
            [found["training_percent"], found["held_out_percent"]], abs=0.006
        )
    # Written once more it is the file of before: ours, so it may be replaced, with its comments.
    assert "# Weight kappa of the play operators, eq. 4.9." in (tmp_path / "hdrb.toml").read_text()
    assert judge_inverse(device, []).sets == ()


# -- verification ---------------------------------------------------------------------------------


class WithInverse(Device):
    """A device whose shipped System is its inverse."""

    @cached_property
    def system(self):
        return block_system(self.inverse)


@pytest.fixture(scope="module")
def inverting(elbow) -> WithInverse:
    return WithInverse(elbow.file, elbow.origin)


def test_a_system_with_the_exact_inverse_is_verified(inverting):
    result = verify(inverting)
    assert result.passed, [c for c in result.comparisons if not c.passed]
    assert result.bounds == {}
    limit = 5e-6 * 20  # of the torque limit, in Nm
    for c in result.comparisons:
        size, allowed = c.residual
        assert allowed == pytest.approx(limit)
        assert size < (1e-9 if c.real == "f64" else 2e-5), (c.real, c.stream)
        assert c.bit_identical is (True if c.real == "f64" else None)
    assert any(c.residual[0] > 0 for c in result.comparisons)
    assert result.to_dict()["comparisons"][0]["residual_limit_Nm"] == pytest.approx(limit)


def mutant(device: Device, real: str, change) -> HostLibrary:
    renderer = Renderer(device.system, FORMATS[real], "-", "-", device.title)
    files = renderer.files()
    name = "esea_inverse_alone_inverse.c"
    changed = change(files[name])
    assert changed != files[name]
    files[name] = changed
    renderer.files = lambda: files  # type: ignore[method-assign]
    return HostLibrary(device.system, renderer)


@pytest.mark.parametrize(
    "change",
    [
        # Everywhere, so that the Block's own residual cannot see it: its model is wrong, too.
        lambda text: text.replace("239.0f", "239.1f"),
        lambda text: text.replace("9.39f", "9.391f"),
        lambda text: text.replace("51.6f", "51.7f"),
    ],
)
def test_a_wrong_model_in_the_inverse_is_seen_although_its_own_residual_is_small(inverting, change):
    library = mutant(inverting, "f32", change)
    block, found = inverting.inverse, []
    for stream in streams(block)[:4]:
        result = compare(inverting, block, library, stream, {}, None)
        y, _ = run_c(library.block("inverse"), stream)
        said, computed = forward_residual(inverting, block, stream, y)
        assert said < 1e-4
        found.append(computed > 1e-4 and any("symbolic sensor" in p for p in result.problems))
    assert any(found)


def test_a_residual_that_is_not_a_number_does_not_pass(inverting):
    library = mutant(
        inverting,
        "f32",
        lambda text: text.replace("out->residual_Nm = ", "out->residual_Nm = 0.0f / 0.0f + "),
    )
    stream = Stream("quiet", {"tau_Nm": single(np.linspace(0, 1, 50))})
    result = compare(inverting, inverting.inverse, library, stream, {}, None)
    assert any("by its own output: nan" in p for p in result.problems)
    assert not result.passed
