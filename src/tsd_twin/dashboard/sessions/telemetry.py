"""Telemetry for pages: robot info and state."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsd_twin.client.monitor import Snapshot
from tsd_twin.client.motions import PlanLimits
from tsd_twin.dashboard.scene.robot_geometry import JointReader, commanded_joints, twist_axes_of
from tsd_twin.dashboard.scene.robot_visual import VisualSource
from tsd_twin.dashboard.sessions.actuator_telemetry import (
    ActuatorTelemetry,
    binding_limit,
    joint_share,
    rounded,
)
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.dashboard.sessions.plot_fields import PlotFields
from tsd_twin.dashboard.wire.from_page import Triple
from tsd_twin.dashboard.wire.to_page import (
    LimitName,
    RobotInfo,
    RobotState,
)
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import JointState, Odometry
from tsd_twin.messages.status import RobotStatus
from tsd_twin.motion import TwistLimiter


class RobotTelemetry:
    """Telemetry of a robot: `RobotInfo` and `RobotState` of its client."""

    def __init__(self, link: VisualSource) -> None:
        self._link = link
        self._kinematics = link.kinematics
        self._reader = JointReader(link.kinematics.joints)
        self._actuators: ActuatorTelemetry = view_of(link.robot).telemetry(link.robot)
        has_alternative = self._actuators.info().get("alternative_estimate") is not None
        self._last_motion: tuple[Any, dict[str, Any]] | None = None
        self.plot_fields = PlotFields(link, has_alternative=has_alternative)
        """Values for plots, on request."""

    def info(self) -> RobotInfo:
        """Return the constant data."""
        robot = self._link.robot
        return RobotInfo(
            id=self._link.id,
            title=robot.title,
            max_speed_mps=robot.limits.speed_mps,
            space="floor" if self._kinematics.pose_type is SE2 else "sphere",
            twist_axes=twist_axes_of(self._kinematics),
            twist_scale_m=self._kinematics.twist_scale_m,
            sideways=robot.drives_sideways,
            plot_fields=self.plot_fields.names,
            **self._actuators.info(),
        )

    def state(self, snapshot: Snapshot, now_s: float, mode_age_s: float = 0.0) -> RobotState | None:
        """Return the state in a snapshot, or None without a status; null for missing messages."""
        if (status := snapshot.status) is None:
            return None
        trips = self._link.round_trips
        return RobotState(
            status_seq=snapshot.status_seq,
            robot_s=round(snapshot.status_robot_s, 6),
            age_ms=round(1000.0 * (now_s - snapshot.received_s), 1),
            source=snapshot.source,
            status=status,
            mode_age_s=round(mode_age_s, 1),
            has_control=False,
            rtt_ms=_milliseconds(trips.median_s()),
            rtt_jitter_ms=_milliseconds(trips.jitter_s()),
            **self._motion(snapshot, status),
        )

    def _motion(self, snapshot: Snapshot, status: RobotStatus) -> dict[str, Any]:
        """Return poses and actuators, computed again only after a change: most robots rest."""
        key = status.limits, status.wheel_speed, snapshot.motion_key()
        if self._last_motion is None or key != self._last_motion[0]:
            self._last_motion = key, self._computed_motion(snapshot, status)
        return self._last_motion[1]

    def _computed_motion(self, snapshot: Snapshot, status: RobotStatus) -> dict[str, Any]:
        joints = self._joint_vector(snapshot.joints)
        setpoint = self._joint_vector(snapshot.setpoint)
        commanded = self._commanded(setpoint, joints)
        odom = snapshot.odom
        motion: dict[str, Any] = {
            "pose": self._planar_pose(odom),
            "twist": rounded(odom.twist) if odom else None,
            "commanded": None if commanded is None else rounded(commanded),
            "truth": self._planar_pose(snapshot.truth),
            "utilization": None if joints is None else self._utilization(joints),
            "limit": None if commanded is None else self._limit(commanded, status),
        }
        if joints is not None and setpoint is not None:
            motion |= self._actuators.state(joints, setpoint, snapshot)
        return motion

    def _commanded(self, setpoint: Array | None, joints: Array | None) -> Array | None:
        if setpoint is None:
            return None
        if joints is not None:
            setpoint = commanded_joints(self._kinematics, setpoint, joints)
        return self._kinematics.forward(setpoint).twist

    def _utilization(self, joints: Array) -> float | None:
        share = joint_share(self._kinematics, joints)
        return None if share is None else round(share, 4)

    def _limit(self, commanded: Array, status: RobotStatus) -> LimitName | None:
        """Return the limit that scales the request down; it is the first in this direction."""
        if status.limits.applied >= 1.0 or not commanded.any():
            return None
        active = PlanLimits.in_force(self._link.robot, self._kinematics, status)
        limiter = TwistLimiter(active.kinematics, active.limits)
        return binding_limit(active.kinematics, limiter, commanded)

    def _planar_pose(self, said: Odometry | None) -> Triple | None:
        """Return the planar pose of a robot, or None for a sphere."""
        return None if said is None or said.wxyz is not None else rounded(said.xy_heading)

    def _joint_vector(self, state: JointState | None) -> Array | None:
        joints = None if state is None else self._reader.read(state)
        return joints if joints is not None and np.isfinite(joints).all() else None


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000.0 * seconds, 2)
