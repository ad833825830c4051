"""Fields that the page requests for its plots, in addition to those in every state."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.robot_geometry import twist_axes_of
from tsd_twin.dashboard.scene.robot_visual import VisualSource
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import ODOM, JointState, Odometry

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

    def __init__(self, link: VisualSource, *, has_alternative: bool) -> None:
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
                unit = _SUFFIXES.get(joint.unit, joint.unit)
                name = f"reading_{unit}" if joint.unit else value
                self._readers[f"{stream}.{joint.name}.{name}"] = partial(
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
            turn = SE2(np.array([0.0, 0.0, float(odom.xy_heading[2])]))
            twist = np.append(turn.inverse().rotate(twist[:2]), twist[2])
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
