"""Link of the client library over the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial

from tsd_twin.bus import Bus
from tsd_twin.client.connection import RobotConnection, numbered_status
from tsd_twin.client.errors import RobotSilent
from tsd_twin.client.link import Link
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.client.state import RobotState, Subscription
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, decode_joints
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import decode_json
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import Sample, Topic

_FIRST_STATE_S = 3.0


class BusLink(RobotConnection, Link):
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
        RobotConnection.__init__(self, bus, robot_id)
        Link.__init__(self)
        self._changed = threading.Condition(self.lock)
        self._samples: dict[Topic, Sample] = {}
        self._status: RobotStatus | None = None
        self._odometry: Odometry | None = None
        self._status_seq = 0
        self._received_s = 0.0
        self._events_watched = False
        self._wakeups: list[Callable[[], None]] = []
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
            if self._states:
                self._put_state(self.state())
            self._wake()

    def _receive_event(self, sample: Sample) -> None:
        try:
            event = decode_json(sample.payload, Event, "an event")
        except MessageError:
            return
        with self.lock:
            self._put_event(event)
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
            status, odometry = self._status, self._odometry
            assert status is not None  # noqa: S101  The constructor waits for both.
            assert odometry is not None  # noqa: S101  As above.
            joints, setpoint = self._samples[topics.JOINTS], self._samples[topics.SETPOINT]
            return RobotState(
                status,
                self._received_s,
                lambda: odometry,
                partial(self._optional_pose, self._samples.get(topics.TRUTH)),
                partial(self._optional_pose, self._samples.get(topics.ODOM_ALTERNATIVE)),
                lambda: decode_joints(joints.payload),
                lambda: decode_joints(setpoint.payload),
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

    def subscribe_events(self, subscription: Subscription[Event]) -> Subscription[Event]:
        """Add the latest past event and every new one to a subscription."""
        super().subscribe_events(subscription)
        with self.lock:
            first, self._events_watched = not self._events_watched, True
        if first:
            self._bus.subscribe_events(topics.EVENT.key(self.id), self._receive_event)
        return subscription

    def close(self) -> None:
        """Disconnect from the bus and end all subscriptions."""
        with self.lock:
            if self._closed:
                return
            Link.close(self)
        self._bus.close()
