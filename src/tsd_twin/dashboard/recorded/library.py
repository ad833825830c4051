"""Library of a recordings folder: list, search, titles, deletion and undo."""

from __future__ import annotations

import asyncio
import contextlib
import time
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.wire.recordings import RecordedLanes, RecordingRow, RowDetails, TrashRow
from tsd_twin.dashboard.wire.to_page import RecordedPath
from tsd_twin.errors import RecordingError
from tsd_twin.recording.details import RecordingDetails
from tsd_twin.recording.folder import Catalogue
from tsd_twin.recording.reader import RecordingSummary
from tsd_twin.recording.records import is_whole
from tsd_twin.recording.remote import ReaderProcesses, RemoteFolderReader
from tsd_twin.recording.titles import (
    FolderError,
    is_being_written,
    is_recording_name,
    read_title,
    write_title,
)
from tsd_twin.recording.trash import Deletion, Trash
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights

PATH_POINTS = 65
"""Positions of each robot in a path preview."""
LANE_SAMPLES = 300
"""Values of each robot in the lanes of a timeline."""
_GROWTH_BYTES = 1 << 20
"""Growth after which the details of an unfinished recording are read again."""
_GROWING_S = 10.0
"""Minimum time between two readings of a growing file."""
_TELL_S = 1.0
"""Interval of notifications while details are read."""
_WATCH_S = 2.0
_PURGE_S = 600.0


class _Known(NamedTuple):
    """Details of a file state, or None if unreadable, and when they were read."""

    stamp: tuple[int, ...]
    details: RecordingDetails | None
    read_s: float


class _FileState(NamedTuple):
    stamp: tuple[int, ...]
    writing: bool


class RecordingLibrary:
    """Recordings of a folder, for all pages; event loop only."""

    def __init__(self, folder: Path, processes: ReaderProcesses) -> None:
        self._folder = folder
        self._trash = Trash(folder)
        self._catalogue = Catalogue(folder, RemoteFolderReader(processes))
        self._listing = asyncio.Lock()
        # A separate reader, because a file may take seconds, and the list should not wait.
        self._reader = RemoteFolderReader(processes)
        self._reading = asyncio.Lock()
        self._known: dict[str, _Known] = {}
        self._background: asyncio.Task[None] | None = None
        self.on_changed: Callable[[], None] = lambda: None
        """Called after each change."""

    async def close(self) -> None:
        """End reading."""
        if self._background is not None:
            self._background.cancel()
            await asyncio.gather(self._background, return_exceptions=True)
        self._catalogue.close()
        self._reader.close()

    def file(self, name: str) -> Path:
        """Return the file of a recording.

        Raises:
            FolderError: If it does not exist.
        """
        # The name must be a file name, not a path, and is checked before it is used.
        if not is_recording_name(name) or not (self._folder / name).is_file():
            raise FolderError("no_recording", "there is no such recording")
        return self._folder / name

    async def permitted_file(self, name: str, rights: RobotRights) -> Path:
        """Return the file of a recording, for a user who may watch all robots in it.

        Raises:
            FolderError: If it does not exist or may not be watched.
        """
        path = self.file(name)
        if rights != EVERY_ROBOT:
            async with self._listing:
                found = await asyncio.to_thread(self._catalogue.recordings)
            if path not in found or not _may_watch(found[path], rights):
                raise FolderError("no_recording", "there is no such recording")
        return path

    async def may_change(self, name: str, rights: RobotRights) -> bool:
        """Return whether a user may use all robots in a recording, not only watch them.

        Raises:
            FolderError: If there is no recording that may be watched.
        """
        path = await self.permitted_file(name, rights)
        if rights == EVERY_ROBOT:
            return True
        async with self._listing:
            found = await asyncio.to_thread(self._catalogue.recordings)
        return path in found and all(map(rights.may_use, found[path].robots))

    # Lists.

    async def rows(self, query: str = "", rights: RobotRights = EVERY_ROBOT) -> list[RecordingRow]:
        """Return the recordings that contain all words of a query, latest first.

        Recordings with a robot that may not be watched are left out.

        Titles, names, drivers, robots, marks and faults are searched. Details are read in the
        background, so that later calls may return more.
        """
        async with self._listing:
            found = await asyncio.to_thread(self._catalogue.recordings)
            states = await asyncio.to_thread(_file_states, found)
        # Files that were deleted since are not in `states`.
        shown = {path: found[path] for path in states if found[path].robots}
        names = {path.name for path in shown}
        self._known = {name: known for name, known in self._known.items() if name in names}
        now_s = time.monotonic()
        pending = [path for path in shown if self._is_pending(path, states[path], now_s)]
        if pending and (self._background is None or self._background.done()):
            self._background = asyncio.create_task(self._read_all(pending))
        words = _folded(query).split()
        return [
            self._row(path, each, states[path])
            for path, each in shown.items()
            if _may_watch(each, rights) and self._contains(path, each, words)
        ]

    async def paths(self, path: Path) -> list[RecordedPath]:
        """Return the path preview of a recording.

        Raises:
            RecordingError: If it cannot be read.
        """
        details = await self._details(path)
        if details is None:
            raise RecordingError(f"{path} cannot be shown")
        return _paths(details)

    async def lanes(self, path: Path) -> list[RecordedLanes]:
        """Return mode, driver and speed of each robot over time.

        Raises:
            RecordingError: If it cannot be read.
        """
        async with self._reading:
            end_s, found = await asyncio.to_thread(self._reader.lanes, path, LANE_SAMPLES)
        return [
            RecordedLanes(each, end_s, lanes.modes, lanes.drivers, lanes.speeds)
            for each, lanes in found.items()
        ]

    async def trash(self) -> list[TrashRow]:
        """Return the deletions that can be undone, latest first."""
        found = await asyncio.to_thread(self._trash.deletions)
        return [_trash_row(each) for each in found]

    # Changes.

    async def set_title(self, name: str, text: str) -> tuple[str, str]:
        """Set the title of a recording; return the new title and the previous one.

        Raises:
            RecordingError: If it is refused or cannot be written.
        """
        path = self.file(name)
        before = await asyncio.to_thread(read_title, path)
        title = await asyncio.to_thread(write_title, path, text)
        self.changed()
        return title, before

    async def delete(self, name: str, by: str) -> TrashRow:
        """Move a recording to the trash.

        Raises:
            RecordingError: If it is refused or cannot be moved.
        """
        deletion = await asyncio.to_thread(self._trash.put, self.file(name), by, time.time_ns())
        self.changed()
        with contextlib.suppress(RecordingError):
            await asyncio.to_thread(self._trash.purge, time.time_ns())
        return _trash_row(deletion)

    async def restore(self, deletion: str) -> str:
        """Undo a deletion and return the name of the recording.

        Raises:
            RecordingError: If it is refused or cannot be moved.
        """
        path = await asyncio.to_thread(self._trash.restore, deletion)
        self.changed()
        return path.name

    def changed(self) -> None:
        """Report a change to all pages."""
        self.on_changed()

    async def watch(self) -> None:
        """Report changes by other programs and empty the trash; runs until cancelled."""
        before, purged_s = await asyncio.to_thread(self._stamp), -_PURGE_S
        while True:
            if time.monotonic() - purged_s > _PURGE_S:
                purged_s = time.monotonic()
                with contextlib.suppress(RecordingError):
                    await asyncio.to_thread(self._trash.purge, time.time_ns())
            await asyncio.sleep(_WATCH_S)
            stamp = await asyncio.to_thread(self._stamp)
            if stamp != before:
                before = stamp
                self.changed()

    def _stamp(self) -> tuple[int, ...]:
        """Return the times at which files were last added to or removed from folder and trash."""
        found: list[int] = []
        for folder in (self._folder, self._trash.path):
            with contextlib.suppress(OSError):
                found.append(folder.stat().st_mtime_ns)
        return tuple(found)

    # Details.

    def _is_pending(self, path: Path, state: _FileState, now_s: float) -> bool:
        known = self._known.get(path.name)
        if known is None:
            return True
        waits = state.writing and now_s - known.read_s < _GROWING_S
        return known.stamp != state.stamp and not waits

    async def _read_all(self, paths: list[Path]) -> None:
        told_s, news = time.monotonic(), False
        for path in paths:
            await self._details(path)
            news = True
            if time.monotonic() - told_s > _TELL_S:
                told_s, news = time.monotonic(), False
                self.changed()
        if news:
            self.changed()

    async def _details(self, path: Path) -> RecordingDetails | None:
        """Return the details of a recording, read if the file has changed; None if unreadable."""
        async with self._reading:
            known = await asyncio.to_thread(self._read, path, self._known.get(path.name))
            self._known[path.name] = known
            return known.details

    def _read(self, path: Path, known: _Known | None) -> _Known:
        now_s = time.monotonic()
        try:
            stamp = _stamp(path, whole=is_whole(path))
        except OSError:  # Deleted.
            return _Known((), None, now_s)
        if known is not None and known.stamp == stamp:
            return known
        try:
            return _Known(stamp, self._reader.details(path, PATH_POINTS), now_s)
        except RecordingError:
            return _Known(stamp, None, now_s)

    def _contains(self, path: Path, summary: RecordingSummary, words: Sequence[str]) -> bool:
        if not words:
            return True
        texts = [summary.title, path.name, *summary.robots, *summary.notes]
        known = self._known.get(path.name)
        if known is not None and known.details is not None:
            texts += [*known.details.drivers, *known.details.fault_texts]
        text = _folded("\n".join(texts))
        return all(word in text for word in words)

    def _row(self, path: Path, summary: RecordingSummary, state: _FileState) -> RecordingRow:
        known = self._known.get(path.name)
        details = None if known is None else known.details
        return RecordingRow(
            name=path.name,
            title=summary.title,
            start_ms=summary.start_ns // 1_000_000,
            duration_s=round(summary.duration_s, 1),
            robots=summary.robots,
            size_bytes=summary.size,
            writing=state.writing,
            marks=summary.marks,
            notes=summary.notes,
            details=None if details is None else _row_details(details),
            details_pending=known is None,
        )


def _may_watch(summary: RecordingSummary, rights: RobotRights) -> bool:
    """Return whether a user may watch a recording; other robots may join an unfinished one."""
    if rights == EVERY_ROBOT:
        return True
    return summary.is_whole and all(map(rights.may_watch, summary.robots))


def _file_states(found: Mapping[Path, RecordingSummary]) -> dict[Path, _FileState]:
    states: dict[Path, _FileState] = {}
    for path, summary in found.items():
        with contextlib.suppress(OSError):
            writing = not summary.is_whole and is_being_written(path)
            states[path] = _FileState(_stamp(path, whole=summary.is_whole), writing)
    return states


def _stamp(path: Path, *, whole: bool) -> tuple[int, ...]:
    """Return a value that changes when the details have to be read again."""
    about = path.stat()
    return (about.st_size, about.st_mtime_ns) if whole else (about.st_size // _GROWTH_BYTES,)


def _row_details(details: RecordingDetails) -> RowDetails:
    return RowDetails(details.drivers, details.stops, details.faults, _paths(details))


def _paths(details: RecordingDetails) -> list[RecordedPath]:
    roster = RobotRoster()
    return [
        RecordedPath(each, roster.css_colour(each), points)
        for each, points in details.tracks.items()
    ]


def _trash_row(deletion: Deletion) -> TrashRow:
    return TrashRow(
        id=deletion.id,
        name=deletion.name,
        title=deletion.title,
        by=deletion.by,
        deleted_ms=deletion.deleted_ns // 1_000_000,
        size_bytes=deletion.size,
    )


def _folded(text: str) -> str:
    """Return text for comparison regardless of case and of how characters are composed."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())
