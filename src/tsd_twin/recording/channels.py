"""Entries of a recording: what each message of the bus becomes in an MCAP file, and back.

A topic of the file is a key of the bus. Payloads stay as they are: CDR with the definition of its
ROS 2 type, JSON or MessagePack without a schema. The number of a state message is the `sequence`,
the robot's monotonic clock the `publish_time`. Attachments that do not fit, and payloads that no
reader could decode, are JSON on `<key>/raw`, with the `sequence` of their message.
"""

from __future__ import annotations

import base64
import functools
import itertools
import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from tsd_twin.control.logged_controller import Call, ServeCall, StopCall, decode_batch
from tsd_twin.errors import MessageError
from tsd_twin.messages import topics
from tsd_twin.messages.requests import Sample
from tsd_twin.messages.ros_types import decode_cdr
from tsd_twin.messages.status import decode_stamp
from tsd_twin.messages.topics import Topic

RAW = "/raw"
"""Ending of the topics for what has no place in the message itself."""
REQUESTS = "requests"
"""Topic below `twin/<robot>/` of all requests to its services, each with its answer."""
JSON, CDR, MSGPACK, BYTES = "json", "cdr", "msgpack", "application/octet-stream"
"""Encodings of messages."""
_SEQUENCE = 0xFFFFFFFF
_FROM_CLIENTS = frozenset({topics.TWIST, topics.SENSOR_POSE, topics.STOP})
"""Topics on which anything may be put, so that their payloads are checked."""


class Entry(NamedTuple):
    """One message of a recording."""

    topic: str
    encoding: str
    type: str
    """ROS 2 type of CDR, "" otherwise."""
    log_ns: int
    """When the recorder received it, by the wall clock of its machine."""
    publish_ns: int
    """Robot's monotonic clock for a state, `log_ns` otherwise."""
    sequence: int
    data: bytes


class RawMessage(msgspec.Struct, frozen=True, omit_defaults=True):
    """A message on a topic that ends with `/raw`."""

    attachment: str = ""
    """Hexadecimal."""
    payload: str | None = None
    """Base64, when the message itself is not in the file since no reader could decode it."""
    put: bool = True
    """False for a delete."""


class EntryMaker:
    """Makes the entries of a file from messages of the bus; counts those without a number."""

    def __init__(self) -> None:
        self._numbers: defaultdict[str, Iterator[int]] = defaultdict(lambda: itertools.count(1))

    def of_sample(self, sample: Sample, log_ns: int) -> Iterator[Entry]:
        """Yield the entries of one message."""
        topic = topic_of(sample.key)
        encoding, ros_type = encoding_of(topic)
        sequence, publish_ns, fits = self._stamp(sample, topic, log_ns)
        whole = sample.is_put and is_readable(topic, sample.payload)
        if whole:
            yield Entry(
                sample.key, encoding, ros_type, log_ns, publish_ns, sequence, sample.payload
            )
        if not (fits and whole):
            payload = None if whole else base64.b64encode(sample.payload).decode()
            message = RawMessage(sample.attachment.hex(), payload, sample.is_put)
            raw = msgspec.json.encode(message)
            yield Entry(sample.key + RAW, JSON, "", log_ns, publish_ns, sequence, raw)
        if topic is topics.INPUTS and whole:
            yield from self._requests(sample, log_ns)

    def of_json(self, topic: str, value: Any, log_ns: int) -> Entry:
        """Return an entry of the recorder itself."""
        sequence = next(self._numbers[topic]) & _SEQUENCE
        return Entry(topic, JSON, "", log_ns, log_ns, sequence, msgspec.json.encode(value))

    def _stamp(self, sample: Sample, topic: Topic | None, log_ns: int) -> tuple[int, int, bool]:
        """Return number, time, and whether these say all that is in the attachment."""
        if topic is not None and topic.path.startswith("state/"):
            try:
                sequence, robot_ns = decode_stamp(sample.attachment)
            except MessageError:
                pass
            else:
                if sequence <= _SEQUENCE and robot_ns >= 0:
                    return sequence, robot_ns, True
        number = next(self._numbers[sample.key]) & _SEQUENCE
        return number, log_ns, not sample.attachment

    def _requests(self, sample: Sample, log_ns: int) -> Iterator[Entry]:
        topic = sample.key.removesuffix(topics.INPUTS.path) + REQUESTS
        for call in decode_batch(sample.payload).calls:
            if (shown := _request(call)) is not None:
                yield self.of_json(topic, shown, log_ns)


def _request(call: Call) -> dict[str, Any] | None:
    if not isinstance(call, ServeCall | StopCall):
        return None
    return {
        "service": call.service if isinstance(call, ServeCall) else topics.Service.STOP,
        "request": _json_or_text(call.payload),
        "reply": _json_or_text(call.reply),
        "robot_s": call.now_s,
    }


def _json_or_text(payload: bytes) -> Any:
    try:
        return msgspec.json.decode(payload or b"{}")
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return payload.decode("utf-8", "replace")


@functools.lru_cache(maxsize=4096)
def topic_of(key: str) -> Topic | None:
    """Return the row of the table of topics that a key belongs to; None for other keys."""
    return next((topic for topic, pattern in _PATTERNS.items() if pattern.fullmatch(key)), None)


_PATTERNS = {
    topic: re.compile("twin/[^/]+/" + topic.path.replace("*", "[^/]+")) for topic in topics.TOPICS
}


def encoding_of(topic: Topic | None) -> tuple[str, str]:
    """Return encoding and ROS 2 type of a topic."""
    if topic is None:
        return BYTES, ""
    return (topic.type, "") if topic.type in (JSON, MSGPACK) else (CDR, topic.type)


def is_readable(topic: Topic | None, payload: bytes) -> bool:
    """Return whether a reader can decode a payload, where a client may have put anything."""
    try:
        if topic is topics.INPUTS:
            decode_batch(payload)
        elif topic is not None and topic in _FROM_CLIENTS:
            if topic.type == JSON:
                msgspec.json.decode(payload)
            else:
                decode_cdr(payload, topic.type)
    except (MessageError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return False
    return True


def robot_of(topic: str) -> str:
    """Return the robot id in a topic of a recording, "" when it has none."""
    parts = topic.split("/")
    return parts[1] if len(parts) > 2 and parts[0] == "twin" else ""
