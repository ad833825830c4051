"""Progress by hundredths: what a bar wants."""

from __future__ import annotations

from collections.abc import Iterator

PARTS = 100


def percents(shares: Iterator[float], whole: float) -> Iterator[int]:
    """Go through `shares`, and yield once for each hundredth of `whole` that has passed."""
    done = 0
    for share in shares:
        while done < min(PARTS, int(PARTS * share / whole)):
            done += 1
            yield done
