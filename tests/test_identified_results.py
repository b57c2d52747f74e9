"""What results of an identification say, typed whole: in the terminal and in JSON."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace as Of

import numpy as np
import pytest
from pydantic import BaseModel

from esea_gen.identify.channels import ChannelNumber
from esea_gen.identify.compare import CompareRow
from esea_gen.identify.cycles import DataSet
from esea_gen.identify.encoder_table import EncoderTable
from esea_gen.identify.family_fit import term_rows
from esea_gen.identify.friction import Friction
from esea_gen.identify.identified import Identified
from esea_gen.identify.inverse import InverseFit
from esea_gen.identify.misfit import Misfit, Misfits
from esea_gen.identify.quality import Finding
from esea_gen.identify.quality_gate import gate_notes
from esea_gen.identify.recorded import Recording
from esea_gen.identify.regression import Estimate
from esea_gen.identify.reliability import PUBLISHED, Coefficient, PairAgreement, Reliability
from esea_gen.identify.resampling import LeftOut
from esea_gen.identify.specimens import JointFit
from esea_gen.identify.verdict import Verdict
from esea_gen.identify.worth import TorqueWorth
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term


def rows(*at):
    return np.array(at, int)


UP = DataSet("up", 0.25, rows(0, 1), rows(3), {"training": 2, "held_out": 1}, 0.125, 4.0, 3.0)
DOWN = DataSet("far down", 0.5, rows(), rows(0, 2), {"rest": 5, "held_out": 2}, None, 4.0, None)
LAST = DataSet("last", 0.125, rows(1), rows(), {}, -0.5, None, 3.0)
FIRST = Recording(
    label="one",
    file="one.csv",
    digest="abc",
    time_s=np.array([0.0, 1.0, 2.5, 4.0, 7.5]),
    theta_rad=np.array([1.0, 2.0, 3.0, 4.0, 5.0]),
    tau_Nm=np.array([0.5, 0.0, -0.5, 1.0, 2.0]),
    timed=True,
    dropped=3,
    cycles=(),
    sets=(UP,),
)
SECOND = replace(
    FIRST,
    label="two",
    file="sub/two.csv",
    digest="def",
    time_s=np.array([0.0, 0.25, 0.75]),
    theta_rad=np.array([-1.0, -2.0, -3.0]),
    tau_Nm=np.array([3.0, 4.0, 5.0]),
    timed=False,
    dropped=0,
    sets=(DOWN, LAST),
    temperature_C=21.5,
)
ERRORS = {"one": np.array([3.0, -4.0, 50.0, -0.5, 60.0]), "two": np.array([-6.0, 2.0, 8.0])}
MODEL = {r.label: r.tau_Nm + ERRORS[r.label] for r in (FIRST, SECOND)}
MISFITS = Misfits.of("Nm", [(r, ERRORS[r.label]) for r in (FIRST, SECOND)])
ALL = TorqueWorth(None, None, 0.5, 80, 30, 0.75)
FEW = TorqueWorth("0-5 %", "> 100 %", None, 7, 2, None)
LAG = ChannelNumber("torque.lag_s", 0.0, 0.002, 0.005, "not seen")


def quantities():
    names = ("domain.theta_max_rad", "domain.omega_max_rad_s", "elastomer.k1_Nm_rad")
    return iter(zip(names, (Of(value=v) for v in (0.5, 7.0, 9.0)), strict=True))


class Limits(BaseModel):
    theta_max_rad: float = 0.0
    omega_max_rad_s: float = 0.0


IDENTIFIED = Identified(
    device=Of(
        name="knee",
        title="A knee",
        tau_full_scale_Nm=12.5,
        rate_terms=False,
        quantities=quantities,
        file=Of(domain=Limits()),
    ),
    source=Of(origin="rig.toml"),
    recordings=(FIRST, SECOND),
    verdict=Verdict(MISFITS, MODEL, {}, 0.0),
    notes=("warm", "few"),
    worth=(ALL, FEW),
    channels=(LAG,),
    seconds=3.0,
)
# Root mean squares: of 3 and -4; of -6 and 8; in % of 12.5 Nm.
HALF, TEN = math.sqrt(12.5), math.sqrt(50)


def error(rms, largest):
    shares = {"rms_percent": 8 * rms, "max_percent": 8 * largest}
    return pytest.approx({"rms_Nm": rms, "max_Nm": largest, **shares})


def test_an_identification_in_the_terminal():
    assert IDENTIFIED.summary() == [
        "A knee: fit in % of full scale (12.5 Nm), RMS",
        "  up        training 28.28 %, held out  4.00 %",
        "  far down  held out 56.57 %",
        "  last      training 16.00 %",
        "  mean      training 22.14 %, held out 30.28 %",
        "note: warm",
        "note: few",
    ]
    small = Misfits("Nm", ((UP, Misfit(1.0, 1.0), Misfit(0.125, 1.0)),))
    quiet = replace(IDENTIFIED, verdict=replace(IDENTIFIED.verdict, misfits=small), notes=())
    assert quiet.summary()[1:] == [
        "  up  training  8.00 %, held out  1.00 %",
        "  mean  training  8.00 %, held out  1.00 %",
    ]


SETS = [
    {
        "label": "up",
        "amplitude_rad": 0.25,
        "cycles": {"held_out": 1, "training": 2},
        "training": error(HALF, 4.0),
        "held_out": error(0.5, 0.5),
        "asymmetry": 0.125,
        "work_first_J": 4.0,
        "work_last_J": 3.0,
        "softening": 0.25,
    },
    {
        "label": "far down",
        "amplitude_rad": 0.5,
        "cycles": {"held_out": 2, "rest": 5},
        "training": None,
        "held_out": error(TEN, 8.0),
        "asymmetry": None,
        "work_first_J": 4.0,
        "work_last_J": None,
        "softening": None,
    },
    {
        "label": "last",
        "amplitude_rad": 0.125,
        "cycles": {},
        "training": error(2.0, 2.0),
        "held_out": None,
        "asymmetry": -0.5,
        "work_first_J": None,
        "work_last_J": 3.0,
        "softening": None,
    },
]
MEANS = {
    "training_Nm": (HALF + 2) / 2,
    "training_percent": 4 * (HALF + 2),
    "held_out_Nm": (0.5 + TEN) / 2,
    "held_out_percent": 4 * (0.5 + TEN),
}
FILES = [
    {
        "label": "one",
        "file": "one.csv",
        "sha256": "abc",
        "samples": 5,
        "dropped": 3,
        "timed": True,
        "duration_s": 7.5,
        "temperature_C": None,
    },
    {
        "label": "two",
        "file": "sub/two.csv",
        "sha256": "def",
        "samples": 3,
        "dropped": 0,
        "timed": False,
        "duration_s": 0.75,
        "temperature_C": 21.5,
    },
]


def test_an_identification_as_json():
    told = IDENTIFIED.to_dict()
    assert told == {
        "device": {"name": "knee", "title": "A knee"},
        "mapping": "rig.toml",
        "full_scale_Nm": 12.5,
        "rate_terms": False,
        "domain": {"theta_max_rad": 0.5, "omega_max_rad_s": 7.0},
        "recordings": FILES,
        "sets": SETS,
        "mean_rms": pytest.approx(MEANS),
        "worth": [
            {
                "torque": None,
                "rate": None,
                "band_Nm": 0.5,
                "samples": 80,
                "held_out": 30,
                "held_out_inside": 0.75,
            },
            {
                "torque": "0-5 %",
                "rate": "> 100 %",
                "band_Nm": None,
                "samples": 7,
                "held_out": 2,
                "held_out_inside": None,
            },
        ],
        "notes": ["warm", "few"],
        "channels": [
            {
                "key": "torque.lag_s",
                "value": 0.0,
                "found": 0.002,
                "sigma": 0.005,
                "why": "not seen",
                "status": "assumed",
            }
        ],
    }
    assert list(told["sets"][0]["cycles"]) == ["held_out", "training"]
    bare = replace(IDENTIFIED, channels=()).to_dict()
    assert bare == {k: v for k, v in told.items() if k != "channels"}


def test_a_device_file_is_named_after_its_device_and_replaced_only_where_asked(monkeypatch):
    calls = []
    of_device = "esea_gen.identify.identified"
    monkeypatch.setattr(f"{of_device}.write_marked", lambda *given: calls.append(given))
    monkeypatch.setattr(f"{of_device}.marked_toml", lambda device: f"text of {device.name}")
    assert IDENTIFIED.write("some/folder") == Path("some/folder/knee.toml")
    IDENTIFIED.write(Path("other"), overwrite=True)
    assert calls == [
        (IDENTIFIED.device, Path("some/folder/knee.toml"), False),
        (IDENTIFIED.device, Path("other/knee.toml"), True),
    ]
    assert IDENTIFIED.toml() == "text of knee"


def test_how_long_it_took_makes_no_other_identification():
    assert IDENTIFIED.full_scale_Nm == 12.5
    assert replace(IDENTIFIED, seconds=9.0) == IDENTIFIED != replace(IDENTIFIED, notes=())


def test_a_mean_of_no_set_is_none():
    alone = Misfits("rad", ((LAST, Misfit(2.0, 3.0), None),))
    assert alone.means(8.0) == {
        "training_rad": 2.0,
        "training_percent": 25.0,
        "held_out_rad": None,
        "held_out_percent": None,
    }
    assert math.isnan(alone.mean_rms(True))
    assert Misfit.of(np.array([])) is None
    assert Misfit.of(np.array([-3.0])) == Misfit(3.0, 3.0)


def test_roles_and_model_torque_sample_by_sample():
    series = IDENTIFIED.series
    assert list(series) == ["one", "two"]
    told = {k: {n: list(x) for n, x in s.items()} for k, s in series.items()}
    assert told["one"] == {
        "time_s": [0, 1, 2.5, 4, 7.5],
        "theta_rad": [1, 2, 3, 4, 5],
        "tau_Nm": [0.5, 0, -0.5, 1, 2],
        "tau_model_Nm": [3.5, -4, 49.5, 0.5, 62],
        "role": [1, 1, 0, 2, 0],
    }
    assert told["two"]["role"] == [2, 1, 2]
    assert told["two"]["tau_model_Nm"] == [-3, 6, 13]


def test_softening_is_the_share_of_loss_that_is_gone():
    cases = ((4.0, 3.0, 0.25), (4.0, 5.0, -0.25), (0.5, 0.0, 1.0), (0.0, 1.0, None))
    cases += ((-1.0, 1.0, None), (None, 1.0, None), (1.0, None, None))
    for first, last, share in cases:
        assert replace(UP, work_first_J=first, work_last_J=last).softening == share


def test_an_inverse_as_json():
    sets = Misfits("rad", ((UP, Misfit(0.02, 0.03), None),))
    published = Misfits("rad", ((UP, Misfit(0.08, 0.09), Misfit(0.1, 0.2)),))
    fit = InverseFit(
        device=Of(file=Of(domain=Of(theta_max_rad=Of(value=0.25)))),
        values={"kappa_rad": 0.2, "phi_1_rad": 3.0, "chi_rad": 0.0025},
        sigma={"kappa_rad": 0.01, "phi_1_rad": None, "chi_rad": 0.0001},
        correlation={"kappa_rad, chi_rad": 0.5},
        phi_range_1_rad=(1.0, 4.0),
        sets=sets,
        published=published,
        seed=11,
        population=64,
        evaluations=7,
        runner_up=0.75,
        notes=("one", "two"),
    )
    told = fit.to_dict()
    parameters = told.pop("parameters")
    assert {k: (p["value"], p["sigma"], p["published"]) for k, p in parameters.items()} == {
        "kappa_rad": (0.2, 0.01, 0.106),
        "phi_1_rad": (3.0, None, 4.84),
        "chi_rad": (0.0025, 0.0001, 0.00233),
    }
    assert all(p["low"] < p["value"] < p["high"] for p in parameters.values())
    errors = {"rms_rad": 0.02, "rms_percent": 8.0, "max_rad": 0.03, "max_percent": 12.0}
    none = {"held_out_rad": None, "held_out_percent": None}
    assert told == {
        "correlation": {"kappa_rad, chi_rad": 0.5},
        "phi_range_1_rad": [1.0, 4.0],
        "full_scale_rad": 0.25,
        "sets": [{"label": "up", "training": pytest.approx(errors), "held_out": None}],
        "mean_rms": {"training_rad": 0.02, "training_percent": pytest.approx(8.0), **none},
        "mean_rms_published": pytest.approx(
            {
                "training_rad": 0.08,
                "training_percent": 32.0,
                "held_out_rad": 0.1,
                "held_out_percent": 40.0,
            }
        ),
        "search": {
            "fitness": "mean over data sets of the mean square deflection error (4.14)",
            "seed": 11,
            "population": 64,
            "evaluations": 7,
            "runner_up": 0.75,
        },
        "notes": ["one", "two"],
    }
    assert replace(fit, runner_up=math.inf).to_dict()["search"]["runner_up"] is None


def test_blocks_left_out_as_json():
    found = LeftOut(np.diag([4.0, 9.0]), 0.5, -0.25, 3, np.zeros(2), np.ones(2), rows(0, 1) > 0)
    assert found.to_dict() == {
        "assumes": "blocks left out in turn: the mean of the variances over cycles and over "
        "conditions; friction that shows is added",
        "band_Nm": 0.5,
        "band_share": 0.95,
        "unmodelled_friction_Nm": -0.25,
        "conditions": 3,
    }
    assert found.sigma.tolist() == [2.0, math.inf]


def test_an_encoders_table_as_json():
    values = (Estimate(0.02, 0.01, 0.04), None, Estimate(-0.04, -0.05, -0.007))
    found = EncoderTable("motor", -1, values, 0.3, Estimate(0.1, 0.05, 0.25), 0.5, 0.004, 640)
    assert found.to_dict() == {
        "side": "motor",
        "direction": -1,
        "zero_rad": 0.3,
        "correction_rad": [0.02, -0.01, -0.04],
        "nodes": [
            {"value_rad": 0.02, "low_rad": 0.01, "high_rad": 0.04},
            None,
            {"value_rad": -0.04, "low_rad": -0.05, "high_rad": -0.007},
        ],
        "play": {"value_rad": 0.1, "low_rad": 0.05, "high_rad": 0.25},
        "before_rad": 0.5,
        "after_rad": 0.004,
        "samples": 640,
    }


def test_friction_as_json_and_at_the_joint():
    load, dry = Estimate(-0.5, -1.0, 0.25), Estimate(0.5, 0.25, 0.75)
    rise, speed, viscous = (
        Estimate(4.0, 3.0, 6.0),
        Estimate(8.0, 6.0, 12.0),
        Estimate(2.0, 1.0, 5.0),
    )
    found = Friction(load, dry, rise, speed, viscous, 0.25, 0.5, 14, 2800, 37)
    rest = {"left_Nm": 0.25, "moved_Nm": 0.5, "runs": 14, "used": 2800, "outside": 37}
    told = {
        "load_Nm": {"value_Nm": -0.5, "low_Nm": -1.0, "high_Nm": 0.25},
        "fc_Nm": {"value_Nm": 0.5, "low_Nm": 0.25, "high_Nm": 0.75},
        "fs_Nm": {"value_Nm": 4.0, "low_Nm": 3.0, "high_Nm": 6.0},
        "vs_rad_s": {"value_rad_s": 8.0, "low_rad_s": 6.0, "high_rad_s": 12.0},
        "fv_Nms_rad": {"value_Nms_rad": 2.0, "low_Nms_rad": 1.0, "high_Nms_rad": 5.0},
    }
    assert found.to_dict() == {"friction": told} | rest
    none = replace(found, fs_Nm=None, vs_rad_s=None)
    assert none.to_dict() == {"friction": told | {"fs_Nm": None, "vs_rad_s": None}} | rest
    at_joint = {
        "fc_Nm": Estimate(2.0, 1.0, 3.0),
        "fv_Nms_rad": Estimate(32.0, 16.0, 80.0),
        "stribeck_Nm": Estimate(16.0, 12.0, 24.0),
        "stribeck_rad_s": Estimate(2.0, 1.5, 3.0),
    }
    assert found.at_joint(4.0) == at_joint
    assert list(none.at_joint(4.0)) == ["fc_Nm", "fv_Nms_rad"]
    # -0.5 + way (0.5 + 4 exp(-|omega| / 8)) + 2 omega
    torques = [-0.5 - 0.5 - 4 / math.e - 16, -0.5, 4.0 * math.exp(-0.25) + 4]
    assert found.torque_Nm(np.array([-8.0, 0.0, 2.0])) == pytest.approx(torques)
    assert none.torque_Nm(np.array([-8.0, 0.0, 2.0])) == pytest.approx([-17.0, -0.5, 4.0])


def test_specimens_as_json():
    agreement = Reliability(
        specimens=("A", "B"),
        rows=7,
        absolute=Coefficient(0.5, 0.25, 0.75),
        consistent=Coefficient(0.625, 0.375, 0.875),
        agreements=(PairAgreement("A", "B", -0.5, -2.0, 1.0, 0.125),),
        apart_pct={"A": 1.5, "B": 2.5},
    )
    pair = {"first": "A", "second": "B", "bias_Nm": -0.5, "low_Nm": -2.0, "high_Nm": 1.0}
    told = {
        "specimens": ("A", "B"),
        "rows": 7,
        "absolute": {"value": 0.5, "low": 0.25, "high": 0.75},
        "consistent": {"value": 0.625, "low": 0.375, "high": 0.875},
        "agreements": (pair | {"limit_error_Nm": 0.125},),
        "apart_pct": {"A": 1.5, "B": 2.5},
        "published": PUBLISHED,
    }
    assert agreement.to_dict() == told
    fits = JointFit("Knee", 12.5, {"A": 3.0, "B": 4.0}, {"A": 1.0, "B": 2.0}, agreement)
    own = {"joint_pct": {"A": 3.0, "B": 4.0}, "own_pct": {"A": 1.0, "B": 2.0}}
    assert fits.to_dict() == told | own | {"full_scale_Nm": 12.5}


def test_rows_of_a_comparison_and_of_terms_as_json():
    assert CompareRow("lin", "slow", 1.5, 2.5, None).to_dict() == {
        "model": "lin",
        "condition": "slow",
        "training": 1.5,
        "held_out": 2.5,
        "instructions": None,
    }
    terms = (
        Term("stop", Rise("bend", 3.0, "positive"), (0.5,), 2.0),
        Term("maxwell", Rise("power", 1.0), (0.5,)),
        Term("spring", Rise("power", 1.0), softening=Softening("strain", 2.0)),
    )
    told = term_rows(FittedMember(Member("m", "M", terms), 0.25, (1.5, 0.0, 2.5)))
    names = ("kind", "rise", "numbers", "exponent", "softening", "weight_Nm")
    assert [[t[k] for k in names] for t in told] == [
        ["stop", ["bend", 3.0, "positive"], [0.5], 2.0, None, 1.5],
        ["spring", ["power", 1.0, "both"], [], 0.0, ["strain", 2.0], 2.5],
    ]
    assert [t["term"] for t in told] == [terms[0].text, terms[2].text]


def test_findings_of_recordings_in_the_notes():
    gap = Finding("gap", "a gap of 1 s", False, ": look")
    stuck = Finding("frozen", "stood still", True, ": mend it")
    off = Finding("offset", "0.1 Nm off", True, ": turn it")
    one, two = replace(FIRST, findings=(gap, stuck)), replace(SECOND, findings=(gap, off, stuck))
    shut = "The torque model's numbers are marked assumed, not identified."
    assert gate_notes([one, two]) == (
        f"Quality gate: frozen, offset. {shut}",
        "Quality, all: a gap of 1 s: look.",
        "Quality, all: stood still: mend it.",
        "Quality, two: 0.1 Nm off: turn it.",
    )
    assert gate_notes([one, two, FIRST], {"frozen"}) == (
        f"Quality gate: offset. {shut}",
        "Quality, one, two: a gap of 1 s: look.",
        "Quality, one, two: stood still.",
        "Quality, two: 0.1 Nm off: turn it.",
    )
    assert gate_notes([replace(FIRST, findings=(gap,))]) == ("Quality, one: a gap of 1 s: look.",)
    assert gate_notes([FIRST, SECOND]) == ()
