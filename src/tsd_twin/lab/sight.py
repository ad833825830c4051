"""Who sees a robot on the bus from outside: a camera, or the simulator itself."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin import topics
from tsd_twin.bus import Bus
from tsd_twin.errors import MessageError
from tsd_twin.lie import Array
from tsd_twin.messages.pose import decode_outside_pose
from tsd_twin.messages.ros import decode_odometry
from tsd_twin.messages.status import decode_stamp

Seen = tuple[float, Array]
"""A time, and x, y, heading (3,) then."""


class Sight:
    """Keeps where a robot was seen, from `in/pose` or, where nobody sends any, from its truth."""

    def __init__(self, bus: Bus, robot_id: str) -> None:
        self._poses = bus.reader(topics.OUTSIDE_POSE.key(robot_id), 256)
        self._truths = bus.reader(topics.TRUTH.key(robot_id), 256)
        self._by_camera: list[Seen] = []
        self._by_simulator: list[Seen] = []
        self.refused = ""
        """Why the last pose that could not be used could not."""

    def look(self) -> None:
        """Take in what has come since the last call."""
        for sample in self._poses.take():
            try:
                pose, stamp_ns = decode_outside_pose(sample)
                self._by_camera.append((stamp_ns * 1e-9, pose.xy_heading))
            except MessageError as error:
                self.refused = str(error)
        for sample in self._truths.take():
            try:
                at_s = decode_stamp(sample.attachment)[1] * 1e-9
                pose_there = np.array(decode_odometry(sample.payload).xy_heading)
            except MessageError:
                continue
            if np.isfinite(pose_there).all():
                self._by_simulator.append((at_s, pose_there))

    def forget(self) -> None:
        """Begin anew: what was seen until now is of no use."""
        self.look()
        self._by_camera.clear()
        self._by_simulator.clear()

    @property
    def seen(self) -> list[Seen]:
        """What was seen, in the order of time; times are of one clock."""
        return sorted(self._source, key=lambda each: each[0])

    @property
    def moved_m(self) -> float:
        """How far it is from where it was seen first."""
        source = self._source
        return math.dist(source[-1][1][:2], source[0][1][:2]) if source else 0.0

    @property
    def who(self) -> str:
        """Who saw it."""
        return "a camera" if self._source is self._by_camera else "the simulator"

    @property
    def _source(self) -> list[Seen]:
        return self._by_camera if len(self._by_camera) > 1 else self._by_simulator
