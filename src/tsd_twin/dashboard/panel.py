"""The panel of one client."""

from __future__ import annotations

from collections.abc import Callable

import viser

from tsd_twin.dashboard.client_view import ClientView
from tsd_twin.dashboard.drive_tab import DriveTab, OnMoved
from tsd_twin.dashboard.scene import Scene
from tsd_twin.dashboard.view_tab import ViewTab
from tsd_twin.dashboard.viser_private import rename_tab
from tsd_twin.lie import Array
from tsd_twin.robots import OmniRobot, Robot, SingularityRobot, SphereRobot

JOINTS: dict[type[Robot] | None, str] = {
    None: "Gimbals",
    SingularityRobot: "Gimbals",
    OmniRobot: "Wheels",
    SphereRobot: "Sphere",
}
"""What the tab of the actuators is called, by the kind of the robot."""


class Panel:
    """Tabs Drive, Gimbals or what else the robot has, View, Plots and Health.

    The second, Plots, Health and the end of Drive are empty places, marked `data-tsd`: the page
    itself draws there, from a socket of its own, so that nothing is sent twice.
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
        plain: bool = False,
    ) -> None:
        """A client that only watches has no control whose movement would be heard.

        One that draws without a graphics card has a `plain` scene.
        """
        self.client = client
        self._view = ClientView(scene, client, plain=plain)
        self._on_robot = on_robot
        gui = client.gui
        tabs = gui.add_tab_group()
        self._drive: DriveTab | None = None
        if not watches:
            with tabs.add_tab("Drive"):
                self._drive = DriveTab(gui, self._view, on_moved, self._chosen)
                gui.add_html('<div data-tsd="gear"></div>')
                gui.add_html('<div data-tsd="route"></div>')
        self._joints = tabs.add_tab(JOINTS[None])
        with self._joints:
            gui.add_html('<div data-tsd="joints"></div>')
        if not watches:
            with tabs.add_tab("View"):
                ViewTab(gui, self._view, scene.clear_trails, dark=dark)
        with tabs.add_tab("Plots"):
            gui.add_html('<div data-tsd="plots"></div>')
        with tabs.add_tab("Health"):
            gui.add_html('<div data-tsd="health"></div>')
        self._name_joints()

    @property
    def robot_id(self) -> str | None:
        """The robot that its client looks at."""
        return self._view.robot_id

    def point(self, origin: Array, direction: Array) -> tuple[float, float, float] | None:
        """Return the point of the robot's ball that a ray (3,), (3,) in the picture meets."""
        return self._view.point(origin, direction)

    def floor(self, shares: Array) -> Array:
        """Return the places (m, 2) in `odom` that the picture shows, as `on_floor`."""
        return self._view.floor(shares)

    def moved(self) -> None:
        """Follow the robot that has moved."""
        self._view.moved()

    def rebuild(self) -> None:
        """Take in that robots have come or gone."""
        self._view.rebuild()
        self._name_joints()
        if self._drive is not None:
            self._drive.refresh()

    def _chosen(self, robot_id: str) -> None:
        self._name_joints()
        self._on_robot(robot_id)

    def _name_joints(self) -> None:
        body = self._view.body
        rename_tab(self._joints, JOINTS[None if body is None else type(body.link.robot)])

    def reset(self) -> None:
        """Let the sliders spring back."""
        if self._drive is not None:
            self._drive.reset()

    def choose(self, robot_id: str) -> None:
        """Turn to another robot, chosen elsewhere in the page."""
        with self._view.lock:  # Another thread may bring the choice in the panel itself.
            before = self._view.robot_id
            self._view.choose(robot_id)
            if self._view.robot_id != before:
                self.reset()
                self._name_joints()
                if self._drive is not None:
                    self._drive.refresh()
