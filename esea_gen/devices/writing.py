"""Device files as commented TOML."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel

from esea_gen.devices.fields import SCHEMA, DeviceFile
from esea_gen.devices.numbers import Quantity, Section, Series


def render_toml(file: DeviceFile) -> str:
    lines = [
        "# Device file of esea-gen.  A number is a value in the unit of its key's suffix, a status",
        "# (published, identified or assumed) and its source.  Reports show the assumed ones.",
        f"schema = {SCHEMA}",
        f"name = {json.dumps(file.name)}",
        f"title = {json.dumps(file.title, ensure_ascii=False)}",
    ]
    for key, names in (("axes", file.axes), ("laws", file.laws)):
        if names:
            about = DeviceFile.model_fields[key].description
            lines += [f"# {about}", f"{key} = {json.dumps(list(names))}"]

    def section(name: str, model: BaseModel, first: bool = True, row: bool = False) -> None:
        # Of a row of sections the first one has the comments.
        about = [f"# {(type(model).__doc__ or '').strip()}"] if first else []
        lines.extend(["", *about, f"[[{name}]]" if row else f"[{name}]"])
        subsections = []
        for key, f in type(model).model_fields.items():
            value = getattr(model, key)
            extra: Any = f.json_schema_extra
            limits = f"Limits {extra['low']:g} to {extra['high']:g}." if extra else ""
            if value is None and extra and not row:
                lines.append(f"# Optional, {key}: {f.description}  {limits}")
            if isinstance(value, Quantity | Series):
                if isinstance(value, Series):
                    content = f"values = {[float(v) for v in value.values]!r}"
                else:
                    content = f"value = {int(value.value) if extra['whole'] else value.value!r}"
                lines.extend([f"# {f.description}  {limits}"] if first else [])
                lines.append(
                    f"{key} = {{ {content}, status = {json.dumps(value.status)}, "
                    f"source = {json.dumps(value.source, ensure_ascii=False)} }}"
                )
            elif isinstance(value, str):
                lines.extend([f"# {f.description}"] if first else [])
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
            elif isinstance(value, BaseModel):
                subsections.append((f"{name}.{key}", value, True, False))
            elif isinstance(value, tuple) and any(isinstance(v, str) for v in value):
                lines.extend([f"# {f.description}"] if first else [])
                lines.append(f"{key} = {json.dumps(list(value))}")
            elif isinstance(value, tuple):
                subsections += [(f"{name}.{key}", v, not i, True) for i, v in enumerate(value)]
        for sub in subsections:
            section(*sub)

    for key in DeviceFile.model_fields:
        value = getattr(file, key)
        if isinstance(value, Section):
            section(key, value)
    return "\n".join(lines) + "\n"
