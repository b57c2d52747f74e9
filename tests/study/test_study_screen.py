"""Participant's screen: scenes, frames and their times, the patch, and a pointer."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from esea_host.interaction.virtual import RigSource
from esea_host.people.person import PersonModel, person
from esea_host.study.conductor import FrameTimes, appears
from esea_host.study.plan import generator
from esea_host.study.scene import COLOURS, ON_WHITE, Scene, Shape, Text
from esea_host.study.words import words_of
from esea_host.windows.theme import BANNER_GROUND
from esea_host.wrist.virtual import VirtualPerson, wrist_protocol
from tests.conducted import TRACKING, ended, of_tasks

# -- time ------------------------------------------------------------------------------------------


def test_frames_between_trials_are_of_no_trial():
    frames = FrameTimes(100.0)
    for k in range(5):
        frames.painted(k * 0.01, 0, 0.0)
    frames.drop()
    assert not frames.painted(1.0, 0, 1.0)
    assert frames.painted(1.01, 1, 1.004)
    one = frames.take(False)
    assert (one["intervals"], one["dropped"], one["onset_delay_p100_ms"]) == (1, 0, 6.0)
    frames.painted(1.02, 1, 1.004)
    frames.painted(1.06, 1, 1.004)
    assert frames.take(False)["dropped"] == 3
    assert (frames.take(True)["intervals"], frames.take(True)["dropped"]) == (3, 3)


# -- pictures --------------------------------------------------------------------------------------


def painted(scene: Scene, width: int, height: int, language: str = "en"):
    """A scene as an array of pixels."""
    from PySide6.QtGui import QImage, QPainter

    from esea_host.windows.study.scene_view import paint_scene

    image = QImage(width, height, QImage.Format.Format_RGB32)
    painter = QPainter(image)
    paint_scene(painter, width, height, scene, words_of(language), COLOURS)
    painter.end()
    return np.array(image.constBits()).reshape(height, width, 4)[:, :, 2::-1]


def rgb(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


@pytest.mark.parametrize(("width", "height"), [(400, 300), (300, 900)])
def test_a_scene_keeps_its_proportions_whatever_the_window(qtbot, width, height):
    """10 right and 20 up of 40: from the middle by as many quarters of half the smaller side."""
    shapes = (Shape("disc", "target", 10.0, 20.0, 4.0), Shape("square", "failed", -20, -20, 4))
    pixels = painted(Scene(shapes), width, height)
    half = min(width, height) / 2
    for s in shapes:
        there = np.argwhere((pixels == rgb(COLOURS[s.role])).all(axis=2)).mean(axis=0)
        wanted = [height / 2 - s.y / 40 * half, width / 2 + s.x / 40 * half]
        assert there == pytest.approx(wanted, abs=1.0)
    assert pixels[0, 0].tolist() == rgb(COLOURS["background"])


def test_texts_are_the_languages_own_and_no_role_is_lost(qtbot):
    scene = Scene((Shape("disc", "no such role", 0, 0, 8.0),), (Text("error", {"error_deg": 1.5}),))
    en, de = painted(scene, 300, 300), painted(scene, 300, 300, "de")
    assert not np.array_equal(en, de)
    given = "error", {"error_deg": 1.5}
    assert words_of("de").scene(*given) == "mittlerer Fehler 1,5 Grad"
    assert words_of("en").scene(*given) == "mean error 1.5 degrees"
    assert en[150, 150].tolist() == rgb(COLOURS["text"])


# Machado, Oliveira, Fernandes, IEEE TVCG 15, 2009: what is seen without one kind of cone, linear.
BLIND = {
    "none": "1 0 0 0 1 0 0 0 1",
    "protan": "0.152286 1.052583 -0.204868 0.114503 0.786281 0.099216 -0.003882 -0.048116 1.051998",
    "deutan": "0.367322 0.860646 -0.227968 0.280085 0.672501 0.047413 -0.011820 0.042940 0.968881",
    "tritan": "1.255528 -0.076749 -0.178779 -0.078411 0.930809 0.147602 0.004733 0.691367 0.303900",
}


def lab(colour: str, blind: str) -> np.ndarray:
    """CIELAB of a colour as somebody sees it (sRGB, D65)."""
    value = np.array(rgb(colour)) / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(blind.split(), float).reshape(3, 3) @ linear, 0, 1)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.array(to_xyz) @ seen / [0.9505, 1.0, 1.089])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("colours", [COLOURS, ON_WHITE], ids=["dark", "light"])
@pytest.mark.parametrize("kind", BLIND)
def test_roles_are_told_apart_without_one_kind_of_cone(kind, colours):
    """Difference in CIELAB: 2 can just be seen side by side, 15 is plain."""
    for a, b in combinations(("cursor", "target", "failed", "origin", "background"), 2):
        apart = np.linalg.norm(lab(colours[a], BLIND[kind]) - lab(colours[b], BLIND[kind]))
        assert apart > 15, (a, b, apart)


@pytest.mark.parametrize("colours", [COLOURS, ON_WHITE], ids=["dark", "light"])
def test_every_role_stands_out_for_impaired_vision(colours):
    """WCAG 2.2: 3 to 1 for shapes (1.4.11), 7 to 1 for text (1.4.6)."""

    def light(colour: str) -> float:
        return ((lab(colour, BLIND["none"])[0] + 16) / 116) ** 3 + 0.05

    ground = light(colours["background"])
    for role, y in ((r, light(c)) for r, c in colours.items() if r != "background"):
        assert max(y, ground) / min(y, ground) >= (7 if role == "text" else 3), role
    assert light("#ffffff") / light(BANNER_GROUND) >= 7


def test_something_appears_where_a_role_or_a_text_is_new():
    before, after = Scene((Shape("disc", "cursor", 0, 0),)), Scene((Shape("disc", "target", 0, 0),))
    assert appears(before, after)
    assert not appears(Scene((*before.shapes, *after.shapes)), after)
    assert appears(Scene(), Scene((), (Text("caught"),)))


@pytest.mark.parametrize(
    ("patch", "changes"), [("frame", [1, 1, 1]), ("onset", [0, 1, 0]), ("off", None)]
)
def test_the_patch_changes_with_each_frame_or_at_an_onset(begin, windows, patch, changes):
    conductor = begin(of_tasks(TRACKING), at=[(1, 0.3)])
    conductor.arrive()
    participant, _ = windows(conductor, patch=patch)
    participant.timer.stop()
    seen = []
    for k in range(5):  # the first one shows what had appeared before
        if k == 3:
            conductor.shown = replace(conductor.shown, onsets=conductor.shown.onsets + 1)
        participant.turn()
        corner = participant.grab().toImage()
        colour = corner.pixelColor(5, corner.height() - 5).name()
        seen.append({"#ffffff": 1, "#000000": 0}.get(colour))
    if changes is None:
        assert set(seen) == {None}
    else:
        assert np.abs(np.diff(seen[1:])).tolist() == changes


# -- somebody points -------------------------------------------------------------------------------


@pytest.mark.ci
def test_who_points_moves_the_hand_in_the_virtual_rig_and_it_is_recorded(tmp_path, begin):
    """Held half way to the right of 11.46 deg; the spring takes some of it."""
    who = person(np.random.default_rng(1), PersonModel())
    folder = tmp_path / "s" / "P01" / "session-1"
    ended(begin(of_tasks(TRACKING), RigSource(who, folder, lambda: (0.5, 0.0))))
    table = np.loadtxt(folder / "encoder-2.csv", delimiter=",", skiprows=2)
    assert len(table) == 1000
    assert np.allclose(np.diff(table[:, 0]), 1e-3)
    held = math.degrees(table[-200:, 1].mean())
    k = math.degrees(0.0502) + who.limbs[0].stiffness_Nm_rad
    own = who.model.stiffness_Nm_rad
    assert held == pytest.approx(0.5 * math.degrees(0.16) / 0.8 * own / (own + k), abs=0.25)


def test_the_mouse_points_in_shares_of_the_scene(begin, windows, qtbot):
    from PySide6.QtCore import QPoint

    participant, _ = windows(begin(of_tasks(TRACKING), at=[(1, 0.1)]))
    found = []
    participant.point = found.append
    participant.resize(600, 400)
    qtbot.mouseMove(participant, QPoint(400, 100))
    qtbot.waitUntil(lambda: bool(found), timeout=120_000)
    assert found[-1] == pytest.approx((0.5, 0.5))


# -- pictures for the manual -----------------------------------------------------------------------


@pytest.fixture
def place(tmp_path) -> Path:
    return Path(os.environ.get("ESEA_PICTURES") or tmp_path)


@pytest.mark.ci
def test_pictures_of_a_calibration_for_the_manual(begin, windows, place):
    from PySide6.QtWidgets import QApplication

    from esea_host.windows.theme import DARK, LIGHT

    who = person(generator(1, 4, 0), PersonModel())
    conductor = begin(wrist_protocol(1), VirtualPerson(who), at=[(6, 3.2)])
    participant, operator = windows(conductor)
    conductor.arrive()
    operator.resize(1180, 700)
    for _ in range(3):  # letters grow with the window, and ask for room
        QApplication.processEvents()
    for theme, name in ((DARK, "study-operator-dark.png"), (LIGHT, "study-operator.png")):
        operator.set_theme(theme)
        picture = operator.grab()
        assert picture.save(str(place / name))
        assert (picture.toImage().pixelColor(3, 300).lightness() < 90) == (theme is DARK)
    participant.resize(480, 480)
    for dark in (False, True):
        participant.set_dark(dark)
        participant.turn()
        picture = participant.grab()
        assert (picture.toImage().pixelColor(3, 3).lightness() < 90) == dark
    assert picture.save(str(place / "study-calibration.png"))
    assert float(operator.bar.readouts["torque flexion"].accessibleName()) > -8.0
    assert not conductor.source.gauges()[0].near


@pytest.mark.ci
def test_pictures_of_the_game_for_the_manual(begin, windows, place):
    pong = 'task = "interaction.pong"\ntrials = [{ parameters = { seconds = 20.0 } }]'
    who = person(generator(1, 4, 0), PersonModel())
    conductor = begin(of_tasks(pong), RigSource(who, place / "s"), at=[(1, 15.0)])
    participant, operator = windows(conductor, language="de")
    conductor.arrive()
    participant.resize(480, 480)
    participant.set_dark(False)
    participant.turn()
    assert participant.grab().save(str(place / "study-pong.png"))
    operator.refresh()
    assert operator.buttons["recentre"].isVisible()
    conductor.stop("that is enough")
    ended(conductor)
