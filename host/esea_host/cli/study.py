"""``esea-host study``: protocols, sessions, replay and repair."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from esea_gen.cli.groups import WholeSentences
from esea_gen.cli.options import option
from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_host.cli.app import app, out, say
from esea_host.cli.options import KeyOption, know_shipped_tasks

if TYPE_CHECKING:
    from esea_gen.device import Device
    from esea_host.study.folder import StudyFolder

study_app = typer.Typer(
    cls=WholeSentences,
    help="Studies with people: protocol, sessions, data.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(study_app, name="study")


TaskOption = Annotated[list[Path] | None, option("--task FILE.py", "File with your own task.")]
TrustOption = Annotated[
    list[str] | None,
    option(
        "--trust HASH",
        "Trust the task file with this SHA-256 from now on; without it, a command shows it.",
    ),
]
FolderArgument = Annotated[Path, typer.Argument(metavar="FOLDER", help="The study's folder.")]
CodeArgument = Annotated[str, typer.Argument(metavar="CODE", help="Participant code, such as P01.")]
SessionOption = Annotated[int, option("--session", "Session number.", min=1)]
OperatorOption = Annotated[
    str,
    option(
        "--operator NAME",
        "Your name, for the record; required in a real study.",
        envvar="ESEA_OPERATOR",
    ),
]
ReasonOption = Annotated[str, option("--reason", "Reason; stays on record.")]


@study_app.command("check")
def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Protocol file, or a study's folder.")
    ],
    task: TaskOption = None,
    device: Annotated[
        str | None, option("--device", "Compare with this board too: sim:wrist_drive, serial:...")
    ] = None,
    key: KeyOption = None,
    trust: TrustOption = None,
) -> None:
    """Check a protocol file; state what it asks of people and how long it takes."""
    from esea_host.study.fitting import DeviceSignals, uses_of
    from esea_host.study.plan import explain
    from esea_host.study.protocol import load_protocol

    trusted(trust)
    know_shipped_tasks()
    protocol = opened(file).protocol if file.is_dir() else load_protocol(file, task or [])
    out.print(explain(protocol))
    if device is not None:
        signals = DeviceSignals(device_at(device, key))
        say(f"  {signals.device.name}: {line}" for line in signals.told(uses_of(protocol)))


def device_at(address: str, key: Path | None = None) -> Device:
    """The device that a board runs; a simulated one is not started for it."""
    from esea_gen.device import board_device
    from esea_host.connection import open_device
    from esea_host.connection.address import parse_address

    place = parse_address(address)
    if place.kind == "sim":
        return board_device(place.place.partition("?")[0])
    with open_device(address, key=key) as board:
        return board.identity.device


@study_app.command("create")
def create(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Protocol file.")],
    folder: FolderArgument,
    task: TaskOption = None,
    simulated: Annotated[
        bool | None,
        option("--simulated/--real", "Whether people take part; this cannot be changed later."),
    ] = None,
    trust: TrustOption = None,
    operator: OperatorOption = "",
) -> None:
    """Make a study's folder from a protocol, for real or simulated people."""
    from esea_host.study.folder import StudyFolder
    from esea_host.study.plan import explain
    from esea_host.study.protocol import load_protocol

    if simulated is None:
        raise UserError(
            "Is it a study of real people, or a simulated one? All its data is marked accordingly.",
            "Give --real or --simulated.",
        )
    trusted(trust)
    know_shipped_tasks()
    protocol = load_protocol(file, task or [])
    explain(protocol)  # every session can be planned
    with new_whole(folder) as scratch:
        StudyFolder.create(scratch, protocol, simulated, by=operator)
    trusted(c.sha256 for c in protocol.code)  # what --task named runs from the folder too
    kind, form = ("SIMULATED", "") if simulated else ("real", " --form VERSION")
    out.print(f"{folder}: {kind}; next: esea-host study enrol {folder} P01 --consent{form}")
    if protocol.file.groups and not simulated:
        out.print(
            f"Groups: a third person draws the list: esea-host study allocate {folder} --keep ..."
        )


@study_app.command("enrol")
def enrol(
    folder: FolderArgument,
    code: CodeArgument,
    consent: Annotated[bool, option("--consent", "Written consent has been obtained.")] = False,
    form: Annotated[str, option("--form VERSION", "Version of the consent form.")] = "",
    date: Annotated[
        str, option("--date", "When it was signed, as 2026-11-26; default: today.")
    ] = "",
    obtained_by: Annotated[
        str, option("--obtained-by", "Who obtained the consent; default: the operator.")
    ] = "",
    stratum: Annotated[
        list[str] | None, option("--stratum FACTOR=LEVEL", "Stratum; once per factor.")
    ] = None,
    operator: OperatorOption = "",
) -> None:
    """Enrol a participant by code; the group is disclosed at the first session."""
    study = opened(folder, runs=False, operator=operator)
    study.enrol(code, consent, form, date, obtained_by, stratum or ())
    out.print(f"{code} enrolled")


@study_app.command("repeat", help="Repeat a trial: its data no longer counts, and stays on record.")
@study_app.command("skip")
def skip(
    context: typer.Context,
    folder: FolderArgument,
    code: CodeArgument,
    trial: Annotated[int, typer.Argument(metavar="TRIAL", min=1, help="Trial number.")],
    session: SessionOption = 1,
    reason: ReasonOption = "",
    trust: TrustOption = None,
    operator: OperatorOption = "",
) -> None:
    """Skip a trial of an interrupted session."""
    study = opened(folder, trust, operator=operator)
    with closing(study.session(code, session - 1, None)) as begun:
        if context.info_name == "repeat":
            begun.repeat(trial, reason)
            out.print(f"{code}: study resume repeats trial {trial}")
        else:
            begun.skip(trial, reason)
            out.print(f"{code}: trial {trial} is skipped")


@study_app.command("event")
def event(
    folder: FolderArgument,
    kind: Annotated[
        Literal["deviation", "adverse"],
        typer.Argument(metavar="KIND", help="deviation or adverse."),
    ],
    text: Annotated[str, typer.Argument(metavar="TEXT", help="What happened, without names.")],
    participant: Annotated[str, option("--participant CODE", "Participant; default: none.")] = "",
    session: Annotated[int | None, option("--session", "Session number.", min=1)] = None,
    severity: Annotated[
        str, option("--severity", "mild, moderate, severe, life-threatening, fatal.")
    ] = "",
    relation: Annotated[
        str,
        option("--relation", "Relation to the device: not-related, possible, probable, causal."),
    ] = "",
    action: Annotated[str, option("--action", "Action taken.")] = "",
    operator: OperatorOption = "",
) -> None:
    """Record a deviation from the protocol, or an adverse event."""
    study = opened(folder, runs=False, operator=operator)
    given: dict[str, Any] = {"participant": participant, "text": text}
    if participant and participant not in study.participants():
        raise UserError(f"{participant} is not in this study.", "Name a participant of it.")
    if session is not None and session > (most := len(study.protocol.file.session)):
        raise UserError(f"There is no session {session}.", f"Give 1 to {most}.")
    given |= {} if session is None else {"session": session - 1}
    more = {"severity": severity, "relation": relation, "action": action}
    if kind == "adverse":
        given |= more
    elif unused := [f"--{n}" for n, x in more.items() if x]:
        raise UserError(f"{', '.join(unused)}: only for adverse events.", "Leave it out.")
    study.record(kind, **given)
    out.print(f"{folder}: {kind} recorded")


@study_app.command("withdraw")
def withdraw(
    folder: FolderArgument,
    code: CodeArgument,
    reason: ReasonOption = "",
    operator: OperatorOption = "",
) -> None:
    """Withdraw a participant: the data stays, but is not used; no reason is required."""
    opened(folder, runs=False, operator=operator).withdraw(code, reason)
    out.print(f"{code} has withdrawn: no more sessions; the data is no longer used")


@study_app.command("repair")
def repair_command(folder: FolderArgument, operator: OperatorOption = "") -> None:
    """Move the part of a log behind a break aside, so that the study can continue."""
    from esea_host.study.repair import repair

    said = repair(opened(folder, runs=False, operator=operator))
    say(said or ["Every log is intact: nothing was changed."])


@study_app.command("replay")
def replay_command(
    folder: FolderArgument,
    code: CodeArgument,
    session: SessionOption = 1,
    trust: TrustOption = None,
) -> None:
    """Recompute every scene of a session and compare it with the log.

    From its log, and from what the board recorded, where it was run with one.
    """
    from esea_host.study.recorded import BoardInputs
    from esea_host.study.session import replay

    study = opened(folder, trust)
    path = study.log_of(code, session - 1)
    if not study.begun(code, session - 1):
        raise UserError(f"{code} has not begun session {session}.", "Name one that was begun.")
    sources: dict[str, BoardInputs | None] = {"log": None}
    if any(path.parent.glob("device-*.mcap")):
        sources["board's recording"] = BoardInputs(path)
    for source, told in sources.items():
        scenes, other = 0, set()
        for trial, _, same in replay(path, study.rows(code, session - 1), told):
            scenes += 1
            other |= set() if same else {trial}
        words = "the same, bit for bit" if not other else "NOT the same"
        scenes -= told.lacking if told else 0
        out.print(f"{scenes} scenes from the {source}; {words}")
        if other:
            raise UserError(
                f"Trials with other scenes: {sorted(other)}.",
                "Check whether a task or a recording was changed.",
            )


@study_app.command("audit")
def audit(folder: FolderArgument) -> None:
    """Check every log's chain, the protocol and the tasks; list all actions.  Runs no code."""
    study = opened(folder, runs=False)
    for e in study.trail(strict=False):
        told = "".join(f" {k}={v}" for k, v in e.data.items() if k not in ("content", "program"))
        out.print(f"{e.utc or 'no time'} ({e.clock or 'clock unknown'}) {e.by}: {e.kind}{told}")
    for name, digest in study.content().items():
        out.print(f"{name}: SHA-256 {digest}")
    problems = study.problems()
    if problems:
        fix = "Restore these files from a copy, or create a new study for a new protocol; "
        fix += f"a broken log: esea-host study repair {folder}."
        raise UserError(f"{folder}: {'; '.join(problems)}.", fix)
    out.print("Every log is as it was written.")


def trusted(hashes: Iterable[str] | None) -> None:
    from esea_gen.trust import trust

    trust(hashes or ())


def opened(
    folder: Path, trust: list[str] | None = None, runs: bool = True, operator: str = ""
) -> StudyFolder:
    """A study's folder, with every shipped task known; runs: whether its trusted tasks are run."""
    from esea_gen.trust import inside
    from esea_host.study.folder import StudyFolder

    trusted(trust)
    know_shipped_tasks()
    for link in (p for p in folder.rglob("*") if p.is_symlink()):
        inside(folder, link.relative_to(folder), str(folder))
    by = operator or os.environ.get("ESEA_OPERATOR", "")
    return StudyFolder.open(folder, runs=runs, by=by)
