"""Test doubles for the scene: a robot source with snapshots set by tests, and an empty scene."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tsd_twin import robots
from tsd_twin.client.connection import SentCommand
from tsd_twin.client.monitor import RoundTrips, Snapshot
from tsd_twin.dashboard.scene.robot_geometry import LinkPoses, Skeleton
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import JointState, Odometry
from tsd_twin.messages.status import RobotStatus
from tsd_twin.models import kinematic_tree
from tsd_twin.robots import RobotDescription

PERIOD_S = 0.02


@dataclass
class RobotFeed:
    """Robot source with a description and a snapshot set by the test."""

    id: str = "tsd"
    robot: Any = field(default_factory=lambda: robots.load_robot("tsd"))
    snapshot: Snapshot = field(default_factory=Snapshot)
    sent_commands: list[SentCommand] = field(default_factory=list[SentCommand])
    round_trips: RoundTrips = field(default_factory=RoundTrips)

    def __post_init__(self) -> None:
        self.kinematics: Any = self.robot.kinematics()
        self.now_s = 100.0

    def say(
        self,
        *,
        pose: Array | None = None,
        twist: Array | None = None,
        joints: Array | None = None,
        setpoint: Array | None = None,
        truth: Array | None = None,
        ball: SO3 | None = None,
        true_ball: SO3 | None = None,
        other_ball: SO3 | None = None,
        status: RobotStatus | None = None,
        covariance: Array | None = None,
        after_s: float = PERIOD_S,
    ) -> None:
        """Set messages in the snapshot, some time after the last ones.

        `twist` (3,) is the estimated twist of `pose`, by default zero.
        """
        self.now_s += after_s
        said = self.snapshot
        if joints is not None:
            said = replace(said, joints=self._joint_state(joints))
        if setpoint is not None:
            said = replace(said, setpoint=self._joint_state(setpoint))
        if pose is not None:
            said = replace(said, odom=odometry(pose, covariance, twist))
        if status is not None:
            said = replace(said, status=status)
        if truth is not None:
            said = replace(said, truth=odometry(truth))
        for name, turned in (("odom", ball), ("truth", true_ball), ("alternative", other_ball)):
            if turned is not None:
                said = replace(said, **{name: replace(odometry(np.zeros(3)), wxyz=turned.wxyz)})
        self.snapshot = replace(said, received_s=self.now_s)

    def _joint_state(self, joints: Array) -> JointState:
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in self.kinematics.joints])
        return JointState(
            [joint.name for joint in self.kinematics.joints],
            np.where(is_angle, joints, np.nan),
            np.where(is_angle, np.nan, joints),
        )


def odometry(pose: Array, covariance: Array | None = None, twist: Array | None = None) -> Odometry:
    nothing = np.zeros((3, 3))
    return Odometry(
        np.asarray(pose, float),
        np.zeros(3) if twist is None else twist,
        nothing if covariance is None else covariance,
        nothing,
    )


def link_poses(
    robot: RobotDescription, base: SE2, joints: Array, ball: SO3 | None = None
) -> dict[str, LinkPoses]:
    """Return the link poses of a robot with unturned wheels."""
    drive = robot.kinematics()
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    turned = SO3.identity() if ball is None else ball
    return Skeleton(kinematic_tree(robot), drive.joints).poses(
        base, turned, np.where(is_angle, joints, 0.0)
    )


class EmptyScene:
    """Scene without robots, for servers."""

    def pick_floor(self, *_: object) -> Future[Array]:
        nothing: Future[Array] = Future()
        nothing.set_result(np.empty((0, 2)))
        return nothing

    def show_route(self, *_: object, **__: object) -> None:
        """Draw nothing."""

    draw = envelope = camera_state = show_route

    def reach_m(self, *_: object) -> float:
        return 0.0
