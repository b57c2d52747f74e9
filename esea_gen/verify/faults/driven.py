"""Faults below the inputs: the real drivers on models of their chips; power cut while storing."""

from __future__ import annotations

from collections.abc import Sequence

from esea_gen.board.driven import BUS_FAULTS, CURRENT_FAULTS, MAGNET_FAULTS, DrivenSensors
from esea_gen.device import Device
from esea_gen.emit.states import BOARD_FAULTS
from esea_gen.errors import UserError
from esea_gen.verify.faults.kinds import BoardFault
from esea_gen.verify.faults.rig import AFTER, FaultRig, FaultScene, Felt

STORE = "store"
_CURRENT = next(f.value for f in BOARD_FAULTS if f.name == "MOTOR_CURRENT")
_PARAMETER, _OLD, _NEW = "velocity.bandwidth_Hz", 16.0, 14.0
_SHARES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)  # of the bytes that a save changes


def driver_faults() -> list[BoardFault]:
    """One of each; a magnet is there where an encoder has one."""
    sides = [("encoder motor", k) for k in (*BUS_FAULTS, *MAGNET_FAULTS)]
    sides += [("encoder load", k) for k in (*BUS_FAULTS, *MAGNET_FAULTS)]
    sides += [("encoder gear", k) for k in BUS_FAULTS]
    sides += [("current", k) for k in CURRENT_FAULTS]
    cuts = [BoardFault(STORE, "power cut", share) for share in _SHARES]
    return [BoardFault(where, kind) for where, kind in sides] + cuts


def below_the_inputs(fault: BoardFault) -> bool:
    """Whether it is one of these."""
    return fault.place in (STORE, "current") or fault.place.startswith("encoder ")


class DrivenRig(FaultRig):
    """The board in the loop with its drivers between plant and application."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self.sensors = DrivenSensors(device)

    def run(
        self,
        scene: FaultScene,
        fault: BoardFault | None,
        at: int,
        seed: int,
        ticks: Sequence[int] = (AFTER, AFTER),
    ) -> Felt:
        """See :class:`FaultRig`; of a cut the drive is flown afterwards, and must be sound."""
        self.board.restart(blank=True)
        self.sensors.start()
        if fault is not None and fault.place == STORE:
            self._cut(fault.amount)
            fault = None
        return super().run(scene, fault, at, seed, ticks)

    def _measure(self, readings: dict[str, float]) -> None:
        sensors, board = self.sensors, self.board
        board.measure(**readings | sensors.read(readings))
        if sensors.current_wrong():
            board.trouble(_CURRENT)

    def _strike(self, fault: BoardFault) -> None:
        self.sensors.break_(fault.place, fault.kind)

    def _tick(self, fault: BoardFault | None, age: int) -> None:
        super()._tick(None, age)
        self.sensors.drive(*self.board.motor)

    def _cut(self, share: float) -> None:
        # A save whose last bytes do not come; bytes of a set go from the lowest address up.
        board = self.board
        board.set_parameter(_PARAMETER, _OLD)
        board.save_parameters()
        before = [bytes(a) for a in board.flash]
        board.set_parameter(_PARAMETER, _NEW)
        board.save_parameters()
        after = [bytes(a) for a in board.flash]
        changed = [
            (k, i)
            for k, (old, new) in enumerate(zip(before, after, strict=True))
            for i in range(len(old))
            if old[i] != new[i]
        ]
        for k, i in changed[round(share * len(changed)) :]:
            board.flash[k][i] = before[k][i : i + 1]
        board.restart()
        found = board.parameter(_PARAMETER)
        if found not in (_OLD, _NEW):
            raise UserError(
                f"Power cut after {share:.0%} of a save: {_PARAMETER} came back as {found:g}.",
                "The store mixes sets: see firmware/app/store.c.",
            )
