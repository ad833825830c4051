"""How much of a command the limits let through."""

from __future__ import annotations

import math

from tsd_twin.lie import Array
from tsd_twin.messages.service import Event

_REPORT_S = 0.5


class Clamp:
    """Compares what was requested with what is applied, and says so now and then."""

    def __init__(self) -> None:
        self.share = 1.0
        """Of the newest request that is applied."""
        self._reported_s = -math.inf

    def forget(self) -> None:
        """Nothing is requested."""
        self.share = 1.0

    def compare(self, request: Array, capped: Array, now_s: float) -> Event | None:
        """Take in a twist (3,) and what is left of it (3,); return what is worth telling."""
        # By the largest number of each, since they differ by a factor: no square overflows.
        length = _largest(request)
        self.share = _largest(capped) / length if length > 0.0 else 1.0
        if self.share >= 0.999 or now_s - self._reported_s < _REPORT_S:
            return None
        self._reported_s = now_s
        return Event(
            "clamp",
            f"The limits let {100 * self.share:.0f} % of the command through.",
            requested=request.tolist(),
            applied=capped.tolist(),
            rule="limits of speed, turn rate and tilt",
            robot_s=now_s,
        )


def _largest(twist: Array) -> float:
    return max(map(abs, twist.tolist()))
