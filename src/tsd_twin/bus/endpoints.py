"""Zenoh handles: publisher, subscriber, queryable and liveliness token."""

# pyright: reportUnknownMemberType=false
# The stubs of zenoh leave out what methods without a result return.

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import zenoh
import zenoh.ext

from tsd_twin.bus.config import reason
from tsd_twin.errors import BusError
from tsd_twin.messages.commands import Sample


class Publisher:
    """Publisher on one key; a put never blocks."""

    def __init__(self, publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher) -> None:
        self._publisher = publisher

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Send a payload; a missing subscriber is no error.

        Raises:
            BusError: the session is closed.
        """
        try:
            self._publisher.put(payload, attachment=attachment or None)
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error

    def close(self) -> None:
        """Undeclare the publisher."""
        self._publisher.undeclare()


class Subscriber:
    """Subscriber with a bounded queue for a key expression; when full, the oldest are dropped."""

    def __init__(self, subscriber: zenoh.Subscriber[Any], depth: int) -> None:
        self._subscriber = subscriber
        self._depth = depth

    def take(self) -> list[Sample]:
        """Return the samples since the last call, oldest first, without waiting."""
        return [sample_of(sample) for sample in _drain(self._subscriber, self._depth)]

    def newest(self) -> Sample | None:
        """Return the newest sample since the last call."""
        samples = self.take()
        return samples[-1] if samples else None

    def close(self) -> None:
        """Undeclare the subscriber."""
        self._subscriber.undeclare()


class Request:
    """A pending request."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self._key = key
        self._query = query
        self.payload = query.payload.to_bytes() if query.payload is not None else b""

    def reply(self, payload: bytes) -> None:
        """Send the reply; a client that has disconnected is no error."""
        try:
            # The requested key may be a pattern, and a reply must name one key.
            self._query.reply(self._key, payload)
            self._query.drop()
        except zenoh.ZError:
            return


class Queryable:
    """Queryable: queues the requests to one key until they are taken.

    A query to a pattern, such as `twin/**`, is how the bus is explored. Unless `patterns` are
    served too, it is no request: it gets no answer, and has no effect.
    """

    def __init__(
        self, key: str, queryable: zenoh.Queryable[Any], depth: int, *, patterns: bool
    ) -> None:
        self._key = key
        self._queryable = queryable
        self._depth = depth
        self._patterns = patterns

    def take(self) -> list[Request]:
        """Return the requests that came in since the last call, without waiting."""
        taken: list[Request] = []
        for query in _drain(self._queryable, self._depth):
            if self._patterns or str(query.key_expr) == self._key:
                taken.append(Request(self._key, query))
            else:
                query.drop()  # The client learns at once that there is no reply.
        return taken


class Token:
    """Liveliness token; it ends with the session, also when the process dies."""

    def __init__(self, token: zenoh.LivelinessToken) -> None:
        self._token = token

    def close(self) -> None:
        """Undeclare the token."""
        self._token.undeclare()


def _drain(channel: Any, depth: int) -> Iterator[Any]:
    """Yield the queued items of a channel, at most its depth: a flood must not block the reader.

    Raises:
        BusError: the session is closed.
    """
    try:
        for _ in range(depth):
            if (item := channel.try_recv()) is None:
                return
            yield item
    except zenoh.ZError as error:
        raise BusError(reason(error)) from error


def sample_of(sample: zenoh.Sample) -> Sample:
    """Convert a sample of zenoh to a `Sample`."""
    return Sample(
        key=str(sample.key_expr),
        payload=sample.payload.to_bytes(),
        attachment=sample.attachment.to_bytes() if sample.attachment is not None else b"",
        is_put=sample.kind == zenoh.SampleKind.PUT,
    )
