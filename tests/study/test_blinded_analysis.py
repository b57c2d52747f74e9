"""Analyses while somebody is blinded: the same numbers, by names that tell nothing."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_host.cli import app
from esea_host.interaction.recordings import (
    MANIFEST,
    PREFIX,
    read_manifest,
    recording_name,
    write_manifest,
    write_recording,
)
from esea_host.interaction.virtual import interaction_protocol
from esea_host.study.exchange import veiled_names
from esea_host.study.folder import StudyFolder
from esea_host.study.log import EventLog
from esea_host.study.plan import build_plan
from esea_host.study.privacy import PRIVATE
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.wrist.analysis import STATES, analyse
from esea_host.wrist.virtual import wrist_protocol

PEOPLE = 6


def blinded(protocol: Protocol) -> Protocol:
    old = 'blinded = ["participant"]'
    assert old in protocol.text
    return parse_protocol(protocol.text.replace(old, 'blinded = ["operator", "analyst"]'), "p")


def studied(folder: Path, protocol: Protocol, task: str, row) -> StudyFolder:
    """A study whose logs hold these rows for every trial of a task."""
    study = StudyFolder.create(folder, protocol, simulated=True, durable=False)
    study.enrol([f"P{k:02d}" for k in range(1, PEOPLE + 1)], True)
    for k, code in enumerate(study.participants()):
        for number in (0, 1):
            plan = build_plan(protocol, k, number, study.group(code))
            path = study.log_of(code, number)
            with EventLog(path, durable=False) as log:
                log.seal = study.key
                log.append(0.0, "session", {"participant": code, "plan": asdict(plan)})
                for trial in (t for t in plan.trials if t.task.startswith(task)):
                    names = ("block", "task", "condition", "catch", "familiarisation")
                    about = {n: getattr(trial, n) for n in names}
                    whole = {"trial": trial.number, "session": number, **about}
                    whole |= row(trial, np.random.default_rng((k, number, trial.number)), path)
                    end = {"trial": trial.number, "state": "completed", "reason": "", "row": whole}
                    log.append(0.0, "trial_end", end)
    return study


def caught(trial, rng, path):
    constrained = trial.parameters.get("impairment", False)
    return {
        "axis": trial.parameters["axis"],
        "impairment": constrained,
        "achieved": trial.parameters["axis"] == "RU" or rng.random() < 0.9 - 0.4 * constrained,
        "sse_deg2": float(rng.normal(700 + 100 * constrained, 30)),
        "pulled_away": False,
        "distance_deg": 30.0,
        "furthest_deg": float(rng.normal(31, 1)),
        "nearest_deg": -1.0,
    }


def moved(trial, rng, path):
    time_s = np.arange(1, 7_001) / 1000
    noise = 0.05 + 0.1 * (trial.parameters["element"] == "spring")
    steps = rng.normal(0, noise, len(time_s)).cumsum() * 1e-3
    write_recording(
        path.parent / recording_name(trial.number),
        time_s,
        0.3 * np.sin(2 * np.pi * 0.3 * time_s) + steps,
        np.zeros(len(time_s), bool),
        True,
    )
    return {"element": trial.parameters["element"]}


def test_the_wrist_study_by_neutral_states(tmp_path):
    study = studied(tmp_path / "s", blinded(wrist_protocol(1)), "wrist.catch", caught)
    hidden, names = analyse(study.path), veiled_names(study)
    assert hidden.blinded
    assert hidden.sides[STATES] == ("condition 1", "condition 2")
    assert all(x.published == (None, None) for x in hidden.tables[STATES][:5])
    done = CliRunner().invoke(app, ["analyse", "wrist", str(study.path)])
    assert done.exit_code == 0, str(done.exception)
    assert done.output.startswith("Left out:\n  P01, session 1: 30 of 139 trials were not run\n")
    assert "BLINDED" in done.output
    table = done.output[done.output.index("7.4 states") :]
    assert not {"healthy", "constrained"} & set(table.split())
    for role in ("operator", "analyst"):
        study.record("unblind", role=role, reason="the analysis is fixed")
    shown = analyse(study.path)
    assert shown.sides[STATES] == ("healthy", "constrained")
    swapped = names["healthy"] == "condition 2"
    for a, b in zip(hidden.tables[STATES], shown.tables[STATES], strict=True):
        assert (a.second, a.first)[:: 1 if swapped else -1] == (b.first, b.second)
        assert a.p == b.p
    assert hidden.tables["7.3 sessions"] == shown.tables["7.3 sessions"]
    assert all(x.p_holm for x in shown.tables[STATES] if x.n)  # also where all are equal


def test_the_interaction_study_by_neutral_elements(tmp_path):
    study = studied(tmp_path / "s", blinded(interaction_protocol(1)), PREFIX, moved)
    write_manifest(study.path, 5.0)
    assert not (study.path / MANIFEST).exists()
    assert (study.path / PRIVATE / MANIFEST).exists()
    words = ["analyse", "interaction", str(study.path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, str(done.exception)
    assert done.output.startswith("Nothing is left out.\nBLINDED")
    assert "condition 1" in done.output
    for word in ("spring", "elastomer", "Table 6.3"):
        assert word not in done.output
    refused = CliRunner().invoke(app, [*words, "--json", str(tmp_path / "x.json")])
    assert "printed only" in str(refused.exception)
    for role in ("operator", "analyst"):
        study.record("unblind", role=role, reason="the analysis is fixed")
    open_ = CliRunner().invoke(app, words).output
    names = veiled_names(study)

    def median(text: str, name: str) -> str:
        line = next(x for x in text.splitlines() if x.startswith("  ") and f"{name} " in x)
        return line.partition(f"{name} ")[2].split()[0].strip(",;")

    for element in ("spring", "elastomer"):
        assert median(open_, element) == median(done.output, names[element])
    assert "Table 6.3, spring and elastomer" in open_
    # Settings of the reader outlive the next session.
    sealed = study.path / PRIVATE / MANIFEST
    sealed.write_text(f'survey = "s\u00fc.csv"\n{sealed.read_text()}', encoding="utf-8")
    write_manifest(study.path, 6.0)
    found = read_manifest(study.path)
    assert (found.survey, found.last_s) == ("s\u00fc.csv", 5.0)


def test_blinding_is_of_a_study(tmp_path):
    done = CliRunner().invoke(app, ["analyse", "interaction", str(tmp_path), "--blinded"])
    assert "--blinded needs a study's folder" in str(done.exception)


@pytest.mark.parametrize("roles", ['["analyst"]', '["operator"]', '["participant"]'])
def test_whose_blinding_hides_the_conditions(tmp_path, roles):
    text = wrist_protocol(1).text.replace('blinded = ["participant"]', f"blinded = {roles}")
    study = studied(tmp_path / "s", parse_protocol(text, "p"), "wrist.catch", caught)
    assert analyse(study.path).blinded is (roles != '["participant"]')
    assert analyse(study.path, blinded=True).blinded
