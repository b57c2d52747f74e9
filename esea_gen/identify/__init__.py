"""Parameters of the torque model from recordings of a test rig."""

from esea_gen.identify.identification import Identification, Verdict, identify, judge
from esea_gen.identify.mapping import Mapping, MappingFile, load_mapping, parse_mapping
from esea_gen.identify.recording import Cycle, DataSet, Recording, load_recordings

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
]
