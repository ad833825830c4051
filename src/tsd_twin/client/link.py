"""Connection of a script to one robot: its interface, and the implementation over the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Protocol

from tsd_twin.bus import Bus
from tsd_twin.client.connection import RobotConnection, numbered_status
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.client.state import RobotState, Subscription
from tsd_twin.client.steps import BlockingPort
from tsd_twin.errors import MessageError, RobotSilent
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.ros import JointState, Odometry, decode_joints
from tsd_twin.messages.services import Event, decode_json
from tsd_twin.messages.status import Status
from tsd_twin.messages.topics import Topic
from tsd_twin.robots import RobotDescription

_FIRST_STATE_S = 3.0


class Link(BlockingPort, Protocol):
    """Connection to one robot; thread-safe, except where a method says otherwise."""

    id: str
    """Of the robot on the bus."""
    robot: RobotDescription
    """Its description."""
    virtual: bool
    """Whether time is virtual, and passes only in `sleep_until` and `wait_for_status`."""

    def wall_ns(self) -> int:
        """Return the wall clock that pose measurements are stamped with."""
        ...

    def send_pose(self, payload: bytes) -> None:
        """Publish a pose measurement."""
        ...

    def state(self) -> RobotState:
        """Return the newest state."""
        ...

    def attach(self, protocol: ControlProtocol) -> None:
        """Start to pass states to a protocol, and to send its due set-points and renewals."""
        ...

    def detach(self, protocol: ControlProtocol) -> None:
        """Stop what `attach` started."""
        ...

    def subscribe_states(self, subscription: Subscription[RobotState]) -> Subscription[RobotState]:
        """Fill a subscription with every new state, until it is closed."""
        ...

    def subscribe_events(self, subscription: Subscription[Event]) -> Subscription[Event]:
        """Fill a subscription with every new event, until it is closed."""
        ...

    def close(self) -> None:
        """Leave the robot; subscriptions end."""
        ...

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        ...


class BusLink(RobotConnection):
    """Connection over the bus with callbacks: each message is stored, passed on, and wakes readers.

    Zenoh calls back on its own threads.
    """

    def __init__(self, bus: Bus, robot_id: str) -> None:
        """Fetch the description of a robot and wait for its first state; closes `bus` at the end.

        Raises:
            BusError: the robot does not answer.
            RobotFileError: its description cannot be used.
            RobotSilent: it sends no state.
        """
        super().__init__(bus, robot_id)
        self._changed = threading.Condition(self.lock)
        self._samples: dict[Topic, Sample] = {}
        self._status: Status | None = None
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
                    raise RobotSilent(f"{self.id} answers, but sends no state")
                self._changed.wait(0.1)

    # Received messages, on threads of Zenoh.

    def _receive_status(self, sample: Sample) -> None:
        try:
            status, seq = numbered_status(sample)
        except MessageError:
            return  # Another program writes on this key; the age of the state shows it.
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
                protocol.receive_odometry(odometry, now_s)
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
        """Call `wakeup` on a thread of Zenoh whenever something new has come in."""
        with self.lock:
            self._wakeups.append(wakeup)

    def sleep_until(self, until_s: float) -> None:
        """Wait until a time."""
        time.sleep(max(0.0, until_s - time.monotonic()))

    def wait_for_status(self, until_s: float) -> None:
        """Wait for the next status, or until a time."""
        with self._changed:
            seen = self._status
            self._changed.wait_for(
                lambda: self._status is not seen, max(0.0, until_s - time.monotonic())
            )

    def state(self) -> RobotState:
        """Return the newest state."""
        with self.lock:
            assert self._status is not None  # noqa: S101  The constructor has waited for both.
            assert self._odometry is not None  # noqa: S101  As above.
            return self._snapshot(self._status, self._odometry)

    def _snapshot(self, status: Status, odometry: Odometry) -> RobotState:
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
        """Hand states to a protocol from now on; the client sends what is due."""
        with self.lock:
            if self._status is not None:
                protocol.receive_status(self._status, self._status_seq, self._received_s)
            if self._odometry is not None:
                protocol.receive_odometry(self._odometry, self._received_s)
            self._protocols.append(protocol)

    def detach(self, protocol: ControlProtocol) -> None:
        """Hand it no more states."""
        with self.lock:
            self._protocols = [each for each in self._protocols if each is not protocol]

    def subscribe_states(self, subscription: Subscription[RobotState]) -> Subscription[RobotState]:
        """Fill a subscription with a state for each `state/odom`, until it is closed."""
        with self.lock:
            self._states = [*self._states, subscription]
        return subscription

    def subscribe_events(self, subscription: Subscription[Event]) -> Subscription[Event]:
        """Fill a subscription with the newest events of the past, and every new one."""
        with self.lock:
            self._events = [*self._events, subscription]
            first, self._events_watched = not self._events_watched, True
        if first:
            self._bus.subscribe_events(topics.EVENT.key(self.id), self._receive_event)
        return subscription

    def close(self) -> None:
        """Leave the bus; subscriptions end."""
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
        """Whether it was closed."""
        return self._closed


def _joints(sample: Sample) -> JointState:
    return decode_joints(sample.payload)
