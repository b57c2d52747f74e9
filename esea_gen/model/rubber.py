"""The coupling's torque model as the device file has it: published, or a member of the family."""

from __future__ import annotations

from esea_gen.devices.file import DeviceData
from esea_gen.devices.rubber import FamilyTerm
from esea_gen.language.block import Block
from esea_gen.model.elastomer import stop_grid, torque_sensor
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_inverse import family_inverse
from esea_gen.model.family_sensor import family_sensor
from esea_gen.model.inverse import chosen_inverse
from esea_gen.model.temperature import TemperatureFactor

POWERS = {"x": 1.0, "x^3": 3.0, "x^5": 5.0}


def fitted_of(device: DeviceData) -> FittedMember:
    """The member of the family that a device file's section ``[family]`` holds."""
    family = device.file.family
    if family is None:
        raise ValueError(f"{device.origin} has no [family]")
    member = Member(family.member, family.title, tuple(_term(t) for t in family.terms))
    weights = tuple(t.weight_Nm.value for t in family.terms)
    t, warm = family.temperature, None
    if t is not None:
        warm = TemperatureFactor(t.reference_C.value, t.per_K.value, t.low_C.value, t.high_C.value)
    return FittedMember(member, family.scale_rad.value, weights, warm)


def _term(t: FamilyTerm) -> Term:
    bend = t.bend.value if t.bend else 0.0
    rise = Rise("bend", bend, t.side) if t.bend else Rise("power", POWERS[t.rise], t.side)
    single = t.threshold or t.path
    numbers = t.times_s.values if t.times_s else ((single.value,) if single else ())
    softening = None
    if t.strain_softening:
        softening = Softening("strain", t.strain_softening.value)
    elif t.path_softening:
        softening = Softening("path", t.path_softening.value)
    return Term(t.kind, rise, numbers, t.exponent.value if t.exponent else 0.0, softening)


def rubber_sensor(device: DeviceData) -> Block:
    family = device.file.family
    if family is None:
        return torque_sensor(device)
    return family_sensor(device, fitted_of(device), family.start)


def rubber_inverse(device: DeviceData) -> Block:
    """The inverse of a device's model: desired torque to deflection set-point."""
    family = device.file.family
    if family is None:
        return chosen_inverse(device)
    return family_inverse(device, fitted_of(device), family.start)


def stiffness_range_Nm_rad(device: DeviceData) -> tuple[float, float]:
    """Smallest and largest stiffness of the coupling, for any history."""
    if device.file.family is not None:
        fitted, reach = fitted_of(device), device.file.domain.theta_max_rad.value
        return fitted.least_slope_Nm_rad(reach), fitted.most_slope_Nm_rad(reach)
    e = device.elastomer
    values = {c.name: c.value for c in device.constants("elastomer")}
    weights = stop_grid(values, round(e.stops.value))[1]
    soft = e.k1_Nm_rad.value
    return soft, soft + sum(float(w) for w in weights) + values.get("kv_Nm_rad", 0.0)
