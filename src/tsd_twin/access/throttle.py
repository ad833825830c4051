"""How often somebody may guess: a few times at once, then after a wait that doubles."""

from __future__ import annotations

from dataclasses import dataclass

KEYS = 1024
"""Remembered at once; the one with the shortest wait, then the fewest tries, gives way."""
CALM_S = 3600.0
"""Whoever has not tried for so long begins anew."""


@dataclass(slots=True)
class _Record:
    tries: int
    last_s: float
    until_s: float


class Throttle:
    """Counts tries by key; each counts as wrong until it turns out right.

    So that who tries many passwords at once is not quicker than who waits for each answer.
    """

    def __init__(self, free: int, first_s: float, longest_s: float) -> None:
        """After `free` tries comes a wait of `first_s`, doubled with each up to `longest_s`."""
        self._free = free
        self._first_s = first_s
        self._longest_s = longest_s
        self._records: dict[str, _Record] = {}

    def wait_s(self, key: str, now_s: float) -> float:
        """Return how long a key has to wait before its next try; 0 when it need not."""
        record = self._records.get(key)
        return 0.0 if record is None else max(0.0, record.until_s - now_s)

    def note(self, key: str, now_s: float) -> None:
        """Count a try."""
        record = self._records.get(key)
        if record is None or now_s - record.last_s > CALM_S:
            self._make_room(key, now_s)
            record = self._records[key] = _Record(0, now_s, now_s)
        record.tries += 1
        record.last_s = now_s
        over = record.tries - self._free
        if over >= 0:
            # Beyond some power there is nothing left to double.
            wait_s = min(self._longest_s, self._first_s * 2.0 ** min(over, 32))
            record.until_s = now_s + wait_s

    def forgive(self, key: str) -> None:
        """Forget one try, which was right after all, and the wait that it began."""
        record = self._records.get(key)
        if record is not None:
            record.tries -= 1
            record.until_s = record.last_s
            if record.tries <= 0:
                del self._records[key]

    def forget(self, key: str) -> None:
        """Forget all tries of a key."""
        self._records.pop(key, None)

    def _make_room(self, key: str, now_s: float) -> None:
        if key not in self._records and len(self._records) >= KEYS:
            # Else many made-up keys would free one that has nearly used up its tries.
            del self._records[
                min(
                    self._records,
                    key=lambda k: (max(now_s, self._records[k].until_s), self._records[k].tries),
                )
            ]


class Allowance:
    """Bounds tries of all keys together: some at once, then one every so often."""

    def __init__(self, at_once: int, every_s: float) -> None:
        """`at_once` tries are free, and `every_s` gives back one of them."""
        self._at_once = at_once
        self._every_s = every_s
        self._left = float(at_once)
        self._now_s = 0.0

    def wait_s(self, now_s: float) -> float:
        """Return how long until the next try; 0 when there need not be a wait."""
        self._refill(now_s)
        return max(0.0, 1.0 - self._left) * self._every_s

    def note(self, now_s: float) -> None:
        """Count a try."""
        self._refill(now_s)
        self._left -= 1.0

    def forgive(self) -> None:
        """Forget one try, which was right after all."""
        self._left = min(self._at_once, self._left + 1.0)

    def _refill(self, now_s: float) -> None:
        gained = max(0.0, now_s - self._now_s) / self._every_s
        self._left = min(self._at_once, self._left + gained)
        self._now_s = max(now_s, self._now_s)
