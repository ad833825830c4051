"""Operator on the bus: reads states, calls services and sends commands."""

from __future__ import annotations

import itertools
import json
import threading
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np

from tests.support.robot_node import RunningNode, matched
from tests.support.virtual_fleet import VirtualNode
from tests.support.withheld import PATIENCE_S, wait_for
from tsd_twin.bus import Bus
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import (
    BASE,
    JointState,
    Odometry,
    TwistStamped,
    decode_joints,
    decode_odometry,
    encode_twist,
)
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.status import RobotStatus, decode_stamp, decode_status
from tsd_twin.messages.topics import QoS, Sample, Service


class BusOperator:
    """Bus client with all services and topics of a dashboard, without a dead-man switch."""

    def __init__(
        self, node: RunningNode | VirtualNode, name: str = "alice", streams: int = 5
    ) -> None:
        self.id, self.name, self.lease = node.id, name, "00" * 16
        self.twist_axes = node.robot.kinematics().twist_axes
        self.bus: Bus = node.client()
        self.newest: dict[str, Sample] = {}
        self.history: dict[str, list[Sample]] = {}
        self.events: list[dict[str, Any]] = []
        self._news = threading.Condition()
        self._pause = threading.Event()
        self._numbers = itertools.count(1)
        self._command = matched(
            self.bus.publisher(topics.twist_key(self.id, name), QoS.REAL_TIME, topics.TWIST.type)
        )
        self.bus.subscribe(f"twin/{self.id}/state/*", self._note)
        self.bus.subscribe_events(topics.EVENT.key(self.id), self._note_event)
        self.wait_until(lambda: len(self.newest) >= streams and "status" in self.newest)

    @classmethod
    def blind(cls, node: RunningNode) -> Self:
        """Return an operator of a robot without ground truth."""
        return cls(node, streams=4)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.close()

    def _note(self, sample: Sample) -> None:
        if sample.key == topics.SUMMARY.key(self.id):
            return  # Repeats the other streams.
        with self._news:
            what = sample.key.rpartition("/")[2]
            self.newest[what] = sample
            self.history.setdefault(what, []).append(sample)
            self._news.notify_all()

    def _note_event(self, sample: Sample) -> None:
        with self._news:
            self.events.append(json.loads(sample.payload))
            self._news.notify_all()

    def wait_until(self, condition: Callable[[], Any]) -> None:
        """Wait until received messages make a condition true."""
        with self._news:
            assert wait_for(self._news, condition), (self.status, self.events[-3:])

    # Received states.

    @property
    def status(self) -> RobotStatus:
        return decode_status(self.newest["status"].payload)

    @property
    def truth(self) -> Odometry:
        return decode_odometry(self.newest["truth"].payload)

    @property
    def odom(self) -> Odometry:
        return decode_odometry(self.newest["odom"].payload)

    @property
    def setpoint(self) -> JointState:
        return decode_joints(self.newest["setpoint"].payload)

    @property
    def texts(self) -> list[str]:
        """Texts of the events."""
        return [event["text"] for event in self.events]

    def together(self, *streams: str) -> list[Sample]:
        """Return the latest samples of all streams that belong to the same robot period."""
        samples = [
            {decode_stamp(sample.attachment)[1]: sample for sample in [*self.history[each]]}
            for each in streams
        ]
        latest_ns = max(set.intersection(*map(set, samples)))
        return [each[latest_ns] for each in samples]

    def wait_for(self, mode: str) -> None:
        self.wait_until(lambda: self.status.mode == mode)

    def wait_for_news(self) -> None:
        """Wait for a status that was sent after this call."""
        first = len(self.history["status"])
        self.wait_until(lambda: len(self.history["status"]) > first + 1)

    def track(self, what: str) -> Array:
        """Return the received poses (n, 4): robot time, x, y, heading."""
        rows = []
        for sample in self.history[what]:
            odometry = decode_odometry(sample.payload)
            rows.append([decode_stamp(sample.attachment)[1] * 1e-9, *odometry.xy_heading])
        return np.array(rows)

    # Requests and commands.

    def ask(self, service: Service, raw: bytes | None = None, **fields: Any) -> dict[str, Any]:
        payload = json.dumps(fields).encode() if raw is None else raw
        return json.loads(self.bus.query(service.key(self.id), payload, PATIENCE_S))

    def acquire(self, **fields: Any) -> dict[str, Any]:
        reply = self.ask(Service.LEASE, op="acquire", operator=self.name, **fields)
        self.lease = reply["lease"] or self.lease
        return reply

    def get_ready(self) -> None:
        """Take control and arm."""
        assert self.acquire()["granted"]
        assert self.ask(Service.ARM, lease=self.lease)["ok"]
        self.drive((0.0, 0.0, 0.0), until=lambda: self.status.mode == "ready")

    @property
    def seen(self) -> int:
        """Number of the latest status."""
        return decode_stamp(self.newest["status"].attachment)[0]

    def send(self, twist: Sequence[float], frame: str = BASE, seen: int | None = None) -> None:
        spatial = np.zeros(6)
        spatial[list(self.twist_axes)] = twist
        payload = encode_twist(TwistStamped(frame, spatial))
        seen = self.seen if seen is None else seen
        attachment = encode_attachment(next(self._numbers), bytes.fromhex(self.lease), seen)
        self._command.put(payload, attachment)

    def drive(
        self,
        twist: Sequence[float],
        seconds: float = np.inf,
        until: Callable[[], Any] = lambda: False,
        frame: str = BASE,
    ) -> None:
        """Send 50 commands per second for a time, or until a condition holds."""
        for _ in range(round(min(seconds, PATIENCE_S) / 0.02)):
            if until():
                return
            self.send(twist, frame)
            self._pause.wait(0.02)
        assert seconds < PATIENCE_S, "what was waited for has not been seen"
