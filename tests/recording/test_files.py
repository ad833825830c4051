"""Recording files: truncated anywhere, on a full disk, in a folder with a size limit."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import tsd_twin
from tsd_twin.errors import RecordingError, TwinError
from tsd_twin.messages.cdr import Odometry, encode_odometry
from tsd_twin.recording import RecordingFolder
from tsd_twin.recording.channels import CDR, JSON, Entry
from tsd_twin.recording.mcap_file import RecordingFile, entries
from tsd_twin.recording.records import is_whole

ODOM = "twin/tsd/state/odom"
STEP_NS = 20_000_000
FLUSH_EVERY = 20
"""Entries between two flushes of 0.2 s, because each time has two entries."""


def entry(number: int) -> Entry:
    """Return an incompressible entry."""
    noise = np.random.default_rng(number).normal(size=(2, 3))
    odometry = Odometry(noise[0], noise[1], np.eye(3), np.eye(3), number)
    at_ns = 1_700_000_000_000_000_000 + number // 2 * STEP_NS
    if number % 2:
        return Entry("twin/tsd/alive", JSON, "", at_ns, at_ns, number, b'{"alive":true}')
    payload = encode_odometry(odometry)
    return Entry(ODOM, CDR, "nav_msgs/msg/Odometry", at_ns, 5 * number, number, payload)


def written(path: Path, count: int = 1000) -> list[Entry]:
    """Write a whole file, flushed like the recorder does."""
    file, all_entries = RecordingFile(path), [entry(i) for i in range(count)]
    for i, each in enumerate(all_entries):
        file.add(each)
        if i % FLUSH_EVERY == FLUSH_EVERY - 1:
            file.flush()
    file.close()
    return all_entries


def by_mcap(path: Path) -> list[tuple[str, int, bytes]]:
    """Read with the MCAP library only."""
    with path.open("rb") as file:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(file, validate_crcs=True).iter_messages()
        ]


def by_rosbags(path: Path) -> list[Any]:
    """Read with rosbags only, and decode typed messages."""
    with AnyReader([path]) as reader:
        return [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.msgtype == "nav_msgs/msg/Odometry"
        ]


def plain(some: Sequence[Entry]) -> list[tuple[str, int, bytes]]:
    return [(each.topic, each.log_ns, each.data) for each in some]


def test_a_whole_file_is_read_by_the_readers_of_others(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    all_entries = written(path)
    assert by_mcap(path) == plain(all_entries)
    assert len(by_rosbags(path)) == len(all_entries) / 2
    assert list(entries(path)) == all_entries
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(all_entries)


def test_a_file_that_is_cut_anywhere_keeps_what_was_flushed_before(tmp_path: Path) -> None:
    """Cut at 40 random places and in the first bytes: read directly, then after completion."""
    whole = tmp_path / "whole.mcap"
    file, all_entries, flushed = RecordingFile(whole), [], [(0, 0)]
    for i in range(1000):
        all_entries.append(entry(i))
        file.add(all_entries[-1])
        if i % FLUSH_EVERY == FLUSH_EVERY - 1:
            file.flush()
            flushed.append((file.size, i + 1))
    file.close()
    data = whole.read_bytes()
    some = np.random.default_rng(4)
    places = [0, 1, 8, 40, *some.integers(len(data), size=40).tolist()]
    for place in places:
        folder = RecordingFolder(tmp_path / str(place), 1 << 40)
        path = folder.path / "tsd-20260101T000000Z.mcap"
        path.write_bytes(data[:place])
        os.utime(path, (1, 1))
        kept = max(count for size, count in flushed if size <= place)
        if place >= 8:
            before = list(entries(path))
            assert before == all_entries[: len(before)]
            assert len(before) >= kept
        completed = folder.complete_cut_files()
        if kept == 0 and not path.exists():
            continue
        assert completed == [path]
        found = by_mcap(path)
        assert found == plain(all_entries[: len(found)])
        assert len(found) >= kept
        assert len(by_rosbags(path)) == (len(found) + 1) // 2
        assert folder.complete_cut_files() == []


def test_a_damaged_byte_costs_no_more_than_what_follows_it(tmp_path: Path) -> None:
    path = tmp_path / "tsd-x.mcap"
    all_entries = written(path)
    data = bytearray(path.read_bytes())[: -len(b"\x89MCAP0\r\n")]
    data[len(data) // 2] ^= 0x40
    path.write_bytes(data)
    found = list(entries(path))
    assert found == all_entries[: len(found)]
    assert len(found) > 300


def test_what_is_no_recording_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a recording")
    with pytest.raises(RecordingError, match="is no recording"):
        tsd_twin.open_recording(path)
    with pytest.raises(RecordingError, match="cannot be read"):
        tsd_twin.open_recording(tmp_path / "missing.mcap")


def test_a_second_recorder_leaves_the_file_of_the_first_alone(tmp_path: Path) -> None:
    """It neither completes nor removes the file."""
    folder = RecordingFolder(tmp_path, 1)
    file = folder.new_file()
    file.add(entry(0))
    file.flush()
    other = RecordingFolder(tmp_path, 1)
    assert other.complete_cut_files() == []
    assert other.remove_oldest() == []
    second = other.new_file()
    assert second.path != file.path
    file.close()
    second.close()
    assert len(other.remove_oldest()) == 2


def test_the_oldest_files_are_removed_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "thesis.mcap").write_bytes(bytes(100_000))
    (tmp_path / "tsd-notes.txt").write_bytes(bytes(100_000))
    for day in range(1, 9):
        path = tmp_path / f"tsd-2026010{day}T000000Z.mcap"
        path.write_bytes(bytes(10_000))
        os.utime(path, (day, day))
    removed = RecordingFolder(tmp_path, 35_000).remove_oldest()
    assert [path.name[11:12] for path in removed] == ["1", "2", "3", "4", "5"]
    assert (tmp_path / "thesis.mcap").exists()
    assert (tmp_path / "tsd-notes.txt").exists()


def test_a_folder_that_cannot_be_one_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TwinError, match="cannot be a folder of recordings"):
        RecordingFolder(tmp_path / "file" / "below", 1)


FULL = """
import resource, sys
from pathlib import Path
from tests.recording.test_files import entry, by_mcap, plain
from tsd_twin.recording.mcap_file import RecordingFile
file = RecordingFile(Path(sys.argv[1]))
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, resource.RLIM_INFINITY))
failed = 0
for i in range(1000):
    file.add(entry(i))
    if i % 20 == 19:
        try:
            file.flush()
        except OSError:
            failed += 1
            assert file.path.stat().st_size == file.size <= 40_000
    if i == 900:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
file.close()
assert by_mcap(file.path) == plain([entry(i) for i in range(1000)])
print(failed)
"""


@pytest.mark.system
def test_nothing_is_lost_while_a_disk_is_full_for_some_time(tmp_path: Path) -> None:
    """A file size limit simulates a full disk, because the same calls fail."""
    ran = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path / "a.mcap")], capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    assert int(ran.stdout) > 10


KILLED = """
import sys, time
from pathlib import Path
from tests.recording.test_files import entry
from tsd_twin.recording.mcap_file import RecordingFile
file = RecordingFile(Path(sys.argv[1]))
for i in range(100_000):
    file.add(entry(i))
    if i % 20 == 19:
        file.flush()
        print(i + 1, flush=True)
"""


@pytest.mark.system
def test_a_process_that_is_killed_has_lost_nothing_that_was_flushed(tmp_path: Path) -> None:
    for seed in range(4):
        folder = RecordingFolder(tmp_path / str(seed), 1 << 40)
        path = folder.path / "tsd-a.mcap"
        process = subprocess.Popen(
            [sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        for _ in range(3):
            process.stdout.readline()
        time.sleep(np.random.default_rng(seed).uniform(0.0, 0.2))
        process.send_signal(signal.SIGKILL)
        flushed = [int(line) for line in process.stdout]
        process.wait()
        process.stdout.close()
        assert not is_whole(path)
        assert folder.complete_cut_files() == [path]
        found = by_mcap(path)
        assert found == plain([entry(i) for i in range(len(found))])
        assert len(found) >= max(flushed, default=60)


def test_memory_has_a_limit_while_a_disk_is_full(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap")
    big = entry(0)._replace(data=os.urandom(1_000_000))
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        for _ in range(60):
            file.add(big)
            with pytest.raises(OSError, match="too large"):
                file.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    assert 20 < file.lost < 40
    assert file.waiting < 40_000_000
    file.flush()
    file.close()
    assert len(by_mcap(file.path)) == 60 - file.lost
