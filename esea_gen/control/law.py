"""Definition of a control law: its Blocks, added to the common ones, and their wires.

A law is one file.  Shipped laws in ``control/laws`` register themselves; a law from outside the
package is named ``FILE.py:law`` wherever a law's name is accepted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from esea_gen.devices.file import DeviceData
from esea_gen.language.component import Component


@dataclass(frozen=True)
class Base:
    """Common parts that every law can use.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.
    blocks : mapping of str to Component
        Instances of every controlling System: ``encoder_motor``, ``encoder_load``, ``joint``,
        ``velocity``, ``sensor``, ``motor_rate``, ``load_rate``, ``reference``, ``limits``,
        ``drive``, ``human`` in the sensing task and ``stamp`` in the control task.
    inverse : callable
        Makes the torque sensor's inverse, for the laws that follow a deflection.
    """

    device: DeviceData
    blocks: Mapping[str, Any]
    inverse: Callable[[], Component]

    @property
    def control_period_s(self) -> float:
        """Period of the control task."""
        return float(self.blocks["stamp"].period_s)


@dataclass(frozen=True)
class Parts:
    """Parts that a law adds.

    Parameters
    ----------
    control : mapping of str to Component
        Its Blocks in the control task, in order.
    command : str
        Where its motor torque comes from: ``"smc.u_command_Nm"``.
    sense : mapping of str to Component
        Its Blocks in the sensing task, behind the reference and before the limits.
    after_limits : mapping of str to Component
        Likewise, behind the observers, which read what the limits have let through.
    replaced : mapping of str to Component
        Instances of :class:`Base` that it wants otherwise, such as with one more output.
    wires : mapping of str to str
        ``{"smc.delta_rad": "joint.theta_rad"}``: reader from writer.  An input that is not named
        here is fed by the signal of its name (:data:`esea_gen.control.system.SIGNALS`).
    signals : mapping of str to str
        Further signals for its own Blocks, by port name.
    inputs : mapping of str to tuple of str
        Further external inputs.
    setpoints : mapping of str to str
        Further external outputs of the sensing task.
    outputs : mapping of str to str
        Further external outputs of the control task.
    request_ok : str
        Output that says whether what the law was asked for is sound, where it checks that itself.
    """

    control: Mapping[str, Component]
    command: str
    sense: Mapping[str, Component] = field(default_factory=dict)
    after_limits: Mapping[str, Component] = field(default_factory=dict)
    replaced: Mapping[str, Component] = field(default_factory=dict)
    wires: Mapping[str, str] = field(default_factory=dict)
    signals: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    setpoints: Mapping[str, str] = field(default_factory=dict)
    outputs: Mapping[str, str] = field(default_factory=dict)
    request_ok: str = ""

    @property
    def own(self) -> dict[str, Component]:
        """All the Blocks that it adds."""
        return {**self.sense, **self.control, **self.after_limits}


@dataclass(frozen=True)
class Law:
    """A control law.

    Parameters
    ----------
    name : str
        Lower case C identifier; what ``laws`` in a device file and ``--controller`` name.
    title : str
        One line for lists and reports.
    parts : callable
        From :class:`Base` to :class:`Parts`.
    section : str
        Section of the device file that it takes its numbers from; empty when it needs none.
    digest : str
        SHA-256 of the file that it comes from, for one from outside the package.
    path : Path, optional
        That file.
    content : bytes
        What stands in it.
    """

    name: str
    title: str
    parts: Callable[[Base], Parts]
    section: str = ""
    digest: str = ""
    path: Path | None = None
    content: bytes = field(default=b"", repr=False)
