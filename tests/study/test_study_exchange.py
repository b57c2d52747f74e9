"""A study's data for others: read back with their tools, against the log."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.study.exchange import new_codes, shared_rows, to_bids, to_parquet, traces, write_tsv
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.protocol import load_protocol
from esea_host.study.source import SimulatedSource
from tests.conftest import ROOT

# From BIDS' schema: entities and their order for motion, channels and its events.
RUN = re.compile(
    r"sub-(?P<sub>[0-9a-zA-Z]+)/ses-(?P<ses>\d+)/motion/sub-(?P=sub)_ses-(?P=ses)"
    r"_task-[0-9a-zA-Z]+_tracksys-[0-9a-zA-Z]+_run-(?P<run>\d+)"
    r"_(motion\.tsv|motion\.json|channels\.tsv|events\.tsv)"
)


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> StudyFolder:
    """Two people; of the first the fourth trial was aborted, then done, then repeated."""
    protocol = load_protocol(ROOT / "examples" / "steady_hold.toml")
    study = StudyFolder.create(tmp_path_factory.mktemp("x") / "s", protocol, True, durable=False)
    for code in ("P01", "P02"):
        study.enrol(code, True)
        session = study.session(code, 0, SimulatedSource(3))
        asked = iter([""] * 100 + ["came with Anna"])
        session.run(stop=lambda asked=asked: next(asked, ""))
        session.note("came with Anna")
        session.run()
        session.repeat(4, "a cough")
        session.source = SimulatedSource(8)
        session.run()
        session.close()
    return study


@pytest.fixture(scope="module")
def out(study, tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("bids") / "bids"
    assert to_bids(study, made) == 24
    return made


def test_a_bids_data_set_by_its_specification(study, out):
    codes = list(new_codes(study))
    files = [p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()]
    top = {"dataset_description.json", "participants.tsv", "README"}
    scans = {f"sub-{s}/ses-1/sub-{s}_ses-1_scans.tsv" for s in codes}
    runs = [f for f in files if f not in top | scans | {s[:-3] + "json" for s in scans}]
    assert all(RUN.fullmatch(f) for f in runs)
    assert len(runs) == 4 * 24
    assert pd.read_csv(out / "participants.tsv", sep="\t").participant_id.tolist() == [
        f"sub-{c}" for c in codes
    ]
    assert "SIMULATED" in (out / "README").read_text()
    everything = "".join((out / f).read_text() for f in files)
    for word in ("P01", "P02", "Anna", "cough"):
        assert word not in everything
    for name in scans:
        table = pd.read_csv(out / name, sep="\t")
        assert table.trial.tolist() == list(range(1, 13))
        assert all((out / name).parent.joinpath(f).exists() for f in table.filename)
        assert table.held.dtype == bool
        assert set(table.hold_s) == {0.3, 0.5}  # which no row of the task has
        said = json.loads((out / name).with_suffix(".json").read_text())
        assert set(said) | {"filename"} == set(table)
        assert said["held"]["Description"] == "whether it was held long enough"
    for name in (f for f in runs if f.endswith("_motion.json")):
        about = json.loads((out / name).read_text())
        stem = name.removesuffix("motion.json")
        channels = pd.read_csv(out / f"{stem}channels.tsv", sep="\t", keep_default_na=False)
        assert list(channels) == ["name", "component", "type", "tracked_point", "units"]
        motion = np.loadtxt(out / f"{stem}motion.tsv", delimiter="\t")
        assert motion.shape[1] == len(channels) == about["MotionChannelCount"]
        assert channels.type.tolist() == ["LATENCY", "JNTANG"]
        assert channels.units.tolist() == ["s", "deg"]
        assert motion[0, 0] == 0
        assert about["SamplingFrequency"] == pytest.approx(50.0, rel=1e-6)
        assert about["RecordingDuration"] == pytest.approx(motion[-1, 0])
        assert re.search(r"_task-steadyhold_", name)
        assert re.sub("[^0-9a-zA-Z]", "", about["TaskName"]) == "steadyhold"


def test_samples_and_events_are_those_of_the_log(study, out):
    new, code = next(iter(new_codes(study).items()))
    (stem,) = out.glob(f"sub-{new}/ses-1/motion/*_run-4_motion.tsv")
    motion = np.loadtxt(stem, delimiter="\t")
    entries = read_log(study.log_of(code, 0)).entries
    begun = [k for k, e in enumerate(entries) if e.kind == "trial" and e.data["trial"] == 4]
    last = [e for e in entries[begun[-1] :] if e.data.get("trial") == 4]
    samples = np.array([s for e in last if e.kind == "frames" for s in e.data["samples"]])
    assert np.allclose(motion[:, 0], samples[:, 0] - samples[0, 0])
    assert np.allclose(motion[:, 1], samples[:, 1], rtol=1e-8)
    wanted = [e.data["at_s"] - samples[0, 0] for e in last if e.kind == "event"]
    events = pd.read_csv(str(stem).replace("_motion.tsv", "_events.tsv"), sep="\t")
    assert events.onset.tolist() == pytest.approx(wanted)
    assert set(events.trial_type) == {"arrived"}


def test_a_trial_that_was_aborted_or_is_to_come_again_is_not_there(study):
    path = study.log_of("P01", 0)
    assert [t.trial.number for t in traces(path)] == list(range(1, 13))
    states = [e.data["state"] for e in read_log(path).entries if e.kind == "trial_end"]
    assert states.count("aborted") == 1
    session = study.session("P01", 0, SimulatedSource(1))
    session.repeat(7, "a cough")
    session.close()
    assert [t.trial.number for t in traces(path)] == [*range(1, 7), *range(8, 13)]
    session = study.session("P01", 0, SimulatedSource(1))
    session.run()
    session.close()


def test_rows_as_parquet(study, tmp_path):
    out = tmp_path / "p"
    assert to_parquet(study, out) == 24
    table = pd.read_parquet(out / "rows.parquet")
    assert set(table.participant) == set(new_codes(study))
    again = shared_rows(study)
    assert table.after_s.tolist() == [r["after_s"] for r in again]
    with pytest.raises(UserError, match="not empty"):
        to_parquet(study, out)


def test_a_tab_is_not_written_into_a_table(tmp_path):
    with pytest.raises(UserError, match="tab"):
        write_tsv(tmp_path / "a.tsv", [["a\tb"]])
    write_tsv(tmp_path / "b.tsv", [[None, "", True, 0.1, 3]])
    assert Path(tmp_path / "b.tsv").read_text() == "n/a\tn/a\ttrue\t0.1\t3\n"


@pytest.mark.parametrize(("form", "said"), [("bids", "24 runs"), ("parquet", "24 rows")])
def test_forms_of_the_command(study, tmp_path, form, said):
    words = ["study", "export", str(study.path), str(tmp_path / "o"), "--as", form]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, str(done.exception)
    assert said in done.output
