"""Views of all viser clients: each belongs to the page whose frame shows it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import viser

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.client_view import ClientView
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.student_robot import StudentPose
from tsd_twin.dashboard.scene.viser_compat import (
    has_no_gpu,
    is_disconnected,
    page_of,
    prefers_dark,
    set_theme,
)
from tsd_twin.dashboard.wire.to_page import CameraState
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.lie import Array

OnSphereClick: TypeAlias = Callable[[str, str, tuple[float, float, float]], None]
"""Called on viser's thread with page, robot id, and the unit vector to a point of its sphere."""


class ClientViews:
    """View of each connected client; a client without a known page shows the first robot."""

    def __init__(
        self,
        server: viser.ViserServer,
        scene: Scene,
        on_point: OnSphereClick = lambda _page, _robot, _at: None,
        *,
        robot_of: Callable[[str], str | None] = lambda _page: None,
        view_of: Callable[[str], ViewSettings | None] = lambda _page: None,
        frame_of: Callable[[str], Rectangle] = lambda _page: Rectangle(),
    ) -> None:
        """Register with the server and the scene.

        Args:
            server: Viser server.
            scene: Shared scene.
            on_point: Called if a sphere is clicked.
            robot_of: Returns the robot shown on a page; called on viser's thread.
            view_of: Returns the view settings of a page; called on viser's thread.
            frame_of: Returns the free part of a page's picture; called on viser's thread.
        """
        self._server = server
        self._scene = scene
        self._on_point = on_point
        self._robot_of, self._view_of, self._frame_of = robot_of, view_of, frame_of
        self._views: dict[int, ClientView] = {}
        self._pages: dict[int, str | None] = {}
        scene.on_robots_moved.append(self.on_robots_moved)
        scene.on_robots_changed.append(self.on_robots_changed)
        scene.on_click = self._on_click
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)

    def of_page(self, page: str) -> list[ClientView]:
        """Return the views of a page: none before its frame has connected."""
        with self._scene.lock:
            return [view for view in self._connected() if self._pages[view.client_id] == page]

    def select_robot(self, page: str, robot_id: str) -> None:
        """Show another robot on a page."""
        for view in self.of_page(page):
            view.select_robot(robot_id)

    def apply(self, page: str, settings: ViewSettings, *, look: bool) -> None:
        """Apply the view settings of a page; `look` points its camera at the robot."""
        for view in self.of_page(page):
            view.apply(settings, look=look)

    def set_frame(self, page: str, frame: Rectangle) -> None:
        """Set the part of a page's picture that nothing covers."""
        for view in self.of_page(page):
            view.set_frame(frame)

    def show_past(self, page: str, past: Snapshot | None, ago_s: float) -> None:
        """Draw the past state of a page's robot next to the live one; None hides it."""
        for view in self.of_page(page):
            view.show_past(past, ago_s)

    def show_preview(self, page: str, robot_id: str, joints: Array | None) -> None:
        """Preview a joint vector (n,) of a page's robot on that page; None ends the preview."""
        for view in self.of_page(page):
            view.preview(robot_id, joints)

    def show_student(self, page: str, pose: StudentPose | None) -> None:
        """Draw a robot in place of a page's robot on that page; None ends that."""
        for view in self.of_page(page):
            view.show_student(pose)

    def pick_floor(self, page: str, shares: Array) -> Array:
        """Return floor points (m, 2) in `odom` at a page's screen positions, see `floor_points`."""
        with self._scene.lock:
            for view in self.of_page(page):
                return view.pick_floor(shares)
        return np.empty((0, 2))

    def camera_state(self, page: str) -> CameraState | None:
        """Return the state of a page's camera; None before it was placed.

        It waits for no drawing: a pose that is half old moves an arrow by some pixels.
        """
        for client_id, view in list(self._views.items()):
            if self._pages.get(client_id) == page and not is_disconnected(view.client):
                return view.camera_state
        return None

    def on_robots_moved(self) -> None:
        """Update the followed robot of each client."""
        for view in self._connected():
            view.on_robots_moved()

    def on_robots_changed(self) -> None:
        """Update after robots were added or removed."""
        for view in self._connected():
            view.on_robots_changed()

    def _on_click(
        self, client: viser.ClientHandle, robot_id: str, origin: Array, direction: Array
    ) -> None:
        """Forward a click to the page, which decides whether the robot moves."""
        with self._scene.lock:
            view, page = self._views.get(client.client_id), self._pages.get(client.client_id)
            if view is None or page is None or view.robot_id != robot_id:
                return
            at = view.pick_sphere(origin, direction)
        if at is not None:
            self._on_point(page, robot_id, at)

    def _connected(self) -> list[ClientView]:
        return [view for view in self._views.values() if not is_disconnected(view.client)]

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        client_id = client.client_id
        page = page_of(self._server, client_id)
        with self._scene.lock:  # Robots must not change in between.
            self._pages[client_id] = page
            dark = prefers_dark(self._server, client_id) is not False
            set_theme(client.gui, dark=dark)
            view = ClientView(
                self._scene,
                client,
                dark=dark,
                plain=has_no_gpu(self._server, client_id),
                frame=Rectangle() if page is None else self._frame_of(page),
            )
            if page is not None and (chosen := self._robot_of(page)) is not None:
                view.select_robot(chosen)
            if page is not None and (settings := self._view_of(page)) is not None:
                view.apply(settings)
            self._views[client_id] = view

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        with self._scene.lock:
            self._pages.pop(client.client_id, None)
            self._views.pop(client.client_id, None)
