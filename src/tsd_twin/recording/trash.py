"""Trash of a recordings folder: deleted recordings that can be restored for some time.

Each deletion is a directory in `trash/` with the recording, its marks and title, and
`deletion.json`. Files are moved in an order that a crash leaves either deleted or not: sidecars
follow the recording into the trash and precede it on the way back.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Generator, Iterator
from pathlib import Path

import msgspec

from tsd_twin.errors import RecordingError
from tsd_twin.recording.events import marks_file
from tsd_twin.recording.titles import (
    FolderError,
    is_being_written,
    is_recording_name,
    read_title,
    sidecars,
    title_file,
)

KEEP_S = 7 * 86400.0
"""Deletions are kept for at most a week."""
UNDO_S = 3600.0
"""Deletions are kept for at least an hour, whatever their size."""
MOST_BYTES = 2_000_000_000
"""Size limit of deletions older than `UNDO_S`."""
_ID = re.compile(r"[0-9a-f]{16}")
_ABOUT = "deletion.json"
_MOST_ABOUT_BYTES = 4096


class _About(msgspec.Struct, frozen=True):
    name: str
    by: str
    deleted_ns: int


class Deletion(msgspec.Struct, frozen=True):
    """Deleted recording."""

    id: str
    name: str
    """File name before the deletion."""
    title: str
    by: str
    """Operator who deleted it."""
    deleted_ns: int
    """Wall clock."""
    size: int
    """Bytes, without marks and title."""

    def age_s(self, now_ns: int) -> float:
        """Return the age; positive also if the clock was set back, so that it can expire."""
        return 1e-9 * abs(now_ns - self.deleted_ns)


class Trash:
    """Trash of a folder; safe with several threads and processes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.path = folder / "trash"

    def put(self, recording: Path, by: str, now_ns: int) -> Deletion:
        """Move a recording of the folder to the trash, with its marks and title.

        Raises:
            FolderError: If it does not exist or is being written.
            RecordingError: If it cannot be moved.
        """
        with _moving(), self._locked():
            try:
                if is_being_written(recording):
                    raise FolderError("being_written", "this recording is being written")
            except FileNotFoundError as error:
                raise FolderError("no_recording", "there is no such recording") from error
            id_ = secrets.token_hex(8)
            place = self.path / id_
            place.mkdir()
            with (place / _ABOUT).open("xb") as file:
                file.write(msgspec.json.encode(_About(recording.name, by, now_ns)))
                file.flush()
                os.fsync(file.fileno())
            _move_unless_written(recording, place / recording.name)
            for each in sidecars(recording):
                with contextlib.suppress(FileNotFoundError):
                    each.rename(place / each.name)
            found = self._deletion(place)
        assert found is not None  # noqa: S101  Written above.
        return found

    def restore(self, id_: str) -> Path:
        """Move a deleted recording back and return its path.

        Raises:
            FolderError: If it is no longer in the trash, or its name is in use again.
            RecordingError: If it cannot be moved.
        """
        gone = FolderError("not_in_trash", "this recording is no longer in the trash")
        if not _ID.fullmatch(id_) or not self.path.is_dir():
            raise gone
        with _moving(), self._locked():
            place = self.path / id_
            deletion = self._deletion(place)
            if deletion is None:
                raise gone
            recording = self._folder / deletion.name
            _reserve(recording)
            deleted = place / deletion.name
            _restore_marks(marks_file(deleted), marks_file(recording))
            if title_file(deleted).is_file() and not title_file(recording).exists():
                title_file(deleted).rename(title_file(recording))
            deleted.rename(recording)
            shutil.rmtree(place, ignore_errors=True)
        return recording

    def deletions(self) -> list[Deletion]:
        """Return the deletions, latest first."""
        found = [each for place in self._places() if (each := self._deletion(place)) is not None]
        return sorted(found, key=lambda each: each.deleted_ns, reverse=True)

    def purge(self, now_ns: int, most_bytes: int = MOST_BYTES) -> None:
        """Remove deletions for good: those older than `KEEP_S`, then the oldest beyond a size.

        The size limit spares deletions of the last `UNDO_S`.

        Raises:
            RecordingError: If the trash cannot be read.
        """
        if not self.path.is_dir():
            return
        with _moving(), self._locked():
            for place in self._places():
                if self._deletion(place) is None:  # A crash interrupted a move.
                    shutil.rmtree(place, ignore_errors=True)
            found = self.deletions()
            total = sum(each.size for each in found)
            for each in reversed(found):
                age_s = each.age_s(now_ns)
                if age_s > KEEP_S or (total > most_bytes and age_s > UNDO_S):
                    total -= each.size
                    shutil.rmtree(self.path / each.id, ignore_errors=True)

    def _places(self) -> Iterator[Path]:
        with contextlib.suppress(FileNotFoundError):
            yield from [each for each in self.path.iterdir() if _ID.fullmatch(each.name)]

    def _deletion(self, place: Path) -> Deletion | None:
        """Return a deletion, or None if it has no recording."""
        try:
            with (place / _ABOUT).open("rb") as file:
                about = msgspec.json.decode(file.read(_MOST_ABOUT_BYTES), type=_About)
            if not is_recording_name(about.name):
                return None
            recording = place / about.name
            size = recording.stat().st_size
        except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return None
        title = read_title(recording)
        return Deletion(place.name, about.name, title, about.by, about.deleted_ns, size)

    @contextlib.contextmanager
    def _locked(self) -> Generator[None]:
        """Context in which no other thread or process changes the trash."""
        self.path.mkdir(exist_ok=True)
        fd = os.open(self.path / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX)
            yield
        finally:
            os.close(fd)


@contextlib.contextmanager
def _moving() -> Generator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"the recording cannot be moved: {error.strerror}") from error


def _move_unless_written(recording: Path, target: Path) -> None:
    """Move a recording, with a lock that keeps a starting recorder from repairing it."""
    fd = os.open(recording, os.O_RDONLY | os.O_NONBLOCK)
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        recording.rename(target)
    finally:
        os.close(fd)


def _reserve(recording: Path) -> None:
    """Create an empty file under a name, so that no recorder uses it.

    Raises:
        FolderError: If the name is in use.
    """
    try:
        with recording.open("xb"):
            return
    except FileExistsError as error:
        # A crash between reserving and moving leaves an empty file.
        if recording.stat().st_size > 0 or is_being_written(recording):
            raise FolderError("name_taken", f"{recording.name} exists again") from error


def _restore_marks(deleted: Path, marks: Path) -> None:
    """Move marks back; append them to marks that were made after the deletion."""
    if not deleted.is_file():
        return
    if not marks.exists():
        deleted.rename(marks)
        return
    with marks.open("ab") as file:
        file.write(b"\n" + deleted.read_bytes())
