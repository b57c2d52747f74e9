"""The elements of the comparison as device files, and the virtual rig: a wrist turns a handle.

The rig has no motor, so the other end of the element is fixed.  Its law is assumed to be that of
the torque sensor.  Mass of the handle is assumed.  Simulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from esea_gen.board.sim import SimBoard
from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.language.system import System, Task
from esea_host.interaction import tasks
from esea_host.interaction.loading import LoadingCurve, LoadingProtocol, analyse_loading
from esea_host.people.hand import MovingHand, shape
from esea_host.people.person import Limb, VirtualParticipant
from esea_host.study.scene import Scene
from esea_host.study.task import Inputs, Situation

HANDLE_KGM2 = 0.001
STEPS = 10  # of 1 ms in a frame of 10 ms
RUNS = ("READY", "UNREFERENCED", "ARMED", "ACTIVE", "LETTING_GO", "STOPPING", "STOPPED")


def law_ends(element: str) -> tuple[float, float]:
    """How far the element's law goes, rad, and its full scale, Nm."""
    device = element_device(element)
    return float(device.sensor.inputs[0].high), float(device.file.domain.tau_full_scale_Nm.value)


@lru_cache(maxsize=8)
def _law(device: Device) -> HostLibrary:
    inputs = {"theta_rad": ("sensor.theta_rad",), "omega_rad_s": ("sensor.omega_rad_s",)}
    blocks, task = {"sensor": device.sensor}, Task("bend", ("sensor",))
    outputs = {"tau_Nm": "sensor.tau_Nm"}
    name, period = f"{device.name}_law", device.period_s
    return compile_system(System(name, period, blocks, (task,), {}, inputs, outputs), "f64")


class CoupledLimb:
    """A limb that holds a handle on an element whose other side is fixed; from zero."""

    def __init__(self, device: Device, limb: Limb) -> None:
        library = self._library = _law(device)
        prefix, ffi = library.prefix, library.ffi
        self._bend = library.function(f"{prefix}_bend_step")
        self._state = ffi.new(f"{prefix}_state_t *")
        library.function(f"{prefix}_init")(self._state)
        self._in, self._out = ffi.new(f"{prefix}_bend_in_t *"), ffi.new(f"{prefix}_bend_out_t *")
        self._h, self._limb = device.period_s, limb
        self._inertia_kgm2 = limb.inertia_kgm2 + HANDLE_KGM2
        self.theta_rad = self.omega_rad_s = self.tau_Nm = 0.0
        self.deflection_rad = self.deflection_rad_s = 0.0

    def step(self, muscle: Sequence[float], share: float) -> None:
        h, given, theta, omega = self._h, self._in, self.theta_rad, self.omega_rad_s
        given.theta_rad, given.omega_rad_s = self.deflection_rad, self.deflection_rad_s
        self._bend(self._state, given, self._out)
        self.tau_Nm = tau = self._out.tau_Nm
        hand = self._limb.torque_Nm(theta, omega, muscle, share, STEPS * h)
        self.omega_rad_s = omega = omega + h * (hand + tau) / self._inertia_kgm2
        self.theta_rad = theta + h * omega
        self.deflection_rad_s = -omega
        self.deflection_rad += h * self.deflection_rad_s


class ElementRig:
    """A wrist on the rig, which the firmware's application senses.

    Each millisecond the application on the board ``sim`` reads the encoder, in whole counts, and
    runs whole: schedule, latches, tasks, main loop.  What is known of torque and angle is what it
    makes of that.  The element itself has its law's torque at its true deflection.
    """

    def __init__(self, element: str, limb: Limb) -> None:
        self.element, self._limb, self.device = element, limb, element_device(element)
        self.board = SimBoard(self.device)
        self._count_rad = 2 * math.pi / 2**self.device.file.encoder.resolution_bits.value
        self._most_rad, _ = law_ends(element)
        self._at = self.board.places["theta_rad"], self.board.places["tau_Nm"]
        self.start()

    def start(self) -> None:
        """From rest at zero, the board just powered on."""
        self.wrist = CoupledLimb(self.device, self._limb)
        self.board.restart()

    @property
    def theta_rad(self) -> float:
        return -float(self.board.values[self._at[0]])

    @property
    def tau_Nm(self) -> float:
        return float(self.board.values[self._at[1]])

    def advance(self, muscle: Sequence[float]) -> list[float]:
        """A frame; the board's angle at each of its milliseconds."""
        board, wrist, read = self.board, self.wrist, []
        for k in range(STEPS):
            wrist.step(muscle, (k + 1) / STEPS)
            # Motor side minus load side; the motor side stands still.
            counts = round(wrist.deflection_rad / self._count_rad)
            board.drivers[0] = counts * self._count_rad
            board.step()
            read.append(self.theta_rad)
        if board.state_now not in RUNS:
            raise UserError(
                f"The simulated board of {self.device.name} is {board.state_now}.",
                "Its angle and torque are not valid; start the session again.",
            )
        if abs(wrist.theta_rad) > self._most_rad:
            raise UserError(
                f"The {self.element} is bent by {math.degrees(wrist.theta_rad):.1f} deg, its law "
                f"ends at {math.degrees(self._most_rad):.1f} deg.",
                "Ask people for less motion.",
            )
        return read


def compile_rig(element: str) -> None:
    """Once, before the processes start."""
    _law(element_device(element))
    SimBoard(element_device(element)).close()


# Thesis section 6.4, Nm/deg.
PUBLISHED_NM_DEG = {"spring": 0.0502, "elastomer": 0.0480}
ELEMENTS = ("spring", "elastomer", "equal")  # equal: an ideal spring as stiff as the elastomer


@cache
def element_device(element: str) -> Device:
    """The element as a device of the generator, read once a process."""
    return load_device(Path(__file__).parent / "devices" / f"rig_{element}.toml")


@lru_cache(maxsize=8)
def simulated_loading(device: Device, protocol: LoadingProtocol | None = None) -> LoadingCurve:
    """The protocol run on the device's torque model: simulated, not measured."""
    _, theta, omega = (protocol or LoadingProtocol()).motion(1 / device.period_s)
    found, _ = device.sensor.simulator().run({"theta_rad": theta, "omega_rad_s": omega})
    return analyse_loading(theta, np.ravel(found["tau_Nm"]))


# Nobody is asked for more than in the familiarisation.
MOST_DEG = 10.0
# Nobody hurries the paddle more than this before the ball comes; assumed.
LEAST_TIME_S = 0.5
# A paddle that has left the screen for so long is brought back; assumed.
LOST_S = 3.0


class RigPlayer(MovingHand):
    def __init__(
        self,
        who: VirtualParticipant,
        advance: Callable[[Sequence[float]], list[float]],
        aims: list[float],
        situation: Situation,
        paused: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(who, aims, HANDLE_KGM2)
        self.advance, self.asked = advance, situation.parameters
        self.read: list[float] = []
        self.waited: list[bool] = []
        self._paused = paused
        self._lost_since_s: float | None = None

    def move(self, muscles: Sequence[Sequence[float]], requests: Mapping[str, float]) -> Inputs:
        """A frame of the rig; the encoder's milliseconds are kept."""
        new = self.advance(muscles[0])
        self.read += new
        self.waited += [self._paused()] * len(new)
        long = self._lost_since_s is not None and self.time_s - self._lost_since_s > LOST_S
        return {"theta_rad": self.read[-1], "recentre": float(long)}

    def pointed_deg(self, scene: Scene, across: float, up: float) -> tuple[float, ...]:
        """Across is the angle; in the game, where the angle is a speed, up is."""
        if isinstance(self.asked, tasks.TrackingParameters):
            return (min(max(across, -1.0), 1.0) * tasks.screen_deg(self.asked.target),)
        return (min(max(up, -1.0), 1.0) * MOST_DEG,)

    def look(self, scene: Scene) -> None:
        """Position of the hand on the screen, and whether the paddle is shown."""
        super().look(scene)
        cursor = shape(scene, "cursor")
        if cursor is None:
            return
        if isinstance(self.asked, tasks.TrackingParameters):
            self.feel((cursor.x * tasks.screen_deg(self.asked.target),))
            return
        lost = min(abs(cursor.y), abs(cursor.to_y)) > 1 and cursor.y * cursor.to_y > 0
        if not lost:
            self._lost_since_s = None
        elif self._lost_since_s is None:
            self._lost_since_s = self.time_s

    def plan(self, axis: int, scene: Scene, aims_then: tuple[float, ...]) -> None:
        if isinstance(self.asked, tasks.TrackingParameters):
            self._follow(self.asked, scene, aims_then[0])
        elif isinstance(self.asked, tasks.PongParameters):
            self._play(self.asked, scene)

    def _follow(self, asked: tasks.TrackingParameters, scene: Scene, aim_then: float) -> None:
        target, cursor = shape(scene, "target"), shape(scene, "cursor")
        if target is None or cursor is None:
            return
        m, deg = self.who.model, tasks.screen_deg(asked.target)
        # On by what the target has moved since it was seen, and will move during half of the way.
        ahead = self.speed_seen("target")[0] * (m.delay_s + m.submovement_s / 2)
        wanted = deg * (target.x + ahead - cursor.x) / self.who.gain[0]
        # What has been commanded since that was seen, and what is still to come of it.
        wanted -= self.end(0) - aim_then
        self.correct(0, wanted, m.submovement_s)

    def _play(self, asked: tasks.PongParameters, scene: Scene) -> None:
        # The angle of the wrist is the paddle's speed: chosen so that it meets the ball.
        ball, paddle = shape(scene, "target"), shape(scene, "cursor")
        if ball is None or paddle is None:
            return
        m = self.who.model
        y = (paddle.y + paddle.to_y) / 2 + self.speed_seen("cursor")[1] * m.delay_s
        speed_x, speed_y = self.speed_seen("target")
        goal, left_s = 0.0, 1.0
        if speed_x < 0:
            left_s = (ball.x - tasks.PADDLE_X) / -speed_x - m.delay_s
            goal = _folded(ball.y + speed_y * (left_s + m.delay_s), 1.0 - asked.half_ball)
        speed = (goal - y) / max(left_s - m.submovement_s / 2, LEAST_TIME_S)
        theta = math.degrees(speed * asked.half_screen * tasks.DAMPING_NMS_RAD)
        theta = min(max(theta, -MOST_DEG), MOST_DEG)
        self.correct(0, theta / self.who.gain[0] - self.end(0), m.submovement_s)


def _folded(y: float, high: float) -> float:
    # Where a ball is that bounces between the walls at -high and high.
    period = 4.0 * high
    x = (y + high) % period
    return (x if x <= 2 * high else period - x) - high
