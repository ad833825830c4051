"""A second opinion on which commands count."""

from __future__ import annotations

import math
from typing import Any


class Referee:
    """Judges every command by the rules as they are written down; no code is shared."""

    def __init__(self) -> None:
        self.holder: str | None = None
        self.lease = ""
        self.ends_s = -math.inf
        self.max_age_s = 0.25
        self.newest = 0
        self.counted = 0
        self.sent = 0
        self.counted_s = -math.inf
        self.pushed_s = -math.inf
        self.counted_lease = ""
        self.stopping = ("", -math.inf)
        """Under which lease, and when, the robot last began to stop by itself."""

    def note_stopping(self, now_s: float) -> None:
        self.stopping = (self.counted_lease, now_s)

    def grant(self, name: str, reply: Any, now_s: float) -> None:
        self.holder, self.lease, self.newest = name, reply.lease, 0
        self.ends_s, self.max_age_s = now_s + 2.0, reply.max_age_s

    def holds(self, name: str, lease: str, now_s: float) -> bool:
        return (name, lease) == (self.holder, self.lease) and now_s < self.ends_s

    def judge(self, letter: dict[str, Any], now_s: float, sent_s: float) -> None:
        """`sent_s` is when the status went out that the letter names, if it did by then."""
        self.sent += 1
        if not letter["sound"] or not self.holds(letter["name"], letter["lease"], now_s):
            return
        if letter["seq"] <= self.newest or now_s - sent_s > self.max_age_s:
            return
        if letter["lease"] == self.stopping[0] and sent_s < self.stopping[1]:
            return
        self.counted_lease = letter["lease"]
        self.newest, self.ends_s = letter["seq"], now_s + 2.0
        self.counted, self.counted_s = self.counted + 1, now_s
        if any(letter["twist"]):
            self.pushed_s = now_s
