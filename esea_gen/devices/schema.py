"""JSON schema of the device file, for editors."""

from __future__ import annotations

from functools import cache
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from esea_gen.devices.fields import DeviceFile, models_of
from esea_gen.devices.file import TORQUE_MODELS, shipped_controllers, shipped_devices
from esea_gen.devices.numbers import Quantity, Section, Series
from esea_gen.language.ports import unit_of

LEFT_OUT = ("title", "default")  # of what pydantic says of a key


def json_schema() -> dict[str, Any]:
    content = _schema_of(DeviceFile)
    content["properties"] = {
        "extends": {
            "type": "string",
            "enum": sorted(shipped_devices()),
            "description": "Shipped device whose numbers hold where this file gives none.",
        },
        "controller": {
            "type": "string",
            "enum": sorted(shipped_controllers()),
            "description": "Shipped controller whose laws and sections hold where this file gives "
            "none.",
        },
    } | content["properties"]
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Device file of esea-gen",
        **content,
        "anyOf": [
            {"required": ["extends"]},
            _required_of(DeviceFile) | {"oneOf": [{"required": [k]} for k in TORQUE_MODELS]},
        ],
    }


def _required_of(model: type[BaseModel]) -> dict[str, Any]:
    # What a file that extends none must have, apart from the properties: else each would stand
    # twice, once for files that extend one.
    keys = {f.alias or name: f for name, f in model.model_fields.items()}
    below = {
        key: _required_of(section)
        for key, f in keys.items()
        if (section := _section_of(f.annotation)) is not None and not _is_row(f.annotation)
    }
    content: dict[str, Any] = {"required": [k for k, f in keys.items() if f.is_required()]}
    inner = {k: v for k, v in below.items() if v["required"] or "properties" in v}
    return content | ({"properties": inner} if inner else {})


def _section_of(annotation: Any) -> type[BaseModel] | None:
    return next((m for m in models_of(annotation) if issubclass(m, Section)), None)


def _is_row(annotation: Any) -> bool:
    return get_origin(annotation) is tuple


@cache
def _plain_keys(model: type[BaseModel]) -> dict[str, Any]:
    # As pydantic describes them, all in one go: to be asked for one of them takes as long.
    found: dict[str, Any] = model.model_json_schema(by_alias=True)["properties"]
    return found


def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    properties = {}
    for name, f in model.model_fields.items():
        key = f.alias or name
        section = _section_of(f.annotation)
        if Series in models_of(f.annotation):
            about = _series_schema(key, f.json_schema_extra)
        elif section is not None and _is_row(f.annotation):
            needed = [k for k, inner in section.model_fields.items() if inner.is_required()]
            about = {"type": "array", "items": _schema_of(section) | {"required": needed}}
        elif section is not None:
            about = _schema_of(section)
        elif Quantity in models_of(f.annotation):
            about = _quantity_schema(key, f.json_schema_extra)
        else:
            about = {k: v for k, v in _plain_keys(model)[key].items() if k not in LEFT_OUT}
        properties[key] = about | ({"description": f.description} if f.description else {})
    return {
        "type": "object",
        "description": " ".join((model.__doc__ or "").split()),
        "properties": properties,
        "additionalProperties": False,
    }


def _quantity_schema(key: str, extra: Any) -> dict[str, Any]:
    fields = Quantity.model_fields
    unit = unit_of(key)
    return {
        "type": "object",
        "properties": {
            "value": {
                "type": "integer" if extra["whole"] else "number",
                "minimum": extra["low"],
                "maximum": extra["high"],
                "description": "The number, "
                + ("dimensionless." if unit == "1" else f"in {unit}."),
            },
            "status": {
                "enum": list(get_args(fields["status"].annotation)),
                "description": fields["status"].description,
            },
            "source": {
                "type": "string",
                "minLength": 1,
                "description": fields["source"].description,
            },
        },
        "required": list(fields),
        "additionalProperties": False,
    }


def _series_schema(key: str, extra: Any) -> dict[str, Any]:
    about = _quantity_schema(key, extra)
    number = about["properties"].pop("value")
    row = {
        "type": "array",
        "items": {k: number[k] for k in ("type", "minimum", "maximum")},
        "minItems": min(extra["sizes"]),
        "maxItems": max(extra["sizes"]),
        "description": number["description"].replace("The number", "The numbers"),
    }
    return about | {
        "properties": {"values": row} | about["properties"],
        "required": list(Series.model_fields),
    }
