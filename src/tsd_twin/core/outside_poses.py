"""Poses of the robot that somebody else has seen: read, put in a row, and handed to the estimate.

They tell where the robot is, and nothing else: nothing here is known to authority or limits.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from tsd_twin.errors import MessageError
from tsd_twin.estimation import CorrectedEstimate, Fate
from tsd_twin.lie import SE2
from tsd_twin.messages.command import Sample
from tsd_twin.messages.pose import decode_outside_pose
from tsd_twin.messages.service import Event
from tsd_twin.messages.status import OutsideDrops, OutsideStatus

AHEAD_S = 0.01
"""A stamp this much later than now is the clocks, and taken for now."""
WAITING = 16
"""Poses that wait for their period; when more come, the oldest give way."""
_REMEMBERED = 64
"""Messages that are known again when they come twice."""
_A_PERIOD = 2
"""Enough for 120 frames a second, and no more work than a period has time for."""


class OutsidePoses:
    """What comes in on `in/pose`."""

    def __init__(self, estimate: CorrectedEstimate | None) -> None:
        """`estimate` is what they correct; None: the robot is not on a floor."""
        self._estimate = estimate
        self._waiting: deque[tuple[SE2, float]] = deque()
        self._heard: deque[bytes] = deque(maxlen=_REMEMBERED)
        self._used_s: deque[float] = deque(maxlen=256)
        self._late_s = 0.0
        self._used = 0
        self._found = 0
        self._dropped = OutsideDrops()
        self._any = False

    def receive(self, samples: Sequence[Sample], now_s: float, wall_ns: int) -> None:
        """Read what has come in; `wall_ns` is what the robot's wall clock, that of stamps, shows.

        Whatever is no pose is counted, and changes nothing.
        """
        for sample in samples:
            self._any = True
            try:
                pose, stamp_ns = decode_outside_pose(sample)
            except MessageError as error:
                self._drop(error.reason)
                continue
            age_s = (wall_ns - stamp_ns) * 1e-9
            if self._estimate is None:
                self._drop("frame")
            elif age_s < -AHEAD_S:
                self._drop("future")
            elif sample.payload in self._heard:
                self._drop(Fate.OLD)  # Said twice it is no truer.
            else:
                self._heard.append(sample.payload)
                self._waiting.append((pose, now_s - max(age_s, 0.0)))
                if len(self._waiting) > WAITING:
                    self._waiting.popleft()
                    self._drop(Fate.FLOOD)

    def step(self, now_s: float, *, at_rest: bool) -> Event | None:
        """Let the estimate take in some of those that wait; return what is worth telling."""
        if self._estimate is None:
            return None
        event = None
        for _ in range(min(_A_PERIOD, len(self._waiting))):
            pose, seen_s = self._waiting.popleft()
            before = self._estimate.pose
            match self._estimate.fuse(pose, seen_s, at_rest=at_rest):
                case Fate.USED:
                    self._used += 1
                    self._used_s.append(now_s)
                    self._late_s = now_s - seen_s
                case Fate.FOUND:
                    self._found += 1
                    event = _found(before, self._estimate.pose, now_s)
                case fate:
                    self._drop(fate)
        return event

    def status(self, now_s: float) -> OutsideStatus | None:
        """Return what became of them; None when nobody has ever sent one."""
        if not self._any:
            return None
        while self._used_s and now_s - self._used_s[0] > 0.999:
            self._used_s.popleft()
        return OutsideStatus(
            hz=float(len(self._used_s)),
            late_s=round(self._late_s, 4) if self._used_s else None,
            used=self._used,
            found=self._found,
            dropped=self._dropped,
        )

    def _drop(self, reason: str) -> None:
        setattr(self._dropped, reason, getattr(self._dropped, reason) + 1)


def _found(before: SE2, after: SE2, now_s: float) -> Event:
    dx, dy, turned = (after.xy_heading - before.xy_heading).tolist()
    text = f"Seen {math.hypot(dx, dy):.2f} m and {math.degrees(turned):.0f} degrees from where"
    return Event(
        "pose",
        f"{text} it was taken to be, at rest: that is where it is now.",
        requested=before.xy_heading.tolist(),
        applied=after.xy_heading.tolist(),
        rule="outside poses that agree with one another",
        robot_s=now_s,
    )
