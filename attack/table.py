"""Rows of the attack report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Result of one attack."""

    attack: str
    """What was done, in one line."""
    promise: str
    """Guarantee to test, with its unit."""
    measured: str
    """What happened, with its unit."""
    held: bool
    """Whether the guarantee held."""

    def __str__(self) -> str:
        """Format the row for a terminal."""
        verdict = "held  " if self.held else "BROKEN"
        return f"{verdict} {self.attack:<64} {self.measured:<28} {self.promise}"
