"""How much one socket of a page may send, judged before anything is decoded."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from types import MappingProxyType

POLICY_VIOLATION = 1008
"""Close code of a socket that floods."""
TOO_MUCH = "too many messages: this socket is closed"
"""Close reason of a socket that floods."""
GRACE = 2.0
"""A socket is closed once it owes this many times its burst, beyond the burst itself."""
_KIND = re.compile(r'\s*\{\s*"t"\s*:\s*"([a-z_]{1,20})"')
_NEVER_DROPPED = frozenset({"stop", "release"})
"""Kinds that only make the robot stop."""
_SHORT = 64
"""Characters: both of them are shorter."""


class Verdict(Enum):
    """What becomes of a message."""

    PASS = auto()
    DROP = auto()
    CUT = auto()
    """The socket floods: it has to be closed."""


@dataclass(frozen=True, slots=True)
class Quota:
    """How much is allowed on average, and how much more at once."""

    per_s: float
    burst: float


class Bucket:
    """A token bucket; time is an argument. It may go into debt, which has to be paid back."""

    def __init__(self, quota: Quota) -> None:
        self._quota = quota
        self._left = quota.burst
        self._at_s = 0.0

    def take(self, amount: float, now_s: float) -> float:
        """Take tokens, and return how many are left; below zero is a debt."""
        refill = max(0.0, now_s - self._at_s) * self._quota.per_s
        self._left = min(self._quota.burst, self._left + refill) - amount
        self._at_s = now_s
        return self._left

    def try_take(self, now_s: float) -> bool:
        """Take one token if there is one."""
        if self.take(1.0, now_s) >= 0.0:
            return True
        self._left += 1.0
        return False


@dataclass(frozen=True, slots=True)
class Limits:
    """What one socket may send."""

    messages: Quota
    size: Quota
    """In characters or bytes."""
    kinds: Mapping[str, Quota]
    """Further limits of single kinds of text messages."""
    other: Quota
    """Limit of text messages whose kind cannot be told, or has no limit of its own."""


TELEOP = Limits(
    messages=Quota(200.0, 400.0),
    size=Quota(64e3, 192e3),
    kinds=MappingProxyType(
        {
            # A page sends at most 100 of these a second, and 10 beats.
            "drive": Quota(150.0, 300.0),
            "go": Quota(150.0, 300.0),
            "beat": Quota(30.0, 100.0),
            "panel_released": Quota(10.0, 20.0),
            "plan": Quota(10.0, 20.0),
            "pace": Quota(30.0, 60.0),
            "unplan": Quota(10.0, 30.0),
            "lease": Quota(10.0, 60.0),
            "arm": Quota(10.0, 60.0),
            "disarm": Quota(10.0, 60.0),
            "reset": Quota(10.0, 60.0),
            "speed": Quota(20.0, 40.0),
            "robot": Quota(10.0, 60.0),
        }
    ),
    other=Quota(50.0, 300.0),
)
"""Of the socket of the controls."""
VISER = Limits(
    messages=Quota(120.0, 300.0), size=Quota(64e3, 256e3), kinds={}, other=Quota(120.0, 300.0)
)
"""Of viser's socket: its page sends at most 50 cameras and 20 changes of a control a second."""


class Allowance:
    """What one socket has sent lately; a message that is dropped counts as well."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._messages, self._size = Bucket(limits.messages), Bucket(limits.size)
        self._kinds: dict[str, Bucket] = {}
        self.dropped = 0
        """Messages that were not looked at."""

    def judge(self, data: str | bytes, now_s: float) -> Verdict:
        """Judge a message by its length and its first characters."""
        kind = _kind_of(data) if isinstance(data, str) else ""
        left = self._messages.take(1.0, now_s) / self._limits.messages.burst
        left = min(left, self._size.take(float(len(data)), now_s) / self._limits.size.burst)
        if left < -GRACE:
            return Verdict.CUT
        if kind in _NEVER_DROPPED and len(data) <= _SHORT:
            return Verdict.PASS
        if left < 0.0 or not self._bucket(kind).try_take(now_s):
            self.dropped += 1
            return Verdict.DROP
        return Verdict.PASS

    def _bucket(self, kind: str) -> Bucket:
        quota = self._limits.kinds.get(kind)
        name = "" if quota is None else kind
        if name not in self._kinds:
            self._kinds[name] = Bucket(quota or self._limits.other)
        return self._kinds[name]


def _kind_of(text: str) -> str:
    found = _KIND.match(text)
    return "" if found is None else found[1]


class CutOff:
    """Logins and pages whose socket was closed for flooding, and until when they stay out.

    Who floods again soon after stays out twice as long as the time before.
    """

    STAYS_OUT_S = 5.0
    LONGEST_S = 60.0
    _MOST = 1000

    def __init__(self) -> None:
        self._out: dict[str, tuple[float, float]] = {}
        """For how long, and until when."""
        self.count = 0
        """Sockets that were closed so far."""

    def __len__(self) -> int:
        """Return how many are remembered."""
        return len(self._out)

    def note(self, key: str, now_s: float) -> None:
        """Note that a socket of this login, or this page, flooded."""
        self.count += 1
        recent = now_s - self.LONGEST_S
        self._out = {who: out for who, out in self._out.items() if out[1] > recent}
        before_s, until_s = self._out.pop(key, (0.0, 0.0))
        while len(self._out) >= self._MOST:
            del self._out[next(iter(self._out))]
        if until_s > now_s:  # Another socket of the same, which was open already.
            self._out[key] = (before_s, until_s)
            return
        stays_s = min(max(self.STAYS_OUT_S, 2.0 * before_s), self.LONGEST_S)
        self._out[key] = (stays_s, now_s + stays_s)

    def waits_s(self, key: str, now_s: float) -> float:
        """Return for how much longer no new socket is opened; 0 when one is."""
        return max(0.0, self._out.get(key, (0.0, 0.0))[1] - now_s)
