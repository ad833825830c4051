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

from tsd_twin.bus import Bus
from tsd_twin.dashboard.pictures.feed import HEADER, CameraFeed, Encoders, PictureSession, Viewer
from tsd_twin.messages.pictures import CameraName, CompressedImage, encode_picture
from tsd_twin.messages.topics import Sample

CEILING = CameraName("ceiling")
PIXELS = np.random.default_rng(1).integers(0, 255, (180, 320, 3), dtype=np.uint8)
JPEG = simplejpeg.encode_jpeg(PIXELS, 30, "BGR")
TAG = {"robot": "tsd", "corners": [[1, 2], [3, 2], [3, 4], [1, 4]], "refused": None}
OUTLINES = {"size": [320, 180], "tags": [TAG]}


def sample(jpeg: bytes, outlines: bytes = b"") -> Sample:
    message = CompressedImage("ceiling", jpeg, time.time_ns())
    return Sample(CEILING.key, encode_picture(message), outlines)


def claims(height: int, width: int) -> bytes:
    """Return a JPEG whose header claims another size."""
    at = JPEG.index(b"\xff\xc0") + 5
    size = height.to_bytes(2, "big") + width.to_bytes(2, "big")
    return JPEG[:at] + size + JPEG[at + 4 :]


def run(work: Callable[[CameraFeed], Coroutine[Any, Any, None]]) -> None:
    def opened() -> Bus:
        raise AssertionError("nobody subscribes")

    async def main() -> None:
        with ThreadPoolExecutor(1) as encoder:
            await work(CameraFeed(CEILING, PictureSession(opened), Encoders(encoder)))

    asyncio.run(asyncio.wait_for(main(), 10.0))


@pytest.mark.parametrize("kept", [0.5, 0.9])
def test_a_picture_that_is_cut_off_is_passed_over(kept: float) -> None:
    async def work(camera: CameraFeed) -> None:
        camera._add(sample(JPEG[: int(kept * len(JPEG))]))
        waits = asyncio.create_task(Viewer(camera).next(100))
        done, _ = await asyncio.wait([waits], timeout=0.1)
        assert not done
        camera._add(sample(JPEG))
        assert HEADER.unpack_from(await waits)[2] == 2

    run(work)


@pytest.mark.parametrize("size", [(65_535, 65_535), (4097, 4096)])
def test_a_picture_that_would_fill_the_memory_is_ignored(size: tuple[int, int]) -> None:
    async def work(camera: CameraFeed) -> None:
        camera._add(sample(claims(*size)))
        assert camera.newest is None
        camera._add(sample(claims(180, 320)))
        assert camera.newest is not None

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
    async def work(camera: CameraFeed) -> None:
        for sent, arrives in ((OUTLINES, True), (outlines, False)):
            text = json.dumps(sent).encode()
            camera._add(sample(JPEG, text))
            assert camera.newest is not None
            assert camera.newest.outlines == (text if arrives else b"")

    run(work)
