"""Pages of identifications and of the thesis, and how numbers are written: worked out by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace as Of

import pytest

from esea_gen.devices.fields import field_facts
from esea_gen.identify import Identification
from esea_gen.report import figures, identification, page, thesis
from esea_gen.report.page import PageSection
from esea_gen.studies.thesis.catalogue import DIFFERS, NOT_RUN, REPRODUCED, TAKEN, UNEXPLAINED

from .made_findings import said


def test_an_identification_s_page_is_given_parameters_and_what_is_assumed(monkeypatch):
    given = []
    monkeypatch.setattr(identification, "render", lambda *a, **k: given.append((a, k)) or "page")
    monkeypatch.setattr(identification, "device_hash", lambda device: "abc")
    guess = said(1000.0, "assumed", "a guess")
    known = (("timing.sense_rate_Hz", guess), ("domain.theta_max_rad", said(0.2)))
    device = Of(title="A rubber", quantities=lambda: iter(known))
    content = {"mapping": "rig.toml", "parameters": {"B": {"value": math.nan}}}
    own = object.__new__(Identification)
    terms = Of(device=device, to_dict=lambda: {"mapping": "m", "model": {"member": "two springs"}})
    monkeypatch.setattr(Identification, "device", device, raising=False)
    monkeypatch.setattr(Identification, "to_dict", lambda self: content)
    for result, section, f, parameters in (
        (
            own,
            "parameters",
            content
            | {
                "parameters": {"B": {"value": None}},
                "content_hash": "abc",
                "command": "esea-gen identify rig.toml",
            },
            [
                {
                    "key": "B",
                    "meaning": field_facts("elastomer.maxwell.B")["text"],
                    "value": None,
                }
            ],
        ),
        (
            terms,
            "terms",
            {
                "mapping": "m",
                "model": {"member": "two springs"},
                "content_hash": "abc",
                "command": 'esea-gen identify m --model "two springs"',
            },
            [],
        ),
    ):
        given.clear()
        assert identification.identification_page(result) == "page"
        (((head, sections, of), shown),) = given
        assert (head.part, of) == ("identification/head", result)
        words = (("notes", "Notes"), (section, section.capitalize()), ("errors", "Errors"))
        words += (("torque", "Torque"), ("specimen", "Specimen"), ("search", "Data and search"))
        assert [(s.part, s.title) for s in sections] == [
            (f"identification/{part}", title) for part, title in words
        ]
        assert shown == {
            "title": "Identification: A rubber",
            "f": f,
            "parameters": parameters,
            "assumed": [("timing.sense_rate_Hz", guess)],
        }


def test_the_weakest_direction_is_told_largest_part_first(monkeypatch):
    given = []
    monkeypatch.setattr(figures, "spread", lambda *a: given.append(a) or "drawn")
    parameters = {"k": {"value": 2.0, "sigma": 0.5}, "m": {"value": 3.0, "sigma": None}}
    weakest = {"direction": {"a": 0.25, "b": -0.75, "c": 0.5}, "rms_change_Nm": 0.125}
    content = {"parameters": parameters, "uncertainty": {"weakest": weakest}}
    shown = identification.PARAMETERS.shown(Of(to_dict=lambda: content))
    assert shown == {
        "weakest": [("b", -0.75), ("c", 0.5), ("a", 0.25)],
        "weakest_change": 0.125,
        "spread": "drawn",
    }
    assert given == [([("k", 2.0, 0.5), ("m", 3.0, None)], "spread")]
    for none in (None, {"direction": None}):
        content["uncertainty"] = {"weakest": none}
        shown = identification._uncertainty(Of(to_dict=lambda: content))
        assert (shown["weakest"], shown["weakest_change"]) == ([], None)


@pytest.mark.parametrize(
    ("key", "expected"),
    [("k1_Nm_rad", "elastomer.k1_Nm_rad"), ("eps2", "elastomer.maxwell.eps2")],
)
def test_a_rate_term_stands_in_a_section_of_its_own(key, expected):
    assert identification.dotted(key) == expected


# -- how numbers are written -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (-math.inf, 2, "–∞"),
        (1.0, 2, "1.0"),
        (9.99, 3, "9.99"),
        (123.4, 2, "123"),
        (0.001, 2, "0.0010"),
        (99999.0, 2, "99999"),
        (1e5, 3, '<span class="n">1.00·10<sup>5</sup></span>'),
        (-0.000999, 1, '<span class="n">−1·10<sup>−3</sup></span>'),
        (0.5, 2, "0.50"),
        (12.345, 4, "12.35"),
    ],
)
def test_a_figure_is_rounded_to_its_digits(value, digits, expected):
    assert page.number(value, digits) == expected


def test_a_figure_has_two_digits_where_nobody_says():
    assert page.number(3.14159) == "3.1"


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (1e-4, "0.0001"),
        (123456.7, "123457"),
        (1e6, '<span class="n">1·10<sup>6</sup></span>'),
        (1234567.0, '<span class="n">1.23457·10<sup>6</sup></span>'),
        (-2.5e-5, '<span class="n">−2.5·10<sup>−5</sup></span>'),
        (-1234.5, "−1234.5"),
    ],
)
def test_a_parameter_has_six_digits_and_no_more_zeros_than_it_needs(value, expected):
    assert page.plain(value) == expected


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("1", ""),
        ("bits", ""),
        ("Nm", "N·m"),
        ("Nm s/rad", "N·m·s/rad"),
        ("Nm/rad^3", "N·m/rad³"),
        ("rad/s^2", "rad/s²"),
        ("s", "s"),
    ],
)
def test_a_unit_is_written_as_it_is_read(unit, expected):
    assert page.unit_text(unit) == expected


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (math.pi, "rad", "180°"),
        (-math.pi / 8, "rad/s", "−22.5°/s"),
        (math.radians(999.4), "rad", "999°"),
        (math.radians(1000), "rad", "1\u202f000°"),
        (math.radians(-12345.6), "rad/s", "−12\u202f346°/s"),
        (1.0, "rad/s^2", ""),
    ],
)
def test_angles_are_told_in_degrees(value, unit, expected):
    assert page.for_people(value, unit) == expected


def test_statuses_have_their_marks_and_templates_their_filters():
    filters = page.environment().filters
    assert [filters["mark"](s) for s in ("published", "identified", "assumed", "derived")] == [
        *("●", "◆", "▲", "○")
    ]
    assert filters["count"](1234567) == "1\u202f234\u202f567"
    assert filters["num"](0.25) == "0.25"
    assert filters["plain"](0.25) == "0.25"
    assert filters["unit"]("Nm") == "N·m"
    assert filters["people"](math.pi, "rad") == "180°"
    assert filters["mathml"]("<m>1</m>").__html__() == "<m>1</m>"


def test_a_page_is_given_what_its_sections_show(monkeypatch):
    asked = []
    template = Of(render=lambda **words: words)
    known = Of(get_template=lambda name: asked.append(name) or template)
    monkeypatch.setattr(page, "environment", lambda: known)
    head = PageSection("h", shown=lambda found: {"a": found + 1})
    sections = [PageSection("x", "X", shown=lambda found: {"b": found + 2}), PageSection("y")]
    assert page.render(head, sections, 10, title="T") == {
        "head": head,
        "sections": sections,
        "found": 10,
        "title": "T",
        "a": 11,
        "b": 12,
    }
    assert asked == ["report/page.html.j2"]
    assert (sections[1].title, sections[1].content(3), sections[1].shown(3)) == ("", {}, {})


# -- the thesis ------------------------------------------------------------------------------------


def test_the_thesis_page_has_chapters_once_and_tones_of_verdicts(monkeypatch):
    asked = []
    template = Of(render=lambda **words: words)
    known = Of(get_template=lambda name: asked.append(name) or template)
    monkeypatch.setattr(thesis, "environment", lambda: known)
    content = {"items": [{"chapter": c} for c in (4, 3, 4, 8)]}
    told = thesis.thesis_page(Of(to_dict=lambda: content, explained=False), "again")
    assert asked == ["report/thesis.html.j2"]
    assert (told["f"], told["command"], told["explained"]) == (content, "again", False)
    assert told["chapters"] == [4, 3, 8]
    verdicts = (REPRODUCED, TAKEN, DIFFERS, UNEXPLAINED, NOT_RUN)
    assert [told["tone"](v) for v in verdicts] == ["good", "good", "warn", "bad", ""]
    assert [told["shown"](x) for x in (None, -0.123456, 12.0)] == ["–", "−0.1235", "12"]
    assert [told["share"](x) for x in (None, 0, 0.0, 0.125, 1e-5)] == [
        *("", "0", "0", "12.5 %", "0.0 %")
    ]
