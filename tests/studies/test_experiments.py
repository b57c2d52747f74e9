"""The thesis' experiments on the virtual exoskeleton, and their results for the controllers."""

from __future__ import annotations

import csv
import dataclasses
import io
import json

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.studies import simulation as room
from esea_gen.studies.registry import load_study
from esea_gen.studies.responses import SWEEP, Frequency, StepStudy
from esea_gen.studies.simulation import ClosedLoopStudy, default_person, simulate
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.judge import judge
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.run import run_case
from tests.own_device import own_text
from tests.typed import typed


def shorter(case: Case, seconds: float) -> Case:
    t = case.trajectory
    n = round(1000 * seconds)
    cut = {"start": min(t.start, n - 1)} | {
        k: getattr(t, k)[:n]
        for k in ("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "tau_desired_Nm")
    }
    return dataclasses.replace(case, trajectory=dataclasses.replace(t, end=n, **cut))


def rms(study: str, controller: str, plant: str = "real", case: int = 0) -> float:
    person = default_person(study, plant)
    found = load_study(study, ClosedLoopStudy).cases()[case]
    if len(found.trajectory.tau_desired_Nm) > 25000:
        found = shorter(found, 25)
    figures = judge(found, run_case(found, Setting(controller, plant, person), seed=1), 0.221)
    assert not figures["unstable"]
    assert not figures["fault"]
    return figures["rms_true_Nm"]


@pytest.mark.ci
def test_improved_sliding_mode_against_the_printed_one():
    # Trials on the standard plant gave 0.513 Nm in the tuning case for the law as published, the
    # thesis measured 0.590 on its device.
    printed = rms("tuning", "smc-published")
    assert 0.45 < printed < 0.60
    assert rms("tuning", "smc") < 0.4 * printed
    assert rms("backdriven", "smc", case=3) < 0.65 * rms("backdriven", "smc-published", case=3)
    assert rms("bread", "smc") < 0.55 * rms("bread", "smc-published")


@pytest.mark.ci
@pytest.mark.parametrize(
    ("controller", "knows", "does_not"),
    [("smc-published", 0.72, 0.96), ("mpc-published", 1.09, 1.51)],
)
def test_a_baseline_is_worth_what_the_person_knows(controller, knows, does_not):
    # Medians of ten seeds; the trials' person, who knows the path, gave 0.67 with the first.
    case = load_study("bread", ClosedLoopStudy).cases()[0]
    for person, middle in (("uncertain", knows), ("uncertain-no-feedforward", does_not)):
        run = run_case(case, Setting(controller, "real", person), seed=1)
        assert judge(case, run, 0.221)["rms_true_Nm"] == pytest.approx(middle, rel=0.12)


def test_predictive_control_with_preview():
    assert rms("tuning", "mpc") < 0.05  # median over ten seeds: 0.040


def test_scaled_damping_is_one_that_the_device_may_render():
    wrist = load_device("wrist_drive")
    cases = load_study("impedance", ClosedLoopStudy).of(wrist).cases_run()
    most = wrist.file.passivity.Kd_max_Nms_rad.value
    assert max(c.tunables["reference"]["Kd_Nms_rad"] for c in cases) == pytest.approx(most)


def test_json_holds_every_case_and_seed(tmp_path):
    result = simulate("tuning", Setting("smc", person="none"), seed=3, runs=2, folder=tmp_path)
    content = result.to_dict()
    json.dumps(content, allow_nan=False)
    assert [(c["name"], c["seed"]) for c in content["cases"]] == [
        ("1.7 Nm 0.6 Hz", 3),
        ("1.7 Nm 0.6 Hz", 4),
    ]
    for c in content["cases"]:
        assert c["unstable"] is False
        assert 0 < c["rms_true_Nm"] < c["max_true_Nm"]
        assert c["rms_model_Nm"] > 0
    assert content["cases"][0]["rms_true_Nm"] != content["cases"][1]["rms_true_Nm"]
    assert content["percentiles"]["1.7 Nm 0.6 Hz"]["rms_true_Nm"]["count"] == 2
    rows = list(csv.DictReader(io.StringIO(result.csv())))
    assert [float(r["rms_true_Nm"]) for r in rows] == [c["rms_true_Nm"] for c in content["cases"]]
    # Resumed from the journal: the same numbers, nothing run again.
    told: list[tuple[int, int, int]] = []
    again = simulate(
        "tuning",
        Setting("smc", person="none"),
        seed=3,
        runs=2,
        folder=tmp_path,
        progress=lambda *a: told.append(a),
    )
    assert again.cases() == result.cases()
    assert told[0][0] == 2
    # The same text too, though a journal sorts its keys.
    assert again.csv() == result.csv()
    assert list(again.cases()[0]) == list(result.cases()[0])


def test_a_journal_of_other_c_is_not_taken_up(tmp_path, monkeypatch):
    told: list[tuple[int, int, int]] = []
    arguments = {"seed": 3, "runs": 2, "folder": tmp_path, "progress": lambda *a: told.append(a)}
    monkeypatch.setattr(room, "simulate_case", quick)
    simulate("tuning", Setting("smc", person="none"), **arguments)
    assert (told[0], told[-1]) == ((0, 2, 0), (2, 2, 0))
    told.clear()
    simulate("tuning", Setting("smc", person="none"), **arguments)
    assert told[0] == (2, 2, 0)
    told.clear()
    monkeypatch.setattr(room, "files_digest", lambda files: f"one more file than {len(files)}")
    simulate("tuning", Setting("smc", person="none"), **arguments)
    assert told[0] == (0, 2, 0)


def quick(seed: int, **_: object) -> dict[str, float]:
    """In place of a run: a figure that tells its seed; seed 5 trips, seed 6 fails."""
    if seed == 6:
        raise ArithmeticError("the plant left the page")
    rest = dict.fromkeys(("rms_model_Nm", "max_true_Nm", "unstable", "fault", "limited_share"), 0.0)
    return {"rms_true_Nm": 0.1 * seed, "tripped": float(seed == 5), **rest}


def at_rate(folder, rate_Hz: float, control_Hz: float) -> str:
    """The elbow's drive with other rates, slow enough for its motor's encoder."""
    path = folder / f"at{rate_Hz:g}.toml"
    numbers = {
        "timing": {"sense_rate_Hz": rate_Hz, "control_rate_Hz": control_Hz},
        "actuator": {"omega_max_rad_s": 5.0},
        "safety": {"omega_max_rad_s": 4.0},
    }
    numbers["timing"]["control_release_s"] = 1 / control_Hz
    path.write_text(own_text(name="other", **numbers))
    return str(path)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("rate_Hz", "control_Hz"), [(500.0, 250.0), (2000.0, 200.0), (1e3 / 3,) * 2]
)
def test_any_sensing_rate_is_simulated(tmp_path, rate_Hz, control_Hz):
    case = shorter(TuningCase().cases()[0], 18)
    run = run_case(case, Setting(at_rate(tmp_path, rate_Hz, control_Hz)), 0)
    # Told and judged in seconds, not in samples: a signal at another speed misses by more than 1.
    assert len(run) == len(case.trajectory.tau_desired_Nm)
    assert run.time_s[-1] == pytest.approx((len(run) - 1) / 1000)
    assert judge(case, run, 0.221)["rms_true_Nm"] < 0.15
    # Where the rate limit acts in one of two ticks, both count.
    assert (0.5 in run.controller["rate_limited"]) == (rate_Hz == 2000.0)
    # The control task runs as often as it says: its output holds in between.
    changes = np.flatnonzero(np.diff(run.controller["u_eq_Nm"][200:]))
    assert np.median(np.diff(changes)) == pytest.approx(1000 / control_Hz, abs=1)


def test_a_wrong_model_shows_in_the_true_torque_only():
    # The elastomer 10 % stiffer than the device file says: the sensor cannot see that.
    case = shorter(TuningCase().cases()[0], 20)
    stiff = dataclasses.replace(case, plant={"elastomer_scale": 1.1})
    plain, wrong = (judge(c, run_case(c, Setting("smc"), 0), 0.221) for c in (case, stiff))
    assert wrong["rms_true_Nm"] > plain["rms_true_Nm"] + 0.03
    assert wrong["rms_model_Nm"] < plain["rms_model_Nm"] + 0.03


@pytest.mark.ci
def test_step_frequency_and_output_impedance():
    steps = StepStudy().metrics(simulate("step", Setting("smc", "ideal")))
    for name in ("1 Nm", "2 Nm"):
        assert steps[name].stable, name
        assert abs(steps[name].steady_error_percent) < 5
    # At rest it hunts by little more than one count of an encoder is worth (1.5 mrad, 14 mNm).
    assert all(m.tail_rms < 0.022 for m in steps.values())
    (response,) = simulate("frequency", Setting("smc", "ideal")).kept.values()
    assert 3 < response.bandwidth().bandwidth_Hz < 8
    assert response.gain[0] == pytest.approx(1, abs=0.07)
    (port,) = simulate("output-impedance", Setting("smc", "ideal", "ideal")).kept.values()
    # Transparent: far below the drive's own inertia where it follows, and rising with frequency.
    frequency_Hz = port.angle.frequency_Hz
    inertia = port.angle.gain / (2 * np.pi * frequency_Hz) ** 2
    assert inertia[frequency_Hz < 2].max() < 0.2 * 0.663


def test_a_frequency_response_ends_where_the_drive_trips():
    (case,), trip = Frequency().cases(), 31_000
    desired = case.trajectory.tau_desired_Nm
    off = np.arange(len(desired)) >= trip
    plant = {"tau_e_Nm": np.where(off, 0.0, desired), "tripped": 2 * off}
    run = ClosedLoopRun(plant, {"fault": 0 * off}, np.arange(len(off)) * 1e-3)
    response = Frequency().keep(case, run)
    assert response.bandwidth().bandwidth_Hz is None
    assert 4 < response.frequency_Hz[-1] < SWEEP.start_Hz + SWEEP.rate_Hz_s * 30


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["flying"], "Unknown study 'flying'. Choose from backdriven, bread"),
        (["tuning", "--plant", "bad"], "Unknown plant 'bad'. Choose from ideal, real, random"),
        (["bread", "--person", "me"], "Unknown person 'me'"),
        (["bread", "--person", "none"], "bread needs a person to move the load"),
        (["tuning", "--real", "f16"], "Unknown number format 'f16'"),
        (["tuning", "--figure", "a.txt"], "not the name of a picture file"),
        (["tuning", "--jobs", "0"], "Give 1 or more, or -1"),
    ],
)
def test_bad_input_is_explained(arguments, said):
    done = typed("simulate", *arguments)
    assert done.returncode == 2, done.stderr
    assert said in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_a_device_without_a_drive_is_refused(tmp_path):
    path = tmp_path / "plain.toml"
    path.write_text('schema = 1\nextends = "elbow"\nname = "plain"\ntitle = "plain"\n')
    with pytest.raises(UserError, match="no drive to be simulated"):
        simulate("tuning", Setting(str(path)))
