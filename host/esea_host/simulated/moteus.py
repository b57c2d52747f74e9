"""An emulated moteus drive behind a pseudo terminal, with the virtual exoskeleton at its shaft.

It replaces fdcanusb adapter, drive, motor and joint: the board's program opens its terminal.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from esea_gen.board.moteus import MoteusDrive
from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.twin.people import PLANT_NAMES
from esea_gen.twin.run import plant_variant
from esea_gen.twin.stepped import SteppedTwin
from esea_host.connection.opening import require_device
from esea_host.simulated.drive import CLAMPED, EMPTY_JOINT, PLANT, known, named_person
from esea_host.simulated.server import IDLE_S, Terminal

TICK_S, SILENCE_S = 1e-3, 0.01
END_S = 10.0  # for a program to end by itself


class MoteusJoint:
    """Drive, motor, gear, coupling and person of a device with one axis."""

    def __init__(
        self,
        device: str,
        plant: str = PLANT,
        person: str = EMPTY_JOINT,
        seed: int = 0,
        rotor_side: bool = False,
    ) -> None:
        loaded = load_device(device)
        actuator = loaded.file.actuator
        require_device(loaded, lambda d: bool(d.laws) and len(d.axes) == 1, "has not one motor")
        assert actuator is not None
        self.gear = actuator.gear_ratio.value
        self._bits = 1 << int(loaded.file.encoder.resolution_bits.value)
        self._gear_bits = 1 << int(actuator.encoder_bits.value)
        self.drive = MoteusDrive({"motor_position.rotor_to_output_ratio": f"{1 / self.gear:.9f}"})
        variant = plant_variant(loaded, known("plant", plant, PLANT_NAMES), "ideal", seed)
        self.plant, self.rotor_side = SteppedTwin(variant), rotor_side
        who = named_person(loaded, person, seed)
        self._rotor = self._last = 0  # counts of the rotor, over all its turns
        counts = self.plant.start([0.0], clamped=person == CLAMPED, person=who)
        self._last = counts["count_gear"]
        self.show(counts)

    def show(self, counts: Mapping[str, int]) -> None:
        """Have the drive's encoders read these."""
        motor, load, gear = (counts[f"count_{side}"] for side in ("motor", "load", "gear"))
        half = self._gear_bits // 2
        self._rotor += (gear - self._last + half) % self._gear_bits - half
        self._last = gear
        turned = self._rotor / self._gear_bits
        side = None if self.rotor_side else motor / self._bits
        self.drive.show(turned / self.gear, (gear / self._gear_bits, load / self._bits, side))

    def tick(self) -> None:
        """A millisecond of drive and plant."""
        self.drive.advance(TICK_S)
        self.move()

    def move(self) -> None:
        """A millisecond of the plant alone."""
        self.show(self.plant.step([self.drive.torque_Nm / self.gear]))


def serve_drive(joint: MoteusJoint, line: Terminal, ends: Callable[[], bool]) -> None:
    """Answer requests: a line is a millisecond of the joint, as a board sends one each tick.

    So a busy computer slows both alike.  In silence the computer's time goes on, and the drive's
    watchdog with it.
    """
    heard, last_s = b"", time.monotonic()
    while not ends():
        *lines, heard = (heard + (line.read() or b"")).split(b"\n")
        for text in lines:
            line.write(joint.drive.line(text.decode("ascii", "replace")).encode())
            joint.tick()
        silence_s = time.monotonic() - last_s
        if lines:
            last_s = time.monotonic()
        elif silence_s > SILENCE_S:
            joint.tick()
            last_s += TICK_S
        else:
            time.sleep(IDLE_S)


@contextmanager
def run_board(program: Path | None, line: str, rotor_side: bool) -> Iterator[Callable[[], bool]]:
    """Run the firmware on this line meanwhile; yield whether it has ended by itself."""
    if program is None:
        yield lambda: False
        return
    command = [str(program.resolve()), "tcp:0", "--drive", f"serial:{line}"]
    try:
        board = subprocess.Popen([*command, *(["--rotor-side"] if rotor_side else [])])
    except OSError as error:
        raise UserError(
            f"{program} does not run: {error.strerror}.",
            "Build it: esea-gen firmware DEVICE --board linux --out out.",
        ) from None
    try:
        yield lambda: board.poll() is not None
    finally:
        board.terminate()  # it then prints how late it woke up
        try:
            board.wait(END_S)
        except subprocess.TimeoutExpired:
            board.kill()
            board.wait()
