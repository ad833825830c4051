"""One robot in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from tsd_twin.dashboard.fleet_meshes import FleetMeshes
from tsd_twin.dashboard.foresight import NOTHING, Foresight, Outlook
from tsd_twin.dashboard.geared import geared
from tsd_twin.dashboard.link import Sent, Snapshot
from tsd_twin.dashboard.poses import JointReader, as_commanded
from tsd_twin.dashboard.rate import Rate
from tsd_twin.dashboard.robot_marks import RobotMarks
from tsd_twin.dashboard.trips import RoundTrips
from tsd_twin.drives import Drive, JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import Robot

SLOWER = 50
"""Wheels that spin on gimbals are drawn turning this much slower than they do: 2,500 a minute as 50
a minute, 5 degrees a frame. At their true speed a picture at 60 Hz would show them creeping,
standing or going back. Wheels that roll are drawn as fast as they are."""
FORESEEN_HZ = 10.0
"""The model is run forward this often: it takes a millisecond or two."""
_LONGEST_S = 0.1
"""A gap in the state longer than this is no time that a wheel was seen turning."""


class Source(Protocol):
    """Where a robot's description and its newest state come from; a link, for one."""

    @property
    def id(self) -> str:
        """Id of the robot."""
        ...

    @property
    def robot(self) -> Robot:
        """Its description."""
        ...

    @property
    def drive(self) -> Drive[Any]:
        """Its kinematics."""
        ...

    @property
    def snapshot(self) -> Snapshot:
        """The newest of everything it has said; the same object as long as there is nothing new."""
        ...

    @property
    def sent(self) -> Sequence[Sent]:
        """The newest commands to it from here."""
        ...

    @property
    def trips(self) -> RoundTrips:
        """How long it takes to answer."""
        ...


class Body:
    """What is known of a robot, and what is drawn of it."""

    def __init__(self, link: Source, meshes: FleetMeshes, marks: RobotMarks) -> None:
        self.id = link.id
        self.link = link
        self.meshes = meshes
        self.marks = marks
        self.shown = Snapshot()
        self.joints = link.drive.inverse(np.zeros(3))
        """The joint vector (n,)."""
        self.angles = np.zeros(len(link.drive.joints))
        """The joints (n,) as they are drawn: angles, of wheels those that they have turned by."""
        self.pose = np.zeros(3)
        """Where the base is (3,): the origin, if it does not move."""
        self.ball = SO3.identity()
        """How the ball in it is turned, if there is one."""
        self._turned_s = -np.inf
        # What stays where it is goes nowhere.
        self._foresight = Foresight(link.drive, link.robot) if link.drive.space is SE2 else None
        self._foresees = Rate(FORESEEN_HZ)
        self._reader = JointReader(link.drive)
        self._wheels = np.array([joint.kind is JointKind.VELOCITY for joint in link.drive.joints])
        self._slower = SLOWER if meshes.shape.tilts else 1

    @property
    def behind(self) -> bool:
        """The link has heard something that is not drawn yet."""
        return self.link.snapshot is not self.shown

    @property
    def drive(self) -> Drive[Any]:
        """The kinematics that the robot is driven by, in the gear that it says it has."""
        return geared(self.link.robot, self.link.drive, self.link.snapshot)

    def update(self) -> None:
        """Take in the newest snapshot."""
        new, old = self.link.snapshot, self.shown
        self.shown = new
        if new.odom is not None:
            if new.odom.wxyz is None:
                self.pose = new.odom.xy_heading
            else:
                self.ball = SO3(new.odom.wxyz)
        if new.joints is not None and new.joints is not old.joints:
            joints = self._reader.vector(new.joints)
            if joints is not None:
                self._turn_wheels(joints, new.received_s)
        self.meshes.place(self.id, self.pose, self.ball, self.angles)
        self.marks.update(new, old, self.joints)
        if self._foresight is not None and self._foresees.due(new.received_s):
            self.marks.foresee(self._outlook(self._foresight, new))

    def _outlook(self, foresight: Foresight, new: Snapshot) -> Outlook:
        setpoint = self._reader.vector(new.setpoint) if new.setpoint else None
        if setpoint is None:
            return NOTHING
        setpoint = as_commanded(self.link.drive, setpoint, self.joints)
        return foresight.look(new, setpoint, self.link.sent, self.link.trips)

    def _turn_wheels(self, joints: Array, now_s: float) -> None:
        dt_s, self._turned_s = now_s - self._turned_s, now_s
        self.joints = joints
        seen_s = dt_s / self._slower if dt_s < _LONGEST_S else 0.0
        turned = np.remainder(self.angles + joints * seen_s, 2.0 * np.pi)
        self.angles = np.where(self._wheels, turned, joints)
