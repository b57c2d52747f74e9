"""A member of the family in a device file: written, read, refused, built, run."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.control.sliding_mode.linear_loop import least_damped
from esea_gen.device import Device, load_device, parse_device
from esea_gen.devices.schema import json_schema
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device
from esea_gen.identify.family.fit import members
from esea_gen.identify.family.identification import family_device, family_section, identify_member
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.rubber import fitted_of, stiffness_range_Nm_rad
from esea_gen.verify.bounds import bounds_or_rule
from tests.conftest import ROOT
from tests.devices.test_devices import conforms

DATA = ROOT / "tests" / "data" / "hdrb"
LINEAR = Rise("power", 1)
# One term of every kind, every rise, every softening.
EVERY = FittedMember(
    Member(
        "every",
        "one of each",
        (
            Term("spring", LINEAR),
            Term("spring", Rise("power", 5, "negative"), softening=Softening("strain", 0.3)),
            Term("stop", Rise("power", 3), (0.15,), softening=Softening("path", 40.0)),
            Term("slip", Rise("bend", 0.4), (0.1,)),
            Term("maxwell", LINEAR, (0.1, 1.0, 10.0), 0.2),
            Term("maxwell", Rise("power", 1, "positive"), (3.0,)),
            Term("spring", Rise("bend", 0.08)),  # of weight 0: left out
            Term("offset"),
        ),
    ),
    0.2,
    (1.5, 0.4, 2.0, 0.7, 0.3, 0.2, 0.0, -0.1),
)


@pytest.fixture(scope="module")
def rig(elbow: Device) -> Device:
    return family_device(elbow, EVERY, "drawn")


@pytest.fixture(scope="module")
def hdrb():
    return identify_member(DATA / "hdrb.toml", "slips, worn")


def refused(text: str) -> str:
    with pytest.raises(UserError) as caught:
        parse_device(text, "mine.toml")
    assert caught.value.fix
    return str(caught.value)


def test_what_is_written_is_read_back(rig):
    again = parse_device(rig.toml(), "again.toml")
    assert again.digest == rig.digest
    used = FittedMember(
        Member("every", "one of each", tuple(t for _, t in EVERY.used)),
        0.2,
        tuple(w for w, _ in EVERY.used),
    )
    assert fitted_of(again) == used
    assert conforms(tomllib.loads(rig.toml()), json_schema()) == []


@pytest.mark.parametrize("member", members(), ids=lambda m: m.name)
def test_every_member_can_be_written(member, elbow):
    """With all of its terms: 60 at most."""
    fitted = FittedMember(member, 0.2, (0.5,) * len(member.terms))
    section = family_section(fitted, "drawn")
    file = elbow.file.model_copy(update={"elastomer": None, "family": section})
    assert fitted_of(Device(file, "mine.toml")) == fitted


WEIGHT = 'weight_Nm = { value = 1.0, status = "assumed", source = "x" }'
ONE = '{ value = 1.0, status = "assumed", source = "x" }'


def term(kind: str, *lines: str, weight: str = WEIGHT) -> str:
    return "\n".join(["[[family.terms]]", f'kind = "{kind}"', weight, *lines])


@pytest.mark.parametrize(
    ("added", "parts"),
    [
        (term("stop"), ["terms[7].threshold is missing", "a stop needs it"]),
        (term("slip", f"threshold = {ONE}"), ["terms[7].threshold has no meaning", "'slip'"]),
        (term("maxwell", f"times_s = {ONE}"), ["terms[7].times_s", "Did you mean values"]),
        (term("spring", f"exponent = {ONE}"), ["exponent has no meaning", "only a maxwell"]),
        (term("spring", 'rise = "bend"'), ["bend is missing", "'bend'"]),
        (term("spring", f"bend = {ONE}"), ["bend has no meaning", "'x'"]),
        (term("spring", 'rise = "x^2"'), ["terms[7].rise = 'x^2'", "x^5"]),
        (term("springs"), ["terms[7].kind = 'springs'", "maxwell"]),
        (
            term("spring", f"strain_softening = {ONE}", f"path_softening = {ONE}"),
            ["has both strain_softening and path_softening"],
        ),
        (term("offset", 'rise = "x^3"'), ["terms[7].rise has no meaning", "constant"]),
        (
            term("spring", weight=WEIGHT.replace("1.0", "-1.0")),
            ["weight_Nm = -1 is below its limit 0", "generate energy"],
        ),
        (
            term("slip", f"path = {ONE.replace('1.0', '0.0')}"),
            ["family.terms[7].path = 0 is below its limit 0.0001"],
        ),
        (
            term("spring", "stiffness = 3"),
            ["unknown key family.terms[7].stiffness", "Known keys here", "weight_Nm"],
        ),
        ('[elastomer]\n', ["elastomer.k1_Nm_rad is missing"]),
    ],
)  # fmt: skip
def test_a_wrong_term_is_refused_with_its_place(rig, added, parts):
    text = rig.toml()
    at = text.index("# Where the parameters were identified")
    said = refused(f"{text[:at]}{added}\n\n{text[at:]}")
    for part in parts:
        assert part in said, said


def test_one_torque_model_and_one_that_rises(rig, elbow):
    both = rig.toml() + elbow.toml()[elbow.toml().index("[elastomer]") :].split("# Where")[0]
    assert "both [elastomer] and [family]" in refused(both)
    text = rig.toml()
    none = text[: text.index("# Torque model")] + text[text.index("# Where the parameters") :]
    assert "coupling has no torque model" in refused(none)
    assert text.count("value = 1.5,") == 1  # the linear spring's weight
    assert "need not rise" in refused(text.replace("value = 1.5,", "value = 0.0,"))


def drive(rig: Device, base: str = "elbow_drive", more: str = "") -> str:
    text = rig.toml()
    section = text[text.index("# Torque model") : text.index("# Where the parameters")]
    return f'schema = 1\nextends = "{base}"\nname = "mine"\ntitle = "Mine"\n{more}\n{section}'


def test_what_is_made_for_the_published_model_refuses(rig):
    published = drive(rig) + '\n[inverse]\nkind = "published"\n'
    assert "inverse.kind = 'published' with [family]" in refused(published)
    with pytest.raises(UserError, match="requires the published model"):
        str(rig.elastomer)


def test_a_drive_takes_the_members_own_inverse(rig):
    """What extends a drive has one torque model; slopes of the loop are the member's."""
    mine = parse_device(drive(rig), "mine.toml")
    assert mine.file.elastomer is None
    assert mine.inverse.title == "Exact inverse: one of each"
    assert "inverse" in mine.system.blocks
    soft, stiff = stiffness_range_Nm_rad(mine)
    assert soft == pytest.approx(1.5 / 0.2)
    reach = mine.file.domain.theta_max_rad.value / 0.2
    shares = sum(t**-0.2 for t in (0.1, 1.0, 10.0))
    steep = 1.5 + 0.4 * 5 * reach**4 + 2.0 * 3 * reach**2 + 0.7 * 2 + 0.3 * shares + 0.2
    assert stiff == pytest.approx(steep / 0.2)
    assert least_damped(mine, 0.0).damping > 0.02


def test_the_largest_slope_is_never_passed(rig):
    """Of the torque over the present deflection, from many memories."""
    block, rng = rig.sensor, np.random.default_rng(5)
    reach = rig.file.domain.theta_max_rad.value
    most = fitted_of(rig).most_slope_Nm_rad(reach)
    theta = np.linspace(-reach, reach, 201)
    many, seen = block.step.map(len(theta)), 0.0
    for _ in range(5):
        simulator = block.simulator()
        simulator.run({"theta_rad": rng.uniform(-reach, reach, 50), "omega_rad_s": np.zeros(50)})
        memory = [
            np.repeat(np.atleast_1d(s)[:, None], len(theta), 1) for s in simulator.state.values()
        ]
        torque = np.asarray(many(*memory, theta[None, :], 0 * theta[None, :])[len(memory)]).ravel()
        seen = max(seen, float((np.diff(torque) / np.diff(theta)).max()))
    assert 0.3 * most < seen <= most


# From the recording to the C.


def test_a_recorded_member_becomes_a_device_file(hdrb, tmp_path):
    """Its C as built gives the errors that the comparison prints (docs: 1.36 %)."""
    device = load_device(hdrb.write(tmp_path))
    assert device.digest == hdrb.device.digest
    assert hdrb.to_dict()["mean_rms"]["held_out_percent"] == pytest.approx(1.37, abs=0.02)
    assert hdrb.to_dict()["model"]["terms"][0]["term"] == "spring of x"
    # Its own torque, worked out from the weights and the unit terms, at the recording's samples.
    (recording,) = hdrb.recordings
    error = (hdrb.verdict.torque_Nm["hdrb"] - recording.tau_Nm)[recording.sets[0].held_out]
    assert 100 * np.sqrt(np.mean(error**2)) / hdrb.full_scale_Nm < 1.7
    theta = 0.15 * np.sin(np.linspace(0, 20, 3000))
    sensors = [
        compile_device(device, real).block("sensor").run(
            {"theta_rad": theta.astype(np.float32), "omega_rad_s": 0 * theta}, trace=False
        )[0]["tau_Nm"]
        for real in ("f64", "f32")
    ]  # fmt: skip
    assert np.abs(sensors[0] - sensors[1]).max() < 2e-4
    assert np.abs(sensors[0]).max() > 1.5


def test_a_bound_that_says_nothing_of_the_torque_fails(elbow, monkeypatch):
    """The limit is 1 % of full scale; with one below what this sensor has, nothing passes."""
    simple = FittedMember(Member("few", "few", (Term("spring", LINEAR),)), 0.2, (1.5,))
    rig = family_device(elbow, simple, "drawn")
    bounds, _ = bounds_or_rule(rig, rig.sensor)
    share = max(b.outputs["tau_Nm"] for b in bounds.values()) / rig.tau_full_scale_Nm
    assert 0 < share < 0.01
    monkeypatch.setattr("esea_gen.verify.bounds.MOST_TORQUE_SHARE", 1e-9)
    with pytest.raises(UserError, match=r"% of full scale, above its limit 1e-07 %"):
        bounds_or_rule(rig, rig.sensor)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--model", "slips, worn", "--inverse"], "exact inverse of its own"),
        (["--compare", "--inverse"], "chooses the model itself"),
        (["--compare", "--model", "slips, worn"], "chooses the model itself"),
        (["--model", "slips", "--search", "evolution"], "The model 'slips' needs no search"),
        (["--out", __file__], "is a file. Give a folder."),
        (["--out", "/dev/null/a"], "cannot be written (Not a directory)"),
        (["--model", "rubber"], "There is no model 'rubber'"),
    ],
)
def test_contradictions_are_refused(given, said):
    run = CliRunner().invoke(app, ["identify", str(DATA / "hdrb.toml"), *given])
    assert isinstance(run.exception, UserError)
    assert said in str(run.exception)
