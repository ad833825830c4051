"""Past state of the robot on one page: in its scene, and as numbers."""

from __future__ import annotations

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.client_views import SceneExecutor
from tsd_twin.dashboard.sessions.robot_directory import RobotDirectory
from tsd_twin.dashboard.wire.to_page import PastState


class LookBackSession:
    """Per-page look at a past state of the selected robot; event loop only."""

    def __init__(self, page: str, directory: RobotDirectory, scene: SceneExecutor) -> None:
        self._page, self._directory, self._scene = page, directory, scene
        self._ago_s: float | None = None
        self._past: Snapshot | None = None

    def request(self, robot_id: str | None, ago_s: float | None) -> None:
        """Look at the state of `ago_s` ago from now on; None ends it."""
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
        if ago_s is None or past is None or past.status is None or robot is None:
            return None
        told = robot.telemetry.state(
            past, past.status, past.received_s, mode_age_s=0.0, round_trips=robot.link.round_trips
        )
        return PastState(ago_s, told.status.mode, told.pose, told.twist)
