"""Zenoh session on the bus."""

# pyright: reportUnknownMemberType=false
# The zenoh stubs omit return types of methods that return nothing.

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from typing import Any, Self

import zenoh
import zenoh.ext

from tsd_twin.bus.config import NO_ANSWER, Config, as_client, reason
from tsd_twin.bus.half_open import HalfOpenConnectionWatchdog
from tsd_twin.bus.handles import (
    PendingQuery,
    Publisher,
    Queryable,
    Subscriber,
    Token,
    sample_of,
)
from tsd_twin.bus.link_sockets import close_at_once
from tsd_twin.errors import BusError, NoAnswerError, SeveralAnswersError
from tsd_twin.messages.topics import QoS, Sample

_LOG = logging.getLogger(__name__)


EVENTS_KEPT = 100
"""Events of each kind kept for late joiners."""
_ATTEMPT_S, _RETRY_S = 2.0, 0.1
"""Longest attempt to reach a router, in which it is dialled every 0.1 to 1 s; pause after it."""
_SILENT_S = 5.0
"""Programs that are started together wait for each other without a warning."""
_SETTLE_S = 0.05
"""Wait for further liveliness tokens after the first, since they arrive individually."""
_SLACK_S = 0.2
"""Safety margin in case Zenoh does not end a timed-out query itself."""

_ENCODINGS = {
    "json": zenoh.Encoding.APPLICATION_JSON,
    "msgpack": zenoh.Encoding("application/msgpack"),
}
"""Encodings of non-CDR payloads."""

# Periodic messages are not retransmitted on links that support it, see `over_datagrams`.
_QOS: dict[QoS, dict[str, Any]] = {
    qos: {
        "priority": priority,
        "express": qos is QoS.REAL_TIME,
        "congestion_control": zenoh.CongestionControl.DROP,
        "reliability": reliability,
    }
    for qos, priority, reliability in (
        (QoS.REAL_TIME, zenoh.Priority.REAL_TIME, zenoh.Reliability.BEST_EFFORT),
        (QoS.DATA, zenoh.Priority.DATA, zenoh.Reliability.BEST_EFFORT),
        (QoS.LOG, zenoh.Priority.BACKGROUND, zenoh.Reliability.RELIABLE),
    )
}


class Bus:
    """Zenoh session; use it as a context manager, or the process may never exit.

    Callbacks run on a bus thread, so they must hand over the data and return.
    """

    def __init__(self, config: Config) -> None:
        self.certificate = config.certificate
        """File of the certificate of this session, or None."""
        self._kept: list[object] = []  # Subscriptions and tokens end when unreferenced.
        try:
            settings = config.parsed()
            self._joins = bool(json.loads(settings.get_json("connect/endpoints")))
            self._is_client = json.loads(settings.get_json("mode")) == "client"
            listens = not self._is_client and bool(
                json.loads(settings.get_json("listen/endpoints"))
            )
            open_timeout_s = json.loads(settings.get_json("transport/unicast/open_timeout")) / 1000
            began_s = time.monotonic()
            self._session = zenoh.open(settings)
        except zenoh.ZError as error:
            raise BusError(f"cannot open the bus at {config.where}: {reason(error)}") from error
        self._kept.append(close_at_once(self._session))
        if self._joins and not listens:
            self._kept.append(HalfOpenConnectionWatchdog(self._session, began_s, open_timeout_s))

    @classmethod
    def when_reachable(cls, config: Config, stop: threading.Event) -> Self | None:
        """Open a session. A client waits for its router; None if `stop` is set before it answers.

        Other sessions open at once and connect in the background.

        Raises:
            BusError: If the configuration cannot be used.
        """
        if not config.is_client:
            return cls(config)
        impatient, warned = as_client(config, _ATTEMPT_S), False
        began_s = time.monotonic()
        while not stop.is_set():
            try:
                return cls(impatient)
            except BusError as error:
                if not str(error).endswith(NO_ANSWER):
                    raise
                if not warned and time.monotonic() - began_s > _SILENT_S:
                    warned = True
                    _LOG.warning("%s; trying until it does", error)
                stop.wait(_RETRY_S)
        return None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the session with its tokens, subscribers and publishers."""
        try:
            self._session.close()
        except zenoh.ZError:  # A stuck peer must not keep this process from exiting.
            return

    def endpoints(self) -> list[str]:
        """Listening endpoints, with the ports chosen for `:0`; a client has none."""
        if self._is_client:
            return []
        replies = self._session.get(f"@/{self._session.zid()}/router", timeout=2.0)
        for reply in replies:
            if reply.ok is not None:
                return list(json.loads(reply.ok.payload.to_string())["locators"])
        return []

    def wait_for_peer(self, timeout_s: float) -> bool:
        """Wait until this session is connected to another; return whether it is."""
        linked = threading.Event()
        listener = self._session.info.declare_transport_events_listener(
            lambda _event: linked.set(), history=True
        )
        try:
            return linked.wait(timeout_s)
        finally:
            listener.undeclare()

    @property
    def id(self) -> str:
        """Session id in hexadecimal."""
        return str(self._session.zid())

    def publisher(
        self, key: str, qos: QoS, type_name: str = "json", *, kept: int = EVENTS_KEPT
    ) -> Publisher:
        """Return a publisher; `type_name` is the type of a `Topic`, `kept` the history length."""
        encoding = _ENCODINGS.get(type_name)
        if encoding is None:
            encoding = zenoh.Encoding.APPLICATION_CDR.with_schema(type_name)
        if qos is QoS.EVENT:
            return Publisher(
                zenoh.ext.declare_advanced_publisher(
                    self._session,
                    key,
                    encoding=encoding,
                    cache=zenoh.ext.CacheConfig(max_samples=kept),
                    publisher_detection=True,
                )
            )
        return Publisher(self._session.declare_publisher(key, encoding=encoding, **_QOS[qos]))

    def subscriber(self, key: str, depth: int) -> Subscriber:
        """Return a subscriber that queues at most `depth` samples of a key expression."""
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(depth)
        return Subscriber(self._session.declare_subscriber(key, ring), depth)

    def queryable(self, key: str, depth: int = 64, *, patterns: bool = False) -> Queryable:
        """Return a queryable for `key` that queues the latest `depth` requests.

        With `patterns`, queries to matching patterns are served too; only for services without side
        effects.
        """
        ring: zenoh.handlers.RingChannel[zenoh.Query] = zenoh.handlers.RingChannel(depth)
        queryable = self._session.declare_queryable(key, ring)
        return Queryable(key, queryable, depth, patterns=patterns)

    def serve(self, key: str, on_request: Callable[[PendingQuery], None]) -> None:
        """Call `on_request` for each query to exactly this key."""

        def take(query: zenoh.Query) -> None:
            if str(query.key_expr) == key:
                on_request(PendingQuery(key, query))
            else:
                query.drop()

        self._kept.append(self._session.declare_queryable(key, take, complete=True))

    def subscribe(self, key: str, on_sample: Callable[[Sample], None]) -> Callable[[], None]:
        """Call `on_sample` for every sample of a key expression, until the returned call."""
        made = self._session.declare_subscriber(key, lambda sample: on_sample(sample_of(sample)))
        self._kept.append(made)

        def end() -> None:
            self._kept.remove(made)
            made.undeclare()

        return end

    def subscribe_events(self, key: str, on_sample: Callable[[Sample], None]) -> None:
        """Call `on_sample` for every event of a key expression, including past ones."""
        self._kept.append(
            zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                lambda sample: on_sample(sample_of(sample)),
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
            )
        )

    def query(
        self, key: str, payload: bytes, timeout_s: float = 1.0, attachment: bytes = b""
    ) -> bytes:
        """Query `key` and return the reply; blocks up to `timeout_s`.

        Raises:
            NoAnswerError: If no queryable serves the key, or none replies in time.
            SeveralAnswersError: If more than one replies.
        """
        answers = self.query_all(key, payload, timeout_s, attachment)
        if not answers:
            raise NoAnswerError(key, timeout_s)
        if len(answers) > 1:
            raise SeveralAnswersError(key, len(answers))
        return answers[0]

    def query_all(
        self, key: str, payload: bytes, timeout_s: float = 1.0, attachment: bytes = b""
    ) -> list[bytes]:
        """Query `key` and return one reply per queryable; blocks up to `timeout_s`."""
        answers: dict[str, bytes] = {}
        try:
            # By default, Zenoh asks the nearest queryable and keeps one reply per key.
            replies = self._session.get(
                key,
                payload=payload,
                timeout=timeout_s,
                attachment=attachment or None,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
            for reply in replies:
                if reply.ok is not None:
                    # With two routes to a session, its reply may arrive twice.
                    answers[str(reply.replier_id)] = reply.ok.payload.to_bytes()
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error
        return list(answers.values())

    def request(
        self, key: str, payload: bytes, take: Callable[[bytes | None], None], timeout_s: float = 1.0
    ) -> None:
        """Query without blocking; `take` receives the first reply, or None after the timeout.

        `take` is called once, on a bus thread.

        Raises:
            BusError: If the session is closed.
        """
        answers: list[bytes] = []

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None and not answers:
                answers.append(reply.ok.payload.to_bytes())
                take(answers[0])

        def on_end() -> None:
            if not answers:
                take(None)

        # Call directly; otherwise each open query would need a thread.
        handler = zenoh.handlers.Callback(on_reply, on_end, indirect=False)
        try:
            self._session.get(key, handler, payload=payload, timeout=timeout_s)
        except zenoh.ZError as error:
            raise BusError(reason(error)) from error

    def declare_token(self, key: str) -> Token:
        """Declare a liveliness token on `key` until the token or the session is closed."""
        token = self._session.liveliness().declare_token(key)
        self._kept.append(token)
        return Token(token)

    def living_tokens(self, key: str, timeout_s: float = 0.5) -> list[str]:
        """Return the keys of the liveliness tokens that match `key`.

        Sessions connect in the background and receive tokens later (about 0.1 s between routers),
        so a new session waits for the first token or until the timeout.
        """
        keys: list[str] = []
        complete = threading.Event()

        def add_key(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                keys.append(str(reply.ok.key_expr))

        # With the default queue of 256, a session that owns more tokens deadlocks.
        # Call directly; otherwise the end may be reported before the last replies.
        handler = zenoh.handlers.Callback(add_key, complete.set, indirect=False)
        self._session.liveliness().get(key, handler, timeout=timeout_s)
        complete.wait(timeout_s + _SLACK_S)
        if self._joins and not keys:
            found = threading.Event()

            def add_token(sample: zenoh.Sample) -> None:
                keys.append(str(sample.key_expr))
                found.set()

            with self._session.liveliness().declare_subscriber(key, add_token, history=True):
                if found.wait(timeout_s):
                    time.sleep(_SETTLE_S)
        return list(keys)

    def subscribe_liveliness(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change` with a key and True (present or new token) or False (removed token)."""
        self._kept.append(
            self._session.liveliness().declare_subscriber(
                key,
                lambda sample: on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT),
                history=True,
            )
        )
