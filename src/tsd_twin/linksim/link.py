"""One direction of a link: what becomes of each packet, with time as an argument."""

from __future__ import annotations

import heapq
import math
from typing import Generic, TypeVar

import numpy as np

from tsd_twin.linksim.counters import Counters
from tsd_twin.linksim.spec import LinkSpec
from tsd_twin.linksim.stopwatch import TICK_S, Stopwatch

DETOUR_S = 0.05
"""How much longer a packet takes that others may overtake."""

Packet = TypeVar("Packet")


class Link(Generic[Packet]):
    """Takes packets, and gives each back when it arrives, or never.

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
        self._stopwatch = Stopwatch(start_s, spec.stall)
        self._capacity_bytes = capacity_bytes
        # Times in here are those of the stopwatch. The count decides between two of one time.
        self._on_the_way: list[tuple[float, int, int, Packet]] = []
        self._bytes = 0
        self._straight_s = 0.0
        self._free_s = 0.0
        self._is_cut = False
        self._packets = self._lost = self._delivered = 0

    @property
    def spec(self) -> LinkSpec:
        """What it does to packets."""
        return self._spec

    @property
    def counters(self) -> Counters:
        """What became of all packets so far."""
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
        """Return the packets that have arrived, in the order of their arrival."""
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
        """Return when the next packet arrives if nobody interferes; None when there is none."""
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
        self._straight_s = 0.0  # What is lost holds up nobody.
        return lost

    def mend(self) -> None:
        """End the cut."""
        self._is_cut = False

    def change(self, spec: LinkSpec, now_s: float) -> None:
        """Treat packets otherwise from now on; the seed counts at the start only."""
        self._stopwatch.change(spec.stall, now_s)
        self._spec = spec

    def _through_s(self) -> float:
        there_s, _, size_bytes, _ = self._on_the_way[0]
        return max(there_s, self._free_s) + 8.0 * size_bytes / self._spec.bandwidth_bit_per_s
