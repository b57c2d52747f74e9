"""Recordings: written live, readable when cut off or damaged, refused where they have holes."""

from esea_host.recording.clock import ClockFit, clock_fit
from esea_host.recording.integrity import Damage, Gap, GapError, Integrity, RecordingState
from esea_host.recording.layout import StreamColumn, StreamLayout
from esea_host.recording.log import Log, Table, open_log
from esea_host.recording.writer import Recorder

__all__ = [
    "ClockFit",
    "Damage",
    "Gap",
    "GapError",
    "Integrity",
    "Log",
    "Recorder",
    "RecordingState",
    "StreamColumn",
    "StreamLayout",
    "Table",
    "clock_fit",
    "open_log",
]
