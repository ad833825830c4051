"""Recordings: write from the bus, read as arrays or by time, replay, rerun and export."""

from tsd_twin.errors import needs_extra

with needs_extra("A recording", "record"):
    from tsd_twin.recording.data import (
        RecordedMessage,
        Recording,
        Series,
        TopicSummary,
        open_recording,
    )
    from tsd_twin.recording.events import (
        Annotation,
        EventKind,
        RecordedEvent,
        add_mark,
        read_events,
        read_marks,
    )
    from tsd_twin.recording.folder import Catalogue, RecordingFolder
    from tsd_twin.recording.player import Player, RecordedRobot, Replay, play
    from tsd_twin.recording.reader import RecordingSummary
    from tsd_twin.recording.recorder import ALLOWED, EVERYTHING, Recorder

__all__ = [
    "ALLOWED",
    "EVERYTHING",
    "Annotation",
    "Catalogue",
    "EventKind",
    "Player",
    "RecordedEvent",
    "RecordedMessage",
    "RecordedRobot",
    "Recorder",
    "Recording",
    "RecordingFolder",
    "RecordingSummary",
    "Replay",
    "Series",
    "TopicSummary",
    "add_mark",
    "open_recording",
    "play",
    "read_events",
    "read_marks",
]
