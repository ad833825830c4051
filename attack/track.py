"""Driven distance of a robot, from ground truth without the emulated link."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections.abc import Callable
from typing import Any

import numpy as np

from tsd_twin.bus import Bus
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.status import RobotStatus, decode_stamp, decode_status
from tsd_twin.messages.topics import Sample

AT_REST_MPS = 1e-3
PATIENCE_S = 20.0


class Odometer:
    """Integrates the distance driven on the floor, or the motion of the top of a sphere."""

    def __init__(self, drive: Kinematics[Any]) -> None:
        self.twist_scale_m = drive.twist_scale_m
        self._pose: SE2 | SO3 | None = None
        self._way_m = 0.0

    def update(self, pose: SE2 | SO3, twist: Array) -> tuple[float, float]:
        """Update with the true pose and twist (3,); return distance (m) and speed (m/s).

        Rotation counts as speed, so a robot that only turns is not at rest.
        """
        if self._pose is not None:
            self._way_m += self.twist_scale_m * float(np.hypot(*_between(self._pose, pose)))
        self._pose = pose
        return self._way_m, self.twist_scale_m * float(np.abs(twist).max())


def _between(before: SE2 | SO3, after: SE2 | SO3) -> Array:
    """Return (2,): metres along the floor, or radians about X and Y of a sphere's base."""
    if isinstance(before, SE2) and isinstance(after, SE2):
        return (after.xy_heading - before.xy_heading)[:2]
    if isinstance(before, SO3) and isinstance(after, SO3):
        return (after @ before.inverse()).log()[:2]
    raise TypeError("the two poses of a robot are of different kinds")


def _is_about(speed_mps: float, wanted_mps: float) -> bool:
    """Return whether a speed is reached, within the loss of a single servo step."""
    return speed_mps >= 0.97 * wanted_mps - 0.01


class DistanceLog:
    """Log of distance and speed over time, on the robot's clock, which is this machine's clock."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._times_s: list[float] = []
        self._ways_m: list[float] = []
        self._speeds_mps: list[float] = []

    def add(self, at_s: float, way_m: float, speed_mps: float) -> None:
        """Add a sample."""
        with self._news:
            self._times_s.append(at_s)
            self._ways_m.append(way_m)
            self._speeds_mps.append(speed_mps)
            self._news.notify_all()

    def until(
        self, condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S
    ) -> None:
        """Wait until new samples satisfy a condition.

        Raises:
            TimeoutError: If it is never satisfied.
        """
        with self._news:
            if not self._news.wait_for(condition, patience_s):
                raise TimeoutError(f"never {what}, {self._speeds_mps[-1:]} m/s")

    def until_fast(self, speed_mps: float) -> None:
        """Wait until the robot has had a speed for several samples."""
        self.until(
            lambda: _is_about(min(self._speeds_mps[-6:], default=0.0), speed_mps),
            f"{speed_mps:.2f} m/s",
            0.5 * PATIENCE_S,
        )

    def until_rest_after(self, time_s: float) -> None:
        """Wait until samples reach a time and the robot is at rest."""
        self.until(
            lambda: self._times_s[-1] >= time_s and max(self._speeds_mps[-3:]) < AT_REST_MPS,
            "at rest",
        )

    def was_fast_at(self, time_s: float, speed_mps: float) -> bool:
        """Return whether the robot had a speed just before a time."""
        with self._news:
            i = max(1, bisect_left(self._times_s, time_s))
            return _is_about(self._speeds_mps[i - 1], speed_mps)

    def distance_since(self, time_s: float) -> float:
        """Return the distance since a time, m, with linear interpolation between samples."""
        with self._news:
            times_s, ways_m = self._times_s, self._ways_m
            i = max(1, bisect_left(times_s, time_s))
            return ways_m[-1] - float(
                np.interp(time_s, times_s[i - 1 : i + 1], ways_m[i - 1 : i + 1])
            )


class TruthRecorder:
    """Records truth and status of a simulated robot in a `DistanceLog`, bypassing the link."""

    def __init__(self, bus: Bus, robot_id: str, drive: Kinematics[Any]) -> None:
        self.track = DistanceLog()
        self.status = RobotStatus("disarmed")
        self._odometer = Odometer(drive)
        self._turning = drive.pose_type is SO3
        bus.subscribe(topics.TRUTH.key(robot_id), self._on_truth)
        bus.subscribe(topics.STATUS.key(robot_id), self._on_status)

    def _on_truth(self, sample: Sample) -> None:
        odometry = decode_odometry(sample.payload, turning=self._turning)
        pose = SE2(odometry.xy_heading) if odometry.wxyz is None else SO3(odometry.wxyz)
        way_m, speed_mps = self._odometer.update(pose, odometry.twist)
        self.track.add(decode_stamp(sample.attachment)[1] * 1e-9, way_m, speed_mps)

    def _on_status(self, sample: Sample) -> None:
        self.status = decode_status(sample.payload)
