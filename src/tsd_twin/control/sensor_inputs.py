"""Queue of pose measurements from the bus."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from tsd_twin.estimation import FusedEstimate, FusionResult
from tsd_twin.lie import SE2
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.pose import decode_pose_measurement
from tsd_twin.messages.status import PoseSensorDrops, PoseSensorStatus
from tsd_twin.messages.topics import Sample

AHEAD_S = 0.01
"""Stamps up to this far in the future are treated as clock skew and clamped to now."""
WAITING = 16
"""Queue size for measurements; the oldest are dropped."""
_REMEMBERED = 64
"""Number of recent messages kept to detect duplicates."""
_A_PERIOD = 2
"""Fusing two per 10 ms step keeps up with a 120 Hz sensor and bounds the step time."""


class PoseMeasurements:
    """Queue of measurements on `sensor/pose`: decodes, checks and fuses them, with counts."""

    def __init__(self, estimate: FusedEstimate | None) -> None:
        """Correct `estimate` with the measurements; drop them if it is None (no SE(2) pose)."""
        self._estimate = estimate
        self._waiting: deque[tuple[SE2, float]] = deque()
        self._heard: deque[bytes] = deque(maxlen=_REMEMBERED)
        self._used_s: deque[float] = deque(maxlen=256)
        self._late_s = 0.0
        self._used = 0
        self._found = 0
        self._dropped = PoseSensorDrops()
        self._any = False

    def receive(self, samples: Sequence[Sample], now_s: float, wall_ns: int) -> None:
        """Decode and queue samples; `wall_ns` is the robot's wall-clock time, to which stamps
        refer.

        Invalid samples are counted and dropped.
        """
        for sample in samples:
            self._any = True
            try:
                pose, stamp_ns = decode_pose_measurement(sample)
            except MessageError as error:
                self._drop(error.reason)
                continue
            age_s = (wall_ns - stamp_ns) * 1e-9
            if self._estimate is None:
                self._drop("frame")
            elif age_s < -AHEAD_S:
                self._drop("future")
            elif sample.payload in self._heard:
                self._drop(FusionResult.OLD)  # Duplicates carry no new information.
            else:
                self._heard.append(sample.payload)
                self._waiting.append((pose, now_s - max(age_s, 0.0)))
                if len(self._waiting) > WAITING:
                    self._waiting.popleft()
                    self._drop(FusionResult.QUEUE_FULL)

    def step(self, now_s: float, *, at_rest: bool) -> Event | None:
        """Fuse the queued measurements of this period; return an event or None."""
        if self._estimate is None:
            return None
        event = None
        for _ in range(min(_A_PERIOD, len(self._waiting))):
            pose, seen_s = self._waiting.popleft()
            before = self._estimate.pose
            match self._estimate.fuse(pose, seen_s, at_rest=at_rest):
                case FusionResult.USED:
                    self._used += 1
                    self._used_s.append(now_s)
                    self._late_s = now_s - seen_s
                case FusionResult.RELOCALIZED:
                    self._found += 1
                    event = _found(before, self._estimate.pose, now_s)
                case fate:
                    self._drop(fate)
        return event

    def status(self, now_s: float) -> PoseSensorStatus | None:
        """Return counts for the status, or None before the first measurement."""
        if not self._any:
            return None
        while self._used_s and now_s - self._used_s[0] > 0.999:
            self._used_s.popleft()
        return PoseSensorStatus(
            hz=float(len(self._used_s)),
            latency_s=round(self._late_s, 4) if self._used_s else None,
            used=self._used,
            found=self._found,
            dropped=self._dropped,
        )

    def _drop(self, reason: str) -> None:
        setattr(self._dropped, reason, getattr(self._dropped, reason) + 1)


def _found(before: SE2, after: SE2, now_s: float) -> Event:
    dx, dy, turned = (after.xy_heading - before.xy_heading).tolist()
    off = because(
        Code.POSE_RESET, metres=math.hypot(dx, dy), deg=float(round(math.degrees(turned)))
    )
    return Event.of(
        "pose",
        off,
        "outside poses that agree with one another",
        now_s,
        requested=before.xy_heading.tolist(),
        applied=after.xy_heading.tolist(),
    )
