"""Delay and gaps of commands that take turns on several sockets over emulated links.

`python -m tests.dashboard.sessions.test_lanes_over_links SECONDS SEEDS` prints the table of
`docs/link.md`.
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from tests.dashboard.pictures.thin_link import Direction, VirtualLoop
from tsd_twin.dashboard.sessions.session_manager import MAX_LANES
from tsd_twin.dashboard.sessions.teleop import COMMAND_TIMEOUT_S
from tsd_twin.link_emulation import LinkSpec

PERIOD_S, COMMAND_BYTES = 0.02, 150
LINKS = (
    "wifi",
    "satellite",
    "transatlantic",
    "delay=45ms,loss=2%",
    "delay=150ms,jitter=30ms,loss=2%",
)
SOCKETS = (1, 2, 1 + MAX_LANES, 2 * (1 + MAX_LANES))


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Arrival of commands that are newer than all earlier ones, in a single drive."""

    gaps_per_min: float
    """Times without one for longer than the dashboard waits for a page."""
    delays_s: np.ndarray
    """Delay of each command, or of a newer one if that arrived before it."""


def drive(link: str, sockets: int, seed: int, seconds: float) -> Arrivals:
    """Send 50 commands per second, in turn over sockets that each lose and repeat segments."""
    loop = VirtualLoop()
    direction = Direction(loop, LinkSpec.parse(link), seed)
    wires = [direction.connection() for _ in range(sockets)]
    arrived: list[tuple[float, int]] = []
    sent_s: list[float] = []
    numbers = itertools.count()

    def send() -> None:
        number = next(numbers)
        sent_s.append(loop.time())

        def arrive() -> None:
            if not arrived or number > arrived[-1][1]:
                arrived.append((loop.time(), number))

        wires[number % sockets](COMMAND_BYTES, arrive)

    loop.every(PERIOD_S, send)
    loop.run(seconds)
    times_s = np.array([at_s for at_s, _ in arrived])
    newest = [number for _, number in arrived]
    known = range(newest[-1] + 1)
    delays_s = times_s[np.searchsorted(newest, known)] - np.array(sent_s)[: len(known)]
    gaps = int(np.sum(np.diff(times_s) > COMMAND_TIMEOUT_S))
    return Arrivals(60.0 * gaps / seconds, delays_s)


@pytest.mark.parametrize("link", LINKS)
def test_lanes_keep_the_controls_of_a_lossy_link_held(link: str) -> None:
    one, lanes = (drive(link, sockets, 1, 120.0) for sockets in (1, 1 + MAX_LANES))
    assert one.gaps_per_min > 5.0
    assert lanes.gaps_per_min < 0.1 * one.gaps_per_min
    assert np.percentile(lanes.delays_s, 99) < np.percentile(one.delays_s, 99)
    assert np.median(lanes.delays_s) <= np.median(one.delays_s)


def test_lanes_delay_nothing_on_a_link_without_losses() -> None:
    delays_s = [drive("delay=20ms", sockets, 1, 10.0).delays_s for sockets in SOCKETS]
    assert np.ptp([np.max(each) for each in delays_s]) < 1e-3


def main(seconds: float, seeds: int) -> None:
    """Print a row per link, with a cell per number of sockets."""
    write = sys.stdout.write
    write("| link | " + " | ".join(f"{count} sockets" for count in SOCKETS) + " |\n")
    write("| --- " * (1 + len(SOCKETS)) + "|\n")
    for link in LINKS:
        cells = [f"`{link}`"]
        for sockets in SOCKETS:
            runs = [drive(link, sockets, 100 + seed, seconds) for seed in range(seeds)]
            gaps = np.mean([each.gaps_per_min for each in runs])
            delays_ms = 1e3 * np.concatenate([each.delays_s for each in runs])
            p50, p99 = np.percentile(delays_ms, [50, 99])
            cells.append(f"{gaps:.1f}, {p50:.0f}, {p99:.0f}")
        write(f"| {' | '.join(cells)} |\n")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]))
