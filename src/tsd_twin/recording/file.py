"""Recording file that is being written: chunks of MCAP, on the disk within a second."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import Writer

from tsd_twin.messages.ros import definition
from tsd_twin.recording.channels import Entry

PROFILE = "ros2"
LIBRARY = "tsd-twin"
_CHUNK_BYTES = 256 * 1024
_WAITING_BYTES = 32 * 1024 * 1024
"""What waits for a full disk; what comes later is lost."""


class RecordingFile:
    """MCAP file that entries are added to; `flush` puts them on the disk.

    It is always whole up to the last flush, also when the disk is full: what does not fit stays in
    memory and is tried again. The lock shows other recorders that the file is in use.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: it exists, or cannot be created.
        """
        self.path = path
        self.size = 0
        """Bytes on the disk."""
        self.lost = 0
        """Entries that were not recorded since the disk was full for too long."""
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        fcntl.flock(self._fd, fcntl.LOCK_EX)
        self._waiting = _Sink()
        self._writer = McapWriter(cast("IO[Any]", self._waiting))

    @property
    def waiting(self) -> int:
        """Bytes that are not on the disk."""
        return self._waiting.size

    def add(self, entry: Entry) -> None:
        """Add an entry, unless the disk has been full for too long."""
        if self._waiting.size > _WAITING_BYTES:
            self.lost += 1
        else:
            self._writer.add(entry)

    def flush(self) -> None:
        """Put all entries on the disk.

        Raises:
            OSError: the disk is full or broken; nothing is lost, and the next flush tries again.
        """
        self._writer.flush()
        self._write_waiting()

    def close(self) -> None:
        """Write the index, and close the file.

        Raises:
            OSError: it does not fit; the file is as after a power cut.
        """
        try:
            self._writer.finish()
            self._write_waiting()
        finally:
            os.close(self._fd)

    def _write_waiting(self) -> None:
        if not self._waiting.parts:
            return
        at = self.size
        try:
            for part in self._waiting.parts:
                view = memoryview(part)
                while view:
                    written = os.write(self._fd, view)
                    if written == 0:
                        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                    view, at = view[written:], at + written
            os.fsync(self._fd)
        except OSError:
            # A half written chunk would end the file for every reader.
            os.ftruncate(self._fd, self.size)
            os.lseek(self._fd, self.size, os.SEEK_SET)
            raise
        self.size = at
        self._waiting.clear()


class McapWriter:
    """Writer of entries to any stream, with the channels and schemas that they need."""

    def __init__(self, stream: IO[Any]) -> None:
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES)
        self._writer.start(profile=PROFILE, library=LIBRARY)
        self._channels: dict[tuple[str, str, str], int] = {}
        self._schemas: dict[str, int] = {}

    def add(self, entry: Entry) -> None:
        """Add an entry."""
        key = (entry.topic, entry.encoding, entry.type)
        if (channel := self._channels.get(key)) is None:
            schema = self._schema(entry.type) if entry.type else 0
            channel = self._writer.register_channel(entry.topic, entry.encoding, schema)
            self._channels[key] = channel
        self._writer.add_message(
            channel, entry.log_ns, entry.data, entry.publish_ns, entry.sequence
        )

    def flush(self) -> None:
        """End the chunk."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()

    def _schema(self, ros_type: str) -> int:
        if (schema := self._schemas.get(ros_type)) is None:
            text = definition(ros_type).encode()
            schema = self._writer.register_schema(ros_type, "ros2msg", text)
            self._schemas[ros_type] = schema
        return schema


class _Sink:
    """Stream that keeps what is written to it."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self._end = 0

    def write(self, data: bytes) -> int:
        if data:
            self.parts.append(bytes(data))
            self.size += len(data)
            self._end += len(data)
        return len(data)

    def tell(self) -> int:
        return self._end

    def flush(self) -> None:
        """Do nothing: the owner writes."""

    def clear(self) -> None:
        self.parts, self.size = [], 0
