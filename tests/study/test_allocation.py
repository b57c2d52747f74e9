"""Allocation: permuted blocks of random size, sealed, and no better to guess than it must be."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.study.allocation import draw_list, strata_of, stratum_named
from esea_host.study.exchange import new_codes, to_bids, to_rows
from esea_host.study.folder import StudyFolder
from esea_host.study.plan import build_plan, group_of
from esea_host.study.privacy import KEY, PRIVATE, export_codes, findings, sealed, unsealed
from esea_host.study.protocol import Protocol, ProtocolFile
from esea_host.study.report import study_page
from esea_host.study.session import read_session
from esea_host.study.source import SimulatedSource
from tests.browser import browser, readable
from tests.conducted import TRACKING, changed, of_tasks

PLACES = 6000


def file_of(blocks: str = "", strata: str = "") -> ProtocolFile:
    text = "[allocation]\n" + (f"blocks = {blocks}\n" if blocks else "")
    text += f"[allocation.strata]\n{strata}\n" if strata else ""
    return changed("[stopping]", f"{text}[stopping]").file


def test_blocks_have_the_declared_sizes_and_are_balanced():
    groups = [e.group for e in draw_list(file_of("[2, 6]"), b"1" * 32, PLACES)]
    # Where no group leads, a block may end: at every such place one of the two sizes fits.
    lead = np.cumsum([1 if g == "A" else -1 for g in groups])
    ends = {0}
    for k in range(2, PLACES + 1, 2):
        if lead[k - 1] == 0 and (k - 2 in ends or k - 6 in ends):
            ends.add(k)
    assert PLACES - max(ends) < 6
    assert np.max(np.abs(lead)) <= 3
    assert Counter(groups)["A"] == pytest.approx(PLACES / 2, abs=3)


def test_the_exported_seed_and_all_past_allocations_predict_nothing():
    """The former allocation followed from the protocol's seed: all of 200 were predicted."""
    protocol = changed("seed = 7", "seed = 7")
    told = [group_of(protocol, k) for k in range(200)]
    lists = [draw_list(protocol.file, bytes([k]) * 32, 200) for k in range(200)]
    each = [np.mean([e.group == g for e, g in zip(found, told, strict=True)]) for found in lists]
    assert np.mean(each) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(200 * 200))
    # Nor does the first half of a list tell its second half by way of another secret's list.
    assert len({tuple(e.group for e in found[:40]) for found in lists}) == 200


def test_strata_have_lists_of_their_own():
    file = file_of(strata='sex = ["f", "m"]\nsite = ["1", "2"]')
    assert strata_of(file) == ["sex=f,site=1", "sex=f,site=2", "sex=m,site=1", "sex=m,site=2"]
    assert stratum_named(file, ["site=2", "sex=f"]) == "sex=f,site=2"
    found = draw_list(file, b"3" * 32, 40)
    assert len({tuple(e.group for e in found if e.stratum == s) for s in strata_of(file)}) == 4
    for wrong in ([], ["sex=f"], ["sex=x,site=1"], ["sex=f,site=1,more=2"]):
        with pytest.raises(UserError, match="sex: f or m; site: 1 or 2"):
            stratum_named(file, wrong)
    assert stratum_named(file_of(), []) == ""
    with pytest.raises(UserError, match="Leave --stratum out"):
        stratum_named(file_of(), ["sex=f"])


@pytest.mark.parametrize("blocks", ["[4]", "[4, 4]", "[3, 4]", "[0, 4]", "[4, 102]"])
def test_wrong_block_sizes_are_told(blocks):
    with pytest.raises(UserError, match="at least two different sizes"):
        file_of(blocks)


# -- a study ---------------------------------------------------------------------------------------


class RealPerson(SimulatedSource):
    """Counts as a real person on a real device."""

    simulated = False


def created(folder: Path, protocol: Protocol, people: int, by: str = "Olga Operator"):
    study = StudyFolder.create(folder, protocol, simulated=False, durable=False, by=by)
    if codes := [f"P{k:02d}" for k in range(1, people + 1)]:
        study.enrol(codes, True, "2.1", "", "Carl Consent")
    third = StudyFolder.open(folder, durable=False, by="Tina Third")
    third.allocate(folder.parent / "list.csv", 40)
    return study


def codes_of(folder: Path) -> list[str]:
    lines = (folder.parent / "list.csv").read_text().splitlines()
    return [line.split(",")[3] for line in lines[3:]]


def run(study: StudyFolder, code: str, number: int = 0, seed: int = 3) -> None:
    session = study.session(code, number, RealPerson(seed))
    session.run()
    study.finish(session)
    session.close()


BLINDED = ('blinded = ["participant"]', 'blinded = ["operator", "participant"]')


@pytest.fixture(scope="module")
def blinded(tmp_path_factory) -> StudyFolder:
    """Twelve people, the operator blinded, their first session done."""
    study = created(tmp_path_factory.mktemp("b") / "s", changed(*BLINDED), 12)
    for k, code in enumerate(study.participants()):
        study.disclose(code, codes_of(study.path)[k])
        run(study, code)
    return study


def test_a_place_is_opened_by_its_code_alone_and_once(tmp_path):
    study = created(tmp_path / "s", changed("seed = 7", "seed = 7"), 3)
    codes = codes_of(study.path)
    for opening, words in (
        ("", "place 1 is to be opened"),
        ("AAAA-BBBB", "does not open"),
        (codes[1], "does not open place 1"),
    ):
        with pytest.raises(UserError, match=words):
            study.disclose("P01", opening)
    with pytest.raises(UserError, match="P01 has no group yet"):
        run(study, "P01")
    assert study.group_shown("P01", "operator") == "not disclosed yet"
    told = study.disclose("P01", codes[0].lower().replace("-", " "))
    assert told == f"P01: place 1 of the list, group {study.group('P01')}"
    assert study.disclose("P01", codes[1]) == ""
    study.disclose("P02", str(tmp_path / "list.csv"))
    last = study.trail()[-1]
    assert (last.kind, last.by, last.data["place"]) == ("disclose", "Olga Operator", 2)
    assert last.utc.endswith("Z")
    third = StudyFolder.open(study.path, durable=False, by="Tina Third")
    for by, call, words in (
        (study, lambda s: s.allocate(tmp_path / "x", 9), "third person, not by Olga Operator"),
        (third, lambda s: s.allocate(tmp_path / "x", 9), "list of 40 places; 2 are open"),
        (third, lambda s: s.allocate(s.path / "x", 9, "more"), "in the study's folder"),
        (third, lambda s: s.allocate(tmp_path / "list.csv", 9, "more"), "cannot be made"),
        (third, lambda s: s.disclose("P03", codes[2]), "Tina Third made the list"),
    ):
        with pytest.raises(UserError, match=words):
            call(by)
    third.allocate(tmp_path / "more.csv", 9, "all are open")
    assert study.allocations.places() == 49
    text = (study.path / "allocation-1.json").read_text()
    (study.path / "allocation-1.json").write_text(text.replace("0", "1", 1))
    with pytest.raises(UserError, match="not what study allocate wrote"):
        study.disclose("P03", codes[2])
    assert [p for p in study.problems() if "allocation-1.json is not what" in p]


def test_each_stratum_is_opened_in_its_own_order(tmp_path):
    text = '[allocation.strata]\nsex = ["f", "m"]\n[stopping]'
    study = created(tmp_path / "s", changed("[stopping]", text), 0)
    words = ["study", "enrol", str(study.path), "P01", "--consent", "--operator", "Olga Operator"]
    assert "sex: f or m" in str(CliRunner().invoke(app, [*words, "--form", "1"]).exception)
    done = CliRunner().invoke(app, [*words, "--form", "1", "--stratum", "sex=f"])
    assert done.exit_code == 0, str(done.exception)
    study.enrol("P02", True, "1", strata=["sex=m"])
    study.enrol("P03", True, "1", strata=["sex=f"])
    for code, words in (("P01", "place 1"), ("P02", "place 1"), ("P03", "place 2")):
        assert words in study.disclose(code, str(tmp_path / "list.csv"))
    strata = [e.data["stratum"] for e in study.trail() if e.kind == "disclose"]
    assert strata == ["sex=f", "sex=m", "sex=f"]


def test_the_seed_makes_the_list_again_and_its_seals_show_no_group(tmp_path):
    study = created(tmp_path / "s", changed("seed = 7", "seed = 7"), 1)
    lines = (tmp_path / "list.csv").read_text().splitlines()
    again = draw_list(study.protocol.file, bytes.fromhex(lines[1].removeprefix("# seed: ")), 40)
    assert [e.group for e in again] == [line.split(",")[2] for line in lines[3:]]
    seals = json.loads((study.path / "allocation-1.json").read_text())[""]
    assert seals == [e.commitment for e in again]
    assert len(set(seals)) == 40
    assert (tmp_path / "list.csv").stat().st_mode & 0o077 == 0


# Not within a sealed value, whose letters are random.
TELLING = re.compile(r'(?<![\w+/])(near|narrow|within_deg|"group":"[AB]"|[Gg]roup [AB])(?![\w+/])')


def test_a_blinded_operator_reads_the_group_nowhere(blinded, tmp_path):
    to_rows(blinded, tmp_path / "rows")
    to_bids(blinded, tmp_path / "bids")
    texts = {"report": study_page(blinded)}
    for command in (["status"], ["audit"], ["export", "--check"]):
        done = CliRunner().invoke(app, ["study", command[0], str(blinded.path), *command[1:]])
        assert done.exit_code == 0, str(done.exception)
        texts[command[0]] = done.output
    for top in (blinded.path, tmp_path):
        files = [p for p in top.rglob("*") if p.is_file()]
        texts |= {str(p): p.read_text(encoding="utf-8") for p in files}
        assert not [p for p in files if p.parent.name in ("A", "B", "near", "narrow")]
    for name, text in texts.items():
        if not name.endswith(("protocol.toml", ".py")):
            assert not TELLING.search(text), name
    opened = [e.data for e in blinded.trail() if e.kind == "disclose"]
    assert [set(d) for d in opened] == [{"participant", "stratum", "place", "sealed"}] * 12
    assert blinded.disclose("P01") == ""
    assert blinded.group_shown("P01", "operator") == "blinded"


def test_the_study_goes_on_and_its_data_are_whole_after_unblinding(tmp_path):
    study = created(tmp_path / "s", changed(*BLINDED), 2)
    for k, code in enumerate(study.participants()):
        study.disclose(code, codes_of(study.path)[k])
        run(study, code)
    run(study, "P01", 1)
    assert read_session(study.log_of("P01", 0)).plan.group == study.group("P01")
    to_rows(study, tmp_path / "labels", labels=True)
    assert {r["condition"] for r in rows_in(tmp_path / "labels")} <= {"condition 1", "condition 2"}
    words = ["study", "unblind", str(study.path), "operator", "--operator", "Olga Operator"]
    assert "needs a reason" in str(CliRunner().invoke(app, words).exception)
    done = CliRunner().invoke(app, [*words, "--reason", "a severe event"])
    assert done.output == "operator unblinded\n"
    assert "is not blinded" in str(CliRunner().invoke(app, [*words, "--reason", "x"]).exception)
    entry = study.trail()[-1]
    assert (entry.by, entry.data["reason"]) == ("Olga Operator", "a severe event")
    to_rows(study, tmp_path / "open")
    assert {r["condition"] for r in rows_in(tmp_path / "open")} == {"near", "narrow"}
    assert f"Group {study.group('P02')}" in study_page(study)


def rows_in(out: Path) -> list[dict]:
    return [json.loads(line) for line in (out / "rows.jsonl").open()]


# -- attacks on what is exported -------------------------------------------------------------------


def test_exported_codes_are_not_reconstructed(blinded, tmp_path):
    """Formerly seed 0 and the number of participants gave all of them."""
    to_rows(blinded, tmp_path / "x")
    shown = list(dict.fromkeys(r["participant"] for r in rows_in(tmp_path / "x")))
    people, truth = list(blinded.participants()), new_codes(blinded)
    assert shown == sorted(truth)  # not in the order of coming
    public = [bytes(32), (7).to_bytes(32), hashlib.sha256(blinded.protocol.text.encode()).digest()]
    for key in public:
        assert not set(export_codes(key, people)) & set(shown)
    everything = "".join(p.read_text() for p in (tmp_path / "x").iterdir())
    assert blinded.key.hex() not in everything
    # Whose code is the first in order, the second...: one of 12 is right by chance, over keys.
    right = [
        np.sum(np.array(list(export_codes(bytes([k]) * 32, people).values())) == people)
        for k in range(200)
    ]
    assert np.mean(right) == pytest.approx(1.0, abs=4 / np.sqrt(200))
    # Another study with the same people has other codes; this one has them in every export.
    same = created(tmp_path / "s", blinded.protocol, 12)
    assert (new_codes(blinded), same.key != blinded.key) == (truth, True)


def test_orders_of_trials_do_not_tell_who_came_when(blinded, tmp_path):
    """The protocol may be public: its seed gave the order of trials of every number."""
    seed = changed("seed = 7", "seed = 7")
    assert "seed = 7" in blinded.protocol.text
    to_rows(blinded, tmp_path / "x")
    assert "seed = 7" not in (tmp_path / "x" / "protocol.toml").read_text()

    def places(plan) -> tuple:
        return tuple(t.parameters["place_deg"] for t in plan.trials)

    done = [places(read_session(path).plan) for _, _, path in blinded.sessions()]
    known = [places(build_plan(seed, k, 0, "A")) for k in range(12)]
    # 36 orders are possible, so that some agree by chance; formerly all 12 did.
    assert sum(a == b for a, b in zip(done, known, strict=True)) <= 6


@pytest.mark.ci
def test_the_report_is_whole_on_a_telephone(blinded, tmp_path):
    with browser(tmp_path / "profile") as b:
        readable(b, study_page(blinded), tmp_path)


# -- privacy ---------------------------------------------------------------------------------------


def test_what_could_identify_a_person_is_listed(tmp_path):
    rows = (
        "participant,age,task,remark,when\n"
        "SAAAAAAAA,31,hold,was tired,2026-11-26\n"
        "SBBBBBBBB,80,hold,Anna helped P07,1764150000\n"
    )
    (tmp_path / "rows.csv").write_text(rows)
    (tmp_path / "protocol.toml").write_text("# asked by anna@example.org, 10:30\nschema = 1\n")
    found = "\n".join(findings(tmp_path, ["P07"], ["Olga Operator"], ["hold"]))
    for words in (
        "rows.csv: a date: 2026-11-26",
        "rows.csv: a time since 1970: 1764150000",
        "rows.csv: a participant's code: P07",
        "protocol.toml: an e-mail address: anna@example.org",
        "protocol.toml: a time of day: 10:30",
        "protocol.toml: 1 lines of comments",
        "column remark: free text, 2 different: 'Anna helped P07', 'was tired'",
        "column age: about the person; 2 values occur in one only",
        "2 participants",
    ):
        assert words in found
    assert "column task" not in found


def test_sealed_values_open_with_their_key_alone():
    text = sealed(b"k" * 32, ["A", 1.5, {"x": None}])
    assert unsealed(b"k" * 32, text) == ["A", 1.5, {"x": None}]
    assert text != sealed(b"k" * 32, ["A", 1.5, {"x": None}])
    assert len(sealed(b"k" * 32, "A")) == len(sealed(b"k" * 32, "narrow, then near"))
    for key, wrong in ((b"j" * 32, text), (b"k" * 32, text[:30] + "A" * 8 + text[38:])):
        with pytest.raises(UserError, match="does not open"):
            unsealed(key, wrong)


def test_a_lost_key_is_told(blinded, tmp_path):
    study = created(tmp_path / "s", blinded.protocol, 1)
    (study.path / PRIVATE / KEY).write_text("00" * 32)
    with pytest.raises(UserError, match="not the study's"):
        new_codes(study)
    for change in (lambda p: p.write_text("x"), Path.unlink):
        change(study.path / PRIVATE / KEY)
        with pytest.raises(UserError, match="cannot be read as a key"):
            new_codes(study)
    assert not (study.path / PRIVATE / KEY).exists()


# -- studies of former versions --------------------------------------------------------------------


def test_a_study_without_groups_has_secret_orders_too(tmp_path):
    protocol = of_tasks(TRACKING)
    study = StudyFolder.create(tmp_path / "s", protocol, False, durable=False, by="x")
    study.enrol("P01", True, "1")
    assert study.disclose("P01") == ""
    study.session("P01", 0, RealPerson(1)).close()
    seeds = [t.seed for t in read_session(study.log_of("P01", 0)).plan.trials]
    assert seeds != [t.seed for t in build_plan(protocol, 0, 0).trials]
    with pytest.raises(UserError, match="no groups"):
        study.allocate(tmp_path / "list.csv", 8)
