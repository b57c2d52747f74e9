"""Torque check: sensors with known errors fail by the criterion for that error."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import esea_gen
from esea_gen.errors import UserError
from esea_gen.studies.torque_check.check import TorqueCheck
from esea_gen.studies.torque_check.procedure import (
    LIMITS,
    KnownLoad,
    largest_torque_Nm,
    load_range_Nm,
    procedure,
    static_torque_Nm,
)
from esea_gen.studies.torque_check.recording import CheckRecording, apply_recording
from tests import typed

FULL = 4.47
TORQUE = 1.0 * 9.81 * 0.2
RATE_HZ = 100.0
SETTLE_S, RECORD_S, HANDLING_S = 5.0, 10.0, 3.0
KNOWN = KnownLoad(1.0, 0.2)
STIFFER = 1.64  # the elbow's rubber under that load, over unloaded


def limit(name: str) -> float:
    return next(x for x in LIMITS if x.name == name).torque_Nm(FULL, TORQUE)


def sensor(
    *,
    offset: float = 0.0,
    gain: float = 1.0,
    minus_gain: float | None = None,
    left: float = 0.0,
    scatter: float = 0.0,
    creep: float = 0.0,
    noise: float = 0.002,
    labelled: bool = True,
    repeats: int = 3,
    seed: int = 1,
) -> CheckRecording:
    """What a sensor with known errors records of the whole procedure.

    Offset and what stays ``left`` after the first load in Nm; ``scatter`` is added to the second
    load of each direction; ``creep`` in Nm over the recorded part of every loaded phase.
    """
    rng = np.random.default_rng(seed)
    tau, labels, last, loads = [], [], offset, 0
    for step in procedure(repeats):
        sign = {"zero": 0, "plus": 1, "minus": -1}[step.kind]
        share = minus_gain if sign < 0 and minus_gain is not None else gain
        level = sign * share * TORQUE + offset * (STIFFER if sign else 1)
        level += left if loads == 1 and sign == 0 else 0
        if sign:
            loads += 1
            level += sign * scatter * (step.label.endswith("_2"))
        ramp = np.linspace(last, level, round(HANDLING_S * RATE_HZ))
        t = np.arange(round((SETTLE_S + RECORD_S + 0.5) * RATE_HZ)) / RATE_HZ
        # A swing that has died away before the phase is judged.
        swing = 0.4 * np.exp(-t / 0.7) * np.sin(2 * np.pi * 1.1 * t) * abs(sign)
        held = level + swing + sign * creep * (t - SETTLE_S - RECORD_S / 2) / RECORD_S
        tau += [ramp, held]
        labels += [""] * len(ramp) + [step.label] * len(held)
        last = level
    values = np.concatenate(tau)
    values = values + rng.normal(0, noise, len(values))
    time = 12.5 + np.arange(len(values)) / RATE_HZ
    return CheckRecording("rig.csv", time, values, tuple(labels) if labelled else None)


def checked(device, recording: CheckRecording, known: KnownLoad = KNOWN, **more) -> TorqueCheck:
    check = TorqueCheck(device, known, **more)
    apply_recording(check, recording)
    return check


def failing(check: TorqueCheck) -> set[str]:
    return {d.criterion for d in check.decisions if not d.passed}


# -- every criterion ----------------------------------------------------------------------------


@pytest.mark.parametrize("labelled", [True, False])
def test_a_good_sensor_passes(elbow, labelled):
    check = checked(elbow, sensor(offset=0.02, gain=1.02, left=0.02, labelled=labelled))
    assert check.verdict == "pass"
    assert not check.missing
    assert [m.label for m in check.measurements] == [s.label for s in procedure()]
    errors = [e for _, e in check.readings]
    # The zero is taken off; what stays after the first load is shared by both beside it.
    assert errors == pytest.approx([0.02 * TORQUE] * 6, abs=0.013)
    assert {d.criterion for d in check.decisions} == {x.name for x in LIMITS}
    counts = {n: sum(d.criterion == n for d in check.decisions) for n in ("zero", "accuracy")}
    assert counts == {"zero": 7, "accuracy": 6}


# Each fault just below and just above the limit, and the criteria that see the larger one.
FAULTS = [
    ("zero", lambda x: {"offset": x}, limit("zero"), {"zero"}),
    ("zero, negative", lambda x: {"offset": -x}, limit("zero"), {"zero"}),
    (
        "zero return",
        lambda x: {"left": x, "offset": -0.05, "gain": 1.01},
        limit("zero return"),
        {"zero return"},
    ),
    (
        "repeatability",
        lambda x: {"scatter": x, "gain": 1 - x / 2 / TORQUE},
        limit("repeatability"),
        {"repeatability"},
    ),
    ("drift", lambda x: {"creep": x}, limit("drift"), {"drift"}),
    ("drift, down", lambda x: {"creep": -x}, limit("drift"), {"drift"}),
    ("noise", lambda x: {"noise": x}, limit("noise"), {"noise"}),
    (
        "symmetry",
        lambda x: {"gain": 1 + x / 2 / TORQUE, "minus_gain": 1 - x / 2 / TORQUE},
        limit("symmetry"),
        {"symmetry"},
    ),
]


@pytest.mark.parametrize(("name", "fault", "edge", "seen"), FAULTS, ids=[f[0] for f in FAULTS])
def test_each_fault_fails_its_own_criterion(elbow, name, fault, edge, seen):
    below, above = (checked(elbow, sensor(**fault(k * edge))) for k in (0.93, 1.07))
    assert below.verdict == "pass", failing(below)
    assert above.verdict == "fail"
    assert failing(above) == seen
    report = " ".join(" ".join(above.report()).split())
    assert f"{next(iter(seen))} FAILED" in report
    assert report.endswith("Verdict: FAIL")


def expanded(known: KnownLoad) -> float:
    """Second derivation: by changing each quantity a little."""
    total = 0.0
    for key in ("mass_kg", "arm_m", "angle_rad", "g_m_s2"):
        u = getattr(known, f"u_{key}")
        value = getattr(known, key)
        ends = [replace(known, **{key: value + s * 1e-4}).torque_Nm for s in (-1, 1)]
        total += ((ends[1] - ends[0]) / 2e-4 * u) ** 2
        if key == "angle_rad":
            curve = (ends[0] - 2 * known.torque_Nm + ends[1]) / 1e-8
            total += 0.5 * (curve * u * u) ** 2
    return 2 * math.sqrt(total)


@pytest.mark.parametrize("gain_error", [1, -1])
@pytest.mark.parametrize(
    "known", [KNOWN, replace(KNOWN, u_arm_m=0.0015), replace(KNOWN, u_mass_kg=0.0, u_arm_m=0.0)]
)
def test_accuracy_is_the_limit_less_the_uncertainty(elbow, gain_error, known):
    most = 0.03 * TORQUE + 0.005 * FULL
    room = most - expanded(known)
    for error, verdict in (
        (0.97 * room, "pass"),
        (0.5 * (room + most), "cannot judge"),
        (1.03 * most, "fail"),
    ):
        check = checked(elbow, sensor(gain=1 + gain_error * error / TORQUE), known)
        assert check.verdict == verdict
        assert failing(check) == (set() if verdict == "pass" else {"accuracy"})
        accuracy = [d for d in check.decisions if d.criterion == "accuracy"]
        assert accuracy[0].limit_Nm == pytest.approx(room, rel=1e-6)
        assert accuracy[0].steps == ("zero_1", "plus_1", "zero_2")


@pytest.mark.parametrize("gain", [0.8333, 0.9, 1.1, 1.1667])
@pytest.mark.parametrize("mass_kg", [0.6, 1.0, 1.5])
def test_a_wrong_gain_fails_whatever_the_load(elbow, mass_kg, gain):
    """Of 1.177 Nm a sensor once passed that showed 0.981: 4.4 % of full scale."""
    known = KnownLoad(mass_kg, 0.2)
    for minus in (gain, 1.0):
        recorded = sensor(gain=gain, minus_gain=minus)
        recorded = replace(recorded, tau_Nm=recorded.tau_Nm * mass_kg)  # the same sensor
        check = checked(elbow, recorded, known)
        assert check.verdict == "fail"
        assert "accuracy" in failing(check)
        assert (check.suspects is not None) == (minus == gain)
    said, to_do = checked(elbow, replace(recorded, tau_Nm=gain * recorded.tau_Nm), known).suspects
    assert f"{'softer' if gain > 1 else 'stiffer'} than its model" in said
    assert "repeat with another mass" in to_do
    assert "its sign is wrong" in checked(elbow, sensor(gain=-1.0), KNOWN).suspects[0]


@pytest.mark.parametrize("gain", [0.97, 1.03])
@pytest.mark.parametrize("weighed", [False, True])
@pytest.mark.parametrize("mass_kg", [0.6, 1.0, 1.5])
def test_what_a_mass_can_tell(elbow, mass_kg, weighed, gain):
    """A gain 3 % off passes if the load is known well; a small load never lets a sensor pass."""
    known = KnownLoad(mass_kg, 0.2, 0.0, *((0.001, 0.0003) if weighed else ()))
    recorded = replace(sensor(gain=gain), tau_Nm=sensor(gain=gain).tau_Nm * mass_kg)
    check = checked(elbow, recorded, known)
    assert check.verdict == ("pass" if weighed and mass_kg > 0.6 else "cannot judge")
    if check.verdict == "pass":
        return
    what, to_do = check.doubt
    assert ("of full scale" in what) == (weighed and mass_kg == 0.6)
    assert to_do.startswith("Hang at least 0.912 kg" if weighed else "Measure the ")
    assert what in check.report()


# -- the known load ----------------------------------------------------------------------------


def test_known_torque_and_budget():
    r = KnownLoad(1.3, 0.25, math.radians(20), 0.004, 0.002, math.radians(1.5))
    assert r.torque_Nm == pytest.approx(1.3 * 9.81 * 0.25 * math.cos(math.radians(20)))
    assert 2 * r.u_torque_Nm == pytest.approx(expanded(r), rel=1e-4)
    # At the horizontal the angle's first-order part vanishes; Monte Carlo sees the second.
    level = KnownLoad(1.0, 0.2, 0.0, 0.0, 0.0, math.radians(8), u_g_m_s2=0.0)
    drawn = level.torque_Nm * np.cos(np.random.default_rng(3).normal(0, math.radians(8), 400_000))
    assert level.u_torque_Nm == pytest.approx(np.std(drawn), rel=0.03)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mass_kg": 0.0}, "the mass = 0 kg is not within"),
        ({"arm_m": 200.0}, "the arm = 200 m is not within 0.01 to 2 m"),
        ({"angle_rad": 1.2}, "Bring the arm nearer the horizontal"),
        ({"u_arm_m": 0.3}, "the arm's uncertainty"),
        ({"g_m_s2": 1.62}, "gravity = 1.62"),
    ],
)
def test_impossible_loads_are_refused(values, message):
    with pytest.raises(UserError) as error:
        replace(KNOWN, **values)
    assert message in str(error.value)


def test_loads_outside_the_domain_are_refused(elbow):
    # Spring and hysteresis at 11.5 deg, from the published numbers.
    theta = math.radians(11.5)
    r = 0.0197 * np.arange(1, 11)
    by_hand = 239 * theta**3 + 9.39 * theta
    by_hand += float(np.sum(10.3 * np.exp(-62.5 * r) * np.minimum(theta, r)))
    assert static_torque_Nm(elbow, theta) == pytest.approx(by_hand)
    # ... and by the sensor itself, slowly, without its rate torque.
    ramp = np.linspace(0, theta, 4000)
    got, _ = elbow.sensor.simulator().run({"theta_rad": ramp, "omega_rad_s": 0 * ramp})
    slow = got["tau_spring_Nm"][-1] + got["tau_hysteresis_Nm"][-1]
    assert static_torque_Nm(elbow, theta) == pytest.approx(slow, abs=1e-6)
    low, high = load_range_Nm(elbow)
    assert (low, high) == pytest.approx((0.25 * FULL, by_hand))
    for share, message in ((1.001 * high, "Hang at most 2.00"), (0.999 * low, "Hang at least 0.9")):
        with pytest.raises(UserError, match=message):
            TorqueCheck(elbow, replace(KNOWN, mass_kg=share / 9.81 / 0.2))
    for share in (0.999 * high, 1.001 * low):
        TorqueCheck(elbow, replace(KNOWN, mass_kg=share / 9.81 / 0.2))
    with pytest.raises(UserError, match="Measure the arm better"):
        TorqueCheck(elbow, replace(KNOWN, u_arm_m=0.01))
    knee = esea_gen.load_device("knee")
    delta = knee.file.domain.theta_max_rad.value
    assert largest_torque_Nm(knee) == pytest.approx(
        min(47.8, static_torque_Nm(knee, delta)), abs=1e-9
    )
    assert static_torque_Nm(knee, math.radians(2.8)) == 0.0
    assert static_torque_Nm(knee, math.radians(15)) == pytest.approx(31.0, abs=0.05)  # spec


# -- going through it ---------------------------------------------------------------------------


def phase(label: str = "zero_1", level: float = 0.0, seconds: float = 15.0, rate: float = 100.0):
    t = np.arange(round(seconds * rate) + 1) / rate
    return label, t, np.full(len(t), level)


def spoiled(change) -> tuple:
    label, t, tau = phase()
    return (label, *change(t.copy(), tau.copy()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, tau: (t[:900], tau[:900]), "8.99 s recorded, below 15 s"),
        (lambda t, tau: (t[:-1], tau), "differ in number"),
        (lambda t, tau: (t, np.where(np.arange(len(t)) == 7, np.nan, tau)), "sample 7 .* is nan"),
        (lambda t, tau: (np.where(np.arange(len(t)) == 9, np.nan, t), tau), "time of sample 9"),
        (lambda t, tau: (t[::-1], tau), "does not rise"),
        (lambda t, tau: (t[::20], tau[::20]), "gap of up to 0.2 s"),
        (lambda t, tau: (np.delete(t, range(800, 830)), tau[30:]), "gap of up to 0.31 s"),
    ],
)
def test_what_cannot_be_judged_is_asked_for_again(elbow, change, message):
    check = TorqueCheck(elbow, KNOWN)
    with pytest.raises(UserError, match=message):
        check.record(*spoiled(change))
    assert not check.measurements


def test_it_goes_on_where_it_stopped(elbow, tmp_path):
    whole = sensor()
    labels = np.array(whole.step)
    middle = int(np.flatnonzero(labels == "plus_3")[0])
    parts = [
        CheckRecording("a.csv", whole.time_s[s], whole.tau_Nm[s], tuple(labels[s]))
        for s in (slice(None, middle), slice(middle, None))
    ]
    first = checked(elbow, parts[0])
    assert first.verdict == "incomplete"
    content = json.loads(json.dumps(first.to_dict(), allow_nan=False))
    assert content["missing"][0] == "plus_3"
    second = TorqueCheck.resumed(elbow, content)
    apply_recording(second, parts[1])
    at_once = checked(elbow, whole)
    assert second.verdict == "pass"
    assert second.decisions == at_once.decisions
    # A decision is made again from what was recorded, never believed.
    content["decisions"] = []
    content["verdict"] = "pass"
    assert TorqueCheck.resumed(elbow, content).verdict == "incomplete"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c | {"kind": "else"}, "not the result of a torque check"),
        (lambda c: c | {"version": 2}, "version 2"),
        (lambda c: c | {"device_digest": "0"}, "has changed since"),
        (lambda c: {k: v for k, v in c.items() if k != "known_load"}, "damaged"),
        (lambda c: c | {"measurements": c["measurements"][1:]}, "out of order"),
        (lambda c: c | {"measurements": [c["measurements"][0] | {"mean_Nm": math.nan}]}, "damaged"),
        (lambda c: c | {"repeats": 2.5}, "damaged"),
        (lambda c: c | {"known_load": c["known_load"] | {"mass_kg": 9.0}}, "above 3.94 Nm"),
    ],
)
def test_only_an_earlier_check_is_gone_on_with(elbow, change, message):
    check = TorqueCheck(elbow, KNOWN)
    check.record(*phase())
    check.record(*phase("plus_1", TORQUE))
    content = json.loads(json.dumps(check.to_dict()))
    with pytest.raises(UserError, match=message):
        TorqueCheck.resumed(elbow, change(content))


# -- recordings ---------------------------------------------------------------------------------


def write(path, recording: CheckRecording):
    columns = {"time_s": recording.time_s.tolist(), "tau_Nm": recording.tau_Nm.tolist()}
    if recording.step is not None:
        columns["step"] = list(recording.step)
    rows = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path


def test_phases_without_labels(elbow):
    recorded = sensor(labelled=False)
    by_label = checked(elbow, sensor())
    found = checked(elbow, recorded)
    assert found.verdict == "pass"
    for a, b in zip(found.measurements, by_label.measurements, strict=True):
        assert a.mean_Nm == pytest.approx(b.mean_Nm, abs=0.01)
    # The last load left out: the phase after it is not what comes next.
    start = by_label.measurements[11].start_s - SETTLE_S
    cut = (recorded.time_s < start - HANDLING_S) | (recorded.time_s > start + 16)
    short = CheckRecording("cut.csv", recorded.time_s[cut], recorded.tau_Nm[cut], None)
    check = TorqueCheck(elbow, KNOWN)
    apply_recording(check, short)
    assert check.verdict == "incomplete"
    assert check.missing[0].label == "minus_3"
    # A sensor that shows nothing has no phases to find, and says so instead of passing.
    dead = replace(recorded, tau_Nm=0 * recorded.tau_Nm)
    assert checked(elbow, dead).verdict == "incomplete"
    assert failing(checked(elbow, replace(dead, step=sensor().step))) == {"accuracy"}


def test_a_recording_is_taken_whole_or_not_at_all(elbow):
    recorded = sensor()
    labels = ["zero_1" if x == "zero_4" else x for x in recorded.step]
    check = TorqueCheck(elbow, KNOWN)
    with pytest.raises(UserError, match=r"is 'zero_1', but zero_4 comes there.*Labels, in order"):
        apply_recording(check, replace(recorded, step=tuple(labels)))
    assert not check.measurements
    with pytest.raises(UserError, match="no step is left"):
        apply_recording(checked(elbow, recorded), recorded)
    with pytest.raises(UserError, match="no phase was found"):
        apply_recording(check, replace(recorded, step=("",) * len(labels)))


# -- the command --------------------------------------------------------------------------------


@pytest.fixture
def command(tmp_path):
    """Run the command line in this process, in a folder of its own."""
    return partial(typed.command, "torque-check", cwd=tmp_path)


LOAD = ("--mass", 1.0, "--arm", 0.2)


def test_the_command(tmp_path, command):
    code, shown, _ = command("elbow")
    assert code == 0
    assert "Choose a mass and an arm that give 1.12 to 3.94 Nm" in shown
    assert "13. zero_7" in shown
    code, shown, _ = command("elbow", *LOAD)
    assert code == 0
    assert "Known load: 1.962 Nm" in shown
    write(tmp_path / "good.csv", sensor())
    code, shown, _ = command("elbow", *LOAD, "--recording", "good.csv", "--json", "r.json")
    assert code == 0
    assert shown.splitlines()[-1] == "Verdict: PASS"
    content = json.loads((tmp_path / "r.json").read_text())
    assert content["verdict"] == "pass"
    assert {d["criterion"] for d in content["decisions"]} == {x.name for x in LIMITS}
    write(tmp_path / "bad.csv", sensor(gain=1.2, labelled=False))
    code, shown, _ = command("elbow", *LOAD, "--recording", "bad.csv")
    assert code == 1
    assert "accuracy      FAILED" in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--mass", 5, "--arm", 0.2), "Hang at most 2.005 kg there"),
        (("--mass", 1), "--arm missing"),
        (("--recording", "x.csv"), "--mass and --arm missing"),
        ((*LOAD, "--recording", "none.csv"), "cannot be read"),
        (("--resume", "none.json"), "cannot be read"),
        (("--resume", "none.json", "--mass", 1), "takes the load from its file"),
        (("--resume", "none.json", "--arm-uncertainty", 0.001), "takes the load from its file"),
        (("--angle", 0), "--mass and --arm missing"),
        (("--json", "r.json"), "--mass and --arm missing"),
    ],
)
def test_the_command_refuses(command, arguments, message):
    code, shown, said = command("elbow", *arguments)
    assert code == 2
    assert message in said
    assert shown == ""
