"""Which device a controller's name stands for, and when its file is read again."""

from __future__ import annotations

import hashlib
from types import SimpleNamespace

import pytest

from esea_gen.control.laws import LAWS
from esea_gen.device import load_device
from esea_gen.devices.file import shipped_controllers, shipped_devices
from esea_gen.errors import UserError
from esea_gen.twin import controllers as module
from esea_gen.twin.controllers import controller_device, controllers, largest_torque_Nm


@pytest.fixture
def asked(monkeypatch):
    """Each device that is asked for: its name, its controller, and what its text is known by."""
    given = []

    def device(name, controller, content):
        given.append((name, controller, content))
        return SimpleNamespace(laws=name != "sensor_only.toml", origin=name)

    monkeypatch.setattr(module, "_device", device)
    monkeypatch.setattr(module, "read_file", lambda name: (f"<{name}>", "origin"))
    return given


def test_controllers_are_the_elbow_s_drive_unless_a_device_is_named(asked, tmp_path):
    own, law = tmp_path / "own.toml", tmp_path / "mine.py"
    own.write_text("a", encoding="utf-8")
    law.write_text("b", encoding="utf-8")
    a, b = (hashlib.sha256(x).hexdigest() for x in (b"a", b"b"))
    drive = "elbow_drive"
    for controller, expected in (
        ("smc", (drive, "smc", f"<{drive}>")),
        ("smc,mpc", (drive, "smc,mpc", f"<{drive}>")),
        (str(own), (str(own), None, f"<{own}>")),
        (drive, (drive, None, f"<{drive}>")),
        ("smc@other.toml", ("other.toml", "smc", "<other.toml>")),
        (f"{own}@other.toml", ("other.toml", str(own), f"<other.toml>{a}")),
        (f"{law}:fast", (drive, f"{law}:fast", f"<{drive}>{b}")),
        (f"{law}:fast,{own}@x", ("x", f"{law}:fast,{own}", f"<x>{b}{a}")),
        (f"{tmp_path}/none.py:fast", (drive, f"{tmp_path}/none.py:fast", f"<{drive}>")),
    ):
        controller_device(controller)
        assert asked.pop() == expected
    # What a file holds is what it is known by.
    law.write_text("a", encoding="utf-8")
    controller_device(f"{law}:fast")
    assert asked.pop()[2] == f"<{drive}>{a}"
    with pytest.raises(UserError, match=r"sensor_only.toml: the device has no drive"):
        controller_device("sensor_only.toml")
    for wrong in ("odd", "smc,odd", "odd@other.toml"):
        with pytest.raises(UserError, match="odd"):
            controller_device(wrong)


def test_configurations_come_before_laws_and_none_twice():
    found = controllers()
    shipped = sorted(shipped_controllers())
    assert found[: len(shipped)] == shipped
    assert set(found) == set(shipped) | set(LAWS)
    assert len(set(found)) == len(found)
    assert "elbow_drive" in shipped_devices()


def test_a_drive_s_largest_torque():
    assert largest_torque_Nm(load_device("elbow_drive")) == 0.221
