"""``esea-host study``, commands on data: what goes out of a study, and what is deleted."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.errors import UserError
from esea_host.cli.app import out
from esea_host.cli.study import (
    CodeArgument,
    FolderArgument,
    ReasonOption,
    TrustOption,
    opened,
    study_app,
)


class ExportForm(StrEnum):
    rows = "rows"
    parquet = "parquet"
    bids = "bids"


@study_app.command("delete")
def delete(
    folder: FolderArgument,
    code: CodeArgument,
    reason: ReasonOption = "",
) -> None:
    """Delete all data of a participant, as anybody may ask; that it was done stays on record."""
    if not reason:
        raise UserError("Nothing is deleted without a reason.", "Give --reason, without names.")
    out.print(f"{code}: {opened(folder, runs=False).delete(code, reason)} files deleted")


@study_app.command("export")
def export(
    folder: FolderArgument,
    to: Annotated[Path, typer.Argument(metavar="OUT", help="A new folder.")],
    seed: Annotated[int, typer.Option("--seed", help="Of the order of the new codes.")] = 0,
    as_: Annotated[
        ExportForm, typer.Option("--as", help="rows: CSV and JSON; bids: samples and events too.")
    ] = ExportForm.rows,
    trust: TrustOption = None,
) -> None:
    """Write scrubbed data for others: new codes, no notes, no times of day."""
    from esea_host.study.exchange import to_bids, to_parquet
    from esea_host.study.folder import StudyFolder

    study = opened(folder, trust, runs=as_ is ExportForm.bids)
    forms = {ExportForm.bids: to_bids, ExportForm.parquet: to_parquet}
    written = forms.get(as_, StudyFolder.export)(study, to, seed)
    out.print(f"{to}: {written} {'runs' if as_ is ExportForm.bids else 'rows'}")
    if study.left_out:
        raise typer.Exit(1)
