"""Options and arguments that several commands take."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from esea_gen.cli.names import complete_block, completing, configured, shipped
from esea_gen.errors import UserError, nearest
from esea_gen.files import sample_folder
from esea_gen.portability import path_limit
from esea_gen.targets import firmware_boards

if TYPE_CHECKING:
    from esea_gen.device import Device


def option(words: str, text: str, **more: Any) -> Any:
    """An option; words: its names, then the placeholder of its value."""
    names = [w for w in words.split() if w.startswith("-")]
    metavar = words.removeprefix(" ".join(names)).strip() or None
    return typer.Option(*names, **({"metavar": metavar} | more), help=text)


def one_of(name: str, text: str, values: Sequence[str]) -> Any:
    return option(name, text, metavar="|".join(values), autocompletion=completing(lambda: values))


DeviceArgument = Annotated[
    str,
    typer.Argument(
        metavar="DEVICE",
        help="Shipped device (elbow) or path of a device file.",
        autocompletion=completing(shipped),
    ),
]


SAMPLE = "hdrb"  # a recording of a high-damping rubber that comes along


def _mapping(path: Path) -> Path:
    # The sample by its name, where there is no such file.
    return (
        sample_folder() / SAMPLE / f"{SAMPLE}.toml"
        if str(path) == SAMPLE and not path.is_file()
        else path
    )


MappingArgument = Annotated[
    Path,
    typer.Argument(
        callback=_mapping, help=f"Mapping file of the recording; {SAMPLE}: a shipped recording."
    ),
]
RecordingOption = Annotated[
    Path | None, option("--recording MAPPING", "Mapping file of a recording to run.")
]
DataOption = Annotated[Path | None, option("--data DIR", "Folder of the recordings.")]


def writable(path: Path | None) -> Path | None:
    """An output file that can be written, tried before the run whose result it is to hold."""
    # Nothing is left behind: folders that are missing are made when there is something to write.
    if path is None:
        return None
    fix = "Give another file."
    try:
        if path.is_dir():
            raise UserError(f"{path}: is a folder.", "Name a file in it.")
        folder = path.absolute().parent
        while not folder.exists() and folder != folder.parent:
            if folder.is_symlink():
                raise UserError(f"{path}: {folder} is a broken link.", fix)
            folder = folder.parent
        longest = path_limit(folder, "PC_NAME_MAX")
        for part in path.parts:
            if len(os.fsencode(part)) > longest:
                raise UserError(f"{path}: a name has more than {longest} bytes.", fix)
        with tempfile.TemporaryFile(dir=folder):
            pass
        # Pictures are written in place, text is put in the old file's.
        if path.exists() and not os.access(path, os.W_OK):
            raise UserError(f"{path}: cannot be written (it is write-protected).", fix)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error}).", fix) from error
    return path


def folder_to_be(path: Path | None) -> Path | None:
    """An output folder, tried in the same way."""
    if path is not None:
        if path.is_file():
            raise UserError(f"{path}: is a file.", "Give a folder.")
        writable(path / "new")
    return path


for _check in (writable, folder_to_be):
    vars(_check)["writes"] = True  # never a file that the command reads: see groups


def output_file(flag: str, words: str, *endings: str) -> Any:
    """An option for a file to write, tried before the run; endings choose a picture's format."""

    def writable_file(file: Path | None) -> Path | None:
        if endings and file is not None and file.suffix.lower() not in endings:
            fix = f"End it in {', '.join(endings[:-1])} or {endings[-1]}."
            raise UserError(f"{file}: not the name of a picture file.", fix)
        return writable(file)

    vars(writable_file)["writes"] = True
    return option(f"{flag} FILE", words, callback=writable_file)


JsonOption = Annotated[Path | None, output_file("--json", "Also write the result as JSON.")]


SeedOption = Annotated[int, option("--seed", "Random seed.", min=0)]
JournalOption = Annotated[
    Path | None,
    option("--resume DIR", "Store finished runs in DIR; the same command continues from there."),
]
BlockOption = Annotated[
    list[str] | None, option("--block NAME", "Block; default: all.", autocompletion=complete_block)
]


RealOption = Annotated[list[str] | None, option("--real f64|f32", "Number format; default: all.")]


ControllerOption = Annotated[
    str | None,
    option(
        "--controller NAME",
        "In place of the file's laws: a controller (mpc), a law (sliding_mode), FILE.py:law; "
        "separate several with commas.",
        autocompletion=completing(configured),
    ),
]
BoardOption = Annotated[
    str, option("--board", f"Board of the firmware: {', '.join(firmware_boards())}.")
]


def chosen_formats(real: list[str] | None, known: Collection[str] = ()) -> list[str]:
    """Number formats that were asked for, each once; the default ones without ``--real``."""
    from esea_gen.emit.formats import DEFAULT_FORMATS, FLOATING_FORMATS, FORMATS

    allowed = list(known or FLOATING_FORMATS)
    chosen = real or list(DEFAULT_FORMATS)
    for name in chosen:
        if name not in allowed:
            fix = f"{nearest(name, allowed)}Choose from {', '.join(allowed)}."
            if name in FORMATS:
                fix += f" {name} has its own command: {FORMATS[name].verified_by}."
            raise UserError(f"Unknown number format '{name}'.", fix)
    return list(dict.fromkeys(chosen))


def _jobs(value: int) -> int:
    if value < 1 and value != -1:
        raise UserError(f"--jobs {value}: not a number of processes.", "Give 1 or more, or -1.")
    return value


JobsOption = Annotated[int, option("--jobs", "Parallel processes; -1: all cores.", callback=_jobs)]


def _cluster(address: str | None) -> str | None:
    # Before anything is computed: a cluster that will not do is told at once.
    if address is not None:
        from esea_gen.analysis.cluster import connected

        with connected(address):
            pass
    return address


ClusterOption = Annotated[
    str | None,
    option(
        "--cluster ADDRESS",
        "Dask scheduler whose workers run the cases, instead of processes here.",
        callback=_cluster,
    ),
]


PICTURES = (".png", ".svg", ".pdf")


FigureOption = Annotated[
    Path | None, output_file("--figure", "Also write a plot: .png, .svg or .pdf.", *PICTURES)
]


def of_recording(data: Path | None, recording: Path | None) -> Path | None:
    """``--data``, refused where there is no ``--recording`` that it could belong to."""
    if data is not None and recording is None:
        raise UserError("--data without --recording.", "Name the recording, or leave --data out.")
    return data


def recorded_streams(loaded: Device, recording: Path | None, data: Path | None) -> dict[str, Any]:
    """Deflections of ``--recording``, by name; none without it."""
    data = of_recording(data, recording)
    if recording is None:
        return {}
    from esea_gen.identify import recorded_deflections

    return recorded_deflections(loaded, recording, data)
