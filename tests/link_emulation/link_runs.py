"""Emulated links run in virtual time, and random link specifications."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from tsd_twin.link_emulation import LinkSpec, Stall
from tsd_twin.link_emulation.link import TICK_S, LinkModel

ROUNDING_S = 2.0 * TICK_S


@dataclass(frozen=True)
class Sent:
    """Packet of a run."""

    number: int
    size_bytes: int
    at_s: float


def link(spec: LinkSpec, start_s: float = 0.0, capacity_bytes: float = math.inf) -> LinkModel[Sent]:
    return LinkModel(spec, np.random.default_rng(spec.seed), start_s, capacity_bytes)


def travel(link: LinkModel[Sent], packets: Iterable[Sent]) -> list[tuple[Sent, float]]:
    """Send packets at their times; return those that arrive, each with the time, in order."""
    arrived: list[tuple[Sent, float]] = []

    def receive_until(until_s: float) -> None:
        while (due_s := link.next_s()) is not None and due_s <= until_s:
            arrived.extend((packet, due_s) for packet in link.receive(due_s))

    for packet in packets:
        receive_until(packet.at_s)
        link.send(packet, packet.size_bytes, packet.at_s)
    receive_until(math.inf)
    return arrived


def paced(count: int, gap_s: float, size_bytes: int = 100) -> list[Sent]:
    """Return packets sent at a steady pace."""
    return [Sent(number, size_bytes, number * gap_s) for number in range(count)]


delays_s = st.sampled_from([0.0, 1e-4, 0.15]) | st.floats(0.0, 1.0)
stalls = st.builds(
    lambda length_s, between_s: Stall(length_s, length_s + between_s),
    st.floats(0.01, 2.0),
    st.floats(0.01, 5.0),
)
bandwidths = st.sampled_from([math.inf, 64e3]) | st.floats(1e4, 1e8)


@st.composite
def specs(draw: st.DrawFn, *, loss: float | None = None, reorder: float | None = None) -> LinkSpec:
    shares = st.sampled_from([0.0, 0.02]) | st.floats(0.0, 0.9)
    return LinkSpec(
        delay_s=draw(delays_s),
        jitter_s=draw(delays_s),
        loss=draw(shares) if loss is None else loss,
        reorder=draw(shares) if reorder is None else reorder,
        stall=draw(st.none() | stalls),
        bandwidth_bit_per_s=draw(bandwidths),
        seed=draw(st.integers(0, 1000)),
    )


@st.composite
def journeys(draw: st.DrawFn) -> list[Sent]:
    """Draw packets at random times, some of them at one time."""
    gaps_s = draw(st.lists(st.sampled_from([0.0, 0.02]) | st.floats(0.0, 1.0), max_size=60))
    times_s = np.cumsum(gaps_s)
    sizes = st.integers(1, 1500)
    return [Sent(number, draw(sizes), float(at_s)) for number, at_s in enumerate(times_s)]
