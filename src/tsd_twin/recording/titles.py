"""Titles of recordings and rules for their file names.

A title is stored in a text file next to the recording. The recording itself is never renamed,
because links, open readers and the recorder identify it by its file name.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import unicodedata
from pathlib import Path

from tsd_twin.errors import RecordingError
from tsd_twin.recording.events import marks_file

TITLE_LENGTH = 40
"""Maximum length of a title, characters in NFC."""
_ENDING = ".title"
_MOST_TITLE_BYTES = 1024
_MOST_NAME_BYTES = 240
"""Leaves room for the endings of marks and titles."""
_CONTROLS = ("Cc", "Cs", "Cn", "Co", "Zl", "Zp")
"""Categories of characters that a title cannot contain."""
_BIDIRECTIONAL = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that can reverse the text after a title."""


class FolderError(RecordingError):
    """A change of the recordings folder is refused; `code` identifies the reason."""

    def __init__(self, code: str, text: str) -> None:
        self.code = code
        super().__init__(text)


def is_recording_name(name: str) -> bool:
    """Return whether a name is a file name of a recording, in any script, not a path."""
    try:
        size = len(name.encode())
    except UnicodeEncodeError:  # A file name that is not UTF-8.
        return False
    return (
        name.endswith(".mcap")
        and not name.startswith(".")
        and size <= _MOST_NAME_BYTES
        and "/" not in name
        and not any(unicodedata.category(each) in _CONTROLS for each in name)
    )


def title_file(recording: Path) -> Path:
    """Return the path of a recording's title, which may not exist."""
    return recording.with_name(recording.name.removesuffix(".mcap") + _ENDING)


def sidecars(recording: Path) -> tuple[Path, Path]:
    """Return the files that belong to a recording: marks and title."""
    return marks_file(recording), title_file(recording)


def clean_title(text: str) -> str:
    """Return a title in NFC with single spaces.

    Raises:
        FolderError: If it is too long or contains control characters.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise FolderError("invalid_title", "a title is Unicode text") from error
    title = " ".join(unicodedata.normalize("NFC", text).split())
    if len(title) > TITLE_LENGTH:
        raise FolderError("invalid_title", f"a title has at most {TITLE_LENGTH} characters")
    if any(each in _BIDIRECTIONAL or unicodedata.category(each) in _CONTROLS for each in title):
        raise FolderError("invalid_title", "a title cannot contain control characters")
    return title


def read_title(recording: Path) -> str:
    """Return the title of a recording, or an empty text if it has no valid one."""
    try:
        with title_file(recording).open("rb") as file:
            return clean_title(file.read(_MOST_TITLE_BYTES).decode())
    except (OSError, UnicodeDecodeError, FolderError):
        return ""


def write_title(recording: Path, text: str) -> str:
    """Set the title of a recording and return it; an empty title removes it.

    Raises:
        FolderError: If the title is invalid or the recording does not exist.
        RecordingError: If the title cannot be written.
    """
    title = clean_title(text)
    if not recording.is_file():
        raise FolderError("no_recording", "there is no such recording")
    target = title_file(recording)
    # Readers see the old title or the new one, even after a crash.
    temporary = target.with_name(f".{secrets.token_hex(8)}{_ENDING}")
    try:
        if not title:
            target.unlink(missing_ok=True)
            return title
        with temporary.open("xb") as file:
            file.write(title.encode())
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise RecordingError(f"the title cannot be written: {error.strerror}") from error
    return title


def is_being_written(recording: Path) -> bool:
    """Return whether a recorder is writing or repairing a file.

    Raises:
        OSError: If the file cannot be opened.
    """
    fd = os.open(recording, os.O_RDONLY | os.O_NONBLOCK)
    try:
        # A shared lock, so that two dashboards do not take each other for a recorder.
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False
