"""Player of a recording: the state of all its robots at any time, and the time that is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin import robots
from tsd_twin.client.connection import RoundTrips, SentCommand, Snapshot
from tsd_twin.errors import MessageError, RecordingError, TwinError
from tsd_twin.lie import SO3
from tsd_twin.messages import topics
from tsd_twin.messages.ros import decode_joints, decode_odometry
from tsd_twin.messages.services import Description
from tsd_twin.messages.status import decode_status
from tsd_twin.messages.topics import Service, Topic
from tsd_twin.recording.channels import Entry, robot_of
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.robots import RobotDescription

_LATEST_NS = (1 << 63) - 1
_TRIED = 8
"""Messages of a stream that are tried until one can be decoded."""


class RecordedRobot:
    """Robot of a recording at one time; it can be drawn as a live one, and not be commanded."""

    sent_commands: Sequence[SentCommand] = ()
    """Commands of the dashboard: none."""

    def __init__(self, index: RecordingIndex, robot_id: str, robot: RobotDescription) -> None:
        self.id = robot_id
        self.robot = robot
        self.kinematics = robot.kinematics()
        self.round_trips = RoundTrips()
        self.snapshot = Snapshot()
        """Newest messages at this time; the same object as long as nothing has changed. Times of
        receipt are seconds since the start of the recording.
        """
        self.alive = False
        """Whether the node was on the bus."""
        self._index = index
        odometry = partial(decode_odometry, turning=self.kinematics.pose_type is SO3)
        self._streams: dict[str, tuple[Topic, Callable[[bytes], Any]]] = {
            "joints": (topics.JOINTS, decode_joints),
            "setpoint": (topics.SETPOINT, decode_joints),
            "odom": (topics.ODOM, odometry),
            "alternative": (topics.ODOM_ALTERNATIVE, odometry),
            "truth": (topics.TRUTH, odometry),
            "status": (topics.STATUS, decode_status),
        }
        self._shown: dict[str, tuple[Entry, Any] | None] = dict.fromkeys(self._streams)

    def show(self, at_ns: int) -> None:
        """Set the state to that of a time, by the wall clock of the recorder.

        Raises:
            RecordingError: the file is damaged there.
        """
        found = {
            name: self._newest(name, topic.key(self.id), decode, at_ns)
            for name, (topic, decode) in self._streams.items()
        }
        self.alive = self._is_alive(at_ns, default=found["status"] is not None)
        if all(found[name] is shown for name, shown in self._shown.items()):
            return
        self._shown = found
        values: dict[str, Any] = {name: each[1] for name, each in found.items() if each}
        start_ns = self._index.start_ns
        times_s = {name: 1e-9 * (each[0].log_ns - start_ns) for name, each in found.items() if each}
        if "odom" in times_s:
            values["odom_received_s"] = times_s["odom"]
        if (status := found["status"]) is not None:
            values["status_seq"] = status[0].sequence
            values["status_robot_s"] = 1e-9 * status[0].publish_ns
        if times_s:
            values["received_s"] = max(times_s.values())
        self.snapshot = Snapshot(**values)

    def _newest(
        self, name: str, key: str, decode: Callable[[bytes], Any], at_ns: int
    ) -> tuple[Entry, Any] | None:
        """Newest message of a stream that can be decoded; as live, others are passed over."""
        shown = self._shown[name]
        for count, entry in enumerate(self._index.newest_first(key, at_ns)):
            if shown is not None and shown[0] == entry:
                return shown
            try:
                return entry, decode(entry.data)
            except MessageError:
                if count == _TRIED:
                    break
        return None

    def _is_alive(self, at_ns: int, *, default: bool) -> bool:
        for entry in self._index.newest_first(topics.alive_key(self.id), at_ns):
            try:
                return msgspec.json.decode(entry.data) == {"alive": True}
            except msgspec.DecodeError:
                return False
        return default


class Player:
    """Player of one recording: all its robots at a time, which may jump to and fro.

    It belongs to one thread.
    """

    def __init__(self, path: Path, robot_id: str | None = None) -> None:
        """Open a recording, for one of its robots or for all.

        Raises:
            RecordingError: it is none, or has no such robot.
        """
        self.index = RecordingIndex(path)
        self.t_s = 0.0
        """Time that is shown, in seconds since the start."""
        self.unknown: dict[str, str] = {}
        """Robots that cannot be shown, each with the reason."""
        shown: dict[str, RecordedRobot] = {}
        for each in sorted({robot_of(topic) for topic in self.index.topics} - {"", "*"}):
            if robot_id in (None, each):
                try:
                    shown[each] = RecordedRobot(self.index, each, _description(self.index, each))
                except TwinError as error:
                    self.unknown[each] = str(error)
        self.robots: Mapping[str, RecordedRobot] = shown
        """Robots that can be shown, by id."""
        if not shown:
            self.index.close()
            reasons = "; ".join(self.unknown.values()) or f"no robot '{robot_id or ''}' is in it"
            raise RecordingError(f"{path} cannot be shown: {reasons}")
        self.seek(0.0)

    def close(self) -> None:
        """Close the file."""
        self.index.close()

    @property
    def duration_s(self) -> float:
        """Duration up to now: a file that is being written gets longer."""
        return 1e-9 * (self.index.end_ns - self.index.start_ns)

    def seek(self, t_s: float) -> None:
        """Show a time, in seconds since the start; the states are those of playing through.

        Raises:
            RecordingError: the file is damaged there.
        """
        self.t_s = min(max(t_s, 0.0), self.duration_s)
        at_ns = self.index.start_ns + round(1e9 * self.t_s)
        for robot in self.robots.values():
            robot.show(at_ns)

    def step(self, robot_id: str, *, back: bool = False) -> None:
        """Show the time of the next status of a robot, or of the one before.

        Raises:
            RecordingError: the file is damaged there.
        """
        key, at_ns = topics.STATUS.key(robot_id), self.index.start_ns + round(1e9 * self.t_s)
        if back:
            found = next(self.index.newest_first(key, at_ns - 1), None)
        else:
            found = self.index.first_after(key, at_ns)
        if found is not None:
            self.seek(1e-9 * (found.log_ns - self.index.start_ns))

    def refresh(self) -> None:
        """Take in what was written since, to a file that is being written."""
        self.index.refresh()


def _description(index: RecordingIndex, robot_id: str) -> RobotDescription:
    """Return the newest description of a robot that is one, without meshes.

    Raises:
        RecordingError: there is none.
        RobotFileError: it cannot be used.
    """
    for entry in index.newest_first(Service.DESC.key(robot_id), _LATEST_NS):
        try:
            text = msgspec.json.decode(entry.data, type=Description).robot
        except msgspec.DecodeError:
            continue  # Not of a robot of ours.
        robot = robots.parse_description(text, f"description of {robot_id}")
        # A folder on the robot's computer; on this one the path names other files.
        body = msgspec.structs.replace(robot.body, meshes=None)
        return msgspec.structs.replace(robot, body=body)
    raise RecordingError(f"there is no description of '{robot_id}'")


LEAST_SPEED, MOST_SPEED = 0.1, 16.0


class Playback:
    """Cursor of a recording, with the time as an argument; it pauses at the end."""

    def __init__(self, duration_s: float, now_s: float) -> None:
        self.duration_s = duration_s
        """Duration; it grows while the recording is written."""
        self.speed = 1.0
        """Factor of the speed at which it plays."""
        self.playing = False
        self._t_s = 0.0
        self._since_s = now_s

    def t_s(self, now_s: float) -> float:
        """Return the time that is shown, in seconds since the start of the recording."""
        if self.playing:
            self._t_s += max(0.0, now_s - self._since_s) * self.speed
            if self._t_s >= self.duration_s:
                self.playing = False
        self._since_s = now_s
        self._t_s = min(self._t_s, self.duration_s)
        return self._t_s

    def play(self, speed: float, now_s: float) -> None:
        """Play from the time that is shown, or from the start when that is the end."""
        t_s = self.t_s(now_s)
        self._t_s = 0.0 if t_s >= self.duration_s else t_s
        self.speed = min(max(speed, LEAST_SPEED), MOST_SPEED)
        self.playing = True

    def pause(self, now_s: float) -> None:
        """Stand still."""
        self.t_s(now_s)
        self.playing = False

    def seek(self, t_s: float, now_s: float) -> None:
        """Show a time; playing goes on from there."""
        self._t_s = min(max(t_s, 0.0), self.duration_s)
        self._since_s = now_s
