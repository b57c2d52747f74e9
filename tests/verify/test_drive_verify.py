"""Verification of the torque-control Blocks detects faults in their C."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.cli import app
from esea_gen.emit.formats import FORMATS
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary
from esea_gen.verify import equivalence
from esea_gen.verify.equivalence import verify
from esea_gen.verify.mutation.campaign import REQUIRED_SCORE, run_mutation
from esea_gen.verify.mutation.equivalent import Prover
from esea_gen.verify.mutation.mutants import mutants
from esea_gen.verify.verdict import EXACT_STEP, LASTING, ONE_STEP, RESIDUAL
from tests.proof.sanitize import GivenRenderer, replay_device, undefined_behaviour

pytestmark = pytest.mark.ci

# One fault a Block: what stands in its C, what is put there, which output or state tells of it.
FAULTS = {
    # The switching term pushes away from the surface.
    "sliding_mode": (r"law_Nm = u_eq_Nm \+", "law_Nm = u_eq_Nm -", "u_wanted_Nm"),
    # The energy trips while it is small, and not when it is large.
    "limits": (r"energy_max_J < window_J", "window_J < energy_max_J", "status"),
    # A turn that is counted is forgotten.
    "encoder": (r" state->turn = turn;", "", "turn"),
    # The new law starts a torque away from where the coupling is.
    "reference": (r"\(law_Nm \+ offset_Nm\)", "(law_Nm - offset_Nm)", "tau_set_Nm"),
    # The last step of the search goes the wrong way.
    "inverse": (r"(refined_rad = turn \* \(\w+) \+", r"\1 -", "residual"),
    # The observer's memory of the motor's torque stands still.
    "drive_observer": (r" state->u_a_Nm = u_a_Nm;", "", "u_a_Nm"),
    # The difference is taken from the first angle ever seen.
    "rate": (r" state->theta_last_rad = theta_rad_used;", "", "omega_rad_s"),
}
SOUND = ["joint", "stamp"]
# By which rule f32 is judged.
RULE = dict.fromkeys(FAULTS, LASTING) | {
    "sliding_mode": ONE_STEP,
    "reference": ONE_STEP,
    "limits": ONE_STEP,
    "inverse": RESIDUAL,
}


def faulty(drive, real):
    files = GivenRenderer(drive, real).files()
    for block, (old, new, _) in FAULTS.items():
        name = f"esea_elbow_drive_{block}.c"
        assert len(re.findall(old, files[name])) == 1, (block, old)
        files[name] = re.sub(old, new, files[name])
    return HostLibrary(drive.system, GivenRenderer(drive, real, files))


def told_of(comparisons):
    return {
        text for c in comparisons for text in [*c.problems, "status" * bool(c.status_differences)]
    }


@pytest.fixture(scope="module")
def f32_faulty(drive):
    return faulty(drive, "f32")


def test_a_fault_in_each_block_is_seen_in_f32_and_told_by_name(drive, f32_faulty, monkeypatch):
    monkeypatch.setattr(equivalence, "compile_device", lambda *_: f32_faulty)
    arguments = [x for name in [*FAULTS, *SOUND] for x in ("--block", name)]
    kept = []
    original = equivalence.verify

    def run(*given, **named):
        kept.append(original(*given, **named))
        return kept[0]

    monkeypatch.setattr(equivalence, "verify", run)
    wide = {"COLUMNS": "200"}
    done = CliRunner().invoke(app, ["verify", "elbow_drive", "--real", "f32", *arguments], env=wide)
    assert done.exit_code == 1, done.output
    (found,) = kept
    for name, (_, _, port) in FAULTS.items():
        items = [c for c in found.comparisons if c.block == name]
        assert not all(c.passed for c in items), name
        # A stream that leaves what a lasting bound assumes is judged step by step.
        assert RULE[name] in {c.rule for c in items}, name
        assert {c.rule for c in items} <= {RULE[name], ONE_STEP}, name
        assert any(port in text for text in told_of(items)), (name, told_of(items))
        assert re.search(rf"\b{name}\b[^\n]*FAILED", done.output), done.output
        assert re.search(rf"^{name} f32, .+: ", done.output, re.M), name
    for name in SOUND:
        assert all(c.passed for c in found.comparisons if c.block == name), name
        assert not re.search(rf"\b{name}\b[^\n]*FAILED", done.output)


# A quotient of two small numbers has no finite bound; real use found the whole device refused.
def test_a_block_without_a_bound_is_held_to_its_executor(monkeypatch):
    device = esea_gen.load_device("elbow_mpc")
    found = verify(device, ["f32"], blocks=["trend"])
    assert found.passed
    assert {c.rule for c in found.comparisons} == {EXACT_STEP}
    assert "not proven" in found.verdict()
    files = GivenRenderer(device, "f32").files()
    old, name = "float stepped = esea_fmax(", "esea_elbow_mpc_trend.c"
    assert old in files[name], files[name]
    files[name] = files[name].replace(old, old.replace("max", "min"))
    library = HostLibrary(device.system, GivenRenderer(device, "f32", files))
    monkeypatch.setattr(equivalence, "compile_device", lambda *_: library)
    assert not verify(device, ["f32"], blocks=["trend"]).passed


@pytest.mark.slow
def test_the_whole_drive_passes(drive):
    found = verify(drive)
    assert found.passed, [(c.block, c.stream, c.problems) for c in found.comparisons]
    assert {c.block for c in found.comparisons} == {b.name for b in drive.system.kinds}
    assert all(c.bit_identical for c in found.comparisons if c.real == "f64")


def test_an_unknown_block_is_refused(drive):
    with pytest.raises(UserError, match=r"no Block 'limit'\.") as error:
        verify(drive, ["f32"], blocks=["limit"])
    assert "limits" in str(error.value.fix)
    assert CliRunner().invoke(app, ["mutate", "elbow_drive", "--block", "nothing"]).exit_code != 0


# -- sanitizers ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("real", ["f32", "f64"])
def test_sanitizers_on_every_block_and_task(drive, real):
    assert undefined_behaviour(drive, real).passed
    found = replay_device(drive, real, "address")
    assert found.passed, found


# -- mutation --------------------------------------------------------------------------------------


def test_a_sample_of_mutants_of_control_is_caught(drive):
    blocks = ["sliding_mode", "reference", "joint"]
    report = run_mutation(drive, "f32", sample=18, seed=3, blocks=blocks)
    assert report.tried == 18
    assert report.score >= REQUIRED_SCORE, [str(m) for m in report.survivors]
    assert report.contradicted == []
    with pytest.raises(UserError, match="no Block 'sensors'"):
        run_mutation(drive, "f32", blocks=["sensors"])


# What all mutants of a Block score at least: the exact inverse repairs a slip of its own search; a
# motor's encoder drops what is farther than it can have turned, whichever way round and how fast.
SCORES = {"inverse": 0.85, "encoder": 0.95, "encoder_gear": 0.96}  # counts compared at halves


@pytest.mark.slow
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_all_mutants_of_the_drive(drive, real):
    for block in drive.system.kinds:
        report = run_mutation(drive, real, blocks=[block.name])
        least = SCORES.get(block.name, 0.975)
        assert report.score >= least, (block.name, [str(m) for m in report.survivors])
        assert report.contradicted == []


def test_a_proof_holds_for_its_own_kernel_alone(drive):
    """What the step knows of its values says nothing of those that ``prepare`` computes.

    A mutant of the Butterworth filter's prewarping that the bits show was once called equivalent,
    because the value of that name in the step is only looked at for its sign.
    """
    own = [m for m in mutants(drive, "f32") if m.kernel]
    rate = [m for m in own if m.file == "esea_elbow_drive_rate.c" and m.function == "prepare"]
    before = [m for m in rate if m.kind == "result negated"]
    assert len(before) > 8
    prove = Prover(before[0].kernel, FORMATS["f32"])
    assert not any(prove(m.edit) for m in before)
    steps = [m for m in own if m.file.endswith("_velocity.c") and m.function == "step"]
    prove = Prover(steps[0].kernel, FORMATS["f32"], steps[0].block)
    assert any(prove(m.edit) for m in steps)
