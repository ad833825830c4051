"""Telemetry for pages: robot info, state, and fields for plots."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from tsd_twin.client.connection import RobotMonitor, RoundTrips, Snapshot
from tsd_twin.dashboard.scene.robot_geometry import commanded_joints, twist_axes_of
from tsd_twin.dashboard.server.messages_from_page import Triple
from tsd_twin.dashboard.server.messages_to_page import (
    RobotInfo,
    RobotState,
    SpeedLimits,
    TwistAxisInfo,
)
from tsd_twin.dashboard.sessions.actuator_telemetry import ActuatorTelemetry, rounded
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.ros import ODOM, JointState, Odometry
from tsd_twin.messages.status import Status

SPEED_LEVELS_PERCENT = (20, 50, 80, 100)
"""Selectable speeds in percent of the limits."""


class RobotTelemetry:
    """Telemetry of a robot: `RobotInfo` and `RobotState` of its client."""

    def __init__(self, link: RobotMonitor) -> None:
        self.link = link
        self._kinematics = link.kinematics
        self._order = [joint.name for joint in link.kinematics.joints]
        self._is_angle = np.array([j.kind is JointKind.POSITION for j in link.kinematics.joints])
        self._actuators: ActuatorTelemetry = view_of(link.robot).telemetry(link.robot)
        has_alternative = self._actuators.info().get("alternative_estimate") is not None
        self.plot_fields = PlotFields(link, has_alternative=has_alternative)
        """Values for plots, on request."""

    def info(self) -> RobotInfo:
        """Return the constant data."""
        robot = self.link.robot
        return RobotInfo(
            id=self.link.id,
            title=robot.title,
            limits=SpeedLimits(robot.limits.speed_mps, robot.limits.turn_rate_rad_per_s),
            levels=SPEED_LEVELS_PERCENT,
            space="floor" if self._kinematics.pose_type is SE2 else "sphere",
            twist_axes=[
                TwistAxisInfo(one.name, one.symbol, one.unit)
                for one in twist_axes_of(self._kinematics)
            ],
            twist_scale_m=self._kinematics.twist_scale_m,
            sideways=robot.drives_sideways,
            plot_fields=self.plot_fields.names,
            **self._actuators.info(),
        )

    def state(
        self,
        snapshot: Snapshot,
        status: Status,
        now_s: float,
        *,
        mode_age_s: float,
        round_trips: RoundTrips,
    ) -> RobotState:
        """Return the latest state; null for messages not yet received."""
        typical_s, jitter_s = round_trips.median_s(), round_trips.jitter_s()
        joints = self._joint_vector(snapshot.joints)
        setpoint = self._joint_vector(snapshot.setpoint)
        odom, truth = snapshot.odom, snapshot.truth
        figures: dict[str, Any] = {}
        if joints is not None and setpoint is not None:
            figures = self._actuators.state(joints, setpoint, snapshot)
        return RobotState(
            seen=snapshot.status_seq,
            robot_s=round(snapshot.status_robot_s, 6),
            age_ms=round(1000.0 * (now_s - snapshot.received_s), 1),
            source=snapshot.source,
            status=status,
            mode_age_s=round(mode_age_s, 1),
            you=False,
            robot_ms=_milliseconds(typical_s),
            robot_jitter_ms=_milliseconds(jitter_s),
            pose=self._planar_pose(odom),
            twist=rounded(odom.twist) if odom else None,
            commanded=self._commanded(setpoint, joints),
            truth=self._planar_pose(truth),
            **figures,
        )

    def _commanded(self, setpoint: Array | None, joints: Array | None) -> Triple | None:
        if setpoint is None:
            return None
        if joints is not None:
            setpoint = commanded_joints(self._kinematics, setpoint, joints)
        return rounded(self._kinematics.forward(setpoint).twist)

    def _planar_pose(self, said: Odometry | None) -> Triple | None:
        """Return the planar pose of a robot, or None for a sphere."""
        return None if said is None or said.wxyz is not None else rounded(said.xy_heading)

    def _joint_vector(self, state: JointState | None) -> Array | None:
        """Return a joint vector (n,), or None if a joint of this robot is missing."""
        if state is None:
            return None
        place = {name: i for i, name in enumerate(state.names)}
        if not all(name in place for name in self._order):
            return None
        rows = [place[name] for name in self._order]
        joints = np.where(self._is_angle, state.position_rad[rows], state.velocity_rad_per_s[rows])
        return joints if np.isfinite(joints).all() else None


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000.0 * seconds, 2)


REQUEST_TIMEOUT_S = 0.25
"""Maximum age of an active drive command."""
_SUFFIXES = {"m/s": "mps", "rad/s": "rad_per_s"}
_POSE = ("x_m", "y_m", "heading_rad")

_Reader: TypeAlias = Callable[[Snapshot], float | None]


class PlotFields:
    """Plot fields of a robot by name, such as `joints.wheel1.velocity_rad_per_s`.

    The last part of a name ends with the unit. `requested` is the twist commanded by this dashboard
    before the robot's limits.
    """

    def __init__(self, link: RobotMonitor, *, has_alternative: bool) -> None:
        """List the fields of a robot, which may have an alternative estimate."""
        self._link = link
        self._readers: dict[str, _Reader] = {}
        robot, kinematics = link.robot, link.kinematics
        axes = [f"{axis.name}_{_SUFFIXES[axis.unit]}" for axis in twist_axes_of(kinematics)]
        for stream, joints in (
            ("setpoint", kinematics.joints),
            ("joints", [*kinematics.joints, *robot.sensors]),
        ):
            for joint in joints:
                is_angle = joint.kind is JointKind.POSITION
                value = "position_rad" if is_angle else "velocity_rad_per_s"
                self._readers[f"{stream}.{joint.name}.{value}"] = partial(
                    _joint_value, stream, joint.name, value
                )
        for i, axis in enumerate(axes):
            self._readers[f"requested.{axis}"] = lambda _, i=i: self._requested(i)
        is_planar = kinematics.pose_type is SE2
        for stream in ("odom", *(["alternative"] if has_alternative else []), "truth"):
            self._add_odometry(stream, "twist", "twist", axes)
            if is_planar:
                self._add_odometry(stream, "pose", "xy_heading", _POSE)
        if is_planar:
            for i, name in enumerate(_POSE):
                self._readers[f"odom.sigma.{name}"] = partial(_sigma, i)

    @property
    def names(self) -> list[str]:
        """Names of all fields that a page can request."""
        return list(self._readers)

    def values(self, names: Iterable[str], snapshot: Snapshot) -> dict[str, float | None]:
        """Return fields by name, None if not received; unknown names are ignored."""
        return {
            name: read(snapshot) for name in names if (read := self._readers.get(name)) is not None
        }

    def _add_odometry(self, stream: str, group: str, part: str, names: Sequence[str]) -> None:
        for i, name in enumerate(names):
            self._readers[f"{stream}.{group}.{name}"] = partial(_odometry_value, stream, part, i)

    def _requested(self, i: int) -> float:
        """Return a component of the latest command in the robot's axes, or 0 if it has expired."""
        commands = self._link.sent_commands
        if not commands or time.monotonic() - commands[-1].sent_s > REQUEST_TIMEOUT_S:
            return 0.0
        twist, odom = commands[-1].twist, self._link.snapshot.odom
        if commands[-1].frame == ODOM and odom is not None:
            twist = _turned(twist, -float(odom.xy_heading[2]))
        return float(twist[i])


def _joint_value(stream: str, joint: str, value: str, snapshot: Snapshot) -> float | None:
    state: JointState | None = getattr(snapshot, stream)
    if state is None or joint not in state.names:
        return None
    return float(getattr(state, value)[list(state.names).index(joint)])


def _odometry_value(stream: str, part: str, i: int, snapshot: Snapshot) -> float | None:
    odom: Odometry | None = getattr(snapshot, stream)
    return None if odom is None else float(getattr(odom, part)[i])


def _sigma(i: int, snapshot: Snapshot) -> float | None:
    odom = snapshot.odom
    return None if odom is None else math.sqrt(max(0.0, float(odom.pose_covariance[i, i])))


def _turned(twist: Array, angle_rad: float) -> Array:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]])
