"""Message age without synchronized clocks, and arbitration of `cmd_vel` publishers (pure).

Each message carries the wall-clock time of its publisher. The minimum difference between arrival
and send time belongs to the fastest message; a later message was delayed by at least the excess
over that minimum. The estimate may err only towards "old": while a link drains its backlog, each
message is faster than the one before, so a clock is trusted only after messages at the publisher's
own rate. A constant delay is not observable in one direction, but an echo of a stamp that we sent
reveals it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from tsd_twin.adapters.cmd_vel import PAUSE_S

MOST_PUBLISHERS = 64
"""Maximum number of known clocks per topic; further publishers are refused while all are active."""
SILENT_S = 60.0
"""The clock of a publisher is discarded after this time without messages."""
DRIFT = 5e-4
"""Maximum drift between two clocks, in s/s."""
STEADY_S = 0.5
"""Duration of a steady rate after which a new clock is known."""
CONFIRM_S = 0.1
"""Duration of a steady rate after which a known clock is trusted again after a gap."""
GAP_S = 0.3
"""Maximum interval between messages at a steady rate."""
JITTER_S = 0.02
"""At a steady rate, no message is faster than the first one by more than this."""
SLOWER_S = 0.1
"""At a steady rate, no message is slower than the first one by more than this."""
FASTER_S = 0.1
"""A clock is reset by a message faster than its steady start by more than this."""
MOST_ECHOES = 256
"""Number of `odom` stamps with a recognized echo (several seconds)."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Publisher, sequence number and send time of a message."""

    publisher: bytes
    sequence: int
    source_ns: int
    """Publisher's wall clock."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """Estimated send time of a message."""

    sent_after_s: float
    """Earliest possible send time on our clock; -inf if the publisher's clock jumped."""
    unproven: str = ""
    """Reason why that time is not yet reliable."""


LEARNING = (
    "cmd_vel counts after half a second at a steady rate, of four messages per second or more: the "
    "clock of its publisher is not known yet"
)
CONFIRMING = "cmd_vel counts after a second message: its publisher was silent"
CROWDED = f"cmd_vel of one more publisher is ignored: {MOST_PUBLISHERS} have published it lately"


@dataclass(slots=True)
class _Clock:
    """Clock of a publisher; offsets are our monotonic time minus its wall-clock time."""

    sequence: int
    at_s: float
    """Arrival of the latest message."""
    first_s: float
    """Arrival of the first message of the steady phase."""
    first_offset_s: float
    fastest_offset_s: float
    """Offset of the fastest message."""
    usual_offset_s: float = -math.inf
    """Offset limited to the maximum clock drift; -inf until the clock is known."""
    is_steady: bool = False

    def note(self, offset_s: float, now_s: float) -> str | None:
        """Process a message; return the reason why its age is not yet reliable.

        Returns None if the clock jumped.
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


class PublisherTracker:
    """Clocks and sequence numbers of all publishers on a topic."""

    def __init__(self) -> None:
        self._clocks: dict[bytes, _Clock] = {}

    def note(self, origin: Origin, now_s: float) -> Arrival | None:
        """Return the send time of a message arriving at `now_s`.

        Returns None for duplicate or reordered messages.
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
        """Discard silent publishers; return whether there is room for another."""
        if len(self._clocks) >= MOST_PUBLISHERS:
            self._clocks = {
                key: clock for key, clock in self._clocks.items() if now_s - clock.at_s <= SILENT_S
            }
        return len(self._clocks) < MOST_PUBLISHERS


class Echoes:
    """Sent `odom` stamps with times; an echo proves that a twist was sent later."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, float]] = deque(maxlen=MOST_ECHOES)

    def sent(self, stamp_ns: int, now_s: float) -> None:
        """Record a stamp before publishing it."""
        self._sent.append((stamp_ns, now_s))

    def sent_after_s(self, stamp_ns: int) -> float | None:
        """Return the send time of a stamp, or None if it is unknown or too old."""
        known = list(self._sent)  # Another thread appends.
        return next((at_s for each_ns, at_s in reversed(known) if each_ns == stamp_ns), None)


class PublisherArbiter:
    """Admits one `cmd_vel` publisher at a time; others are refused until it pauses.

    A refused publisher must also pause first, so that a held stick does not start to move the
    robot.
    """

    def __init__(self) -> None:
        self._publisher, self._moved_s = b"", -math.inf
        self._refused: dict[bytes, float] = {}

    def admits(self, publisher: bytes, moves: bool, now_s: float) -> bool:
        """Process a twist, non-zero if it `moves`; return whether it is accepted."""
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
