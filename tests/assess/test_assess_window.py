"""Clinician's window: actions go through the desk; its content; its pictures."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from esea_host.assess import NOTICE
from esea_host.assess.desk import ClinicDesk
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort
from esea_host.assess.session import Assessment
from esea_host.assess.simulated import patient_named
from tests.assess.test_assess import made_up


@pytest.fixture(scope="module")
def data():
    return made_up()


@pytest.fixture
def opened(qtbot, data, tmp_path):
    from esea_host.windows.assess import AssessWindow

    desk = ClinicDesk(Assessment(data), Comfort(0, 120 * DEG), file=tmp_path / "session.json")
    window = AssessWindow(desk, "P01", dark=False)
    window.timer.stop()
    qtbot.addWidget(window)
    return window


def steps(window) -> list[str]:
    return [e.what for e in window.desk.session.trail]


def test_it_says_what_it_is_not_and_works_without_a_sensor(opened, qtbot):
    from PySide6.QtCore import Qt

    assert opened.bar.who.text() == NOTICE
    assert opened.bar.badge.text() == ""
    assert not hasattr(opened.controls, "move_button")
    before = opened.desk.proposed
    qtbot.mouseClick(opened.controls.words["strong"], Qt.MouseButton.LeftButton)
    assert steps(opened) == ["begin", "felt"]
    assert opened.desk.proposed != before or opened.desk.session.by_name()
    opened.controls.torque.setValue(7.5)
    opened.controls.take_torque()
    assert steps(opened) == ["begin", "felt", "measured"]
    assert opened.trail.count() == 3
    assert "resistance felt as strong" in opened.trail.item(1).text()
    # On the disk after every step.
    import json

    saved = json.loads(opened.desk.file.read_text())
    assert len(saved["trail"]) == 3
    assert saved["notice"] == NOTICE


def test_the_clinician_judges_and_takes_back_and_the_steps_tell(opened):
    c = opened.controls
    c.name.setCurrentIndex(opened.desk.session.names.index("D2"))
    c.percent.setValue(70)
    c.why.setText("history")
    c.judge()
    assert opened.desk.session.by_name()["D2"] == pytest.approx(0.7)
    assert "mild dystonic-like 70% (history)" in opened.trail.item(1).text()
    opened.undo()
    assert opened.desk.session.by_name()["D2"] != pytest.approx(0.7)
    assert steps(opened) == ["begin", "clinician", "undone"]
    opened.undo()
    assert opened.bar.said.text() == "There is nothing to take back."
    asked = opened.desk.proposed.location
    c.another.click()
    assert opened.desk.proposed.location != asked
    opened.undo()  # that, and not a step before it
    assert opened.desk.proposed.location == asked
    c.why_skip.setText("pain")
    c.skip.click()
    assert steps(opened)[-3:] == ["left out", "undone", "skipped"]


def test_limits_are_shown_and_kept_and_impossible_ones_refused(opened):
    c = opened.controls
    c.high.setValue(80)
    c.fastest.setValue(60)
    c.limit()
    assert opened.desk.comfort.high_rad == pytest.approx(80 * DEG)
    assert max(opened.desk.proposed.start_rad, opened.desk.proposed.end_rad) <= 80 * DEG + 1e-9
    assert [line.value() for line in opened.map.limits] == pytest.approx([0, 80, -60, 60])
    # Cells that no comfortable movement passes are empty, the others are not.
    seen = opened.map.image.image[..., 3] > 0
    assert np.array_equal(seen.ravel(), np.isfinite(opened.desk.value))
    c.high.setValue(5)
    c.limit()
    assert "reach" in opened.bar.said.text()
    assert opened.desk.comfort.high_rad == pytest.approx(80 * DEG)
    assert c.high.value() == 80


@pytest.mark.parametrize("locale", ["C", "de_DE", "fr_FR"])
def test_a_typed_number_is_the_same_in_every_locale(qtbot, data, locale):
    from PySide6.QtCore import QLocale
    from PySide6.QtWidgets import QPushButton

    from esea_host.windows.assess import AssessWindow

    before = QLocale()
    QLocale.setDefault(QLocale(locale))
    try:
        window = AssessWindow(ClinicDesk(Assessment(data), Comfort(0, 120 * DEG)))
        window.timer.stop()
        qtbot.addWidget(window)
        c = window.controls
        take = next(b for b in c.findChildren(QPushButton) if b.text() == "Take")
        for text, taken in (("62.5", True), ("412,5", False), ("1.062,5", False), ("62,5", True)):
            c.fastest.clear()
            qtbot.keyClicks(c.fastest, text + "\r")
            assert window.desk.comfort.rate_rad_s / DEG == pytest.approx(62.5)
            assert c.fastest.reason.isHidden() == taken
        for text in ("2 500", "", "2,5"):
            c.torque.clear()
            qtbot.keyClicks(c.torque, text)
            take.click()
        assert steps(window) == ["begin", "measured"]
        assert "2.5 Nm" in window.trail.item(1).text()
    finally:
        QLocale.setDefault(before)


def test_a_recording_and_the_page(opened, tmp_path):
    t = np.arange(0, 6, 0.01)
    rows = np.stack([t, 60 + 45 * np.sin(1.2 * t), 0 * t + 2], axis=1)
    path = tmp_path / "r.csv"
    np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,torque_Nm", comments="")
    opened.open_recording(path)
    assert opened.bar.said.text().startswith("r.csv: ")
    opened.open_recording(tmp_path / "none.csv")
    assert "cannot be read" in opened.bar.said.text()
    page = tmp_path / "page.pdf"
    opened.save_page(page)
    assert page.read_bytes()[:4] == b"%PDF"
    opened.save_page(tmp_path / "page.doc")
    assert ".html, .png or .pdf" in opened.bar.said.text()


@pytest.fixture(scope="module")
def driven(data):
    if os.environ.get("ESEA_PICTURES"):  # for the manual: what people will see
        from esea_host.assess.database import shipped

        data = shipped()
    session, patient = Assessment(data), patient_named("D2")
    return ClinicDesk(session, Comfort(10 * DEG, 115 * DEG), patient=patient, seed=3)


def test_a_simulated_patient_is_driven_from_it_and_never_taken_for_a_person(driven, qtbot):
    from esea_host.windows.assess import AssessWindow

    window = AssessWindow(driven, "")
    window.timer.stop()
    qtbot.addWidget(window)
    assert "SIMULATED PATIENT" in window.windowTitle()
    assert window.bar.badge.text() == "SIMULATED PATIENT"
    window.move_leg()
    assert window.bar.said.text().startswith("Simulated: ")
    assert "measured" in steps(window)
    assert driven.about("P01") == "SIMULATED PATIENT P01"
    wanted, passed = driven.moved
    qtbot.wait(300)
    window.animate()
    assert window.leg.scene.texts[0].key == "knee_moved"
    assert np.ptp(passed.angle_rad) > 0.3 * abs(wanted.end_rad - wanted.start_rad)


@pytest.mark.parametrize("dark", [False, True])
def test_pictures_for_the_manual(driven, qtbot, dark, tmp_path):
    from esea_host.windows.assess import AssessWindow

    window = AssessWindow(driven, "", dark)
    window.timer.stop()
    qtbot.addWidget(window)
    window.resize(1280, 860)
    window.show()
    while len(driven.session.evidence) < 3:
        window.move_leg()
    qtbot.wait(900)
    window.animate()
    target = os.environ.get("ESEA_PICTURES") or tmp_path
    path = Path(target) / ("assessment-window-dark.png" if dark else "assessment-window.png")
    picture = window.grab()
    assert picture.save(str(path))
    image = picture.toImage()
    assert (image.pixelColor(image.width() // 4, image.height() - 60).lightness() < 90) == dark
    colours = {image.pixel(x, y) for x in range(0, image.width(), 3) for y in range(80, 700, 3)}
    assert len(colours) > 20
    if os.environ.get("ESEA_PICTURES") and not dark:
        window.save_page(path.with_name("assessment-page.png"))
