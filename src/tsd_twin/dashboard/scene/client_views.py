"""Views of all viser clients, by the page whose frame shows them, and their worker thread."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
import viser
from numpy.typing import NDArray

from tsd_twin.dashboard.scene.client_filter import client_filters, visible_robots
from tsd_twin.dashboard.scene.client_view import ClientView
from tsd_twin.dashboard.scene.framing import WHOLE_PICTURE, Rectangle
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.viser_compat import (
    filter_clients,
    is_disconnected,
    look_of,
    page_of,
    robots_of,
    set_theme,
)
from tsd_twin.dashboard.wire.to_page import CameraState
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.lie import Array
from tsd_twin.messages.pictures import GroundGrid

_LOG = logging.getLogger(__name__)
_Answer = TypeVar("_Answer")

OnSphereClick: TypeAlias = Callable[[str, str, tuple[float, float, float]], None]
"""Called on viser's thread with page, robot id, and the unit vector to a point of its sphere."""


class PageView(NamedTuple):
    """View that a page has asked for."""

    settings: ViewSettings | None = None
    frame: Rectangle = WHOLE_PICTURE
    """Part of the picture that the page leaves free."""
    robot_id: str | None = None
    """Robot that the page shows."""


class ClientViews:
    """View of each connected client; a client without a known page shows the first robot."""

    def __init__(
        self,
        server: viser.ViserServer,
        scene: Scene,
        on_point: OnSphereClick = lambda _page, _robot, _at: None,
        *,
        view_of: Callable[[str], PageView] = lambda _page: PageView(),
    ) -> None:
        """Register with the server and the scene.

        Args:
            server: Viser server.
            scene: Shared scene.
            on_point: Called if a sphere is clicked.
            view_of: Returns the view of a page; called on viser's thread.
        """
        self._server = server
        self._scene = scene
        self._on_point = on_point
        self._view_of = view_of
        self._views: dict[int, ClientView] = {}
        filter_clients(server, client_filters)
        scene.on_robots_moved = self._on_robots_moved
        scene.on_robots_changed = self._on_robots_changed
        scene.on_click = self._on_click
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)

    def of_page(self, page: str) -> list[ClientView]:
        """Return the views of a page: none before its frame has connected."""
        with self._scene.lock:
            return [view for view in self._connected() if view.page == page]

    @property
    def show_ground(self) -> bool:
        """Whether a client shows pictures of cameras above the floor; those show all robots."""
        return any(view.shows_ground for view in self._connected())

    def draw_ground(
        self, key: str, picture: NDArray[np.uint8] | None = None, grid: GroundGrid | None = None
    ) -> None:
        """Draw the picture of a camera on the floor, for all clients that show it."""
        with self._scene.lock:
            for view in self._connected():
                view.draw_ground(key, picture, grid)

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
        views = list(self._views.values())
        shown = (each for each in views if each.page == page and not is_disconnected(each.client))
        return next((view.camera_state for view in shown), None)

    def _on_robots_moved(self) -> None:
        for view in self._connected():
            view.on_robots_moved()

    def _on_robots_changed(self) -> None:
        for view in self._connected():
            view.on_robots_changed()

    def _on_click(
        self, client: viser.ClientHandle, robot_id: str, origin: Array, direction: Array
    ) -> None:
        """Forward a click to the page, which decides whether the robot moves."""
        with self._scene.lock:
            view = self._views.get(client.client_id)
            if view is None or view.page is None or view.robot_id != robot_id:
                return
            at = view.pick_sphere(origin, direction)
        if at is not None:
            self._on_point(view.page, robot_id, at)

    def _connected(self) -> list[ClientView]:
        return [view for view in list(self._views.values()) if not is_disconnected(view.client)]

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        client_id = client.client_id
        page, look = page_of(self._server, client_id), look_of(self._server, client_id)
        with self._scene.lock:  # Neither the robots nor the page's requests may change in between.
            asked = PageView() if page is None else self._view_of(page)
            dark = "dark" in look
            set_theme(client.gui, dark=dark)
            view = ClientView(
                self._scene,
                client,
                page,
                dark=dark,
                plain="plain" in look,
                frame=asked.frame,
                visible=visible_robots(robots_of(self._server, client_id)),
            )
            if asked.robot_id is not None:
                view.select_robot(asked.robot_id)
            if asked.settings is not None:
                view.apply(asked.settings)
            self._views[client_id] = view

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        with self._scene.lock:
            self._views.pop(client.client_id, None)


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
    """Scene of pages, for the event loop: changes are made on a worker thread, one by one."""

    def __init__(
        self, worker: BackgroundWorker, scene: Scene, views: Callable[[], ClientViews]
    ) -> None:
        self._worker, self._scene, self._views = worker, scene, views

    def draw(self, page: str, kind: str, act: Callable[[ClientView], None]) -> None:
        """Call `act` with the views of a page; it replaces a waiting call of this kind."""

        def work() -> None:
            for view in self._views().of_page(page):
                act(view)

        self._worker.submit_latest((kind, page), work)

    def pick_floor(self, page: str, shares: Array) -> Future[Array]:
        """Floor points (m, 2) in `odom` at screen positions `shares` of a page."""
        return self._worker.submit(lambda: self._views().pick_floor(page, shares))

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show the planned path of a robot on all pages; None removes it."""
        self._worker.submit_latest(
            ("route", robot_id), lambda: self._scene.show_route(robot_id, poses)
        )

    # Answered at once, without waiting for a drawing.

    def camera_state(self, page: str) -> CameraState | None:
        """State of a page's camera; None before it was placed."""
        return self._views().camera_state(page)

    def envelope(self, robot_id: str) -> Array | None:
        """Drawn stop envelope (n, 2) in the frame of a robot; None at rest."""
        return self._scene.envelope(robot_id)

    def reach_m(self, robot_id: str) -> float:
        """Radius of a robot around its base; 0 while it is not in the scene."""
        return self._scene.reach_m(robot_id)
