"""Interface of the check of signatures, which runs before the controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

from tsd_twin.messages.events import Event
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.topics import Sample, Service

Serve: TypeAlias = Callable[[Service, bytes, float], LeaseReply | Reply]


class Authority(Protocol):
    """Check of signatures; `tsd_twin.security.robot_authority` implements it."""

    def signed_commands(self, samples: Sequence[Sample], now_s: float) -> list[Sample]:
        """Return the commands whose signature is right, without it; called in every period."""
        ...

    def serve(self, service: Service, payload: bytes, now_s: float, serve: Serve) -> bytes:
        """Return the reply to a request; `serve` processes it if its signature is right."""
        ...

    def record_status(self, number: int, now_s: float) -> None:
        """Record the time at which a status was sent."""
        ...

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        ...
