"""What the sections of a device file are made of: numbers with their provenance."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

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
