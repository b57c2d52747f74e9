"""The simulated board behind a socket or a pseudo terminal, and somebody at the virtual machine."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import queue
import secrets
import select
import socket
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from esea_gen.errors import UserError
from esea_gen.portability import TERMINALS, other_end_left, raw_terminal_pair
from esea_gen.twin.published import Person
from esea_gen.twin.stepped import EMPTY
from esea_host.simulated.drive import SimulatedBoard

MOST_BACKLOG_BYTES = 1 << 18
MOST_TICKS = 50  # between two looks at the line
IDLE_S = 0.0005
MOST_PUSH_RAD, MOST_AIM_RAD = 1.0, 3.0
SETTLE_TICKS, ZERO_TICKS = 300, 500
GUEST_S, MOST_GUEST_BYTES = 1.0, 4096  # for which somebody beside the host is heard


class _Socket:
    def __init__(self, link: socket.socket) -> None:
        link.setblocking(False)
        self._link = link

    def leaves(self) -> bool:
        return other_end_left(self._link)

    def read(self, most: int = 65536) -> bytes | None:
        try:
            return self._link.recv(most) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> int:
        try:
            return self._link.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def close(self) -> None:
        self._link.close()


class _Guests:
    # Who comes while a host is there: is told who commands, a stop of theirs is taken, and they are
    # let go.

    def __init__(self, drive: SimulatedBoard, listener: socket.socket) -> None:
        self._drive, self._listener = drive, listener
        self._here: dict[int, tuple[_Socket, float, int]] = {}

    def attend(self, host: _Socket, commander: str) -> None:
        for _ in range(self._drive.board.guests):
            try:
                # In this order: who is seen only after the host has left is the next host.
                if not select.select([self._listener], [], [], 0.0)[0] or host.leaves():
                    break
                came, _ = self._listener.accept()
            except (OSError, ValueError):  # the listener was closed
                break
            self._admit(_Socket(came), commander)
        for place in list(self._here):
            self._hear(place)

    def _admit(self, line: _Socket, commander: str) -> None:
        free = set(range(self._drive.board.guests)) - set(self._here)
        place = min(free) if free else min(self._here, key=lambda p: self._here[p][1])
        if not free:  # who came first has been heard
            self._hear(place)
            self._let_go(place)
        self._here[place] = line, time.monotonic() + GUEST_S, 0
        line.write(self._drive.board.greet(place, commander))

    def _hear(self, place: int) -> None:
        line, until_s, count = self._here[place]
        data = line.read(512)
        last = data is None or count > MOST_GUEST_BYTES or time.monotonic() > until_s
        line.write(self._drive.board.overhear(place, data or b"", last))
        self._here[place] = line, until_s, count + len(data or b"")
        if last:
            self._let_go(place)

    def _let_go(self, place: int) -> None:
        if place in self._here:
            self._here.pop(place)[0].close()

    def close(self) -> None:
        for place in list(self._here):
            self._hear(place)
            self._let_go(place)


class Terminal:
    def __init__(self) -> None:
        self._ours, self._theirs, self.name = raw_terminal_pair()

    def read(self) -> bytes | None:
        try:
            return os.read(self._ours, 65536)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> int:
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)


def serve(
    device: str,
    port: int | None,
    *,
    plant: str | None = None,
    person: str | None = None,
    motion: str | None = None,
    seed: int = 0,
    speed: float = 1.0,
    board: str = "sim",
    zeroed: bool = False,
    once: bool = False,
    say: Callable[[str], None] | None = None,
    hands: int | None = None,
    spring_Nm_rad: float = 0.0,
) -> None:
    if not 0 <= speed <= 1000:
        raise UserError(f"Invalid speed {speed:g}.", "Give 0 (as fast as it is read) to 1000.")
    tell = say or (lambda text: print(text, flush=True))
    drive = SimulatedBoard(device, plant, person, seed, board, motion, spring_Nm_rad)
    named = drive.device.name
    if f"{device}_board" == named:
        named += f", as {device} has no encoders of its own,"
    try:
        drive.board.lib.sim_unique(1 + secrets.randbelow((1 << 32) - 1))
        drive.restart()  # what was said to another one does not fit this start
        if zeroed:
            _zero(drive)
        if port is None and not TERMINALS:
            tell("This system has no pseudo terminals: TCP in place of one.")
            port = 0
        by = "" if drive.device.shipped and "@" not in device else f" --device {device}"
        if port is None:
            terminal = Terminal()
            tell(f"simulated {named} at pty:{terminal.name}")
            tell(f"See it: esea-host view pty:{terminal.name}{by}")
            _play(drive, terminal, speed, Hands(hands))
            return
        with socket.create_server(("127.0.0.1", port)) as listener:
            at = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
            tell(f"simulated {named} at {at}")
            tell(f"See it: esea-host view {at}{by}")
            serve_hosts(drive, listener, speed, once, Hands(hands))
    finally:
        drive.close()


def _zero(drive: SimulatedBoard) -> None:
    for _ in range(SETTLE_TICKS):
        drive.tick()
    drive.board.zero()
    for _ in range(ZERO_TICKS):
        drive.tick()
    if drive.board.state_now != "READY":
        raise UserError("The simulated joint does not stand still: it cannot be zeroed.", "")
    drive.read()  # nobody has listened


class Hands:
    """Actions of a person at the virtual machine: lines of text, read without waiting.

    ``push RAD ...``, ``lead RAD ...``: the joint, a number an axis; ``aim RAD``: the arm; ``hang
    NM``: a mass, the motor held; ``let-go 0``: it is taken off; ``spring NM_RAD``: 0: elastomer.
    """

    def __init__(self, source: int | None) -> None:
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._attendant: Attendant | None = None
        if source is not None:  # in a thread: Windows has no pipes that do not wait
            threading.Thread(target=self._listen, args=(source,), daemon=True).start()

    def _listen(self, source: int) -> None:
        rest = b""
        with contextlib.suppress(OSError):
            while data := os.read(source, 4096):
                *lines, rest = (rest + data).split(b"\n")
                for line in lines:
                    self._lines.put(line)

    def reach(self, drive: SimulatedBoard) -> None:
        while not self._lines.empty():
            word, *texts = self._lines.get().decode("ascii", "replace").split() or [""]
            try:
                numbers = [float(n) for n in texts]
            except ValueError:
                continue
            self._do(drive, word, numbers)

    def _do(self, drive: SimulatedBoard, word: str, numbers: list[float]) -> None:
        fits = len(numbers) == len(drive.pushes_rad)
        if word in ("push", "lead") and fits and all(abs(p) <= MOST_PUSH_RAD for p in numbers):
            drive.pushes_rad, drive.led = numbers, word == "lead"
        if len(numbers) != 1 or len(drive.axes) != 1 or drive.passive:
            return
        self._attendant = self._attendant or Attendant(drive)
        most = dict.fromkeys(("let-go", "spring"), math.inf)
        most |= {"aim": MOST_AIM_RAD, "hang": drive.device.tau_full_scale_Nm}
        if abs(numbers[0]) <= most.get(word, -1.0):
            with contextlib.suppress(UserError):  # a spring that no coupling has
                self._attendant.do(word, numbers[0])


def serve_hosts(
    drive: SimulatedBoard,
    listener: socket.socket,
    speed: float,
    once: bool,
    hands: Hands | None = None,
) -> None:
    """One host at a time; between two the board runs on, in real time, and hears nobody."""
    guests = _Guests(drive, listener)
    while True:
        try:
            listener.settimeout(0.01)
            link, (host, port) = listener.accept()
        except OSError as error:
            if not isinstance(error, TimeoutError):
                return  # the listener was closed
            for _ in range(10):
                drive.tick()
            drive.read()
            continue
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line = _Socket(link)
        try:
            _play(drive, line, speed, hands, partial(guests.attend, line, f"{host}:{port}"))
        finally:
            line.close()
            guests.close()
        if once:
            return


def _play(
    drive: SimulatedBoard,
    line: _Socket | Terminal,
    speed: float,
    hands: Hands | None,
    attend: Callable[[], None] = lambda: None,
) -> None:
    # Until the host has gone.
    backlog = bytearray()
    started_s, first = time.monotonic(), drive.ticks
    while True:
        data = line.read()
        if data is None:
            return
        if data:
            drive.write(data)
        attend()
        if hands is not None:
            hands.reach(drive)
        due = MOST_TICKS
        if speed:
            due = int((time.monotonic() - started_s) * 1000 * speed) - (drive.ticks - first)
        elif len(backlog) > MOST_BACKLOG_BYTES // 8:
            due = 0
        for _ in range(min(due, MOST_TICKS)):
            drive.tick()
        backlog += drive.read()
        sent = line.write(bytes(backlog)) if backlog else 0
        del backlog[:sent]
        # Like a serial line that nobody empties: what comes now has no room.
        if len(backlog) > MOST_BACKLOG_BYTES:
            del backlog[MOST_BACKLOG_BYTES // 2 :]
        if due <= 0 or (not sent and not due):
            time.sleep(IDLE_S)


# A mass that hangs pulls with the same torque wherever the joint is; somebody holds the motor.
HANGING = dataclasses.replace(
    EMPTY, spring_Nm_rad=1.0, own_damping_Nms_rad=2.0, damping_Nms_rad=0.0, gravity_Nm=0.0
)
LOCKED = {"fc_Nm": 100.0, "coulomb_width_rad_s": 2e-3, "fv_Nms_rad": 100.0, "J_kgm2": 100.0}
LAID_ON_TICKS = 100
# An elbow that is held firmly while it is led; assumed.
FIRM_NM_RAD, FIRM_NMS_RAD = 40.0, 4.0
AIM_TICKS = 10  # from one aim to the next: a frame of a study


class Attendant:
    """Performs at the virtual machine the actions of a person at a real one."""

    def __init__(self, drive: SimulatedBoard, seed: int = 0) -> None:
        self.drive = drive
        self._hung_Nm = 0.0
        self._noise = np.random.default_rng([seed, 5])
        self._aim: tuple[float, float, int] | None = None  # place, step, steps left

    def do(self, word: str, number: float) -> None:
        """Do something by its word, as :class:`Hands` has them."""
        acts = {"aim": self.aim, "hang": self.hang, "spring": self.drive.build_in}
        acts.get(word, self.let_go)(number)

    def hang(self, load_Nm: float) -> None:
        """Fix the motor, nobody in the joint, and hang a mass on it smoothly; 0: no mass."""
        now_Nm, self._hung_Nm, self._aim = self._hung_Nm, load_Nm, None

        def pulling() -> Mapping[str, float]:
            nonlocal now_Nm
            now_Nm += (load_Nm - now_Nm) / LAID_ON_TICKS
            at = float(self.drive.plant.truth()["theta_l_rad"])
            return led_path(at + now_Nm / HANGING.spring_Nm_rad)

        self.drive.set_up(person=HANGING, hand=pulling, values=LOCKED)

    def let_go(self, _: float = 0.0) -> None:
        """Release the motor; the original person holds the joint at its present angle."""
        self._hung_Nm = 0.0
        self._lead()

    def aim(self, aim_rad: float) -> None:
        """The person moves no longer to and fro, but to this angle within the next frame."""
        at_rad = self._lead() if self._aim is None else self._aim[0]
        self._aim = at_rad, (aim_rad - at_rad) / AIM_TICKS, AIM_TICKS

    def _lead(self) -> float:
        at_rad = float(self.drive.plant.truth()["theta_l_rad"])
        person, clamped = self.drive.first_person
        assert isinstance(person, Person)
        firm = dataclasses.replace(person, spring_Nm_rad=FIRM_NM_RAD, damping_Nms_rad=FIRM_NMS_RAD)
        self.drive.set_up(clamped=clamped, person=firm, hand=self._led)
        self._aim = at_rad, 0.0, 0
        return at_rad

    def _led(self) -> Mapping[str, float]:
        assert self._aim is not None
        at, step, left = self._aim
        moves = left > 0
        self._aim = at + moves * step, step, left - moves
        return led_path(
            self._aim[0], 1e3 * step * moves, noise=float(self._noise.standard_normal())
        )


def led_path(
    theta_rad: float, omega_rad_s: float = 0.0, alpha_rad_s2: float = 0.0, noise: float = 0.0
) -> dict[str, float]:
    """Where somebody leads the hand, as the virtual plant takes it."""
    speed = {"omega_p_rad_s": omega_rad_s, "alpha_p_rad_s2": alpha_rad_s2}
    return {"theta_p_rad": theta_rad, **speed, "noise": noise}
