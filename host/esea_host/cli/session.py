"""``study run`` and ``study resume``: a session, in its windows or without."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from esea_gen.cli.options import option
from esea_gen.errors import UserError
from esea_gen.portability import command_line
from esea_host.cli.app import out
from esea_host.cli.options import KeyOption
from esea_host.cli.study import (
    CodeArgument,
    FolderArgument,
    OperatorOption,
    SessionOption,
    TrustOption,
    opened,
    study_app,
)
from esea_host.cli.view import need_a_screen

if TYPE_CHECKING:
    from esea_gen.device import Device
    from esea_host.connection import ConnectedDevice
    from esea_host.people.hand import Pointer
    from esea_host.people.person import VirtualParticipant
    from esea_host.study.folder import StudyFolder
    from esea_host.study.session import SessionState, StudySession
    from esea_host.study.source import InputSource
    from esea_host.wrist.virtual import VirtualPerson

INTERACTION = "interaction."
PatchMode = Literal["off", "frame", "onset"]
SIMULATED, VIRTUAL, POINTER = "simulated", "virtual", "pointer"


DeviceOption = Annotated[
    str | None,
    option(
        "--device",
        "A study of real people has no default. simulated: each task's own person; virtual: "
        "a person in the virtual device; pointer: you, moving that person's hand with the mouse; "
        "or a board: serial:..., tcp:..., sim:wrist_drive with a person in it",
    ),
]
HeadlessOption = Annotated[bool, option("--headless", "Show no windows.")]
SeedOption = Annotated[
    int | None, option("--seed", "Seed of the simulated person; default: 1.", min=0)
]
SpeedOption = Annotated[
    float, option("--speed", "With windows: simulated over real time.", min=0.1)
]
DarkOption = Annotated[
    bool | None, option("--dark/--light", "Default: dark; operator's: the desktop's theme.")
]
MassOption = Annotated[
    float | None, option("--mass", "Known mass, kg, to confirm the board's element.", min=0.01)
]


@dataclass(frozen=True)
class _AskedSession:
    """The requested session; number: of the session, from 0."""

    study: StudyFolder
    code: str
    number: int
    device: str
    key: Path | None
    arm: bool
    headless: bool
    seed: int
    speed: float
    language: str
    patch: PatchMode
    dark: bool | None
    close: bool
    hold: bool
    early: str
    mass: float | None
    lever: float | None
    log: Path
    rehearsal: bool
    opening: str

    def run(self) -> None:
        if self.key is not None and self.device in (SIMULATED, VIRTUAL, POINTER):
            raise UserError("--key needs a board, and --device is not one.", "Leave --key out.")
        if self.headless and self.device == POINTER:
            raise UserError("A pointer needs a window.", "Leave --headless out.")
        if not self.headless:
            need_a_screen("esea-host study run --headless")
        pointed = [(0.0, 0.0)]
        words = "study", "resume", f"{self.study.path}", self.code, "--session"
        on = command_line("esea-host", *words, f"{self.number + 1}")
        try:
            with ExitStack() as held:
                source, board = self._source(held, lambda: pointed[0])
                if not self.rehearsal and (told := self.study.disclose(self.code, self.opening)):
                    out.print(told)
                session = self._opened(source)
                if self.headless:
                    state, reason = self._without_windows(session)
                else:
                    state, reason = self._in_windows(session, board, pointed)
        except OSError as error:
            raise UserError(
                f"{error.filename or self.log}: {error.strerror or error}.",
                f"Earlier entries are intact. Correct the cause, then: {on}",
            ) from None
        if not self.rehearsal and self.device != SIMULATED and self.study.protocol.file.groups:
            _name_recordings(self.study)
        done = len(state.plan.trials) - len(state.remaining)
        whose = "REHEARSAL: " if self.rehearsal else ""
        whose += "Simulated participant: " if state.simulated else ""
        out.print(f"{whose}{done} of {len(state.plan.trials)} trials done.")
        if reason:
            fix = "Rehearse again." if self.rehearsal else f"Continue: {on}"
            what = f"The session ended early: {reason}{'' if reason[-1] in '.?' else '.'}"
            raise UserError(what, fix)

    def _opened(self, source: InputSource) -> StudySession:
        # Simulated people need no washout.
        day = None if self.study.simulated else date.today().toordinal()
        log = self.log if self.rehearsal else None
        names = ("device", "seed", "arm", "mass", "lever")  # with which resume goes on
        device = {n: x for n in names if (x := getattr(self, n)) is not None}
        return self.study.session(self.code, self.number, source, day, self.early, log, device)

    def _without_windows(self, session: StudySession) -> tuple[SessionState, str]:
        try:
            reason = session.run()
            self.study.finish(session)
        finally:
            session.close()
        return session.state, reason

    def _in_windows(
        self,
        session: StudySession,
        board: ConnectedDevice | None,
        pointed: list[tuple[float, float]],
    ) -> tuple[SessionState, str]:
        from esea_host.study.conductor import Conductor
        from esea_host.windows.study.running import run_windows

        # A board has its own clock: it is waited for anyhow.
        speed = self.speed if board is None else math.inf
        conductor = Conductor(self.study, session, speed, self.hold)

        def point(place: tuple[float, float]) -> None:
            pointed[0] = place

        run_windows(conductor, board, self.language, self.dark, self.patch, self.close, point)
        if conductor.error is not None:
            raise conductor.error
        if conductor.display is not None and (seen := conductor.display.take(True))["intervals"]:
            late = ", ".join(f"{k} %: {seen[f'interval_p{k}_ms']} ms" for k in (50, 99, 100))
            lost = f"{seen['dropped']} of {seen['intervals']} frames dropped"
            out.print(
                f"Participant's window: {lost} at {seen['refresh_Hz']:g} Hz; intervals {late}."
            )
        return conductor.state, conductor.reason

    def _source(
        self, held: ExitStack, pointer: Pointer
    ) -> tuple[InputSource, ConnectedDevice | None]:
        from esea_host.study.source import SimulatedSource

        if self.device == SIMULATED:
            return SimulatedSource(self.seed), None
        if self.device in (VIRTUAL, POINTER):
            source = self._virtual(pointer if self.device == POINTER else None)
            held.callback(source.close)
            return source, None
        from esea_host.cli.study import device_at
        from esea_host.connection import open_device
        from esea_host.study.board import BoardSource
        from esea_host.study.fitting import DeviceSignals, uses_of

        uses = uses_of(self.study.protocol)
        if self.device.startswith("sim:"):
            device = device_at(self.device)
            DeviceSignals(device).must_fit(uses)
            if all(task.name.startswith("wrist.") for task, _ in uses) and device.laws:
                source = self._worn(None, device)
                held.callback(source.close)
                return source, None
        board = held.enter_context(open_device(self.device, key=self.key))
        DeviceSignals(board.identity.device).must_fit(uses)
        if all(task.name.startswith(INTERACTION) for task, _ in uses):
            source = self._with_element(board)
        else:
            source = BoardSource(board, self.log.parent, self.arm)
        held.callback(source.close)
        return source, board

    def _with_element(self, board: ConnectedDevice) -> InputSource:
        from esea_gen.studies.torque_check.procedure import KnownLoad
        from esea_host.interaction.on_board import ElementBoard, process_hands

        if (self.mass is None) != (self.lever is None):
            raise UserError("A known load is a mass on a lever.", "Give both --mass and --lever.")
        given: dict[str, Any] = {}
        if self.mass is not None and self.lever is not None:
            given["known"] = KnownLoad(self.mass, self.lever)
        if board.address is not None and board.address.kind == "sim":
            given |= {"hands": process_hands(board), "who": self._person()}
        return ElementBoard(board, self.log.parent, self.arm, **given)

    def _virtual(self, pointer: Pointer | None) -> InputSource:
        from esea_host.interaction.virtual import RigSource

        tasks = {b.task for s in self.study.protocol.file.session for b in s.block}
        made: dict[str, Callable[[], InputSource]] = {
            "wrist.": lambda: self._worn(pointer),
            INTERACTION: lambda: RigSource(self._person(), self.log.parent, pointer),
        }
        for prefix, make in made.items():
            if all(t.startswith(prefix) for t in tasks):
                return make()
        raise UserError(
            f"There is no virtual device for {', '.join(sorted(tasks))}.",
            f"There is one for tasks that begin with {' or '.join(made)}; else --device simulated.",
        )

    def _person(self) -> VirtualParticipant:
        # As study virtual has them; what they learnt in an earlier session is not known here.
        from esea_host.people.person import PersonModel, person
        from esea_host.study.plan import generator

        index = self.study.participants().get(self.code, 0)
        return person(generator(self.seed, 4, index), PersonModel())

    def _worn(self, pointer: Pointer | None, device: Device | None = None) -> VirtualPerson:
        from esea_host.wrist.virtual import VirtualPerson

        return VirtualPerson(self._person(), self.log.parent, pointer, device)


@study_app.command(
    "resume", help="Show an interrupted session and continue it in the planned order."
)
@study_app.command("run")
def run(
    context: typer.Context,
    folder: FolderArgument,
    code: CodeArgument,
    session: SessionOption = 1,
    device: DeviceOption = None,
    key: KeyOption = None,
    arm: Annotated[bool, option("--arm", "Zero and arm the board first, at 0 Nm.")] = False,
    headless: HeadlessOption = False,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    language: Annotated[
        str, option("--language", "Windows' language: en, de; default: the protocol's.")
    ] = "",
    patch: Annotated[
        PatchMode, option("--patch", "Square for a photodiode: at every frame or onset.")
    ] = "off",
    dark: DarkOption = None,
    close: Annotated[bool, option("--close", "Close the windows at the end.")] = False,
    hold: Annotated[
        bool, option("--hold", "Wait for the operator after an incomplete calibration.")
    ] = False,
    early: Annotated[str, option("--early", "Reason to start before the washout is over.")] = "",
    mass: MassOption = None,
    lever: Annotated[
        float | None, option("--lever", "Distance of the mass from the joint, m.", min=0.01)
    ] = None,
    rehearsal: Annotated[
        bool, option("--rehearsal", "Rehearse with any device; gives no study data.")
    ] = False,
    opening: Annotated[
        str,
        option(
            "--open CODE",
            "First session: opening code of the participant's place, or the sealed list.",
        ),
    ] = "",
    trust: TrustOption = None,
    operator: OperatorOption = "",
) -> None:
    """Run a session: the participant's window and the operator's; Space, Escape or F12 stops."""
    from esea_host.study.session import read_session

    study = opened(folder, trust, operator=operator)
    study.protocol.words(language)  # refused before anything is written
    path, begun = study.log_of(code, session - 1), context.info_name == "resume"
    if rehearsal and begun:
        raise UserError("A rehearsal cannot be continued.", "Begin another: study run --rehearsal.")
    if rehearsal:
        path = study.new_rehearsal(session - 1)
    there = not rehearsal and study.begun(code, session - 1)
    if begun and not there:
        raise UserError(f"{code} has not begun session {session}.", "Begin it with study run.")
    if there and not begun:
        done = not read_session(path).remaining
        next_ = f"run {folder} {code} --session {session + 1}"
        if not done or session == len(study.protocol.file.session):
            next_ = f"resume {folder} {code} --session {session}"
        raise UserError(
            f"{code} has {'completed' if done else 'begun'} session {session} already.",
            f"Continue: esea-host study {next_}",
        )
    for change in study.changes():
        warnings.warn(f"{change}. esea-host study audit reports it.", stacklevel=2)
    if not begun or _remains(path):
        former = dict(read_session(path).about.get("device", {})) if begun else {}
        device = _device(study, device, former.get("device"), rehearsal)
        arm, seed = arm or bool(former.get("arm")), former.get("seed", 1) if seed is None else seed
        mass, lever = mass or former.get("mass"), lever or former.get("lever")
        _AskedSession(
            study, code, session - 1, device, key, arm, headless, seed, speed, language, patch,
            dark, close, hold, early, mass, lever, path, rehearsal, opening,
        ).run()  # fmt: skip


def _nobody(device: str) -> bool:
    return device in (SIMULATED, VIRTUAL, POINTER) or device.startswith("sim:")


def _device(study: StudyFolder, given: str | None, former: str | None, rehearsal: bool) -> str:
    # As the session was begun; a board may have got another address meanwhile.
    if given and former and given != former and (_nobody(given) or _nobody(former)):
        raise UserError(
            f"The session was begun with --device {former}, not {given}.",
            "Leave --device out: it continues with the same.",
        )
    device = given or former or (SIMULATED if study.simulated or rehearsal else "")
    if not device:
        raise UserError(
            f"{study.path} is a study of real people: no device is the default.",
            "Name the board: --device serial:... or tcp:...; to try the session out: --rehearsal.",
        )
    if not rehearsal and not study.simulated and _nobody(device):
        study.must_suit(simulated=True)
    return device


def _remains(path: Path) -> bool:
    # What an interrupted session holds, and whether anything is to do.
    from esea_host.study.session import read_session

    state = read_session(path)
    done = len(state.plan.trials) - len(state.remaining)
    out.print(f"{path}: {done} of {len(state.plan.trials)} trials are done.")
    if state.torn:
        out.print(f"A last event was cut off ({state.torn} bytes); it is set aside, not lost.")
    if state.running is not None:
        out.print(f"Trial {state.running} was running; it counts as aborted and is repeated.")
    if not state.remaining:
        out.print("The session is complete.")
        return False
    order = ", ".join(str(t.number) for t in state.remaining[:12])
    out.print(f"Remaining, as planned: {order}{', ...' if len(state.remaining) > 12 else ''}")
    return True


def _name_recordings(study: StudyFolder) -> None:
    # What the rig or the board has recorded, for analyse interaction.
    from esea_host.interaction.recordings import cut_trials, recording_name, write_manifest
    from esea_host.interaction.virtual import LAST_S

    cut_trials(study)
    if any(study.path.glob(f"*/session-*/{recording_name('*')}")):
        write_manifest(study.path, LAST_S)
