"""Reader of recordings for the dashboard: listings, states, events and tracks.

The dashboard runs it in another process, see `reader_process`. All results are small for any file:
long texts are truncated, large states skipped.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin import robots
from tsd_twin.errors import RecordingError, TwinError
from tsd_twin.lie import SO3
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_joints, decode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import Description
from tsd_twin.messages.status import decode_status
from tsd_twin.messages.topics import Service, Topic
from tsd_twin.recording.channels import Entry, robots_in
from tsd_twin.recording.events import Annotation, EventKind, RecordedEvent, read_events, read_marks
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.records import RecordFile, readable
from tsd_twin.recording.titles import read_title
from tsd_twin.robots import RobotDescription

MOST_ROBOTS = 16
"""Maximum robots listed and shown per recording."""
_LATEST_NS = (1 << 63) - 1
_TRIED = 8
"""Maximum messages of a stream tried until one can be decoded."""
_STATE_BYTES = 16_384
"""Maximum size of a state, ten times that of a typical one."""
_TEXT_LENGTH = 200
_MOST_EVENTS = 2000
_MOST_NOTES = 50
_GROWING = 16
"""Maximum number of growing files with a cached index."""

STREAMS: dict[str, Topic] = {
    "joints": topics.JOINTS,
    "setpoint": topics.SETPOINT,
    "odom": topics.ODOM,
    "alternative": topics.ODOM_ALTERNATIVE,
    "truth": topics.TRUTH,
    "status": topics.STATUS,
}
"""Displayed states, by their name in a snapshot."""


def decoders(robot: RobotDescription) -> dict[str, Callable[[bytes], Any]]:
    """Return the decoder of each stream."""
    odometry = partial(decode_odometry, turning=robot.kinematics().pose_type is SO3)
    poses = dict.fromkeys(("odom", "alternative", "truth"), odometry)
    return {"joints": decode_joints, "setpoint": decode_joints, **poses, "status": decode_status}


class RobotStates(msgspec.Struct, frozen=True, array_like=True):
    """States of a robot at a time."""

    alive: bool
    """Whether the node was on the bus."""
    found: dict[str, Entry]
    """Latest decodable message of each stream."""


class Contents(msgspec.Struct, frozen=True):
    """Contents of an open recording."""

    start_ns: int
    """Time of the first message, recorder's wall clock."""
    end_ns: int
    robots: dict[str, str]
    """Descriptions of the robots that can be shown, by id."""
    unknown: dict[str, str]
    """Robots that cannot be shown, with the reasons."""


class RecordingSummary(msgspec.Struct, frozen=True):
    """Summary of a recording for listings."""

    start_ns: int
    """Start, recorder's wall clock; 0 if there are no messages."""
    end_ns: int
    robots: tuple[str, ...]
    size: int
    """Bytes."""
    is_whole: bool
    """Whether the file is complete, not truncated or still being written."""
    marks: int
    """Number of marks."""
    notes: tuple[str, ...] = ()
    """Texts of the first marks."""
    title: str = ""
    """Title that people gave it, empty if none."""

    @property
    def duration_s(self) -> float:
        """Duration."""
        return 1e-9 * (self.end_ns - self.start_ns)


class RecordingReader:
    """Reader of a recording; reading raises a `RecordingError` if the file is damaged there."""

    def __init__(self, path: Path) -> None:
        """Open the recording.

        Raises:
            RecordingError: If the file is not a recording.
        """
        self.index = RecordingIndex(path)
        self._texts: dict[str, str] = {}
        self._unknown: dict[str, str] = {}
        self._robots: dict[str, _RobotReader] = {}
        try:
            found = robots_in(self.index.topics)
            for each in found[:MOST_ROBOTS]:
                self._add(each)
            if len(found) > MOST_ROBOTS:
                self._unknown["others"] = f"only {MOST_ROBOTS} robots are shown"
        except BaseException:
            self.index.close()
            raise

    def _add(self, robot_id: str) -> None:
        try:
            text = recorded_description(self.index, robot_id).robot
            robot = parse_recorded(text, robot_id)
            self._robots[robot_id] = _RobotReader(self.index, robot_id, robot)
        except TwinError as error:
            self._unknown[robot_id] = str(error)[: 4 * _TEXT_LENGTH]
        else:
            self._texts[robot_id] = text

    def close(self) -> None:
        """Close the file."""
        self.index.close()

    def contents(self) -> Contents:
        """Return the current contents; a file being written grows."""
        self.index.refresh()
        return Contents(self.index.start_ns, self.index.end_ns, self._texts, self._unknown)

    def states(self, robot_ids: Sequence[str], at_ns: int) -> dict[str, RobotStates]:
        """Return the states of robots at a time, recorder's wall clock."""
        with readable(self.index.path):
            return {each: self._robots[each].at(at_ns) for each in robot_ids}

    def next_status_ns(self, robot_id: str, at_ns: int, back: bool) -> int | None:
        """Return the time of a robot's first status after a time, or of the last before it."""
        key = topics.STATUS.key(robot_id)
        with readable(self.index.path):
            if back:
                found = next(self.index.newest_first(key, at_ns - 1), None)
            else:
                found = self.index.first_after(key, at_ns)
        return None if found is None else found.log_ns

    def events(self) -> list[RecordedEvent]:
        """Return the events to display, truncated to the first 2000."""
        with readable(self.index.path):
            found = [e for e in read_events(self.index) if e.kind is not EventKind.OTHER]
        return [replace(event, text=event.text[:_TEXT_LENGTH]) for event in found[:_MOST_EVENTS]]

    def marks(self) -> list[Annotation]:
        """Return the marks."""
        return read_marks(self.index.path)

    def track(self, count: int) -> dict[str, list[tuple[float, float]]]:
        """Return each robot's floor positions at `count` evenly spaced times, m."""
        start_ns, span_ns = self.index.start_ns, self.index.end_ns - self.index.start_ns
        tracks: dict[str, list[tuple[float, float]]] = {each: [] for each in self._robots}
        with readable(self.index.path):
            for i in range(count):
                for robot_id, robot in self._robots.items():
                    xy = robot.position(start_ns + span_ns * i // (count - 1))
                    if xy is not None:
                        tracks[robot_id].append(xy)
        return tracks


class _RobotReader:
    """Finds a robot's states: the latest decodable ones, as on a live page."""

    def __init__(self, index: RecordingIndex, robot_id: str, robot: RobotDescription) -> None:
        self._index, self._id, self._decoders = index, robot_id, decoders(robot)
        self._known: dict[str, tuple[Entry, Any]] = {}

    def at(self, at_ns: int) -> RobotStates:
        found = {name: known[0] for name in STREAMS if (known := self._newest(name, at_ns))}
        return RobotStates(self._is_alive(at_ns, default="status" in found), found)

    def position(self, at_ns: int) -> tuple[float, float] | None:
        odom = self._newest("odom", at_ns)
        if odom is None or odom[1].wxyz is not None:
            return None
        x, y, _ = (round(float(number), 3) for number in odom[1].xy_heading)
        return x, y

    def _newest(self, name: str, at_ns: int) -> tuple[Entry, Any] | None:
        known = self._known.get(name)
        key = STREAMS[name].key(self._id)
        for count, entry in enumerate(self._index.newest_first(key, at_ns)):
            if known is not None and known[0] == entry:
                return known
            if count > _TRIED:
                break
            if len(entry.data) <= _STATE_BYTES:
                try:
                    self._known[name] = entry, self._decoders[name](entry.data)
                except MessageError:
                    continue
                return self._known[name]
        return None

    def _is_alive(self, at_ns: int, *, default: bool) -> bool:
        for entry in self._index.newest_first(topics.alive_key(self._id), at_ns):
            try:
                return msgspec.json.decode(entry.data) == {"alive": True}
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                return False
        return default


class FolderReader:
    """Reads the summaries of the recordings in a folder."""

    def __init__(self) -> None:
        self._growing: OrderedDict[Path, RecordingIndex] = OrderedDict()

    def close(self) -> None:
        """Close the files that are being written."""
        for index in self._growing.values():
            index.close()
        self._growing.clear()

    def listing(self, path: Path) -> RecordingSummary:
        """Return the summary of a recording.

        Raises:
            RecordingError: If the file is not a recording.
        """
        with closing(RecordFile(path)) as file:
            if file.is_whole:
                self._forget(path)
                channels, _, start_ns, end_ns, counts = file.summary(chunks=False)
                if counts is None:
                    raise RecordingError(f"{path} has no index")
                found = {about[0] for about in channels.wanted(None).values()}
            else:
                index = self._index(path)
                start_ns, end_ns, found = index.start_ns, index.end_ns, set(index.topics)
            shown, marks = tuple(robots_in(found)[:MOST_ROBOTS]), read_marks(path)
            notes = tuple(mark.note[:_TEXT_LENGTH] for mark in marks[:_MOST_NOTES])
            return RecordingSummary(
                start_ns,
                end_ns,
                shown,
                file.size,
                file.is_whole,
                len(marks),
                notes,
                read_title(path),
            )

    def _index(self, path: Path) -> RecordingIndex:
        """Return the index of a growing file, reading only new data."""
        index = self._growing.get(path)
        if index is None:
            index = self._growing[path] = RecordingIndex(path)
            if len(self._growing) > _GROWING:
                self._forget(next(iter(self._growing)))
        index.refresh()
        return index

    def _forget(self, path: Path) -> None:
        if (index := self._growing.pop(path, None)) is not None:
            index.close()


def recorded_description(index: RecordingIndex, robot_id: str) -> Description:
    """Return the latest valid description of a robot.

    Raises:
        RecordingError: If the file has no description.
    """
    for entry in index.newest_first(Service.DESC.key(robot_id), _LATEST_NS):
        try:
            return msgspec.json.decode(entry.data, type=Description)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue  # Third-party robot.
    raise RecordingError(f"there is no description of '{robot_id}'")


def parse_recorded(text: str, robot_id: str) -> RobotDescription:
    """Parse the description of a recorded robot, without meshes.

    Raises:
        RobotFileError: If it cannot be used.
    """
    robot = robots.parse_description(text, f"description of {robot_id}")
    # The path refers to the robot's computer; locally it would name unrelated files.
    body = msgspec.structs.replace(robot.body, meshes=None)
    return msgspec.structs.replace(robot, body=body)
