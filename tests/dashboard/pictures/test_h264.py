"""H.264 reaches pages on thin links; each WebSocket can be decoded without the others."""

from __future__ import annotations

import asyncio
import time
from typing import Any, NamedTuple

import av
import numpy as np
import pytest
import simplejpeg
from av.codec.context import Flags
from numpy.typing import NDArray

from tests.dashboard.pictures.test_feed import OneCamera, run
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.pictures.feed import HEADER, MAX_VIDEOS, Cameras, Coding, Viewer
from tsd_twin.dashboard.pictures.h264 import H264Stream
from tsd_twin.dashboard.pictures.link_budget import VIDEO_FORMATS

HEIGHT, WIDTH = 360, 640
RANDOM = np.random.default_rng(5)
AT = np.arange(2 * WIDTH)[None, :, None], np.arange(HEIGHT)[:, None, None]
WAVES = [RANDOM.uniform(0.01, 0.05, 3) * each for each in AT]
GROUND = (128.0 + 120.0 * np.sin(WAVES[0] + WAVES[1])).astype(np.uint8)
NOISE = RANDOM.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)


def scene(number: int) -> NDArray[np.uint8]:
    """Return a picture of a scene that moves by a block of its JPEG each time."""
    return np.ascontiguousarray(GROUND[:, 8 * number : 8 * number + WIDTH])


def jpeg(number: int) -> bytes:
    return simplejpeg.encode_jpeg(scene(number), 80, "BGR")


CAMERA_BYTES = len(jpeg(0))


class Decoder:
    """FFmpeg's decoder, without delay."""

    def __init__(self) -> None:
        self._context: Any = av.CodecContext.create("h264", "r")
        self._context.thread_type = "NONE"
        self._context.flags |= Flags.low_delay

    def decode(self, data: bytes) -> NDArray[np.uint8]:
        """Return the picture, which depends on no data that are still to come."""
        (frame,) = self._context.decode(av.Packet(data))
        return frame.to_ndarray(format="bgr24")


def difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    return float(np.abs(one.astype(float) - other.astype(float)).mean())


class Sent(NamedTuple):
    number: int
    coding: Coding
    data: bytes


def sent(message: bytes) -> Sent:
    _, _, number, outlines, coding = HEADER.unpack_from(message)
    return Sent(number, Coding(coding), message[HEADER.size + outlines :])


@pytest.mark.parametrize(("height", "width"), [(360, 640), (135, 241), (16, 64)])
def test_each_picture_is_decoded_at_once_and_looks_like_the_one_of_the_camera(
    height: int, width: int
) -> None:
    stream, decoder = H264Stream(), Decoder()
    for number in range(10):
        pixels = np.ascontiguousarray(scene(number)[:height, :width])
        data, is_key = stream.encode(pixels, 20_000)
        shown = decoder.decode(data)
        assert is_key == (number == 0)
        assert shown.shape == (height // 2 * 2, width // 2 * 2, 3)
        assert difference(shown, pixels[: shown.shape[0], : shown.shape[1]]) < 10.0
        assert difference(shown, np.roll(shown, 20, 1)) > 20.0


def test_pictures_keep_to_their_size_in_bytes_also_where_all_is_noise() -> None:
    for most_bytes in (2_000, 10_000):
        stream = H264Stream()
        sizes = [len(stream.encode(np.roll(NOISE, i, 1), most_bytes)[0]) for i in range(20)]
        assert sum(sizes) <= 1.2 * most_bytes * len(sizes)


def test_a_still_scene_takes_few_bytes() -> None:
    stream = H264Stream()
    sizes = [len(stream.encode(scene(0), 20_000)[0]) for _ in range(20)]
    assert sizes[-1] < 0.1 * sizes[0]


@pytest.mark.parametrize(
    ("pixels", "most_bytes"), [(scene(0)[::2, ::2].copy(), 10_000), (scene(0), 20_000)]
)
def test_another_size_or_limit_begins_with_a_key_frame(
    pixels: NDArray[np.uint8], most_bytes: float
) -> None:
    stream = H264Stream()
    keys = [stream.encode(scene(i), 10_000 + 1000 * i)[1] for i in range(5)]
    assert keys == [True, False, False, False, False]
    data, is_key = stream.encode(pixels, most_bytes)
    assert is_key
    assert difference(Decoder().decode(data), pixels) < 10.0


def test_a_stream_that_was_ended_begins_with_a_key_frame() -> None:
    stream = H264Stream()
    stream.encode(scene(0), 10_000)
    stream.end()
    data, is_key = stream.encode(scene(1), 10_000)
    assert is_key
    Decoder().decode(data)


def thin(viewer: Viewer, camera_bytes: int) -> None:
    """Let the link of a page carry H.264 in full size, and no JPEG in this size."""
    per_second = 40.0 * VIDEO_FORMATS[0].bytes_share * camera_bytes
    for _ in range(20):
        viewer.budget.add(10_000, 10_000 / per_second, 0.0, time.monotonic())


async def until_available(cameras: Cameras) -> None:
    (one,) = cameras.feeds.values()
    for _ in range(round(PATIENCE_S / 0.01)):
        if one.encoders.permits_video(Viewer(one)):
            return
        await asyncio.sleep(0.01)
    raise AssertionError("PyAV was not found")


def publish(camera: OneCamera, number: int) -> NDArray[np.uint8]:
    """Publish a picture, and return its pixels."""
    camera.publish(jpeg(number))
    return simplejpeg.decode_jpeg(jpeg(number), "BGR")


def test_each_socket_can_be_decoded_without_the_others() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        await until_available(cameras)
        async with one.watched():
            viewer, streams = Viewer(one), [H264Stream() for _ in range(3)]
            thin(viewer, CAMERA_BYTES)
            decoders = [Decoder(), Decoder()]  # The pictures of the third never arrive.
            for number in range(12):
                pixels = publish(camera, number)
                socket = number % 3
                got = sent(await viewer.next(WIDTH, streams[socket]))
                assert got.number == number + 1
                assert got.coding == (Coding.H264_KEY if number < 3 else Coding.H264)
                if socket < 2:
                    assert difference(decoders[socket].decode(got.data), pixels) < 10.0

    run(work)


def test_a_page_that_was_away_gets_the_newest_picture_by_h264() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        await until_available(cameras)
        async with one.watched():
            viewer, stream, decoder = Viewer(one), H264Stream(), Decoder()
            thin(viewer, CAMERA_BYTES)
            for number in (0, 5, 20):
                publish(camera, number)
                pixels = publish(camera, number + 1)
                got = sent(await viewer.next(WIDTH, stream))
                assert difference(decoder.decode(got.data), pixels) < 10.0
            assert got.number == 6

    run(work)


@pytest.mark.parametrize(
    ("wants", "is_thin", "coding"),
    [
        (True, True, Coding.H264_KEY),
        (False, True, Coding.JPEG),
        (True, False, Coding.JPEG),
    ],
)
def test_only_pages_on_thin_links_that_ask_for_it_get_h264(
    wants: bool, is_thin: bool, coding: Coding
) -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        await until_available(cameras)
        async with one.watched():
            viewer = Viewer(one)
            if is_thin:
                thin(viewer, CAMERA_BYTES)
            else:
                viewer.budget.add(10_000, 1e-6, 0.0, time.monotonic())
            publish(camera, 0)
            got = sent(await viewer.next(WIDTH, H264Stream() if wants else None))
            assert got.coding == coding

    run(work)


def test_pages_beyond_the_most_get_jpeg_until_another_leaves_or_asks_for_jpeg() -> None:
    async def work(camera: OneCamera, cameras: Cameras) -> None:
        (one,) = cameras.feeds.values()
        await until_available(cameras)

        async def coding(viewer: Viewer, stream: H264Stream | None) -> Coding:
            publish(camera, 0)
            return sent(await viewer.next(WIDTH, stream)).coding

        async with one.watched():
            viewers = [Viewer(one) for _ in range(MAX_VIDEOS + 1)]
            for each in viewers:
                thin(each, CAMERA_BYTES)
            last = viewers.pop()
            for number in range(MAX_VIDEOS):
                assert await coding(viewers[number], H264Stream()) is Coding.H264_KEY
            assert await coding(last, H264Stream()) is Coding.JPEG
            assert await coding(viewers[0], None) is Coding.JPEG
            assert await coding(last, H264Stream()) is Coding.H264_KEY
            assert await coding(viewers[0], H264Stream()) is Coding.JPEG
            del viewers[1]
            assert await coding(viewers[0], H264Stream()) is Coding.H264_KEY

    run(work)
