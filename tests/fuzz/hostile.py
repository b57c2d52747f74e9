"""Fuzz the readers of files, links and texts: ``python -m tests.fuzz.hostile TARGET --seconds 60``.

An input follows from its seed and number: ``--seed S --first N --inputs 1`` repeats one.  It may be
accepted, or refused with a UserError or LinkError; anything else, a hang, or memory beyond the
bound is a fault.  ``--plant`` puts a fault into the code that the target must find.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import numpy as np

from esea_gen import toml_file
from esea_gen.devices.file import parse_file, shipped_devices
from esea_gen.emit.dialect import load_dialect
from esea_gen.errors import UserError
from esea_gen.identify.recording.mapping import parse_mapping
from esea_gen.link.messenger import Messenger
from esea_gen.link.received import shown
from esea_gen.link.transport import LinkError
from esea_host import open_log
from esea_host.cli import logs
from esea_host.cli.app import out
from esea_host.connection import decoder
from esea_host.connection.receiver import Receiver
from esea_host.recording import Gap, Recorder, StreamColumn, StreamLayout, records
from esea_host.recording.replay import loaded_device
from esea_host.study.protocol import parse_protocol

MOST_S = 60.0  # an input; a busy machine is slow
MOST_BYTES = 1 << 30  # beyond what the imports take
ROOT = Path(__file__).parents[2]
Rng = Random
NUMBERS = (
    0,
    1,
    0x7F,
    0x80,
    0xFFFF,
    1 << 20,
    (1 << 31) - 1,
    1 << 32,
    1 << 40,
    (1 << 63) - 1,
    1 << 63,
)


def mutated(rng: Rng, data: bytes) -> bytes:
    """The bytes with a few faults."""
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at, length = rng.randrange(len(found) + 1), rng.choice((1, 2, 4, 9, 100, 5000))
        match rng.randrange(8):
            case 0:
                found[at:] = b"" if rng.random() < 0.3 else found[at:]
            case 1:
                del found[at : at + length]
            case 2:
                found[at:at] = found[max(0, at - length) : at]
            case 3:
                found[at:at] = rng.randbytes(min(length, 100))
            case 4:
                size = rng.choice((1, 2, 4, 8))
                number = rng.choice(NUMBERS) & (1 << 8 * size) - 1
                found[at : at + size] = number.to_bytes(size, "little")
            case 5:
                other = rng.randrange(len(found) + 1)
                found[at : at + length] = found[other : other + length]
            case _ if at < len(found):
                found[at] ^= 1 << rng.randrange(8)
    return bytes(found)


def text_of(rng: Rng) -> str:
    """A text that wants to be more than a text."""
    parts = (
        "\x1b[2J",
        "\x1b]0;x\x07",
        "\u202e",
        "../",
        "\\",
        "\0",
        "CON",
        "-rf",
        ".",
        "é",
        "<b>",
        "\n",
        "\u200b",
        "a",
        "🦾",
        "\ud800",
        "\r",
        "  ",
        "NUL.txt",
        "/etc/passwd",
        "%s{0}",
    )
    return "".join(rng.choice(parts) for _ in range(rng.choice((0, 1, 3, 8, 400))))


# -- recordings ----------------------------------------------------------------------------------

LAYOUT = StreamLayout(
    "sense_out", (StreamColumn("sequence", "u4"), StreamColumn("tau_Nm", "f4", "Nm", "", 2))
)


def small_recording(path: Path, compress: bool) -> bytes:
    """Three pieces of 40 rows, events and attachments."""
    with Recorder(
        path, {"facts.json": b'{"device": "elbow_drive", "tick_us": 1000}'}, compress, 0
    ) as r:
        for first in range(0, 120, 40):
            rows = np.zeros(40, LAYOUT.dtype)
            rows["sequence"] = np.arange(first, first + 40)
            ns = rows["sequence"].astype(np.int64) * 1_000_000
            r.rows(LAYOUT, rows, ns + 10**18, ns)
            r.gap(Gap("sense_out", first + 39, first + 40, 0, "link", first * 1_000_000))
        r.note("a note")
        r.event("clock", {"host_ns": 1, "board_ns": 1})
    data = path.read_bytes()
    path.unlink()
    return data


def foreign_recording(compression: str, chunked: bool) -> bytes:
    """As other tools write: JSON and CDR, lz4 or outside chunks, without checksums."""
    from mcap.writer import CompressionType, Writer

    made = io.BytesIO()
    kind = CompressionType[compression]
    writer = Writer(made, 500, kind, use_chunking=chunked, enable_crcs=False)
    writer.start("ros2", "libmcap")
    for name, encoding, schema in (("/joint", "cdr", "ros2msg"), ("/log", "json", "jsonschema")):
        number = writer.register_schema(name, schema, b"{}")
        channel = writer.register_channel(name, encoding, number)
        for i in range(20):
            writer.add_message(channel, i, b'{"a": 1}' if encoding == "json" else bytes(12), i, i)
    writer.finish()
    return made.getvalue()


def sealed(rng: Rng, compress: bool) -> bytes:
    """A recording whose checksums are right and whose content is hostile."""
    huge = rng.choice(NUMBERS)
    column = {
        "name": text_of(rng),
        "kind": rng.choice(("f4", "O", "u8")),
        "unit": "",
        "meaning": "",
        "size": rng.choice((1, -1, huge)),
    }
    sequence = {"name": "sequence", "kind": "u4", "unit": "", "meaning": "", "size": 1}
    layout = rng.choice(
        ("[" * 100_000, "{}", "null", json.dumps([sequence, column]), LAYOUT.to_json())
    )
    event = rng.choice(
        (
            b"[" * 50_000,
            b"{}",
            b'{"stream": 3, "after_tick": "x"}',
            b"9" * 5000,
            b"\xff",
            json.dumps(
                {
                    "stream": "sense_out",
                    "after_tick": huge,
                    "before_tick": -huge,
                    "missing": huge,
                    "reason": text_of(rng),
                    "board_ns": huge,
                    "text": {},
                    "host_ns": huge,
                }
            ).encode(),
        )
    )
    facts = rng.choice((b"[]", b'{"tick_us": 0.1}', b'{"device": [1]}', b'{"tick_us": -1}', b"{}"))
    from mcap.writer import CompressionType, Writer

    made = io.BytesIO()
    writer = Writer(made, 1 << 18, CompressionType.ZSTD if compress else CompressionType.NONE)
    writer.start("", "esea-host")
    writer.add_attachment(huge & 0x7FFF, 0, "facts.json", "", facts)
    rows = [
        ("sense_out", "protobuf", rng.randbytes(rng.choice((0, 5, 17)))),
        ("gap", "json", event),
        ("note", "json", event),
        ("clock", "json", event),
    ]
    for topic, encoding, data in rows:
        known = {"esea.columns": layout} if encoding == "protobuf" else {}
        channel = writer.register_channel(f"/{topic}", encoding, 0, known)
        for i in range(rng.choice((1, 3, 20))):
            ns = rng.choice((i, huge))
            writer.add_message(channel, ns, data, rng.choice((ns, i)), i)
    writer.finish()
    return made.getvalue()


def bomb(rng: Rng) -> bytes:
    """Chunks of nothing that unpack to gigabytes, and say so or not."""
    import lz4.frame
    import zstandard

    size = rng.choice((1 << 26, 1 << 24))
    kind = rng.choice(("zstd", "lz4"))
    packed = (zstandard if kind == "zstd" else lz4.frame).compress(bytes(size))
    told = rng.choice((size, size, 100, 1 << 40))
    head = struct.pack("<QQQII", 0, 1, told, rng.choice((0, 7)), len(kind)) + kind.encode()
    chunk = head + struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<BQII", 1, 8, 0, 0)
    return b"\x89MCAP0\r\n" + header + (struct.pack("<BQ", 6, len(chunk)) + chunk) * 10


def use_recording(folder: Path, data: bytes) -> None:
    """All that a command does with a recording, but to compile C."""
    path = folder / "a.mcap"
    path.write_bytes(data)
    with contextlib.redirect_stdout(io.StringIO()):
        out.file = sys.stdout
        with contextlib.suppress(UserError):
            logs.show(path)
    with open_log(path) as log:
        for stream in log.streams:
            with contextlib.suppress(UserError):
                table = log[stream]
                for part in table.pieces():
                    assert len(part)
                table.frame()
                list(log.read_timed(stream))
        for topic in log.topics:
            with contextlib.suppress(UserError):
                log.events(topic)
        assert log.integrity.to_dict()
        for to in logs.FORMATS:
            target = folder / to
            with contextlib.suppress(UserError), contextlib.redirect_stderr(io.StringIO()):
                logs.export(path, target, to)
            for made in sorted(folder.rglob("*"), reverse=True):
                made.rmdir() if made.is_dir() else made.unlink() if made != path else None


def mcap_target(rng: Rng, folder: Path) -> Callable[[], None]:
    """Recordings, ours and foreign ones, changed, cut, sealed again or made to explode."""
    kind = rng.randrange(12)
    if kind == 0:
        data = bomb(rng)
    elif kind < 4:
        data = sealed(rng, rng.random() < 0.5)
    elif kind < 7:
        chunked = rng.random() < 0.5
        data = mutated(rng, foreign_recording(rng.choice(("NONE", "LZ4", "ZSTD")), chunked))
    else:
        data = mutated(rng, small_recording(folder / "made.mcap", rng.random() < 0.5))
    return lambda: use_recording(folder, data)


# -- tables, TOML, links -------------------------------------------------------------------------


def tables_target(rng: Rng, folder: Path) -> Callable[[], None]:
    """CSV, JSON, MAT, HDF5 and Parquet."""
    from esea_gen.tables import read_table

    rows = [",".join(str(rng.uniform(-1, 1)) for _ in range(3)) for _ in range(30)]
    data, ending = "\n".join(["t,x,tau", *rows]).encode(), ".csv"
    if rng.random() < 0.3:
        columns = {k: [rng.random() for _ in range(9)] for k in ("t", "x")}
        data, ending = json.dumps(columns).encode(), ".json"
    odd = (
        b'"',
        b"\xef\xbb\xbf",
        b"\0",
        b"nan",
        b"1_234",
        b"'",
        b";",
        b"\r",
        b"9" * 200_000,
        b"[" * 9000,
    )
    data = mutated(rng, data)
    at = rng.randrange(len(data) + 1)
    data = data[:at] + rng.choice(odd) + data[at:] if rng.random() < 0.6 else data
    if rng.random() < 0.1:
        data, ending = rng.randbytes(500), rng.choice((".mat", ".h5", ".parquet"))
    path = folder / f"a{ending}"
    path.write_bytes(data)
    return lambda: read_table(path) and None


def toml_target(rng: Rng, folder: Path) -> Callable[[], None]:
    """Device files, mappings of recordings, protocols of studies."""
    own = sorted((ROOT / "host").rglob("protocol.toml"))
    mapping = ROOT / "tests" / "data" / "hdrb" / "hdrb.toml"
    kind = rng.randrange(3)
    source = (rng.choice(sorted(shipped_devices().values())), mapping, rng.choice(own))[kind]
    lines = source.read_text(encoding="utf-8").splitlines()
    odd = (
        "[" * 20_000,
        "9" * 5000,
        "1e999",
        "nan",
        "-inf",
        "{a=" * 9000,
        '"""',
        "1979-05-27",
        "true",
        "[1, 'a', {}]",
        "''",
        json.dumps(shown(text_of(rng))),
        "0x" + "f" * 300,
    )
    for _ in range(rng.choice((1, 2, 5))):
        at = rng.randrange(len(lines))
        key, equals, _ = lines[at].partition("=")
        choice = rng.randrange(5)
        if choice < 3 and equals:
            lines[at] = f"{key}= {rng.choice(odd)}"
        elif choice == 3:
            del lines[at : at + 1 + rng.randrange(3)]
            lines = lines or [""]
        else:
            lines.insert(at, rng.choice(("[a" + ".b" * 5000 + "]", "x = 1", "[[name]]", lines[at])))
    text = "\n".join(lines)
    if rng.random() < 0.2:
        text = mutated(rng, text.encode()).decode("utf-8", "replace")
    if kind == 0:
        return lambda: parse_file(text, "a.toml") and None
    if kind == 1:
        return lambda: parse_mapping(text, "a.toml") and None
    return lambda: parse_protocol(text, "a.toml") and None


class _Bytes:
    def __init__(self, data: bytes) -> None:
        self.data = [data[i : i + 700] for i in range(0, len(data), 700)]

    def read(self, timeout_s: float) -> bytes:
        return self.data.pop(0) if self.data else b""

    def write(self, data: bytes, timeout_s: float) -> None:
        pass

    def close(self) -> None:
        pass

    def said(self) -> str:
        return ""


def _frames(rng: Rng) -> bytes:
    dialect = load_dialect(loaded_device("elbow_drive"))
    sender, found = dialect.MAVLink(None, 1, 1), []
    classes = sorted(dialect.mavlink_map.values(), key=lambda c: c.id)
    for _ in range(20):
        cls = rng.choice(classes)
        payload = rng.randbytes(cls.unpacker.size)
        if rng.random() < 0.3:
            payload = (text_of(rng).encode("utf-8", "replace") * 99)[: cls.unpacker.size].ljust(
                1, b"\0"
            )
        head = struct.pack("<BBBBBB", len(payload), 0, 0, sender.seq, 1, 1) + cls.id.to_bytes(
            3, "little"
        )
        crc = decoder.checksum(head + payload + bytes([cls.crc_extra]))
        found.append(b"\xfd" + head + payload + struct.pack("<H", crc))
        sender.seq = (sender.seq + rng.choice((1, 1, 1, 7))) % 256
    data = b"".join(found)
    return mutated(rng, data) if rng.random() < 0.5 else data


def mavlink_target(rng: Rng, folder: Path) -> Callable[[], None]:
    """Bytes of a board, to the receiver and to the session; its texts are clean."""
    data, dialect = _frames(rng), load_dialect(loaded_device("elbow_drive"))

    def use() -> None:
        receiver = Receiver(_Bytes(b""), decoder.TelemetryDecoder(dialect), 1_000_000)
        queue = receiver.subscribe()
        receiver.take(data)
        queue.take(0.0)
        session = Messenger(_Bytes(data), dialect, 0.0)
        for message in session.pending():
            for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
                text = getattr(message, name)
                assert kind != "char" or not isinstance(text, str) or text == shown(text), message
        if session.heartbeat is not None:
            session.state()

    return use


def strings_target(rng: Rng, folder: Path) -> Callable[[], None]:
    """Texts: nothing hidden is printed."""
    text = text_of(rng)

    def use() -> None:
        said = shown(text)
        assert all(c.isprintable() for c in said.replace(" ", "").replace("\u3000", "")), repr(said)

    return use


TARGETS = {
    "mcap": mcap_target,
    "tables": tables_target,
    "toml": toml_target,
    "mavlink": mavlink_target,
    "strings": strings_target,
}


def plant(target: str) -> None:
    """Put a fault into what a target tests."""
    places: dict[str, tuple[object, str, object]] = {
        "mcap": (records, "unpack", lambda kind, data, size: bytes(2 * MOST_BYTES)),
        "toml": (toml_file, "parse_toml", lambda *_: 1 / 0),
        "mavlink": (decoder.TelemetryDecoder, "feed", lambda *_: 1 / 0),
        "strings": (sys.modules[__name__], "shown", lambda text: text),
    }
    if target == "tables":
        from esea_gen import tables

        places["tables"] = (tables, "read_table", lambda _: 1 / 0)
    where, name, fault = places[target]
    setattr(where, name, fault)
    for module in list(sys.modules.values()):  # who has imported it by name
        if getattr(module, "__name__", "").startswith("esea_gen.devices") and hasattr(module, name):
            setattr(module, name, fault)


def _too_long(*_: object) -> None:
    raise TimeoutError(f"an input took longer than {MOST_S:g} s")


def campaign(target: str, seed: int, numbers: Iterator[int], seconds: float) -> dict[str, object]:
    """Run inputs until the time or the numbers are over; what happened."""
    counts = {"inputs": 0, "accepted": 0, "refused": 0}
    faults: list[dict[str, object]] = []
    slowest_s, end_s = 0.0, time.monotonic() + seconds
    signal.signal(signal.SIGALRM, _too_long)
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            if time.monotonic() > end_s or len(faults) == 20:
                break
            use = TARGETS[target](Rng(f"{target} {seed} {number}"), Path(folder))
            counts["inputs"] += 1
            start_s = time.monotonic()
            signal.setitimer(signal.ITIMER_REAL, MOST_S)
            try:
                use()
                counts["accepted"] += 1
            except (UserError, LinkError):
                counts["refused"] += 1
            except BaseException as error:
                last = traceback.extract_tb(error.__traceback__)[-1]
                where = f"{Path(last.filename).name}:{last.lineno}"
                what = f"{type(error).__name__}: {str(error)[:200]}"
                faults.append({"number": number, "what": what, "where": where})
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
            slowest_s = max(slowest_s, time.monotonic() - start_s)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {**counts, "slowest_s": slowest_s, "peak_bytes": peak, "faults": faults}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", choices=TARGETS, nargs="+", metavar="TARGET")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--inputs", type=int, default=1 << 62)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--plant", action="store_true")
    given = parser.parse_args()
    for target in given.targets if given.plant else ():
        plant(target)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (used + MOST_BYTES, hard))
    for target in given.targets:
        numbers = iter(range(given.first, given.first + given.inputs))
        found = campaign(target, given.seed, numbers, given.seconds)
        print(json.dumps({"target": target, "seed": given.seed, "used_bytes": used, **found}))


if __name__ == "__main__":
    main()
