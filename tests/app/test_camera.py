"""`tsd-camera` as a user runs it."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import simplejpeg

from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, client_config
from tsd_twin.camera.setup_file import read_setup
from tsd_twin.messages.pictures import INFO_TYPE, CameraName, decode_clock, decode_picture
from tsd_twin.messages.ros_types import decode_cdr
from tsd_twin.messages.status import decode_status
from tsd_twin.messages.topics import STATUS, Sample

pytestmark = pytest.mark.system

Start = Callable[..., Program]
CEILING = CameraName("ceiling")


def test_a_simulated_camera_tells_a_robot_where_it_is_and_shows_it(start: Start) -> None:
    mock = start("tsd_mock", "--listen", "tcp/127.0.0.1:0")
    endpoint = mock.ready().split()[-1]
    camera = start("tsd_camera", "--simulate", "--connect", endpoint, "--tag", "3=tsd")
    assert CEILING.key in camera.ready()
    used, described = threading.Event(), threading.Event()
    pictures: list[Sample] = []
    shown = threading.Event()

    def look(sample: Sample) -> None:
        pose_sensor = decode_status(sample.payload).pose_sensor
        if pose_sensor is not None and pose_sensor.used > 5:
            used.set()

    def take(sample: Sample) -> None:
        if any(tag["robot"] == "tsd" for tag in json.loads(sample.attachment)["tags"]):
            pictures.append(sample)
            shown.set()

    def describe(sample: Sample) -> None:
        assert decode_cdr(sample.payload, INFO_TYPE).width == 1280
        described.set()

    with Bus(client_config([endpoint])) as bus:
        bus.subscribe(STATUS.key("tsd"), look)
        bus.subscribe(CEILING.key, take)
        bus.subscribe(CEILING.info_key, describe)
        assert all(each.wait(PATIENCE_S) for each in (used, shown, described))
        assert bus.living_tokens(CEILING.alive_key) == [CEILING.alive_key]
        asked_ns = time.time_ns()
        assert asked_ns <= decode_clock(bus.query(CEILING.clock_key, b"")) <= time.time_ns()
    picture = simplejpeg.decode_jpeg(decode_picture(pictures[0].payload).data, "GRAY")
    assert picture.shape[:2] == (720, 1280)
    assert camera.end(signal.SIGTERM) == 0
    assert mock.end(signal.SIGTERM) == 0


def test_a_camera_is_calibrated_in_two_steps_and_sheets_are_printed(
    start: Start, tmp_path: Path
) -> None:
    file = str(tmp_path / "ceiling.toml")
    flags = ("--simulate", "--seed", "5", "--across", "60", "--file", file)
    lens = start("tsd_camera", "calibrate", "lens", *flags)
    assert lens.wait() == 0
    assert read_setup(file).place is None
    floor = start("tsd_camera", "calibrate", "floor", *flags)
    assert floor.wait() == 0
    assert any(line.startswith("in the middle: ") for line in floor.output)
    height_m = float(read_setup(file).view.place.position_m[2])
    assert height_m == pytest.approx(2.5, abs=0.02)
    assert (tmp_path / "ceiling.floor.png").stat().st_size > 0
    sheet = tmp_path / "tag.pdf"
    assert start("tsd_camera", "print", "--tag", "3", "--out", str(sheet)).wait() == 0
    assert sheet.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--simulate", "--tag", "three"], "3=tsd@0.31"),
        (["--source", "nothing.mp4"], "nothing.mp4"),
        (["calibrate", "floor", "--file", "nothing.toml"], "nothing.toml"),
    ],
)
def test_a_mistake_is_one_sentence(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    camera = start("tsd_camera", *flags)
    assert camera.wait() == 1
    assert words in camera.sentence
