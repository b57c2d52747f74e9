"""Relations between the numbers of the limits, up to equality."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from esea_gen.control.limits.safety import check_safety, safety_sections
from esea_gen.errors import UserError
from tests.control.test_linear_loop import variant

# Of the shipped drive: joint from -0.6 to 3 rad, motion from -0.15 to 2.5 rad, 10 of 12 rad/s.
JUST = [
    ("safety.rom_min_rad", 2.5, "safety.rom_max_rad = 2.5", ""),
    ("safety.rom_min_rad", -0.4, "joint.theta_min_rad = -0.6", "with safety.rom_margin_rad = 0.2"),
    ("safety.rom_max_rad", 2.8, "joint.theta_max_rad = 3", "with safety.rom_margin_rad = 0.2"),
    ("safety.omega_max_rad_s", 12.0, "joint.omega_max_rad_s = 12", ""),
    ("safety.rom_margin_rad", 0.5, "safety.rom_min_rad = -0.15", "or narrow the margin"),
    ("joint.omega_max_rad_s", 10.0, "joint.omega_max_rad_s = 10", "Lower safety.omega_max_rad_s"),
    ("actuator.omega_max_rad_s", 10.0, "= 10", "or raise actuator.omega_max_rad_s."),
]


def shipped(**changes):
    """The drive with other numbers, not looked at before."""
    device = variant()
    quantities = {k: SimpleNamespace(value=q.value) for k, q in device.quantities()}
    for key, value in changes.items():
        quantities[key.replace("__", ".")].value = value
    return SimpleNamespace(
        file=device.file, origin="mine.toml", quantities=lambda: list(quantities.items())
    )


@pytest.mark.parametrize(("key", "value", "named", "more"), JUST)
def test_a_limit_that_meets_the_next_one_is_refused(key, value, named, more):
    with pytest.raises(UserError) as refused:
        check_safety(shipped(**{key: value}))
    assert named in str(refused.value)
    assert more in str(refused.value)
    room = "omega" not in key and "rom_margin" in str(refused.value)
    assert ("narrow the margin" in str(refused.value)) == room


@pytest.mark.parametrize("missing", ["safety", "actuator", "joint"])
def test_a_section_that_is_missing_is_named(missing):
    device = variant()
    object.__setattr__(device, "file", device.file.model_copy(update={missing: None}))
    with pytest.raises(UserError, match=f"{missing} is missing.*\n?.*extends"):
        safety_sections(device)
