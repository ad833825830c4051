"""Link of the client library over the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Protocol

from tsd_twin.bus import Bus
from tsd_twin.client.connection import RobotConnection, numbered_status
from tsd_twin.client.errors import RobotSilent
from tsd_twin.client.port import BlockingPort
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.client.state import RobotState, Subscription
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import JointState, Odometry, decode_joints
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import decode_json
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import Topic
from tsd_twin.robots import RobotDescription

_FIRST_STATE_S = 3.0


class Link(BlockingPort, Protocol):
    """Connection to one robot; thread-safe unless noted otherwise."""

    id: str
    """Robot id on the bus."""
    robot: RobotDescription
    """Robot description."""
    virtual: bool
    """Whether time is virtual and advances only in `sleep_until` and `wait_for_status`."""

    def wall_ns(self) -> int:
        """Return the wall-clock time in nanoseconds, used to stamp pose measurements."""
        ...

    def send_pose(self, payload: bytes) -> None:
        """Publish a pose measurement."""
        ...

    def state(self) -> RobotState:
        """Return the latest state."""
        ...

    def attach(self, protocol: ControlProtocol) -> None:
        """Start passing states to a protocol and sending its due setpoints and renewals."""
        ...

    def detach(self, protocol: ControlProtocol) -> None:
        """Undo `attach`."""
        ...

    def subscribe_states(self, subscription: Subscription[RobotState]) -> Subscription[RobotState]:
        """Add every new state to a subscription until it is closed."""
        ...

    def subscribe_events(self, subscription: Subscription[Event]) -> Subscription[Event]:
        """Add every new event to a subscription until it is closed."""
        ...

    def close(self) -> None:
        """Disconnect from the robot and end all subscriptions."""
        ...

    @property
    def closed(self) -> bool:
        """Whether the connection is closed."""
        ...


class BusLink(RobotConnection):
    """Bus connection with callbacks: stores and forwards each message, and wakes readers.

    Zenoh calls back on its own threads.
    """

    def __init__(self, bus: Bus, robot_id: str) -> None:
        """Fetch the description and wait for the first state; takes ownership of `bus`.

        Raises:
            BusError: If the robot does not respond.
            RobotFileError: If its description is invalid.
            RobotSilent: If it sends no state.
        """
        super().__init__(bus, robot_id)
        self._changed = threading.Condition(self.lock)
        self._samples: dict[Topic, Sample] = {}
        self._status: RobotStatus | None = None
        self._odometry: Odometry | None = None
        self._status_seq = 0
        self._received_s = 0.0
        self._protocols: list[ControlProtocol] = []
        self._states: list[Subscription[RobotState]] = []
        self._events: list[Subscription[Event]] = []
        self._events_watched = False
        self._wakeups: list[Callable[[], None]] = []
        self._closed = False
        for topic in (topics.JOINTS, topics.SETPOINT, topics.TRUTH, topics.ODOM_ALTERNATIVE):
            self.subscribe(topic, partial(self._samples.__setitem__, topic))
        self.subscribe(topics.STATUS, self._receive_status)
        self.subscribe(topics.ODOM, self._receive_odometry)
        self._wait_for_first_state()

    def _wait_for_first_state(self) -> None:
        needed = (topics.JOINTS, topics.SETPOINT)

        def complete() -> bool:
            known = self._status is not None and self._odometry is not None
            return known and all(topic in self._samples for topic in needed)

        end_s = time.monotonic() + _FIRST_STATE_S
        with self._changed:
            while not complete():
                if time.monotonic() > end_s:
                    raise RobotSilent(f"{self.id} answers, but sends no state", "no_state")
                self._changed.wait(0.1)

    # Received messages, on Zenoh threads.

    def _receive_status(self, sample: Sample) -> None:
        try:
            status, seq = numbered_status(sample)
        except MessageError:
            return  # Another program writes on this key; the age of the state reveals it.
        with self._changed:
            now_s = self._received_s = time.monotonic()
            self._status, self._status_seq = status, seq
            for protocol in self._protocols:
                protocol.receive_status(status, seq, now_s)
            self._changed.notify_all()
            self._wake()

    def _receive_odometry(self, sample: Sample) -> None:
        try:
            odometry = self.decode_odometry(sample.payload)
        except MessageError:
            return
        with self._changed:
            now_s = self._received_s = time.monotonic()
            self._odometry = odometry
            for protocol in self._protocols:
                protocol.receive_odometry(odometry.xy_heading, odometry.twist, now_s)
            if self._states and self._status is not None and topics.JOINTS in self._samples:
                state = self._snapshot(self._status, odometry)
                self._states = [each for each in self._states if not each.closed]
                for subscription in self._states:
                    subscription.put(state)
            self._wake()

    def _receive_event(self, sample: Sample) -> None:
        try:
            event = decode_json(sample.payload, Event, "an event")
        except MessageError:
            return
        with self.lock:
            self._events = [each for each in self._events if not each.closed]
            for subscription in self._events:
                subscription.put(event)
            self._wake()

    def _wake(self) -> None:
        for wakeup in self._wakeups:
            wakeup()

    def on_change(self, wakeup: Callable[[], None]) -> None:
        """Call `wakeup` on a Zenoh thread whenever a message arrives."""
        with self.lock:
            self._wakeups.append(wakeup)

    def sleep_until(self, until_s: float) -> None:
        """Sleep until `until_s`."""
        time.sleep(max(0.0, until_s - time.monotonic()))

    def wait_for_status(self, until_s: float) -> None:
        """Wait for the next status, at most until `until_s`."""
        with self._changed:
            seen = self._status
            self._changed.wait_for(
                lambda: self._status is not seen, max(0.0, until_s - time.monotonic())
            )

    def state(self) -> RobotState:
        """Return the latest state."""
        with self.lock:
            assert self._status is not None  # noqa: S101  The constructor waits for both.
            assert self._odometry is not None  # noqa: S101  As above.
            return self._snapshot(self._status, self._odometry)

    def _snapshot(self, status: RobotStatus, odometry: Odometry) -> RobotState:
        get = self._samples.get
        joints, setpoint = self._samples[topics.JOINTS], self._samples[topics.SETPOINT]
        return RobotState(
            status,
            self._received_s,
            lambda: odometry,
            partial(self._optional_pose, get(topics.TRUTH)),
            partial(self._optional_pose, get(topics.ODOM_ALTERNATIVE)),
            cache(partial(_joints, joints)),
            cache(partial(_joints, setpoint)),
        )

    def _optional_pose(self, sample: Sample | None) -> Odometry | None:
        return None if sample is None else self.decode_odometry(sample.payload)

    def attach(self, protocol: ControlProtocol) -> None:
        """Start passing states to a protocol; the caller sends its due commands."""
        with self.lock:
            if self._status is not None:
                protocol.receive_status(self._status, self._status_seq, self._received_s)
            if self._odometry is not None:
                protocol.receive_odometry(
                    self._odometry.xy_heading, self._odometry.twist, self._received_s
                )
            self._protocols.append(protocol)

    def detach(self, protocol: ControlProtocol) -> None:
        """Stop passing states to a protocol."""
        with self.lock:
            self._protocols = [each for each in self._protocols if each is not protocol]

    def subscribe_states(self, subscription: Subscription[RobotState]) -> Subscription[RobotState]:
        """Add a state for each `state/odom` to a subscription until it is closed."""
        with self.lock:
            self._states = [*self._states, subscription]
        return subscription

    def subscribe_events(self, subscription: Subscription[Event]) -> Subscription[Event]:
        """Add the latest past event and every new one to a subscription."""
        with self.lock:
            self._events = [*self._events, subscription]
            first, self._events_watched = not self._events_watched, True
        if first:
            self._bus.subscribe_events(topics.EVENT.key(self.id), self._receive_event)
        return subscription

    def close(self) -> None:
        """Disconnect from the bus and end all subscriptions."""
        with self.lock:
            if self._closed:
                return
            self._closed = True
            ending: list[Subscription[Any]] = [*self._states, *self._events]
        for subscription in ending:
            subscription.close()
        self._bus.close()

    @property
    def closed(self) -> bool:
        """Whether the connection is closed."""
        return self._closed


def _joints(sample: Sample) -> JointState:
    return decode_joints(sample.payload)
