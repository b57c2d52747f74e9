"""Every result as JSON: one head, a schema that is published, and one helper that writes it."""

from __future__ import annotations

import ast
import json
import re
from itertools import chain

import jsonschema
import pytest
from typer.testing import CliRunner

from esea_gen import __version__
from esea_gen.cli import app
from esea_gen.cli.app import stopped
from esea_gen.cli.names import reproductions
from esea_gen.errors import UserError
from esea_gen.files import SCHEMA_VERSION, result_schema, result_schemas, stamped, write_json
from tests import result_schemas as drawn
from tests.conftest import ROOT
from tests.typed import command

SOURCES = sorted(chain((ROOT / "esea_gen").rglob("*.py"), (ROOT / "host").rglob("*.py")))


def named_in_the_sources() -> set[str]:
    """Second argument of ``write_json`` and third of ``show``, wherever they are called."""
    found: set[str] = set()
    for path in SOURCES:
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if re.search(r"\b(write_json|show)\(", text) else ():
            place = {"write_json": 1, "show": 2}.get(getattr(getattr(node, "func", None), "id", ""))
            if place is None or len(node.args) <= place:
                continue
            what = node.args[place]
            if isinstance(what, ast.Constant):
                found.add(what.value)
            elif isinstance(what, ast.JoinedStr):
                found |= {f"reproduce-{w.name}" for w in reproductions() if w.name != "all"}
    return found


def test_every_result_has_a_published_schema_and_every_schema_a_result():
    assert named_in_the_sources() == set(result_schemas())
    for name in result_schemas():
        schema = json.loads(result_schema(name))
        jsonschema.Draft202012Validator.check_schema(schema)
        assert set(drawn.HEAD) <= set(schema["required"])
        assert schema["properties"]["schema"] == {"const": name}
        assert schema["properties"]["schema_version"] == {"const": SCHEMA_VERSION}


def test_no_other_way_to_write_a_result():
    for path in SOURCES:
        assert not re.search(r"json(_file)?\.write_text", path.read_text()), path


def test_the_head_says_schema_and_versions(tmp_path):
    write_json(tmp_path / "a.json", "host-parameters", {"parameters": {"smc.lambda_1_s": 9.0}})
    assert json.loads((tmp_path / "a.json").read_text()) == {
        "schema": "host-parameters",
        "schema_version": 1,
        "tool_version": __version__,
        "parameters": {"smc.lambda_1_s": 9.0},
    }
    with pytest.raises(ValueError, match="has schema itself"):
        stamped("tune", {"schema": 1})


def test_a_result_that_left_its_schema_is_found(tmp_path):
    """Armed: what every test's output is held to refuses a wrong type, a missing key, no schema."""
    good = {"parameters": {"smc.lambda_1_s": 9.0}}
    for wrong in ({"parameters": {"smc.lambda_1_s": "9"}}, {"parameters": 9}):
        with pytest.raises(jsonschema.ValidationError):
            write_json(tmp_path / "a.json", "host-parameters", wrong)
    gates = {"targets": {"host": {"passed": "yes"}}}
    with pytest.raises(jsonschema.ValidationError):
        write_json(tmp_path / "a.json", "gates", gates)
    with pytest.raises(UserError, match="Did you mean host-parameters"):
        write_json(tmp_path / "a.json", "host-parameter", good)
    assert not (tmp_path / "a.json").exists()


def test_the_schema_command_prints_them(tmp_path):
    assert json.loads(CliRunner().invoke(app, ["schema", "tune"]).output)["$id"] == "tune-1"
    assert "tune" in CliRunner().invoke(app, ["schema", "--list"]).output.split()
    assert json.loads(CliRunner().invoke(app, ["schema"]).output)["title"] != "tune"


def test_ctrl_c_says_how_to_go_on(monkeypatch):
    for words, resumable, wanted in (
        (
            ["simulate", "tuning", "--resume", "a b"],
            "DIR",
            "esea-gen simulate tuning --resume 'a b'",
        ),
        (["simulate", "tuning", "--resume=j"], "DIR", "is stored"),
        (["simulate", "tuning"], "DIR", "esea-gen simulate tuning --resume DIR"),
        (["identify", "hdrb"], "FILE", "esea-gen identify hdrb --resume FILE"),
        (["torque-check", "elbow"], "JSON", "Start again with"),
        (["verify", "elbow"], None, "Start again with:\n  esea-gen verify elbow"),
    ):
        assert wanted in stopped(words, resumable)

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("esea_gen.verify.faults.campaign.fault_campaign", interrupted)
    code, _, said = command("faults", "elbow_drive")
    assert code == 130
    assert "esea-gen faults elbow_drive --resume DIR" in said
