"""``python -m esea_host.simulated DEVICE``: the server alone, as ``sim:DEVICE`` starts it."""

import argparse
import math
import sys

from esea_gen.errors import UserError
from esea_host.simulated.server import serve

NAMED = {"person": None, "plant": None, "motion": None, "board": "sim", "seed": 0, "speed": 1.0}
parser = argparse.ArgumentParser()
parser.add_argument("device")
for name, default in (NAMED | {"tcp": 0, "zeroed": 0, "spring": 0.0}).items():
    kind = str if default is None else type(default)
    parser.add_argument(f"--{name}", type=kind, default=default)
for name in ("pty", "once", "hands"):
    parser.add_argument(f"--{name}", action="store_true")
given = vars(parser.parse_args())
try:
    serve(
        given["device"],
        None if given["pty"] else given["tcp"],
        zeroed=bool(given["zeroed"]),
        once=given["once"],
        spring_Nm_rad=math.degrees(given["spring"]),
        hands=sys.stdin.fileno() if given["hands"] else None,
        **{name: given[name] for name in NAMED},
    )
except UserError as error:
    sys.exit(str(error))
