"""Route of the robots' portraits."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from aiohttp import web

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.gateway.auth import PRINCIPAL
from tsd_twin.dashboard.gateway.pages import Content
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.errors import TwinError


class PortraitRoutes:
    """Portraits of the robots on the bus, rendered in a thread at their first request."""

    def __init__(self, links: Mapping[str, RobotMonitor]) -> None:
        """`links` is a live view of all robots by id."""
        self._links = links
        self._portraits: dict[str, tuple[RobotMonitor, Content]] = {}
        self._rendering = asyncio.Lock()
        """One at a time: the other core belongs to commands."""

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Add the route."""
        router.add_get("/portraits/{robot}", self._serve)

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        robot_id = request.match_info["robot"]
        async with self._rendering:
            link = self._links.get(robot_id)
            if link is None or not request[PRINCIPAL].rights.may_watch(robot_id):
                raise web.HTTPNotFound(text="No such robot.")
            known, portrait = self._portraits.get(robot_id, (None, None))
            if portrait is None or known is not link:  # Also after a restart of the robot.
                try:
                    body = await asyncio.to_thread(lambda: robot_shape(link.robot).portrait)
                except TwinError as error:
                    raise web.HTTPNotFound(text=str(error)) from error
                portrait = Content(body, ".webp")
                present = {
                    each: self._portraits[each] for each in self._portraits.keys() & self._links
                }
                self._portraits = {**present, robot_id: (link, portrait)}
        return portrait.respond(request)
