"""Clock of a camera's computer, compared with the monotonic clock of this machine."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

READINGS = 8
"""Latest readings of a camera's clock, of which that with the least round trip counts."""
DRIFT_S = 0.002
"""Difference by which clocks drift apart within the latest readings: 0.2 ms per second."""
_STAMPS = 100
"""Pictures in the comparison without readings."""


@dataclass(frozen=True, slots=True)
class _Reading:
    offset_s: float
    """The camera's clock minus the monotonic clock, for equal ways there and back."""
    error_s: float
    """Largest error of it: half of the round trip."""


class CameraClock:
    """Converts time stamps of a camera to the monotonic clock of this machine.

    A reading of the camera's clock was taken between question and answer. Its error is therefore at
    most half of the round trip, for any offset and any delays, as in NTP (RFC 5905).

    Without readings, from programs that publish pictures only, stamps are believed unless they are
    in the future: then the camera's clock is ahead, and the least delay of recent pictures counts
    as none. Pictures of a clock that is behind look too old, so that nobody drives by them, as by
    those that a network holds back.
    """

    def __init__(self) -> None:
        self._readings: deque[_Reading] = deque(maxlen=READINGS)
        self._delays_s: deque[float] = deque(maxlen=_STAMPS)

    def read(self, asked_s: float, clock_s: float, answered_s: float) -> None:
        """Add a reading of the camera's clock between two times of the monotonic clock."""
        offset_s, error_s = clock_s - 0.5 * (asked_s + answered_s), 0.5 * (answered_s - asked_s)
        # Earlier readings that contradict this one are from before the clock was set.
        agreeing = [
            each
            for each in self._readings
            if abs(each.offset_s - offset_s) <= each.error_s + error_s + DRIFT_S
        ]
        self._readings = deque([*agreeing, _Reading(offset_s, error_s)], maxlen=READINGS)

    def exposed_s(self, stamp_s: float, wall_s: float, now_s: float) -> float:
        """Return the time of an exposure for a picture that arrives now, at the latest now."""
        if self._readings:
            best = min(self._readings, key=lambda each: each.error_s)
            return min(now_s, stamp_s - best.offset_s)
        delay_s = wall_s - stamp_s
        self._delays_s.append(delay_s)
        return now_s - delay_s + min(0.0, *self._delays_s)
