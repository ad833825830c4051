"""Replay: a recording as a source on the bus, under an id of its own, that cannot be driven."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Iterator
from typing import Any

import msgspec

from tsd_twin.bus import Bus, Publisher, Request
from tsd_twin.errors import BusError, RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.status import encode_stamp
from tsd_twin.messages.topics import Service
from tsd_twin.recording import mcap_file
from tsd_twin.recording.channels import RAW, Entry, topic_of
from tsd_twin.recording.data import Recording

_PREFIXES = ("state/", "event/", "sensor/")
"""What is replayed. Commands are not: no gate would judge them, and their leases are over."""
_LOOK_S = 0.01
HARDWARE = "recording"
"""`hardware.kind` in each status, so that no page takes it for a robot."""


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
        self._description = _description(recording, robot)
        self._refusal = f"this is a recording of '{robot}': it cannot be driven or stopped"
        self._publishers: dict[str, Publisher] = {}
        self._servers = {
            service: bus.queryable(service.key(replay_id), patterns=service is Service.DESC)
            for service in Service
        }
        # As a node does, so that a robot that is started with this id later reports it.
        instance = topics.instance_key(replay_id, secrets.token_hex(8))
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
        elif service is Service.LEASE:
            request.reply(msgspec.json.encode(LeaseReply(False, reason=self._refusal)))
        else:
            request.reply(msgspec.json.encode(Reply(False, self._refusal)))

    def _send(self, entry: Entry) -> None:
        topic = topic_of(entry.topic)
        assert topic is not None  # noqa: S101  Others were left out.
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


def _description(recording: Recording, robot: str) -> bytes:
    for message in recording.messages(Service.DESC, robot=robot):
        if message.value is not None:
            return msgspec.json.encode(message.value)
    raise RecordingError(f"{recording.path} has no description of '{robot}'")


def _marked(status: bytes) -> bytes:
    """Return a status that says that it is of a recording."""
    try:
        value = msgspec.json.decode(status, type=dict[str, Any])
        value["hardware"] = {**value.get("hardware", {}), "kind": HARDWARE}
    except (msgspec.DecodeError, TypeError, AttributeError):
        return status
    return msgspec.json.encode(value)
