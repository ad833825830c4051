"""Rows of the benchmark report."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Row of the table."""

    what: str
    measured: float
    limit: float
    unit: str
    comparison: str
    """Peer or lower bound for the limit, measured in the same run."""
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether the limit is met."""
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit

    def __str__(self) -> str:
        word = ">=" if self.at_least else "<="
        share = self.measured / self.limit if self.limit else math.inf
        return (
            f"{self.what:<52} {self.measured:>9.3g} {self.unit:<6} {word} {self.limit:>8.3g}"
            f"  {share:>6.2f}x  {'ok  ' if self.met else 'MISS'}  {self.comparison}"
        )


def percentile(values: Sequence[float], share: float) -> float:
    """Return a percentile of many values."""
    return statistics.quantiles(values, n=1000, method="inclusive")[round(share * 1000) - 1]
