"""A short trial from Python: connect, set a parameter, record, read the recording.

esea-host sim elbow_drive --tcp 5760 &
python examples/host_trial.py tcp:127.0.0.1:5760 trial.mcap
"""

import sys

import esea_host


def trial(address: str, path: str, seconds: float = 1.0) -> float:
    """Record a board that is at rest; largest torque in Nm."""
    largest_Nm = 0.0
    with esea_host.connect(address) as device:
        device.set("lambda_1_s", 12)
        with device.record(path):
            start_s = None
            for sample in device.samples("tau_Nm"):
                start_s = sample.time_s if start_s is None else start_s
                largest_Nm = max(largest_Nm, abs(sample["tau_Nm"]))
                if sample.time_s - start_s > seconds:
                    break
    return largest_Nm


if __name__ == "__main__":
    print(f"largest torque {trial(*sys.argv[1:3]):.3f} Nm")
    with esea_host.open_log(sys.argv[2]) as log:
        print(log["sense_out"].frame()[["tau_Nm", "theta_load_rad"]].describe())
