"""Sixty devices as other people may write them, run through the commands.

Drawn with a fixed seed: rates, limits, ratios, encoders, stiffness, and control rates asked for
that do not divide.  What the device file allows must build, be verified, run on the emulated board
and in the virtual exoskeleton; what it refuses must be refused with a word on what to do, never
with a traceback.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.device import parse_device
from esea_gen.errors import UserError
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Setting
from esea_gen.twin.run import run_case
from tests.own_device import own_text
from tests.studies.test_experiments import shorter

# What is copied from the elbow is for its rate, and said so.
pytestmark = pytest.mark.filterwarnings("ignore:.*designed for")

# Periods of whole microseconds, and a control task every so many of them.
PERIODS_US = (250, 400, 500, 800, 1000, 1250, 2000, 3000, 4000)
COUNT = 60


def drawn(number: int) -> tuple[str, bool]:
    """Text of one device, and whether it has a drive."""
    rng = np.random.default_rng([20, number])
    drive = number % 2 == 0
    rate = 1e6 / float(rng.choice(PERIODS_US))
    slower = int(rng.integers(1, 9))
    gear = float(rng.choice([20.0, 50.0, 74.0, 100.0, 161.0]))
    # The motor's encoder may turn by less than half a turn in two periods.
    top = round(min(float(rng.choice([2.0, 5.0, 12.0])), 0.9 * np.pi * rate / (2 * gear)), 3)
    u_max = float(rng.choice([0.05, 0.221, 0.6, 3.0]))
    tables = {
        "timing": {"sense_rate_Hz": rate},
        "encoder": {"resolution_bits": int(rng.integers(10, 20))},
        "elastomer": {"k1_Nm_rad": round(float(9.39 * rng.uniform(0.3, 4)), 3)},
        "velocity": {"bandwidth_Hz": round(min(15.0, 0.1 * rate), 3)},
    }
    if drive:
        # One in five asks for a rate that need not divide.
        asked = rate / slower if rng.random() < 0.8 else float(rng.choice([30.0, 70.0, 300.0]))
        tables["timing"] |= {"control_rate_Hz": asked, "control_release_s": 1 / rate}
        tables["actuator"] = {
            "gear_ratio": gear,
            "encoder_bits": int(rng.choice([12, 14, 17, 20])),
            "u_max_Nm": u_max,
            "omega_max_rad_s": top,
        }
        tables["safety"] = {
            "u_max_Nm": u_max * float(rng.choice([0.5, 1.0])),
            "omega_max_rad_s": 0.8 * top,
        }
    return own_text("", "elbow_drive" if drive else "elbow", f"own{number}", **tables), drive


def said(*words: str, codes: tuple[int, ...] = (0,)) -> str:
    """What a command prints; refused or failed says so."""
    done = CliRunner().invoke(app, list(words))
    if isinstance(done.exception, UserError):
        raise done.exception
    assert done.exit_code in codes, f"{' '.join(words)}\n{done.output}\n{done.exception!r}"
    return done.output


def board_for(device) -> tuple[str, ...]:
    """The default board, or the one that its refusal names: one without encoders of its own."""
    assert device.file.encoder is not None
    if not device.laws or device.file.encoder.resolution_bits.value <= 14:
        return ()
    with pytest.raises(UserError, match="above 14, the most bits") as refused:
        said("firmware", device.origin, "--out", str(Path(device.origin).parent))
    named = re.search(r"--board (\S+)", refused.value.fix)
    assert named
    return "--board", named[1]


def taken_through(number: int, folder, whole: bool) -> str:
    """Every command on one device; returns how far it came.

    whole: verify, emulate and report all of it, not the cheapest Block.
    """
    text, drive = drawn(number)
    file = folder / f"own{number}.toml"
    file.write_text(text)
    try:
        device = parse_device(text, str(file))
        names = [b.name for b in device.system.kinds]
        said("build", str(file), "--out", str(folder / "c"))
    except UserError as refused:
        return f"refused: {refused}"
    if whole or not drive:
        chosen = () if whole else ("--block", "velocity", "--real", "f64")
        said("verify", str(file), *chosen)
    if drive:
        run = run_case(shorter(TuningCase().cases()[0], 2), Setting(str(file)), 0)
        assert np.isfinite(run["tau_e_Nm"]).all()
    if whole:
        more = ("--seconds", "0.3") if drive else ()
        board = board_for(device)
        said("emulate", str(file), *more, *board)
        # With the elbow's gains a drawn drive may trip: then the page says so, and the code is 1.
        page = folder / "page.html"
        found = said("report", str(file), "--out", str(page), *board, codes=(0, 1))
        verdict = found.splitlines()[2]  # the second one: on the drive
        assert ("FAILED" in verdict) == ("tripped" in found or "unstable" in found)
        assert "every bit as on the host" in found
        assert "DIFFER" not in found
        assert page.read_text().rstrip().endswith("</html>")
    return f"done: {len(names)} Blocks"


@pytest.mark.ci
@pytest.mark.parametrize("number", [3, 18])
def test_a_device_of_ones_own(number, tmp_path):
    assert taken_through(number, tmp_path, whole=False).startswith("done")


def test_of_sixty_most_are_devices_and_the_others_are_told_why():
    """The form alone, of all: what is refused says what to give instead."""
    refused = []
    for number in range(COUNT):
        try:
            parse_device(drawn(number)[0], "own.toml")
        except UserError as error:
            refused.append(error)
    assert all(error.fix for error in refused)
    assert 0 < len(refused) < COUNT / 3
    assert any("does not divide" in error.what for error in refused)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(COUNT))
def test_every_device_of_ones_own(number, tmp_path):
    taken_through(number, tmp_path, whole=True)
