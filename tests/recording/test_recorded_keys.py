"""Keys that a recorder subscribes to."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from mcap.reader import make_reader

from tsd_twin.messages import topics
from tsd_twin.messages.pictures import CameraName
from tsd_twin.messages.topics import Sample
from tsd_twin.recording import Recorder
from tsd_twin.recording.folder import RecordingFolder


class OneStream:
    """Bus that hands its subscriber to the test."""

    def subscribe(self, _key: str, take: Callable[[Sample], None]) -> None:
        self.put = take

    def subscribe_liveliness(self, _key: str, take: object) -> None:
        """Report no robots."""


def test_a_recording_has_each_message_but_pictures(tmp_path: Path) -> None:
    recorder = Recorder(RecordingFolder(tmp_path, 10**9))
    bus = OneStream()
    recorder.listen(bus)  # type: ignore[arg-type]
    camera = CameraName("front", "tsd")
    for key in (camera.key, topics.STATUS.key("tsd"), camera.info_key, "twin/tsd/other"):
        bus.put(Sample(key, b"{}", b""))
    stop = threading.Event()
    stop.set()
    recorder.run(stop)
    (file,) = tmp_path.glob("*.mcap")
    with file.open("rb") as stream:
        found = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert topics.STATUS.key("tsd") in found
    assert any(topic.startswith("twin/tsd/other") for topic in found)
    assert not [topic for topic in found if "/camera/" in topic]
