"""Programs of the Foxglove server: live robots, and playback of recordings."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import math
import threading
import time
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from tsd_twin import robots
from tsd_twin.adapters.fleet import LONGEST_OPERATOR, Fleet, MeshFiles, package_of
from tsd_twin.adapters.foxglove.gateway import Access, Front
from tsd_twin.adapters.foxglove.live import FoxgloveSource, LiveOperator
from tsd_twin.adapters.foxglove.sdk import SdkServer
from tsd_twin.adapters.ros_messages import RobotMapping
from tsd_twin.adapters.ros_topics import PUBLISHED, SOURCES, namespaces
from tsd_twin.bus import Bus
from tsd_twin.errors import RecordingError, TwinError
from tsd_twin.messages.errors import MessageError
from tsd_twin.models import robot_urdf
from tsd_twin.recording.channels import RAW, Entry, robot_of, robots_in, topic_of
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.reader import recorded_description

_WATCH_S = 0.05


async def serve_live(
    open_bus: Callable[[], Bus],
    address: tuple[str, int],
    access: Access,
    stop: threading.Event,
    ready: Callable[[int], None],
    *,
    operator: str,
    may_drive: bool = True,
    only: Collection[str] = (),
) -> None:
    """Serve all robots on the bus until `stop` is set."""
    server = SdkServer("tsd-twin", may_drive=may_drive)
    operator = operator[:LONGEST_OPERATOR]
    make_source = partial(FoxgloveSource, server, may_drive, operator)
    fleet = Fleet(make_source, open_bus, only)
    make = partial(LiveOperator, fleet, operator) if may_drive else None
    front = Front(access, make, server.port, server.trust)
    bus = await asyncio.to_thread(open_bus)
    try:
        await front.start(*address)
        fleet.watch(bus)
        ready(front.port)
        while not stop.is_set():
            await asyncio.sleep(_WATCH_S)
    finally:
        await front.stop()
        await fleet.close()
        bus.close()
        server.close()


SLOWEST, FASTEST = 0.01, 100.0
"""Range of playback speeds."""
_STEP_S = 0.02


class RecordingPlayback:
    """Playback of a recording; thread-safe."""

    def __init__(self, path: Path, name: str) -> None:
        """Open a recording and serve it.

        Raises:
            RecordingError: If the file is not a recording, or none of its robots can be shown.
            MissingExtraError: If the SDK is not installed.
        """
        self._index = RecordingIndex(path)
        self._lock = threading.RLock()
        self._playing, self._speed = False, 1.0
        self._at_ns = self._index.start_ns
        self._clock_s = 0.0
        self._entries: Iterator[Entry] | None = None
        self._pending: Entry | None = None
        range_ns = self._index.start_ns, self._index.end_ns
        self.server = SdkServer(name, playback_ns=range_ns, on_playback=self.on_request)
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
        self._seek(self._index.start_ns)

    def close(self) -> None:
        """Close the file and all connections."""
        self.server.close()
        self._index.close()

    def _show_robots(self, path: Path) -> None:
        unknown: list[str] = []
        for robot, names in namespaces(robots_in(self._index.topics)).items():
            try:
                description = recorded_description(self._index, robot)
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

    # Called on SDK threads.

    def on_request(self, request: Any) -> Any:
        """Handle a client request; return the playback state."""
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

    # Timing.

    def advance(self) -> None:
        """Send all messages due by now."""
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
        """Show the latest message of each stream at a time."""
        self._at_ns = min(max(at_ns, self._index.start_ns), self._index.end_ns)
        for topic in sorted(self._topics):
            for entry in self._index.newest_first(topic, self._at_ns):
                self._send(entry, self._at_ns)
                break
        self._entries = self._index.ordered(self._topics, self._at_ns + 1)
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
    """Serve a recording until `stop` is set; nothing can be driven."""
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
