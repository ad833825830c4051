"""Lanes of a timeline: mode, driver and speed at evenly spaced times."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from tests.support.recorded_drives import RecordedDrive
from tsd_twin.messages import topics
from tsd_twin.messages.status import LeaseStatus, RobotStatus, encode_status
from tsd_twin.recording.details import RobotLanes, read_lanes
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.recording.reader import RecordingReader


def lanes_of(path: Path, count: int) -> RobotLanes:
    with closing(RecordingReader(path)) as reader:
        return read_lanes(reader, count)[1]["tsd"]


def test_lanes_show_each_mode_and_driver_at_its_time(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap")
    robot = RecordedDrive(file)
    for mode, holder in (("disarmed", None), ("ready", "web-1"), ("driving", "web-1")):
        for _ in range(10):
            robot.now_s += 0.1
            lease = LeaseStatus(holder)
            status = RobotStatus(mode, lease=lease, operators={"web-1": "Ольга"})
            robot.put_state(topics.STATUS, encode_status(status))
    file.close()
    lanes = lanes_of(tmp_path / "a.mcap", 61)
    assert list(dict.fromkeys(lanes.modes)) == ["disarmed", "ready", "driving"]
    assert all(abs(lanes.modes.count(mode) - 20) <= 2 for mode in lanes.modes)
    drivers = dict(zip(lanes.modes, lanes.drivers, strict=True))
    assert drivers == {"disarmed": None, "ready": "Ольга", "driving": "Ольга"}


def test_a_silent_robot_leaves_a_gap_in_all_lanes(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap")
    robot = RecordedDrive(file)
    robot.circle(1)
    robot.now_s += 10.0
    robot.wait(1.0)
    file.close()
    lanes = lanes_of(tmp_path / "a.mcap", 100)
    gap = [i for i, mode in enumerate(lanes.modes) if mode is None]
    assert lanes.modes[0] is not None
    assert lanes.modes[-1] is not None
    assert gap == list(range(gap[0], gap[-1] + 1))
    assert all(lanes.speeds[i] is None for i in gap)
    assert max(speed or 0.0 for speed in lanes.speeds) > 0.1
