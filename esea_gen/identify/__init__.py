"""Parameters of the torque model from recordings of a test rig."""

from esea_gen.identify.identification import Identification, Verdict, identify, judge
from esea_gen.identify.mapping import Mapping, MappingFile, load_mapping, parse_mapping
from esea_gen.identify.recording import Cycle, DataSet, Recording, load_recordings
from esea_gen.identify.replay import Replay, recorded_deflections, recordings_for

__all__ = [
    "Cycle",
    "DataSet",
    "Identification",
    "Mapping",
    "MappingFile",
    "Recording",
    "Replay",
    "Verdict",
    "identify",
    "judge",
    "load_mapping",
    "load_recordings",
    "parse_mapping",
    "recorded_deflections",
    "recordings_for",
]
