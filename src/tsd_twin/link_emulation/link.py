"""Emulated link in one direction, for packets and for TCP streams; pure, with time as an
argument.
"""

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
    """Packet counters; packets neither lost nor delivered are in transit."""

    packets: int
    """Put on their way; over TCP a segment counts each time it is sent."""
    lost: int
    """By chance, by a cut, or because the queue was full."""
    delivered: int


TICK_S = 1e-6
"""Times closer than this are the same: clocks count large numbers, and those are rounded."""


class StallClock:
    """Conversion between time and the running time of a link, which excludes stalls; seconds.

    A link that schedules in running time handles stalls without further rules: a stall delays
    packets in transit by its length, and keeps their order and spacing.
    """

    def __init__(self, start_s: float, stall: Stall | None) -> None:
        self._start_s = start_s
        self._stall = stall
        self._seen_s = start_s
        self._ran_s = 0.0
        self._held_until_s = start_s

    def read(self, now_s: float) -> float:
        """Return how long the link has run; time that went back counts as time that stood."""
        if now_s > self._seen_s:
            # What was held is over at the latest when the time that is asked for comes.
            since_s = min(now_s, max(self._seen_s, self._held_until_s))
            self._ran_s += self._ran(now_s) - self._ran(since_s)
            self._seen_s = now_s
        return self._ran_s

    def hold(self, length_s: float, now_s: float) -> None:
        """Stall for `length_s` from now on; of overlapping stalls the later end holds."""
        self.read(now_s)
        self._held_until_s = max(self._held_until_s, now_s + length_s)

    def change(self, stall: Stall | None, now_s: float) -> None:
        """Stall in another rhythm from now on, still counted from the start."""
        self.read(now_s)
        self._stall = stall

    def stands(self, now_s: float) -> bool:
        """Return whether the link stalls now."""
        if now_s < self._held_until_s - TICK_S:
            return True
        if self._stall is None:
            return False
        periods, into_s = divmod(now_s - self._start_s, self._stall.period_s)
        return periods >= 1.0 and into_s < self._stall.length_s - TICK_S

    def when(self, ran_s: float) -> float:
        """Return when the link will have run for `ran_s`, without a further stall on request."""
        from_s = max(self._seen_s, self._held_until_s)
        ran_s = self._ran(from_s) + max(0.0, ran_s - self._ran_s)
        stalls = 0.0
        if self._stall is not None and ran_s >= self._stall.period_s - TICK_S:
            between_s = self._stall.period_s - self._stall.length_s
            stalls = 1.0 + math.floor((ran_s + TICK_S - self._stall.period_s) / between_s)
        stalled_s = stalls * self._stall.length_s if self._stall is not None else 0.0
        return self._start_s + ran_s + stalled_s

    def _ran(self, at_s: float) -> float:
        """Running time since the start without stalls on request."""
        since_start_s = at_s - self._start_s
        if self._stall is None or since_start_s < self._stall.period_s:
            return since_start_s
        periods, into_s = divmod(since_start_s, self._stall.period_s)
        stalled_s = (periods - 1.0) * self._stall.length_s + min(self._stall.length_s, into_s)
        return since_start_s - stalled_s


DETOUR_S = 0.05
"""Additional delay of a packet that others may overtake."""

Packet = TypeVar("Packet")


class Link(Generic[Packet]):
    """Emulated link in one direction: delays, reorders and loses packets.

    A packet travels for `delay_s` and its jitter, waits for its turn, and leaves at the rate of
    the link. Those on the straight way keep their order: one that jitter makes late holds up those
    behind it. One on a detour keeps clear of them. Times are seconds of any clock, never falling.

    Args:
        spec: what it does to them.
        random: where chance comes from.
        start_s: when periodic stalls start to count.
        capacity_bytes: what may be on the way and wait; what comes on top is lost.
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
        self._stopwatch = StallClock(start_s, spec.stall)
        self._capacity_bytes = capacity_bytes
        # Times in here are those of the stall clock. The count decides between two of one time.
        self._on_the_way: list[tuple[float, int, int, Packet]] = []
        self._bytes = 0
        self._straight_s = 0.0
        self._free_s = 0.0
        self._is_cut = False
        self._packets = self._lost = self._delivered = 0

    @property
    def spec(self) -> LinkSpec:
        """Specification in force."""
        return self._spec

    @property
    def counters(self) -> Counters:
        """Counters of all packets."""
        # Another thread may read them: what is counted last is read first.
        lost, delivered = self._lost, self._delivered
        return Counters(self._packets, lost, delivered)

    def send(self, packet: Packet, size_bytes: int, now_s: float) -> bool:
        """Put a packet on its way, and return False when it is lost."""
        self._packets += 1
        # Always all three, so that changing one property leaves the chance of the others alone.
        fate, way, lateness = self._random.random(3)
        overflows = self._bytes + size_bytes > self._capacity_bytes
        if self._is_cut or overflows or fate < self._spec.loss:
            self._lost += 1
            return False
        jitter_s = -self._spec.jitter_s * math.log1p(-lateness)
        there_s = self._stopwatch.read(now_s) + self._spec.delay_s + jitter_s
        if way < self._spec.reorder:
            there_s += DETOUR_S
        else:
            there_s = self._straight_s = max(self._straight_s, there_s)
        heapq.heappush(self._on_the_way, (there_s, self._packets, size_bytes, packet))
        self._bytes += size_bytes
        return True

    def receive(self, now_s: float) -> list[Packet]:
        """Packets that have arrived, in the order of their arrival."""
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
        """Return when the next packet arrives without further calls; None when there is none."""
        return self._stopwatch.when(self._through_s()) if self._on_the_way else None

    def stall(self, length_s: float, now_s: float) -> None:
        """Deliver nothing for `length_s`, and lose nothing."""
        self._stopwatch.hold(length_s, now_s)

    def cut(self) -> list[Packet]:
        """Lose everything from now on; return what was on its way, in the order of sending."""
        self._is_cut = True
        lost = [packet for _, _, _, packet in sorted(self._on_the_way, key=lambda each: each[1])]
        self._lost += len(lost)
        self._on_the_way.clear()
        self._bytes = 0
        self._straight_s = 0.0  # A lost packet delays no other.
        return lost

    def restore(self) -> None:
        """End the cut."""
        self._is_cut = False

    def change(self, spec: LinkSpec, now_s: float) -> None:
        """Change the specification from now on; the seed has effect at the start only."""
        self._stopwatch.change(spec.stall, now_s)
        self._spec = spec

    def _through_s(self) -> float:
        there_s, _, size_bytes, _ = self._on_the_way[0]
        return max(there_s, self._free_s) + 8.0 * size_bytes / self._spec.bandwidth_bit_per_s


MIN_TIMEOUT_S = 0.2
"""Shortest retransmission time-out, as Linux has it."""
MAX_TIMEOUT_S = 120.0
"""Longest, however often a segment is lost; as Linux has it."""

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
    """Reliable, ordered byte stream over a lossy link, as TCP has it.

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
