"""The pages: self-contained, complete, escaped, the same every time, and able to fail."""

from __future__ import annotations

import copy
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from esea_gen.board.emulator import Difference
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.identify import Identification, identify
from esea_gen.report import builder, sensing
from esea_gen.report import findings as boards
from esea_gen.report.builder import Report, gather
from esea_gen.report.findings import BoardRun, run_board
from esea_gen.report.identification import identification_page
from esea_gen.report.page import number
from esea_gen.verify import equivalence
from esea_gen.verify.streams import streams
from tests.browser import browser, readable
from tests.conftest import ROOT, require_tool

pytestmark = pytest.mark.ci

HDRB = ROOT / "tests" / "data" / "hdrb"
VOID = {"meta", "rect", "path", "use", "polyline", "br", "link", "img"}
HOSTILE = 'A <script>alert("x")</script> & "coupling"'


class Page(HTMLParser):
    """Collects tags, text and outward links; complains about tags that do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.ids: list[str] = []
        self.outward: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attrs:
            if key == "id":
                self.ids.append(value or "")
            if key in ("src", "href", "srcset", "action", "data") and not (value or "").startswith(
                "#"
            ):
                self.outward.append(f"{tag} {key}={value}")
            if key != "xmlns" and re.search(r"https?:|url\((?!#)", value or ""):
                self.outward.append(f"{tag} {key}={value}")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag, f"</{tag}> closes something else"

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


@pytest.fixture(scope="module")
def mapping(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The rubber's mapping for a device of 160 Hz: fewer steps to emulate."""
    folder = tmp_path_factory.mktemp("hdrb")
    shutil.copy(HDRB / "hdrb.csv", folder)
    text = (HDRB / "hdrb.toml").read_text()
    rate = 'sense_rate_Hz = { value = 160, status = "assumed", source = "shorter test" }'
    (folder / "hdrb.toml").write_text(text.replace("[device]\n", f"[device]\n{rate}\n"))
    return folder / "hdrb.toml"


@pytest.fixture(scope="module")
def identification(mapping: Path) -> Identification:
    return identify(mapping)


@pytest.fixture(scope="module")
def chirped(elbow: Device) -> Report:
    """The elbow without a recording, its board left out: that has a test of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(builder, "run_board", no_board)
        patch.setattr(sensing, "domain_chirp", ramp)
        shorten(patch)
        return gather(elbow)


@pytest.fixture(scope="module")
def recorded(identification: Identification, mapping: Path) -> Report:
    """The identified rubber with its own recording, board and all."""
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        return gather(identification.device, mapping)


@pytest.fixture(scope="module")
def chirped_page(chirped: Report) -> str:
    return chirped.html()


@pytest.fixture(scope="module")
def recorded_page(recorded: Report) -> str:
    return recorded.html()


def shorten(patch: pytest.MonkeyPatch) -> None:
    # Every stream, but shorter: verification has tests of its own.
    patch.setattr(equivalence, "streams", lambda block, seed: streams(block, seed, 400))
    patch.setattr(equivalence, "domain_chirp", ramp)


def ramp(device: Device) -> np.ndarray:
    theta = device.file.domain.theta_max_rad.value
    return np.float64(np.float32(theta * np.sin(np.arange(1500) * 0.004)))


def no_board(device: Device, board: str, deflections: object, say: object) -> BoardRun:
    return BoardRun(board, "a board", skipped="The emulator is not installed.")


def test_the_page_is_self_contained_and_well_formed(
    chirped_page: str, recorded_page: str, identification: Identification
) -> None:
    for text in (chirped_page, recorded_page, identification_page(identification)):
        page = Page(text)
        assert page.outward == []
        assert page.tags.count("script") == 1  # zooms figures
        assert "@import" not in text
        assert "@font-face" not in text
        assert len(page.ids) == len(set(page.ids)), "an id occurs twice"
        assert len(text) < 3e6
        assert str(ROOT) not in text
        for target in re.findall(r'(?:href="#|url\(#)([^")]+)', text):
            assert target in page.ids


def test_the_page_shows_every_parameter_with_its_status(chirped: Report, chirped_page: str) -> None:
    text = chirped_page
    for key, q in chirped.device.quantities():
        row = re.search(rf"<tr[^>]*>\s*<th[^>]*><span[^>]*>{re.escape(key)}</span>.*?</tr>", text)
        assert row is not None, key
        assert q.status in row.group()
        assert f"badge {q.status}" in row.group()
    assumed = [k for k, q in chirped.device.quantities() if q.status == "assumed"]
    assert f"{len(assumed)} values are assumed" in text
    listed = text[text.index('id="assumed"') :]
    assert all(k in listed[: listed.index("</div>")] for k in assumed)


def test_the_page_shows_every_equation_and_the_content_hash(
    chirped: Report, chirped_page: str
) -> None:
    page = Page(chirped_page)
    equations = [e for b in chirped.device.system.kinds for e in b.equations]
    assert page.tags.count("math") == len(equations)
    for e in equations:
        assert e.number in page.text
        assert e.text in page.text
    assert chirped.verification.content_hash in page.text
    assert all(c.stream in page.text for c in chirped.verification.comparisons)


def test_a_measured_torque_is_compared(recorded: Report, recorded_page: str) -> None:
    fit = recorded.to_dict()["fit"]
    assert fit is not None
    assert 0 < fit["mean_rms_percent"]["training"] < 20
    assert fit["f32_minus_f64_max_Nm"] < 1e-5
    text = recorded_page
    assert "measured</text>" in text or ">measured<" in text
    assert "Rate terms not identified" in text
    assert "rate terms not identified" in recorded.summary()


def test_another_specimens_torque_is_not_compared(recorded: Report) -> None:
    other = recorded.device.file.model_copy(update={"name": "other"})
    stranger = replace(recorded, device=Device(other, "other.toml"))
    assert stranger.to_dict()["fit"] is None
    assert "another specimen's" in " ".join(Page(stranger.html()).text.split())


def test_the_fit_is_that_of_the_identification(
    recorded: Report, identification: Identification
) -> None:
    # Two ways to one number: the report's own run of the C, and the identification's.  The report's
    # is the device whole, which smooths the deflection within a count of its encoders.
    fit = recorded.to_dict()["fit"]
    assert fit is not None
    content = identification.to_dict()
    for ours, theirs in zip(fit["sets"], content["sets"], strict=True):
        for role in ("training", "held_out"):
            assert ours[role]["rms_Nm"] == pytest.approx(theirs[role]["rms_Nm"], rel=2e-3)
    for role in ("training", "held_out"):
        expected = content["mean_rms"][f"{role}_percent"]
        assert fit["mean_rms_percent"][role] == pytest.approx(expected, rel=2e-3)


def test_hostile_text_is_escaped(chirped: Report, identification: Identification) -> None:
    named = identification.device.file.model_copy(update={"title": HOSTILE})
    hostile = replace(identification, device=Device(named, "x.toml"), notes=(HOSTILE,))
    assert identification_page(hostile).count("<script") == 1
    file = chirped.device.file
    bad = file.elastomer.model_copy(
        update={"k1_Nm_rad": file.elastomer.k1_Nm_rad.model_copy(update={"source": HOSTILE})}
    )
    device = Device(file.model_copy(update={"title": HOSTILE, "elastomer": bad}), "x.toml")
    text = replace(chirped, device=device, command=f"run {HOSTILE}").html()
    assert text.count("<script") == 1
    assert "&lt;script&gt;" in text
    assert HOSTILE in Page(text).text


def test_two_renders_are_equal(
    recorded: Report, recorded_page: str, identification: Identification
) -> None:
    assert recorded.html() == recorded_page
    assert json.dumps(recorded.to_dict()) == json.dumps(recorded.to_dict())
    assert identification_page(identification) == identification_page(identification)


def test_the_banner_says_passed_only_when_all_is_well(chirped: Report, chirped_page: str) -> None:
    assert chirped.passed
    text = chirped_page
    assert 'class="banner passed partial"' in text
    assert "✗" not in Page(text).text
    assert "skipped: The emulator is not installed." in Page(text).text
    assert any("skipped" in line for line in chirped.summary())


@pytest.mark.parametrize("how", ["problem", "status", "bits"])
def test_a_failing_comparison_turns_the_banner(chirped: Report, how: str) -> None:
    verification = copy.deepcopy(chirped.verification)
    comparison = verification.comparisons[0]
    if how == "problem":
        comparison.problems.append("omega_rad_s: error 1 above 0.1")
    elif how == "status":
        comparison.status_differences = 3
    else:
        comparison.bit_identical = False
    failed = replace(chirped, verification=verification)
    assert not failed.passed
    assert not failed.to_dict()["passed"]
    text = failed.html()
    assert text.count('class="banner failed"') == 1
    assert "✓" not in text.partition('id="verdict"')[2].partition('class="cards"')[0]
    assert failed.problems
    assert all(p in Page(text).text for p in failed.problems)
    assert failed.summary()[1].startswith("FAILED: The C does not match the model; ")
    assert "accuracy is not known" in failed.summary()[2]  # what the device does is another matter


def test_a_board_that_differs_or_dies_turns_the_banner(recorded: Report) -> None:
    if recorded.board.skipped:
        require_tool("qemu-system-arm")
        require_tool("arm-none-eabi-gcc")
    assert recorded.passed
    assert recorded.board.results
    (largest,) = [recorded.to_dict()["verdicts"]["device"]["largest_Nm"]]
    held_out = [s["held_out"] for s in recorded.to_dict()["fit"]["sets"]]
    assert largest == max(s["max_Nm"] for s in held_out if s)
    said = f"The sensor's error is at most {largest:.2g} Nm of 4.47 Nm; held-out cycles"
    assert recorded.summary()[2].startswith(said)
    assert "every bit equal" in Page(recorded.html()).text
    label, result = next(iter(recorded.board.results.items()))
    wrong = replace(
        result,
        identical=False,
        first_difference=Difference(7, "tau_Nm", "0x3f800000", "0x00000000"),
    )
    for board in (
        replace(recorded.board, results={label: wrong}),
        replace(recorded.board, results={label: replace(result, content_hash="0" * 16)}),
        replace(recorded.board, results={}, failed="the board was silent for 10 s"),
    ):
        failed = replace(recorded, board=board)
        assert not failed.passed
        assert 'class="banner failed"' in failed.html()


def test_missing_tools_do_not_stop_the_report(
    elbow: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: object) -> None:
        raise UserError("The compiler 'arm-none-eabi-gcc' is not installed.", "Install it.")

    monkeypatch.setattr(boards, "build_firmware", missing)
    monkeypatch.delenv("ESEA_REQUIRE_TOOLS", raising=False)
    board = run_board(elbow, "netduinoplus2", {}, lambda _: None)
    assert "arm-none-eabi-gcc" in board.skipped
    assert board.passed
    monkeypatch.setenv("ESEA_REQUIRE_TOOLS", "1")
    with pytest.raises(UserError):
        run_board(elbow, "netduinoplus2", {}, lambda _: None)


def test_a_build_that_breaks_is_a_finding(elbow: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("the control code is not float-only")

    monkeypatch.setattr(boards, "build_firmware", broken)
    board = run_board(elbow, "netduinoplus2", {}, lambda _: None)
    assert not board.passed
    assert "float-only" in board.failed


def test_the_identification_page_shows_what_was_found(identification: Identification) -> None:
    text = Page(identification_page(identification)).text
    content = identification.to_dict()
    for key in content["parameters"]:
        assert key in text
    for note in identification.notes:
        assert note in text
    assert "Rate terms not identified" in text
    assert "Weakest direction" in text
    for s in content["sets"]:
        assert s["label"] in text
        assert number(s["held_out"]["rms_percent"], 3) in text


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.0, 2, "0"),
        (0.0123, 2, "0.012"),
        (-3.456, 3, "−3.46"),
        (None, 2, "–"),
        (float("inf"), 2, "∞"),
        (float("nan"), 2, "not a number"),
        (1.5e-7, 2, '<span class="n">1.5·10<sup>−7</sup></span>'),
        (-2e6, 2, '<span class="n">−2.0·10<sup>6</sup></span>'),
    ],
)
def test_numbers_are_written_for_people(value: float | None, digits: int, expected: str) -> None:
    assert number(value, digits) == expected


def test_pages_are_read_on_a_telephone_by_day_and_by_night(
    chirped_page: str, recorded_page: str, identification: Identification, tmp_path: Path
) -> None:
    with browser(tmp_path / "profile") as b:
        for text in (chirped_page, recorded_page, identification_page(identification)):
            readable(b, text, tmp_path)
