"""Rate limits for attempts at secrets: passwords of users, and enrolment codes of robots."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass

KEYS = 1024
"""Maximum number of keys; the one with the shortest wait, then the fewest tries, is evicted."""
CALM_S = 3600.0
"""The count of a key restarts after this time without attempts."""


@dataclass(slots=True)
class _Attempts:
    tries: int
    last_s: float
    until_s: float


class LoginRateLimiter:
    """Rate limiter for login attempts by key, with exponential backoff.

    Each attempt counts as failed until it succeeds, so parallel attempts gain nothing.
    """

    def __init__(self, free: int, first_s: float, longest_s: float) -> None:
        """Allow `free` tries, then delay by `first_s`, doubled with each try up to `longest_s`."""
        self._free = free
        self._first_s = first_s
        self._longest_s = longest_s
        self._records: dict[str, _Attempts] = {}

    def wait_s(self, key: str, now_s: float) -> float:
        """Return the wait before the next try of a key, or 0."""
        record = self._records.get(key)
        return 0.0 if record is None else max(0.0, record.until_s - now_s)

    def count_attempt(self, key: str, now_s: float) -> None:
        """Count an attempt."""
        record = self._records.get(key)
        if record is None or now_s - record.last_s > CALM_S:
            self._make_room(key, now_s)
            record = self._records[key] = _Attempts(0, now_s, now_s)
        record.tries += 1
        record.last_s = now_s
        over = record.tries - self._free
        if over >= 0:
            # Bound the exponent to avoid overflow.
            wait_s = min(self._longest_s, self._first_s * 2.0 ** min(over, 32))
            record.until_s = now_s + wait_s

    def refund(self, key: str) -> None:
        """Remove one successful try and the wait that it caused."""
        record = self._records.get(key)
        if record is not None:
            record.tries -= 1
            record.until_s = record.last_s
            if record.tries <= 0:
                del self._records[key]

    def forget(self, key: str) -> None:
        """Remove all tries of a key."""
        self._records.pop(key, None)

    def _make_room(self, key: str, now_s: float) -> None:
        if key not in self._records and len(self._records) >= KEYS:
            # Otherwise many invented keys would evict one that has nearly used up its tries.
            del self._records[
                min(
                    self._records,
                    key=lambda k: (max(now_s, self._records[k].until_s), self._records[k].tries),
                )
            ]


class LoginTokenBucket:
    """Token bucket that limits the attempts of all keys together."""

    def __init__(self, at_once: int, every_s: float) -> None:
        """Allow `at_once` tries at once, refilled by one every `every_s`."""
        self._at_once = at_once
        self._every_s = every_s
        self._left = float(at_once)
        self._now_s = 0.0

    def wait_s(self, now_s: float) -> float:
        """Return the wait before the next try, or 0."""
        self._refill(now_s)
        return max(0.0, 1.0 - self._left) * self._every_s

    def count_attempt(self, now_s: float) -> None:
        """Count an attempt."""
        self._refill(now_s)
        self._left -= 1.0

    def refund(self) -> None:
        """Return the token of a successful try."""
        self._left = min(self._at_once, self._left + 1.0)

    def _refill(self, now_s: float) -> None:
        gained = max(0.0, now_s - self._now_s) / self._every_s
        self._left = min(self._at_once, self._left + gained)
        self._now_s = max(now_s, self._now_s)


class AttemptLimits:
    """Limits per address and for all together; `now_s` is monotonic time."""

    def __init__(self, addresses: LoginRateLimiter | None = None) -> None:
        """`addresses` is the limit per address, by default five free tries."""
        # The waits are bounded, so that an attacker behind the same address cannot lock others out
        # for long.
        self.addresses = addresses or LoginRateLimiter(free=5, first_s=5.0, longest_s=900.0)
        # This limit is independent of addresses, because any local process can forge the headers of
        # a proxy.
        self.together = LoginTokenBucket(at_once=60, every_s=5.0)

    def wait_s(self, address: str, now_s: float, other_s: float = 0.0) -> float:
        """Return the wait before the next try; if 0, count the try until `right` is called.

        `other_s` is the wait of another limit on the same try.
        """
        wait_s = max(other_s, self.addresses.wait_s(address, now_s), self.together.wait_s(now_s))
        if wait_s <= 0.0:
            self.together.count_attempt(now_s)
            self.addresses.count_attempt(address, now_s)
        return wait_s

    def right(self, address: str) -> None:
        """Record that a try succeeded. Other tries from the address still count."""
        self.together.refund()
        self.addresses.refund(address)


def subscriber_network(address: str) -> str:
    """Return the rate-limit key of an address: for IPv6 the subscriber's /64 network."""
    try:
        parsed = parse_address(address)
    except ValueError:
        return "unknown"
    if parsed.version == 4:
        return str(parsed)
    return str(ipaddress.ip_network((parsed, 64), strict=False))


def parse_address(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Parse an address, an IPv4 address in IPv6 notation as the former; raises ValueError."""
    parsed = ipaddress.ip_address(address)
    mapped = parsed.ipv4_mapped if parsed.version == 6 else None
    return mapped or parsed
