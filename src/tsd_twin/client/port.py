"""Steps of a procedure and their execution by a client.

A procedure is a sans-I/O generator: it yields steps (`Call`, `Sleep`, a `TwistCommand` ...) and is
resumed with an `Outcome`. Clients perform the steps in a thread, on an event loop or in virtual
time.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Generator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeAlias, TypeVar

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


Step: TypeAlias = Call | TwistCommand | SendStop | Sleep | NextStatus | Compute
"""A `TwistCommand` is published."""
Procedure: TypeAlias = Generator[Step, Outcome, T]


class Port(Protocol):
    """Part of a connection required by all executions."""

    @property
    def lock(self) -> AbstractContextManager[Any]:
        """Guards the attached protocols."""
        ...

    def send(self, command: TwistCommand) -> None:
        """Publish a command."""
        ...


def advance(port: Port, resume: Callable[[], Step]) -> Step:
    """Resume a procedure, send its command if it yields one, and return its next step.

    Raises:
        StopIteration: If the procedure has ended; with its result.
    """
    # Hold the lock, so that commands are sent in the order of their numbers.
    with port.lock:
        step = resume()
        if isinstance(step, TwistCommand):
            port.send(step)
    return step


async def run_async(
    port: Port, procedure: Procedure[T], perform: Callable[[Step], Awaitable[Outcome]]
) -> T:
    """Run a procedure on an event loop; `perform` awaits each step.

    Errors and cancellations of a step are raised inside the procedure.
    """
    resume: Callable[[], Step] = partial(next, procedure)
    try:
        while True:
            step = advance(port, resume)
            try:
                resume = partial(procedure.send, await perform(step))
            except BaseException as error:
                resume = partial(procedure.throw, error)
    except StopIteration as done:
        result: T = done.value
        return result
