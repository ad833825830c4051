"""Player of a recording: the state of its robots at any time, and replay on the bus.

A replay has an id of its own and cannot be driven.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin import robots
from tsd_twin.bus import Bus, Publisher, Request
from tsd_twin.client.connection import RoundTrips, SentCommand, Snapshot
from tsd_twin.errors import BusError, MessageError, RecordingError, TwinError
from tsd_twin.lie import SO3
from tsd_twin.messages import topics
from tsd_twin.messages.requests import Description, encode_refusal
from tsd_twin.messages.ros import decode_joints, decode_odometry
from tsd_twin.messages.status import RECORDING, decode_status, encode_stamp
from tsd_twin.messages.topics import Service, Topic
from tsd_twin.recording import mcap_file
from tsd_twin.recording.channels import RAW, Entry, robot_of, topic_of
from tsd_twin.recording.data import Recording
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
        values["source"] = "recording"
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


_PREFIXES = ("state/", "event/", "sensor/")
"""What is replayed. Commands are not: no gate would judge them, and their leases are over."""
_LOOK_S = 0.01


class Replay:
    """Source on the bus that sends the states of one recorded robot and refuses all control."""

    def __init__(self, bus: Bus, recording: Recording, robot: str, replay_id: str) -> None:
        """Claim the id on the bus and answer services.

        Raises:
            BusError: the id is taken or invalid.
            RecordingError: the robot or its description is not in the recording.
        """
        alive = topics.alive_key(topics.checked(replay_id))
        if robot not in recording.robots:
            known = ", ".join(recording.robots) or "no robot"
            raise RecordingError(f"{recording.path} has {known}, not '{robot}'")
        if bus.living_tokens(alive):
            raise BusError(f"'{replay_id}' is on the bus already: choose another id with --id")
        self._bus, self._recording, self._robot, self._id = bus, recording, robot, replay_id
        self._description = _recorded_description(recording, robot)
        self._refusal = f"this is a recording of '{robot}': it cannot be driven or stopped"
        self._publishers: dict[str, Publisher] = {}
        self._servers = {
            service: bus.queryable(service.key(replay_id), patterns=service is Service.DESC)
            for service in Service
        }
        # As a node does, so that a robot that is started with this id later reports it.
        instance = topics.recording_key(replay_id, secrets.token_hex(8))
        self._tokens = [bus.declare_token(instance), bus.declare_token(alive)]

    def run(self, stop: threading.Event, speed: float = 1.0) -> None:
        """Send the recording once, `speed` times as fast as it was, until `stop` is set."""
        start_s = time.monotonic()
        first_ns: int | None = None
        for entry in self._entries():
            first_ns = entry.log_ns if first_ns is None else first_ns
            due_s = start_s + (entry.log_ns - first_ns) * 1e-9 / speed
            self._serve_until(due_s, stop)
            if stop.is_set():
                return
            self._send(entry)

    def close(self) -> None:
        """Leave the bus."""
        for token in self._tokens:
            token.close()

    def _entries(self) -> Iterator[Entry]:
        above = f"twin/{self._robot}/"
        wanted = {
            topic
            for topic in self._recording.topics
            if topic.startswith(tuple(above + prefix for prefix in _PREFIXES))
            and not topic.endswith(RAW)
            and topic_of(topic) is not None
        }
        return mcap_file.entries(self._recording.path, wanted)

    def _serve_until(self, due_s: float, stop: threading.Event) -> None:
        while True:
            self._serve()
            left_s = due_s - time.monotonic()
            if left_s <= 0.0 or stop.wait(min(left_s, _LOOK_S)):
                return

    def _serve(self) -> None:
        for service, server in self._servers.items():
            for request in server.take_requests():
                self._answer(service, request)

    def _answer(self, service: Service, request: Request) -> None:
        if service is Service.DESC:
            request.reply(self._description)
        else:
            request.reply(encode_refusal(service, self._refusal))

    def _send(self, entry: Entry) -> None:
        topic = topic_of(entry.topic)
        assert topic is not None  # noqa: S101  `run` plays entries of topics only.
        path = entry.topic.removeprefix(f"twin/{self._robot}/")
        if path not in self._publishers:
            key = f"twin/{self._id}/{path}"
            self._publishers[path] = self._bus.publisher(key, topic.qos, topic.type)
        data, attachment = entry.data, b""
        if path.startswith("state/"):
            attachment = encode_stamp(entry.sequence, entry.publish_ns)
        if topic is topics.STATUS:
            data = _marked(data)
        self._publishers[path].put(data, attachment)


def play(replay: Replay, stop: threading.Event, speed: float, *, loop: bool = False) -> None:
    """Run a replay once, or again and again with `loop`."""
    while not stop.is_set():
        replay.run(stop, speed)
        if not loop:
            return


def _recorded_description(recording: Recording, robot: str) -> bytes:
    for message in recording.messages(Service.DESC, robot=robot):
        if message.value is not None:
            return msgspec.json.encode(message.value)
    raise RecordingError(f"{recording.path} has no description of '{robot}'")


def _marked(status: bytes) -> bytes:
    """Return a status that says that it is of a recording."""
    try:
        value = msgspec.json.decode(status, type=dict[str, Any])
        value["hardware"] = {**value.get("hardware", {}), "kind": RECORDING}
    except (msgspec.DecodeError, TypeError, AttributeError):
        return status
    return msgspec.json.encode(value)
