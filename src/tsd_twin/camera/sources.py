"""Real cameras and files: V4L2 and files with OpenCV, RTSP and HTTP with PyAV."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from tsd_twin.camera.detect import Gray
from tsd_twin.errors import TwinError, needs_extra

_LOG = logging.getLogger(__name__)

STREAM_OPTIONS = {"fflags": "nobuffer", "flags": "low_delay", "max_delay": "0"}
"""Options of FFmpeg: 38 ms instead of 105 from exposure to picture (docs/camera.md)."""
_RETRY_S = 1.0
_OPEN_TIMEOUT_S = 3.0
_READ_TIMEOUT_S = 2.0
_FILE_RATE_HZ = 30.0
"""Rate of a folder of pictures, and of a file without a rate."""
_PICTURES = (".jpg", ".jpeg", ".png")
_STREAMS = ("rtsp://", "rtsps://", "http://", "https://")


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """Picture with its time."""

    picture: NDArray[np.uint8]
    """(height, width), or (height, width, 3): blue, green, red."""
    stamp_ns: int
    """Middle of its exposure, wall clock."""

    @property
    def gray(self) -> Gray:
        """Brightness (height, width)."""
        if self.picture.ndim == 2:
            return self.picture
        return np.asarray(cv2.cvtColor(self.picture, cv2.COLOR_BGR2GRAY), np.uint8)


class Source(Protocol):
    """Stream of pictures."""

    def read(self, timeout_s: float) -> CameraFrame | None:
        """Return the next picture, or the latest one of a live camera; None after the timeout.

        Raises:
            TwinError: If the source has ended.
        """
        ...

    def close(self) -> None:
        """Release the camera."""
        ...


def open_source(where: str, delay_s: float = 0.0, size: tuple[int, int] | None = None) -> Source:
    """Open a camera by number or device, an address, a video file, or a folder of pictures.

    `delay_s` is the time from the middle of an exposure to the arrival of its picture; `size` asks
    a device for width and height.

    Raises:
        TwinError: If it cannot be opened, or PyAV is not installed.
    """
    # Errors are reported as one sentence; OpenCV would print its own lines as well.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    if where.startswith(_STREAMS):
        return LiveSource(StreamReader(where), delay_s)
    if where.isdigit() or where.startswith("/dev/"):
        return LiveSource(DeviceReader(where, size), delay_s)
    return FileSource(where)


class Reader(Protocol):
    """Blocking reader of a live camera; used by one thread."""

    def pictures(self) -> Iterator[NDArray[np.uint8]]:
        """Yield pictures as they arrive; ends when the camera is lost."""
        ...


class DeviceReader:
    """Camera of Video4Linux."""

    def __init__(self, where: str, size: tuple[int, int] | None) -> None:
        """Raises:
        TwinError: If there is no such camera.
        """
        self._where = int(where) if where.isdigit() else where
        self._size = size
        self._opened: cv2.VideoCapture | None = self._open()
        if self._opened is None:
            raise TwinError(f"no camera at {where}: v4l2-ctl --list-devices shows those that exist")

    def pictures(self) -> Iterator[NDArray[np.uint8]]:
        """Yield pictures until the camera is unplugged."""
        capture, self._opened = self._opened or self._open(), None
        if capture is None:
            return
        try:
            yield from _frames_of(capture)
        finally:
            capture.release()

    def _open(self) -> cv2.VideoCapture | None:
        capture = cv2.VideoCapture(self._where, cv2.CAP_V4L2)
        if not capture.isOpened():
            return None
        # Uncompressed pictures of this size exceed USB 2 above 10 Hz.
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        if self._size is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        return capture


class StreamReader:
    """RTSP or HTTP stream, read by PyAV without buffering."""

    def __init__(self, address: str) -> None:
        """Raises:
        MissingExtraError: If PyAV is not installed.
        """
        with needs_extra(f"A stream such as {address.split(':')[0]}://", "camera-stream"):
            import av
        self._av: Any = av
        self._address = address

    def pictures(self) -> Iterator[NDArray[np.uint8]]:
        """Yield pictures until the stream ends or stalls."""
        options = dict(STREAM_OPTIONS)
        if self._address.startswith("rtsp"):
            options["rtsp_transport"] = "tcp"  # Lost datagrams would smear pictures with tags.
        try:
            with self._av.open(
                self._address, options=options, timeout=(_OPEN_TIMEOUT_S, _READ_TIMEOUT_S)
            ) as container:
                stream = container.streams.video[0]
                stream.thread_type = "NONE"  # Threads of a decoder hold frames back.
                for frame in container.decode(stream):
                    yield frame.to_ndarray(format="bgr24")
        except (self._av.error.FFmpegError, OSError, IndexError) as error:
            _LOG.info("%s: %s", self._address, error)


class LiveSource:
    """Newest picture of a live camera, read on a separate thread; opens a lost camera again."""

    def __init__(self, reader: Reader, delay_s: float) -> None:
        self._reader = reader
        self._delay_ns = round(delay_s * 1e9)
        self._newest: CameraFrame | None = None
        self._arrived = threading.Condition()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def read(self, timeout_s: float) -> CameraFrame | None:
        """Return the latest picture, at most once; None after the timeout."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._newest is not None, timeout_s)
            frame, self._newest = self._newest, None
        return frame

    def close(self) -> None:
        """Stop reading; a reader that hangs is left to end with the process."""
        self._stop.set()
        self._thread.join(_READ_TIMEOUT_S)

    def _run(self) -> None:
        while not self._stop.is_set():
            for picture in self._reader.pictures():
                frame = CameraFrame(picture, time.time_ns() - self._delay_ns)
                with self._arrived:
                    self._newest = frame
                    self._arrived.notify()
                if self._stop.is_set():
                    return
            self._stop.wait(_RETRY_S)


class FileSource:
    """Video file or folder of pictures, played at its own rate."""

    def __init__(self, where: str) -> None:
        """Raises:
        TwinError: If it contains no pictures.
        """
        path = Path(where)
        self._rate_hz = _FILE_RATE_HZ
        self._capture: cv2.VideoCapture | None = None
        if path.is_dir():
            self._pictures = iter(read_folder(path))
        else:
            capture = cv2.VideoCapture(where)
            if not path.exists() or not capture.isOpened():
                raise TwinError(f"{where} is not a video, a folder of pictures or a camera")
            self._capture = capture
            self._rate_hz = capture.get(cv2.CAP_PROP_FPS) or _FILE_RATE_HZ
            self._pictures = _frames_of(capture)
        self._next_s = time.monotonic()

    def read(self, timeout_s: float) -> CameraFrame | None:
        """Return the next picture at its time, or None if this takes longer than the timeout.

        Raises:
            TwinError: If the file has ended.
        """
        wait_s = self._next_s - time.monotonic()
        time.sleep(max(0.0, min(wait_s, timeout_s)))
        if wait_s > timeout_s:
            return None
        picture = next(self._pictures, None)
        if picture is None:
            raise TwinError("the file has ended")
        self._next_s = max(self._next_s + 1.0 / self._rate_hz, time.monotonic() - 1.0)
        return CameraFrame(picture, time.time_ns())

    def close(self) -> None:
        """Close the file."""
        if self._capture is not None:
            self._capture.release()


def read_folder(folder: Path) -> list[NDArray[np.uint8]]:
    """Return the pictures in a folder, sorted by name.

    Raises:
        TwinError: If the folder has no pictures, or one cannot be read.
    """
    files = sorted(each for each in folder.iterdir() if each.suffix.lower() in _PICTURES)
    if not files:
        raise TwinError(f"{folder} has no pictures: {', '.join(_PICTURES)}")
    pictures = [(file, cv2.imread(str(file), cv2.IMREAD_COLOR)) for file in files]
    for file, picture in pictures:
        if picture is None:
            raise TwinError(f"{file} is not a picture")
    return [np.asarray(picture, np.uint8) for _, picture in pictures]


def _frames_of(capture: cv2.VideoCapture) -> Iterator[NDArray[np.uint8]]:
    while True:
        got, picture = capture.read()
        if not got:
            return
        yield np.asarray(picture, np.uint8)
