"""Lays the pictures of cameras above the floor on the floor of the scene."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from contextlib import AsyncExitStack

import numpy as np
import simplejpeg
from numpy.typing import NDArray

from tsd_twin.dashboard.pictures.feed import CameraFeed, Cameras
from tsd_twin.dashboard.pictures.ground import MOST_PX, seen_from_above
from tsd_twin.dashboard.scene.client_views import BackgroundWorker, ClientViews
from tsd_twin.errors import BusError
from tsd_twin.messages.pictures import GroundGrid

_LOG = logging.getLogger(__name__)
PERIOD_S = 0.5
"""Slower than the pane, because this picture shows the surroundings."""


class GroundLayer:
    """Draws the latest picture of each such camera for clients that show this layer."""

    def __init__(self, cameras: Cameras, views: ClientViews, worker: BackgroundWorker) -> None:
        self._cameras, self._views, self._worker = cameras, views, worker
        self._watched: dict[str, tuple[CameraFeed, AsyncExitStack]] = {}
        self._drawn: dict[str, int] = {}

    async def run(self) -> None:
        """Draw until it is cancelled."""
        try:
            while True:
                await asyncio.sleep(PERIOD_S)
                await self._follow(self._cameras.feeds if self._views.show_ground else {})
                for key, (feed, _) in self._watched.items():
                    await self._draw(key, feed)
        finally:
            await self._follow({})

    async def _follow(self, wanted: Mapping[str, CameraFeed]) -> None:
        """Watch the calibrated ones of the wanted cameras only."""
        wanted = {key: feed for key, feed in wanted.items() if feed.ground is not None}
        for key in set(self._watched) - set(wanted):
            _, watching = self._watched.pop(key)
            await watching.aclose()
            self._drawn.pop(key, None)
            self._worker.submit_latest(("ground", key), lambda k=key: self._views.draw_ground(k))
        for key in set(wanted) - set(self._watched):
            watching = AsyncExitStack()
            try:
                await watching.enter_async_context(wanted[key].watched())
            except BusError as error:  # The next period tries again.
                _LOG.warning("pictures of %s: %s", key, error)
                continue
            self._watched[key] = wanted[key], watching

    async def _draw(self, key: str, feed: CameraFeed) -> None:
        newest, grid = feed.newest, feed.ground
        if newest is None or grid is None or newest.number == self._drawn.get(key):
            return
        self._drawn[key] = newest.number
        flat = await asyncio.to_thread(_flat, newest.jpeg, grid)
        if flat is not None:
            self._worker.submit_latest(
                ("ground", key), lambda: self._views.draw_ground(key, flat, grid)
            )


def _flat(jpeg: bytes, grid: GroundGrid) -> NDArray[np.uint8] | None:
    """Return a picture of the floor from above; None if the JPEG is broken."""
    try:
        picture = simplejpeg.decode_jpeg(
            jpeg, "RGB", fastdct=True, min_height=MOST_PX, min_width=MOST_PX
        )
    except ValueError:
        return None
    return seen_from_above(picture, grid)
