"""Running instances (nodes and replays) per robot id, and a stop confirmed by every node."""

from __future__ import annotations

import threading

import msgspec

from tsd_twin.bus import Bus
from tsd_twin.errors import BusError
from tsd_twin.messages import topics
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import Reply, decode_json
from tsd_twin.messages.topics import Service

_MAX_INSTANCES = 4096
"""Bounds memory, because liveliness tokens on an open bus are not authenticated."""


class Instances:
    """Instances per robot id, from their liveliness tokens; thread-safe."""

    def __init__(self, bus: Bus, robot_id: str = "*") -> None:
        self._keys: dict[str, frozenset[str]] = {}
        self._count = 0
        self._lock = threading.Lock()
        bus.subscribe_liveliness(topics.instance_key(robot_id, "*"), self._note)

    def of(self, robot_id: str) -> frozenset[str]:
        """Return the token keys of a robot id."""
        return self._keys.get(robot_id, frozenset())

    def _note(self, key: str, is_alive: bool) -> None:
        try:
            robot_id = topics.robot_of(key)
        except BusError:
            return
        with self._lock:
            before = self.of(robot_id)
            after = before | {key} if is_alive else before - {key}
            grown = len(after) - len(before)
            if grown > 0 and self._count >= _MAX_INSTANCES:
                return
            self._count += grown
            if after:
                self._keys[robot_id] = after
            else:
                self._keys.pop(robot_id, None)


def live_count(instances: frozenset[str]) -> int:
    """Return the number of robots among the instances, excluding replays."""
    return sum(not topics.is_recording_key(key) for key in instances)


def stop_instances(
    bus: Bus, robot_id: str, payload: bytes, timeout_s: float, instances: frozenset[str]
) -> bytes | None:
    """Stop every instance of an id; return one reply, or None on timeout.

    The reply is `ok` only if every robot among `instances` confirms, and at least one does. Replays
    refuse and thus never confirm.
    """
    answers = bus.query_all(Service.STOP.key(robot_id), payload, timeout_s)
    if not answers:
        return None
    needed, confirmed = max(1, live_count(instances)), sum(map(is_ok, answers))
    if confirmed >= needed:
        return msgspec.json.encode(Reply(True))
    refused = [answer for answer in answers if not is_ok(answer)]
    if len(answers) == 1 and refused:
        return refused[0]
    text = f"{confirmed} of {needed} robots with the id '{robot_id}' confirmed the stop"
    return msgspec.json.encode(Reply(False, text))


def is_ok(answer: bytes) -> bool:
    """Return whether a stop reply confirms the stop."""
    try:
        return decode_json(answer, Reply, "an answer").ok
    except MessageError:
        return False
