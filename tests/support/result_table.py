"""Table of measured results of fault tests, printed at the end."""

from __future__ import annotations

from dataclasses import dataclass, field

from tests.support.fault_stage import SPEED_MPS, Run

LIMIT_M = 0.35
MOVED_M = 0.002
"""Standstill is standstill: a servo step of 0.09 degrees is 16 mm/s, so 2 mm is 0.12 s of one."""


@dataclass
class Table:
    """Rows in the order in which they were added."""

    rows: list[tuple[str, str, str, str, str]] = field(default_factory=list)

    def add(self, fault: str, run: Run, note: str = "") -> Run:
        """Add what a robot did since a fault, and return it."""
        moved = f"{1000 * run.after_m:.0f} mm" if run.after_m > MOVED_M else "no"
        self.rows.append((fault, f"{run.distance_m:.3f}", f"{run.time_s:.2f}", moved, note))
        return run

    def lines(self) -> list[str]:
        """Return the table as text."""
        head = ("fault at 1 m/s", "distance m", "time s", "moved again", "")
        rows = [head, *self.rows]
        widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
        return [" | ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)) for r in rows]


def stands_still(run: Run) -> None:
    """Fail when a robot went too far, or moved after it had come to rest.

    While the processor is withheld, it may continue at its speed.
    """
    assert run.distance_m <= LIMIT_M + SPEED_MPS * run.withheld_s
    assert run.after_m <= MOVED_M
