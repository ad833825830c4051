"""In-memory bus with the interface of `tsd_twin.bus.Bus`, in virtual time."""

from __future__ import annotations

import functools
import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import zenoh

from tests.support.virtual_time import VirtualClock
from tsd_twin.errors import NoAnswerError
from tsd_twin.messages.topics import Sample

_STEP_S = 0.001


@functools.cache
def _match(one: str, other: str) -> bool:
    return bool(zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other)))


@dataclass
class Network:
    """Declarations of all sessions, and samples held back by links."""

    clock: VirtualClock
    takers: list[tuple[str, Callable[[Sample], None]]] = field(default_factory=list)
    watchers: list[tuple[str, Callable[[str, bool], None]]] = field(default_factory=list)
    servers: list[tuple[str, Queue]] = field(default_factory=list)
    tokens: dict[int, str] = field(default_factory=dict)
    is_held: Callable[[str], bool] = lambda _key: False
    """Return whether the link holds back samples of a key."""
    held: list[Sample] = field(default_factory=list)
    numbers: Any = field(default_factory=itertools.count)
    certificate: Path | None = None
    """Certificate of new sessions."""

    def put(self, sample: Sample) -> None:
        """Deliver a sample or hold it back."""
        if self.is_held(sample.key):
            self.held.append(sample)
            return
        for key, take in list(self.takers):
            if _match(key, sample.key):
                take(sample)

    def release(self) -> None:
        """Deliver the samples that were held back."""
        held, self.held, self.is_held = self.held, [], lambda _key: False
        for sample in held:
            self.put(sample)

    def change_token(self, number: int, key: str, *, alive: bool) -> None:
        """Declare or undeclare a liveliness token."""
        if alive:
            self.tokens[number] = key
        elif self.tokens.pop(number, None) is None:
            return
        for pattern, tell in list(self.watchers):
            if _match(pattern, key):
                tell(key, alive)


class Queue:
    """Bounded queue of samples or requests, with the methods of a subscriber and a queryable."""

    def __init__(self, depth: int, close: Callable[[Queue], None]) -> None:
        self._items: deque[Any] = deque(maxlen=depth)
        self._close = close

    def add(self, item: Any) -> None:
        """Queue an item."""
        self._items.append(item)

    def take_samples(self) -> list[Any]:
        """Return the items since the last call."""
        items = list(self._items)
        self._items.clear()
        return items

    take_requests = take_samples

    def newest(self) -> Any:
        """Return the latest item since the last call."""
        items = self.take_samples()
        return items[-1] if items else None

    def close(self) -> None:
        """Undeclare it."""
        self._close(self)


@dataclass
class Request:
    """A pending request."""

    payload: bytes
    attachment: bytes
    answer: bytes | None = None
    dropped: bool = False

    def reply(self, payload: bytes, attachment: bytes = b"") -> None:
        """Reply."""
        del attachment
        self.answer = payload if self.answer is None else self.answer

    def drop(self) -> None:
        """End the request without a reply."""
        self.dropped = True


class _Publisher:
    def __init__(self, network: Network, key: str) -> None:
        self._network, self._key = network, key

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        self._network.put(Sample(self._key, payload, attachment))

    @property
    def has_subscribers(self) -> bool:
        return any(_match(key, self._key) for key, _ in self._network.takers)

    def close(self) -> None:
        """Close nothing, because nothing is stored."""


class _Token:
    def __init__(self, network: Network, key: str) -> None:
        self._network, self._key, self._number = network, key, next(network.numbers)
        network.change_token(self._number, key, alive=True)

    def close(self) -> None:
        self._network.change_token(self._number, self._key, alive=False)


class MemoryBus:
    """Session on an in-memory network."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self.certificate = network.certificate
        self.id = f"{next(network.numbers):032x}"
        self._tokens: list[_Token] = []
        self._takers: list[tuple[str, Callable[[Sample], None]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Withdraw all tokens and subscriptions."""
        for token in self._tokens:
            token.close()
        taken = self._takers
        self._network.takers = [each for each in self._network.takers if each not in taken]

    def publisher(self, key: str, *_: Any, **__: Any) -> _Publisher:
        return _Publisher(self._network, key)

    def subscribe(self, key: str, on_sample: Callable[[Sample], None]) -> None:
        self._takers.append((key, on_sample))
        self._network.takers.append((key, on_sample))

    subscribe_events = subscribe

    def subscriber(self, key: str, depth: int) -> Queue:
        queue = Queue(depth, self._unsubscribe)
        self.subscribe(key, queue.add)
        return queue

    def _unsubscribe(self, queue: Queue) -> None:
        takers = self._network.takers
        self._network.takers = [each for each in takers if each[1] != queue.add]

    def queryable(self, key: str, depth: int = 64, *, patterns: bool = False) -> Queue:
        del patterns
        queue = Queue(depth, lambda _queue: None)
        self._network.servers.append((key, queue))
        return queue

    def query(
        self, key: str, payload: bytes, timeout_s: float = 1.0, attachment: bytes = b""
    ) -> bytes:
        answers = self._ask(key, payload, timeout_s, attachment)
        if not answers:
            raise NoAnswerError(key, timeout_s)
        return answers[0]

    def _ask(self, key: str, payload: bytes, timeout_s: float, attachment: bytes) -> list[bytes]:
        """Query all servers of a key and wait in virtual time for the first reply."""
        asked = [Request(payload, attachment) for at, _ in self._network.servers if at == key]
        servers = [queue for at, queue in self._network.servers if at == key]
        for request, queue in zip(asked, servers, strict=True):
            queue.add(request)
        end_s = self._network.clock.now_s + timeout_s
        while asked and self._network.clock.now_s < end_s:
            answers = [each.answer for each in asked if each.answer is not None]
            if answers or all(each.dropped for each in asked):
                return answers
            self._network.clock.wait(_STEP_S)
        return []

    def query_all(self, key: str, payload: bytes, timeout_s: float = 1.0) -> list[bytes]:
        return self._ask(key, payload, timeout_s, b"")

    def declare_token(self, key: str) -> _Token:
        token = _Token(self._network, key)
        self._tokens.append(token)
        return token

    def living_tokens(self, key: str, timeout_s: float = 0.5) -> list[str]:
        del timeout_s
        return [each for each in self._network.tokens.values() if _match(key, each)]

    def subscribe_liveliness(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        self._network.watchers.append((key, on_change))
        for each in self.living_tokens(key):
            on_change(each, True)
