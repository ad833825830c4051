"""Recorder: writes all messages of the bus to files, and goes on when the disk is full."""

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
from tsd_twin.messages.requests import Event, Sample
from tsd_twin.messages.topics import QoS, Service
from tsd_twin.recording.channels import EntryMaker, robot_of
from tsd_twin.recording.folder import RecordingFolder
from tsd_twin.recording.mcap_file import RecordingFile

EVERYTHING = ("twin/**",)
"""Keys of a bus without access rules."""
ALLOWED = (
    "twin/*/state/**",
    "twin/*/event/**",
    topics.INPUTS.key("*"),
    topics.TWIST.key("*"),
    topics.SENSOR_POSE.key("*"),
    topics.STOP.key("*"),
)
"""Keys that the access rules of a robot allow to a recorder: one rule for each."""
FLUSH_S = 0.4
"""Time between two writes to the disk, which is what a power cut loses at most; messages wait for
another 0.2 s in the log of a node."""
NEW_FILE_S = 3600.0
_SHARE = 0.25
"""Of the limit of the folder, in one file: otherwise the limit could not be kept."""
_QUEUE = 200_000
"""Messages that wait while a disk hangs: some ten minutes of one robot."""
_DESCRIBE_S = 2.0
_LOG = logging.getLogger(__name__)


class Recorder:
    """Recorder of all robots on one bus or several.

    Callbacks of a bus only queue; one thread, which calls `run`, converts and writes.
    """

    def __init__(
        self, folder: RecordingFolder, *, notify: Callable[[str], None] = _LOG.warning
    ) -> None:
        """Open the first file.

        `notify` gets one sentence when the disk is full, and when it is no longer.

        Raises:
            OSError: the file cannot be created.
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
        """File that is being written."""
        self._opened_s = time.monotonic()

    def listen(self, bus: Bus, keys: Sequence[str] = EVERYTHING) -> None:
        """Record what is put on `keys` of a bus.

        It has to be a client session: peers of a robot do not see what other peers put.
        """
        for key in keys:
            bus.subscribe(key, self._put)
        for key in (topics.alive_key("*"), topics.instance_key("*", "*")):
            bus.subscribe_liveliness(key, functools.partial(self._receive_life, bus))

    def new_file(self) -> None:
        """Begin a new file soon; may be called from a signal handler."""
        self._new_file.set()

    def run(self, stop: threading.Event) -> None:
        """Record until `stop` is set; then the file is closed with its index."""
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

    # On threads of the bus.

    def _now_ns(self) -> int:
        # The wall clock as it was at the start: a clock that is set must not turn times round.
        return self._epoch_ns + time.monotonic_ns()

    def _receive_life(self, bus: Bus, key: str, is_alive: bool) -> None:
        self._put((key, {"alive": is_alive}))
        if key.endswith("/alive"):
            robot = robot_of(key)
            if is_alive:  # It may have been started again, with another description.
                self._alive[robot] = bus
                self._describe(robot, bus)
            else:
                self._alive.pop(robot, None)

    def _put(self, item: Sample | tuple[str, Any]) -> None:
        if len(self._queue) < _QUEUE:
            self._queue.append((self._now_ns(), item))
        else:
            self._dropped += 1

    def _describe(self, robot: str, bus: Bus) -> None:
        """Ask a robot for its description, which every file needs."""

        def take(answer: bytes | None) -> None:
            if answer is None:
                return
            try:
                description = json.loads(answer)
            except ValueError:
                description = None  # Not a robot of ours; it is not asked again.
            if self._descriptions.get(robot, self) != description:
                self._descriptions[robot] = description
                self._put((Service.DESC.key(robot), description))

        try:
            bus.request(Service.DESC.key(robot), b"", take, _DESCRIBE_S)
        except BusError:  # The session is being closed.
            return

    def _describe_again(self) -> None:
        """Ask robots that have not answered."""
        now_s = time.monotonic()
        if now_s - self._described_s > _DESCRIBE_S:
            self._described_s = now_s
            for robot, bus in list(self._alive.items()):
                if robot not in self._descriptions:
                    self._describe(robot, bus)

    # On the thread that writes.

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
        """Tell the terminal, and the pages of all robots."""
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
