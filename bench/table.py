"""Rows of the benchmark report: ratios of a subject to its peer over alternating rounds."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from bench.machine import Withheld
from bench.targets import TARGETS, Target

MAX_WITHHELD = 0.15
"""Fraction of withheld time, in either half, above which a row is not judged."""
MAX_DIFFERENCE = 0.15
"""Difference between two machines above which `--compare` marks a row."""
ROUNDS = 5
OK, MISS, BUSY = "ok", "MISS", "not judged: machine busy"


@dataclass(frozen=True)
class Row:
    """Measured row; subject and peer have one value per round."""

    name: str
    subject: Sequence[float]
    peer: Sequence[float]
    withheld: float = 0.0
    """Larger of the two medians of the withheld time over the rounds, as a fraction."""
    note: str = ""

    @property
    def target(self) -> Target:
        """Target of this row."""
        return TARGETS[self.name]

    @property
    def ratios(self) -> list[float]:
        """Ratio of each round."""
        return [a / b if b else float("inf") for a, b in zip(self.subject, self.peer, strict=True)]

    @property
    def ratio(self) -> float:
        """Median of the ratios."""
        return statistics.median(self.ratios)

    @property
    def verdict(self) -> str:
        """`OK`, `MISS`, or `BUSY` if the machine made the row meaningless."""
        if self.withheld > MAX_WITHHELD and not self.target.physics:
            return BUSY
        limit = self.target.limit
        met = self.ratio >= limit if self.target.at_least else self.ratio <= limit
        return OK if met else MISS

    def __str__(self) -> str:
        target, ratios = self.target, self.ratios
        spread = f"({min(ratios):.3g} to {max(ratios):.3g})" if len(ratios) > 1 else ""
        limit = f"{'>=' if target.at_least else '<='} {target.limit:.3g}"
        limit += "~" if target.provisional else ""
        subject, peer = statistics.median(self.subject), statistics.median(self.peer)
        values = f"{target.subject} {subject:.3g} / {target.peer} {peer:.3g} {target.unit}".rstrip()
        reasons = [values, f"physics: {target.physics}" if target.physics else "", self.note]
        return (
            f"{self.name:<24} {self.ratio:>7.3g} {spread:<19} {limit:<9} {self.verdict:<5} "
            f"{100 * self.withheld:>3.0f} %  {'; '.join(filter(None, reasons))}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return all values, the ratio, the target and the verdict."""
        computed = {"ratio": self.ratio, "verdict": self.verdict}
        return {**asdict(self), **computed, "target": asdict(self.target)}


HEAD = f"{'':<24} {'ratio':>7} {'lowest to highest':<19} {'target':<9} {'':<5} {'held':>5}"


@dataclass
class Run:
    """Selection of rows, and the amount of work."""

    wanted: Collection[str] = ()
    """Names of parts or rows, or patterns; all if empty."""
    smallest: bool = False
    withheld: list[float] = field(default_factory=list[float])
    """Withheld time of all halves, as fractions."""

    def wants(self, *names: str) -> bool:
        """Return whether any of the rows is selected."""
        return not self.wanted or any(
            fnmatch(name, pattern) or name.startswith(f"{pattern}.")
            for name in names
            for pattern in self.wanted
        )

    def pick(self, full: float, smallest: float) -> float:
        """Return the amount of work, for example a duration in seconds."""
        return smallest if self.smallest else full

    def alternate(
        self,
        names: Sequence[str],
        subject: Callable[[], Sequence[float]],
        peer: Callable[[], Sequence[float]],
        *,
        rounds: int = ROUNDS,
        note: Callable[[], str] = str,
    ) -> Iterator[Row]:
        """Measure subject and peer in turn; each call returns one value per name."""
        if not self.wants(*names):
            return
        halves: list[list[Sequence[float]]] = [[], []]
        withheld: list[list[float]] = [[], []]
        for _ in range(1 if self.smallest else rounds):
            for half, measure in enumerate((subject, peer)):
                meter = Withheld()
                try:
                    with meter:
                        halves[half].append(measure())
                finally:
                    withheld[half].append(meter.fraction)
                    self.withheld.append(meter.fraction)
        worst = max(map(statistics.median, withheld))
        for i, name in enumerate(names):
            if self.wants(name):
                ours, theirs = ([values[i] for values in half] for half in halves)
                yield Row(name, ours, theirs, worst, note())


def percentile(values: Sequence[float], fraction: float) -> float:
    """Return a percentile of many values."""
    return statistics.quantiles(values, n=1000, method="inclusive")[round(fraction * 1000) - 1]


def quantiles(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the 90th percentile."""
    return percentile(values, 0.5), percentile(values, 0.9)


def write_json(path: Path, machine: Mapping[str, float], rows: Sequence[Row]) -> None:
    """Write the machine's speed and all rows."""
    content = {"machine": dict(machine), "rows": [row.as_json() for row in rows]}
    path.write_text(json.dumps(content, indent=1) + "\n")


def compare(first: Path, second: Path) -> Iterator[tuple[str, bool]]:
    """Yield a line for each row of both files, and whether the ratios agree."""
    old, new = (json.loads(path.read_text()) for path in (first, second))
    ratios = {row["name"]: row["ratio"] for row in old["rows"]}
    speeds = [f"{key} {old['machine'].get(key, 0):.3g}, {new['machine'].get(key, 0):.3g}"
              for key in new["machine"]]  # fmt: skip
    yield "machine: " + "; ".join(speeds), True
    for row in new["rows"]:
        if (before := ratios.get(row["name"])) is None:
            continue
        difference = row["ratio"] / before - 1.0 if before else 0.0
        agrees = abs(difference) <= MAX_DIFFERENCE
        line = f"{row['name']:<24} {before:>8.3g} {row['ratio']:>8.3g} {100 * difference:>+6.0f} %"
        yield line + ("" if agrees else "  DIFFERS"), agrees
