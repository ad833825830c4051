"""On whose word the joints move."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Mandate:
    """What a controller board with a timeout of its own is told beside each set-point."""

    armed: bool
    """The wheels may spin."""
    words: int
    """Rises as long as an operator stands behind the set-points; what stays the same feeds nobody.

    While the robot moves, only counted commands make it rise, and once the beginning of a
    controlled stop. While it is at rest with spinning wheels, every step does: that somebody has
    control, or had it 10 s ago, is watched by the modes.
    """
