"""Device files of tests: a shipped device with other numbers."""

from __future__ import annotations

from collections.abc import Mapping

from esea_gen.device import Device, parse_device


def q(value: object) -> str:
    """A value as a device file has it: a word, or a number with its status."""
    if isinstance(value, str):
        return f'"{value}"'
    return f'{{ value = {value}, status = "assumed", source = "a test" }}'


def own_text(
    text: str = "", base: str = "elbow_drive", name: str = "mine", **sections: Mapping[str, object]
) -> str:
    """What follows the head of the file, and sections, ``joint={"Jh_kgm2": 0.2}``."""
    for section, values in sections.items():
        text += f"[{section}]\n" + "".join(f"{k} = {q(v)}\n" for k, v in values.items())
    return f'schema = 1\nextends = "{base}"\nname = "{name}"\ntitle = "{name}"\n{text}'


def own_device(
    text: str = "", base: str = "elbow_drive", name: str = "mine", **sections: Mapping[str, object]
) -> Device:
    return parse_device(own_text(text, base, name, **sections), f"{name}.toml")
