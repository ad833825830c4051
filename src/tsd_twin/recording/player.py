"""Playback of a recording: the robots' states at any time, and replay on the bus.

A replay has a separate robot id and cannot be driven.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from tsd_twin.bus import Bus, Publisher
from tsd_twin.client.connection import SentCommand
from tsd_twin.client.monitor import RoundTrips, Snapshot
from tsd_twin.errors import BusError, RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.services import encode_refusal
from tsd_twin.messages.status import RECORDING, encode_stamp
from tsd_twin.messages.topics import Service
from tsd_twin.recording import mcap_file
from tsd_twin.recording.channels import RAW, Entry, topic_of
from tsd_twin.recording.data import Recording
from tsd_twin.recording.reader import (
    RecordingReader,
    RobotStates,
    decoders,
    parse_recorded,
)
from tsd_twin.recording.remote import RemoteReader
from tsd_twin.robots import RobotDescription

Reader: TypeAlias = RecordingReader | RemoteReader


class RecordedRobot:
    """Robot of a recording at a given time; drawn like a live robot, but accepts no commands."""

    sent_commands: Sequence[SentCommand] = ()
    """Commands sent by the dashboard, always empty."""

    def __init__(self, robot_id: str, robot: RobotDescription) -> None:
        self.id = robot_id
        self.robot = robot
        self.kinematics = robot.kinematics()
        self.round_trips = RoundTrips()
        self.snapshot = Snapshot()
        """Latest messages at this time; the object is replaced only if they change. Times of
        receipt are seconds since the start of the recording.
        """
        self.alive = False
        """Whether the node was on the bus."""
        self._decoders = decoders(robot)
        self._found: dict[str, Entry] = {}
        self._decoded: dict[str, Any] = {}

    def show(self, states: RobotStates, start_ns: int) -> None:
        """Set the state; `start_ns` is the start of the recording."""
        self.alive = states.alive
        before, found = self._found, states.found
        if found == before:
            return
        self._decoded = {
            name: self._decoded[name] if before.get(name) == each else decode(each.data)
            for name, decode in self._decoders.items()
            if (each := found.get(name)) is not None
        }
        self._found = found
        values: dict[str, Any] = {**self._decoded, "source": "recording"}
        times_s = {name: 1e-9 * (each.log_ns - start_ns) for name, each in found.items()}
        if "odom" in times_s:
            values["odom_received_s"] = times_s["odom"]
        if (status := found.get("status")) is not None:
            values["status_seq"] = status.sequence
            values["status_robot_s"] = 1e-9 * status.publish_ns
        if times_s:
            values["received_s"] = max(times_s.values())
        self.snapshot = Snapshot(**values)


class Player:
    """Shows all robots of a recording at an arbitrary time; not thread-safe.

    Reading raises a `RecordingError` if the file is damaged there.
    """

    def __init__(
        self, path: Path, robot_id: str | None = None, reader: Reader | None = None
    ) -> None:
        """Open one robot of a recording, or all; `reader` may run in another process.

        Raises:
            RecordingError: If the file is not a recording or lacks the robot.
        """
        self.path = path
        self.reader: Reader = RecordingReader(path) if reader is None else reader
        """Reader of the file; closed with the player."""
        self.t_s = 0.0
        """Displayed time, seconds since the start."""
        try:
            contents = self.reader.contents()
            self.start_ns, self._end_ns = contents.start_ns, contents.end_ns
            """Time of the first message, recorder's wall clock."""
            self.unknown = contents.unknown
            """Robots that cannot be shown, with the reasons."""
            self.robots: Mapping[str, RecordedRobot] = {
                each: RecordedRobot(each, parse_recorded(text, each))
                for each, text in contents.robots.items()
                if robot_id in (None, each)
            }
            """Robots that can be shown, by id."""
            if not self.robots:
                unknown = [
                    reason for each, reason in self.unknown.items() if robot_id in (None, each)
                ]
                reasons = "; ".join(unknown) or f"no robot '{robot_id or ''}' is in it"
                raise RecordingError(f"{path} cannot be shown: {reasons}")
            self.seek(0.0)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self.reader.close()

    @property
    def duration_s(self) -> float:
        """Duration so far; grows while the file is being written."""
        return 1e-9 * (self._end_ns - self.start_ns)

    def seek(self, t_s: float) -> None:
        """Show a time, in seconds since the start; same states as after playing up to it."""
        self.t_s = min(max(t_s, 0.0), self.duration_s)
        found = self.reader.states(list(self.robots), self._now_ns())
        for robot_id, robot in self.robots.items():
            robot.show(found[robot_id], self.start_ns)

    def step(self, robot_id: str, *, back: bool = False) -> None:
        """Show the time of a robot's next status, or of the previous one."""
        log_ns = self.reader.next_status_ns(robot_id, self._now_ns(), back=back)
        if log_ns is not None:
            self.seek(1e-9 * (log_ns - self.start_ns))

    def refresh(self) -> None:
        """Update the duration of a file that is being written."""
        self._end_ns = self.reader.contents().end_ns

    def _now_ns(self) -> int:
        return self.start_ns + round(1e9 * self.t_s)


LEAST_SPEED, MOST_SPEED = 0.1, 16.0


class PlaybackCursor:
    """Playback position, with time as an argument; pauses at the end."""

    def __init__(self, duration_s: float, now_s: float) -> None:
        self.duration_s = duration_s
        """Duration; grows while the recording is being written."""
        self.speed = 1.0
        """Playback speed factor."""
        self.playing = False
        self._t_s = 0.0
        self._since_s = now_s

    def t_s(self, now_s: float) -> float:
        """Return the displayed time, in seconds since the start of the recording."""
        if self.playing:
            self._t_s += max(0.0, now_s - self._since_s) * self.speed
            if self._t_s >= self.duration_s:
                self.playing = False
        self._since_s = now_s
        self._t_s = min(self._t_s, self.duration_s)
        return self._t_s

    def play(self, speed: float, now_s: float) -> None:
        """Play from the displayed time, or from the start if it is at the end."""
        t_s = self.t_s(now_s)
        self._t_s = 0.0 if t_s >= self.duration_s else t_s
        self.speed = min(max(speed, LEAST_SPEED), MOST_SPEED)
        self.playing = True

    def pause(self, now_s: float) -> None:
        """Pause playback."""
        self.t_s(now_s)
        self.playing = False

    def seek(self, t_s: float, now_s: float) -> None:
        """Show a time; playback continues from there."""
        self._t_s = min(max(t_s, 0.0), self.duration_s)
        self._since_s = now_s


_PREFIXES = ("state/", "event/", "sensor/")
"""Topics that are replayed. Commands are not, because they would bypass the command gate and their
leases have expired.
"""
_LOOK_S = 0.01


class Replay:
    """Publishes the recorded states of a robot on the bus and refuses all control."""

    def __init__(self, bus: Bus, recording: Recording, robot: str, replay_id: str) -> None:
        """Claim the id on the bus and answer services.

        Raises:
            BusError: If the id is taken or invalid.
            RecordingError: If the recording lacks the robot or its description.
        """
        alive = topics.alive_key(topics.checked(replay_id))
        if robot not in recording.robots:
            known = ", ".join(recording.robots) or "no robot"
            raise RecordingError(f"{recording.path} has {known}, not '{robot}'")
        if bus.living_tokens(alive):
            raise BusError(f"'{replay_id}' is on the bus already: choose another id with --id")
        self._bus, self._recording, self._robot, self._id = bus, recording, robot, replay_id
        refusal = because(Code.RECORDING, robot=robot)
        self._replies = {service: encode_refusal(service, refusal) for service in Service}
        self._replies[Service.DESC] = _recorded_description(recording, robot)
        self._publishers: dict[str, Publisher] = {}
        self._servers = {
            service: bus.queryable(service.key(replay_id), patterns=service is Service.DESC)
            for service in Service
        }
        # Declared like a node, so that a robot started later with this id detects the conflict.
        instance = topics.recording_key(replay_id, secrets.token_hex(8))
        self._tokens = [bus.declare_token(instance), bus.declare_token(alive)]

    def run(self, stop: threading.Event, speed: float = 1.0) -> None:
        """Publish the recording once, at `speed` times real time, until `stop` is set."""
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
            # A summary has an unmarked status; without one, dashboards follow the streams.
            and topic_of(topic) not in (None, topics.SUMMARY)
        }
        return mcap_file.entries(self._recording.path, wanted)

    def serve(self) -> None:
        """Answer all requests that have arrived: a recording refuses them."""
        for service, server in self._servers.items():
            for request in server.take_requests():
                request.reply(self._replies[service])

    def _serve_until(self, due_s: float, stop: threading.Event) -> None:
        while True:
            self.serve()
            left_s = due_s - time.monotonic()
            if left_s <= 0.0 or stop.wait(min(left_s, _LOOK_S)):
                return

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
    """Run a replay once, or repeatedly with `loop`."""
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
    """Mark a status as recorded."""
    try:
        value = msgspec.json.decode(status, type=dict[str, Any])
        value["hardware"] = {**value.get("hardware", {}), "kind": RECORDING}
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, TypeError, AttributeError):
        return status
    return msgspec.json.encode(value)
