"""Deleted recordings are moved and restored as a whole, and kept for some time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tsd_twin.errors import RecordingError
from tsd_twin.recording import RecordingFolder
from tsd_twin.recording.events import Annotation, add_mark, marks_file, read_marks
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.recording.titles import (
    TITLE_LENGTH,
    FolderError,
    clean_title,
    is_recording_name,
    read_title,
    title_file,
    write_title,
)
from tsd_twin.recording.trash import KEEP_S, UNDO_S, Trash

NAME = "tsd-20260101T000000Z.mcap"
NOW_NS = 1_800_000_000_000_000_000
THREADS = 8


def recording(folder: Path, name: str = NAME, content: bytes = b"content") -> Path:
    """Write a file with a mark and a title; the trash does not read recordings."""
    path = folder / name
    path.write_bytes(content)
    add_mark(path, Annotation(5, "slipped", "alice"))
    write_title(path, "First drive")
    return path


def is_complete(path: Path, content: bytes = b"content") -> bool:
    return (
        path.read_bytes() == content
        and [mark.note for mark in read_marks(path)] == ["slipped"]
        and read_title(path) == "First drive"
    )


def refused(act: Callable[[], object]) -> str:
    """Return the code of the refusal."""
    with pytest.raises(FolderError) as error:
        act()
    return error.value.code


def together(act: Callable[[], object]) -> list[object]:
    """Call a function in several threads at once; return its results and refusals."""
    results: list[object] = []
    start = threading.Barrier(THREADS)

    def run() -> None:
        start.wait()
        try:
            results.append(act())
        except FolderError as error:
            results.append(error.code)

    threads = [threading.Thread(target=run) for _ in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def test_a_restored_recording_has_its_marks_and_title(tmp_path: Path) -> None:
    path = recording(tmp_path)
    deletion = Trash(tmp_path).put(path, "bob", NOW_NS)
    assert (deletion.name, deletion.title, deletion.by) == (NAME, "First drive", "bob")
    assert [each.name for each in tmp_path.iterdir()] == ["trash"]
    assert Trash(tmp_path).deletions() == [deletion]
    assert Trash(tmp_path).restore(deletion.id) == path
    assert is_complete(path)
    assert Trash(tmp_path).deletions() == []


def test_of_simultaneous_deletions_and_restorations_one_succeeds(tmp_path: Path) -> None:
    path = recording(tmp_path)
    results = together(lambda: Trash(tmp_path).put(path, "bob", NOW_NS))
    assert results.count("no_recording") == THREADS - 1
    (deletion,) = Trash(tmp_path).deletions()
    results = together(lambda: Trash(tmp_path).restore(deletion.id))
    assert results.count("not_in_trash") == THREADS - 1
    assert is_complete(path)


def test_whatever_is_done_at_once_each_recording_exists_once(tmp_path: Path) -> None:
    names = [f"tsd-2026010{i}T000000Z.mcap" for i in range(3)]
    for name in names:
        (tmp_path / name).write_bytes(name.encode())
    seeds = iter(range(THREADS))

    def act() -> None:
        choose, trash = np.random.default_rng(next(seeds)), Trash(tmp_path)
        for _ in range(30):
            try:
                if choose.random() < 0.4:
                    trash.put(tmp_path / str(choose.choice(names)), "bob", NOW_NS)
                elif choose.random() < 0.5:
                    write_title(
                        tmp_path / str(choose.choice(names)), f"title {choose.random():.3f}"
                    )
                elif found := trash.deletions():
                    trash.restore(found[choose.integers(len(found))].id)
            except FolderError:
                continue

    together(act)
    deleted = [each.name for each in Trash(tmp_path).deletions()]
    assert sorted([*deleted, *(each.name for each in tmp_path.glob("*.mcap"))]) == names
    for each in Trash(tmp_path).deletions():
        Trash(tmp_path).restore(each.id)
    assert [(tmp_path / name).read_bytes().decode() for name in names] == names


class CrashError(BaseException):
    """Simulated crash of the program."""


@pytest.fixture
def crash(monkeypatch: pytest.MonkeyPatch) -> Generator[Callable[[int], None]]:
    """Return a function that crashes the program at a later rename.

    Odd numbers crash it after the rename, even ones before.
    """
    rename, left = Path.rename, [1 << 30]

    def interrupted(path: Path, target: Path) -> Path:
        left[0] -= 2
        if left[0] in (-1, -2):
            if left[0] == -1:
                rename(path, target)
            raise CrashError
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", interrupted)

    def crash_at(number: int) -> None:
        left[0] = number

    yield crash_at
    left[0] = 1 << 30


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("restoring", [False, True])
def test_a_crash_at_any_step_loses_nothing(
    tmp_path: Path, crash: Callable[[int], None], number: int, *, restoring: bool
) -> None:
    path = recording(tmp_path)
    trash = Trash(tmp_path)
    deletion = trash.put(path, "bob", NOW_NS) if restoring else None
    crash(number)
    with pytest.raises(CrashError):
        trash.put(path, "bob", NOW_NS) if deletion is None else trash.restore(deletion.id)
    crash(1 << 30)
    Trash(tmp_path).purge(NOW_NS)
    found = Trash(tmp_path).deletions()
    assert len(found) + (path.is_file() and path.stat().st_size > 0) == 1
    for each in found:
        Trash(tmp_path).restore(each.id)
    assert is_complete(path)


def test_the_recording_that_is_written_cannot_be_deleted(tmp_path: Path) -> None:
    path = tmp_path / NAME
    with closing(RecordingFile(path)) as file:
        file.flush()
        assert refused(lambda: Trash(tmp_path).put(path, "bob", NOW_NS)) == "being_written"
        assert path.is_file()
    Trash(tmp_path).put(path, "bob", NOW_NS)


def test_a_name_that_is_in_use_again_is_not_overwritten(tmp_path: Path) -> None:
    trash, path = Trash(tmp_path), recording(tmp_path)
    deletion = trash.put(path, "bob", NOW_NS)
    path.write_bytes(b"another")
    assert refused(lambda: trash.restore(deletion.id)) == "name_taken"
    assert path.read_bytes() == b"another"
    path.unlink()
    trash.restore(deletion.id)
    assert is_complete(path)


def test_marks_made_after_the_deletion_are_kept(tmp_path: Path) -> None:
    trash, path = Trash(tmp_path), recording(tmp_path)
    deletion = trash.put(path, "bob", NOW_NS)
    with pytest.raises(RecordingError, match="does not exist"):
        add_mark(path, Annotation(7, "late"))
    # A mark added while the recording was being deleted.
    marks_file(path).write_text('{"log_ns":7,"note":"late"}\n')
    trash.restore(deletion.id)
    assert [mark.note for mark in read_marks(path)] == ["slipped", "late"]


def test_the_trash_is_emptied_by_age_and_size_but_not_within_an_hour(tmp_path: Path) -> None:
    trash, ages_s = Trash(tmp_path), (0.9 * UNDO_S, 1.1 * UNDO_S, 3 * UNDO_S, 1.01 * KEEP_S)
    for i, age_s in enumerate(ages_s):
        path = recording(tmp_path, f"tsd-{i}.mcap", bytes(1000))
        trash.put(path, "bob", NOW_NS - round(1e9 * age_s))

    def left(most_bytes: int) -> list[str]:
        trash.purge(NOW_NS, most_bytes)
        return [each.name for each in trash.deletions()]

    assert left(1 << 40) == ["tsd-0.mcap", "tsd-1.mcap", "tsd-2.mcap"]
    assert left(2500) == ["tsd-0.mcap", "tsd-1.mcap"]
    assert left(0) == ["tsd-0.mcap"]


def test_a_deletion_ends_also_if_the_clock_is_set_back(tmp_path: Path) -> None:
    trash = Trash(tmp_path)
    trash.put(recording(tmp_path), "bob", NOW_NS + round(1e9 * (KEEP_S + 1.0)))
    trash.purge(NOW_NS)
    assert trash.deletions() == []


def test_a_manipulated_trash_reaches_no_other_file(tmp_path: Path) -> None:
    folder, outside = tmp_path / "drives", tmp_path / "outside.mcap"
    folder.mkdir()
    outside.write_bytes(b"mine")
    trash = Trash(folder)
    deletion = trash.put(recording(folder), "bob", NOW_NS)
    about = trash.path / deletion.id / "deletion.json"
    text = about.read_text().replace(NAME, "../../../outside.mcap")
    about.write_text(text)
    assert trash.deletions() == []
    for id_ in (deletion.id, "../..", "..", "", f"{deletion.id}/..", "x" * 16):
        assert refused(lambda id_=id_: trash.restore(id_)) == "not_in_trash"
    trash.purge(NOW_NS)
    assert outside.read_bytes() == b"mine"


def test_the_recorder_removes_titles_with_their_recordings_and_spares_the_trash(
    tmp_path: Path,
) -> None:
    oldest, latest = (tmp_path / f"tsd-{i}.mcap" for i in range(2))
    for i, path in enumerate((oldest, latest)):
        path.write_bytes(bytes(1000))
        os.utime(path, (i, i))
    add_mark(oldest, Annotation(5, "slipped"))
    write_title(oldest, "First")
    deleted = recording(tmp_path)
    folder = RecordingFolder(tmp_path, latest.stat().st_size)
    deletion = Trash(tmp_path).put(deleted, "bob", time.time_ns())
    # A file that a dashboard deletes between listing and reading.
    (tmp_path / "tsd-gone.mcap").symlink_to(tmp_path / "nowhere")
    assert folder.remove_oldest() == [oldest]
    assert not title_file(oldest).exists()
    assert not marks_file(oldest).exists()
    assert latest.is_file()
    assert Trash(tmp_path).deletions() == [deletion]


@pytest.mark.parametrize(
    "name",
    [
        "a.mcap",
        "Fahrt über den Hof.mcap",
        "試験走行.mcap",
        "\u0627\u062e\u062a\u0628\u0627\u0631.mcap",
    ],
)
def test_file_names_may_be_in_any_script(name: str) -> None:
    assert is_recording_name(name)


@pytest.mark.parametrize(
    "name",
    [
        *("", ".mcap", "..", "../a.mcap", "a/b.mcap", "/a.mcap", "a\0.mcap", "a\n.mcap", "a.mcap/"),
        *("a.marks.jsonl", "trash", "\udcff.mcap", "ä" * 120 + ".mcap", "\u2028.mcap"),
    ],
)
def test_paths_and_control_characters_are_not_file_names(name: str) -> None:
    assert not is_recording_name(name)


def test_titles_are_short_text_in_nfc(tmp_path: Path) -> None:
    path = recording(tmp_path)
    assert write_title(path, "  U\u0308bung \t 7 ") == "\u00dcbung 7" == read_title(path)
    assert write_title(path, "試験" * (TITLE_LENGTH // 2)) == read_title(path)
    assert clean_title("u\u0308" * TITLE_LENGTH) == "ü" * TITLE_LENGTH
    before = read_title(path)
    for wrong in ("x" * (TITLE_LENGTH + 1), "a\0b", "a\u202eb", "\ud800", "a\u2067b"):
        assert refused(lambda wrong=wrong: write_title(path, wrong)) == "invalid_title"
    assert read_title(path) == before
    assert write_title(path, " \n ") == ""
    assert not title_file(path).exists()


@pytest.mark.parametrize("data", [b"\xff\xfe", b"a" * 5000, b"a\0b", "\u202e".encode()])
def test_a_damaged_title_is_ignored(tmp_path: Path, data: bytes) -> None:
    path = recording(tmp_path)
    title_file(path).write_bytes(data)
    assert read_title(path) == ""
