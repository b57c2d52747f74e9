"""Made recordings of a test rig, and mapping files beside them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify import load_mapping, load_recordings

MAPPING = """\
schema = 1
[device]
name = "rig"
title = "Rig"
rate_terms = false
[deflection]
column = "x"
unit = "rad"
[torque]
column = "y"
unit = "Nm"
[sampling]
time_column = "t"
[[recording]]
files = ["rig.csv"]
"""
PER = 200  # samples a cycle, of 2 s


def changed(*changes: tuple[str, str], text: str = MAPPING) -> str:
    """A mapping file's text with other words in it."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def table(t: Iterable[float], x: Iterable[float], y: Iterable[float]) -> str:
    rows = [f"{a:.12g},{b:.12g},{c:.12g}" for a, b, c in zip(t, x, y, strict=True)]
    return "\n".join(["t,x,y", *rows]) + "\n"


def mapped(folder: Path, *changes: tuple[str, str], text: str = MAPPING) -> Path:
    (folder / "map.toml").write_text(changed(*changes, text=text))
    return folder / "map.toml"


def written(folder: Path, t: object, x: object, y: object, *changes: tuple[str, str]) -> Path:
    """Mapping file beside ``rig.csv``."""
    (folder / "rig.csv").write_text(table(t, x, y))
    return mapped(folder, *changes)


def refused(path: Path) -> str:
    """What is said of recordings that are not read."""
    with pytest.raises(UserError) as caught:
        load_recordings(load_mapping(path))
    assert caught.value.fix
    return str(caught.value)


def says(error: UserError, *parts: str) -> None:
    text = str(error)
    assert "\n" not in text
    assert error.fix
    for part in parts:
        assert part in text, f"'{part}' is not in: {text}"


def play(x: np.ndarray, r: float) -> np.ndarray:
    out, state = [], 0.0
    for value in x:
        state = min(max(state, value - r), value + r)
        out.append(state)
    return np.array(out)


def rig(*amplitudes: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, deflection and torque of springs and two stops; by default eight equal cycles."""
    sizes = np.repeat(amplitudes or (0.1,) * 8, PER)
    x = np.append(sizes * np.sin(2 * np.pi * np.arange(len(sizes)) / PER), 0.0)
    t = np.arange(len(x)) * 2 / PER
    y = 20 * x + 500 * x**3 + 8 * (x - play(x, 0.01)) + 5 * (x - play(x, 0.04))
    return t, x, y + np.random.default_rng(4).normal(0, 0.002, len(y))
