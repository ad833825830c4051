"""Zenoh handles: publisher, subscriber, queryable and liveliness token."""

# pyright: reportUnknownMemberType=false
# The stubs of zenoh leave out what methods without a result return.

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

import zenoh
import zenoh.ext

from tsd_twin.bus.config import reason
from tsd_twin.errors import BusError
from tsd_twin.messages.commands import Sample


class Publisher:
    """Sends on one key; a put is never waited for."""

    def __init__(self, publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher) -> None:
        self._publisher = publisher

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Send a payload; nobody listening is no error.

        Raises:
            BusError: the session is closed.
        """
        try:
            self._publisher.put(payload, attachment=attachment or None)
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error

    @property
    def has_subscribers(self) -> bool:
        """Whether a put has a subscriber now; where puts are kept for late joiners, always."""
        if not isinstance(self._publisher, zenoh.Publisher):
            return True
        status = cast("zenoh.MatchingStatus", self._publisher.matching_status)
        return status.matching

    def close(self) -> None:
        """Take the key back."""
        self._publisher.undeclare()


class Subscriber:
    """Keeps the newest samples of a key expression until they are taken; the oldest give way."""

    def __init__(self, subscriber: zenoh.Subscriber[Any], depth: int) -> None:
        self._subscriber = subscriber
        self._depth = depth

    def take(self) -> list[Sample]:
        """Return what came in since the last call, oldest first, without waiting."""
        return [sample_of(sample) for sample in _drain(self._subscriber, self._depth)]

    def newest(self) -> Sample | None:
        """Return the newest of what came in since the last call."""
        samples = self.take()
        return samples[-1] if samples else None

    def close(self) -> None:
        """Stop reading."""
        self._subscriber.undeclare()


class Request:
    """A request that waits for its answer."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self._key = key
        self._query = query
        self.payload = query.payload.to_bytes() if query.payload is not None else b""

    def reply(self, payload: bytes) -> None:
        """Answer; an asker that has gone is no error."""
        try:
            # The key asked for may be a pattern, and an answer must name one key.
            self._query.reply(self._key, payload)
            self._query.drop()
        except zenoh.ZError:
            return


class Queryable:
    """Keeps requests to one key until they are taken.

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
                query.drop()  # The asker learns at once that nothing comes.
        return taken


class Token:
    """The word that somebody lives; it goes with the session, also when the process dies."""

    def __init__(self, token: zenoh.LivelinessToken) -> None:
        self._token = token

    def close(self) -> None:
        """Take the word back."""
        self._token.undeclare()


def _drain(channel: Any, depth: int) -> Iterator[Any]:
    """Yield what waits in a channel, no more than fits: a flood must not hold up who drains it.

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
    """Return a sample of zenoh as a value of ours."""
    return Sample(
        key=str(sample.key_expr),
        payload=sample.payload.to_bytes(),
        attachment=sample.attachment.to_bytes() if sample.attachment is not None else b"",
        is_put=sample.kind == zenoh.SampleKind.PUT,
    )
