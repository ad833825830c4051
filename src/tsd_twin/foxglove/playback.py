"""Recording behind Foxglove's playback controls: play, pause, speed and seek."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin import robots
from tsd_twin.errors import MessageError, RecordingError, TwinError
from tsd_twin.foxglove.front import Access, Front
from tsd_twin.foxglove.sdk import Playback, SdkServer
from tsd_twin.interop.fleet import MeshFiles, package_of
from tsd_twin.interop.mapping import PUBLISHED, SOURCES, RobotMapping, namespaces
from tsd_twin.messages.services import Description
from tsd_twin.messages.topics import Service
from tsd_twin.models import robot_urdf
from tsd_twin.recording.channels import RAW, Entry, robot_of, topic_of
from tsd_twin.recording.index import RecordingIndex

SLOWEST, FASTEST = 0.01, 100.0
"""Speeds of playback."""
_STEP_S = 0.02
_LATEST_NS = (1 << 63) - 1


class RecordingPlayback:
    """One recording at a time that plays on; thread-safe."""

    def __init__(self, path: Path, name: str) -> None:
        """Open a recording and serve it.

        Raises:
            RecordingError: it is none, or no robot in it can be shown.
            MissingExtraError: the SDK is not installed.
        """
        self._index = RecordingIndex(path)
        self._lock = threading.RLock()
        self._playing, self._speed = False, 1.0
        self._at_ns = self._index.start_ns
        self._clock_s = 0.0
        self._entries: Iterator[Entry] | None = None
        self._pending: Entry | None = None
        start_ns, end_ns = self._index.start_ns, self._index.end_ns
        self.server = SdkServer(name, playback=Playback(start_ns, end_ns, self.on_request))
        self._web: Any = importlib.import_module("foxglove.websocket")
        self._mappings: dict[str, RobotMapping] = {}
        self._show_robots(path)
        self._topics = {
            topic
            for topic in self._index.topics
            if topic_of(topic) in SOURCES
            and robot_of(topic) in self._mappings
            and not topic.endswith(RAW)
        }
        self._seek(start_ns)

    def close(self) -> None:
        """Close the file and all connections."""
        self.server.close()
        self._index.close()

    def _show_robots(self, path: Path) -> None:
        found = {robot_of(topic) for topic in self._index.topics} - {"", "*"}
        unknown: list[str] = []
        for robot, names in namespaces(found).items():
            try:
                description = self._description(robot)
                meshes = MeshFiles(robots.parse_description(description.robot, robot))
                text = description.urdf or robot_urdf(meshes.robot)
                mapping = RobotMapping(robot, names, text, package_of(names))
            except TwinError as error:
                unknown.append(str(error))
                continue
            self._mappings[robot] = mapping
            self.server.declare([(row, names.topic(row.name)) for row in PUBLISHED], robot)
            self.server.set_assets(package_of(names), meshes.get)
            for message in mapping.static():
                self.server.log(message, robot)
        if not self._mappings:
            reasons = "; ".join(unknown) or "there is no robot in it"
            raise RecordingError(f"{path} cannot be shown: {reasons}")

    def _description(self, robot: str) -> Description:
        for entry in self._index.newest_first(Service.DESC.key(robot), _LATEST_NS):
            with contextlib.suppress(msgspec.DecodeError):
                return msgspec.json.decode(entry.data, type=Description)
        raise RecordingError(f"there is no description of '{robot}'")

    # On threads of the SDK.

    def on_request(self, request: Any) -> Any:
        """Act on a request of a client, and return the state."""
        with self._lock:
            sought = request.seek_time is not None
            if sought:
                self._seek(request.seek_time)
            speed = float(request.playback_speed)
            if math.isfinite(speed):
                self._speed = min(max(speed, SLOWEST), FASTEST)
            self._playing = request.playback_command == self._web.PlaybackCommand.Play
            self._clock_s = time.monotonic()
            return self._state(sought=sought, request_id=request.request_id)

    def _state(self, *, sought: bool = False, request_id: str | None = None) -> Any:
        status = self._web.PlaybackStatus
        now = status.Playing if self._playing else status.Paused
        if self._at_ns >= self._index.end_ns:
            now = status.Ended
        return self._web.PlaybackState(now, self._at_ns, self._speed, sought, request_id)

    # Time.

    def advance(self) -> None:
        """Send what is due by the clock."""
        with self._lock:
            now_s = time.monotonic()
            step_ns = round(1e9 * self._speed * (now_s - self._clock_s))
            self._clock_s = now_s
            if not self._playing or self._entries is None:
                return
            self._at_ns = min(self._at_ns + step_ns, self._index.end_ns)
            while (entry := self._pending) is not None and entry.log_ns <= self._at_ns:
                self._send(entry)
                self._pending = next(self._entries, None)
            self.server.server.broadcast_time(self._at_ns)
            if self._at_ns >= self._index.end_ns:
                self._playing = False
                self.server.server.broadcast_playback_state(self._state())

    def _seek(self, at_ns: int) -> None:
        """Show the newest message of each stream at a time."""
        self._at_ns = min(max(at_ns, self._index.start_ns), self._index.end_ns)
        for topic in sorted(self._topics):
            for entry in self._index.newest_first(topic, self._at_ns):
                self._send(entry, self._at_ns)
                break
        self._entries = self._index.entries(self._topics, self._at_ns)
        self._pending = next(self._entries, None)

    def _send(self, entry: Entry, log_ns: int | None = None) -> None:
        topic, robot = topic_of(entry.topic), robot_of(entry.topic)
        if topic is None:
            return
        with contextlib.suppress(MessageError):
            for message in self._mappings[robot].convert(topic, entry.data, self.server.wants):
                self.server.log(message, robot, log_ns or entry.log_ns)


async def serve_recording(
    path: Path,
    address: tuple[str, int],
    access: Access,
    stop: threading.Event,
    ready: Callable[[int], None],
) -> None:
    """Serve a recording until `stop` is set; nothing can be driven.

    Raises:
        TwinError: the SDK is missing, or file, address or access settings cannot be used.
    """
    access.check(address[0])
    playback = RecordingPlayback(path, path.name)
    front = Front(access, None, playback.server.port, playback.server.trust)
    try:
        await front.start(*address)
        ready(front.port)
        while not stop.is_set():
            await asyncio.to_thread(playback.advance)
            await asyncio.sleep(_STEP_S)
    finally:
        await front.stop()
        playback.close()
