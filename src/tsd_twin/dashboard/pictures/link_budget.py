"""Size, quality and rate of the pictures for a page: at most 80 % of what its link gives.

No I/O: times and sizes in, a format and an interval out.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

SHARE = 0.8
"""Fraction of the link that pictures use: on a full link each waits for the one before."""
LEAST_HZ = 15.0
"""Rate for which the format is chosen; the size is reduced first, then the rate."""
_FRAMES = 25
"""Frames in the estimate of the link."""


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """Size in eighths of the camera's, and JPEG quality; without one, as the camera sent it."""

    eighths: int
    quality: int | None
    bytes_share: float
    """Typical size in bytes as a fraction of that of the camera's own JPEG, of quality 80."""


FORMATS = (
    PictureFormat(8, None, 1.0),
    PictureFormat(6, 75, 0.55),
    PictureFormat(4, 75, 0.28),
    PictureFormat(4, 55, 0.2),
    PictureFormat(3, 55, 0.13),
    PictureFormat(3, 35, 0.09),
    PictureFormat(2, 35, 0.05),
)
"""From the best to the smallest."""


class _Frame(NamedTuple):
    size_bytes: int
    took_s: float


class LinkBudget:
    """Choice for one page, from the intervals between sending and the next request."""

    def __init__(self) -> None:
        self._frames: deque[_Frame] = deque(maxlen=_FRAMES)
        self._before = FORMATS[-2]
        self._next_s = 0.0

    def add(self, size_bytes: int, took_s: float, round_trip_s: float) -> None:
        """Add a picture: its size, the time from sending it to the next request, and the round trip
        of an empty message, which is subtracted.
        """
        self._frames.append(_Frame(size_bytes, max(0.0, took_s - max(0.0, round_trip_s))))

    @property
    def s_per_byte(self) -> float | None:
        """Time that the link takes for a byte, or None before the first pictures."""
        if not self._frames:
            return None
        return median(each.took_s / each.size_bytes for each in self._frames)

    def format_for(self, own_bytes: int, own_width: int, width: int) -> PictureFormat:
        """Return the best format that a pane of `width` pixels can show and the link carries.

        `own_bytes` and `own_width` describe the camera's picture. A better format than the one
        before is chosen only with a tenth of the link in reserve.
        """
        s_per_byte = self.s_per_byte
        if s_per_byte is None:
            return self._before
        needed = [each for each in FORMATS if 8 * width <= each.eighths * own_width]
        top = FORMATS.index(_smallest_size(needed)) if needed else 0
        for each in FORMATS[top:]:
            limit = SHARE if each.bytes_share <= self._before.bytes_share else SHARE - 0.1
            if each.bytes_share * own_bytes * s_per_byte * LEAST_HZ <= limit:
                self._before = each
                return each
        self._before = FORMATS[-1]
        return self._before

    def waits_s(self, now_s: float) -> float:
        """Return the time until the next picture may be sent."""
        return max(0.0, self._next_s - now_s)

    def sent(self, size_bytes: int, now_s: float) -> None:
        """Count a picture that is sent now."""
        self._next_s = max(self._next_s, now_s) + size_bytes * (self.s_per_byte or 0.0) / SHARE


def _smallest_size(formats: list[PictureFormat]) -> PictureFormat:
    """Return the first of the formats with the fewest pixels, which has the best quality."""
    return min(formats, key=lambda each: each.eighths)
