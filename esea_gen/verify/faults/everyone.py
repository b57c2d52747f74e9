"""Encoders that are wrong but plausible, and stops of either category, felt by everybody.

A seed decides plant, moment, desired torque (both signs) and motion, alike for every row and law.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Unpack

from esea_gen.analysis.campaign import Running, run_cases
from esea_gen.analysis.journal import Configuration, rooms_digest
from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.emit.states import TIMES_MS
from esea_gen.errors import UserError
from esea_gen.verify.faults.campaign import felt_in, loaded
from esea_gen.verify.faults.kinds import BoardFault
from esea_gen.verify.faults.rig import (
    AFTER,
    CLAMPED,
    IMPEDANCE,
    LIMP,
    MOST_NM,
    OPERATOR,
    REACTS,
    STOP_LINE,
    SUBJECTS,
    TORQUE,
    FaultScene,
    drawn_moment,
)

SEEDS = 20
ENCODERS, STOPS = "encoders", "stops"
ANY, RUN_OUT = "largest", "largest, motor off"  # rows of all rows
# Ticks after a fault, and after a stop has switched the motor off.
WATCHED, STOP_WATCHED = 3000, 1500
SIDES = ("load", "motor", "both", "gear")
# Rad, rad/s, and what a gain multiplies.
FAULTS = (
    *(f"freeze:{side}" for side in SIDES),
    *(f"gain:{side}={x}" for side in SIDES for x in (0.8, 1.2)),
    *(f"slip:load={x}" for x in (0.05, -0.05, 0.0838, -0.0838, 0.3, -0.3)),
    *(f"slip:{side}={x}" for side in ("motor", "both") for x in (0.0838, -0.0838)),
    *(f"slip:gear={x}" for x in (0.03, -0.03)),
    *(f"drift:load={x}" for x in (0.02, -0.02, 0.05, -0.05, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0)),
    *(f"drift:{side}={x}" for side in SIDES[1:] for x in (0.05, -0.05)),
)
KINDS = {"slip": "jump", "drift": "ramp"}  # what the rig calls them, by shares of a turn
Column = tuple[str, str]  # of the table: a row's name and a column's
Run = tuple[str, str, Mapping[str, float]]  # column, law, what was felt


def board_fault(text: str, gear_ratio: float) -> BoardFault:
    """One of :data:`FAULTS`; the amount at the joint, as a share of the encoder's turn."""
    kind, side, amount = re.split("[:=]", text + "=0")[:3]
    place = "count_motor+count_load" if side == "both" else f"count_{side}"
    turns = float(amount) / (2 * math.pi) * (gear_ratio if side == "gear" else 1)
    return BoardFault(place, KINDS.get(kind, kind), turns if kind in KINDS else float(amount))


def drawn_scene(person: str, seed: int, halts: bool = False) -> FaultScene:
    sign = (1, -1)[seed % 2] if person == CLAMPED else (0, 1, -1)[seed % 3]
    shown = seed % 6 == 3 and person not in (LIMP, CLAMPED)
    torque_Nm = sign * MOST_NM.get(person, 2.0)
    return FaultScene("", person, IMPEDANCE if shown else TORQUE, torque_Nm, seed // 3 % 2, halts)


def felt_by(
    device: str,
    controller: str,
    fault: Mapping[str, Any],
    person: str,
    seed: int,
    halts: bool,
    ticks: Sequence[int],
) -> dict[str, float]:
    at = drawn_moment(random.Random(seed), person)
    scene = drawn_scene(person, seed, halts)
    return felt_in(loaded(device, controller), scene, BoardFault(**fault), at, seed, ticks)


def _encoder_cases(device: Device) -> dict[Column, dict[str, Any]]:
    assert device.file.actuator is not None
    ratio = device.file.actuator.gear_ratio.value
    how = {"halts": False, "ticks": (WATCHED, AFTER)}
    return {
        (text, person): {"fault": asdict(board_fault(text, ratio)), "person": person} | how
        for text in FAULTS
        for person in SUBJECTS
    }


def _stop_cases(_: Device) -> dict[Column, dict[str, Any]]:
    stops = {0: BoardFault(STOP_LINE, "open"), 1: BoardFault(OPERATOR, "stop")}
    return {
        (person, f"category {k}, {f'halts after {REACTS} ms' if halts else 'goes on'}"): {
            "fault": asdict(fault),
            "person": person,
            "halts": halts,
            "ticks": (k * TIMES_MS["STOP_OFF"][0] + STOP_WATCHED, STOP_WATCHED),
        }
        for person in SUBJECTS
        for k, fault in stops.items()
        for halts in (False, True)
    }


def _row(name: str, key: str, runs: Sequence[Run]) -> dict[str, Any]:
    by_law_Nm: dict[str, dict[str, float]] = {}
    laws = dict.fromkeys(law for _, law, _ in runs)
    for column, law, v in runs:
        of = by_law_Nm.setdefault(column, {})
        of[law] = max(v[key], of.get(law, 0.0))
    found = [int(v["found_ticks"]) for *_, v in runs if v["found_ticks"] >= 0]
    lost = [(v["torque_then_Nm"], column, law) for column, law, v in runs if v["found_ticks"] < 0]
    unfound_Nm, *whose = max(lost, default=(None,))
    return {
        "name": name,
        "found": f"{len(found)} of {len(runs)}",
        "latest_ticks": max(found, default=None),
        "torque_Nm": {column: max(of.values()) for column, of in by_law_Nm.items()},
        "by_law_Nm": by_law_Nm,
        "most_Nm": {law: max(of[law] for of in by_law_Nm.values()) for law in laws},
        "unfound_Nm": unfound_Nm,
        "unfound_by": ", ".join(map(str, whose)),
        "energy_J": max(v["energy_J"] for *_, v in runs),
    }


@dataclass(frozen=True)
class PeopleTable:
    """The largest torque on the limb, by person and law; simulated, worst first."""

    device: str
    controllers: list[str]
    seeds: int
    what: str
    people: list[dict[str, Any]]

    def table(self) -> list[str]:
        more = ("found", "latest_ticks", "unfound_Nm", "energy_J") if self.what == ENCODERS else ()
        titles = ["latest, ticks" if k == "latest_ticks" else k.replace("_", ", ") for k in more]
        heads = ["", *self.people[0]["torque_Nm"], *titles]
        lines = [heads, ["---"] * len(heads)]
        for row in self.people:
            felt = [" / ".join(f"{x:.1f}" for x in of.values()) for of in row["by_law_Nm"].values()]
            cells = [row[k] for k in more]
            shown = [f"{x:.1f}" if isinstance(x, float) else str(x or "–") for x in cells]
            lines.append([row["name"], *felt, *shown])
        said = f"{self.device}, {' / '.join(self.controllers)}, simulated: largest torque in Nm, "
        return ["| " + " | ".join(line) + " |" for line in lines] + [
            f"{said}{self.seeds} seeds a row, person and law."
        ]

    def to_dict(self) -> dict[str, Any]:
        return {"simulated": True, **vars(self)}


def people_table(
    origin: str,
    what: str,
    *,
    controllers: Sequence[str] = (),
    seeds: int = SEEDS,
    first_seed: int = 0,
    **how: Unpack[Running],
) -> PeopleTable:
    """Run :data:`ENCODERS` or :data:`STOPS`, each law with every seed."""
    laws = list(controllers) or [""]
    devices = [loaded(origin, law) for law in laws]
    device = devices[0]
    if not device.laws or len(device.axes) > 1 or device.file.redundancy is None:
        raise UserError(
            f"{device.origin}: no drive of one axis with the section [redundancy].",
            "Give one, such as elbow_drive.",
        )
    made = (_encoder_cases if what == ENCODERS else _stop_cases)(device)
    hashes = [device_hash(d) for d in devices]
    done = run_cases(
        felt_by,
        [
            {"device": origin, "controller": law, "seed": first_seed + k} | case
            for law in laws  # first: a worker's rig is of one law
            for k in range(seeds)
            for case in made.values()
        ],
        configuration=Configuration({"code": rooms_digest(), "device": hashes}),
        **how,
    )
    names = [n or "its law" for n in laws]
    rows: dict[str, list[Run]] = {}
    for k, result in enumerate(done.results):
        if result.values is None:
            raise UserError(f"{result.case}: {result.failure}", "Correct the cause named above.")
        row, column = list(made)[k % len(made)]
        law = names[k // (seeds * len(made))]
        rows.setdefault(row, []).append((column, law, result.values))
    peak = "peak_torque_Nm"
    key = "torque_then_Nm" if what == ENCODERS else peak
    every = [run for of in rows.values() for run in of]
    people = [_row(name, key, runs) for name, runs in ({ANY: every} | rows).items()]
    people.sort(key=lambda r: -max(r["most_Nm"].values()))
    people[1:1] = [_row(RUN_OUT, peak, every)] if what == ENCODERS else []
    return PeopleTable(device.name, names, seeds, what, people)
