"""``python -m esea_host.simulated DEVICE``: the server alone, as ``sim:DEVICE`` starts it."""

import argparse
import math
import sys

from esea_gen.errors import UserError
from esea_host.simulated.server import serve

parser = argparse.ArgumentParser()
parser.add_argument("device")
parser.add_argument("--tcp", type=int, default=None)
parser.add_argument("--pty", action="store_true")
parser.add_argument("--once", action="store_true")
parser.add_argument("--hands", action="store_true")
parser.add_argument("--person")
parser.add_argument("--plant")
parser.add_argument("--motion")
parser.add_argument("--board", default="sim")
parser.add_argument("--zeroed", type=int, default=0)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--speed", type=float, default=1.0)
parser.add_argument("--spring", type=float, default=0.0)
given = parser.parse_args()
try:
    serve(
        given.device,
        None if given.pty else given.tcp or 0,
        person=given.person,
        plant=given.plant,
        motion=given.motion,
        seed=given.seed,
        speed=given.speed,
        board=given.board,
        zeroed=bool(given.zeroed),
        once=given.once,
        spring_Nm_rad=math.degrees(given.spring),
        hands=sys.stdin.fileno() if given.hands else None,
    )
except UserError as error:
    sys.exit(str(error))
