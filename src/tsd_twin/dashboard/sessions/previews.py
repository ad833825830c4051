"""Preview of the joints for a twist, and past state of the robot, on one page."""

from __future__ import annotations

import numpy as np

from tsd_twin.client.monitor import RobotMonitor, Snapshot
from tsd_twin.client.motions import PlanLimits
from tsd_twin.dashboard.scene.client_views import SceneExecutor
from tsd_twin.dashboard.sessions.actuator_telemetry import binding_limit, rounded
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.dashboard.sessions.permitted_robots import PermittedRobots
from tsd_twin.dashboard.sessions.robot_directory import RobotDirectory
from tsd_twin.dashboard.sessions.send_queue import SendQueue
from tsd_twin.dashboard.wire.to_page import JointPreview, PastState, encode_message
from tsd_twin.lie import Array
from tsd_twin.motion import TwistLimiter


class PreviewSession:
    """Per-page preview: the reply to the page, and the pose in its scene; event loop only."""

    def __init__(
        self,
        page: str,
        directory: RobotDirectory | PermittedRobots,
        scene: SceneExecutor,
        queue: SendQueue,
    ) -> None:
        self._page, self._directory = page, directory
        self._scene, self._queue = scene, queue
        self._asked: tuple[str, Array] | None = None
        self._shown: JointPreview | None = None

    def request(self, robot_id: str | None, twist: tuple[float, float, float] | None) -> None:
        """Show the joints for a twist of a robot; None ends the preview."""
        if twist is None or robot_id is None:
            self.end()
            return
        self._asked, self._shown = (robot_id, np.array(twist)), None
        self.refresh()

    def refresh(self) -> None:
        """Show the joints again if they have changed with the wheel speed or the limits."""
        robot = None if self._asked is None else self._directory.robot(self._asked[0])
        if self._asked is None or robot is None:
            return
        preview, joints = preview_of(robot.link, self._asked[1])
        if preview != self._shown:
            self._shown = preview
            self._queue.put_latest("preview", encode_message(preview))
            self._draw(robot.link.id, joints)

    def end(self) -> None:
        """End the preview, if there is one."""
        if self._asked is not None:
            self._draw(self._asked[0], None)
            self._asked = self._shown = None

    def _draw(self, robot_id: str, joints: Array | None) -> None:
        self._scene.draw(self._page, "preview", lambda view: view.show_preview(robot_id, joints))


def preview_of(link: RobotMonitor, twist: Array) -> tuple[JointPreview, Array]:
    """Return the preview of `twist` (3,) and its joint vector (n,), at the current limits."""
    active = PlanLimits.in_force(link.robot, link.kinematics, link.snapshot.status)
    drive, limiter = active.kinematics, TwistLimiter(active.kinematics, active.limits)
    reached = limiter.cap(twist)
    joints = drive.inverse(reached)
    held_back = max(limiter.utilizations(twist)) > 1.0
    preview = JointPreview(
        robot=link.id,
        twist=rounded(reached),
        utilization=round(float(drive.joint_utilization(twist)), 4),
        limit=binding_limit(drive, limiter, twist) if held_back else None,
        **view_of(link.robot).joint_fields(drive, joints),
    )
    return preview, joints


class LookBackSession:
    """Per-page look at a past state of the selected robot; event loop only."""

    def __init__(
        self, page: str, directory: RobotDirectory | PermittedRobots, scene: SceneExecutor
    ) -> None:
        self._page, self._directory, self._scene = page, directory, scene
        self._ago_s: float | None = None
        self._past: Snapshot | None = None

    def request(self, robot_id: str | None, ago_s: float | None) -> None:
        """Show the state of `ago_s` ago; None shows the current one again."""
        self._ago_s = ago_s
        self.show(robot_id)

    def show(self, robot_id: str | None) -> PastState | None:
        """Draw the past state of the robot, if requested, and return it."""
        ago_s, robot = self._ago_s, self._directory.robot(robot_id)
        past = None if ago_s is None or robot is None else robot.past(ago_s)
        if past is not self._past:
            self._past = past
            at_s = ago_s or 0.0
            self._scene.draw(self._page, "past", lambda view: view.show_past(past, at_s))
        if ago_s is None or past is None or robot is None:
            return None
        told = robot.telemetry.state(past, past.received_s)
        return told and PastState(ago_s, told.status.mode, told.pose, told.twist)
