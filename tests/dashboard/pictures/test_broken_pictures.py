"""Broken pictures from the bus neither stall nor break a page."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import simplejpeg

from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, Publisher, node_config
from tsd_twin.dashboard.pictures.feed import HEADER, CameraFeed, Encoders, PictureSession, Viewer
from tsd_twin.messages.pictures import CameraName, CompressedImage, encode_picture
from tsd_twin.messages.topics import QoS

CEILING = CameraName("ceiling")
PIXELS = np.random.default_rng(1).integers(0, 255, (180, 320, 3), dtype=np.uint8)
JPEG = simplejpeg.encode_jpeg(PIXELS, 30, "BGR")
TAG = {"robot": "tsd", "corners": [[1, 2], [3, 2], [3, 4], [1, 4]], "refused": None}
OUTLINES = {"size": [320, 180], "tags": [TAG]}


def show(pictures: Publisher, jpeg: bytes, outlines: bytes = b"") -> None:
    """Publish a picture as a camera does."""
    pictures.put(encode_picture(CompressedImage("ceiling", jpeg, time.time_ns())), outlines)


def claims(height: int, width: int) -> bytes:
    """Return a JPEG whose header claims another size."""
    at = JPEG.index(b"\xff\xc0") + 5
    size = height.to_bytes(2, "big") + width.to_bytes(2, "big")
    return JPEG[:at] + size + JPEG[at + 4 :]


def run(work: Callable[[CameraFeed, Publisher], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        with Bus(node_config([])) as bus, ThreadPoolExecutor(1) as encoder:
            feed = CameraFeed(CEILING, PictureSession(lambda: bus), Encoders(encoder))
            async with feed.watched():
                await work(feed, bus.publisher(CEILING.key, QoS.DATA))

    asyncio.run(asyncio.wait_for(main(), PATIENCE_S))


@pytest.mark.parametrize("kept", [0.5, 0.9])
def test_a_picture_that_is_cut_off_is_passed_over(kept: float) -> None:
    async def work(camera: CameraFeed, pictures: Publisher) -> None:
        show(pictures, JPEG[: int(kept * len(JPEG))])
        await camera.newer_than(0)
        waits = asyncio.create_task(Viewer(camera).next(100))
        done, _ = await asyncio.wait([waits], timeout=0.1)
        assert not done
        show(pictures, JPEG)
        assert HEADER.unpack_from(await waits)[2] == 2

    run(work)


@pytest.mark.parametrize("size", [(65_535, 65_535), (4097, 4096)])
def test_a_picture_that_would_fill_the_memory_is_ignored(size: tuple[int, int]) -> None:
    async def work(camera: CameraFeed, pictures: Publisher) -> None:
        show(pictures, claims(*size))
        show(pictures, claims(180, 320))
        picture = await camera.newer_than(0)
        assert (picture.number, picture.height, picture.width) == (1, 180, 320)

    run(work)


@pytest.mark.parametrize(
    "outlines",
    [
        {},
        {"size": [320, 180]},
        {"size": None, "tags": []},
        {"size": [320, 180], "tags": None},
        {"size": [320, 180], "tags": [{**TAG, "corners": None}]},
        {"size": [320, 180], "tags": [TAG] * 1000},
    ],
)
def test_outlines_that_a_page_cannot_draw_do_not_reach_it(outlines: dict[str, Any]) -> None:
    async def work(camera: CameraFeed, pictures: Publisher) -> None:
        for number, (sent, arrives) in enumerate(((OUTLINES, True), (outlines, False))):
            text = json.dumps(sent).encode()
            show(pictures, JPEG, text)
            picture = await camera.newer_than(number)
            assert picture.outlines == (text if arrives else b"")

    run(work)
