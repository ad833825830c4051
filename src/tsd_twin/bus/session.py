"""Zenoh session and its handles: publisher, subscriber, queryable and liveliness token."""

# pyright: reportUnknownMemberType=false
# The stubs of zenoh leave out what methods without a result return.

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Self

import zenoh
import zenoh.ext

from tsd_twin.bus.config import Config, reason
from tsd_twin.errors import BusError, NoAnswerError
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.topics import QoS


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


# The stubs of zenoh leave out what methods without a result return.


EVENTS_KEPT = 100
"""Events of each kind that a late joiner still gets."""
_SETTLE_S = 0.05
"""Those who live are heard of one by one, right after the first."""
_SLACK_S = 0.2
"""Zenoh ends a query that has timed out by itself; this is for when it does not."""

# What is said again at once is not repeated by a link that has the choice, see `over_datagrams`.
_QOS: dict[QoS, dict[str, Any]] = {
    QoS.REAL_TIME: {
        "priority": zenoh.Priority.REAL_TIME,
        "express": True,
        "congestion_control": zenoh.CongestionControl.DROP,
        "reliability": zenoh.Reliability.BEST_EFFORT,
    },
    QoS.DATA: {
        "priority": zenoh.Priority.DATA,
        "express": False,
        "congestion_control": zenoh.CongestionControl.DROP,
        "reliability": zenoh.Reliability.BEST_EFFORT,
    },
}


class Bus:
    """One session; use it as a context manager, or a process may never end.

    Callbacks run on a thread of the bus: they hand over and return.
    """

    def __init__(self, config: Config) -> None:
        self._kept: list[object] = []  # Subscriptions and tokens end when nobody refers to them.
        try:
            settings = config.parsed()
            self._joins = bool(json.loads(settings.get_json("connect/endpoints")))
            self._session = zenoh.open(settings)
        except zenoh.ZError as error:
            raise BusError(f"cannot open the bus at {config.where}: {reason(error)}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the bus; tokens, subscriptions and publications go with it."""
        try:
            self._session.close()
        except zenoh.ZError:  # A stuck peer must not keep this process from ending.
            return

    def endpoints(self) -> list[str]:
        """Return where this session listens, with the ports that `:0` became."""
        replies = self._session.get(f"@/{self._session.zid()}/router", timeout=2.0)
        for reply in replies:
            if reply.ok is not None:
                return list(json.loads(reply.ok.payload.to_string())["locators"])
        return []

    def wait_for_peer(self, timeout_s: float) -> bool:
        """Wait until this session is linked to another, and return whether it is."""
        linked = threading.Event()
        listener = self._session.info.declare_transport_events_listener(
            lambda _event: linked.set(), history=True
        )
        try:
            return linked.wait(timeout_s)
        finally:
            listener.undeclare()

    def publisher(self, key: str, qos: QoS, type_name: str = "json") -> Publisher:
        """Return a publisher; `type_name` is `json` or the ROS 2 type of a CDR payload."""
        encoding = zenoh.Encoding.APPLICATION_JSON
        if type_name != "json":
            encoding = zenoh.Encoding.APPLICATION_CDR.with_schema(type_name)
        if qos is QoS.EVENT:
            return Publisher(
                zenoh.ext.declare_advanced_publisher(
                    self._session,
                    key,
                    encoding=encoding,
                    cache=zenoh.ext.CacheConfig(max_samples=EVENTS_KEPT),
                    publisher_detection=True,
                )
            )
        return Publisher(self._session.declare_publisher(key, encoding=encoding, **_QOS[qos]))

    def subscriber(self, key: str, depth: int) -> Subscriber:
        """Return a reader that keeps at most `depth` samples of a key expression."""
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(depth)
        return Subscriber(self._session.declare_subscriber(key, ring), depth)

    def queryable(self, key: str, depth: int = 64, *, patterns: bool = False) -> Queryable:
        """Return a server of requests to `key`; when they pour in, the oldest give way.

        With `patterns`, also queries to patterns that match the key are served. That is for
        services without an effect only.
        """
        ring: zenoh.handlers.RingChannel[zenoh.Query] = zenoh.handlers.RingChannel(depth)
        queryable = self._session.declare_queryable(key, ring)
        return Queryable(key, queryable, depth, patterns=patterns)

    def subscribe(self, key: str, take: Callable[[Sample], None]) -> None:
        """Call `take` with every sample of a key expression."""
        self._kept.append(
            self._session.declare_subscriber(key, lambda sample: take(sample_of(sample)))
        )

    def subscribe_events(self, key: str, take: Callable[[Sample], None]) -> None:
        """Call `take` with every event of a key expression, also those sent before."""
        self._kept.append(
            zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                lambda sample: take(sample_of(sample)),
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
            )
        )

    def query(self, key: str, payload: bytes, timeout_s: float = 1.0) -> bytes:
        """Return the answer of the one who serves `key`; waits for it.

        Raises:
            NoAnswerError: nobody serves the key, or not in time.
        """
        try:
            for reply in self._session.get(key, payload=payload, timeout=timeout_s):
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error
        raise NoAnswerError(key, timeout_s)

    def request(
        self, key: str, payload: bytes, take: Callable[[bytes | None], None], timeout_s: float = 1.0
    ) -> None:
        """Ask without waiting: `take` gets the first answer, or None when there was none in time.

        It is called once, on a thread of the bus.

        Raises:
            BusError: the session is closed.
        """
        answers: list[bytes] = []

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None and not answers:
                answers.append(reply.ok.payload.to_bytes())
                take(answers[0])

        def on_end() -> None:
            if not answers:
                take(None)

        # Direct: otherwise each question that is open would have a thread of its own.
        handler = zenoh.handlers.Callback(on_reply, on_end, indirect=False)
        try:
            self._session.get(key, handler, payload=payload, timeout=timeout_s)
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error

    def declare_token(self, key: str) -> Token:
        """Announce that whoever owns `key` lives, until the token or the session is closed."""
        token = self._session.liveliness().declare_token(key)
        self._kept.append(token)
        return Token(token)

    def living_tokens(self, key: str, timeout_s: float = 0.5) -> list[str]:
        """Return the keys of those that live and match `key`.

        A session joins others in the background and hears of them a moment later, some 0.1 s
        between routers: one that joins waits for the first of them, or until the time is over.
        """
        keys: list[str] = []
        complete = threading.Event()

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                keys.append(str(reply.ok.key_expr))

        # With the default queue of 256 a session that owns more tokens waits for itself for ever.
        # Direct: otherwise the end may be told before the last replies are.
        handler = zenoh.handlers.Callback(take, complete.set, indirect=False)
        self._session.liveliness().get(key, handler, timeout=timeout_s)
        complete.wait(timeout_s + _SLACK_S)
        if self._joins and not keys:
            somebody = threading.Event()

            def note(sample: zenoh.Sample) -> None:
                keys.append(str(sample.key_expr))
                somebody.set()

            with self._session.liveliness().declare_subscriber(key, note, history=True):
                if somebody.wait(timeout_s):
                    time.sleep(_SETTLE_S)
        return list(keys)

    def subscribe_liveliness(self, key: str, take: Callable[[str, bool], None]) -> None:
        """Call `take` with the key and True or False, when somebody comes or goes, or is there."""
        self._kept.append(
            self._session.liveliness().declare_subscriber(
                key,
                lambda sample: take(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT),
                history=True,
            )
        )
