"""A device's record: every step that was ever done with it, its verdict and its picture."""

from __future__ import annotations

import json
import time
from io import BytesIO
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.files import write_json, write_whole
from esea_host.commissioning.result import StepResult
from esea_host.connection.identity import Identity

KIND, VERSION, NAME = "esea-host commissioning", 1, "record.json"


class CommissioningRecord:
    """A folder with ``record.json`` and pictures; entries are added, never changed."""

    def __init__(self, folder: Path, device: str) -> None:
        self.folder, self.device = Path(folder), device
        self.entries: list[dict[str, Any]] = []
        path = self.folder / NAME
        if not path.exists():
            return
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            kind, of = (content["kind"], content["version"]), str(content["device"])
            self.entries = [dict(e) for e in content["entries"]]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(
                f"{path} cannot be read as a record ({error}).", "Name another folder: --record."
            ) from None
        if kind != (KIND, VERSION):
            raise UserError(f"{path} is no record of this version.", "Name another folder.")
        if of != device:
            raise UserError(
                f"{path} is the record of a {of}, not of a {device}.",
                "Give each machine a folder of its own: --record.",
            )

    def add(self, result: StepResult, identity: Identity) -> dict[str, Any]:
        """Write a result down, its picture first."""
        number = len(self.entries) + 1
        drawn = BytesIO()
        result.picture.savefig(drawn, format="png", dpi=110)
        picture = f"{number:03d}-{result.step}.png"
        write_whole(self.folder / picture, drawn.getvalue())
        facts = identity.facts()
        entry = {
            "number": number,
            "host_ns": time.time_ns(),
            **result.to_dict(),
            "picture": picture,
            "device_digest": identity.device.digest,
            **{k: facts[k] for k in ("content_hash", "real", "board", "simulated", "versions")},
        }
        self.entries.append(entry)
        content = {"kind": KIND, "version": VERSION, "device": self.device}
        write_json(self.folder / NAME, "host-commissioning", content | {"entries": self.entries})
        return entry

    def last(self, step: str, digest: str) -> dict[str, Any] | None:
        """The newest entry of a step for the device file as it is now."""
        fits = (e for e in reversed(self.entries) if e["step"] == step)
        return next((e for e in fits if e["device_digest"] == digest), None)

    def summary(self, steps: tuple[tuple[str, str], ...], digest: str) -> list[str]:
        lines = []
        for name, title in steps:
            entry = self.last(name, digest)
            word = "not done" if entry is None else "passed" if entry["passed"] else "FAILED"
            kind = " (simulated)" if entry is not None and entry["simulated"] else ""
            lines.append(f"  {name:10}{title:34}{word}{kind}")
        return lines
