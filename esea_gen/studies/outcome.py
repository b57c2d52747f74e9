"""What became of a closed-loop study."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from esea_gen.analysis.monte_carlo import MonteCarlo
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.judge import ENCODER_FAULT, ENDED, FIGURES
from esea_gen.twin.off import off_families

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERRORS = ("rms_true_Nm", "rms_model_Nm", "max_true_Nm")


def csv_lines(entries: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    keys = list(dict.fromkeys(k for e in entries for k in e))
    table = csv.DictWriter(text, keys, lineterminator="\n")
    table.writeheader()
    table.writerows(entries)
    return text.getvalue()


class Told(Protocol):
    """What an outcome takes from its study."""

    name: ClassVar[str]
    title: ClassVar[str]
    person: ClassVar[bool]
    thesis_Nm: ClassVar[Mapping[str, float]]

    def case(self, name: str) -> Case: ...
    def table(self, done: Simulation) -> list[str]: ...
    def to_dict(self, done: Simulation) -> dict[str, Any]: ...
    def figure(self, done: Simulation) -> Figure: ...


@dataclass(frozen=True)
class Simulation:
    """A study's outcome."""

    study: Told
    setting: Setting
    seeds: tuple[int, ...]
    monte_carlo: MonteCarlo
    kept: Mapping[str, Any]

    @property
    def person(self) -> str:
        return self.setting.person if self.study.person else "none"

    def cases(self) -> list[dict[str, Any]]:
        entries = []
        for r in self.monte_carlo.results:
            entry: dict[str, Any] = {"name": r.case["case"], "seed": r.case["seed"]}
            entry |= dict.fromkeys(ERRORS)
            values = r.values or {}
            # In one order, whether it was run now or comes out of a journal.
            order = [*(k for k in FIGURES if k in values), *sorted(set(values) - set(FIGURES))]
            entry |= {k: values[k] for k in order}
            entry |= {k: bool(values.get(k)) for k in ENDED}
            if self.setting.fault:
                entry |= {k: values.get(k) for k in ENCODER_FAULT}
            if r.values is None:
                entry["failure"] = r.failure
            entry |= {"off": self.setting.off, "family": off_families()[self.setting.off].group}
            entry["thesis_rms_Nm"] = self.study.thesis_Nm.get(self.setting.controller)
            entries.append(entry)
        return entries

    def by_case(self) -> dict[str, list[dict[str, Any]]]:
        found: dict[str, list[dict[str, Any]]] = {}
        for entry in self.cases():
            found.setdefault(entry["name"], []).append(entry)
        return found

    def ended(self) -> list[dict[str, Any]]:
        """Runs that were unstable, tripped, latched or failed: their errors judge no controller."""
        return [e for e in self.cases() if any(e.get(k) for k in (*ENDED, "failure"))]

    def to_dict(self) -> dict[str, Any]:
        content = self.study.to_dict(self)
        if self.setting.fault:
            content |= {"fault": str(parse_fault(self.setting.fault)), "simulated": True}
        return content

    def table(self) -> list[str]:
        return self._faults() if self.setting.fault else self.study.table(self)

    def _faults(self) -> list[str]:
        # What came of an encoder's fault, a line a case.
        s, runs = self.setting, len(self.seeds)
        lines = [
            f"{self.study.title}, {parse_fault(s.fault)}, simulated: {s.controller}, plant "
            f"{s.plant}, person {self.person}, {runs} run{'s' if runs > 1 else ''} a case",
            f"{'case':32}{'found':>8}{'after ms':>10}{'torque then':>13}{'peak torque':>13}"
            f"{'energy':>9}",
        ]
        for name, entries in self.by_case().items():
            good = [e for e in entries if e["peak_torque_Nm"] is not None]
            found = [e for e in good if e["detected_ticks"] is not None]

            def worst(key: str, of: list[dict[str, Any]], places: int, width: int) -> str:
                return f"{max(e[key] for e in of):{width}.{places}f}" if of else f"{'-':>{width}}"

            lines.append(
                f"{name:32}{f'{len(found)}/{len(entries)}':>8}"
                f"{worst('detected_ticks', found, 0, 10)}{worst('torque_then_Nm', found, 2, 13)}"
                f"{worst('peak_torque_Nm', good, 2, 13)}{worst('energy_J', good, 2, 9)}"
            )
        return [*lines, "the worst of all runs; torques in Nm, energy given to the limb in J"]

    def figure(self) -> Figure:
        from esea_gen.analysis.plots import crossed

        ended: dict[str, str] = {}
        for entry in self.ended():
            words = [ENDED.get(k, "failed") for k in (*ENDED, "failure") if entry.get(k)]
            ended.setdefault(entry["name"], f"seed {entry['seed']} {', '.join(words)}")
        return crossed(self.study.figure(self), ended)

    def csv(self) -> str:
        return csv_lines(self.cases())
