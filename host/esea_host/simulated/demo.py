"""The first minute without hardware: a simulated session, its recording, its proof, one page."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import written_whole
from esea_gen.model.sensing import of_axis
from esea_gen.twin.judge import ROUGHNESS, rate_limited, rms, roughness
from esea_host.connection.address import driven_by
from esea_host.connection.opening import require_device
from esea_host.recording.log import Log, Table, open_log
from esea_host.recording.replay import ReplayVerdict, device_of, loaded_device, verify
from esea_host.simulated.drive import PERSON, LockstepDevice, SimulatedBoard

TURN_S = 0.005  # from one command to the next, as often as the control task runs
AMPLITUDE_Nm, WANTED_HZ = 1.7, 0.6  # the tuning case of the published trials
SETTLE_S, ZERO_S, ZERO_TRIES = 0.3, 0.4, 5
OFF = "STOPPED", "FAULT_LATCHED"  # told whenever the motor is off: no limit acts


@dataclass(frozen=True)
class Demo:
    recording: Path
    report: Path
    verdict: ReplayVerdict
    rms_error_Nm: float  # of the sensed torque, from the second cycle on
    roughness: dict[str, float]  # likewise
    fault: str = ""  # that the board latched


def run_demo(
    device: str | SimulatedBoard,
    seconds: float,
    report: Path,
    recording: Path | None = None,
    person: str | None = None,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> Demo:
    """Zero, arm, follow a sine of torque against a virtual person; record, prove, draw."""
    target = recording or report.with_suffix(".mcap")
    for path in (target, report):
        if path.exists():
            raise UserError(f"{path} already exists.", "Give another name.")
    own = isinstance(device, str)
    if isinstance(device, str):
        require_device(loaded_device(device), lambda d: bool(d.laws), "has no motor")
    drive = SimulatedBoard(device, person=person, seed=seed) if isinstance(device, str) else device
    try:
        connected = LockstepDevice(drive)
        named = driven_by(connected.identity.controller, drive.device.name)
        say(f"simulated {named}, simulated person '{person or PERSON}'")
        with connected.record(target) as live:
            live.note("simulated: the firmware's application, virtual drive, virtual person")
            latched = _follow(connected, seconds)
            live.event("board_clock", **connected.clock())
    finally:
        if own:
            drive.close()
    with open_log(target) as log:
        say(f"{target}: {len(log[log.first_output])} ticks; computing it again")
        verdict = verify(log)
        error_Nm, rough = _draw(log, verdict, report)
    return Demo(target, report, verdict, error_Nm, rough, latched)


def shown_error(rms_Nm: float) -> str:
    error = f"{rms_Nm:.3f} Nm rms"
    return f"torque error {'of less than a cycle not judged' if math.isnan(rms_Nm) else error}"


def _follow(device: LockstepDevice, seconds: float) -> str:
    # The fault that the board has latched in the end, or nothing.
    device.advance(SETTLE_S)
    for _ in range(ZERO_TRIES):
        device.zero()
        device.advance(ZERO_S)
        if device.state() == "READY":
            break
    else:
        raise UserError(f"The simulated person did not stand still in {ZERO_TRIES} tries.", "")
    names = [of_axis("tau_desired_Nm", a) for a in device.drive.axes]
    device.arm()
    device.advance(TURN_S)
    for i in range(round(seconds / TURN_S)):
        wanted_Nm = AMPLITUDE_Nm / len(names) * math.sin(2 * math.pi * WANTED_HZ * i * TURN_S)
        wanted: dict[str, Any] = dict.fromkeys(names, wanted_Nm)
        device.want(mode=1.0, **wanted)
        device.advance(TURN_S)
    latched = device.session.fault() if device.state() == "FAULT" else ""
    device.disarm()
    device.advance(1.0)
    return latched


def _draw(log: Log, verdict: ReplayVerdict, path: Path) -> tuple[float, dict[str, float]]:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, STYLE

    device = device_of(log)
    axis = device.axes[0]
    last = list(log[log.first_output].pieces())[-1]
    given = list(log[log.first_output.replace("_out", "_in")].pieces())[-1]
    names = ("tau_Nm", "theta_rad", "theta_load_rad", "u_Nm")
    tau_Nm, theta_rad, load_rad, u_Nm = (last[of_axis(n, axis)] for n in names)
    desired_Nm, on, t_s = given[of_axis("tau_desired_Nm", axis)], given["mode"] > 0, last.time_s
    twist_deg, joint_deg = np.degrees(theta_rad), np.degrees(load_rad)
    judged = on & (t_s > t_s[on][0] + 1 / WANTED_HZ if on.any() else on)
    error_Nm = (tau_Nm - desired_Nm)[judged]
    rms_Nm, rough = float("nan"), dict.fromkeys(ROUGHNESS, float("nan"))
    if judged.any():
        limits = np.asarray(last[of_axis("limits_status", axis)])[judged]
        rms_Nm, rough = rms(error_Nm), roughness(u_Nm[judged], error_Nm, rate_limited(limits))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 9.4), layout="constrained")
        torque, bend, command, acts, loop = figure.subplot_mosaic(
            [["a", "a"], ["b", "b"], ["c", "c"], ["d", "e"]], height_ratios=[1.5, 1, 1, 1.4]
        ).values()
        joint = bend.twinx()
        for panel, x, y, colour, width, label in (
            (torque, t_s, np.where(on, desired_Nm, np.nan), MODEL, 1.0, "wanted"),
            (torque, t_s, tau_Nm, MEASURED, 1.3, "sensed"),
            (bend, t_s, twist_deg, MEASURED, 1.2, "deflection"),
            (joint, t_s, joint_deg, BOUND, 1.0, "joint"),
            (command, t_s, u_Nm, INK, 0.7, "command"),
            (loop, twist_deg, tau_Nm, MEASURED, 0.7, "torque"),
        ):
            panel.plot(x, y, color=colour, lw=width, label=label)
        title = f"Torque {axis}; {shown_error(rms_Nm)}".replace(" ;", ";")
        torque.set(ylabel="torque [Nm]", title=title)
        torque.legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.98))  # beside the title
        joint.set_ylabel("joint [deg]", color=BOUND)
        joint.grid(False)
        bend.set(ylabel="deflection [deg]", title="Deflection (left), joint angle (right)")
        command.set(ylabel="command [Nm]", xlabel="time [s]", title="Motor command")
        loop.set(xlabel="deflection [deg]", ylabel="sensed torque [Nm]")
        loop.set_title("Torque over deflection")
        word = of_axis("limits_status", axis)
        port = next(x.port for x in device.system.outputs if x.name == word)
        flags = [(1 << i, flag.name) for i, flag in enumerate(port.flags)]
        _raster(acts, last, word, [(bit, name) for bit, name in flags if name not in OFF])
        said = "every bit matches the generated C" if verdict.same else "NOT the same bits"
        figure.suptitle(
            f"Simulated {log.facts['device']}: {len(last)} ticks recorded, {len(log.gaps)} gaps; "
            f"replay of {verdict.values} values: {said}",
            x=0.01, ha="left", color=INK, fontsize=11,
        )  # fmt: skip
        with written_whole(path) as scratch:
            figure.savefig(scratch, dpi=110)
    return rms_Nm, rough


def _raster(axes: Any, table: Table, word: str, flags: list[tuple[int, str]]) -> None:
    # When which limit acts; those that never did are left out.
    status, t_s = table[word], table.time_s
    seen = [(bit, name) for bit, name in flags if (status & bit).any()]
    for row, (bit, _) in enumerate(seen):
        held = ((status & bit) != 0).astype(np.int8)
        edges = np.flatnonzero(np.diff(held, prepend=0, append=0))
        spans = [(t_s[a], (b - a) * 1e-3) for a, b in edges.reshape(-1, 2)]
        axes.broken_barh(spans, (row - 0.35, 0.7), color="#9a3f78")
    axes.set_yticks(range(len(seen)), [name.lower().replace("_", " ") for _, name in seen])
    axes.set_ylim(-0.6, max(len(seen), 1) - 0.4)
    axes.set_xlim(t_s[0], t_s[-1])
    axes.set(xlabel="time [s]", title="Which limit acts")
