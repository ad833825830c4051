"""Any file costs bounded memory and time, and each error is one sentence."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from pathlib import Path

import pytest

import tsd_twin
from tests.support.hostile_recordings import Parts, bombs, damaged
from tests.support.programs import recording_readers
from tests.support.recorded_drives import recorded_circle
from tsd_twin.errors import RecordingError
from tsd_twin.messages.topics import Service
from tsd_twin.recording import RecordingFolder
from tsd_twin.recording.channels import BYTES, Entry
from tsd_twin.recording.mcap_file import RecordingFile, entries
from tsd_twin.recording.player import Player
from tsd_twin.recording.records import MOST_CHANNELS, MOST_MESSAGE_BYTES
from tsd_twin.recording.remote import ReaderProcesses, RemoteFolderReader, RemoteReader

pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]

GROWTH_BYTES = 200 << 20
"""Memory a program may need to read a file in a separate process."""


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_circle(tmp_path_factory.mktemp("honest") / "drive.mcap", 3)


@pytest.fixture(scope="module")
def planted(honest: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return bombs(honest, tmp_path_factory.mktemp("bombs"))


@pytest.fixture(scope="module")
def processes() -> Generator[ReaderProcesses]:
    made = ReaderProcesses()
    yield made
    made.close()


def refusals(*reads: Callable[[], object]) -> Iterator[str]:
    """Yield the package's errors of some reads; others are raised."""
    for read in reads:
        try:
            read()
        except RecordingError as error:
            yield str(error)


def shown(path: Path, processes: ReaderProcesses) -> list[str]:
    """Read a file like a dashboard; return its errors."""
    folder = RemoteFolderReader(processes)
    found = list(refusals(lambda: folder.listing(path), lambda: folder.details(path, 20)))
    folder.close()
    try:
        player = Player(path, reader=RemoteReader(path, processes))
    except RecordingError as error:
        return [*found, str(error)]
    for i in range(10):
        found += refusals(lambda at=i: player.seek(player.duration_s * at / 9))
    found += refusals(player.refresh, player.reader.events, player.reader.marks)
    found += refusals(lambda: player.step(next(iter(player.robots)), back=True))
    player.close()
    return found


def used(path: Path) -> list[str]:
    """Read a file like a script; return its errors."""

    def read(recording: tsd_twin.Recording) -> None:
        for message in recording.messages():
            del message

    def describe() -> None:
        read(tsd_twin.open_recording(path))

    return list(refusals(describe, lambda: tsd_twin.open_recording(path).description()))


def is_a_sentence(error: str, path: Path) -> bool:
    return "\n" not in error and len(error) < 1000 and (str(path) in error or "twin/" in error)


def memory_bytes(name: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def errors_within_memory(path: Path, processes: ReaderProcesses) -> list[str]:
    """Read a file in every way; fail if the process exceeds its memory limit."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # Resets the peak.
    before = memory_bytes("VmRSS")
    errors = [*shown(path, processes), *used(path)]
    assert memory_bytes("VmHWM") - before < GROWTH_BYTES, path
    return errors


def check(honest: Path, folder: Path, processes: ReaderProcesses, seeds: range) -> None:
    for seed in seeds:
        path = damaged(honest, folder / f"{seed}.mcap", seed)
        for error in errors_within_memory(path, processes):
            assert is_a_sentence(error, path), (seed, error)
            # The parser's limits apply before those of the process.
            assert "too much time" not in error, seed
        path.unlink()


def test_fifty_damaged_files_are_shown_or_refused_in_a_sentence(
    honest: Path, tmp_path: Path, processes: ReaderProcesses
) -> None:
    check(honest, tmp_path, processes, range(50))


@pytest.mark.timeout(1800)
def test_a_thousand_damaged_files_are_shown_or_refused_in_a_sentence(
    honest: Path, tmp_path: Path, processes: ReaderProcesses
) -> None:
    check(honest, tmp_path, processes, range(1000, 2000))


def test_every_known_bomb_is_shown_or_refused_in_little_memory(
    planted: dict[str, Path], processes: ReaderProcesses
) -> None:
    for name, path in planted.items():
        for error in errors_within_memory(path, processes):
            assert is_a_sentence(error, path), (name, error)


def test_a_chunk_is_refused_by_the_size_it_has_and_the_size_it_says(
    honest: Path, tmp_path: Path
) -> None:
    parts = Parts.read(honest)
    for size, reason in ((9 << 20, "larger than 8388608"), (1 << 31, "larger than 8388608")):
        path = parts.with_bomb(size).write(tmp_path / f"{size}.mcap")
        with pytest.raises(RecordingError, match=reason):
            list(entries(path))


def test_a_planted_bomb_is_not_written_larger_when_a_recorder_starts(
    honest: Path, tmp_path: Path
) -> None:
    """It has a recording's name and no end, so the next recorder would complete it."""
    parts = Parts.read(honest)
    zeros = parts.with_bomb(5 << 20).chunks[-2:-1] * 30
    path = tmp_path / "tsd-planted.mcap"
    Parts(parts.definitions, (*parts.chunks, *zeros)).write(path, is_whole=False)
    size = path.stat().st_size
    assert RecordingFolder(tmp_path, 1 << 40).complete_cut_files() == []
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    assert path.stat().st_size == size


def test_a_recorder_writes_nothing_that_its_readers_refuse(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap")

    def add(topic: str, size: int) -> None:
        file.add(Entry(topic, BYTES, "", 1, 1, 1, bytes(size)))

    for size in (10, MOST_MESSAGE_BYTES, MOST_MESSAGE_BYTES + 1, 300_000_000):
        add("twin/tsd/event/x", size)
    assert file.refused == 2
    for number in range(MOST_CHANNELS + 100):
        add(f"twin/tsd/{number}", 1)
    assert file.refused == 2 + 101
    file.close()
    recording = tsd_twin.open_recording(file.path)
    assert len(recording.topics) == MOST_CHANNELS
    assert max(len(message.value) for message in recording.messages("event/x")) == 6 << 20


class KeptConnections(ReaderProcesses):
    """Processes whose latest connection is kept, to change its timeout."""

    newest: socket.socket

    def connect(self) -> socket.socket:
        self.newest = super().connect()
        return self.newest


def test_a_reader_without_answer_is_given_up_and_the_others_go_on(
    honest: Path,
) -> None:
    with (
        closing(KeptConnections()) as processes,
        closing(RemoteReader(honest, processes)) as reader,
    ):
        others = recording_readers()
        slow = RemoteReader(honest, processes)
        (pid,) = recording_readers() - others
        os.kill(pid, signal.SIGSTOP)
        processes.newest.settimeout(0.1)
        for ask in (slow.events, slow.contents):
            with pytest.raises(RecordingError, match="too much time or memory"):
                ask()
        os.kill(pid, signal.SIGCONT)
        assert reader.contents().robots


def test_pipe_is_not_a_recording(tmp_path: Path, processes: ReaderProcesses) -> None:
    path = tmp_path / "pipe.mcap"
    os.mkfifo(path)
    for error in errors_within_memory(path, processes):
        assert "is not a file" in error


def test_an_honest_file_has_the_same_states_from_both_readers(
    honest: Path, processes: ReaderProcesses
) -> None:
    here, there = Player(honest), Player(honest, reader=RemoteReader(honest, processes))
    assert here.reader.events() == there.reader.events() != []
    for i in range(50):
        here.seek(0.1 * i)
        there.seek(0.1 * i)
        assert repr(here.robots["tsd"].snapshot) == repr(there.robots["tsd"].snapshot)
        assert here.robots["tsd"].alive is there.robots["tsd"].alive is True
    assert here.duration_s == there.duration_s
    here.close()
    there.close()


def test_a_description_is_found_in_an_honest_file(honest: Path) -> None:
    found = list(entries(honest, {Service.DESC.key("tsd")}))
    assert len(found) == 1
