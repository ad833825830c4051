"""Timing of the loop of a node, and the check that its id is unique."""

from __future__ import annotations

import math
import secrets
import threading
import time
from collections import deque

import numpy as np

from tsd_twin.bus import Bus
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.events import Event
from tsd_twin.messages.status import LoopStatus

_REMEMBERED = 500
_SLEEP_S = 0.02


class RateKeeper:
    """Fixed-rate timer; missed periods count as overruns and are skipped."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = time.monotonic()
        self._last_s = self._next_s
        self._periods_s: deque[float] = deque(maxlen=_REMEMBERED)
        self._overruns = 0

    def wait(self, stop: threading.Event) -> float:
        """Wait for the next period or for `stop`; return the monotonic time."""
        self._next_s += self._period_s
        ahead_s = self._next_s - time.monotonic()
        if ahead_s > _SLEEP_S:
            stop.wait(ahead_s)
        elif ahead_s > 0.0:
            # Costs half as much as waiting for an event, and delays `stop` only by this time.
            time.sleep(ahead_s)
        elif ahead_s < -self._period_s:
            self._overruns += 1
            self._next_s = time.monotonic()
        now_s = time.monotonic()
        self._periods_s.append(now_s - self._last_s)
        self._last_s = now_s
        return now_s

    def status(self) -> LoopStatus:
        """Return rate, overruns, jitter and longest period of the loop."""
        if not self._periods_s:
            return LoopStatus()
        periods_s = np.array(self._periods_s)
        place = min(len(periods_s) - 1, math.ceil(0.99 * len(periods_s)))
        p99_s = float(np.partition(np.abs(periods_s - self._period_s), place)[place])
        hz = 1.0 / float(periods_s.mean())
        longest_ms = round(1000.0 * float(periods_s.max()), 1)
        return LoopStatus(round(hz, 1), self._overruns, round(1000.0 * p99_s, 2), longest_ms)


class DuplicateIdMonitor:
    """Detects other nodes with the same robot id by numbered liveliness tokens.

    The check at startup only finds nodes already on the bus. If two networks were joined later, two
    robots would follow the same commands.
    """

    def __init__(self, bus: Bus, robot_id: str) -> None:
        self._id = robot_id
        instance = secrets.token_hex(8)
        self._own = topics.instance_key(robot_id, instance)
        self._others: set[str] = set()
        self.fault: Reason | None = None
        """Reason for the fault; None while no other robot has this id."""
        self._event: Event | None = None
        self._token = bus.declare_token(self._own)
        bus.subscribe_liveliness(topics.instance_key(robot_id, "*"), self._on_token)

    def step(self, now_s: float) -> Reason | None:
        """Check the tokens of other nodes; return `fault`."""
        fault = because(Code.DUPLICATE_ID, robot=self._id) if self._others else None
        if fault != self.fault:
            self.fault = fault
            why = fault or because(Code.DUPLICATE_ID_GONE, robot=self._id)
            self._event = Event.of("id", why, "one robot for each id", now_s)
        return fault

    def take_event(self) -> Event | None:
        """Return the event of a duplicate id appearing or disappearing, once."""
        event, self._event = self._event, None
        return event

    def close(self) -> None:
        """Undeclare the token."""
        self._token.close()

    def _on_token(self, key: str, is_alive: bool) -> None:
        # On a bus thread; the loop only checks whether the set is empty.
        if key == self._own:
            return
        if is_alive:
            self._others.add(key)
        else:
            self._others.discard(key)
