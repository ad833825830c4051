"""Cameras on the bus, and their latest pictures; event loop only."""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from enum import IntEnum
from weakref import WeakSet

import msgspec
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from tsd_twin.bus import Bus
from tsd_twin.dashboard.pictures.camera_clock import CameraClock
from tsd_twin.dashboard.pictures.h264 import MAX_PIXELS, MIN_SIDE, H264Stream, is_available
from tsd_twin.dashboard.pictures.link_budget import LinkBudget, PictureFormat
from tsd_twin.errors import BusError
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pictures import (
    ALIVE_KEYS,
    GROUND_KEYS,
    CameraName,
    GroundGrid,
    decode_clock,
    decode_ground,
    decode_picture,
)
from tsd_twin.messages.topics import Sample

MAX_CAMERAS = 64
LARGEST_OUTLINES = 8192
MOST_PIXELS = 4096 * 4096
"""A JPEG of a few kilobytes may claim 65,535 x 65,535, and would be decoded into gigabytes."""
HEADER = struct.Struct("<ddIII")
"""Header of a picture to a page: age and time when it is sent, ms; sequence number; length of the
outlines in bytes; `Coding`. Outlines and picture follow."""
MAX_VIDEOS = 4
"""Most pages of a dashboard that get H.264, which is encoded for each."""
_CLOCK_PERIOD_S = 1.0
"""Period of the questions for a camera's clock, and their timeout."""


class Coding(IntEnum):
    """Coding of a picture to a page."""

    JPEG = 0
    H264 = 1
    """Depends on the pictures before on the same WebSocket, from the latest key frame on."""
    H264_KEY = 2


class _Outline(msgspec.Struct):
    corners: list[tuple[float, float]]
    robot: str | None
    refused: str | None


class _Outlines(msgspec.Struct):
    """Tags in a picture, as far as pages read them."""

    size: tuple[int, int]
    tags: list[_Outline]


_OUTLINES = msgspec.json.Decoder(_Outlines)


@dataclass(slots=True, eq=False)
class Picture:
    """Picture of a camera, and its encodings."""

    number: int
    jpeg: bytes
    outlines: bytes
    """JSON of tags that were found in it, as `encode_outlines` makes it, or nothing."""
    width: int
    height: int
    exposed_s: float
    """Middle of the exposure on the monotonic clock of this machine."""
    encoded: dict[PictureFormat, asyncio.Future[bytes]] = field(
        default_factory=dict[PictureFormat, asyncio.Future[bytes]]
    )


class PictureSession:
    """Session on the bus for pictures alone, which cannot delay states; opened at the first use."""

    def __init__(self, opened: Callable[[], Bus]) -> None:
        """`opened` opens it, and may block."""
        self._open = opened
        self._bus: Bus | None = None
        self._opening = asyncio.Lock()

    async def bus(self) -> Bus:
        """Return the session.

        Raises:
            BusError: If it cannot be opened.
        """
        async with self._opening:
            if self._bus is None:
                self._bus = await asyncio.to_thread(self._open)
        return self._bus

    async def close(self) -> None:
        """Close it, if it was opened."""
        async with self._opening:
            if self._bus is not None:
                await asyncio.to_thread(self._bus.close)


class Encoders:
    """Threads that encode pictures, and the pages that get H.264."""

    def __init__(self, threads: Executor) -> None:
        self.threads = threads
        self.videos = WeakSet[Viewer]()
        self._is_available: Future[bool] | None = None

    def permits_video(self, viewer: Viewer) -> bool:
        """Return whether a page may get H.264; the first call only starts a check for PyAV."""
        if self._is_available is None:
            self._is_available = self.threads.submit(is_available)
        if not (self._is_available.done() and self._is_available.result()):
            return False
        return viewer in self.videos or len(self.videos) < MAX_VIDEOS


class CameraFeed:
    """A camera: subscribed to while it is watched; keeps the latest picture."""

    def __init__(self, name: CameraName, session: PictureSession, encoders: Encoders) -> None:
        self.name = name
        self.newest: Picture | None = None
        self.ground: GroundGrid | None = None
        """Where its pictures show the floor, if it is calibrated."""
        self.is_alive = True
        self.encoders, self._session = encoders, session
        self._loop = asyncio.get_running_loop()
        self._clock = CameraClock()
        self._asked_s = -math.inf
        self._bus: Bus | None = None
        self._viewers = 0
        self._number = 0
        self._end: Callable[[], None] | None = None
        self._arrived = asyncio.Event()

    @property
    def is_watched(self) -> bool:
        """Whether a page watches it."""
        return self._viewers > 0

    @contextlib.asynccontextmanager
    async def watched(self) -> AsyncGenerator[None]:
        """Subscribe to the pictures during this context."""
        self._viewers += 1
        try:
            self._bus = bus = await self._session.bus()
            self._ask_for_clock(bus)
            if self._end is None:
                self._end = bus.subscribe(self.name.key, self._hand_over)
            yield
        finally:
            self._viewers -= 1
            if self._viewers == 0 and self._end is not None:
                self._end()
                self._end = self.newest = None

    async def newer_than(self, number: int) -> Picture:
        """Wait for a picture with a higher number, and return the latest."""
        while self.newest is None or self.newest.number <= number:
            await self._arrived.wait()
        return self.newest

    async def encoded(self, picture: Picture, chosen: PictureFormat) -> bytes:
        """Return a picture in a format; it is encoded once for all who ask.

        Raises:
            ValueError: If its data are broken.
        """
        if chosen.quality is None:
            return picture.jpeg
        if chosen not in picture.encoded:
            picture.encoded[chosen] = self._loop.run_in_executor(
                self.encoders.threads, jpeg_of, picture, chosen.eighths, chosen.quality
            )
        return await asyncio.shield(picture.encoded[chosen])

    async def filmed(
        self, picture: Picture, chosen: PictureFormat, stream: H264Stream
    ) -> tuple[bytes, Coding]:
        """Return a picture as the next one of a stream.

        Raises:
            ValueError: If its data are broken.
        """
        most_bytes = chosen.bytes_share * len(picture.jpeg)

        def encode() -> tuple[bytes, bool]:
            return stream.encode(pixels_of(picture, chosen.eighths), most_bytes)

        data, is_key = await self._loop.run_in_executor(self.encoders.threads, encode)
        return data, Coding.H264_KEY if is_key else Coding.H264

    def _hand_over(self, sample: Sample) -> None:
        self._loop.call_soon_threadsafe(self._add, sample)

    def _ask_for_clock(self, bus: Bus) -> None:
        asked_s = time.monotonic()
        if asked_s - self._asked_s < _CLOCK_PERIOD_S:
            return
        self._asked_s = asked_s

        def take(answer: bytes | None) -> None:
            answered_s = time.monotonic()
            if answer is not None:
                self._loop.call_soon_threadsafe(self._take_clock, asked_s, answer, answered_s)

        with contextlib.suppress(BusError):  # The session closes.
            bus.request(self.name.clock_key, b"", take, _CLOCK_PERIOD_S)

    def _take_clock(self, asked_s: float, answer: bytes, answered_s: float) -> None:
        with contextlib.suppress(MessageError):  # Anybody on the bus can send bytes.
            self._clock.read(asked_s, 1e-9 * decode_clock(answer), answered_s)

    def _add(self, sample: Sample) -> None:
        if self._bus is not None:
            self._ask_for_clock(self._bus)
        try:
            message = decode_picture(sample.payload)
            height, width = map(int, simplejpeg.decode_jpeg_header(message.data)[:2])
        except (MessageError, ValueError):
            return  # Anybody on the bus can send bytes.
        if not 0 < height * width <= MOST_PIXELS:
            return
        self._number += 1
        outlines = sample.attachment if _are_outlines(sample.attachment) else b""
        exposed_s = self._clock.exposed_s(1e-9 * message.stamp_ns, time.time(), time.monotonic())
        self.newest = Picture(self._number, message.data, outlines, width, height, exposed_s)
        self._arrived.set()  # Wakes all who wait now; the next ones wait for the next picture.
        self._arrived.clear()


class Viewer:
    """A page that looks at a camera, over one socket or several that take turns."""

    def __init__(self, camera: CameraFeed) -> None:
        self.budget = LinkBudget()
        self._camera = camera
        self._number = 0

    async def next(self, width: int, stream: H264Stream | None = None) -> bytes:
        """Wait for a picture that this page has not had, and return it with its header.

        `stream` is the one of the socket, if the page can show H.264.
        """
        while True:
            picture = await self._camera.newer_than(self._number)
            if picture.number <= self._number:
                continue  # Another socket of this page, which waited as well, has taken it.
            if (waits_s := self.budget.waits_s(time.monotonic())) > 0.0:
                await asyncio.sleep(waits_s)
                continue  # A newer one may have come.
            self._number = picture.number
            chosen = self.budget.format_for(
                len(picture.jpeg), picture.width, width, video=self._permits(picture, stream)
            )
            try:
                data, coding = await self._encoded(picture, chosen, stream)
            except ValueError:
                continue  # Broken after its header: the page waits for the next one.
            break
        now_s = time.monotonic()
        age_ms = 1000.0 * (now_s - picture.exposed_s)
        header = HEADER.pack(age_ms, 1000.0 * now_s, picture.number, len(picture.outlines), coding)
        message = header + picture.outlines + data
        if not chosen.is_video:
            self.budget.encoded(chosen, len(picture.jpeg), len(message))
        self.budget.sent(len(message), now_s)
        return message

    def _permits(self, picture: Picture, stream: H264Stream | None) -> bool:
        height, width = picture.height, picture.width
        if stream is None or min(height, width) < MIN_SIDE or height * width > MAX_PIXELS:
            return False
        return self._camera.encoders.permits_video(self)

    async def _encoded(
        self, picture: Picture, chosen: PictureFormat, stream: H264Stream | None
    ) -> tuple[bytes, Coding]:
        videos = self._camera.encoders.videos
        if stream is not None and chosen.is_video:
            videos.add(self)
            return await self._camera.filmed(picture, chosen, stream)
        videos.discard(self)
        if stream is not None:
            stream.end()
        return await self._camera.encoded(picture, chosen), Coding.JPEG


class Cameras:
    """All cameras on the bus, by key."""

    def __init__(self, bus: Bus, opened: Callable[[], Bus]) -> None:
        """`bus` shows which cameras there are; `opened` opens a session for their pictures."""
        self.on_changed: Callable[[], None] = lambda: None
        """Called when a camera appears or disappears."""
        self._session = PictureSession(opened)
        self._loop = asyncio.get_running_loop()
        self._encoders = Encoders(ThreadPoolExecutor(2, "pictures"))
        self._feeds: dict[str, CameraFeed] = {}
        for keys in ALIVE_KEYS:
            bus.subscribe_liveliness(keys, self._hand_over)
        bus.subscribe(GROUND_KEYS, self._hand_over_ground)

    @property
    def feeds(self) -> Mapping[str, CameraFeed]:
        """Cameras that are there, by the keys of their pictures."""
        return {key: feed for key, feed in self._feeds.items() if feed.is_alive}

    async def close(self) -> None:
        """Close the session, once nobody looks."""
        self._encoders.threads.shutdown(wait=False, cancel_futures=True)
        await self._session.close()

    def _hand_over(self, key: str, there: bool) -> None:
        self._loop.call_soon_threadsafe(self._change, key, there)

    def _hand_over_ground(self, sample: Sample) -> None:
        self._loop.call_soon_threadsafe(self._take_ground, sample)

    def _take_ground(self, sample: Sample) -> None:
        name = CameraName.of(sample.key)
        feed = self._feeds.get(name.key) if name is not None else None
        if feed is None:
            return
        try:
            feed.ground = decode_ground(sample.payload)
        except MessageError:
            return  # Anybody on the bus can send bytes.

    def _change(self, key: str, there: bool) -> None:
        name = CameraName.of(key)
        if name is None or (there and len(self.feeds) >= MAX_CAMERAS):
            return
        if there:
            self._feeds.setdefault(name.key, CameraFeed(name, self._session, self._encoders))
        if name.key in self._feeds:
            self._feeds[name.key].is_alive = there
        # A page that watches a lost camera sees it again once it is back.
        self._feeds = {
            key: feed for key, feed in self._feeds.items() if feed.is_alive or feed.is_watched
        }
        self.on_changed()


def _are_outlines(data: bytes) -> bool:
    """Return whether an attachment is what pages read: anybody on the bus can send one."""
    try:
        _OUTLINES.decode(data)
    except msgspec.MsgspecError:
        return False
    return len(data) <= LARGEST_OUTLINES


def pixels_of(picture: Picture, eighths: int) -> NDArray[np.uint8]:
    """Decode a picture in a smaller size; BGR.

    Raises:
        ValueError: If its data are broken.
    """
    height, width = (math.ceil(n * eighths / 8) for n in (picture.height, picture.width))
    return simplejpeg.decode_jpeg(
        picture.jpeg, "BGR", fastdct=True, min_height=height, min_width=width
    )


def jpeg_of(picture: Picture, eighths: int, quality: int) -> bytes:
    """Return a picture as a smaller JPEG.

    Raises:
        ValueError: If its data are broken.
    """
    pixels = pixels_of(picture, eighths)
    return simplejpeg.encode_jpeg(pixels, quality, "BGR", colorsubsampling="420", fastdct=True)
