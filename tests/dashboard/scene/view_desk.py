"""A scene with views of its clients, and the pages that the clients belong to."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any

import viser

from tests.support.link_sockets import eventually
from tests.support.viser_client import ViserClient, viser_client
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.scene.client_view import ClientView
from tsd_twin.dashboard.scene.client_views import ClientViews, PageView
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.wire.view import ViewSettings

PAGE, OTHER_PAGE = "0123456789abcdef", "fedcba9876543210"


@dataclass
class ViewDesk:
    """A scene with client views; robots, settings and frames of pages are set by the test."""

    server: viser.ViserServer
    scene: Scene
    robots: dict[str, str] = field(default_factory=dict[str, str])
    settings: dict[str, ViewSettings] = field(default_factory=dict[str, ViewSettings])
    frames: dict[str, Rectangle] = field(default_factory=dict[str, Rectangle])
    points: SimpleQueue[tuple[Any, ...]] = field(default_factory=SimpleQueue)
    """Clicks on spheres: page, robot and point."""

    def __post_init__(self) -> None:
        self._disconnected: SimpleQueue[int] = SimpleQueue()
        self.views = ClientViews(
            self.server,
            self.scene,
            lambda *point: self.points.put(point),
            view_of=lambda page: PageView(
                self.settings.get(page), self.frames.get(page, Rectangle()), self.robots.get(page)
            ),
        )
        self.server.on_client_disconnect(self._note)

    async def _note(self, client: viser.ClientHandle) -> None:
        self._disconnected.put(client.client_id)

    def clear(self) -> None:
        """Remove all robots, and forget all pages."""
        for robot_id in list(self.scene.visuals):
            self.scene.remove(robot_id)
        for pages in (self.robots, self.settings, self.frames):
            pages.clear()

    def view(self, page: str = PAGE) -> ClientView:
        """Return the view of a page that has one client."""
        (view,) = self.views.of_page(page)
        return view

    def apply(self, page: str = PAGE, *, look: bool = False, **settings: Any) -> None:
        """Apply view settings to a page; those that are not given have their defaults."""
        self.view(page).apply(ViewSettings(**settings), look=look)

    @contextmanager
    def opened(
        self, page: str | None, *, plain: bool = False, robots: str = ""
    ) -> Generator[ViserClient]:
        """Connect a client with a view, which the server has forgotten when this ends."""
        with viser_client(self.server.get_port(), page, plain=plain, robots=robots) as viewer:
            viewer.until(lambda: "/stage/key" in viewer.own)
            if page is not None:
                eventually(lambda: bool(self.views.of_page(page)))
            yield viewer
        self._disconnected.get(timeout=PATIENCE_S)
