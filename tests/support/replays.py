"""Replays of a short recording, on any bus."""

from __future__ import annotations

import threading
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path

from tests.support.recorded_drives import RecordedDrive
from tests.support.robot_node import PATIENCE_S
from tsd_twin.bus import Bus
from tsd_twin.recording import Replay, open_recording, play
from tsd_twin.recording.mcap_file import RecordingFile


def stopped_drive(path: Path) -> Path:
    """Write a recording of `tsd` that drives for a second and is stopped."""
    file = RecordingFile(path)
    drive = RecordedDrive(file)
    drive.circle(1)
    drive.controller.stop(b'{"reason": "recorded"}', drive.now_s)
    drive.wait(1.0)
    file.close()
    return path


@contextmanager
def replaying(bus: Bus, path: Path, replay_id: str) -> Generator[None]:
    """Replay the recording of `tsd` again and again on a bus, under an id."""
    stop = threading.Event()
    with closing(Replay(bus, open_recording(path), "tsd", replay_id)) as replay:
        thread = threading.Thread(target=play, args=(replay, stop, 1.0), kwargs={"loop": True})
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(PATIENCE_S)
