"""Scene operations of pages, on a worker thread off the event loop."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.client_views import ClientViews
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.student_robot import StudentPose
from tsd_twin.dashboard.wire.to_page import CameraState
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.lie import Array

_LOG = logging.getLogger(__name__)
_Answer = TypeVar("_Answer")


class BackgroundWorker:
    """Worker thread with a queue of tasks; thread-safe."""

    def __init__(self, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, name)
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, Callable[[], None]] = {}

    def submit_latest(self, key: Hashable, work: Callable[[], None]) -> None:
        """Queue `work`; it replaces a waiting task with the same key."""
        with self._lock:
            waits = key in self._waiting
            self._waiting[key] = work
            if not waits:
                self._pool.submit(self._do, key)

    def submit(self, work: Callable[[], _Answer]) -> Future[_Answer]:
        """Queue `work`, and return its future result."""
        return self._pool.submit(work)

    def close(self) -> None:
        """Finish queued tasks, and accept no more."""
        self._pool.shutdown()

    def _do(self, key: Hashable) -> None:
        with self._lock:
            work = self._waiting.pop(key)
        try:
            work()
        except Exception:  # The next task belongs to another page.
            _LOG.exception("%s was not done", key)


class SceneExecutor:
    """Scene operations of pages, one after the other on a worker thread; calls do not block."""

    def __init__(
        self, worker: BackgroundWorker, scene: Scene, views: Callable[[], ClientViews]
    ) -> None:
        self._worker, self._scene, self._views = worker, scene, views

    def pick_floor(self, page: str, shares: Array) -> Future[Array]:
        """Floor points (m, 2) in `odom` at screen positions `shares` of a page."""
        return self._worker.submit(lambda: self._views().pick_floor(page, shares))

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show the planned path of a robot on all pages; None removes it."""
        self._worker.submit_latest(
            ("route", robot_id), lambda: self._scene.show_route(robot_id, poses)
        )

    def apply_view(self, page: str, settings: ViewSettings, *, look: bool) -> None:
        """Apply the view settings of a page; `look` turns its camera to the robot."""
        self._worker.submit_latest(
            ("view", page), lambda: self._views().apply(page, settings, look=look)
        )

    def set_frame(self, page: str, frame: Rectangle) -> None:
        """Set the part of a page's picture that nothing covers."""
        self._worker.submit_latest(("frame", page), lambda: self._views().set_frame(page, frame))

    def show_past(self, page: str, past: Snapshot | None, ago_s: float) -> None:
        """Draw the robot of a page as it was some seconds ago, beside the live one, or no more."""
        self._worker.submit_latest(
            ("past", page), lambda: self._views().show_past(page, past, ago_s)
        )

    def show_preview(self, page: str, robot_id: str, joints: Array | None) -> None:
        """Preview joints (n,) of a page's robot in its scene; None ends the preview."""
        self._worker.submit_latest(
            ("preview", page), lambda: self._views().show_preview(page, robot_id, joints)
        )

    def show_student(self, page: str, pose: StudentPose | None) -> None:
        """Draw a robot in place of a page's robot in its scene; None ends that."""
        self._worker.submit_latest(
            ("student", page), lambda: self._views().show_student(page, pose)
        )

    def select_robot(self, page: str, robot_id: str) -> None:
        """Select a robot on a page."""
        self._worker.submit_latest(
            ("choose", page), lambda: self._views().select_robot(page, robot_id)
        )

    def camera_state(self, page: str) -> CameraState | None:
        """State of a page's camera; None before it was placed."""
        return self._views().camera_state(page)

    def envelope(self, robot_id: str) -> Array | None:
        """Drawn stop envelope (n, 2) in the frame of a robot; None at rest."""
        return self._scene.envelope(robot_id)

    def reach_m(self, robot_id: str) -> float:
        """Radius of a robot around its base; 0 while it is not in the scene."""
        return self._scene.reach_m(robot_id)
