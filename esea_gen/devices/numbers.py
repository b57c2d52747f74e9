"""Numbers with provenance, the elements of a device file's sections."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from esea_gen.errors import UserError
from esea_gen.language.ports import Constant, Tunable


class Quantity(BaseModel):
    """A number with its provenance."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    value: float = Field(description="The number, in the unit that the key's suffix names.")
    status: Literal["published", "identified", "assumed"] = Field(
        description="published: printed in the source; identified: fitted to a recording; "
        "assumed: a choice, shown as such in every report."
    )
    source: str = Field(min_length=1, description="Table, recording, or reason for the choice.")

    def constant(self, name: str) -> Constant:
        return Constant(name, self.value, self.source, self.status)

    def tunable(
        self,
        name: str,
        low: float,
        high: float,
        meaning: str,
        safer: Literal["", "low", "high"] = "",
    ) -> Tunable:
        """Tunable that has it as its default."""
        return Tunable(name, self.value, low, high, meaning, self.source, self.status, safer)


class Series(BaseModel):
    """A row of numbers with its provenance."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    # Strict, but for the container: TOML and JSON have lists only.
    values: Annotated[tuple[float, ...], Field(strict=False)] = Field(
        description="The numbers, in the unit that the key's suffix names."
    )
    status: Literal["published", "identified", "assumed"] = Field(
        description=Quantity.model_fields["status"].description
    )
    source: str = Field(min_length=1, description="Table, recording, or reason for the choice.")


def number(low: float, high: float, text: str, *, whole: bool = False, **more: Any) -> Any:
    extra: Any = {"low": low, "high": high, "whole": whole}
    return Field(description=text, json_schema_extra=extra, **more)


def optional(low: float, high: float, text: str, *, whole: bool = False) -> Any:
    return number(low, high, text, whole=whole, default=None)


def table(text: str) -> Any:
    return Field(default=None, description=text)


def series(low: float, high: float, sizes: tuple[int, ...], text: str) -> Any:
    extra: Any = {"low": low, "high": high, "whole": False, "sizes": list(sizes)}
    return Field(default=None, description=text, json_schema_extra=extra)


class Section(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def toml_entry(key: str, number: Quantity | Series, *, whole: bool = False) -> str:
    if isinstance(number, Series):
        content = f"values = {[float(v) for v in number.values]!r}"
    else:
        content = f"value = {int(number.value) if whole else number.value!r}"
    return (
        f"{key} = {{ {content}, status = {json.dumps(number.status)}, "
        f"source = {json.dumps(number.source, ensure_ascii=False)} }}"
    )


S = TypeVar("S", bound=Section)
Facts = dict[str, Any]  # of a number: low, high, whole and text; sizes of a row


def numbers_of(
    section: BaseModel, prefix: str = ""
) -> Iterator[tuple[str, Quantity | Series, Facts]]:
    """Every number of a section and of those below it: dotted key, number, facts."""
    for key, field in type(section).model_fields.items():
        value = getattr(section, key)
        if isinstance(value, Quantity | Series):
            extra: Any = field.json_schema_extra
            yield prefix + key, value, {**extra, "text": field.description}
        # The elements of a row are numbered from 0, as in messages.
        row = isinstance(value, tuple | list)
        parts = {f"{key}[{i}]": v for i, v in enumerate(value)} if row else {key: value}
        for name, part in parts.items():
            if isinstance(part, BaseModel) and not isinstance(part, Quantity | Series):
                yield from numbers_of(part, f"{prefix}{name}.")


def changed(section: S, change: Callable[[Quantity | Series], Quantity | Series]) -> S:
    """A section with every number changed, those below it too."""

    def of(value: Any) -> Any:
        if isinstance(value, Quantity | Series):
            return change(value)
        if isinstance(value, Section):
            return changed(value, change)
        return tuple(map(of, value)) if isinstance(value, tuple) else value

    return section.model_copy(
        update={k: of(getattr(section, k)) for k in type(section).model_fields}
    )


def beyond(key: str, value: float, facts: Facts, unit: str = "") -> UserError | None:
    """The error for a number outside its bounds."""
    low, high = facts["low"], facts["high"]
    if low <= value <= high:
        return None
    side, limit = ("below", low) if value < low else ("above", high)
    return UserError(
        f"{key} = {value:g}{unit} is {side} its limit {limit:g}{unit} ({facts['text']})",
        f"Give a value from {low:g} to {high:g}{unit}.",
    )
