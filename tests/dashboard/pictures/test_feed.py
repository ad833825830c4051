"""Camera pictures reach each page that shows them, latest first, without delaying others."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Coroutine
from typing import Any, cast

import numpy as np
import pytest
import simplejpeg

from tsd_twin.bus import Bus
from tsd_twin.dashboard.pictures import feed
from tsd_twin.dashboard.pictures.feed import HEADER, Cameras, Viewer
from tsd_twin.messages.pictures import (
    GROUND_KEYS,
    CameraName,
    CompressedImage,
    GroundGrid,
    encode_clock,
    encode_ground,
    encode_picture,
)
from tsd_twin.messages.topics import Sample

CEILING = CameraName("ceiling")
PIXELS = np.tile(np.linspace(0, 255, 640).astype(np.uint8)[None, :, None], (360, 1, 3))
BEHIND_NS = 3600 * 10**9
JPEG = simplejpeg.encode_jpeg(PIXELS, 80, "BGR")
OUTLINES = json.dumps({"size": [640, 360], "tags": []}).encode()


class OneCamera:
    """Bus with one camera: counts subscribers, and publishes pictures from the test."""

    def __init__(self) -> None:
        self.takers: list[Callable[[Sample], None]] = []
        self.opened = 0
        self.closed = False
        self.answer: Callable[[], bytes | None] = lambda: None
        """Answer to a question for its clock."""

    def request(
        self, key: str, payload: bytes, take: Callable[[bytes | None], None], _: float
    ) -> None:
        assert (key, payload) == (CEILING.clock_key, b"")
        take(self.answer())

    def subscribe_liveliness(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        if key == "floor/*/alive":
            self.on_change = on_change
            on_change(CEILING.alive_key, True)

    def subscribe(self, key: str, taker: Callable[[Sample], None]) -> Callable[[], None]:
        if key == GROUND_KEYS:
            self.say_ground = taker
            return lambda: None
        assert key == CEILING.key
        self.takers.append(taker)
        return lambda: self.takers.remove(taker)

    def close(self) -> None:
        self.closed = True

    def open(self) -> Bus:
        self.opened += 1
        return cast("Bus", self)

    def publish(self, data: bytes = JPEG, age_s: float = 0.0, attachment: bytes = OUTLINES) -> None:
        stamp_ns = time.time_ns() - round(1e9 * age_s)
        self.send(encode_picture(CompressedImage("ceiling", data, stamp_ns)), attachment)

    def send(self, payload: bytes, attachment: bytes = b"") -> None:
        for taker in list(self.takers):
            taker(Sample(CEILING.key, payload, attachment))


def run(work: Callable[[OneCamera, Cameras], Coroutine[Any, Any, None]]) -> OneCamera:
    camera = OneCamera()

    async def main() -> None:
        cameras = Cameras(camera.open(), camera.open)
        camera.opened = 0
        await asyncio.sleep(0)
        await work(camera, cameras)
        await cameras.close()

    asyncio.run(asyncio.wait_for(main(), 10.0))
    return camera


def number_of(message: bytes) -> int:
    return HEADER.unpack_from(message)[2]


def test_it_is_subscribed_to_only_while_somebody_looks() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        assert (camera.opened, camera.takers) == (0, [])
        async with one.watched(), one.watched():
            assert (camera.opened, len(camera.takers)) == (1, 1)
        assert camera.takers == []
        async with one.watched():
            assert (camera.opened, len(camera.takers)) == (1, 1)

    assert run(work).closed


def test_a_page_that_was_away_gets_the_newest_picture_and_none_twice() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        async with one.watched():
            viewer = Viewer(one)
            for _ in range(5):
                camera.publish()
            assert number_of(await viewer.next(640)) == 5
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(viewer.next(640), 0.05)
            camera.publish()
            assert number_of(await viewer.next(640)) == 6

    run(work)


def test_sockets_of_one_page_take_turns() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        async with one.watched():
            viewer = Viewer(one)
            asked = [asyncio.create_task(viewer.next(640)) for _ in range(8)]
            for _ in range(8):
                await asyncio.sleep(0.01)
                camera.publish()
            numbers = [number_of(each) for each in await asyncio.gather(*asked)]
            assert sorted(numbers) == list(range(1, 9))

    run(work)


def test_a_size_is_encoded_once_for_all_who_ask_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[int] = []
    encode = feed.jpeg_of

    def counted(*arguments: Any) -> bytes:
        encoded.append(1)
        return encode(*arguments)

    monkeypatch.setattr(feed, "jpeg_of", counted)

    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        async with one.watched():
            asked = [asyncio.create_task(Viewer(one).next(640)) for _ in range(20)]
            await asyncio.sleep(0.01)
            camera.publish()
            pictures = [
                each[HEADER.size + len(OUTLINES) :] for each in await asyncio.gather(*asked)
            ]
            assert len(set(pictures)) == 1
            assert simplejpeg.decode_jpeg(pictures[0]).shape[:2] == (135, 240)

    run(work)
    assert len(encoded) == 1


def test_a_page_that_does_not_ask_keeps_nobody_waiting() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        async with one.watched(), one.watched():
            Viewer(one)  # Never requests pictures.
            viewer = Viewer(one)
            for number in range(1, 30):
                camera.publish()
                assert number_of(await viewer.next(640)) == number

    run(work)


@pytest.mark.parametrize(
    "payload", [b"", b"x" * 100, encode_picture(CompressedImage("c", b"\xff\xd8\xff", 0))]
)
def test_what_is_no_picture_is_ignored(payload: bytes) -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        async with one.watched():
            camera.send(payload)
            camera.publish(attachment=b"x" * 10_000)
            assert number_of(await Viewer(one).next(640)) == 1
            assert one.newest is not None
            assert one.newest.outlines == b""

    run(work)


@pytest.mark.parametrize(
    ("answer", "age_s"),
    [
        (lambda: encode_clock(time.time_ns() - BEHIND_NS), 0.2),
        (lambda: None, 3600.2),
        (lambda: b"soon", 3600.2),
        (lambda: encode_clock(-BEHIND_NS), 3600.2),
    ],
)
def test_an_age_counts_by_the_clock_of_the_camera(
    answer: Callable[[], bytes | None], age_s: float
) -> None:
    """Its clock is an hour behind; without a valid answer, its pictures look as old."""

    async def work(camera: OneCamera, cameras: Cameras) -> None:
        camera.answer = answer
        (one,) = cameras.feeds.values()
        began_s = time.monotonic()
        async with one.watched():
            camera.publish(age_s=3600.2)
            age_ms = HEADER.unpack_from(await Viewer(one).next(640))[0]
        assert abs(1e-3 * age_ms - age_s) <= time.monotonic() - began_s

    run(work)


def test_the_floor_of_a_camera_is_known_once_it_says_where_it_is() -> None:
    grid = GroundGrid((0.0, 0.0), (1.0, 1.0), [[(0.0, 0.0)] * 2] * 2)

    async def work(camera: OneCamera, cameras: Cameras) -> None:
        for key, payload in (
            (CEILING.ground_key, b"broken"),
            ("floor/other/ground", encode_ground(grid)),
        ):
            camera.say_ground(Sample(key, payload, b""))
            await asyncio.sleep(0)
            assert cameras.feeds[CEILING.key].ground is None
        camera.say_ground(Sample(CEILING.ground_key, encode_ground(grid), b""))
        await asyncio.sleep(0)
        assert cameras.feeds[CEILING.key].ground == grid

    run(work)


def test_whoever_looks_at_a_lost_camera_sees_it_again_when_it_comes_back() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        async with one.watched():
            camera.on_change(CEILING.alive_key, False)
            await asyncio.sleep(0)
            assert not cameras.feeds
            camera.on_change(CEILING.alive_key, True)
            await asyncio.sleep(0)
            assert list(cameras.feeds.values()) == [one]
            camera.publish()
            assert number_of(await Viewer(one).next(640)) == 1
        camera.on_change(CEILING.alive_key, False)
        camera.on_change(CEILING.alive_key, True)
        await asyncio.sleep(0)
        assert list(cameras.feeds.values()) != [one]

    run(work)
