"""Mapping between bus messages and MCAP entries.

An MCAP topic is a bus key. Payloads are stored unchanged: CDR with its ROS 2 type definition, JSON
or MessagePack without a schema. For state messages, `sequence` is the message number and
`publish_time` the robot's monotonic clock. Attachments that do not fit, and payloads that readers
could not decode, are stored as JSON on `<key>/raw` with the `sequence` of their message.
"""

from __future__ import annotations

import base64
import functools
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import msgspec

from tsd_twin.control.logged_controller import Call, ServeCall, StopCall, decode_batch
from tsd_twin.messages import topics
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.ros_types import decode_cdr
from tsd_twin.messages.status import decode_stamp
from tsd_twin.messages.topics import Sample, Topic

RAW = "/raw"
"""Suffix of the topics for data that does not fit in the message itself."""
REQUESTS = "requests"
"""Topic below `twin/<robot>/` for all service requests and replies."""
JSON, CDR, MSGPACK, BYTES = "json", "cdr", "msgpack", "application/octet-stream"
"""Message encodings."""
_SEQUENCE = 0xFFFFFFFF
_FROM_CLIENTS = frozenset({topics.TWIST, topics.SENSOR_POSE, topics.STOP})
"""Topics on which clients may put anything, so that their payloads are validated."""


class Entry(NamedTuple):
    """One message of a recording."""

    topic: str
    encoding: str
    type: str
    """ROS 2 type if CDR, else ""."""
    log_ns: int
    """Time of receipt, recorder's wall clock."""
    publish_ns: int
    """Robot's monotonic clock for states, else `log_ns`."""
    sequence: int
    data: bytes


class RawMessage(msgspec.Struct, frozen=True, omit_defaults=True):
    """Message on a topic with suffix `/raw`."""

    attachment: str = ""
    """Hexadecimal."""
    payload: str | None = None
    """Base64, if the message itself is not stored because readers could not decode it."""
    put: bool = True
    """False for a delete."""


class EntryMaker:
    """Converts bus messages to file entries; numbers messages that have no sequence number."""

    def __init__(self) -> None:
        self._numbers: defaultdict[str, Iterator[int]] = defaultdict(lambda: itertools.count(1))

    def of_sample(self, sample: Sample, log_ns: int) -> Iterator[Entry]:
        """Yield the entries for one message."""
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
        """Return an entry created by the recorder."""
        sequence = next(self._numbers[topic]) & _SEQUENCE
        return Entry(topic, JSON, "", log_ns, log_ns, sequence, msgspec.json.encode(value))

    def _stamp(self, sample: Sample, topic: Topic | None, log_ns: int) -> tuple[int, int, bool]:
        """Return sequence number, publish time, and whether they cover the whole attachment."""
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
    """Return the topic of a key, or None if unknown."""
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
    """Return whether readers can decode a payload; False only for malformed client data."""
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
    """Return the robot id in a topic, or ""."""
    parts = topic.split("/")
    return parts[1] if len(parts) > 2 and parts[0] == "twin" else ""


def robots_in(found: Iterable[str]) -> list[str]:
    """Return the ids of the robots in some topics, sorted."""
    return sorted({robot_of(topic) for topic in found} - {"", "*"})
