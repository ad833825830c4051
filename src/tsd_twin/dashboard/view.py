"""What a page is told about one robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from tsd_twin.dashboard.components import components
from tsd_twin.dashboard.gimbal_figures import GimbalFigures
from tsd_twin.dashboard.link import RobotLink, Snapshot
from tsd_twin.dashboard.poses import as_commanded
from tsd_twin.dashboard.protocol import Card, Limits, Number, State, Triple
from tsd_twin.dashboard.sphere_figures import SphereFigures
from tsd_twin.dashboard.trips import RoundTrips
from tsd_twin.dashboard.wheel_figures import WheelFigures
from tsd_twin.drives import JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.ros import JointState, Odometry
from tsd_twin.messages.status import Status
from tsd_twin.robots import OmniRobot, Robot, SingularityRobot, SphereRobot

LEVELS = (20, 50, 80, 100)
"""Speeds that can be chosen, in percent of the limits."""


class Figures(Protocol):
    """What belongs to one kind of robot in cards and states, by the names of their fields."""

    def card(self) -> dict[str, Any]:
        """Return what belongs into a card."""
        ...

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot, /) -> dict[str, Any]:
        """Return what belongs into a state, from joint vectors (n,)."""
        ...


FIGURES: dict[type[Robot], Callable[[Any], Figures]] = {
    SingularityRobot: GimbalFigures,
    OmniRobot: WheelFigures,
    SphereRobot: SphereFigures,
}
"""From the kind of a robot to what is shown of its actuators."""


class RobotView:
    """Description and state of a robot, in the numbers that are shown."""

    def __init__(self, link: RobotLink) -> None:
        self.link = link
        self._drive = link.drive
        self._order = [joint.name for joint in link.drive.joints]
        self._is_angle = np.array([j.kind is JointKind.POSITION for j in link.drive.joints])
        self._figures = FIGURES[type(link.robot)](link.robot)

    def card(self) -> Card:
        """Return what does not change."""
        robot = self.link.robot
        return Card(
            id=self.link.id,
            title=robot.title,
            limits=Limits(robot.limits.speed_mps, robot.limits.turn_rate_rad_per_s),
            levels=LEVELS,
            space="floor" if self._drive.space is SE2 else "ball",
            numbers=[Number(one.name, one.symbol, one.unit) for one in components(self._drive)],
            lever_m=self._drive.lever_m,
            **self._figures.card(),
        )

    def state(
        self,
        snapshot: Snapshot,
        status: Status,
        now_s: float,
        *,
        mode_age_s: float,
        trips: RoundTrips,
    ) -> State:
        """Return the newest of everything; null where the robot has not said it yet."""
        typical_s, jitter_s = trips.typical_s(), trips.jitter_s()
        joints = self._vector(snapshot.joints)
        setpoint = self._vector(snapshot.setpoint)
        odom, truth = snapshot.odom, snapshot.truth
        figures: dict[str, Any] = {}
        if joints is not None and setpoint is not None:
            figures = self._figures.state(joints, setpoint, snapshot)
        return State(
            seen=snapshot.status_seq,
            age_ms=round(1000.0 * (now_s - snapshot.received_s), 1),
            status=status,
            mode_age_s=round(mode_age_s, 1),
            you=False,
            robot_ms=_ms(typical_s),
            robot_jitter_ms=_ms(jitter_s),
            pose=self._place(odom),
            twist=_rounded(odom.twist) if odom else None,
            commanded=self._commanded(setpoint, joints),
            truth=self._place(truth),
            **figures,
        )

    def _commanded(self, setpoint: Array | None, joints: Array | None) -> Triple | None:
        if setpoint is None:
            return None
        if joints is not None:
            setpoint = as_commanded(self._drive, setpoint, joints)
        return _rounded(self._drive.forward(setpoint).twist)

    def _place(self, said: Odometry | None) -> Triple | None:
        """Return where a robot is that drives; a ball is turned, not anywhere."""
        return None if said is None or said.wxyz is not None else _rounded(said.xy_heading)

    def _vector(self, state: JointState | None) -> Array | None:
        """Return a joint vector (n,), or None when it lacks one of our joints."""
        if state is None:
            return None
        place = {name: i for i, name in enumerate(state.names)}
        if not all(name in place for name in self._order):
            return None
        rows = [place[name] for name in self._order]
        joints = np.where(self._is_angle, state.position_rad[rows], state.velocity_rad_per_s[rows])
        return joints if np.isfinite(joints).all() else None


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000.0 * seconds, 2)


def _rounded(values: Array) -> Triple:
    a, b, c = (round(float(value), 5) for value in values)
    return a, b, c
