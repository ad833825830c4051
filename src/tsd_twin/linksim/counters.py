"""What became of the packets of one direction."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Counters:
    """Packets so far; those neither lost nor delivered are on their way."""

    packets: int
    """Put on their way; over TCP a segment counts each time it is sent."""
    lost: int
    """By chance, by a cut, or because the queue was full."""
    delivered: int
