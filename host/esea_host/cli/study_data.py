"""``esea-host study``, commands on data: groups, export, deletion."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from esea_gen.cli.options import option, writable
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_host.cli.app import out, say, say_left_out
from esea_host.cli.study import (
    CodeArgument,
    FolderArgument,
    OperatorOption,
    ReasonOption,
    TrustOption,
    opened,
    study_app,
)

if TYPE_CHECKING:
    from esea_host.study.folder import StudyFolder


ExportForm = Literal["rows", "parquet", "bids"]


@study_app.command("allocate")
def allocate(
    folder: FolderArgument,
    keep: Annotated[Path, option("--keep FILE", "The sealed list: a new file, elsewhere.")],
    places: Annotated[int, option("--places", "In each stratum.", min=1, max=10000)] = 200,
    reason: ReasonOption = "",
    operator: OperatorOption = "",
) -> None:
    """Draw the sealed list of groups, as a third person (permuted blocks of random size)."""
    strata = opened(folder, runs=False, operator=operator).allocate(keep, places, reason)
    each = f" in each of {len(strata)} strata" if len(strata) > 1 else ""
    out.print(f"{folder}: {places} places{each}; the study has their seals, not the groups")
    out.print(
        f"{keep}: the groups and the code that opens each place. Remove it from this computer; "
        "at a participant's first session give only the code of the next place."
    )


@study_app.command("unblind")
def unblind(
    folder: FolderArgument,
    role: Annotated[
        Literal["operator", "participant", "analyst"],
        typer.Argument(help="Role that may see groups from now on."),
    ],
    reason: ReasonOption = "",
    operator: OperatorOption = "",
) -> None:
    """Unblind a role; person, time and reason stay on record."""
    study = opened(folder, runs=False, operator=operator)
    if not reason:
        raise UserError("Unblinding needs a reason.", "Give --reason, without names.")
    if not study.blinded(role):
        raise UserError(f"The {role} is not blinded.", "No action is needed.")
    study.record("unblind", role=role, reason=reason)
    out.print(f"{role} unblinded")


@study_app.command("delete")
def delete(
    folder: FolderArgument,
    code: CodeArgument,
    reason: ReasonOption = "",
    operator: OperatorOption = "",
) -> None:
    """Delete all data of a participant on request; the deletion stays on record."""
    from esea_host.study.privacy import export_codes

    if not reason:
        raise UserError("Deletion needs a reason.", "Give --reason, without names.")
    study = opened(folder, runs=False, operator=operator)
    out.print(f"{code}: {study.delete(code, reason)} files deleted")
    if made := sum(kind == "export" for kind, _ in study.audited(strict=False)):
        (new,) = export_codes(study.key, [code])
        out.print(f"exports on record: {made}; delete {new} there too")


@study_app.command("export")
def export(
    folder: FolderArgument,
    to: Annotated[Path | None, typer.Argument(metavar="OUT", help="A new folder.")] = None,
    as_: Annotated[
        ExportForm, option("--as", "rows: CSV and JSON; bids: samples and events too.")
    ] = "rows",
    check: Annotated[
        bool, option("--check", "Write nothing; list what could identify a person.")
    ] = False,
    labels: Annotated[
        bool, option("--labels", "Blinded study: conditions by neutral names, not left out.")
    ] = False,
    trust: TrustOption = None,
    operator: OperatorOption = "",
) -> None:
    """Export data: secret codes, no notes, no dates, no groups while blinded."""
    from esea_host.study.exchange import omissions

    study = opened(folder, trust, runs=as_ == "bids", operator=operator)
    if (to is None) is not check:
        raise UserError("Either a new folder is written, or --check lists.", "Give one of them.")
    if to is not None:
        study.must_know_operator()  # before anything is written
    say_left_out(omissions(study))
    if to is None:
        with tempfile.TemporaryDirectory() as scratch:
            # Parquet has the same rows, which are looked at as text.
            form = "rows" if as_ == "parquet" else as_
            _write(study, Path(scratch) / "x", form, labels)
            found = _identifying(study, Path(scratch) / "x")
        out.print(
            "Could identify a person:" if found else "Found nothing that identifies a person."
        )
        say(f"  {line}" for line in found)
        out.print("Not searched: movements, which can be matched with others of the same person.")
        return
    written = _write(study, to, as_, labels)
    study.record("export", form=as_, labels=labels, written=written)
    out.print(f"{to}: {written} {'runs' if as_ == 'bids' else 'rows'}")
    if count := len(_identifying(study, to)):
        out.print(f"identifying values: {count}; next: esea-host study export {folder} --check")
    if study.left_out or study.missing():
        raise typer.Exit(1)


def _write(study: StudyFolder, to: Path, form: ExportForm, labels: bool) -> int:
    from esea_host.study.exchange import to_bids, to_parquet, to_rows

    forms = {"bids": to_bids, "parquet": to_parquet, "rows": to_rows}
    return forms[form](study, to, labels)


def _identifying(study: StudyFolder, to: Path) -> list[str]:
    from esea_host.study.exchange import known_words, people_of
    from esea_host.study.privacy import findings

    return findings(to, study.participants(), people_of(study), known_words(study))


@study_app.command("status")
def status(folder: FolderArgument) -> None:
    """Show participants, places of the list and sessions, without groups."""
    from esea_host.study.report import flow_of

    say(flow_of(opened(folder, runs=False)).lines())


@study_app.command("report")
def report(
    folder: FolderArgument,
    to: Annotated[Path, typer.Argument(metavar="FILE.html", callback=writable, help="The page.")],
) -> None:
    """Write a one-page report: participants, sessions, deviations, adverse events, logs."""
    from esea_host.study.report import study_page

    if to.suffix != ".html":
        raise UserError(f"{to}: a page ends in .html.", "Give another name.")
    write_whole(to, study_page(opened(folder, runs=False)))
    out.print(f"{to}: written")
