"""Control laws in files: errors with file, line and remedy; where they run."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import casadi as ca
import pytest

from esea_gen.cli import app
from esea_gen.control.law import Base, Law, Parts
from esea_gen.control.own_law import NOT_IN_C, outside_law
from esea_gen.device import Device, load_device
from esea_gen.emit.walker import OPERATIONS
from esea_gen.errors import UserError
from esea_gen.trust import read_code, trust
from esea_gen.twin.controllers import controller_device
from tests.own_device import own_text

EXAMPLE = (Path(__file__).parents[2] / "examples" / "proportional.py").read_text()


@pytest.fixture(scope="module")
def base() -> Base:
    """What laws of the elbow's drive stand on."""
    seen: list[Base] = []
    device = load_device("elbow_drive")

    def spy(base: Base) -> Parts:
        seen.append(base)
        raise LookupError

    with suppress(LookupError):
        _ = Device(device.file, "spy.toml", (Law("spy", "", spy),)).system
    return seen[0]


def changed(tmp_path: Path, old: str, new: str) -> tuple[str, int]:
    """A law as the command line names it, one place in it changed; and the line of that place."""
    assert old in EXAMPLE
    text = EXAMPLE.replace(old, new, 1)
    (tmp_path / "mine.py").write_text(text)
    return f"{tmp_path}/mine.py:LAW", 1 + text[: text.index(new.strip())].count("\n")


SIGNAL = "u.tau_set_Nm - u.tau_Nm"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (SIGNAL, "u.tau_set_Nm - u.tau", "there is no 'tau' .*Did you mean tau_Nm"),
        (SIGNAL, "__import__('math').exp(u.tau_Nm)", "a number here, but this is a symbol"),
        (SIGNAL, "u.tau_Nm * math.exp(u.tau_Nm)", r"Use casadi\.exp\."),
        (SIGNAL, "math.sin(u.tau_Nm)", r"it is casadi\.sin, but the firmware's C has no sin"),
        (SIGNAL, "ca.sin(u.tau_Nm)", r"sin in Block proportional\. .*polynomial"),
        (SIGNAL, "u.tau_Nm if u.tau_Nm > 0 else 0", r"choose with casadi\.if_else"),
        (SIGNAL, "2 % u.tau_Nm + u.tau_Nm // 2", r"no whole part.* divide with /"),
        (SIGNAL, "(u.mode > 1) & (u.mode < 2)", r"conditions with casadi\.logic_and"),
        ("ca.logic_and(guard.inputs_ok, u.mode >= 1)", "guard.inputs_ok and u.mode", "logic_and"),
        (SIGNAL, "u.tau_Nm * float('nan')", "nan in Block proportional"),
        (SIGNAL, "__import__('sys').exit(0)", r"0 \(SystemExit\)"),
        (SIGNAL, "u.tau_Nm * math.inf", "inf in Block proportional"),
        ('"error_Nm": ca.if_else(active, smooth, 0)', '"error_Nm": [smooth, 0]', "has shape"),
        ('"u_command_Nm": ca.if_else', '"u_comand_Nm": ca.if_else', "unknown .'u_comand_Nm'"),
        ("base.control_period_s", "base.period_s", "'Base' object has no attribute 'period_s'"),
        ('Port("tau_Nm", -tau_Nm, tau_Nm', 'Port("tau_Nm", tau_Nm, -tau_Nm', "port tau_Nm: range"),
        ("    return Parts(control=", "    return dict(control=", "gives dict, not Parts"),
    ],
)
def test_what_is_wrong_in_a_law_is_told_with_its_line(base, tmp_path, old, new, words):
    law, line = changed(tmp_path, old, new)
    text = (tmp_path / "mine.py").read_text()
    (tmp_path / "mine.py").write_text(
        text.replace("import casadi as ca", "import math, casadi as ca")
    )
    with pytest.raises(UserError) as refused:
        outside_law(law).parts(base)
    said = str(refused.value)
    assert re.search(words, said), said
    if "not Parts" not in words:
        assert said.startswith(f"mine.py, line {line}: law proportional: ")
    assert ca.SX.__float__.__name__ == "__float__"  # put back


def test_a_number_that_is_written_nowhere_has_no_line(base, tmp_path):
    law, _ = changed(tmp_path, SIGNAL, "1 / (u.tau_Nm * 0)")
    with pytest.raises(UserError, match=r"^mine\.py: law proportional: inf in Block"):
        outside_law(law).parts(base)


def test_a_law_that_is_not_named_is_asked_for():
    with pytest.raises(UserError, match=r"Add its name: mine\.py:LAW"):
        controller_device("mine.py")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('count("mode"', 'count("mod"', r"no wire .*Did you mean mode\?"),
        ('nal.u_command_Nm")', 'nal.u_comand_Nm")', "no such port .*Did you mean u_command_Nm"),
    ],
)
def test_a_wire_to_nowhere_is_told_with_its_line(tmp_path, old, new, words):
    text = EXAMPLE.replace("u.mode", "u.mod") if "mod" in old else EXAMPLE
    line = 1 + text[: text.index(old)].count("\n")
    (tmp_path / "mine.py").write_text(text.replace(old, new, 1))
    with pytest.raises(UserError, match=rf"mine\.py, line {line}: law proportional: {words}"):
        _ = load_device("elbow_drive", f"{tmp_path}/mine.py:LAW").system


def test_no_function_that_is_refused_can_be_emitted():
    codes = {code for code, _ in OPERATIONS.values()}
    assert not codes & {getattr(ca, f"OP_{n.upper()}") for n in NOT_IN_C}


OWN = own_text('laws = ["laws/mine.py:LAW"]\n', name="own")
BESIDE = f"{EXAMPLE}\n# beside its device file\n"


@pytest.fixture
def own(tmp_path, monkeypatch) -> Path:
    """A device file with a law of its own, which is trusted."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "laws").mkdir()
    # Its own text: what some test before it named on a command line stays trusted in the process.
    (tmp_path / "laws" / "mine.py").write_text(BESIDE)
    (tmp_path / "own.toml").write_text(OWN)
    trust([read_code(tmp_path / "laws" / "mine.py").sha256])
    return tmp_path / "own.toml"


def test_a_device_file_names_its_law_beside_it(own, monkeypatch):
    monkeypatch.chdir("/")
    device = load_device(own)
    assert [law.title for law in device.laws] == ["Proportional torque control"]
    assert device.own_laws() == {"laws/mine.py": BESIDE.encode()}
    assert "proportional" in device.system.blocks
    assert load_device(own).system is device.system  # shared, as of any device
    (own.parent / "laws" / "mine.py").write_text(f"{BESIDE}\n# edited\n")
    with pytest.raises(UserError, match="Untrusted code"):
        _ = load_device(own).laws


@pytest.mark.ci
def test_a_recording_of_an_own_law_is_replayed_by_the_law_in_it(own, tmp_path):
    """On the simulated board, with nothing but the recording at hand."""
    from esea_host.recording.log import open_log
    from esea_host.recording.replay import verify
    from esea_host.simulated.demo import run_demo

    done = run_demo(str(own), 1.0, tmp_path / "page.png")
    assert done.verdict.same
    assert done.fault == ""
    own.unlink()
    (own.parent / "laws" / "mine.py").unlink()
    (tmp_path / "config" / "esea-host" / "trusted-code").unlink()
    with open_log(done.recording) as log, pytest.raises(UserError, match="Untrusted code"):
        verify(log)


@pytest.mark.ci
@pytest.mark.parametrize("law", ["mine.py:LAW", "cascade"])
def test_a_device_under_another_law_is_recorded_and_replayed(law, tmp_path, monkeypatch):
    from esea_host.recording.log import open_log
    from esea_host.recording.replay import device_of
    from esea_host.simulated.demo import run_demo

    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(f"{EXAMPLE}\n# named, and never trusted\n")
    done = run_demo(f"{law}@elbow_drive", 1.0, tmp_path / "page.png")
    assert done.verdict.same
    Path("mine.py").unlink()
    with open_log(done.recording) as log:
        device = device_of(log)
    assert [x.name for x in device.laws] == ["proportional" if ".py" in law else law]


@pytest.mark.ci
def test_a_fault_and_a_repaired_state_are_reported(own):
    from typer.testing import CliRunner

    limit = '[safety]\ntau_max_Nm = { value = 1.0, status = "assumed", source = "test" }\n'
    own.write_text(OWN + limit)
    (law := own.parent / "laws" / "mine.py").write_text(BESIDE.replace("2 * tau_Nm", "0.01"))
    trust([read_code(law).sha256])
    done = CliRunner().invoke(app, ["simulate", "tuning", "--controller", str(own)])
    assert done.exit_code == 1
    assert "latched: TORQUE, the interaction torque was too large" in done.output
    assert "proportional: its state left its Port's range and was repaired in up to " in done.output


def test_a_division_by_0_at_rest_is_told_before_a_motor_turns(tmp_path, base, recwarn):
    for divisor, told in (("ca.fmax(u.tau_Nm, 0.1)", 0), ("u.tau_Nm", 1)):
        outside_law(changed(tmp_path, SIGNAL, f"u.tau_set_Nm / {divisor}")[0]).parts(base)
        assert sum("divides by 0 at rest" in str(w.message) for w in recwarn) == told
