"""Handles of a Zenoh session: publisher, subscriber, queryable and liveliness token."""

# pyright: reportUnknownMemberType=false
# The zenoh stubs omit return types of methods that return nothing.

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any, cast

import zenoh
import zenoh.ext

from tsd_twin.bus.config import reason
from tsd_twin.errors import BusError
from tsd_twin.messages.topics import Sample


class Publisher:
    """Publisher on one key. `put` never blocks; all methods are thread-safe."""

    def __init__(self, publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher) -> None:
        self._publisher = publisher
        # Zenoh refuses to undeclare a publisher during a put, and to put during undeclaration.
        self._lock = threading.Lock()

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Send a payload; missing subscribers are not an error.

        Raises:
            BusError: If the session or the publisher is closed.
        """
        try:
            with self._lock:
                self._publisher.put(payload, attachment=attachment or None)
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error

    @property
    def has_subscribers(self) -> bool:
        """Whether a put reaches a subscriber; always True if puts are cached for late joiners."""
        if not isinstance(self._publisher, zenoh.Publisher):
            return True
        status = cast("zenoh.MatchingStatus", self._publisher.matching_status)
        return status.matching

    def close(self) -> None:
        """Undeclare the publisher."""
        with self._lock:
            self._publisher.undeclare()


class Subscriber:
    """Subscriber for a key expression; when its queue is full, the oldest samples are dropped."""

    def __init__(self, subscriber: zenoh.Subscriber[Any], depth: int) -> None:
        self._subscriber = subscriber
        self._depth = depth

    def take_samples(self) -> list[Sample]:
        """Return the samples since the last call, oldest first, without waiting."""
        return [sample_of(sample) for sample in _drain(self._subscriber, self._depth)]

    def newest(self) -> Sample | None:
        """Return the latest sample since the last call."""
        samples = self.take_samples()
        return samples[-1] if samples else None

    def close(self) -> None:
        """Undeclare the subscriber."""
        self._subscriber.undeclare()


class PendingQuery:
    """Pending query to a queryable."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self._key = key
        self._query = query
        self.payload = query.payload.to_bytes() if query.payload is not None else b""
        self.attachment = query.attachment.to_bytes() if query.attachment is not None else b""

    def reply(self, payload: bytes, attachment: bytes = b"") -> None:
        """Send the reply; a disconnected client is not an error."""
        try:
            # The requested key may be a pattern, but a reply must name a concrete key.
            self._query.reply(self._key, payload, attachment=attachment or None)
            self._query.drop()
        except zenoh.ZError:
            return

    def drop(self) -> None:
        """End the request without a reply; the client is notified immediately."""
        self._query.drop()


class Queryable:
    """Queues the requests to a key until they are taken.

    Queries to a pattern such as `twin/**` explore the bus. Unless `patterns` is set, they are
    dropped without a reply.
    """

    def __init__(
        self, key: str, queryable: zenoh.Queryable[Any], depth: int, *, patterns: bool
    ) -> None:
        self._key = key
        self._queryable = queryable
        self._depth = depth
        self._patterns = patterns

    def take_requests(self) -> list[PendingQuery]:
        """Return the requests since the last call, without waiting."""
        taken: list[PendingQuery] = []
        for query in _drain(self._queryable, self._depth):
            if self._patterns or str(query.key_expr) == self._key:
                taken.append(PendingQuery(self._key, query))
            else:
                query.drop()  # The client is notified immediately that there is no reply.
        return taken


class Token:
    """Liveliness token; ends with the session, even if the process dies."""

    def __init__(self, token: zenoh.LivelinessToken) -> None:
        self._token = token

    def close(self) -> None:
        """Undeclare the token."""
        self._token.undeclare()


def _drain(channel: Any, depth: int) -> Iterator[Any]:
    """Yield at most `depth` queued items, so that a flood cannot block the reader.

    Raises:
        BusError: If the session is closed.
    """
    try:
        for _ in range(depth):
            if (item := channel.try_recv()) is None:
                return
            yield item
    except zenoh.ZError as error:
        raise BusError(reason(error)) from error


def sample_of(sample: zenoh.Sample) -> Sample:
    """Convert a zenoh sample to a `Sample`."""
    return Sample(
        key=str(sample.key_expr),
        payload=sample.payload.to_bytes(),
        attachment=sample.attachment.to_bytes() if sample.attachment is not None else b"",
        is_put=sample.kind == zenoh.SampleKind.PUT,
    )
