"""``python -m tests.planted ROOM|FILE[:N]...``: plant faults into this checkout's sources."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from esea_gen.errors import UserError

from .campaign import mutate_python


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser("python -m tests.planted", description=__doc__)
    parser.add_argument("whats", nargs="+", metavar="ROOM|FILE[:N]", help="N faults of this one")
    parser.add_argument("--sample", type=int, help="faults of each, drawn; default: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", action="append", default=[], help="default: the nearest")
    parser.add_argument("--all-tests", dest="independent", action="store_false")
    parser.add_argument("--widen", type=int, default=0, help="test files more, for survivors")
    parser.add_argument("--limit-s", type=float, help="of a test file; default: from its own time")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    given = vars(parser.parse_args(arguments))
    file = given.pop("json")
    try:
        report = mutate_python(Path.cwd(), given.pop("whats"), progress=print, **given)
    except UserError as error:
        sys.exit(str(error))
    print("\n".join(report.table()))
    if file is not None:
        file.write_text(json.dumps(report.to_dict(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
