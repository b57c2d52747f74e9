"""Model mismatch: virtual exoskeletons that differ from the controller's model.

Each family changes one property of the requested plant; its numbers are in ``plants.toml``.
Friction, inertia and lag are scaled from the device file's, which the controller uses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError, nearest
from esea_gen.language.ports import Array
from esea_gen.observe import torque_scale
from esea_gen.twin.encoders import SIDES
from esea_gen.twin.parameters import CABLE_KEYS
from esea_gen.twin.published import PLANTS
from esea_gen.twin.trajectories import RATE_HZ

NOTHING, ALL, BACKLASH = "none", "all", "backlash"
_DRAWS, _MISSES = 4, 5  # streams of random numbers, beside those of plant, person and noise
_TURN = 2 * math.pi


@dataclass(frozen=True)
class Deviation:
    values: Mapping[str, float] = field(default_factory=dict)  # tunables of plant and encoders
    delay_ticks: int = 0
    missed_share: float = 0.0  # probability that a control run is left out

    def missed(self, ticks: int, seed: int) -> Array | None:
        """Ticks in which a control run would be left out; None where none is."""
        if not self.missed_share:
            return None
        out = np.random.default_rng([seed, _MISSES]).random(ticks) < self.missed_share
        out[: round(PLANTS.off.missed_from_s * RATE_HZ)] = False
        return np.asarray(out)


Draw = Callable[[Device, np.random.Generator], Deviation]


@dataclass(frozen=True)
class OffFamily:
    name: str
    group: str
    meaning: str
    draw: Draw


def _same(off: Deviation) -> Draw:
    return lambda _device, _rng: off


def _scaled(scale: float, *keys: str) -> Draw:
    # From the device file's numbers, which are the controller's.
    def draw(device: Device, _: np.random.Generator) -> Deviation:
        return Deviation({k: scale * getattr(device.file.actuator, k).value for k in keys})

    return draw


def _encoders(rng: np.random.Generator, deg: Callable[[], float]) -> dict[str, float]:
    out = {}
    for side in SIDES:
        out[f"{side}_wave_1_rad"] = math.radians(deg())
        out[f"{side}_phase_1_rad"] = float(rng.uniform(0, _TURN))
    return out


def _waved(deg: float) -> Draw:
    return lambda _, rng: Deviation(_encoders(rng, lambda: deg))


def _everything(part: float = 1.0, missing: bool = False) -> Draw:
    # part: of the way from the model to what is drawn.
    def draw(device: Device, rng: np.random.Generator) -> Deviation:
        r, a = PLANTS.off.random, device.file.actuator
        assert a is not None

        def uniform(ends: tuple[float, float], model: float = 0.0) -> float:
            return model + part * (float(rng.uniform(*ends)) - model)

        def by_ratio(ends: tuple[float, float]) -> float:
            return math.exp(uniform((math.log(ends[0]), math.log(ends[1]))))

        values = {
            "elastomer_scale": uniform(r.rubber_scale, 1.0),
            "hysteresis_scale": uniform(r.hysteresis_scale, 1.0),
            "relaxation_Nm_rad": uniform(r.relaxation_Nm_rad),
            "fv_Nms_rad": by_ratio(r.friction_scale) * a.fv_Nms_rad.value,
            "fc_Nm": by_ratio(r.friction_scale) * a.fc_Nm.value,
            "J_kgm2": uniform(r.inertia_scale, 1.0) * a.J_kgm2.value,
            "tau_c_s": by_ratio(r.lag_scale) * a.tau_c_s.value,
            "cable_backlash_rad": uniform(r.backlash_rad),
            **_encoders(rng, lambda: uniform(r.encoder_deg)),
        }
        delay = part * int(rng.integers(r.delay_ms[0], r.delay_ms[1], endpoint=True))
        share = uniform(r.missed_share) if missing else 0.0
        return Deviation(values, round(delay * RATE_HZ / 1000), share)

    return draw


@cache
def off_families() -> dict[str, OffFamily]:
    """Every family by name, in the order of the table."""
    o = PLANTS.off

    def values(**numbers: float) -> Draw:
        return _same(Deviation(numbers))

    def percent(x: float) -> str:
        return f"{100 * (x - 1):+.0f}"

    wide, slow = f"{1000 * o.backlash_rad:g}", o.relaxation_s
    branch = values(relaxation_Nm_rad=o.relaxation_Nm_rad, relaxation_s=slow)
    part = f"a second Maxwell branch, {o.relaxation_Nm_rad:g} Nm/rad (elbow) with {slow:g} s"
    twice = o.hysteresis_scale
    rows: list[tuple[str, str, str, Draw]] = [
        (NOTHING, NOTHING, "nothing off beside what the plant has", values()),
        *(
            (f"rubber{p}", "rubber", f"true torque of the rubber {p} %", values(elastomer_scale=x))
            for x, p in ((x, percent(x)) for x in o.rubber_scale)
        ),
        (
            *(f"hysteresis-x{twice:g}", "hysteresis"),
            *(f"stop operators' torque times {twice:g}", values(hysteresis_scale=twice)),
        ),
        ("relaxation", "relaxation", part, branch),
    ]
    for x in o.encoder_deg:
        text = f"both joint encoders wrong by {x:g} deg once a turn, any phase"
        rows.append((f"encoder-{x:g}deg", "encoder", text, _waved(x)))
    for x in o.friction_scale:
        draw = _scaled(x, "fv_Nms_rad", "fc_Nm")
        rows.append((f"friction-x{x:g}", "friction", f"friction {x:g} times the model's", draw))
    for x in o.inertia_scale:
        text = f"inertia of motor and drive {percent(x)} % of the model's"
        rows.append((f"inertia{percent(x)}", "inertia", text, _scaled(x, "J_kgm2")))
    for x in o.lag_scale:
        text = f"motor's lag {x:g} times the model's"
        rows.append((f"lag-x{x:g}", "lag", text, _scaled(x, "tau_c_s")))
    for ms in o.delay_ms:
        late = _same(Deviation(delay_ticks=round(ms * RATE_HZ / 1000)))
        rows.append((f"delay+{ms}ms", "delay", f"command {ms} ms later at the motor", late))
    gap, cable = values(cable_backlash_rad=o.backlash_rad), f"backlash of the cable {wide} mrad"
    rows.append((f"backlash-{wide}mrad", BACKLASH, cable, gap))
    for x in o.missed_share:
        name, text = f"missed-{100 * x:g}%", f"{100 * x:g} % of the control runs left out, any"
        rows.append((name, "missed", text, _same(Deviation(missed_share=x))))
    half, missed = _everything(0.5), _everything(missing=True)
    rows += [
        ("random", "random", "everything above drawn at once, but no run missed", _everything()),
        ("random-half", "random-half", "the same, half as far from the model", half),
        ("random-missed", "random-missed", "as random, and runs missed", missed),
    ]
    return {row[0]: OffFamily(*row) for row in rows}


def _groups(rigid: bool) -> dict[str, list[str]]:
    groups: dict[str, list[str]] = {}
    for row in off_families().values():
        groups.setdefault(row.group, []).append(row.name)
    every = [n for n in off_families() if not n.startswith("random")]
    # Asked for by its own name it is refused: a rigid cable has no backlash.
    return groups | {ALL: [n for n in every if not (rigid and n in groups[BACKLASH])]}


def chosen_families(given: str, *, rigid: bool = False) -> list[str]:
    """Names of families from a list with commas: names, names of groups, or ``all``."""
    if not given.strip():
        raise UserError(
            "--off is empty.",
            f"Leave --off out for {NOTHING} (nothing off), or give {ALL} or a family's name.",
        )
    groups, names = _groups(rigid), list(off_families())
    found: list[str] = []
    for part in (p.strip() for p in given.split(",")):
        if part in groups:
            found += groups[part]
        elif part in names:
            found.append(part)
        else:
            listed = "; ".join(f"{r.name}: {r.meaning}" for r in off_families().values())
            several = [g for g, rows in groups.items() if len(rows) > 1 and g != ALL]
            raise UserError(
                f"--off {given}: unknown family '{part}'.",
                f"{nearest(part, [*groups, *names])}There are {listed}. {', '.join(several)} stand "
                f"for all of theirs, {ALL} for each but the random ones; separate several with "
                "commas.",
            )
    return list(dict.fromkeys(found))


def deviation(name: str, device: Device, seed: int) -> Deviation:
    """Mismatch in the run of a seed, by the name of one family."""
    (only,) = chosen_families(name)
    found = off_families()[only].draw(device, np.random.default_rng([seed, _DRAWS]))
    by = {"relaxation_Nm_rad": torque_scale(device)}  # the others go with the device as they are
    return replace(found, values={k: v * by.get(k, 1) for k, v in found.values.items()})


def refuse_unknown(what: str, values: Collection[str], known: Collection[str]) -> None:
    """Reject what changes a property missing in the plant."""
    for key in (k for k in values if k not in known):
        rigid = ": its cable is rigid" * (key in CABLE_KEYS)
        other = f"{nearest(key, known)}It has {', '.join(known)}."
        fix = "Give --plant real or random, or leave it out." if rigid else other
        raise UserError(f"{what}: the plant has no {key}{rigid}.", fix)
