"""The exported page contains exactly the events of its part of a recording."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.support.recorded_drives import START_NS, RecordedDrive
from tsd_twin.dashboard.html_export import LONGEST_S, build, to_html, to_picture
from tsd_twin.errors import TwinError
from tsd_twin.messages.events import Event
from tsd_twin.recording.channels import JSON, Entry
from tsd_twin.recording.events import Annotation, add_mark
from tsd_twin.recording.export import RecordingSlice
from tsd_twin.recording.mcap_file import RecordingFile

SPITEFUL = "</script><script>alert(1)</script><!-- \u2028"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots with drops, a stop, and marks whose text would end a script."""
    path = tmp_path_factory.mktemp("drives") / "drive.mcap"
    file = RecordingFile(path)
    drive, other = RecordedDrive(file), RecordedDrive(file, "kiwi", "other")
    other.wait(1.0)
    alice = drive.get_ready("alice")
    drive.drive(alice, (0.3, 0.0, 0.4), 2.0)
    drive.put_event(Event("drop", SPITEFUL, rule="age"))
    drive.controller.stop(b'{"operator": "bob", "reason": "a cat"}', drive.now_s)
    drive.wait(1.0)
    file.close()
    for t_s in (0.5, 3.5):
        add_mark(path, Annotation(START_NS + round(t_s * 1e9), SPITEFUL, "bob"))
    return path


def about(html: str) -> dict[str, Any]:
    found = re.search(r'id="tsd-recording">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def test_a_page_has_the_events_marks_and_modes_of_its_part(recording: Path) -> None:
    html = build(RecordingSlice(recording, 2.0))
    assert len(html) < 5_000_000
    data = about(html)
    assert data["start_ms"] == START_NS // 1_000_000 + 2000
    (robot, other) = sorted(data["robots"], key=lambda each: each["id"] != "tsd")
    assert [mode for _, mode in robot["modes"]] == ["arming", "ready", "driving", "stopped"]
    assert max(speed for speed in robot["speeds"] if speed is not None) > 0.2
    assert len(robot["speeds"]) == pytest.approx(10 * data["duration_s"], abs=1)
    # Its stream has ended without notice.
    assert [mode for _, mode in other["modes"]] == ["disarmed"]
    events = sorted(data["events"], key=lambda each: each["t_s"])
    assert [each["kind"] for each in events] == ["mark", "drop", "stop"]
    assert events[0]["t_s"] == pytest.approx(1.5)
    assert {each["text"] for each in events[:2]} == {SPITEFUL}
    assert SPITEFUL not in html
    assert html.count("<body") == 1


def test_a_page_of_one_robot_has_that_one_only(recording: Path) -> None:
    data = about(build(RecordingSlice(recording, 0.0, 0.4, "other")))
    assert [robot["id"] for robot in data["robots"]] == ["other"]
    assert data["events"] == []


def test_what_cannot_be_exported_is_refused_in_a_sentence(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="is there already"):
        to_html(RecordingSlice(recording), recording)
    with pytest.raises(TwinError, match="is there already"):
        to_picture(RecordingSlice(recording, 0.0, 1.0), _touched(tmp_path / "there.gif"))
    with pytest.raises(TwinError, match=r"ends with \.webp or \.gif"):
        to_picture(RecordingSlice(recording), tmp_path / "drive.mp4")
    with pytest.raises(TwinError, match="is no part"):
        to_html(RecordingSlice(recording, 100.0), tmp_path / "a.html")
    with pytest.raises(TwinError, match="has no robot 'bob'"):
        to_html(RecordingSlice(recording, robot="bob"), tmp_path / "a.html")
    with pytest.raises(TwinError, match="cannot be written"):
        to_html(RecordingSlice(recording, 0.0, 0.1), tmp_path / "missing" / "a.html")
    file = RecordingFile(tmp_path / "longer.mcap")
    for log_ns in (1, round(1e9 * (LONGEST_S + 2.0))):
        file.add(Entry("twin/tsd/alive", JSON, "", log_ns, log_ns, 1, b'{"alive":true}'))
    file.close()
    for part in (RecordingSlice(file.path), RecordingSlice(file.path, 1.0)):
        with pytest.raises(TwinError, match="at most 600 s"):
            to_html(part, tmp_path / "a.html")
        with pytest.raises(TwinError, match="at most 30 s"):
            to_picture(part, tmp_path / "a.gif")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "longer.mcap", "there.gif",
    ]  # fmt: skip


def _touched(path: Path) -> Path:
    path.touch()
    return path
