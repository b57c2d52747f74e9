"""The interaction study on a simulated board: the element is measured before its first trial."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import esea_gen
from esea_gen.errors import UserError
from esea_gen.studies.torque_check.procedure import KnownLoad
from esea_host.interaction.confirming import expected, judge, spring_Nm_rad
from esea_host.interaction.on_board import ElementBoard
from esea_host.interaction.recordings import cut_trials, read_angle
from esea_host.people.person import PersonModel, person
from esea_host.simulated import LockstepDevice
from esea_host.simulated.server import Attendant
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.plan import generator
from esea_host.study.protocol import parse_protocol
from esea_host.study.recorded import BoardInputs
from esea_host.study.session import PENDING, replay

ELBOW = esea_gen.load_device("elbow_drive")
LOAD = KnownLoad(0.5, 0.2)
BLOCK = """
[[session.block]]
name = "{0} with the {1}"
task = "interaction.{0}"
condition = "{1}"
trials = [{{ parameters = {{ seconds = {2} }} }}]
"""
HEAD = """
schema = 1
name = "short"
title = "both elements in one session"
seed = 1
[conditions.spring]
parameters = { element = "spring" }
[conditions.elastomer]
parameters = { element = "elastomer" }
[[session]]
name = "both"
"""


@pytest.fixture
def session_of(tmp_path, simulated_elbow):
    """A session of blocks at the simulated drive, and its source."""
    made = []

    def begin(attendant, *blocks, load=None):
        simulated_elbow.restart()
        device = LockstepDevice(simulated_elbow)
        device.advance(1.0)  # a board runs before it is recorded
        text = HEAD + "".join(BLOCK.format(*b) for b in blocks)
        folder = tmp_path / f"s{len(made)}"
        study = StudyFolder.create(folder, parse_protocol(text, "p"), simulated=True, durable=False)
        study.enrol("P01", True)
        folder, who = study.log_of("P01", 0).parent, person(generator(1, 4, 0), PersonModel())
        made.append(ElementBoard(device, folder, True, device.advance, load, attendant, who))
        return study, study.session("P01", 0, made[-1])

    yield begin
    for board in made:
        board.close()
    simulated_elbow.build_in(0.0)
    simulated_elbow.restart()


def told(session, kind):
    """Contents of a kind of event."""
    return [e.data for e in read_log(session.log.path).entries if e.kind == kind]


@pytest.mark.ci
def test_both_elements_are_confirmed_played_and_replayed(session_of, simulated_elbow):
    blocks = ("tracking", "elastomer", 2.0), ("pong", "spring", 1.0), ("tracking", "spring", 1.0)
    study, session = session_of(Attendant(simulated_elbow).do, *blocks)
    assert session.run() == ""
    elements = told(session, "element")
    assert [e["element"] for e in elements] == ["elastomer", "spring"]  # once a swap
    for e in elements:
        assert e["confirmed"]
        assert e["simulated"]
        wanted = e["expected"][e["element"]]
        assert e["measured"]["stiffness_Nm_rad"] == pytest.approx(
            wanted["stiffness_Nm_rad"], rel=0.03
        )
        assert e["measured"]["memory"] == pytest.approx(wanted["memory"], abs=0.02)
    # The cursor is the board's angle from the middle, which is where limits leave room.
    (middle,) = told(session, "middle")
    assert math.degrees(middle["inputs"]["theta_rad"]) > 15
    frames = [s for e in told(session, "frames") if e["trial"] == 1 for s in e["samples"]]
    assert max(abs(s[1]) for s in frames) < math.radians(15)
    session.source.close()
    path = session.log.path
    for inputs in (None, BoardInputs(path)):
        scenes = list(replay(path, (), inputs))
        assert {n for n, _, _ in scenes} == {1, 2, 3}
        assert all(same for _, _, same in scenes)
    assert cut_trials(study) == 3
    time_s, theta_deg, _ = read_angle(path.parent / "encoder-1.csv")
    assert len(time_s) == 2000
    shown_deg = np.degrees([s[1] + middle["inputs"]["theta_rad"] for s in frames])
    assert np.allclose(theta_deg[9::10], shown_deg, atol=1e-6)


@pytest.mark.ci
def test_a_wrong_element_refuses_its_block_and_the_trial_stays_to_be_done(
    session_of, simulated_elbow
):
    simulated_elbow.build_in(spring_Nm_rad(ELBOW, "spring"))
    blocks = ("tracking", "spring", 1.0), ("pong", "elastomer", 1.0)
    attendant = Attendant(simulated_elbow)

    def careless(word, number):
        """Leave in what is in."""
        if word != "spring":
            attendant.do(word, number)

    _, session = session_of(careless, *blocks)
    assert "It measures as: spring, equal. Build in the elastomer" in session.run()
    assert [e["confirmed"] for e in told(session, "element")] == [True, False]
    assert session.state.states[2] == PENDING


def test_without_a_known_mass_nobody_is_believed(session_of):
    _, session = session_of(None, ("tracking", "spring", 1.0))
    assert "Give --mass KG and --lever M" in session.run()
    assert session.state.states[1] == PENDING


def means_of(stiffness_Nm_rad, memory, load_Nm, zero_rad=0.0):
    """Of the five phases."""
    bent = load_Nm / stiffness_Nm_rad
    return [zero_rad + bent * x for x in (0.0, 1.0, memory, -1.0, -memory)]


@settings(max_examples=12, deadline=None)
@given(st.floats(0.5, 3.0), st.floats(-0.05, 0.05), st.sampled_from([-1, 1]))
def test_the_numbers_come_back_whatever_the_zero_and_the_side(mass_kg, zero_rad, side):
    load = KnownLoad(mass_kg, 0.2)
    for element in ("spring", "elastomer", "equal"):
        x = expected(ELBOW, element, load.torque_Nm, spring_Nm_rad(ELBOW, element))
        means = means_of(x.stiffness_Nm_rad, x.memory, side * load.torque_Nm, zero_rad)
        found = judge(ELBOW, element, load, means)
        assert found.measured.stiffness_Nm_rad == pytest.approx(x.stiffness_Nm_rad)
        assert found.measured.memory == pytest.approx(x.memory, abs=1e-9)
        assert element in found.fits
        assert not found.problem
        # By the memory where by the stiffness alone they could not be told apart.
        assert ("elastomer" in found.fits) == (element == "elastomer")


def test_what_no_mass_can_tell_is_refused():
    good = means_of(16.0, 0.0, LOAD.torque_Nm)
    with pytest.raises(UserError, match="one way and the other"):
        judge(ELBOW, "spring", LOAD, [abs(x) for x in good])
    with pytest.raises(UserError, match="stiffness is uncertain by"):
        judge(ELBOW, "spring", KnownLoad(0.5, 0.2, u_arm_m=0.01), good)
    with pytest.raises(UserError, match="Hang a lighter mass"):
        judge(ELBOW, "spring", KnownLoad(8.0, 0.2), means_of(100.0, 0.0, 15.7))
    # A spring that the protocol names is held to its own number.
    assert "off the spring" in judge(ELBOW, "spring", LOAD, good, 0.35).problem
    assert not judge(ELBOW, "spring", LOAD, good, math.radians(16.0)).problem
