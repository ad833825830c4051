"""Age of ROS messages without common clocks, and turns between publishers of `cmd_vel`. Pure.

Each message carries the time of its publisher's clock. The smallest difference between arrival and
that time belongs to the fastest message; a later message has waited for at least the difference to
it. The estimate may err only towards "old": while a link drains what it held back, each message is
faster than the one before, so a clock counts only after messages at the publisher's own rate. A
constant delay cannot be measured in one direction: the echo of a stamp that we sent can.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from tsd_twin.interop.cmd_vel import PAUSE_S

MOST_PUBLISHERS = 64
"""Publishers per topic whose clocks are known; further ones are refused while all of them send."""
SILENT_S = 60.0
"""The clock of a publisher that was silent for longer is forgotten."""
DRIFT = 5e-4
"""Seconds per second by which two clocks may drift apart."""
STEADY_S = 0.5
"""A new clock is known after messages at a steady rate for this long."""
CONFIRM_S = 0.1
"""A known clock counts again after a gap and messages at a steady rate for this long."""
GAP_S = 0.3
"""Messages further apart are not at a steady rate."""
JITTER_S = 0.02
"""At a steady rate no message is faster than the first one by more."""
SLOWER_S = 0.1
"""At a steady rate no message is slower than the first one by more."""
FASTER_S = 0.1
"""A clock is no longer known if a message is faster than in its steady start by more."""
MOST_ECHOES = 256
"""Stamps of `odom` whose echo is recognized: several seconds."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where and when a message was published."""

    publisher: bytes
    sequence: int
    source_ns: int
    """Wall clock of the publisher."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """Send time of a message, as far as its publisher's clock shows it."""

    sent_after_s: float
    """Earliest time at which it can have been sent, on our clock; -inf if the clock has jumped."""
    unproven: str = ""
    """Reason why that time does not count yet."""


LEARNING = (
    "cmd_vel counts after half a second at a steady rate, of four messages per second or more: the "
    "clock of its publisher is not known yet"
)
CONFIRMING = "cmd_vel counts after a second message: its publisher was silent"
CROWDED = f"cmd_vel of one more publisher is ignored: {MOST_PUBLISHERS} have published it lately"


@dataclass(slots=True)
class _Clock:
    """Clock of one publisher; offsets are our monotonic clock less the wall clock there."""

    sequence: int
    at_s: float
    """Arrival of the newest message."""
    first_s: float
    """Arrival of the first message of the steady part."""
    first_offset_s: float
    fastest_offset_s: float
    """Offset of the fastest message."""
    usual_offset_s: float = -math.inf
    """The same, but falls no faster than two clocks drift apart; -inf until the clock is known."""
    is_steady: bool = False

    def note(self, offset_s: float, now_s: float) -> str | None:
        """Update with a message; return why its age does not count yet.

        None if the clock has jumped.
        """
        gap_s = now_s - self.at_s
        drift_s = DRIFT * gap_s
        is_known = math.isfinite(self.usual_offset_s)
        self.at_s = now_s
        self.first_offset_s -= drift_s
        self.fastest_offset_s = min(offset_s, self.fastest_offset_s + drift_s)
        if is_known:
            self.usual_offset_s = max(self.usual_offset_s - drift_s, self.fastest_offset_s)
            if offset_s < self.usual_offset_s - FASTER_S:
                self.usual_offset_s = -math.inf
                self._restart(offset_s, now_s)
                return None
        later_s = offset_s - self.first_offset_s
        if gap_s > GAP_S or not (self.is_steady or -JITTER_S <= later_s <= SLOWER_S):
            self._restart(offset_s, now_s)
        self.is_steady |= now_s - self.first_s >= (CONFIRM_S if is_known else STEADY_S)
        if not self.is_steady:
            return CONFIRMING if is_known else LEARNING
        if not is_known:
            self.usual_offset_s = self.fastest_offset_s
        return ""

    def _restart(self, offset_s: float, now_s: float) -> None:
        self.first_s, self.first_offset_s, self.is_steady = now_s, offset_s, False


class Arrivals:
    """Clocks and sequence numbers of all publishers of a topic."""

    def __init__(self) -> None:
        self._clocks: dict[bytes, _Clock] = {}

    def note(self, origin: Origin, now_s: float) -> Arrival | None:
        """Return the send time of a message that arrives at `now_s`.

        None if the message has come before, or after a newer one.
        """
        offset_s = now_s - 1e-9 * origin.source_ns
        clock = self._clocks.get(origin.publisher)
        if clock is not None and origin.sequence <= clock.sequence:
            return None
        if clock is None or now_s - clock.at_s > SILENT_S:
            if clock is None and not self._has_room(now_s):
                return Arrival(now_s, CROWDED)
            clock = _Clock(origin.sequence, now_s, now_s, offset_s, offset_s)
            self._clocks[origin.publisher] = clock
        clock.sequence = origin.sequence
        unproven = clock.note(offset_s, now_s)
        if unproven is None:
            return Arrival(-math.inf)
        return Arrival(1e-9 * origin.source_ns + clock.fastest_offset_s, unproven)

    def _has_room(self, now_s: float) -> bool:
        """Forget publishers that are silent; return whether one more has room."""
        if len(self._clocks) >= MOST_PUBLISHERS:
            self._clocks = {
                key: clock for key, clock in self._clocks.items() if now_s - clock.at_s <= SILENT_S
            }
        return len(self._clocks) < MOST_PUBLISHERS


class Echoes:
    """Stamps of `odom` that we sent, and when: an echo proves that a twist was sent later."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, float]] = deque(maxlen=MOST_ECHOES)

    def sent(self, stamp_ns: int, now_s: float) -> None:
        """Note a stamp before it is published."""
        self._sent.append((stamp_ns, now_s))

    def sent_after_s(self, stamp_ns: int) -> float | None:
        """Return when a stamp was sent; None if it is not one of the newest."""
        known = list(self._sent)  # Another thread appends.
        return next((at_s for each_ns, at_s in reversed(known) if each_ns == stamp_ns), None)


class OnePublisher:
    """Turn of one publisher of `cmd_vel`: twists of others move nothing until it pauses.

    A publisher that was refused has to pause as well, so that a stick that is held on does not
    begin to count.
    """

    def __init__(self) -> None:
        self._publisher, self._moved_s = b"", -math.inf
        self._refused: dict[bytes, float] = {}

    def admits(self, publisher: bytes, moves: bool, now_s: float) -> bool:
        """Note a twist, other than zero if it `moves`; return whether it counts."""
        taken = publisher != self._publisher and now_s - self._moved_s < PAUSE_S
        if not moves:
            return not taken
        recent = {each: at_s for each, at_s in self._refused.items() if now_s - at_s < PAUSE_S}
        if taken or publisher in recent:
            while len(recent) >= MOST_PUBLISHERS:
                del recent[next(iter(recent))]
            self._refused = {**recent, publisher: now_s}
            return False
        self._refused, self._publisher, self._moved_s = recent, publisher, now_s
        return True
