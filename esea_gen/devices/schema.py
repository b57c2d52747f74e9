"""JSON schema of the device file, for editors."""

from __future__ import annotations

from typing import Any

from esea_gen.devices.fields import DeviceFile
from esea_gen.devices.file import TORQUE_MODELS, shipped_controllers, shipped_devices
from esea_gen.language.ports import unit_of

NUMBER = {"value", "values"}  # keys of a number or a row of them, whose table is no section


def json_schema() -> dict[str, Any]:
    content = DeviceFile.model_json_schema(by_alias=True)
    content = _inlined("", content, content.pop("$defs"))
    extends, controller = (
        {"type": "string", "enum": sorted(known), "description": f"Shipped {text} missing here."}
        for known, text in (
            (shipped_devices(), "device that supplies the numbers"),
            (shipped_controllers(), "controller that supplies the laws and sections"),
        )
    )
    needed = _required(content)
    about = "Scale the base's other numbers to those in this file."
    head = {"extends": extends, "controller": controller}
    head |= {"scaled": {"type": "boolean", "description": about}}
    content["properties"] = head | content["properties"]
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Device file of esea-gen",
        **content,
        "anyOf": [
            {"required": ["extends"]},
            needed | {"oneOf": [{"required": [k]} for k in TORQUE_MODELS]},
        ],
    }


def _inlined(key: str, about: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
    # What pydantic says of a key, with the table that it refers to in its place, and with a
    # number's bounds where JSON schemas have them.
    own = {k: v for k, v in about.items() if k not in ("anyOf", "$ref", "default", "title")}
    for kind in (about, *about.get("anyOf", ())):
        if "$ref" in kind:
            own = defs[kind["$ref"].rpartition("/")[2]] | own
    own.pop("title", None)
    if "items" in own:
        own["items"] = _inlined(key, own["items"], defs)
    if "properties" in own:
        inner = own["properties"].items()
        own["properties"] = {k: _inlined(k, v, defs) for k, v in inner}
    if "low" in own:
        low, high, whole, sizes = (own.pop(k, None) for k in ("low", "high", "whole", "sizes"))
        bounds = {"type": "integer" if whole else "number", "minimum": low, "maximum": high}
        unit = unit_of(key)
        text = "dimensionless." if unit == "1" else f"in {unit}."
        if sizes:
            row = {"items": bounds, "minItems": min(sizes), "maxItems": max(sizes)}
            number = {"type": "array", **row, "description": f"The numbers, {text}"}
            own["properties"] |= {"values": number}
        else:
            own["properties"] |= {"value": bounds | {"description": f"The number, {text}"}}
    return own


def _required(section: dict[str, Any]) -> dict[str, Any]:
    # What a file that extends none must have, taken out of the properties: else each would stand
    # twice, once for files that extend one.
    below = {
        key: _required(about)
        for key, about in section["properties"].items()
        if "properties" in about and not NUMBER & about["properties"].keys()
    }
    inner = {k: v for k, v in below.items() if v["required"] or "properties" in v}
    needed = {"required": section.pop("required", [])}
    return needed | ({"properties": inner} if inner else {})
