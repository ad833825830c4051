"""Size, quality and rate of the pictures for a page: at most 80 % of what its link gives.

No I/O: times and sizes in, a format and an interval out.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

SHARE = 0.8
"""Fraction of the link that pictures use: on a full link each waits for the one before."""
FORMAT_SHARE = 0.75
"""Fraction for which the format is chosen."""
GOOD_HZ = 20.0
"""Rate for which the format is chosen; the size is reduced first, then the rate.

At 15 Hz two lost pictures in a row make the one before older than 0.3 s, at 20 Hz three.
"""
LEAST_HZ = 15.0
"""Rate at which the last but one format, which still shows objects, is given up for the last."""
_RESERVE = 0.1
"""Further fraction of the link that must be free for a better format than the one before."""
_LEAST_FRAMES, _MOST_FRAMES = 5, 60
_FRAMES_S = 3.0
"""The estimate of the link is from these frames, or fewer if the rest is older than this."""
_ROUND_TRIP_S = 60.0
"""Time for which a round trip is remembered; a slower route shows up after it."""


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """Size in eighths of the camera's, and JPEG quality; without one, as the camera sent it.

    H.264 has no such quality, but a largest size in bytes.
    """

    eighths: int
    quality: int | None
    bytes_share: float
    """Typical size in bytes as a fraction of that of the camera's own JPEG, of quality 80."""
    is_video: bool = False


FORMATS = (
    PictureFormat(8, None, 1.0),
    PictureFormat(6, 75, 0.55),
    PictureFormat(4, 75, 0.29),
    PictureFormat(4, 55, 0.22),
    PictureFormat(3, 55, 0.15),
    PictureFormat(3, 35, 0.12),
    PictureFormat(2, 35, 0.08),
)
"""From the best to the smallest."""
VIDEO_FORMATS = (
    PictureFormat(8, None, 0.2, is_video=True),
    PictureFormat(6, None, 0.075, is_video=True),
    PictureFormat(4, None, 0.045, is_video=True),
    PictureFormat(3, None, 0.03, is_video=True),
    PictureFormat(2, None, 0.02, is_video=True),
)
"""H.264 from the best to the smallest: for links that do not carry the JPEG that a pane can show.

JPEG is sharper, costs the dashboard less, and is the same for many pages.
"""
_LAST_BUT_ONE = FORMATS[-2], VIDEO_FORMATS[-2]


class _Frame(NamedTuple):
    size_bytes: int
    took_s: float
    acknowledged_s: float


class LinkBudget:
    """Choice for one page, from the intervals between sending and the next request."""

    def __init__(self) -> None:
        self._frames: deque[_Frame] = deque(maxlen=_MOST_FRAMES)
        self._round_trips: deque[tuple[float, float]] = deque()
        """Times and round trips of the last minute that are below all later ones."""
        self._shares = {each: each.bytes_share for each in FORMATS + VIDEO_FORMATS}
        """Size of the latest picture in each format, as a fraction of the camera's."""
        self._before = FORMATS[-2]
        self._next_s = 0.0

    def add(self, size_bytes: int, took_s: float, round_trip_s: float, now_s: float) -> None:
        """Add a picture: its size, the interval between sending it and the next request, and the
        round trip of an empty message at present.

        The least round trip of a minute is subtracted: the present one includes the queue, so that
        a full link would look fast.
        """
        if round_trip_s > 0.0:
            while self._round_trips and self._round_trips[-1][1] >= round_trip_s:
                self._round_trips.pop()
            self._round_trips.append((now_s, round_trip_s))
        while self._round_trips and now_s - self._round_trips[0][0] > _ROUND_TRIP_S:
            self._round_trips.popleft()
        least_s = self._round_trips[0][1] if self._round_trips else 0.0
        self._frames.append(_Frame(size_bytes, max(0.0, took_s - least_s), now_s))
        while (
            len(self._frames) > _LEAST_FRAMES and now_s - self._frames[0].acknowledged_s > _FRAMES_S
        ):
            self._frames.popleft()

    @property
    def s_per_byte(self) -> float | None:
        """Time that the link takes for a byte, or None before the first pictures.

        The lower eighth: losses, jitter and a busy page only delay pictures.
        """
        if not self._frames:
            return None
        all_s = sorted(each.took_s / each.size_bytes for each in self._frames)
        return all_s[len(all_s) // 8]

    def format_for(
        self, own_bytes: int, own_width: int, width: int, *, video: bool = False
    ) -> PictureFormat:
        """Return the best format that a pane of `width` pixels can show and the link carries.

        `own_bytes` and `own_width` describe the camera's picture; `video` permits H.264.
        """
        s_per_byte = self.s_per_byte
        if s_per_byte is None:
            return self._before
        needed = [each for each in FORMATS if 8 * width <= each.eighths * own_width]
        top = FORMATS.index(min(needed, key=lambda each: each.eighths)) if needed else 0
        formats = FORMATS[top:]
        if video:
            largest = FORMATS[top].eighths
            formats = formats[0], *(each for each in VIDEO_FORMATS if each.eighths <= largest)
        for each in formats:
            is_better = each.bytes_share > self._before.bytes_share
            limit = FORMAT_SHARE - (_RESERVE if is_better else 0.0)
            rate_hz = LEAST_HZ if each in _LAST_BUT_ONE else GOOD_HZ
            if self._shares[each] * own_bytes * s_per_byte * rate_hz <= limit:
                self._before = each
                return each
        self._before = formats[-1]
        return self._before

    def encoded(self, chosen: PictureFormat, own_bytes: int, size_bytes: int) -> None:
        """Note the size of a picture in a format, which depends on what the camera sees."""
        self._shares[chosen] = size_bytes / own_bytes

    def waits_s(self, now_s: float) -> float:
        """Return the time until the next picture may be sent."""
        return max(0.0, self._next_s - now_s)

    def sent(self, size_bytes: int, now_s: float) -> None:
        """Count a picture that is sent now."""
        takes_s = size_bytes * (self.s_per_byte or 0.0) / SHARE
        # A picture that was late by less than its own time does not delay the next.
        self._next_s = max(self._next_s, now_s - takes_s) + takes_s
