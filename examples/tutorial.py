"""Tutorial: from a device file to C that measures torque.  Run it: python examples/tutorial.py.

It takes a few seconds, needs gcc, and writes only below the folder given as its argument (by
default, ``tutorial`` in the current folder).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import esea_gen
from esea_gen.emit.build import render_device, write_bundles
from esea_gen.hostlib import compile_device
from esea_gen.identify import identify

OUT = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("tutorial")
RECORDING = Path(__file__).parents[1] / "tests" / "data" / "hdrb" / "hdrb.toml"


# 1. A device -------------------------------------------------------------------------------------
#
# A device is a TOML file in which every number says where it comes from: published, identified or
# assumed.  Give a path for a file of your own; names without a path are shipped devices.

elbow = esea_gen.load_device("elbow")
print(elbow.title)
for key, quantity in elbow.quantities():
    if key.startswith("elastomer."):
        print(f"  {key:34} {quantity.value:<10g} {quantity.status:10} {quantity.source}")


# 2. One step -------------------------------------------------------------------------------------
#
# `sensor` is a Block: torque from deflection, written once, as symbols.  Its simulator evaluates
# those symbols in float64 and keeps the state.  The name of every quantity ends in its unit.

sensor = elbow.sensor.simulator()
answer = sensor.step(theta_rad=0.10, omega_rad_s=0.0)
print(f"\none step at 0.10 rad: {answer['tau_Nm']:.4f} Nm, status {answer['status']:#04x}")

# A sample that cannot be - here NaN - is not computed with: the last deflection is held, and the
# status word says so.
answer = sensor.step(theta_rad=float("nan"), omega_rad_s=0.0)
flags = elbow.sensor.status_port.flags
said = [f.name for i, f in enumerate(flags) if answer["status"] >> i & 1]
print(f"one step at NaN:      {answer['tau_Nm']:.4f} Nm, status {said}")

# The symbolic step is an ordinary CasADi function, to differentiate or to put into an optimiser.
print(elbow.sensor.step)


# 3. A stream through the symbolic System ---------------------------------------------------------
#
# On the board the Blocks are wired into a System: an observer gives the rate, the sensor takes it.
# Task `sense` runs once a millisecond.

t_s = np.arange(0.0, 2.0, elbow.period_s)
theta_rad = 0.15 * np.sin(2 * np.pi * 0.8 * t_s)
system = elbow.system.simulator()
model_Nm = np.array([system.step("sense", theta_rad=x)["tau_Nm"] for x in theta_rad])
print(f"\n{len(t_s)} steps: torque from {model_Nm.min():.3f} to {model_Nm.max():.3f} Nm")


# 4. The same stream through the generated C ------------------------------------------------------
#
# `compile_device` renders the C, compiles it for this machine and loads it: the bytes that the
# board runs.  f64 is for the host, f32 is what ships.

results = {}
for real in ("f64", "f32"):
    task = compile_device(elbow, real).task("sense")
    outputs, _ = task.run({"theta_rad": theta_rad}, trace=False)
    results[real] = outputs["tau_Nm"].astype(float)
    worst = np.abs(results[real] - model_Nm).max() / elbow.tau_full_scale_Nm
    print(f"C in {real} against the model: {100 * worst:.1e} % of full scale")


# 5. Write the C ----------------------------------------------------------------------------------
#
# The same as `esea-gen build elbow`.  Each folder stands alone: add its .c files (main.c is an
# example program) to your project and call esea_elbow_init once, esea_elbow_sense_step every tick.

for path in write_bundles(render_device(elbow, ["f64", "f32"]), OUT / "elbow"):
    print(f"\n{path}: {', '.join(sorted(p.name for p in path.iterdir()))}")


# 6. A device from a recording --------------------------------------------------------------------
#
# A mapping file says which columns of a recording are deflection and torque, and in which units.
# This one is a real rubber bearing under cyclic shear.  The last cycle of each amplitude is held
# out: the fit has not seen it.

found = identify(RECORDING)
print()
print("\n".join(found.summary()))
path = found.write(OUT, overwrite=True)

# What identification writes is a device file like any other: check it, build it.
hdrb = esea_gen.load_device(path)
task = compile_device(hdrb, "f32").task("sense")
print(f"\n{hdrb.title}: {task.step(theta_rad=0.1)['tau_Nm']:.4f} Nm at the first sample of 0.1 rad")
