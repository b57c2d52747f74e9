"""Number formats, one module each: printing of kernels, conversion of values, support files."""

from __future__ import annotations

from esea_gen.emit.formats import f32, f64, q31
from esea_gen.emit.formats.base import Format

FORMATS: dict[str, Format] = {m.FORMAT.name: m.FORMAT for m in (f64, f32, q31)}
DEFAULT_FORMATS = tuple(name for name, fmt in FORMATS.items() if fmt.default)
FLOATING_FORMATS = tuple(name for name, fmt in FORMATS.items() if fmt.floating)

__all__ = ["DEFAULT_FORMATS", "FLOATING_FORMATS", "FORMATS", "Format"]
