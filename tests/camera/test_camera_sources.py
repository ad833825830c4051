"""Picture sources: folders, video files, streams, and a camera that disconnects and returns."""

from __future__ import annotations

import functools
import http.server
import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.withheld import PATIENCE_S
from tsd_twin.camera.sources import CameraFrame, LiveSource, Source, open_source
from tsd_twin.errors import TwinError

SIZE = 64, 48


def picture(brightness: int) -> NDArray[np.uint8]:
    return np.full((SIZE[1], SIZE[0], 3), brightness, np.uint8)


def video(file: Path, count: int) -> Path:
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 100.0, SIZE)
    for number in range(count):
        writer.write(picture(10 * number))
    writer.release()
    return file


def next_frame(source: Source) -> CameraFrame:
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        frame = source.read(0.2)
        if frame is not None:
            return frame
    raise AssertionError("no picture")


@pytest.mark.parametrize("as_video", [False, True])
def test_a_file_shows_its_pictures_in_order_and_then_ends(tmp_path: Path, as_video: bool) -> None:
    if as_video:
        where = video(tmp_path / "drive.avi", 5)
    else:
        where = tmp_path
        for number in range(5):
            cv2.imwrite(str(tmp_path / f"{number}.png"), picture(10 * number))
    source = open_source(str(where))
    shown = [next_frame(source) for _ in range(5)]
    assert [float(frame.gray.mean()) for frame in shown] == pytest.approx(range(0, 50, 10), abs=3.0)
    assert all(a.stamp_ns < b.stamp_ns for a, b in itertools.pairwise(shown))
    with pytest.raises(TwinError, match="ended"):
        next_frame(source)
    source.close()


@pytest.mark.parametrize("where", ["nothing.mp4", "."])
def test_what_has_no_pictures_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TwinError, match="picture"):
        open_source(where)


class UnsteadyCamera:
    """Camera that shows two pictures each time it is plugged in."""

    def __init__(self) -> None:
        self.opened = 0

    def pictures(self) -> Iterator[NDArray[np.uint8]]:
        self.opened += 1
        for number in range(2):
            yield picture(100 * number + self.opened)


def test_a_camera_that_is_lost_is_opened_again() -> None:
    camera = UnsteadyCamera()
    source = LiveSource(camera, delay_s=0.25)
    before_ns = time.time_ns()
    while float(next_frame(source).picture.mean()) < 102.0:
        assert time.time_ns() < before_ns + PATIENCE_S * 1e9
    assert camera.opened >= 2
    source.close()
    opened = camera.opened
    assert source.read(1.5) is None
    assert camera.opened == opened


def test_a_picture_is_as_old_as_its_camera_is_slow() -> None:
    source = LiveSource(UnsteadyCamera(), delay_s=0.25)
    frame = next_frame(source)
    assert time.time_ns() - frame.stamp_ns >= 0.25e9
    source.close()


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002  Its name there.
        """Print nothing."""


def test_a_stream_is_read_by_its_address(tmp_path: Path) -> None:
    video(tmp_path / "drive.avi", 5)
    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        source = open_source(f"http://127.0.0.1:{server.server_port}/drive.avi")
        assert next_frame(source).picture.shape == (SIZE[1], SIZE[0], 3)
        source.close()
        server.shutdown()
