"""Parameters of the torque model from recordings of a test rig."""

from esea_gen.identify.identification import Identification, identify
from esea_gen.identify.recording.cycles import Cycle, DataSet
from esea_gen.identify.recording.mapping import MappingFile, load_mapping, parse_mapping
from esea_gen.identify.recording.reading import load_recordings, recorded_deflections
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.tables import Mapping
from esea_gen.identify.verdict import Verdict, judge

__all__ = [
    "Cycle",
    "DataSet",
    "Identification",
    "Mapping",
    "MappingFile",
    "Recording",
    "Verdict",
    "identify",
    "judge",
    "load_mapping",
    "load_recordings",
    "parse_mapping",
    "recorded_deflections",
]
