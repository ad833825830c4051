"""What a robot says of its joints, and others of where it is, as a recording on one clock."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsd_twin.errors import MessageError, TwinError
from tsd_twin.lab.recording import Recording
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.command import Sample
from tsd_twin.messages.pose import decode_outside_pose
from tsd_twin.messages.ros import decode_joints
from tsd_twin.messages.status import decode_stamp
from tsd_twin.robots import SingularityRobot

_OLD_S, _AHEAD_S = 2.0, 0.2
"""A pose whose stamp is older, or more ahead of the newest joints, was stamped by another clock."""
_CLOCK_SET_S = 0.05
"""The wall clock of the robot may not jump by more against the other one, that never does."""
_NEWEST = 25


class Recorder:
    """Takes samples of `state/joints`, `state/setpoint` and `in/pose` as they come.

    Stamps of poses are of the robot's wall clock, which anybody may set. All times here are of its
    other one, that all of `state/*` has as well: from both stamps on the joints, one is had from
    the other.
    """

    def __init__(self, robot: SingularityRobot) -> None:
        self._modules = robot.drive.modules
        joints = robot.kinematics().joints
        self._names = [joint.name for joint in joints]
        self._measures_spin = robot.measures_spin
        self._nominal_v = robot.battery.nominal_v
        self._joints: list[tuple[float, Array]] = []
        self._told: list[tuple[float, Array]] = []
        self._poses: list[tuple[float, Array]] = []
        self._ahead_s: list[float] = []
        self.refused = ""
        """Why the last pose that could not be used could not."""

    def joints(self, sample: Sample) -> None:
        """Take measured joints; what cannot be read or is not measured is left out."""
        found = self._row(sample)
        if found is None:
            return
        now_s, stamp_ns, row = found
        angles = row.reshape(-1, 3)[:, :2]
        if np.isfinite(angles).all() and (not self._joints or now_s > self._joints[-1][0]):
            self._joints.append((now_s, row))
            self._ahead_s.append(stamp_ns * 1e-9 - now_s)

    def setpoint(self, sample: Sample) -> None:
        """Take commanded joints."""
        found = self._row(sample)
        if found is not None and np.isfinite(found[2][2::3]).all():
            self._told.append((found[0], found[2][2::3]))

    def pose(self, sample: Sample) -> tuple[SE2, float] | None:
        """Take an outside pose; return it and when it was so, None if it is of no use."""
        try:
            pose, stamp_ns = decode_outside_pose(sample)
        except MessageError as error:
            self.refused = str(error)
            return None
        if not self._joints:
            return None  # Nothing yet to tell its time by.
        seen_s = stamp_ns * 1e-9 - self._ahead_now_s()
        off_s = seen_s - self._joints[-1][0]
        if not -_OLD_S <= off_s <= _AHEAD_S:
            self.refused = f"its stamp is {off_s:.1f} s off the clock of the robot"
            return None
        self._poses.append((seen_s, pose.xy_heading))
        return pose, seen_s

    def recording(self, first_s: float, last_s: float, battery_v: float | None) -> Recording:
        """Return what was between two times; `battery_v` is what the battery had, if known.

        Raises:
            TwinError: there is too little, or the robot's wall clock was set meanwhile.
        """
        joints = [(t_s, row) for t_s, row in self._joints if first_s <= t_s <= last_s]
        poses = sorted(
            [(t_s, pose) for t_s, pose in self._poses if first_s <= t_s <= last_s],
            key=lambda each: each[0],
        )
        ahead = np.array(self._ahead_s)
        if len(joints) < 2 or len(poses) < 2 or not self._told:
            raise TwinError("too little was heard of the drive to record it")
        if abs(np.median(ahead[:_NEWEST]) - np.median(ahead[-_NEWEST:])) > _CLOCK_SET_S:
            raise TwinError("the clock of the robot was set during the drive: drive again")
        t_s, rows = _columns(joints)
        share = 1.0 if battery_v is None else battery_v / self._nominal_v
        told_s, told = _columns(self._told)
        last = np.clip(np.searchsorted(told_s, t_s, side="right") - 1, 0, None)
        spin = rows[:, 2::3] if self._measures_spin else np.full((len(t_s), self._modules), np.nan)
        angles = rows.reshape(len(rows), -1, 3)[:, :, :2].reshape(len(rows), -1)
        seen_s, seen = _columns(poses)
        seen[:, 2] = np.unwrap(seen[:, 2])
        return Recording(t_s - t_s[0], angles, share * told[last], spin, seen_s - t_s[0], seen)

    def _ahead_now_s(self) -> float:
        """Return by how much the wall clock is ahead: of the newest joints, one late by chance."""
        return float(np.median(self._ahead_s[-_NEWEST:]))

    def _row(self, sample: Sample) -> tuple[float, int, Array] | None:
        """Return the robot's time, its wall clock, and angles and speeds (n,) of all joints."""
        try:
            _, robot_ns = decode_stamp(sample.attachment)
            state = decode_joints(sample.payload)
            at = [list(state.names).index(name) for name in self._names]
        except (MessageError, ValueError):
            return None
        row = np.array(state.position_rad)[at]
        row[2::3] = np.array(state.velocity_rad_per_s)[at][2::3]
        return robot_ns * 1e-9, state.stamp_ns, row


def _columns(rows: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
    return np.array([t_s for t_s, _ in rows]), np.array([row for _, row in rows])
