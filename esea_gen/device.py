"""Devices: the numbers of a device file, and the Blocks and System built from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakValueDictionary

from esea_gen.control.law import Law
from esea_gen.control.laws import LAWS, find_law
from esea_gen.control.system import control_system
from esea_gen.devices.fields import LAW_SECTIONS, MOST_LAWS, DeviceFile
from esea_gen.devices.file import (
    DeviceData,
    controller_document,
    copied_file,
    parse_file,
    read_file,
    shipped_controllers,
    shipped_devices,
)
from esea_gen.devices.numbers import Quantity
from esea_gen.errors import UserError, choose
from esea_gen.language.block import Block
from esea_gen.language.system import System
from esea_gen.model.filters import tracking_observer
from esea_gen.model.rubber import rubber_inverse, rubber_sensor
from esea_gen.model.sensing import counting_system, measures_counts, sensing_system
from esea_gen.observe import Drive, drive_of, has_drive

Made = TypeVar("Made")
Data = TypeVar("Data", bound=DeviceData)
_FIRST: WeakValueDictionary[tuple[object, ...], Device] = WeakValueDictionary()


def _made_once(make: Callable[[Device], Made]) -> Callable[[Device], Made]:
    """Shared results of devices with equal content, because a System takes long to build.

    It is made by the first of them that is still alive.
    """

    @wraps(make)
    def of(device: Device) -> Made:
        key = device.digest, device.origin, device.laws
        first = _FIRST.setdefault(key, device)
        return make(device) if first is device else getattr(first, make.__name__)

    return of


class Device(DeviceData):
    """A validated device: its numbers, and the Blocks and System built from them.

    Parameters
    ----------
    file : DeviceFile
        The validated content.
    origin : str
        Name of the file it was read from, for messages.
    laws : tuple of Law, optional
        In place of those that the file asks for.
    controller : str
        What was asked for in place of the file's laws, as the command line takes it.
    """

    def __init__(
        self,
        file: DeviceFile,
        origin: str,
        laws: tuple[Law, ...] | None = None,
        controller: str = "",
    ) -> None:
        super().__init__(file, origin)
        self._laws = laws
        self.controller = controller
        self.given = origin, controller  # as it was asked for: name or path, controller
        self.law_files: Mapping[str, bytes] = {}  # laws that came along, by their names in the file

    def __repr__(self) -> str:
        kind = "drive" if has_drive(self) else "sensor"
        return f"<Device {self.name} ({kind}), {self.title}, from {self.origin}>"

    @cached_property
    @_made_once
    def sensor(self) -> Block:
        """The torque sensor Block (spec section 3)."""
        return rubber_sensor(self)

    @cached_property
    @_made_once
    def velocity(self) -> Block:
        """The velocity estimate Block."""
        return tracking_observer(self)

    @cached_property
    @_made_once
    def inverse(self) -> Block:
        """The inverse that the section ``[inverse]`` asks for; exact where there is none."""
        return rubber_inverse(self)

    @cached_property
    def drive(self) -> Drive | None:
        """Numbers of its drive; None for a device that only measures."""
        return drive_of(self) if has_drive(self) else None

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The control laws of its System, the first one in force after the start."""
        if self._laws is not None or self.drive is None:
            return self._laws or ()
        asked = self.file.laws or [n for n in reversed(LAW_SECTIONS) if getattr(self.file, n)][:1]
        # Relative to the file that asks for them.
        folder = Path(self.given[0]).parent
        kept = self.law_files
        return tuple(_law(n, self.origin, folder, kept.get(n.rpartition(":")[0])) for n in asked)

    def own_laws(self) -> dict[str, bytes]:
        """The files of its laws from outside the package, by their names in the device file."""
        named = zip(self.file.laws, self.laws, strict=False)
        return {n.rpartition(":")[0]: law.content for n, law in named if law.path}

    @cached_property
    @_made_once
    def system(self) -> System:
        """All Blocks, wired into tasks: with a law torque control, else sensing."""
        if self.drive is not None and not self.laws:
            raise UserError(
                f"{self.origin}: the device has a drive but no control law.",
                "Add [sliding_mode] or [predictive], or give --controller.",
            )
        if not self.laws:
            if self.file.impairment:
                raise UserError(
                    f"{self.origin}: [impairment] requires torque, but the device has no drive.",
                    "Add a drive, as in wrist_drive.toml, or remove [impairment].",
                )
            make = counting_system if measures_counts(self) else sensing_system
            return make(self, self.velocity, self.sensor)
        return control_system(self, self.laws, self.velocity, self.sensor, lambda: self.inverse)


def load_device(name_or_path: str | Path, controller: str | None = None) -> Device:
    """Read and validate a device file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped device (``elbow``), path of a TOML file, or either behind a controller:
        ``smc@elbow_drive``.
    controller : str, optional
        In place of the file's laws: a shipped controller (``mpc``), a law (``predictive``), a law
        from outside the package (``FILE.py:law``) or the path of a device file whose sections are
        taken; several with a comma between, to switch between them at run time.
    """
    law, at, base = str(name_or_path).rpartition("@")
    if at and controller is None and not Path(name_or_path).is_file():
        return load_device(base, law)
    text, origin = read_file(name_or_path)
    device = _device(text, origin, controller)
    device.given = str(name_or_path), controller or ""
    return device


def board_device(device: Device | str | Path) -> Device:
    """The device that a board runs: of a shipped one without encoders its ``<name>_board``.

    Parameters
    ----------
    device : Device, str or Path
        A device, or its name or file.
    """
    loaded = device if isinstance(device, Device) else load_device(device)
    passive = loaded.drive is None
    if not passive or measures_counts(loaded):
        return loaded
    name = f"{loaded.name}_board"
    if name in shipped_devices() and loaded.digest == load_device(loaded.name).digest:
        return _shipped_board(name)
    raise UserError(
        f"{loaded.origin}: a board needs encoders, but the device has none.",
        "Add [encoder.motor], [encoder.load] and [joint], as in knee_board.toml.",
    )


@lru_cache(maxsize=4)
def _shipped_board(name: str) -> Device:
    return load_device(name)


def _device(text: str, origin: str, controller: str | None) -> Device:
    if controller is None:
        return parse_device(text, origin)
    names = [n.strip() for n in controller.split(",")]
    if len(set(names)) != len(names):
        raise UserError(f"--controller {controller}: names one twice.", "Give each once.")
    for name in names:
        if name.endswith(".py"):
            raise UserError(f"{name}: the law is not named.", f"Add its name: {name}:LAW.")
        if not name.endswith(".toml") and ".py:" not in name:
            choose("controller", name, controllers(), ", or give FILE.toml or FILE.py:law")
    files = [n for n in names if n in shipped_controllers() or n.endswith(".toml")]
    own = any(".py:" in str(n) for f in files for n in controller_document(f).get("laws", []))
    if len(files) == len(names) and not own:
        device = Device(parse_file(text, origin, files), origin, controller=controller)
    else:
        laws: dict[str, Law] = {}
        for name in names:
            if name in files:
                own_laws = controller_document(name).get("laws", [])
                laws |= {str(n): _law(n, name, Path(name).parent) for n in own_laws}
            else:
                laws[Path(name).name] = find_law(name)
        if len(laws) > MOST_LAWS:
            raise UserError(f"{len(laws)} laws, above the limit of {MOST_LAWS}.", "Give fewer.")
        # As if the file named them, so that it can be read again beside them.
        file = parse_file(text, origin, files).model_copy(update={"laws": tuple(laws)})
        device = Device(file, origin, tuple(laws.values()), ",".join(Path(n).name for n in names))
    if device.drive is None:
        raise UserError(
            f"{origin}: the device has no drive that a controller could move.",
            'Write extends = "elbow_drive" in it.',
        )
    return device


def controllers() -> list[str]:
    """Names that a controller may have without a file: configurations, then laws."""
    return [*sorted(shipped_controllers()), *(n for n in LAWS if n not in shipped_controllers())]


def _law(law: object, file: str, folder: Path, content: bytes | None = None) -> Law:
    if ".py:" not in str(law):
        choose(f"law in {file}:", str(law), LAWS, ", or write FILE.py:law")
    return find_law(str(law), folder, content)


def parse_device(text: str, origin: str) -> Device:
    """Validate the text of a device file.

    Parameters
    ----------
    text : str
        TOML.
    origin : str
        File name for messages.
    """
    return Device(parse_file(text, origin), origin)


def with_numbers(device: Data, values: Mapping[str, float | Quantity]) -> Data:
    """A device with other numbers, which are not validated again.

    Parameters
    ----------
    device : Device
        Whose other numbers.
    values : mapping
        Number by its place in the file: ``{"timing.sense_rate_Hz": 500.0}``; its status and source
        stay, but for those of a Quantity.
    """

    def changed(section: Any, place: list[str], value: float | Quantity) -> Any:
        key, *rest = place
        new, held = value, getattr(section, key)
        if rest:
            new = changed(held, rest, value)
        elif not isinstance(value, Quantity):
            new = held.model_copy(update={"value": value})
        return section.model_copy(update={key: new})

    file = device.file
    for place, value in values.items():
        file = changed(file, place.split("."), value)
    return type(device)(file, device.origin)


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
    """
    return Device(copied_file(base, name), f"{name}.toml")
