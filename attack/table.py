"""Rows of the attack report, and the summary of all repetitions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Result of an attack."""

    attack: str
    """Case in one line, identical for all repetitions."""
    promise: str
    """Guarantee to test, with its unit."""
    measured: str
    """Measurement, with its unit."""
    held: bool
    """Whether the guarantee held."""
    robot: str = ""
    """Attacked robot, or "" if irrelevant."""
    size: float = 0.0
    """Measurement as a number; larger is worse."""

    def __str__(self) -> str:
        """Format the row for a terminal."""
        verdict = "held  " if self.held else "BROKEN"
        attack = f"{self.robot}: {self.attack}" if self.robot else self.attack
        return f"{verdict} {attack:<64} {self.measured:<28} {self.promise}"


def summary(results: Iterable[tuple[str, Row]]) -> Iterator[str]:
    """Yield one line per part, robot and case, with the worst repetition.

    Repetitions that did not hold are worse than those that did.
    """
    cases: dict[tuple[str, str, str], list[Row]] = {}
    for part, row in results:
        cases.setdefault((part, row.robot, row.attack), []).append(row)
    lines = [("part", "robot", "case", "worst measured", "promised", "held")]
    for (part, robot, attack), rows in cases.items():
        worst = max(rows, key=lambda row: (not row.held, row.size))
        held = f"{sum(row.held for row in rows)} of {len(rows)}"
        lines.append((part, robot, attack, worst.measured, worst.promise, held))
    yield from _aligned(lines)


def _aligned(lines: Sequence[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True))
