"""Commissioning of a connected board in steps: instruction, verdict, figure, record.

The steps use what every board has: the streams of its sensing task, and its own torque mode.
The torque is judged by :mod:`esea_gen.studies.torque_check`.
"""

from esea_host.commissioning.bench import CommissioningBench, CommissioningEndedError, HandAct
from esea_host.commissioning.record import BoardUnit, CommissioningRecord, StepResult, unit_of
from esea_host.commissioning.simulated import SimulatedHands, simulated_bench
from esea_host.commissioning.steps import (
    STEPS,
    CommissioningStep,
    StepOptions,
    guide,
    run_step,
    steps_of,
)

__all__ = [
    "STEPS",
    "BoardUnit",
    "CommissioningBench",
    "CommissioningEndedError",
    "CommissioningRecord",
    "CommissioningStep",
    "HandAct",
    "SimulatedHands",
    "StepOptions",
    "StepResult",
    "guide",
    "run_step",
    "simulated_bench",
    "steps_of",
    "unit_of",
]
