"""Panel manager: one panel per viser client, and the page of each client."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
import viser

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.panel import Panel, SliderMode
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.student_robot import StudentPose
from tsd_twin.dashboard.scene.viser_compat import (
    has_no_gpu,
    is_disconnected,
    is_viewer,
    page_of,
    prefers_dark,
    set_theme,
)
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.lie import Array

OnPanelMoved: TypeAlias = Callable[
    [str, float, float, float, Literal["preview", "drive"], bool], None
]
"""Called on viser's thread with page, twist components, mode and latch."""
OnSphereClick: TypeAlias = Callable[[str, str, tuple[float, float, float]], None]
"""Called on viser's thread with page, robot id, and the unit vector to a point of its sphere."""
OnRobotSelected: TypeAlias = Callable[[str, str], None]
"""Called on viser's thread with page and robot id."""


OnPageViewChanged: TypeAlias = Callable[[str, ViewSettings], None]
"""Called on viser's thread with page and the settings changed by its operator."""


def _ignore_view(_page: str, _settings: ViewSettings) -> None:
    pass


class PanelManager:
    """Creates a panel for each connected client, and forwards its input to the page's session.

    The panel of a client without a known page only changes its view.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        scene: Scene,
        on_panel: OnPanelMoved,
        on_robot: OnRobotSelected,
        on_point: OnSphereClick,
        *,
        robot_of: Callable[[str], str | None] = lambda _page: None,
        on_view: OnPageViewChanged = _ignore_view,
        view_of: Callable[[str], ViewSettings | None] = lambda _page: None,
        dark: bool | None = None,
    ) -> None:
        """Register with the server and the scene.

        Args:
            server: Viser server.
            scene: Shared scene.
            on_panel: Called if sliders are moved.
            on_robot: Called if a robot is selected.
            on_point: Called if a sphere is clicked.
            robot_of: Returns the robot shown on a page; called on viser's thread.
            on_view: Called if view settings are changed.
            view_of: Returns the view settings of a page; called on viser's thread.
            dark: Theme of all clients; None follows the preference of each browser.
        """
        self._server = server
        self._scene = scene
        self._on_panel = on_panel
        self._on_robot = on_robot
        self._on_point = on_point
        self._robot_of = robot_of
        self._on_view, self._view_of = on_view, view_of
        self._dark = dark
        self._panels: dict[int, Panel] = {}
        self._pages: dict[int, str | None] = {}
        scene.on_robots_moved.append(self.on_robots_moved)
        scene.on_robots_changed.append(self.on_robots_changed)
        scene.on_click = self._on_click
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)

    def reset_sliders(self, page: str) -> None:
        """Reset the sliders of a page after a release."""
        for panel in self._panels_of(page):
            panel.reset_sliders()

    def select_robot(self, page: str, robot_id: str) -> None:
        """Select a robot in the panel of a page."""
        for panel in self._panels_of(page):
            panel.select_robot(robot_id)

    def set_view(self, page: str, settings: ViewSettings, *, look: bool) -> None:
        """Apply the view settings of a page; `look` points its camera at the robot."""
        for panel in self._panels_of(page):
            panel.set_view(settings, look=look)

    def show_past(self, page: str, past: Snapshot | None, ago_s: float) -> None:
        """Draw the past state of a page's robot next to the live one; None hides it."""
        for panel in self._panels_of(page):
            panel.show_past(past, ago_s)

    def show_preview(self, page: str, robot_id: str, joints: Array | None) -> None:
        """Preview a joint vector (n,) of a page's robot on that page; None ends the preview."""
        for panel in self._panels_of(page):
            panel.preview(robot_id, joints)

    def show_student(self, page: str, pose: StudentPose | None) -> None:
        """Draw a robot in place of a page's robot on that page; None ends that."""
        for panel in self._panels_of(page):
            panel.show_student(pose)

    def pick_floor(self, page: str, shares: Array) -> Array:
        """Return floor points (m, 2) in `odom` at a page's screen positions, see `floor_points`."""
        with self._scene.lock:
            for panel in self._panels_of(page):
                return panel.pick_floor(shares)
        return np.empty((0, 2))

    def on_robots_moved(self) -> None:
        """Update the followed robot of each client."""
        for panel in self._connected_panels():
            panel.on_robots_moved()

    def on_robots_changed(self) -> None:
        """Update after robots were added or removed."""
        for panel in self._connected_panels():
            panel.on_robots_changed()

    def _on_click(
        self, client: viser.ClientHandle, robot_id: str, origin: Array, direction: Array
    ) -> None:
        """Forward a click to the page, which decides whether the robot moves."""
        with self._scene.lock:
            panel, page = self._panels.get(client.client_id), self._pages.get(client.client_id)
            if panel is None or page is None or panel.robot_id != robot_id:
                return
            at = panel.pick_sphere(origin, direction)
        if at is not None:
            self._on_point(page, robot_id, at)

    def _panels_of(self, page: str) -> list[Panel]:
        with self._scene.lock:
            return [
                panel
                for panel in self._connected_panels()
                if self._pages[panel.client.client_id] == page
            ]

    def _connected_panels(self) -> list[Panel]:
        return [panel for panel in self._panels.values() if not is_disconnected(panel.client)]

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        page = page_of(self._server, client.client_id)

        def moved(x: float, y: float, turn: float, mode: SliderMode, latch: bool) -> None:
            if page is not None:
                self._on_panel(page, x, y, turn, mode.value, latch)

        def robot(robot_id: str) -> None:
            if page is not None:
                self._on_robot(page, robot_id)

        def view(settings: ViewSettings) -> None:
            if page is not None:
                self._on_view(page, settings)

        with self._scene.lock:  # Robots must not change in between.
            self._pages[client.client_id] = page
            dark = self._dark
            if dark is None:
                dark = prefers_dark(self._server, client.client_id) is not False
                set_theme(client.gui, dark=dark)
            plain = has_no_gpu(self._server, client.client_id)
            watches = is_viewer(self._server, client.client_id)
            panel = Panel(
                self._scene, client, moved, robot, view, dark=dark, watches=watches, plain=plain
            )
            if page is not None and (chosen := self._robot_of(page)) is not None:
                panel.select_robot(chosen)
            if page is not None and (settings := self._view_of(page)) is not None:
                panel.set_view(settings, look=False)
            self._panels[client.client_id] = panel

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        with self._scene.lock:
            self._pages.pop(client.client_id, None)
            self._panels.pop(client.client_id, None)
