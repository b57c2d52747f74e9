"""Device files: what firmware is built for.

A device file is TOML.  Every number in it is a small table with the value, a status (``published``,
``identified`` or ``assumed``) and the source; its unit is the key's suffix.  Reading one checks
every key, unit, bound and relation, and says in one paragraph what is wrong.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import re
from collections.abc import Iterator
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import tomlkit
import tomlkit.exceptions
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError

from esea_gen.block import UNIT_SUFFIXES, Constant, f32_inside, unit_of
from esea_gen.errors import UserError

if TYPE_CHECKING:
    from esea_gen.block import Block
    from esea_gen.system import System

SCHEMA = 1
SCHEMA_FILE = "esea-gen.schema.json"
NAME_PATTERN = r"^[a-z][a-z0-9_]{0,14}$"
AXIS_PATTERN = r"^[a-z]{1,12}$"  # letters only: a digit or underscore could read as part of a unit
MOST_AXES = 6  # their torques, rates and status words fit one telemetry frame
MAX_DEAD_ZONE_RAD = math.radians(6)
FORMATS = ("f64", "f32")


class Quantity(BaseModel):
    """A number with its provenance."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    value: float = Field(description="The number, in the unit that the key's suffix names.")
    status: Literal["published", "identified", "assumed"] = Field(
        description="published: printed in the source; identified: fitted to a recording; "
        "assumed: a choice, shown as such in every report."
    )
    source: str = Field(min_length=1, description="Table, recording, or reason for the choice.")


def _number(low: float, high: float, text: str, *, whole: bool = False, **more: Any) -> Any:
    extra: Any = {"low": low, "high": high, "whole": whole}
    return Field(description=text, json_schema_extra=extra, **more)


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Maxwell(_Section):
    """Rate terms: one Maxwell element whose viscosity depends on deflection and rate."""

    kv_Nm_rad: Quantity = _number(0, 1000, "Stiffness kv of the Maxwell element, eq. 3.3.")
    A_Nms_rad: Quantity = _number(0, 1000, "Deflection gain A of the viscosity, eq. 3.4.")
    m: Quantity = _number(0, 4, "Deflection exponent m of the viscosity, eq. 3.4.")
    eps1_Nms_rad: Quantity = _number(1e-6, 1, "Viscosity offset eps1 at zero deflection, eq. 3.4.")
    B: Quantity = _number(0, 1000, "Rate gain B of the viscosity, eq. 3.4.")
    n: Quantity = _number(0, 1, "Rate exponent n of the viscosity, eq. 3.4.")
    eps2: Quantity = _number(1e-6, 12, "Viscosity offset eps2 at zero rate, eq. 3.4.")


class Elastomer(_Section):
    """Torque model of the rubber coupling, equations 3.1 to 3.11."""

    k1_Nm_rad: Quantity = _number(0, 1000, "Linear stiffness k1, eq. 3.2.")
    k3_Nm_rad3: Quantity = _number(0, 2500, "Cubic stiffness k3, eq. 3.2.")
    alpha_Nm_rad: Quantity = _number(0, 1000, "Stop weight alpha, eq. 3.10.")
    beta_1_rad: Quantity = _number(0, 1000, "Decay beta of the stop weight, eq. 3.10.")
    omega_rad: Quantity = _number(1e-6, 0.1, "Spacing omega of the stop thresholds, eq. 3.11.")
    stops: Quantity = _number(1, 32, "Number N of stop operators, eq. 3.9.", whole=True)
    dead_zone_rad: Quantity | None = _number(
        0,
        MAX_DEAD_ZONE_RAD,
        "Half-width of the dead zone, eq. 8.7/8.8; leave the key out where there is none.",
        default=None,
    )
    maxwell: Maxwell | None = Field(
        default=None, description="Rate terms; leave the table out where they are not identified."
    )


class Domain(_Section):
    """Where the parameters were identified; outside it the firmware says so and goes on."""

    theta_max_rad: Quantity = _number(1e-3, 3.2, "Largest identified |deflection|.")
    omega_max_rad_s: Quantity = _number(1e-3, 100, "Largest identified |deflection rate|.")
    tau_full_scale_Nm: Quantity = _number(1e-3, 1000, "Full scale for errors in % of full scale.")


class Limits(_Section):
    """Physical ranges of the ports; a value outside is an invalid input."""

    theta_rad: Quantity = _number(1e-3, 3.2, "Largest plausible |deflection|.")
    omega_rad_s: Quantity = _number(1e-2, 1000, "Largest plausible |deflection rate|.")
    tau_Nm: Quantity = _number(1e-2, 2000, "Largest plausible |torque|.")


class Timing(_Section):
    """Task rates."""

    sense_rate_Hz: Quantity = _number(50, 10000, "Rate of the sensing task.")


class Velocity(_Section):
    """Velocity estimate shared by all that need a rate."""

    bandwidth_Hz: Quantity = _number(2, 100, "Bandwidth of the tracking observer's triple pole.")


class Encoder(_Section):
    """Encoders on either side of the coupling."""

    resolution_bits: Quantity = _number(8, 24, "Counts per turn, as a power of two.", whole=True)


class DeviceFile(_Section):
    """A device file, as written."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this format.")
    name: str = Field(pattern=NAME_PATTERN, description="Lower case C identifier, prefix of the C.")
    title: str = Field(min_length=1, description="One line for reports.")
    axes: tuple[Annotated[str, Field(pattern=AXIS_PATTERN)], ...] = Field(
        default=(),
        max_length=MOST_AXES,
        description="Axes of equal couplings, each with inputs and outputs of its own, such as "
        "theta_flexion_rad; leave the key out for one axis without a name.",
    )
    elastomer: Elastomer
    domain: Domain
    limits: Limits
    timing: Timing
    velocity: Velocity
    encoder: Encoder

    _origin: str = PrivateAttr(default="<device>")


class Device:
    """A validated device: its numbers, and the Blocks and System built from them.

    Parameters
    ----------
    file : DeviceFile
        The validated content.
    origin : str
        Name of the file it was read from, for messages.
    """

    def __init__(self, file: DeviceFile, origin: str) -> None:
        self.file = file
        self.origin = origin

    @property
    def name(self) -> str:
        """Short name, prefix of the generated C."""
        return self.file.name

    @property
    def title(self) -> str:
        """One line for reports."""
        return self.file.title

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes; one empty name where there is a single axis."""
        return self.file.axes or ("",)

    @property
    def period_s(self) -> float:
        """Period of the sensing task."""
        return 1.0 / self.file.timing.sense_rate_Hz.value

    @property
    def tau_full_scale_Nm(self) -> float:
        """Torque that counts as 100 % in error figures."""
        return self.file.domain.tau_full_scale_Nm.value

    def quantities(self) -> Iterator[tuple[str, Quantity]]:
        """Every number of the file as (dotted key, quantity), in file order."""
        yield from _quantities(self.file)

    def constants(self, section: str) -> tuple[Constant, ...]:
        """The numbers of one section, as Block constants.

        Parameters
        ----------
        section : str
            Dotted name of the section, such as ``elastomer``.

        Returns
        -------
        tuple of Constant
            Sub-sections included; names without the section.
        """
        return tuple(
            Constant(key.rsplit(".", 1)[-1], q.value, q.source, q.status)
            for key, q in self.quantities()
            if key.startswith(section + ".")
        )

    def canonical(self) -> str:
        """The content as canonical JSON: what the content hash covers."""
        content = self.file.model_dump(by_alias=True, mode="json", exclude_defaults=True)
        return json.dumps(content, sort_keys=True)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of :meth:`canonical`, hexadecimal."""
        return hashlib.sha256(self.canonical().encode()).hexdigest()

    @cached_property
    def sensor(self) -> Block:
        """The torque sensor Block (spec section 3)."""
        from esea_gen.model.elastomer import torque_sensor

        return torque_sensor(self)

    @cached_property
    def velocity(self) -> Block:
        """The velocity estimate Block."""
        from esea_gen.model.filters import tracking_observer

        return tracking_observer(self)

    @cached_property
    def system(self) -> System:
        """All Blocks, wired into tasks."""
        from esea_gen.system import sensing_system

        return sensing_system(self)

    def toml(self) -> str:
        """The content as a commented TOML document."""
        return render_toml(self.file)


def _quantities(section: BaseModel, prefix: str = "") -> Iterator[tuple[str, Quantity]]:
    for key in type(section).model_fields:
        value = getattr(section, key)
        if isinstance(value, Quantity):
            yield prefix + key, value
        elif isinstance(value, BaseModel):
            yield from _quantities(value, f"{prefix}{key}.")


def _field_extra(key: str) -> dict[str, Any]:
    model: Any = DeviceFile
    *sections, last = key.split(".")
    for name in sections:
        annotation = model.model_fields[name].annotation
        model = Maxwell if name == "maxwell" else annotation
    extra = model.model_fields[last].json_schema_extra
    return {**extra, "text": model.model_fields[last].description}


def shipped_devices() -> dict[str, Path]:
    """Device files that come with the package, by name."""
    folder = resources.files("esea_gen") / "devices"
    return {Path(str(p)).stem: Path(str(p)) for p in folder.iterdir() if p.name.endswith(".toml")}


def load_device(name_or_path: str | Path) -> Device:
    """Read and validate a device file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped device (``elbow``) or path of a TOML file.

    Returns
    -------
    Device
        The validated device.

    Raises
    ------
    UserError
        When there is no such device, the file is not TOML, or a key, unit, value or relation is
        wrong; the message names file, key, value, limit and fix.
    """
    shipped = shipped_devices()
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.is_file():
        close = difflib.get_close_matches(str(name_or_path), shipped, n=1)
        hint = f"Did you mean {close[0]}? " if close else ""
        raise UserError(
            f"There is no device '{name_or_path}': it is neither a file nor a shipped device.",
            f"{hint}Shipped: {', '.join(sorted(shipped))}; or give the path of a TOML file.",
        )
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(
            f"{path.name}: cannot be read as text ({error}).", "Check the file."
        ) from error
    return parse_device(text, path.name)


def parse_device(text: str, origin: str) -> Device:
    """Validate the text of a device file.

    Parameters
    ----------
    text : str
        TOML.
    origin : str
        File name for messages.

    Returns
    -------
    Device
        The validated device.

    Raises
    ------
    UserError
        As :func:`load_device`.
    """
    try:
        document = tomlkit.parse(text).unwrap()
    except tomlkit.exceptions.TOMLKitError as error:
        raise UserError(
            f"{origin}: not valid TOML ({error}).", "Correct that line; see the shipped elbow.toml."
        ) from None
    try:
        file = DeviceFile.model_validate(document)
    except ValidationError as error:
        raise _explain(error, document, origin) from None
    for key, q in _quantities(file):
        _check_value(origin, key, q)
    _check_texts(origin, file)
    _check_relations(origin, file)
    return Device(file, origin)


def _check_value(origin: str, key: str, q: Quantity) -> None:
    extra = _field_extra(key)
    unit = unit_of(key)
    shown = "" if unit == "1" else f" {unit}"
    if not extra["low"] <= q.value <= extra["high"]:
        side, limit = (
            ("below", extra["low"]) if q.value < extra["low"] else ("above", extra["high"])
        )
        raise UserError(
            f"{origin}: {key} = {q.value:g}{shown} is {side} its limit {limit:g}{shown} "
            f"({extra['text']})",
            f"Give a value from {extra['low']:g} to {extra['high']:g}{shown}.",
        )
    if extra["whole"] and q.value != math.floor(q.value):
        raise UserError(
            f"{origin}: {key} = {q.value:g} is not a whole number.", "Give a whole one."
        )


def _check_texts(origin: str, file: DeviceFile) -> None:
    # These words stand in comments of the generated C.
    texts = [("title", file.title)]
    texts += [(f"{key}.source", q.source) for key, q in _quantities(file)]
    for key, text in texts:
        bad = next((b for b in ("*/", "/*", "\\") if b in text), None)
        if bad is None and not text.isprintable():
            bad = "a line break or other control character"
        if bad is not None:
            raise UserError(
                f"{origin}: {key} holds {bad}, which would end or break a comment of the C.",
                "Take it out.",
            )


def _check_relations(origin: str, file: DeviceFile) -> None:
    values = dict(_quantities(file))
    for inner, outer in (
        ("domain.theta_max_rad", "limits.theta_rad"),
        ("domain.omega_max_rad_s", "limits.omega_rad_s"),
        ("domain.tau_full_scale_Nm", "limits.tau_Nm"),
    ):
        if values[inner].value > values[outer].value:
            raise UserError(
                f"{origin}: {inner} = {values[inner].value:g} is above {outer} = "
                f"{values[outer].value:g}: the identified domain must lie inside the port's range.",
                f"Raise {outer} or lower {inner}.",
            )
    zone, reach = values.get("elastomer.dead_zone_rad"), values["domain.theta_max_rad"]
    if zone is not None and zone.value >= reach.value:
        raise UserError(
            f"{origin}: elastomer.dead_zone_rad = {zone.value:g} is not below "
            f"domain.theta_max_rad = {reach.value:g}: no torque in the whole domain.",
            "Narrow the dead zone or widen the domain.",
        )
    if len(set(file.axes)) != len(file.axes):
        raise UserError(
            f"{origin}: axes = {list(file.axes)} names an axis twice.", "Give each its own name."
        )
    e = file.elastomer
    if e.k1_Nm_rad.value == 0 and e.k3_Nm_rad3.value == 0 and e.alpha_Nm_rad.value == 0:
        raise UserError(
            f"{origin}: elastomer.k1_Nm_rad, k3_Nm_rad3 and alpha_Nm_rad are all 0: no torque.",
            "Give at least one stiffness.",
        )
    if file.velocity.bandwidth_Hz.value > 0.1 * file.timing.sense_rate_Hz.value:
        raise UserError(
            f"{origin}: velocity.bandwidth_Hz = {file.velocity.bandwidth_Hz.value:g} Hz is above "
            f"its limit, a tenth of timing.sense_rate_Hz ({0.1 * file.timing.sense_rate_Hz.value:g}"
            " Hz).",
            "Lower the bandwidth or raise the rate.",
        )


def _line_of(document_key: tuple[Any, ...]) -> str:
    return ".".join(str(k) for k in document_key)


def _stem(key: str) -> str:
    for suffix in sorted(UNIT_SUFFIXES, key=len, reverse=True):
        if key.endswith(suffix):
            return key.removesuffix(suffix)
    return key


def _known_keys(loc: tuple[Any, ...]) -> list[str]:
    model: Any = DeviceFile
    for name in loc:
        f = model.model_fields.get(name)
        if f is None:
            return []
        model = Maxwell if name == "maxwell" else f.annotation
        if not (isinstance(model, type) and issubclass(model, BaseModel)):
            return []
    return ["schema" if k == "schema_version" else k for k in model.model_fields]


def _explain(error: ValidationError, document: Any, origin: str) -> UserError:
    # A wrong unit suffix shows as one unknown and one missing key: tell of the unknown first.
    items = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    first = items[0]
    loc = first["loc"]
    key, more = _line_of(loc), len(items) - 1
    tail = f" ({more} more problem{'s' if more > 1 else ''} in this file.)" if more else ""
    if first["type"] == "extra_forbidden":
        name = str(loc[-1])
        known = _known_keys(loc[:-1])
        same = [k for k in known if _stem(k) == _stem(name)]
        if same:
            return UserError(
                f"{origin}: {key} has the unit suffix of '{unit_of(name)}'; this value is kept in "
                f"'{unit_of(same[0])}'.",
                f"Convert the number and name the key {same[0]}.{tail}",
            )
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"Did you mean {close[0]}? " if close else ""
        return UserError(
            f"{origin}: unknown key {key} = {first.get('input')!r}.",
            f"{hint}Known keys here: {', '.join(known)}.{tail}",
        )
    if first["type"] == "missing":
        if loc[-1] in ("value", "status", "source"):
            fix = 'Write { value = 1.0, status = "assumed", source = "why" }.'
        else:
            fix = "Add it; the shipped elbow.toml shows the form."
        return UserError(f"{origin}: key {key} is missing.", fix + tail)
    given = first.get("input")
    if loc[0] == "axes":
        return UserError(
            f"{origin}: {key} = {given!r}: {first['msg'].lower()}.",
            'Axes are written ["flexion", "deviation"]: up to '
            f"{MOST_AXES} names of 1 to 12 lower case letters.{tail}",
        )
    return UserError(
        f"{origin}: {key} = {given!r}: {first['msg'].lower()}.",
        'A number is written { value = 1.0, status = "published", source = "where from" }.' + tail,
    )


def render_toml(file: DeviceFile) -> str:
    """Write a device file with a comment for every key.

    Parameters
    ----------
    file : DeviceFile
        Content.

    Returns
    -------
    str
        TOML that :func:`parse_device` reads back to an equal content.
    """
    lines = [
        "# Device file of esea-gen.  A number is a value in the unit of its key's suffix, a status",
        "# (published, identified or assumed) and its source.  Reports show the assumed ones.",
        f"schema = {SCHEMA}",
        f"name = {json.dumps(file.name)}",
        f"title = {json.dumps(file.title, ensure_ascii=False)}",
    ]
    if file.axes:
        about = DeviceFile.model_fields["axes"].description
        lines += [f"# {about}", f"axes = {json.dumps(list(file.axes))}"]

    def section(name: str, model: BaseModel) -> None:
        lines.extend(["", f"# {(type(model).__doc__ or '').strip()}", f"[{name}]"])
        subsections = []
        for key, f in type(model).model_fields.items():
            value = getattr(model, key)
            extra: Any = f.json_schema_extra
            limits = f"Limits {extra['low']:g} to {extra['high']:g}." if extra else ""
            if value is None and extra:
                lines.append(f"# Optional, {key}: {f.description}  {limits}")
            if isinstance(value, Quantity):
                lines.append(f"# {f.description}  {limits}")
                number = int(value.value) if extra["whole"] else value.value
                lines.append(
                    f"{key} = {{ value = {number!r}, status = {json.dumps(value.status)}, "
                    f"source = {json.dumps(value.source, ensure_ascii=False)} }}"
                )
            elif isinstance(value, BaseModel):
                subsections.append((f"{name}.{key}", value))
        for sub, value in subsections:
            section(sub, value)

    for key in ("elastomer", "domain", "limits", "timing", "velocity", "encoder"):
        section(key, getattr(file, key))
    return "\n".join(lines) + "\n"


def copy_device(base: Device, name: str) -> Device:
    """A new device with the numbers of another one.

    None of them is published or identified for the new device: each becomes ``assumed``, and its
    source says where it was copied from.

    Parameters
    ----------
    base : Device
        Whose numbers.
    name : str
        Name of the new device.

    Returns
    -------
    Device
        The new device.

    Raises
    ------
    UserError
        For a name that is no lower case C identifier of 1 to 15 characters, or a shipped device's.
    """
    if not re.fullmatch(NAME_PATTERN, name):
        raise UserError(
            f"'{name}' cannot be a device's name: it becomes the prefix of the C.",
            "Give a lower case letter, then up to 14 lower case letters, digits or underscores.",
        )
    if name in shipped_devices():
        raise UserError(f"'{name}' is a shipped device.", "Give the new one another name.")

    def assumed(section: _Section) -> _Section:
        update: dict[str, Any] = {}
        for key in type(section).model_fields:
            value = getattr(section, key)
            if isinstance(value, Quantity):
                source = f"copied from {base.name}: {value.source}"
                update[key] = Quantity(value=value.value, status="assumed", source=source)
            elif isinstance(value, _Section):
                update[key] = assumed(value)
        return section.model_copy(update=update)

    title = f"{name}: new device, all numbers copied from {base.name}"
    file = assumed(base.file.model_copy(update={"name": name, "title": title}))
    assert isinstance(file, DeviceFile)
    return Device(file, f"{name}.toml")


def json_schema() -> dict[str, Any]:
    """JSON schema of the device file, for editors.

    It is written without references, so that every editor shows a key's own description and bounds.

    Returns
    -------
    dict
        The schema, draft 7, which TOML editors know.
    """
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Device file of esea-gen",
        **_schema_of(DeviceFile),
    }


def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    properties = {}
    required = []
    for name, f in model.model_fields.items():
        key = f.alias or name
        section = next((m for m in _models(f.annotation) if m is not Quantity), None)
        if section is not None:
            about = _schema_of(section)
        elif Quantity in _models(f.annotation):
            about = _quantity_schema(key, f.json_schema_extra)
        else:
            about = model.model_json_schema(by_alias=True)["properties"][key]
            about.pop("title", None)
            about.pop("default", None)
        properties[key] = about | ({"description": f.description} if f.description else {})
        if f.is_required():
            required.append(key)
    return {
        "type": "object",
        "description": " ".join((model.__doc__ or "").split()),
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _models(annotation: Any) -> list[type[BaseModel]]:
    # The models among an annotation and, for an optional one, its members.
    candidates = [annotation, *get_args(annotation)]
    return [a for a in candidates if isinstance(a, type) and issubclass(a, BaseModel)]


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


def threshold(value: float) -> float:
    """A positive threshold as the nearest float32 not above it (all formats then decide alike).

    Parameters
    ----------
    value : float
        Threshold.

    Returns
    -------
    float
        The snapped threshold.
    """
    return f32_inside(-value, value)[1]
