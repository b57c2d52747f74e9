"""The field for typed numbers, by key, in three locales."""

from __future__ import annotations

import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from esea_gen.errors import UserError
from esea_gen.typed import read_number, shown_number


@pytest.fixture(params=["C", "de_DE", "fr_FR"])
def field(request, qtbot):
    from PySide6.QtCore import QLocale

    from esea_host.windows.number_field import NumberField

    before = QLocale()
    QLocale.setDefault(QLocale(request.param))
    made = NumberField(-100, 100, 0.5, " Nm")
    made.setValue(7)
    qtbot.addWidget(made.box)
    made.box.show()
    yield made
    QLocale.setDefault(before)


def typed(field, text: str, leave: bool = False) -> list[float]:
    """What the field tells when a text is typed over what stands there."""
    from PySide6.QtCore import QEvent, Qt
    from PySide6.QtGui import QFocusEvent, QKeyEvent
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QApplication

    told, no = list[float](), Qt.KeyboardModifier.NoModifier
    field.taken.connect(told.append)
    field.selectAll()
    QTest.keyClick(field, Qt.Key.Key_Delete)
    for c in text:  # QTest.keyClicks ends the program at what is not ASCII
        QApplication.sendEvent(field, QKeyEvent(QEvent.Type.KeyPress, 0, no, c))
    if leave:
        QApplication.sendEvent(field, QFocusEvent(QEvent.Type.FocusOut))
    else:
        QTest.keyClick(field, Qt.Key.Key_Return)
    field.taken.disconnect(told.append)
    return told


@pytest.mark.parametrize("leave", [False, True])
def test_point_and_comma_are_the_same_in_every_locale(field, leave):
    for text, value in (("2.5", 2.5), ("12,5", 12.5), (" -,5 ", -0.5), ("3.", 3.0), ("5e1", 50.0)):
        assert typed(field, text, leave) == [value]
        assert (field.value(), field.text()) == (value, shown_number(value))
        assert field.reason.isHidden()
    assert typed(field, "2.55") == [2.55]  # not rounded
    assert field.text() == "2.55"


@pytest.mark.parametrize("leave", [False, True])
def test_any_other_text_changes_nothing_and_says_why(field, leave):
    grouped = ["1,234.5", "1.234,5", "1,000", "1_0", "1'234", "1.234.567"]
    grouped += ["1 234", "1\u00a0234", "1\u202f234"]
    others = ("", " ", "-", ".", "nan", "inf", "0x1", "--5", "5-", "٢", "２", "2.5 Nm")
    for text in (*grouped, *others, "100.1", "-1e3", "1e400"):
        assert typed(field, text, leave) == []
        assert (field.value(), field.text()) == (7.0, text)
        reason = field.reason.text()
        assert field.reason.isVisible()
        assert "-100.0 to 100.0 Nm" in reason
        assert reason.endswith("Still 7.0 Nm.")
        assert ("grouping" in reason) == (text in grouped), text
    assert typed(field, "8", leave) == [8.0]
    assert not field.reason.isVisible()


def test_paste_arrows_and_wheel(field):
    from PySide6.QtCore import QPoint, QPointF, Qt
    from PySide6.QtGui import QGuiApplication, QWheelEvent
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QApplication

    from esea_host.windows.number_field import Choice

    QGuiApplication.clipboard().setText("2,5\n")
    field.selectAll()
    field.paste()
    assert field.take() == 2.5
    no = Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False
    up = QPointF(5, 5), QPointF(5, 5), QPoint(0, 0), QPoint(0, 120), Qt.MouseButton.NoButton, *no
    QApplication.sendEvent(field, QWheelEvent(*up))
    assert (field.value(), field.text()) == (2.5, "2.5")
    choice = Choice()
    choice.addItems(["a", "b"])
    choice.setCurrentIndex(1)
    QApplication.sendEvent(choice, QWheelEvent(*up))
    assert choice.currentIndex() == 1
    QTest.keyClick(field, Qt.Key.Key_Up)
    assert (field.value(), field.text()) == (2.5, "3.0")  # taken like typed text
    assert field.take() == 3.0
    assert typed(field, "100") == [100.0]
    QTest.keyClick(field, Qt.Key.Key_Up)
    assert field.take() is None
    assert field.value() == 100.0
    typed(field, "1e999")
    QTest.keyClick(field, Qt.Key.Key_Up)
    assert (field.value(), field.text()) == (100.0, "100.5")


@given(st.floats(-1e9, 1e9), st.sampled_from(".,"))
def test_what_is_shown_reads_as_the_same_number(value, point):
    text = shown_number(value).replace(".", point)
    assume(not re.fullmatch(r"-?[1-9]\d{0,2},\d{3}", text))  # 1,000 may be a thousand
    assert read_number(text, -1e9, 1e9) == value


@given(st.text(alphabet="0123456789.,'_ \u00a0\u202f\u2019eE+-٢", max_size=12))
def test_a_text_is_the_number_of_its_digits_or_refused(text):
    try:
        value = read_number(text, -1e300, 1e300)
    except UserError:
        return
    assert value == float(text.strip(" ").replace(",", "."))
    assert text.count(".") + text.count(",") <= 1
