"""Seeking shows the same state as playback; events and marks are found."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import tsd_twin
from tests.support.recorded_drives import START_NS, RecordedDrive, recorded_circle
from tsd_twin.control.monitors import FaultReporter
from tsd_twin.errors import RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_joints, decode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.status import ConsistencyStatus, RobotStatus, decode_status, encode_status
from tsd_twin.recording import RecordingFolder, mcap_file
from tsd_twin.recording.channels import JSON, Entry
from tsd_twin.recording.events import (
    Annotation,
    EventKind,
    add_mark,
    kind_of,
    marks_file,
    read_events,
    read_marks,
)
from tsd_twin.recording.export import RecordingSlice, to_mcap
from tsd_twin.recording.folder import Catalogue
from tsd_twin.recording.index import RecordingIndex
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.recording.player import Player
from tsd_twin.recording.reader import FolderReader

STREAMS: dict[str, tuple[topics.Topic, Callable[[bytes], Any]]] = {
    "joints": (topics.JOINTS, decode_joints),
    "setpoint": (topics.SETPOINT, decode_joints),
    "odom": (topics.ODOM, decode_odometry),
    "truth": (topics.TRUTH, decode_odometry),
    "status": (topics.STATUS, decode_status),
}


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record two robots, one of which joins late and leaves early, with undecodable messages."""
    path = tmp_path_factory.mktemp("drives") / "tsd-20260101T000000Z.mcap"
    file = RecordingFile(path)
    first, second = RecordedDrive(file), None
    alice = first.get_ready("alice")
    for second_number in range(8):
        first.drive(alice, (0.3, 0.05, 0.4), 1.0)
        if second_number == 2:
            second = RecordedDrive(file, "kiwi", "other", first.now_s)
        if second is not None and second_number < 6:
            second.wait(0.5)
        if second_number == 5 and second is not None:
            second.put_json(topics.alive_key("other"), {"alive": False})
        first.put_state(topics.ODOM, b"\x00")
        first.put_event(Event("drop", "1 command is too old.", rule="age"))
    first.controller.stop(b'{"operator": "bob", "reason": "a cat"}', first.now_s)
    first.wait(1.0)
    file.close()
    return path


def played(path: Path) -> Iterator[tuple[int, dict[tuple[str, str], Entry]]]:
    """Yield the latest decodable message of each stream, after each message."""
    newest: dict[tuple[str, str], Entry] = {}
    for entry in mcap_file.entries(path):
        robot = entry.topic.split("/")[1]
        for name, (topic, decode) in STREAMS.items():
            if entry.topic == topic.key(robot):
                try:
                    decode(entry.data)
                except MessageError:
                    continue
                newest[robot, name] = entry
        yield entry.log_ns, dict(newest)


def shown(player: Player) -> dict[tuple[str, str], bytes]:
    """Return the shown messages as text, for comparison."""
    return {
        (robot.id, name): repr(getattr(robot.snapshot, name)).encode()
        for robot in player.robots.values()
        for name in STREAMS
        if getattr(robot.snapshot, name) is not None
    }


def expected(newest: dict[tuple[str, str], Entry]) -> dict[tuple[str, str], bytes]:
    return {key: repr(STREAMS[key[1]][1](entry.data)).encode() for key, entry in newest.items()}


def test_any_of_500_times_shows_what_playing_up_to_it_shows(driven: Path) -> None:
    through = list(played(driven))
    times_ns = np.array([log_ns for log_ns, _ in through])
    player = Player(driven)
    assert set(player.robots) == {"tsd", "other"}
    random = np.random.default_rng(2)
    somewhere = random.integers(0, times_ns[-1] - START_NS, size=440)
    exactly = random.choice(times_ns, 60) - START_NS
    for t_ns in [*somewhere.tolist(), *exactly.tolist()]:
        player.seek(t_ns * 1e-9)
        last = int(np.searchsorted(times_ns, START_NS + t_ns, side="right")) - 1
        newest = through[last][1]
        assert shown(player) == expected(newest), t_ns
        for robot in player.robots.values():
            own = [entry for (robot_id, _), entry in newest.items() if robot_id == robot.id]
            if own:
                latest_s = 1e-9 * (max(entry.log_ns for entry in own) - START_NS)
                assert robot.snapshot.received_s == pytest.approx(latest_s)
                status = newest[robot.id, "status"]
                assert robot.snapshot.status_seq == status.sequence
    player.close()


def test_a_snapshot_is_the_same_object_until_something_changes(driven: Path) -> None:
    player = Player(driven)
    player.seek(3.0)
    before = player.robots["tsd"].snapshot
    player.seek(3.0)
    assert player.robots["tsd"].snapshot is before
    player.seek(3.1)
    after = player.robots["tsd"].snapshot
    assert after is not before
    assert after.odom is not before.odom
    player.close()


def test_a_robot_is_alive_while_its_node_was(driven: Path) -> None:
    player = Player(driven)
    other = player.robots["other"]
    entries = [e for e in mcap_file.entries(driven) if e.topic == topics.alive_key("other")]
    came_s, went_s = (1e-9 * (entry.log_ns - START_NS) for entry in entries)
    for t_s, alive in ((came_s - 0.1, False), (came_s + 0.1, True), (went_s + 0.1, False)):
        player.seek(t_s)
        assert other.alive is alive
        assert player.robots["tsd"].alive
    player.close()


def test_stepping_by_status_shows_each_once(driven: Path) -> None:
    player = Player(driven)
    key = topics.STATUS.key("tsd")
    numbers = [entry.sequence for entry in mcap_file.entries(driven, {key})]
    player.seek(0.0)
    forward: list[int] = []
    for _ in numbers:
        forward.append(player.robots["tsd"].snapshot.status_seq)
        player.step("tsd")
    assert sorted(set(forward) - {0}) == numbers
    at_end = player.t_s
    player.step("tsd")
    assert player.t_s == at_end
    player.step("tsd", back=True)
    assert player.robots["tsd"].snapshot.status_seq == numbers[-2]
    player.close()


def test_a_file_that_grows_or_was_cut_shows_the_same(driven: Path, tmp_path: Path) -> None:
    """Its index is built by scanning, in steps of any size."""
    data, whole = driven.read_bytes(), Player(driven)
    path = tmp_path / "tsd-growing.mcap"
    random = np.random.default_rng(3)
    cuts = sorted(random.integers(30_000, len(data), size=12).tolist())
    with path.open("wb") as file:
        file.write(data[: cuts[0]])
        file.flush()
        growing, begun, index = Player(path, "tsd"), RecordingIndex(path), RecordingIndex(driven)
        for begin, end in zip(cuts, [*cuts[1:], len(data)], strict=True):
            growing.refresh()
            begun.refresh()
            found = list(begun.ordered(begun.topics))
            # Chunks overlap, so a message of a later chunk may be older than the last one here.
            assert sorted(found) == sorted(mcap_file.entries(path))
            assert found == sorted(found, key=lambda entry: entry.log_ns)
            assert set(found) <= set(index.ordered(index.topics))
            for t_s in random.uniform(0.0, growing.duration_s, size=5):
                growing.seek(t_s)
                whole.seek(t_s)
                own = {key: value for key, value in shown(whole).items() if key[0] == "tsd"}
                assert shown(growing) == own
            file.write(data[begin:end])
            file.flush()
    growing.refresh()
    assert growing.duration_s == whole.duration_s
    for opened in (growing, whole, begun, index):
        opened.close()


def test_messages_that_were_written_out_of_order_are_found_by_their_time(tmp_path: Path) -> None:
    """Bus threads take timestamps before they queue, so chunks may overlap."""
    path, topic, random = tmp_path / "a.mcap", "twin/tsd/event/x", np.random.default_rng(5)
    file = RecordingFile(path)
    for number in range(400):
        log_ns = START_NS + 1000 * (number + int(random.integers(-30, 30)))
        file.add(Entry(topic, JSON, "", log_ns, log_ns, number, b"%d" % number))
        if number % 10 == 9:
            file.flush()
    file.close()
    in_order = list(mcap_file.entries(path))
    times_ns = [entry.log_ns for entry in in_order]
    index = RecordingIndex(path)
    for at_ns in random.integers(min(times_ns) - 5, max(times_ns) + 5, size=200).tolist():
        before = [entry for entry in in_order if entry.log_ns <= at_ns]
        found = list(index.newest_first(topic, at_ns))
        assert found == before[::-1]
        after = index.first_after(topic, at_ns)
        assert after == next((entry for entry in in_order if entry.log_ns > at_ns), None)
    index.close()


def test_a_damaged_chunk_is_an_error_of_one_sentence(driven: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = bytearray(driven.read_bytes())
    data[len(data) // 3] ^= 0x10
    path.write_bytes(data)
    player = Player(path)
    errors: list[str] = []
    for t_s in np.linspace(0.0, player.duration_s, 100):
        try:
            player.seek(t_s)
        except RecordingError as error:
            errors.append(str(error))
    assert 0 < len(errors) < 20
    assert all("is damaged" in each for each in errors)
    player.close()


def test_what_cannot_be_shown_is_refused(driven: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no robot 'bob' is in it"):
        Player(driven, "bob")
    with pytest.raises(RecordingError, match="cannot be read"):
        Player(tmp_path / "missing.mcap")
    file = RecordingFile(tmp_path / "a.mcap")
    file.add(Entry("twin/tsd/alive", JSON, "", 1, 1, 1, b'{"alive":true}'))
    file.close()
    with pytest.raises(RecordingError, match="no description of 'tsd'"):
        Player(tmp_path / "a.mcap")


def test_events_are_found_and_repeated_ones_are_counted(driven: Path) -> None:
    with contextlib.closing(RecordingIndex(driven)) as index:
        events = read_events(index)
    assert [event.t_s for event in events] == sorted(event.t_s for event in events)
    by_kind = {kind: [each for each in events if each.kind is kind] for kind in EventKind}
    assert by_kind[EventKind.HAND_OVER][0].text == "alice has control."
    # Eight events, 1 s apart.
    (drops,) = by_kind[EventKind.DROP]
    assert drops.count == 8
    stops = by_kind[EventKind.STOP]
    assert [event.text for event in stops] == ["From driving to stopped: a cat."]


@pytest.mark.parametrize(
    ("mode", "kind"),
    [("stopped", EventKind.STOP), ("fault", EventKind.FAULT), ("ready", EventKind.OTHER)],
)
def test_stops_without_codes_come_from_the_modes_of_statuses(
    mode: str, kind: EventKind, tmp_path: Path
) -> None:
    file = RecordingFile(tmp_path / "old.mcap")
    event = b'{"kind": "mode", "text": "words of another version"}'
    file.add(Entry("twin/tsd/event/mode", JSON, "", 10, 10, 1, event))
    file.add(Entry("twin/tsd/state/status", JSON, "", 20, 20, 2, encode_status(RobotStatus(mode))))
    file.close()
    index = RecordingIndex(tmp_path / "old.mcap")
    assert [each.kind for each in read_events(index)] == [kind]
    index.close()


def test_an_event_that_never_occurred_has_no_messages_and_a_topic_of_nobody_is_an_error(
    driven: Path,
) -> None:
    recording = tsd_twin.open_recording(driven)
    assert list(recording.messages("event/fault", robot="tsd")) == []
    for topic in ("event", "state/odometry"):
        with pytest.raises(RecordingError, match=f"has no twin/tsd/{topic}, but"):
            list(recording.messages(topic, robot="tsd"))


def test_an_event_about_a_suspect_is_found_as_one_of_consistency() -> None:
    event = FaultReporter().step(ConsistencyStatus(suspect="module2", level=2.0), 5.0)
    assert event is not None
    assert kind_of(event) is EventKind.CONSISTENCY


def test_marks_stay_beside_a_recording_and_go_with_it(driven: Path, tmp_path: Path) -> None:
    path = tmp_path / "tsd-20260101T000000Z.mcap"
    shutil.copy(driven, path)
    assert read_marks(path) == []
    late, early = (
        Annotation(START_NS + 5, "it slipped", "alice"),
        Annotation(START_NS + 2, "Größe: 3 < 4"),
    )
    add_mark(path, late)
    with marks_file(path).open("ab") as file:
        file.write(b'{"log_ns": 17, "no')  # A crash.
    add_mark(path, early)
    assert read_marks(path) == [early, late]
    with pytest.raises(RecordingError, match="at most 200"):
        add_mark(path, msgspec.structs.replace(late, note=201 * "x"))
    assert list(mcap_file.entries(path)) == list(mcap_file.entries(driven))
    RecordingFolder(tmp_path, 1).remove_oldest()
    assert list(tmp_path.iterdir()) == []


def test_a_list_has_time_duration_robots_and_marks_of_each_recording(
    driven: Path, tmp_path: Path
) -> None:
    """Complete files, a growing one, and one that is not a recording."""
    whole, growing = tmp_path / "a.mcap", tmp_path / "b.mcap"
    shutil.copy(driven, whole)
    data = driven.read_bytes()
    growing.write_bytes(data[: len(data) // 2])
    (tmp_path / "c.mcap").write_text("not a recording")
    (tmp_path / "d.mcap").write_bytes(data[:100] + data[-60:])
    (tmp_path / "notes.txt").write_text("notes")
    add_mark(whole, Annotation(START_NS, "here"))
    recording, player = tsd_twin.open_recording(driven), Player(driven)
    catalogue = Catalogue(tmp_path, FolderReader())
    by_path = catalogue.recordings()
    assert set(by_path) == {whole, growing}
    assert by_path[whole].start_ns == recording.start_ns
    assert by_path[whole].duration_s == pytest.approx(recording.duration_s)
    assert by_path[whole].robots == recording.robots == ("other", "tsd")
    assert (by_path[whole].marks, by_path[whole].is_whole) == (1, True)
    before_s = by_path[growing].duration_s
    assert not by_path[growing].is_whole
    assert 0.0 < before_s < player.duration_s
    growing.write_bytes(data)
    add_mark(whole, Annotation(START_NS, "and here"))
    by_path = catalogue.recordings()
    assert by_path[growing].duration_s == pytest.approx(player.duration_s)
    assert by_path[growing].is_whole
    assert by_path[whole].marks == 2
    growing.unlink()
    assert list(catalogue.recordings()) == [whole]
    catalogue.close()
    player.close()


@pytest.mark.parametrize("name", ["atlas", "mecanum"])
def test_every_kind_of_robot_is_shown(name: str, tmp_path: Path) -> None:
    player = Player(recorded_circle(tmp_path / "a.mcap", 1, name))
    player.seek(player.duration_s)
    snapshot = player.robots["tsd"].snapshot
    assert snapshot.odom is not None
    assert (snapshot.odom.wxyz is not None) == (name == "atlas")
    player.close()


def test_an_exported_part_has_the_marks_of_its_time(driven: Path, tmp_path: Path) -> None:
    path, part = tmp_path / "a.mcap", tmp_path / "part.mcap"
    shutil.copy(driven, path)
    marks = [Annotation(START_NS + t_s * 1_000_000_000, f"at {t_s} s") for t_s in (1, 4, 9)]
    for each in marks:
        add_mark(path, each)
    to_mcap(RecordingSlice(path, 3.0, 8.0), part)
    assert read_marks(part) == [marks[1]]
    player = Player(part)
    assert player.start_ns == START_NS + 3_000_000_000
    player.close()
