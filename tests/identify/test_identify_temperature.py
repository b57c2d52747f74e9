"""Temperature coefficient identified from simulated recordings; no real one has a temperature.

The rubber is written here a second time: springs, two stop operators at thresholds that no
candidate has, an offset; all but the offset change by -0.4 % a kelvin of what they are at 23 degC.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError
from esea_gen.identify import judge, load_mapping, load_recordings
from esea_gen.identify.family.fit import UnitTerms, fit_member, members, misfits_of
from esea_gen.identify.family.identification import identify_member
from esea_gen.identify.notes import temperature_notes
from esea_gen.identify.recording.conditions import searched_factor
from esea_gen.model.family import Member, Rise, Term
from esea_gen.model.temperature import TemperatureFactor
from tests.identify.test_recordings import MAPPING
from tests.rigs import says, table

PER_K, AT_23_C, NOISE_Nm = -0.004, 23.0, 0.01
MODEL = "stops, Maxwell, offset"
HELD_OUT_RULE = "[cycles]\nhold_out_last = 1\n\n"


def rubber(theta: np.ndarray, temperature_C: float, per_K: float = PER_K) -> np.ndarray:
    """Torque along a deflection, in rad and Nm, from rest."""
    found, stuck = [], np.zeros(2)
    last = 0.0
    for value in theta:
        stuck = np.clip(stuck + value - last, -np.array([0.011, 0.045]), [0.011, 0.045])
        last = value
        found.append(8.0 * value + 180.0 * value**3 + stuck @ [9.0, 4.0])
    return (1 + per_K * (temperature_C - AT_23_C)) * np.array(found) - 0.06


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Three amplitudes, five cycles each."""
    t = np.arange(1501) / 100
    return t, np.where(t < 5, 0.06, np.where(t < 10, 0.12, 0.18)) * np.sin(2 * np.pi * t)


def recorded(
    folder: Path,
    uses: dict[float, str],
    per_K: float = PER_K,
    stated: bool = True,
    status: str = "published",
    law=rubber,
    noise_Nm: float = NOISE_Nm,
) -> Path:
    """A mapping and a recording for each temperature, with noise."""
    rows = []
    t, theta = motion()
    for i, (c, use) in enumerate(uses.items()):
        noise = np.random.default_rng(i).normal(0, noise_Nm, len(t))
        tau = law(theta, c, per_K) + noise
        (folder / f"at{c:g}.csv").write_text(table(t, np.degrees(theta), tau))
        known = f'temperature_C = {{ value = {c!r}, status = "{status}", source = "bath" }}\n'
        rows.append(f'[[recording]]\nfiles = ["at{c:g}.csv"]\nuse = "{use}"\n' + known * stated)
    text = MAPPING.replace('[[recording]]\nfiles = ["rig.csv"]\n', HELD_OUT_RULE + "\n".join(rows))
    (folder / "map.toml").write_text(text)
    return folder / "map.toml"


THREE = {15.0: "cycles", 23.0: "cycles", 31.0: "cycles"}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return identify_member(recorded(tmp_path_factory.mktemp("warm"), THREE), MODEL)


def test_the_change_a_kelvin_is_found_again(found):
    """Within 5 %, and the truth is in its interval."""
    factor = found.fitted.temperature
    assert (factor.reference_C, factor.low_C, factor.high_C) == (23.0, 15.0, 31.0)
    assert factor.per_K == pytest.approx(PER_K, rel=0.05)
    assert 0 < found.sigma_per_K < 0.05 * abs(PER_K)
    assert abs(factor.per_K - PER_K) < 4 * found.sigma_per_K
    offsets = [w for w, t in found.fitted.used if t.kind == "offset"]
    assert offsets == pytest.approx([-0.06], abs=0.01)


def test_its_own_c_is_judged_at_each_temperature(found):
    """What the device's C gives at 15 and 31 degC, against the rubber without noise."""
    _, theta = motion()
    for r in found.recordings:
        truth = rubber(theta, r.temperature_C)
        error = found.verdict.torque_Nm[r.label] - truth
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.abs(truth).max(), r.label
    assert found.to_dict()["mean_rms"]["held_out_Nm"] < 0.02


def errors(folder: Path, stated: bool) -> tuple[float, float]:
    """RMS in Nm at 31 degC, and at 15 and 23, which train."""
    folder.mkdir()
    uses = {15.0: "train", 23.0: "train", 31.0: "held_out"}
    recordings = load_recordings(load_mapping(recorded(folder, uses, stated=stated)))
    terms = UnitTerms(next(m for m in members() if m.name == MODEL), recordings, 100.0)
    fitted = fit_member(terms, recordings, 3.0)
    if stated:
        # Of what the weights are at 19 degC, the mean in training.
        assert fitted.temperature.reference_C == 19.0
        assert fitted.temperature.per_K == pytest.approx(PER_K / 1.016, rel=0.05)
        assert fitted.temperature.high_C == 31.0
    else:
        assert fitted.temperature is None
    found = misfits_of(terms, recordings, fitted)
    return found.mean_rms(True), found.mean_rms(False)


def test_a_temperature_left_out_is_predicted(tmp_path):
    """As well as those that train; without the factor 19 to 31 degC cost 4.8 % of the torque."""
    (without, _), (held_out, trained) = (errors(tmp_path / str(s), s) for s in (False, True))
    _, theta = motion()
    assert without > 0.9 * np.sqrt(np.mean((0.048 * (rubber(theta, 23.0) + 0.06)) ** 2)) > 0.03
    assert held_out < 1.1 * trained
    assert trained < 1.5 * NOISE_Nm


def springs(theta: np.ndarray, temperature_C: float, per_K: float) -> np.ndarray:
    return (1 + per_K * (temperature_C - AT_23_C)) * (8 * theta + 180 * theta**3) - 0.06


@pytest.mark.parametrize(
    ("uses", "said"),
    [
        ({22.0: "cycles", 24.0: "cycles"}, "Training is at 22 to 24 degC"),
        ({15.0: "cycles", 31.0: "held_out"}, "Training is at 15 to 15 degC"),
    ],
)
def test_too_near_or_one_temperature_tells_nothing(tmp_path, uses, said):
    """Not known, and said so."""
    recordings = load_recordings(load_mapping(recorded(tmp_path, uses)))
    member = Member("one", "one", (Term("spring", Rise("power", 1)),))
    assert fit_member(UnitTerms(member, recordings, 100.0), recordings, 3.0).temperature is None
    (note,) = temperature_notes(recordings)
    assert "not known" in note
    assert said in note


def test_no_change_is_not_told_from_none(tmp_path):
    """Of a rubber without one: the interval holds 0, and the note says so."""
    done = identify_member(recorded(tmp_path, THREE, 0.0, status="assumed"), MODEL)
    assert abs(done.fitted.temperature.per_K) < 4 * done.sigma_per_K < 2e-4
    assert done.device.file.family.temperature.per_K.status == "assumed"
    told = [*temperature_notes(done.recordings, TemperatureFactor(23, 1e-5, 15, 31), 1e-4)]
    assert "cannot be distinguished from zero" in told[-1]
    told = [*temperature_notes(done.recordings, TemperatureFactor(23, 3e-4, 15, 31), 1e-4)]
    assert len(told) == 1


@pytest.mark.parametrize("truth", [-0.0049, 0.0, 0.013])
def test_the_search_is_the_optimum_of_another_solver(truth):
    """One spring and an offset: the torque is linear in k, k per_K and the offset."""
    rng = np.random.default_rng(3)
    at_C = np.repeat([10.0, 20.0, 40.0], 200)
    x = rng.uniform(-1, 1, 600)
    y = 2.0 * (1 + truth * (at_C - 23.3)) * x + 0.3 + rng.normal(0, 0.02, 600)
    member = Member("two", "two", (Term("spring", Rise("power", 1)), Term("offset")))
    basis = np.column_stack([x, np.ones(600)])

    sets = (SimpleNamespace(training=[0]),)
    recordings = [SimpleNamespace(temperature_C=c, sets=sets) for c in (10.0, 20.0, 40.0)]
    factor = searched_factor(
        member, recordings, at_C, basis, y, lambda b, t: np.linalg.lstsq(b, t, rcond=None)[0]
    )
    assert factor.reference_C == 23.3
    k, slope, _ = np.linalg.lstsq(
        np.column_stack([x, x * (at_C - 23.3), np.ones(600)]), y, rcond=None
    )[0]
    assert factor.per_K == pytest.approx(slope / k, abs=1e-7)


@pytest.mark.parametrize(("side", "room_K"), [(1, 42.5), (-1, 8.5)])
def test_the_factor_keeps_its_least_at_every_known_temperature(side, room_K):
    """Trained at 20 and 25 degC; one at -20 and one at 31 only judge, and it holds there, too."""
    rng = np.random.default_rng(4)
    at_C, x = np.repeat([20.0, 25.0], 100), rng.uniform(-1, 1, 200)
    y = 2.0 * (1 + side * 0.1 * (at_C - 22.5)) * x
    member = Member("one", "one", (Term("spring", Rise("power", 1)),))
    trained = (SimpleNamespace(training=[0]),)
    known = [(-20.0, ()), (20.0, trained), (25.0, trained), (31.0, ())]
    recordings = [SimpleNamespace(temperature_C=c, sets=s) for c, s in known]
    factor = searched_factor(
        member, recordings, at_C, x[:, None], y, lambda b, t: np.linalg.lstsq(b, t, rcond=None)[0]
    )
    facts = field_facts("family.temperature.per_K")
    most = min(0.8 / room_K, facts["high"] if side > 0 else -facts["low"])
    assert factor.per_K == pytest.approx(side * most, rel=2e-3)
    assert factor.ends[0] >= 0.2


# The mapping file.


def test_a_column_gives_its_mean(tmp_path):
    t, theta = motion()
    warm = 296.15 + 0.5 * np.sin(t)
    rows = np.column_stack([t, np.degrees(theta), rubber(theta, 23.0), warm])
    np.savetxt(tmp_path / "rig.csv", rows, delimiter=",", header="t,x,y,T", comments="")
    section = '[temperature]\ncolumn = "T"\nunit = "K"\n\n'
    (tmp_path / "map.toml").write_text(MAPPING.replace("[[rec", f"{section}[[rec"))
    (r,) = load_recordings(load_mapping(tmp_path / "map.toml"))
    assert r.temperature_C == pytest.approx(23.0 + 0.5 * np.mean(np.sin(t)))

    def error(text: str) -> UserError:
        (tmp_path / "map.toml").write_text(MAPPING.replace("[[rec", f"{text}[[rec"))
        with pytest.raises(UserError) as caught:
            load_recordings(load_mapping(tmp_path / "map.toml"))
        return caught.value

    says(
        error(section.replace("K", "C")),
        "column 'T'",
        "outside -60 to 200 degC",
        "temperature.unit",
    )
    says(error(section.replace('"T"', '"t"')), "column 't' is named twice")
    rows[:, 3] += np.linspace(0, 4, len(t))
    np.savetxt(tmp_path / "rig.csv", rows, delimiter=",", header="t,x,y,T", comments="")
    says(error(section), "more than 3 K", "one temperature")


def test_a_recording_beyond_the_range_is_not_judged(found, tmp_path):
    recordings = load_recordings(load_mapping(recorded(tmp_path, {45.0: "cycles"})))
    with pytest.raises(UserError, match=r"recorded at 45 degC, outside 15 to 31 degC"):
        judge(found.device, recordings)
