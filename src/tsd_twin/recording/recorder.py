"""Recorder: writes all bus messages to files, and continues when the disk is full."""

from __future__ import annotations

import functools
import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from tsd_twin.bus import Bus, Publisher
from tsd_twin.errors import BusError
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.events import Event
from tsd_twin.messages.pictures import CameraName
from tsd_twin.messages.topics import QoS, Sample, Service
from tsd_twin.recording.channels import EntryMaker, robot_of
from tsd_twin.recording.folder import RecordingFolder
from tsd_twin.recording.mcap_file import RecordingFile

EVERYTHING = ("twin/**",)
"""Keys on a bus without access rules."""
ALLOWED = (
    "twin/*/state/**",
    "twin/*/event/**",
    topics.INPUTS.key("*"),
    topics.TWIST.key("*"),
    topics.SENSOR_POSE.key("*"),
    topics.STOP.key("*"),
)
"""Keys that a robot's access rules allow recorders to read, one per rule."""
FLUSH_S = 0.4
"""Write period, which limits the loss at a power cut; nodes buffer inputs for another 0.2 s."""
NEW_FILE_S = 3600.0
_SHARE = 0.25
"""Maximum file size as a fraction of the folder limit; larger files would prevent keeping it."""
_QUEUE = 200_000
"""Maximum messages queued while the disk hangs, about ten minutes for a single robot."""
_DESCRIBE_S = 2.0
_LOG = logging.getLogger(__name__)


class Recorder:
    """Records all robots on one or more buses.

    Bus callbacks only queue messages; the thread that calls `run` converts and writes them.
    """

    def __init__(
        self, folder: RecordingFolder, *, notify: Callable[[str], None] = _LOG.warning
    ) -> None:
        """Open the first file.

        `notify` receives a sentence when the disk becomes full, and when space is available again.

        Raises:
            OSError: If the file cannot be created.
        """
        self._folder, self._notify = folder, notify
        self._make = EntryMaker()
        self._queue: deque[tuple[int, Sample | tuple[str, Any]]] = deque()
        self._dropped = 0
        self._epoch_ns = time.time_ns() - time.monotonic_ns()
        self._alive: dict[str, Bus] = {}
        self._descriptions: dict[str, Any] = {}
        self._described_s = time.monotonic()
        self._events: dict[str, Publisher] = {}
        self._new_file = threading.Event()
        self._full = ""
        self._refused = False
        self.file = folder.new_file()
        """Current file."""
        self._opened_s = time.monotonic()

    def listen(self, bus: Bus, keys: Sequence[str] = EVERYTHING) -> None:
        """Record all messages on `keys` of a bus, except pictures.

        The bus must be a client session, because peers of a robot do not see messages from other
        peers.
        """
        for key in keys:
            bus.subscribe(key, self._put)
        for key in (topics.alive_key("*"), topics.instance_key("*", "*")):
            bus.subscribe_liveliness(key, functools.partial(self._receive_life, bus))

    def new_file(self) -> None:
        """Start a new file soon; may be called from a signal handler."""
        self._new_file.set()

    def run(self, stop: threading.Event) -> None:
        """Record until `stop` is set, then close the file with its index."""
        try:
            while not stop.wait(FLUSH_S):
                self._write()
                self._describe_again()
                if self._is_due():
                    self._change_file()
        finally:
            self._write()
            self._close(self.file)
            self._folder.remove_oldest()

    # Called on bus threads.

    def _now_ns(self) -> int:
        # Extrapolate the wall clock from the start, so that setting it cannot reverse times.
        return self._epoch_ns + time.monotonic_ns()

    def _receive_life(self, bus: Bus, key: str, is_alive: bool) -> None:
        self._put((key, {"alive": is_alive}))
        if key.endswith("/alive"):
            robot = robot_of(key)
            if is_alive:  # A restarted robot may have another description.
                self._alive[robot] = bus
                self._describe(robot, bus)
            else:
                self._alive.pop(robot, None)

    def _put(self, item: Sample | tuple[str, Any]) -> None:
        if isinstance(item, Sample) and CameraName.of(item.key) is not None:
            return  # Pictures would fill the memory while the disk hangs, and then the disk.
        if len(self._queue) < _QUEUE:
            self._queue.append((self._now_ns(), item))
        else:
            self._dropped += 1

    def _describe(self, robot: str, bus: Bus) -> None:
        """Query a robot's description, which every file needs."""

        def take(answer: bytes | None) -> None:
            if answer is None:
                return
            try:
                description = json.loads(answer)
            except ValueError:
                description = None  # Third-party robot, not queried again.
            if self._descriptions.get(robot, self) != description:
                self._descriptions[robot] = description
                self._put((Service.DESC.key(robot), description))

        try:
            bus.request(Service.DESC.key(robot), b"", take, _DESCRIBE_S)
        except BusError:  # The session is being closed.
            return

    def _describe_again(self) -> None:
        """Query robots that have not answered."""
        now_s = time.monotonic()
        if now_s - self._described_s > _DESCRIBE_S:
            self._described_s = now_s
            for robot, bus in list(self._alive.items()):
                if robot not in self._descriptions:
                    self._describe(robot, bus)

    # Called on the writing thread.

    def _write(self) -> None:
        for _ in range(len(self._queue)):
            log_ns, item = self._queue.popleft()
            if isinstance(item, Sample):
                for entry in self._make.of_sample(item, log_ns):
                    self.file.add(entry)
            else:
                self.file.add(self._make.of_json(*item, log_ns))
        try:
            self.file.flush()
        except OSError as error:
            self._report_full(error)
        else:
            self._report_space()
        if self.file.refused and not self._refused:
            self._refused = True
            skipped, file = self.file.refused, self.file.path.name
            self._say(because(Code.MESSAGES_NOT_RECORDED, count=skipped, file=file))

    def _report_full(self, error: OSError) -> None:
        if not self._full:
            self._full = error.strerror or str(error)
            self._say(because(Code.RECORDING_PAUSED, text=self._full))
            self._folder.remove_oldest()

    def _report_space(self) -> None:
        if not self._full:
            return
        lost, self._full = self.file.lost + self._dropped, ""
        self.file.lost = self._dropped = 0
        self._say(because(Code.RECORDING_CONTINUES, lost=lost))

    def _say(self, why: Reason) -> None:
        """Notify the terminal and the pages of all robots."""
        event = Event.of("record", why, "recording", 0.0)
        self._notify(event.text)
        for robot, bus in list(self._alive.items()):
            try:
                if robot not in self._events:
                    key = topics.event_key(robot, event.kind)
                    self._events[robot] = bus.publisher(key, QoS.EVENT)
                self._events[robot].put(msgspec.json.encode(event))
            except BusError:
                return

    def _is_due(self) -> bool:
        age_s = time.monotonic() - self._opened_s
        most = _SHARE * self._folder.keep_bytes
        due = age_s >= NEW_FILE_S or self.file.size >= most or self._new_file.is_set()
        return due and not self._full

    def _change_file(self) -> None:
        self._new_file.clear()
        try:
            following = self._folder.new_file()
        except OSError as error:
            self._report_full(error)
            return
        self._close(self.file)
        self.file, self._opened_s = following, time.monotonic()
        now_ns = self._now_ns()
        for robot in list(self._alive):
            self.file.add(self._make.of_json(topics.alive_key(robot), {"alive": True}, now_ns))
        for robot, description in list(self._descriptions.items()):
            self.file.add(self._make.of_json(Service.DESC.key(robot), description, now_ns))
        self._folder.remove_oldest()

    def _close(self, file: RecordingFile) -> None:
        try:
            file.close()
        except OSError as error:
            self._notify(f"{file.path} has no index: {error.strerror}.")
