"""Folder of recordings: file names, repair of truncated files, size limit, and a catalogue with
start, duration and robots of each recording.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from tsd_twin.errors import RecordingError, TwinError
from tsd_twin.recording.channels import Entry
from tsd_twin.recording.mcap_file import McapWriter, RecordingFile, entries
from tsd_twin.recording.reader import FolderReader, RecordingSummary
from tsd_twin.recording.records import is_whole
from tsd_twin.recording.remote import RemoteFolderReader
from tsd_twin.recording.titles import is_recording_name, sidecars
from tsd_twin.recording.trash import Trash

_PATTERN = "tsd-*.mcap"
"""Only matching files are repaired or removed, because a folder may contain other files."""
_UNFINISHED = ".part"
_NEW_S = 10.0
_MOST_RATIO = 256
"""Maximum ratio of decompressed size to file size; recorders reach a tenth of it."""
_FREE_BYTES = 64 << 20
"""Decompressed size allowed for any file."""
_LOG = logging.getLogger(__name__)


LEAST_GB, DEFAULT_GB = 0.01, 5.0
"""Minimum and default size limit of a folder."""


def default_folder(home: Path | None = None) -> Path:
    """Return the recordings folder of this user, or below another `home`."""
    data = os.environ.get("XDG_DATA_HOME")
    if home is None and data:
        return Path(data) / "tsd-twin"
    return (home or Path.home()) / ".local/share/tsd-twin"


class RecordingFolder:
    """Folder of recordings with a size limit."""

    def __init__(self, path: Path, keep_bytes: int) -> None:
        """Create the folder if needed.

        Raises:
            TwinError: If it cannot be created or written to.
        """
        self.path = path
        self.keep_bytes = keep_bytes
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TwinError(f"{path} cannot be a folder of recordings: {error.strerror}") from error
        if not os.access(path, os.W_OK | os.X_OK):
            raise TwinError(f"{path} cannot be written to: choose another folder")

    def new_file(self) -> RecordingFile:
        """Create a file named by the current time.

        Raises:
            OSError: If it cannot be created.
        """
        stem = datetime.now(UTC).strftime("tsd-%Y%m%dT%H%M%SZ")
        number = 1
        while True:
            suffix = "" if number == 1 else f"-{number}"
            try:
                return RecordingFile(self.path / f"{stem}{suffix}.mcap")
            except FileExistsError:
                number += 1

    def complete_cut_files(self) -> list[Path]:
        """Add the index to truncated files, for example after a power cut; return those files.

        Files without messages are removed. If the disk cannot hold a copy of a file, it is left
        unchanged until the next start.
        """
        for left in self.path.glob(_PATTERN + _UNFINISHED):
            left.unlink(missing_ok=True)
        completed: list[Path] = []
        for path in self._unused():
            if is_whole(path):
                continue
            try:
                if _complete(path):
                    completed.append(path)
            except (OSError, RecordingError) as error:
                _LOG.warning("%s stays cut: %s", path, getattr(error, "strerror", error))
        return completed

    def remove_oldest(self) -> list[Path]:
        """Remove the oldest files until the folder is within its limit; return those files.

        Old deletions leave the trash first. Recent ones remain and do not count, so that deleting a
        recording never costs another one.
        """
        # A dashboard may delete or restore files at any time.
        files = sorted(
            (stamp, path) for path in self.path.glob(_PATTERN) if (stamp := _stamp(path))
        )
        total = sum(size for (_, size), _ in files)
        removed: list[Path] = []
        unused = set(self._unused())
        for (_, size), path in files:
            if total <= self.keep_bytes:
                break
            if path in unused:
                total -= size
                path.unlink(missing_ok=True)
                for each in sidecars(path):
                    each.unlink(missing_ok=True)
                removed.append(path)
        try:
            Trash(self.path).purge(time.time_ns(), max(0, self.keep_bytes - total))
        except RecordingError as error:
            _LOG.warning("the trash cannot be emptied: %s", error)
        return removed

    def _unused(self) -> Iterator[Path]:
        """Yield the files that no recorder is writing, sorted by name."""
        for path in sorted(filter(Path.is_file, self.path.glob(_PATTERN))):
            with contextlib.suppress(OSError), path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                about = path.stat()
                # A new empty file may belong to another recorder that is about to lock it.
                if about.st_size or time.time() - about.st_mtime > _NEW_S:
                    yield path


def _complete(path: Path) -> bool:
    """Rewrite a truncated file with an index; return whether it has any message.

    Raises:
        OSError: If the copy does not fit on the disk.
        RecordingError: If the decompressed messages are implausibly large.
    """
    most = _FREE_BYTES + _MOST_RATIO * path.stat().st_size
    unfinished = path.with_name(path.name + _UNFINISHED)
    count = 0
    try:
        with unfinished.open("wb") as file:
            writer = McapWriter(file)
            for entry in _until_cut(path):
                writer.add(entry)
                count += 1
                most -= len(entry.data)
                if most < 0:
                    raise RecordingError("its messages are far larger than the file")
            writer.finish()
            file.flush()
            os.fsync(file.fileno())
        if count:
            times = path.stat()
            os.utime(unfinished, ns=(times.st_atime_ns, times.st_mtime_ns))
            unfinished.replace(path)
        else:
            path.unlink()
    finally:
        unfinished.unlink(missing_ok=True)
    return count > 0


def _until_cut(path: Path) -> Iterator[Entry]:
    with contextlib.suppress(RecordingError):  # Even the start of the file may be missing.
        yield from entries(path)


class Catalogue:
    """Catalogue of a folder; rereads a file only if it or its marks have changed."""

    def __init__(self, folder: Path, reader: FolderReader | RemoteFolderReader) -> None:
        self.folder = folder
        self._reader = reader
        self._known: dict[Path, tuple[tuple[object, ...], RecordingSummary | None]] = {}

    def recordings(self) -> dict[Path, RecordingSummary]:
        """Return the summaries of all readable recordings, latest first."""
        known, self._known = self._known, {}
        for path in self.folder.glob("*.mcap"):
            if not is_recording_name(path.name):
                continue
            stamp = tuple(_stamp(each) for each in (path, *sidecars(path)))
            if path not in known or known[path][0] != stamp:
                known[path] = stamp, self._summary(path)
            self._known[path] = known[path]
        found = [
            (path, summary) for path, (_, summary) in self._known.items() if summary is not None
        ]
        found.sort(key=lambda item: (item[1].start_ns, item[0].name), reverse=True)
        return dict(found)

    def close(self) -> None:
        """Close the files that are being written."""
        self._reader.close()

    def _summary(self, path: Path) -> RecordingSummary | None:
        try:
            return self._reader.listing(path)
        except RecordingError:
            return None


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return modification time, ns, and size of a file, or None if it does not exist."""
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_mtime_ns, about.st_size
