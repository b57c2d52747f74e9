"""``python -m tests.benchmarks``: steps, fixed point and twin; print the rows and the aims."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from esea_gen.device import load_device

from .fixed import fixed_rows
from .steps import aims, step_rows
from .twin import twin_aim, twin_rows


def table(rows: list[dict]) -> str:
    width = max(len(r["name"]) for r in rows)
    lines = [f"{'':{width}}  {'ours':>10}  {'peer':>10}  {'peer/ours':>9}  middle half"]
    for r in rows:
        spread = f"  {r['low']:.2f} to {r['high']:.2f}" if "low" in r else ""
        lines.append(
            f"{r['name']:{width}}  {r['ours']:10.4g}  {r['peer']:10.4g}  {r['ratio']:9.2f}"
            f"{spread}  {r['unit']}"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("device", nargs="?", default="elbow", help="shipped device or device file")
    parser.add_argument("--json", type=Path, help="also write the rows")
    parser.add_argument("--pairs", type=int, default=101, help="pairs of measurements a row")
    parser.add_argument("--drive", default="elbow_drive", help="device with a drive; empty: none")
    chosen = parser.parse_args()

    def say(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    device = load_device(chosen.device)
    drive = load_device(chosen.drive) if chosen.drive else None
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # times of one processor
    rows = step_rows(device, drive, chosen.pairs, say) + fixed_rows(device, say)
    rows += twin_rows(drive, chosen.pairs, say) if drive else []
    print(table(rows))
    print("\n".join([*aims(rows), *twin_aim(rows)]))
    if chosen.json:
        chosen.json.write_text(json.dumps({"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
