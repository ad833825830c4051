"""Details of a recording: drivers, stops and faults from events and statuses."""

from __future__ import annotations

from contextlib import closing
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from tests.support.recorded_drives import RecordedDrive
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.events import Event
from tsd_twin.messages.status import LeaseStatus, RobotStatus, encode_status
from tsd_twin.recording.details import RecordingDetails, read_details
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.recording.reader import RecordingReader

POINTS = 7


def details_of(path: Path) -> RecordingDetails:
    with closing(RecordingReader(path)) as reader:
        return read_details(reader, POINTS)


def recorded(path: Path, *modes: str, coded: bool) -> Path:
    """Record a robot that passes through some modes, each with a status."""
    file = RecordingFile(path)
    robot = RecordedDrive(file)
    for before, after in pairwise(modes):
        robot.now_s += 1.0
        why = because(Code.MODE_CHANGED, before=before, after=after)
        event = Event.of("mode", why, "", robot.now_s)
        robot.put_event(event if coded else msgspec.structs.replace(event, why=None))
        robot.put_state(topics.STATUS, encode_status(RobotStatus(after)))
    file.close()
    return path


@pytest.mark.parametrize("coded", [True, False])
def test_each_stop_and_fault_is_counted_once(tmp_path: Path, *, coded: bool) -> None:
    modes = ("driving", "stopping", "stopped", "disarmed", "ready", "stopped", "fault", "stopped")
    found = details_of(recorded(tmp_path / "a.mcap", *modes, coded=coded))
    assert (found.stops, found.faults, len(found.fault_texts)) == (3, 1, 1)
    quiet = details_of(recorded(tmp_path / "b.mcap", "disarmed", "ready", coded=coded))
    assert (quiet.stops, quiet.faults, quiet.fault_texts) == (0, 0, ())


def test_drivers_are_those_who_had_control_in_order(tmp_path: Path) -> None:
    """The first has control since before the recording; the last only requests it."""
    file = RecordingFile(tmp_path / "a.mcap")
    robot = RecordedDrive(file)
    for holder in ("zoe", "alice", "zoe", None):
        robot.now_s += 1.0
        if holder != "zoe":
            why = because(Code.LEASE_RELEASED, operator="x")
            robot.put_event(Event.of("lease", why, "", robot.now_s))
        lease = LeaseStatus(holder, requested_by="eve")
        robot.put_state(topics.STATUS, encode_status(RobotStatus("ready", lease=lease)))
    file.close()
    found = details_of(tmp_path / "a.mcap")
    assert found.drivers == ("zoe", "alice")


def test_a_track_has_as_many_points_as_asked_for(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap")
    RecordedDrive(file).circle(1)
    file.close()
    assert len(details_of(tmp_path / "a.mcap").tracks["tsd"]) == POINTS
