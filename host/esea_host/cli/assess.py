"""``assess``: probabilities of knee disorders, and the most informative movement."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from esea_gen.cli.groups import WholeSentences
from esea_gen.cli.options import FigureOption, JobsOption, option, writable
from esea_gen.errors import UserError
from esea_gen.files import refuse_copies, write_json, write_whole, written_whole
from esea_host.assess import MEASURED_NOTICE, NOTICE, Measure, Summary
from esea_host.cli.app import app, out, say, told
from esea_host.cli.options import DarkOption, JsonOption, KeyOption, output_file
from esea_host.cli.view import need_a_screen

if TYPE_CHECKING:
    from esea_host.assess.board import KneeBoard
    from esea_host.assess.patients import KneePatient
    from esea_host.assess.probing import Comfort
    from esea_host.connection import ConnectedDevice

assess = typer.Typer(
    cls=WholeSentences,
    help=f"Assess a knee: movement disorders, and the most informative next movement. {NOTICE}",
    no_args_is_help=True,
)
app.add_typer(assess, name="assess")

DataOption = Annotated[
    Path | None, option("--database FILE", "Database; default: the simulated knee's.")
]
BoardOption = Annotated[
    str | None,
    option(
        "--device ADDRESS",
        "Measure with a board: sim:knee, tcp:host:port, serial:/dev/..., pty:...",
    ),
]
ZeroOption = Annotated[
    bool, option("--zero", "Zero the board first: straight leg at rest, hands off.")
]
PatientOption = Annotated[
    str | None, option("--patient", "simulated:S3, simulated:S2+D4, simulated:rigid, or :any.")
]
SeedOption = Annotated[int, option("--seed", "Seed of the simulated patient.", min=0)]
HeightOption = Annotated[float, option("--height-m", "Body height, 1.0 to 2.3.")]
LowOption = Annotated[float, option("--from-deg", "Reach: least bending.")]
HighOption = Annotated[float, option("--to-deg", "Reach: most bending.")]
MassOption = Annotated[float, option("--mass-kg", "Body mass, 15 to 250.")]


def _data(path: Path | None) -> Any:
    from esea_host.assess.database import ResponseDataBase, shipped

    return ResponseDataBase.load(path) if path else shipped()


HeadlessOption = Annotated[
    bool, option("--headless", "With a board: keep movements that pass, repeat the others.")
]


@assess.command(epilog=NOTICE)
def build(
    file: Annotated[Path, typer.Argument(callback=writable, help="Database file (.npz).")],
    patients: Annotated[
        int, option("--patients", "Simulated patients of each category.", min=8)
    ] = 60,
    recordings: Annotated[
        Path | None,
        option(
            "--recordings FOLDER",
            "Build from recordings instead: a folder for each category, tables or MCAP in it.",
        ),
    ] = None,
) -> None:
    """Build a database of responses; the file states its sources."""
    from esea_host.assess.build import build as simulate
    from esea_host.assess.files import from_recordings

    data = from_recordings(recordings, told) if recordings else simulate(patients, told)
    digest = data.save(file)
    out.print(data.notice)
    out.print(
        f"{file}: {len(data.category)} people, {len(data.categories)} categories, "
        f"{int(data.common.sum())} of {data.grid.cells} locations reached by all, {digest[:16]}"
    )
    if data.calibration is None:
        out.print('Not calibrated: spread, noise and "none of these" are assumed.')
        return
    fit = data.calibration
    out.print(
        f"None of these: {fit['none_called']:.0f} of {fit['none_patients']:.0f} other simulated "
        f"patients are called so, with {fit['none_log_odds']:.2f} on its log odds."
    )


@assess.command(epilog=NOTICE)
def evaluate(
    patients: Annotated[int, option("--patients", "Number of patients.")] = 200,
    seed: Annotated[int, option("--seed", "Random seed.", min=0)] = 1,
    jobs: JobsOption = -1,
    json_file: JsonOption = None,
    page: Annotated[Path | None, output_file("--page", "Write the page (.html).")] = None,
    database: DataOption = None,
) -> None:
    """Evaluate the assessment on new simulated patients."""
    from esea_host.assess.evaluation import evaluate as meet_all
    from esea_host.assess.evaluation import judge, table
    from esea_host.assess.pages import evaluation_page

    data = _data(database)
    met, mixed = meet_all(data, patients, seed, jobs, say=told)
    result = {"seed": seed} | judge(met, mixed, data)
    out.print(data.notice)
    say(table(result))
    write_json(json_file, "host-assess-virtual", result)
    if page is not None:
        write_whole(page, evaluation_page(result))


@assess.command(epilog=NOTICE)
def run(
    recording: Annotated[
        list[Path] | None, option("--recording FILE", "Read a movement; repeatable.")
    ] = None,
    device: BoardOption = None,
    key: KeyOption = None,
    headless: HeadlessOption = False,
    zero: ZeroOption = False,
    movements: Annotated[int, option("--movements", "Headless: most movements.", min=1)] = 12,
    patient: PatientOption = None,
    seed: SeedOption = 1,
    window: Annotated[bool, option("--window", "Open the clinician's window.")] = False,
    dark: DarkOption = None,
    height_m: HeightOption = 1.70,
    mass_kg: MassOption = 70.0,
    low_deg: LowOption = 0.0,
    high_deg: HighOption = 130.0,
    fastest: Annotated[float, option("--fastest-deg-s", "Fastest comfortable speed.")] = 120.0,
    mixed: Annotated[bool, option("--mixed", "Also consider two disorders at once.")] = False,
    summary: Annotated[Summary, option("--summary", "Of the database.")] = "people",
    measure: Annotated[Measure, option("--measure", "Measure to choose movements.")] = "expected",
    who: Annotated[str, option("--who", "Name to print on the page.")] = "",
    json_file: JsonOption = None,
    page: Annotated[Path | None, output_file("--page", "Write a page (.html, .png, .pdf).")] = None,
    database: DataOption = None,
) -> None:
    """Assess one leg: measure each proposed movement, type its result, or read recordings.

    A board measures with --device, and its recording goes beside the session (--json).  Works
    without a sensor: say in a word how the leg resists, or skip.
    """
    # Long: an option a line.
    from esea_host.assess.desk import ClinicDesk, assess_unattended, converse
    from esea_host.assess.files import read_recording
    from esea_host.assess.patients import DEG
    from esea_host.assess.probing import Comfort
    from esea_host.assess.responses import check_body
    from esea_host.assess.session import Assessment

    if window:
        need_a_screen("the conversation: leave --window out")
    if page is not None:
        from esea_host.assess.pages import checked_name

        checked_name(page)
    if json_file is not None and json_file.is_file() and not recording:
        raise UserError(f"{json_file} already exists.", "Give another name: it is a session.")
    check_body(height_m, mass_kg)
    comfort = Comfort(low_deg * DEG, high_deg * DEG, fastest * DEG)
    if headless and (device is None or window):
        raise UserError("--headless", "Give --device, and leave --window out.")
    somebody = _patient(patient, device, (height_m, mass_kg), seed)
    refuse_copies(recording or [])
    recordings = [read_recording(p, height_m, mass_kg) for p in recording or []]
    session = Assessment(_data(database), summary, mixed)
    with _board(device, key, somebody, comfort, json_file, seed, paced=not headless) as board:
        given = somebody, json_file, seed, measure, board
        desk = ClinicDesk(session, comfort, height_m, mass_kg, *given)
        out.print(session.data.notice)
        if somebody is not None:
            out.print("The patient is simulated.")
        for path, r in zip(recording or [], recordings, strict=True):
            say([r.read] if r.read else [])
            out.print(desk.recording(r, path.name))
        if board is not None and (headless or zero):
            from esea_host.assess.board import be_ready

            be_ready(board, out.print, zero)
        if window:
            from esea_host.windows.assess import run_assess

            run_assess(desk, who, dark)
        elif headless:
            assess_unattended(desk, movements, out.print)
        else:
            converse(desk, sys.stdin if not recording else io.StringIO(), out.print)
    if somebody is not None:
        out.print(f"The simulated patient was: {somebody.category}")
    if page is not None:
        from esea_host.assess.pages import write_session_page

        write_session_page(page, session, desk.about(who), desk.comfort, measure)


def _here(address: str | None) -> str | None:
    # The device of a board that is simulated in this process.
    kind, _, name = (address or "").partition(":")
    return name if kind == "sim" and name and "?" not in name else None


def _patient(
    text: str | None, address: str | None, body: tuple[float, float], seed: int
) -> KneePatient | None:
    if text is None:
        if _here(address) is None:
            return None
        text = "simulated:any"
    from esea_host.assess.simulated import patient_named

    kind, _, name = text.partition(":")
    if kind != "simulated":
        raise UserError(f"--patient {text}.", "Give simulated:S3, simulated:any; others are real.")
    if address is not None and _here(address) is None:
        raise UserError(
            f"--patient {text} cannot be put on the board behind {address}.",
            "Leave it out, or take --device sim:knee.",
        )
    return patient_named(name or "any", body, seed)


@contextmanager
def _board(
    address: str | None,
    key: Path | None,
    patient: KneePatient | None,
    comfort: Comfort,
    json_file: Path | None,
    seed: int,
    *,
    paced: bool,
    kept_s: float = 30.0,
) -> Iterator[KneeBoard | None]:
    """Connect the board; for ``sim:knee`` with the simulated patient on it."""
    if address is None:
        yield None
        return
    from esea_gen.device import board_device
    from esea_host.assess.board import KneeBoard, await_state
    from esea_host.recording.replay import loaded_device

    given: dict[str, Any] = {"kept_s": kept_s}
    name = _here(address)
    made = None if name is None else board_device(loaded_device(name))
    if patient and made and not made.laws and len(made.axes) == 1:  # a leg fits no other
        from esea_host.assess.simulated import MovedKnee
        from esea_host.simulated import LockstepDevice, SimulatedBoard

        knee = MovedKnee(patient, made, seed)
        simulated = LockstepDevice(SimulatedBoard(made, seed=seed, motion=knee.step))
        given |= {"advance": simulated.advance, "paced": paced, "therapist": knee}
        connected: ConnectedDevice = simulated
    else:
        from esea_host.connection import open_device

        connected = open_device(address, None, key)
    with connected:
        board = KneeBoard(connected, comfort, json_file, **given)
        try:
            about = "simulated " if board.simulated else ""
            out.print(f"{about}{connected.identity.who}")
            out.print(
                f"Recorded in {board.recorded}."
                if board.recorded
                else "Not recorded: give --json FILE, and the recording goes beside it."
            )
            await_state(board)
            yield board
        finally:
            board.close()


def _one_of(recording: Path | None, device: str | None) -> None:
    if (recording is None) == (device is None):
        raise UserError("Neither or both of FILE and --device.", "Give FILE, or --device ADDRESS.")


@contextmanager
def _measuring(
    device: str | None, *given: Any, zero: bool, kept_s: float = 30.0
) -> Iterator[tuple[KneeBoard, Any]]:
    """A board that is ready for a passive test; the hands on it, if it is simulated."""
    from esea_host.assess.board import be_ready

    with _board(device, *given, paced=False, kept_s=kept_s) as board:
        assert board is not None
        be_ready(board, out.print, zero)
        if board.simulated:
            out.print("SIMULATED")
        yield board, board.therapist if board.simulated else None


def _measured(read: str, sentences: list[str]) -> None:
    out.print(MEASURED_NOTICE)
    say([read] if read else [])
    say(sentences)


@assess.command(epilog=MEASURED_NOTICE)
def pendulum(
    recording: Annotated[
        Path | None, typer.Argument(help="Table or MCAP: time_s, and angle_deg or _rad.")
    ] = None,
    device: BoardOption = None,
    key: KeyOption = None,
    zero: ZeroOption = False,
    patient: PatientOption = None,
    seed: SeedOption = 1,
    seconds: Annotated[
        float, option("--seconds", "Longest wait for a fall.", min=4, max=600)
    ] = 60.0,
    json_file: JsonOption = None,
) -> None:
    """Wartenberg's pendulum test: relaxation index, damping, first swing."""
    from esea_host.assess.files import angle_columns
    from esea_host.assess.passive_tests import pendulum_test
    from esea_host.assess.patients import MEAN_HEIGHT_M, MEAN_MASS_KG
    from esea_host.assess.probing import Comfort

    _one_of(recording, device)
    somebody = _patient(patient, device, (MEAN_HEIGHT_M, MEAN_MASS_KG), seed)
    if recording is not None:
        time_s, angle, table = angle_columns(recording)
        said, simulated = table.read, table.simulated
    else:
        # A leg that falls is faster than any comfort.
        free, said = Comfort(0.0, 2.7, 5.0), ""
        given = device, key, somebody, free, json_file, seed
        with _measuring(*given, zero=zero) as (board, hands):
            from esea_host.assess.board import await_fall

            if hands:
                hands.let_fall()
            out.print("Hold the leg straight, keep still, and let go.")
            fall = await_fall(board, out.print, seconds)
            time_s, angle, simulated = fall.time_s, fall.angle_rad, board.simulated
    found = pendulum_test(time_s, angle)
    _measured(said, found.sentences())
    about = {"notice": MEASURED_NOTICE, "simulated": simulated}
    write_json(json_file, "host-assess-pendulum", about | vars(found))


@assess.command("range", epilog=MEASURED_NOTICE)
def range_(
    recording: Annotated[
        Path | None, typer.Argument(help="Table or MCAP: time_s, angle_deg, torque_Nm.")
    ] = None,
    device: BoardOption = None,
    key: KeyOption = None,
    zero: ZeroOption = False,
    patient: PatientOption = None,
    seed: SeedOption = 1,
    seconds: Annotated[
        float, option("--seconds", "Duration from the first movement.", min=10, max=600)
    ] = 48.0,
    height_m: HeightOption = 1.70,
    mass_kg: MassOption = 70.0,
    low_deg: LowOption = 0.0,
    high_deg: HighOption = 130.0,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Passive range of motion: range, stiffness, and work lost in a cycle."""
    from esea_host.assess.files import read_recording
    from esea_host.assess.pages import loop_picture
    from esea_host.assess.passive_tests import SLOW_rad_s, motion_range
    from esea_host.assess.patients import DEG
    from esea_host.assess.probing import Comfort
    from esea_host.assess.responses import check_body

    _one_of(recording, device)
    check_body(height_m, mass_kg)
    slow = Comfort(low_deg * DEG, high_deg * DEG, SLOW_rad_s)
    somebody = _patient(patient, device, (height_m, mass_kg), seed)
    if recording is not None:
        leg = read_recording(recording, height_m, mass_kg)
    else:
        given = device, key, somebody, slow, json_file, seed
        with _measuring(*given, zero=zero, kept_s=seconds + 10) as (board, hands):
            from esea_host.assess.board import await_cycles

            if hands:
                hands.sweep(slow.low_rad, slow.high_rad, 20.0)
            out.print("Bend and straighten the leg slowly, from one end to the other.")
            leg = await_cycles(board, out.print, seconds, height_m, mass_kg)
    found = motion_range(leg)
    _measured(leg.read, found.sentences())
    numbers = {k: v for k, v in vars(found).items() if v is None or isinstance(v, int | float)}
    about = {"notice": MEASURED_NOTICE, "simulated": leg.simulated}
    write_json(json_file, "host-assess-motion", about | numbers)
    if figure is not None:
        with written_whole(figure) as scratch:
            loop_picture(found, leg.simulated).savefig(scratch, dpi=150)


@assess.command(epilog=NOTICE)
def validate(
    folder: Annotated[
        Path | None, option("--elbow", "Folder with the published elbow recordings.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Compare the simulated knee with published numbers."""
    from esea_host.assess.validation import against_elbow, pendulum_table, table

    found: dict[str, Any] = {"notice": NOTICE, "simulated": True, "pendulum": pendulum_table()}
    if folder is not None:
        found["elbow"] = against_elbow(folder)
    out.print(NOTICE)
    say(table(found))
    write_json(json_file, "host-assess-known", found)
