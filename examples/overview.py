"""Draw the README's picture: python examples/overview.py FILE.png (half a minute, needs gcc).

A recorded rubber, the C of its identified model, and a simulated elbow under torque control.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from esea_gen.identify.family.identification import identify_member
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Setting
from esea_gen.twin.run import run_case

RECORDING = Path(__file__).parents[1] / "tests" / "data" / "hdrb" / "hdrb.toml"
MEASURED, COMPUTED, DESIRED = "#d9822b", "#1f5f8b", "#20303c"
SIMULATED = "#8fbcd9"

found = identify_member(RECORDING, "slips, worn")  # which held-out data choose
recording, computed_Nm = found.recordings[0], found.verdict.torque_Nm["hdrb"]
twist_deg, measured_Nm = np.degrees(recording.theta_rad), recording.tau_Nm
part = recording.time_s > 0.88 * recording.time_s[-1]  # whole loops of the largest amplitude

case = TuningCase().cases()[0]
run = run_case(case, Setting("elbow_mpc"), 1)
ticks = slice(-3400, None)  # two periods at 1 kHz
time_s = run.time_s[ticks] - run.time_s[ticks][0]

figure = Figure(figsize=(12.4, 4.1), layout="constrained")
left, middle, right = figure.subplots(1, 3)
for ax, title in (
    (left, "1  Record the rubber"),
    (middle, "2  Fit its model, generate C"),
    (right, "3  Control it (simulated)"),
):
    ax.set_title(title, loc="left", fontsize=15, fontweight="bold")
    ax.set_ylabel("torque, N·m", fontsize=12)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(alpha=0.25)
for ax in (left, middle):
    ax.plot(twist_deg[part], measured_Nm[part], color=MEASURED, lw=5, label="measured")
    ax.set_xlabel("twist of the rubber, degrees", fontsize=12)
middle.plot(twist_deg[part], computed_Nm[part], color=COMPUTED, lw=1.6, label="generated C")
right.plot(time_s, run["tau_e_Nm"][ticks], color=SIMULATED, lw=5, label="on the simulated arm")
desired_Nm = case.trajectory.tau_desired_Nm[ticks]
right.plot(time_s, desired_Nm, "--", color=DESIRED, lw=1.6, label="desired")
right.set_xlabel("time, s", fontsize=12)
right.set_ylim(-2.9, 2.0)
for ax in (left, middle, right):
    ax.legend(fontsize=12, frameon=False, loc="upper left" if ax is not right else "lower left")
figure.savefig(sys.argv[1], dpi=100)
