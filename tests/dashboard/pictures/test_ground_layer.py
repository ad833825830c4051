"""Floor pictures are drawn only while a client shows them."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import simplejpeg

from tsd_twin.dashboard import ground_layer
from tsd_twin.dashboard.ground_layer import GroundLayer
from tsd_twin.errors import BusError
from tsd_twin.messages.pictures import GroundGrid

JPEG = simplejpeg.encode_jpeg(np.full((90, 160, 3), 90, np.uint8), 80, "RGB")
GRID = GroundGrid((0.0, 0.0), (1.6, 0.9), [[(0.0, 1.0), (1.0, 1.0)], [(0.0, 0.0), (1.0, 0.0)]])


class OneCamera:
    def __init__(self) -> None:
        self.watchers, self.failing = 0, False
        self.newest: Any = SimpleNamespace(number=1, jpeg=JPEG)
        self.ground: GroundGrid | None = GRID

    @asynccontextmanager
    async def watched(self) -> Any:
        if self.failing:
            raise BusError("no router")
        self.watchers += 1
        try:
            yield
        finally:
            self.watchers -= 1


class Views:
    def __init__(self) -> None:
        self.show_ground = False
        self.drawn: list[Any] = []

    def draw_ground(self, key: str, picture: Any = None, grid: GroundGrid | None = None) -> None:
        self.drawn.append((key, None if picture is None else picture.shape, grid))


def test_a_picture_is_drawn_once_while_it_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground_layer, "PERIOD_S", 0.0)
    camera, views = OneCamera(), Views()
    cameras = SimpleNamespace(feeds={"floor/a": camera, "floor/b": OneCamera()})
    cameras.feeds["floor/b"].ground = None
    worker = SimpleNamespace(submit_latest=lambda _key, work: work())

    async def pass_time() -> None:
        await asyncio.sleep(0.1)

    async def main() -> None:
        layer = GroundLayer(cast("Any", cameras), cast("Any", views), cast("Any", worker))
        running = asyncio.create_task(layer.run())
        await pass_time()
        assert (camera.watchers, views.drawn) == (0, [])
        views.show_ground, camera.failing = True, True
        await pass_time()
        assert views.drawn == []
        camera.failing = False
        await pass_time()
        assert views.drawn == [("floor/a", (180, 320, 3), GRID)]
        camera.newest = SimpleNamespace(number=2, jpeg=b"broken")
        await pass_time()
        assert len(views.drawn) == 1
        camera.newest = SimpleNamespace(number=3, jpeg=JPEG)
        await pass_time()
        assert len(views.drawn) == 2
        views.show_ground = False
        await pass_time()
        assert (camera.watchers, views.drawn[-1]) == (0, ("floor/a", None, None))
        views.show_ground = True
        await pass_time()
        assert camera.watchers == 1
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert camera.watchers == 0

    asyncio.run(main())
