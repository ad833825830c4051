"""The panel of one client."""

from __future__ import annotations

from collections.abc import Callable

import viser

from tsd_twin.dashboard.client_view import ClientView
from tsd_twin.dashboard.drive_tab import DriveTab, OnMoved
from tsd_twin.dashboard.scene import Scene
from tsd_twin.dashboard.view_tab import ViewTab


class Panel:
    """Tabs Drive, Gimbals, View, Plots and Health.

    Gimbals, Plots and Health are empty places, marked `data-tsd`: the page itself draws there, from
    a socket of its own, so that nothing is sent twice.
    """

    def __init__(
        self,
        scene: Scene,
        client: viser.ClientHandle,
        on_moved: OnMoved,
        on_robot: Callable[[str], None],
        *,
        dark: bool,
        watches: bool = False,
    ) -> None:
        """A client that only watches has no control whose movement would be heard."""
        self.client = client
        self._view = ClientView(scene, client)
        gui = client.gui
        tabs = gui.add_tab_group()
        self._drive: DriveTab | None = None
        if not watches:
            with tabs.add_tab("Drive"):
                self._drive = DriveTab(gui, self._view, on_moved, on_robot)
        with tabs.add_tab("Gimbals"):
            gui.add_html('<div data-tsd="gimbals"></div>')
        if not watches:
            with tabs.add_tab("View"):
                ViewTab(gui, self._view, scene.clear_trails, dark=dark)
        with tabs.add_tab("Plots"):
            gui.add_html('<div data-tsd="plots"></div>')
        with tabs.add_tab("Health"):
            gui.add_html('<div data-tsd="health"></div>')

    def moved(self) -> None:
        """Follow the robot that has moved."""
        self._view.moved()

    def rebuild(self) -> None:
        """Take in that robots have come or gone."""
        self._view.rebuild()
        if self._drive is not None:
            self._drive.refresh()

    def reset(self) -> None:
        """Let the sliders spring back."""
        if self._drive is not None:
            self._drive.reset()

    def choose(self, robot_id: str) -> None:
        """Turn to another robot, chosen elsewhere in the page."""
        if robot_id != self._view.robot_id and robot_id in self._view.robot_ids:
            self.reset()
            self._view.choose(robot_id)
            if self._drive is not None:
                self._drive.refresh()
