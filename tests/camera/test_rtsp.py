"""Pictures of a real RTSP server, GStreamer's."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Generator

import numpy as np
import pytest

from tests.camera import rtsp_server
from tests.camera.rtsp_server import BITS, COLUMNS, SQUARE_PX
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.camera.sources import CameraFrame, Source, open_source

pytestmark = pytest.mark.system

PYTHON = "/usr/bin/python3"
"""Python with the bindings of GStreamer, which Debian installs for its own."""
FRAMES = 200
OLD_S = 0.080
FOUND_S = 5.0
"""Time in which a server that is back must be found."""
GONE_S = 4.0


class Server:
    """RTSP server in a process."""

    def __init__(self) -> None:
        self.address, self.port = "", "0"
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [PYTHON, rtsp_server.__file__, self.port], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().split()[-1]
        self.port = self.address.split(":")[2].split("/")[0]

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def server() -> Generator[Server]:
    server = Server()
    yield server
    server.kill()


@pytest.fixture
def source(server: Server) -> Generator[Source]:
    source = open_source(server.address)
    yield source
    source.close()


def next_frame(source: Source) -> CameraFrame:
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if (frame := source.read(1.0)) is not None:
            return frame
    raise AssertionError("no picture")


def shown_s(frame: CameraFrame) -> float:
    """Return the time in the squares of a picture."""
    height = BITS // COLUMNS * SQUARE_PX
    squares = frame.gray[SQUARE_PX // 2 : height : SQUARE_PX, SQUARE_PX // 2 :: SQUARE_PX]
    ms = int("".join("1" if level > 127 else "0" for level in squares.ravel()), 2)
    return 1e-3 * ((time.time_ns() // 1_000_000 >> BITS << BITS) + ms)


def age_s(frame: CameraFrame) -> float:
    return time.time() - shown_s(frame)


def test_p99_of_the_age_of_pictures_is_below_80_ms(source: Source) -> None:
    next_frame(source)  # Opening the stream takes a second.
    with WithheldTime(os.getpid()) as withheld:
        ages_s = [age_s(next_frame(source)) for _ in range(FRAMES)]
    assert min(ages_s) > 0.0
    assert np.percentile(ages_s, 99) < OLD_S + withheld.total_s


def hang(server: Server) -> Callable[[], None]:
    server.process.send_signal(signal.SIGSTOP)
    return lambda: server.process.send_signal(signal.SIGCONT)


def end(server: Server) -> Callable[[], None]:
    server.kill()
    return server.start


@pytest.mark.parametrize("go", [end, hang])
def test_a_server_that_is_back_is_found_within_5_s(
    server: Server, source: Source, go: Callable[[Server], Callable[[], None]]
) -> None:
    next_frame(source)
    come_back = go(server)
    time.sleep(GONE_S)
    come_back()
    with WithheldTime(os.getpid()) as withheld:
        back_s = time.time()
        while shown_s(next_frame(source)) < back_s:
            assert time.time() < back_s + PATIENCE_S, "no new picture"
        took_s = time.time() - back_s
    assert took_s < FOUND_S + withheld.total_s
