"""Steps of a procedure and their execution by a client.

A procedure is a sans-I/O generator: it yields steps (`Call`, `Send`, `Sleep` ...) and is resumed
with an `Outcome`. Clients perform the steps in a thread, on an event loop or in virtual time.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Generator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from tsd_twin.client.protocol import TwistCommand
from tsd_twin.messages.topics import Service

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Call:
    """Step: call a service of the robot and wait for the response."""

    service: Service
    payload: bytes
    timeout_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Send:
    """Step: publish a command."""

    command: TwistCommand


@dataclass(frozen=True, slots=True)
class SendStop:
    """Step: publish a stop without waiting for an acknowledgement."""

    payload: bytes


@dataclass(frozen=True, slots=True)
class Sleep:
    """Step: wait until a time."""

    until_s: float


@dataclass(frozen=True, slots=True)
class NextStatus:
    """Step: wait for the next status, at most until `until_s`."""

    until_s: float


@dataclass(frozen=True, slots=True)
class Compute:
    """Step: run a function that takes tens of milliseconds."""

    function: Callable[[], Any]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a step, sent back to the procedure."""

    now_s: float
    answer: bytes | None = None
    """Response of a `Call`, or None on timeout."""
    value: Any = None
    """Return value of a `Compute`."""


Step: TypeAlias = Call | Send | SendStop | Sleep | NextStatus | Compute
Procedure: TypeAlias = Generator[Step, Outcome, T]


class Port(Protocol):
    """Part of a connection required by all executions."""

    @property
    def lock(self) -> AbstractContextManager[Any]:
        """Guards the attached protocols."""
        ...

    def now_s(self) -> float:
        """Return the monotonic or virtual time."""
        ...

    def call(self, service: Service, payload: bytes, timeout_s: float) -> bytes | None:
        """Call a service and return its response, or None on timeout."""
        ...

    def send(self, command: TwistCommand) -> None:
        """Publish a command."""
        ...

    def send_stop(self, payload: bytes) -> None:
        """Publish a stop without waiting for an acknowledgement."""
        ...


class BlockingPort(Port, Protocol):
    """Connection that can block the calling thread."""

    def sleep_until(self, until_s: float) -> None:
        """Sleep until `until_s`."""
        ...

    def wait_for_status(self, until_s: float) -> None:
        """Wait for the next status, at most until `until_s`."""
        ...


class _Execution(Generic[T]):
    """Step-by-step execution of a procedure."""

    result: T
    """Result of the procedure, valid once `advance` has returned None."""

    def __init__(self, port: Port, procedure: Procedure[T]) -> None:
        self._port, self._procedure = port, procedure
        self.outcome: Outcome | None = None
        """Result of the last step."""
        self.error: BaseException | None = None
        """Error or interrupt of the last step, to be raised inside the procedure."""

    def advance(self) -> Step | None:
        """Send the next step's command, if any; return the step, or None at the end."""
        error, self.error = self.error, None
        # Hold the lock, so that commands are sent in the order of their numbers.
        with self._port.lock:
            try:
                if error is not None:
                    step = self._procedure.throw(error)
                elif self.outcome is None:
                    step = next(self._procedure)
                else:
                    step = self._procedure.send(self.outcome)
            except StopIteration as done:
                self.result = done.value
                return None
            if isinstance(step, Send):
                self._port.send(step.command)
        return step


def run(port: BlockingPort, procedure: Procedure[T]) -> T:
    """Run a procedure in this thread."""
    execution = _Execution(port, procedure)
    while (step := execution.advance()) is not None:
        try:
            execution.outcome = _perform(port, step)
        except BaseException as error:
            execution.error = error
    return execution.result


def run_stepwise(port: BlockingPort, procedure: Procedure[T]) -> Generator[Step, None, T]:
    """Run a procedure in this thread, yielding each step before it is performed."""
    execution = _Execution(port, procedure)
    while (step := execution.advance()) is not None:
        try:
            yield step
            execution.outcome = _perform(port, step)
        except BaseException as error:
            execution.error = error
    return execution.result


async def run_async(
    port: Port, procedure: Procedure[T], perform: Callable[[Step], Awaitable[Outcome]]
) -> T:
    """Run a procedure on an event loop; `perform` awaits each step."""
    execution = _Execution(port, procedure)
    while (step := execution.advance()) is not None:
        try:
            execution.outcome = await perform(step)
        except BaseException as error:
            execution.error = error
    return execution.result


def _perform(port: BlockingPort, step: Step) -> Outcome:
    answer, value = None, None
    match step:
        case Call(service, payload, timeout_s):
            answer = port.call(service, payload, timeout_s)
        case SendStop(payload):
            port.send_stop(payload)
        case Sleep(until_s):
            port.sleep_until(until_s)
        case NextStatus(until_s):
            port.wait_for_status(until_s)
        case Compute(function):
            value = function()
        case Send():
            pass
    return Outcome(port.now_s(), answer, value)
