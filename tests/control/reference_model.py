"""Reference model: an independent decision of which commands count."""

from __future__ import annotations

import math
from typing import Any


class CommandReference:
    """Independent decision on every command, from the written rules; shares no code."""

    def __init__(self, default_age_s: float) -> None:
        self.default_age_s = default_age_s
        """Age that commands may have under a lease that asked for no other."""
        self.holder: str | None = None
        self.lease = ""
        self.ends_s = -math.inf
        self.max_age_s = default_age_s
        self.newest = 0
        self.counted = 0
        self.sent = 0
        self.counted_s = -math.inf
        self.echoed_s = -math.inf
        """Send time of the status seen by the latest accepted command."""
        self.pushed_s = -math.inf
        self.stands_until_s = -math.inf
        """Time at which the latest accepted command expires."""
        self.interrupted_s = -math.inf
        """When the robot was last armed, became ready, began to stop, or was shut off."""
        self.asked = ("", -math.inf)
        """Who asks the holder for control, and until when."""
        self.reserved = ("", -math.inf)
        """Who alone may take control, and until when."""
        self.kept = ("", -math.inf)
        """Refused operator, and the end of the refusal."""

    def note_interruption(self, now_s: float) -> None:
        self.interrupted_s = now_s

    def is_free(self, now_s: float) -> bool:
        """Whether the lease is free; requests to the last holder end with it."""
        if self.holder is not None and now_s >= self.ends_s:
            self.end()
        return self.holder is None

    def end(self) -> None:
        self.holder = None
        self.asked = self.reserved = self.kept = ("", -math.inf)

    def asker(self, now_s: float) -> str:
        return self.asked[0] if not self.is_free(now_s) and now_s < self.asked[1] else ""

    def stands(self, now_s: float) -> bool:
        """Return whether the latest accepted command may still move the robot.

        It arrived within the timeout plus the lease's additional age, and the status it had seen
        was sent within the lease's maximum age.
        """
        return now_s <= self.stands_until_s

    def may_acquire(self, name: str, take_over: bool, now_s: float) -> bool:
        if now_s < self.reserved[1] and self.reserved[0] != name:
            return False
        return take_over or self.is_free(now_s)

    def may_request(self, name: str, now_s: float) -> bool:
        if self.is_free(now_s) or name == self.holder:
            return False
        if now_s < self.kept[1] and name == self.kept[0]:
            return False
        return self.asker(now_s) in ("", name)

    def hand_over(self, now_s: float) -> None:
        """Hand the lease from its holder to the requester."""
        asker = self.asker(now_s)
        self.end()
        if asker:
            self.reserved = (asker, now_s + 3.0)

    def grant(self, name: str, reply: Any, now_s: float) -> None:
        self.end()
        self.holder, self.lease, self.newest = name, reply.lease, 0
        self.ends_s, self.max_age_s = now_s + 2.0, reply.max_age_s

    def holds(self, name: str, lease: str, now_s: float) -> bool:
        return (name, lease) == (self.holder, self.lease) and now_s < self.ends_s

    def judge(self, letter: dict[str, Any], now_s: float, sent_s: float) -> None:
        """`sent_s` is when the status went out that the letter names, if it did by then."""
        self.sent += 1
        if not letter["sound"] or not self.holds(letter["name"], letter["lease"], now_s):
            return
        late = now_s - sent_s > self.max_age_s or sent_s < self.interrupted_s
        if letter["seq"] <= self.newest or (late and any(letter["twist"])):
            return
        self.newest = letter["seq"]
        self.counted, self.counted_s, self.echoed_s = self.counted + 1, now_s, sent_s
        if not late:
            self.ends_s = now_s + 2.0
            added_s = self.max_age_s - self.default_age_s
            self.stands_until_s = min(now_s + 0.2 + added_s, sent_s + self.max_age_s)
        if any(letter["twist"]):
            self.pushed_s = now_s
