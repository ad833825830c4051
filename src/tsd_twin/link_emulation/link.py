"""Sans-I/O model of a one-way link, for packets and TCP streams."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tsd_twin.link_emulation.spec import LinkSpec, Stall


@dataclass(frozen=True, slots=True)
class Counters:
    """Packet counters; packets neither lost nor delivered are in flight."""

    packets: int
    """Packets sent; retransmitted TCP segments count again."""
    lost: int
    """Lost by chance, by a cut, or because the queue was full."""
    delivered: int


TICK_S = 1e-6
"""Tolerance for equal times, above the rounding of large clock values."""


class StallClock:
    """Converts between time and the running time of a link, which excludes stalls; seconds.

    Scheduling in running time makes stalls trivial: a stall delays packets in flight by its length
    and keeps their order and spacing.
    """

    def __init__(self, start_s: float, stall: Stall | None) -> None:
        self._start_s = start_s
        self._stall = stall
        self._seen_s = start_s
        self._ran_s = 0.0
        self._held_until_s = start_s

    def read(self, now_s: float) -> float:
        """Return the running time; a clock that jumps back counts as paused."""
        if now_s > self._seen_s:
            # A requested stall ends no later than `now_s`.
            since_s = min(now_s, max(self._seen_s, self._held_until_s))
            self._ran_s += self._ran(now_s) - self._ran(since_s)
            self._seen_s = now_s
        return self._ran_s

    def hold(self, length_s: float, now_s: float) -> None:
        """Stall for `length_s`; if stalls overlap, the later end applies."""
        self.read(now_s)
        self._held_until_s = max(self._held_until_s, now_s + length_s)

    def change(self, stall: Stall | None, now_s: float) -> None:
        """Replace the periodic stalls; their phase is still relative to the start."""
        self.read(now_s)
        self._stall = stall

    def stands(self, now_s: float) -> bool:
        """Return whether the link is stalled now."""
        if now_s < self._held_until_s - TICK_S:
            return True
        if self._stall is None:
            return False
        periods, into_s = divmod(now_s - self._start_s, self._stall.period_s)
        return periods >= 1.0 and into_s < self._stall.length_s - TICK_S

    def when(self, ran_s: float) -> float:
        """Return when the running time reaches `ran_s`, assuming no further requested stalls."""
        from_s = max(self._seen_s, self._held_until_s)
        ran_s = self._ran(from_s) + max(0.0, ran_s - self._ran_s)
        stalls = 0.0
        if self._stall is not None and ran_s >= self._stall.period_s - TICK_S:
            between_s = self._stall.period_s - self._stall.length_s
            stalls = 1.0 + math.floor((ran_s + TICK_S - self._stall.period_s) / between_s)
        stalled_s = stalls * self._stall.length_s if self._stall is not None else 0.0
        # Rounding may not make a packet due before it was sent.
        return max(from_s, self._start_s + ran_s + stalled_s)

    def _ran(self, at_s: float) -> float:
        """Return the running time since the start, ignoring requested stalls."""
        since_start_s = at_s - self._start_s
        if self._stall is None or since_start_s < self._stall.period_s:
            return since_start_s
        periods, into_s = divmod(since_start_s, self._stall.period_s)
        stalled_s = (periods - 1.0) * self._stall.length_s + min(self._stall.length_s, into_s)
        return since_start_s - stalled_s


DETOUR_S = 0.05
"""Additional delay of reordered packets."""

Packet = TypeVar("Packet")


class LinkModel(Generic[Packet]):
    """Emulated link in one direction: delays, reorders and drops packets.

    A packet is delayed by `delay_s` plus wander and jitter, queues, and leaves at the rate of the
    link. Packets keep their order, so a late one holds up its successors, except for reordered
    packets, which take a detour. Times are seconds of any non-decreasing clock.

    Args:
        spec: Link properties.
        random: Random generator.
        start_s: Start of the first period of periodic stalls.
        capacity_bytes: Maximum data in flight and queued; excess packets are dropped.
    """

    def __init__(
        self,
        spec: LinkSpec,
        random: np.random.Generator,
        start_s: float,
        capacity_bytes: float = math.inf,
    ) -> None:
        self._spec = spec
        self._random = random
        self._start_s = start_s
        self._stopwatch = StallClock(start_s, spec.stall)
        self._capacity_bytes = capacity_bytes
        # Times are in running time; the packet count breaks ties.
        self._on_the_way: list[tuple[float, int, int, Packet]] = []
        self._bytes = 0
        self._straight_s = 0.0
        self._free_s = 0.0
        self._is_cut = False
        self._packets = self._lost = self._delivered = 0

    @property
    def spec(self) -> LinkSpec:
        """Active specification."""
        return self._spec

    @property
    def counters(self) -> Counters:
        """Counters of all packets."""
        # Another thread may read these, so read them in reverse order of counting.
        lost, delivered = self._lost, self._delivered
        return Counters(self._packets, lost, delivered)

    def send(self, packet: Packet, size_bytes: int, now_s: float) -> bool:
        """Send a packet; return False if it is lost."""
        self._packets += 1
        # Always draw all three, so that changing one property does not affect the others.
        fate, way, lateness = self._random.random(3)
        overflows = self._bytes + size_bytes > self._capacity_bytes
        if self._is_cut or overflows or fate < self._spec.loss:
            self._lost += 1
            return False
        jitter_s = -self._spec.jitter_s * math.log1p(-lateness)
        there_s = (
            self._stopwatch.read(now_s) + self._spec.delay_s + self._wander_s(now_s) + jitter_s
        )
        if way < self._spec.reorder:
            there_s += DETOUR_S
        else:
            there_s = self._straight_s = max(self._straight_s, there_s)
        heapq.heappush(self._on_the_way, (there_s, self._packets, size_bytes, packet))
        self._bytes += size_bytes
        return True

    def receive(self, now_s: float) -> list[Packet]:
        """Return delivered packets in order of arrival."""
        ran_s = self._stopwatch.read(now_s)
        arrived: list[Packet] = []
        if self._stopwatch.stands(now_s):
            return arrived
        while self._on_the_way and (through_s := self._through_s()) <= ran_s + TICK_S:
            _, _, size_bytes, packet = heapq.heappop(self._on_the_way)
            self._free_s = through_s
            self._bytes -= size_bytes
            arrived.append(packet)
        self._delivered += len(arrived)
        return arrived

    def next_s(self) -> float | None:
        """Return the arrival time of the next packet without further calls, or None."""
        return self._stopwatch.when(self._through_s()) if self._on_the_way else None

    def stall(self, length_s: float, now_s: float) -> None:
        """Deliver nothing for `length_s`, without losing packets."""
        self._stopwatch.hold(length_s, now_s)

    def cut(self) -> list[Packet]:
        """Drop all further packets; return those in flight, oldest first."""
        self._is_cut = True
        lost = [packet for _, _, _, packet in sorted(self._on_the_way, key=lambda each: each[1])]
        self._lost += len(lost)
        self._on_the_way.clear()
        self._bytes = 0
        self._straight_s = 0.0  # Lost packets do not delay others.
        return lost

    def restore(self) -> None:
        """End the cut."""
        self._is_cut = False

    def change(self, spec: LinkSpec, now_s: float) -> None:
        """Replace the specification; the new seed is ignored."""
        self._stopwatch.change(spec.stall, now_s)
        self._spec = spec

    def _wander_s(self, now_s: float) -> float:
        """Return the additional delay of this period, the same in both directions."""
        wander = self._spec.wander
        if wander is None:
            return 0.0
        period = max(0, math.floor((now_s - self._start_s) / wander.period_s))
        return wander.most_s * np.random.default_rng((self._spec.seed, period)).random()

    def _through_s(self) -> float:
        there_s, _, size_bytes, _ = self._on_the_way[0]
        return max(there_s, self._free_s) + 8.0 * size_bytes / self._spec.bandwidth_bit_per_s


MIN_TIMEOUT_S = 0.2
"""Minimum retransmission timeout (Linux default)."""
MAX_TIMEOUT_S = 120.0
"""Maximum retransmission timeout (Linux default)."""

Payload = TypeVar("Payload")


@dataclass(slots=True)
class Segment(Generic[Payload]):
    """Segment of a stream."""

    stream: Stream[Payload]
    number: int
    payload: Payload
    size_bytes: int
    sent_s: float


class Stream(Generic[Payload]):
    """Reliable, ordered byte stream over a lossy link, like TCP.

    A lost segment is retransmitted after the timeout of the oldest lost one, and blocks all later
    segments. Each consecutive timeout doubles the next; progress resets it (RFC 6298, section 5).
    Acknowledgements are not modelled: the sender knows which segments arrived.

    Args:
        link: Link, shared with other streams; its receiver calls `arrived`.
        release: Called with each payload in order.
    """

    def __init__(
        self, link: LinkModel[Segment[Payload]], release: Callable[[Payload], object]
    ) -> None:
        self._link = link
        self._release = release
        self._sent = 0
        self._released = 0
        self._timeouts = 0
        self._lost: dict[int, Segment[Payload]] = {}
        self._early: dict[int, Segment[Payload]] = {}
        self.waiting_bytes = 0
        """Size of segments sent and not yet released."""

    def send(self, payload: Payload, size_bytes: int, now_s: float) -> None:
        """Append a payload to the stream."""
        self._transmit(Segment(self, self._sent, payload, size_bytes, now_s))
        self._sent += 1
        self.waiting_bytes += size_bytes

    def arrived(self, segment: Segment[Payload]) -> None:
        """Accept a segment from the link, and release all payloads now in order."""
        self._early[segment.number] = segment
        while (ready := self._early.pop(self._released, None)) is not None:
            self._released += 1
            self._timeouts = 0
            self.waiting_bytes -= ready.size_bytes
            self._release(ready.payload)

    def lost(self, segment: Segment[Payload]) -> None:
        """Record that the link lost a segment."""
        self._lost[segment.number] = segment

    def next_s(self) -> float | None:
        """Return the retransmission time of the oldest lost segment, or None."""
        if not self._lost:
            return None
        backed_off_s = self._timeout_s() * 2.0 ** min(self._timeouts, 32)
        return self._lost[min(self._lost)].sent_s + min(MAX_TIMEOUT_S, backed_off_s)

    def retransmit(self, now_s: float) -> None:
        """If the oldest lost segment has timed out, retransmit all segments lost that long."""
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
