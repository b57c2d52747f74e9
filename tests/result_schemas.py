"""Published JSON schemas of all results, and how they were generated.

To draw them up again after a result has changed, run the tests that write it with the samples kept,
then this module; look at what it wrote before it is committed.

    ESEA_RESULT_SAMPLES=/tmp/samples pytest tests/studies/test_tune.py ...
    python -m tests.result_schemas /tmp/samples
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from esea_gen.files import SCHEMA_VERSION, result_schema

HEAD = ("schema", "schema_version", "tool_version")
DEPTH = 4  # deeper down only the type is held
SURE = 3  # so many objects of the same keys are of one form


@cache
def validator(name: str) -> Draft202012Validator:
    return Draft202012Validator(json.loads(result_schema(name)))


def held(name: str, content: Mapping[str, Any]) -> None:
    """A result as it is written against its schema; or kept as a sample of it."""
    plain = json.loads(json.dumps(content))
    samples = os.environ.get("ESEA_RESULT_SAMPLES")
    if samples:
        folder = Path(samples) / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{os.getpid()}-{len(list(folder.iterdir()))}.json").write_text(json.dumps(plain))
        return
    validator(name).validate(plain)


def kind_of(value: Any) -> str:
    for kind, types in (("boolean", bool), ("integer", int), ("number", float), ("string", str)):
        if isinstance(value, types):
            return kind
    return "null" if value is None else "array" if isinstance(value, list) else "object"


def drawn_up(values: Sequence[Any], depth: int = DEPTH) -> dict[str, Any]:
    """The schema of values that were seen in one place."""
    kinds = {kind_of(v) for v in values} - {"null"}
    if "number" in kinds:
        kinds.discard("integer")
    if not kinds:
        return {}
    # What a run did not give is null.
    schema: dict[str, Any] = {"type": [*sorted(kinds), "null"]}
    lists = [v for v in values if isinstance(v, list)]
    dicts = [v for v in values if isinstance(v, dict)]
    if depth and any(lists):
        schema["items"] = drawn_up([x for v in lists for x in v], depth - 1)
    if depth and any(dicts):
        schema |= _object(dicts, depth)
    return schema


def _object(dicts: Sequence[dict[str, Any]], depth: int) -> dict[str, Any]:
    keys = list(dict.fromkeys(k for d in dicts for k in d))
    always = [k for k in keys if all(k in d for d in dicts)]
    inside = [v for d in dicts for v in d.values()]
    alike = len({kind_of(v).replace("integer", "number") for v in inside}) == 1
    # Keys that are names, of Blocks or tasks, have values of one kind and are not always the same.
    same = len(dicts) >= SURE and len(always) == len(keys)
    if alike and depth < DEPTH and not same:
        return {"additionalProperties": drawn_up(inside, depth - 1)}
    properties = {k: drawn_up([d[k] for d in dicts if k in d], depth - 1) for k in keys}
    # What was seen seldom need not be there.
    return {"properties": properties, "required": always if len(dicts) >= SURE else []}


def result(name: str, samples: Sequence[dict[str, Any]]) -> str:
    """The schema of a result, from samples of it."""
    program, words = ("esea-host", name[5:]) if name.startswith("host-") else ("esea-gen", name)
    schema = drawn_up(samples) | {"type": "object"}
    schema["required"] = list(dict.fromkeys([*HEAD, *schema["required"]]))
    given = {"const": name}, {"const": SCHEMA_VERSION}, {"type": "string"}
    schema["properties"] |= dict(zip(HEAD, given, strict=True))
    head = {
        "$schema": Draft202012Validator.META_SCHEMA["$id"],
        "$id": f"{name}-{SCHEMA_VERSION}",
        "title": f"{program}: {words.replace('-', ' ')}",
    }
    return written(head | schema)


def written(schema: dict[str, Any]) -> str:
    """A key a line, and below `properties` a property a line."""
    properties = [f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in schema["properties"].items()]
    inner = ",\n".join(properties)
    lines = [
        f" {json.dumps(k)}: " + (f"{{\n{inner}\n }}" if k == "properties" else json.dumps(v))
        for k, v in schema.items()
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    out = Path(__file__).parents[1] / "esea_gen" / "schemas"
    for folder in sorted(Path(sys.argv[1]).iterdir()):
        seen = [json.loads(p.read_text()) for p in sorted(folder.glob("*.json"))]
        (out / f"{folder.name}.json").write_text(result(folder.name, seen))
        print(f"{folder.name}: {len(seen)} samples")
