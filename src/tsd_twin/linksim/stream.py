"""One direction of a TCP connection over a link, with time as an argument."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from tsd_twin.linksim.link import Link

MIN_TIMEOUT_S = 0.2
"""Shortest retransmission time-out, as Linux has it."""
MAX_TIMEOUT_S = 120.0
"""Longest, however often a segment is lost; as Linux has it."""

Payload = TypeVar("Payload")


@dataclass(slots=True)
class Segment(Generic[Payload]):
    """What a stream sends at a time."""

    stream: Stream[Payload]
    number: int
    payload: Payload
    size_bytes: int
    sent_s: float


class Stream(Generic[Payload]):
    """Brings payloads over a link that loses and reorders: all of them, in order, if late.

    A lost segment goes again when the retransmission time-out of the oldest one is over, and holds
    up all behind it. Each time-out in a row doubles the next; progress takes it back to the first
    (RFC 6298, section 5). Acknowledgements are not carried: the sender knows what arrived.

    Args:
        link: shared with other streams; who receives from it calls `arrived`.
        release: called with each payload in turn.
    """

    def __init__(self, link: Link[Segment[Payload]], release: Callable[[Payload], object]) -> None:
        self._link = link
        self._release = release
        self._sent = 0
        self._released = 0
        self._timeouts = 0
        self._lost: dict[int, Segment[Payload]] = {}
        self._early: dict[int, Segment[Payload]] = {}
        self.waiting_bytes = 0
        """Of segments sent and not yet released."""

    def send(self, payload: Payload, size_bytes: int, now_s: float) -> None:
        """Send a payload behind all others."""
        self._transmit(Segment(self, self._sent, payload, size_bytes, now_s))
        self._sent += 1
        self.waiting_bytes += size_bytes

    def arrived(self, segment: Segment[Payload]) -> None:
        """Take a segment from the link, and release what it completes."""
        self._early[segment.number] = segment
        while (ready := self._early.pop(self._released, None)) is not None:
            self._released += 1
            self._timeouts = 0
            self.waiting_bytes -= ready.size_bytes
            self._release(ready.payload)

    def lost(self, segment: Segment[Payload]) -> None:
        """Note that the link lost a segment on its way."""
        self._lost[segment.number] = segment

    def next_s(self) -> float | None:
        """Return when the time-out of the oldest lost segment is over; None when none is lost."""
        if not self._lost:
            return None
        backed_off_s = self._timeout_s() * 2.0 ** min(self._timeouts, 32)
        return self._lost[min(self._lost)].sent_s + min(MAX_TIMEOUT_S, backed_off_s)

    def retransmit(self, now_s: float) -> None:
        """Send again what was lost for a time-out or longer, if that of the oldest is over."""
        due_s = self.next_s()
        if due_s is None or now_s < due_s:
            return
        due = [n for n, one in self._lost.items() if one.sent_s + self._timeout_s() <= now_s]
        self._timeouts += 1
        for number in sorted(due):
            segment = self._lost.pop(number)
            segment.sent_s = now_s
            self._transmit(segment)

    def _transmit(self, segment: Segment[Payload]) -> None:
        if not self._link.send(segment, segment.size_bytes, segment.sent_s):
            self.lost(segment)

    def _timeout_s(self) -> float:
        round_trip_s = 2.0 * (self._link.spec.delay_s + self._link.spec.jitter_s)
        return min(MAX_TIMEOUT_S, max(MIN_TIMEOUT_S, 2.0 * round_trip_s))
