"""Recordings: written from the bus, read as arrays, put back on the bus, run again, exported."""

from tsd_twin.recording.data import (
    RecordedMessage,
    Recording,
    Series,
    TopicSummary,
    open_recording,
)
from tsd_twin.recording.folder import RecordingFolder
from tsd_twin.recording.recorder import ALLOWED, EVERYTHING, Recorder
from tsd_twin.recording.replay import Replay, play

__all__ = [
    "ALLOWED",
    "EVERYTHING",
    "RecordedMessage",
    "Recorder",
    "Recording",
    "RecordingFolder",
    "Replay",
    "Series",
    "TopicSummary",
    "open_recording",
    "play",
]
