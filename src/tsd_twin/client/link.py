"""Connection of a client to one robot, on the bus or in virtual time."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from functools import partial
from typing import Any, TypeVar

from tsd_twin.client.port import (
    Call,
    Compute,
    NextStatus,
    Outcome,
    Procedure,
    SendStop,
    Sleep,
    Step,
    advance,
)
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.client.state import RobotState, Subscription
from tsd_twin.messages.events import Event
from tsd_twin.messages.topics import Service
from tsd_twin.robots import RobotDescription

T = TypeVar("T")


class Link(ABC):
    """Connection to one robot; thread-safe unless noted otherwise."""

    id: str
    """Robot id on the bus."""
    robot: RobotDescription
    """Robot description."""
    virtual: bool
    """Whether time is virtual and advances only in `sleep_until` and `wait_for_status`."""
    lock: threading.RLock
    """Guards the attached protocols and the subscriptions."""

    def __init__(self) -> None:
        self._protocols: list[ControlProtocol] = []
        self._states: list[Subscription[RobotState]] = []
        self._events: list[Subscription[Event]] = []
        self._closed = False

    def protocol(self, operator: str, name: str = "") -> ControlProtocol:
        """Return a protocol for an operator, which signs if this connection has a key."""
        return ControlProtocol(self.id, self.robot, operator, name)

    @abstractmethod
    def now_s(self) -> float:
        """Return the monotonic or virtual time."""

    @abstractmethod
    def wall_ns(self) -> int:
        """Return the wall-clock time in nanoseconds, used to stamp pose measurements."""

    @abstractmethod
    def call(self, service: Service, payload: bytes, timeout_s: float) -> bytes | None:
        """Call a service and return its response, or None on timeout."""

    @abstractmethod
    def send(self, command: TwistCommand) -> None:
        """Publish a command."""

    @abstractmethod
    def send_stop(self, payload: bytes) -> None:
        """Publish a stop without waiting for an acknowledgement."""

    @abstractmethod
    def send_pose(self, payload: bytes) -> None:
        """Publish a pose measurement."""

    @abstractmethod
    def sleep_until(self, until_s: float) -> None:
        """Sleep until `until_s`."""

    @abstractmethod
    def wait_for_status(self, until_s: float) -> None:
        """Wait for the next status, at most until `until_s`."""

    @abstractmethod
    def state(self) -> RobotState:
        """Return the latest state."""

    # Procedures.

    def run(self, procedure: Procedure[T]) -> T:
        """Run a procedure in this thread; errors of a step are raised inside it."""
        # Not through `run_stepwise`, where Ctrl-C between two steps could skip the final zero.
        resume: Callable[[], Step] = partial(next, procedure)
        try:
            while True:
                step = advance(self, resume)
                try:
                    resume = partial(procedure.send, self._perform(step))
                except BaseException as error:
                    resume = partial(procedure.throw, error)
        except StopIteration as done:
            result: T = done.value
            return result

    def run_stepwise(self, procedure: Procedure[T]) -> Generator[Step, None, T]:
        """Run a procedure in this thread, yielding each step before it is performed."""
        resume: Callable[[], Step] = partial(next, procedure)
        try:
            while True:
                step = advance(self, resume)
                try:
                    yield step
                    resume = partial(procedure.send, self._perform(step))
                except BaseException as error:
                    resume = partial(procedure.throw, error)
        except StopIteration as done:
            result: T = done.value
            return result

    def _perform(self, step: Step) -> Outcome:
        answer, value = None, None
        match step:
            case Call(service, payload, timeout_s):
                answer = self.call(service, payload, timeout_s)
            case SendStop(payload):
                self.send_stop(payload)
            case Sleep(until_s):
                self.sleep_until(until_s)
            case NextStatus(until_s):
                self.wait_for_status(until_s)
            case Compute(function):
                value = function()
            case TwistCommand():  # `advance` has published it.
                pass
        return Outcome(self.now_s(), answer, value)

    # Protocols and subscriptions.

    @abstractmethod
    def attach(self, protocol: ControlProtocol) -> None:
        """Pass the latest and all further states to a protocol."""

    def detach(self, protocol: ControlProtocol) -> None:
        """Stop passing states to a protocol."""
        with self.lock:
            self._protocols = [each for each in self._protocols if each is not protocol]

    def subscribe_states(self, subscription: Subscription[RobotState]) -> Subscription[RobotState]:
        """Add new states at 50 Hz to a subscription until it is closed."""
        with self.lock:
            self._states = [*self._states, subscription]
        return subscription

    def subscribe_events(self, subscription: Subscription[Event]) -> Subscription[Event]:
        """Add every new event to a subscription until it is closed."""
        with self.lock:
            self._events = [*self._events, subscription]
        return subscription

    def _put_state(self, state: RobotState) -> None:
        self._states = [each for each in self._states if not each.closed]
        for subscription in self._states:
            subscription.put(state)

    def _put_event(self, event: Event) -> None:
        self._events = [each for each in self._events if not each.closed]
        for subscription in self._events:
            subscription.put(event)

    def close(self) -> None:
        """Disconnect from the robot and end all subscriptions."""
        with self.lock:
            self._closed = True
            ending: list[Subscription[Any]] = [*self._states, *self._events]
        for subscription in ending:
            subscription.close()

    @property
    def closed(self) -> bool:
        """Whether the connection is closed."""
        return self._closed
