"""Readers of recordings in other processes, so that no file can block the caller.

One process starts with the first file and forks a reader for each connection. A reader has a CPU
time limit per request, a memory limit, and lower priority than the dashboard. If it exceeds a limit
it ends, and the request raises a `RecordingError`.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from tsd_twin.errors import RecordingError
from tsd_twin.recording.details import RecordingDetails, RobotLanes
from tsd_twin.recording.events import Annotation, RecordedEvent
from tsd_twin.recording.reader import Contents, RecordingSummary, RobotStates

MOST_ANSWER_BYTES = 2 << 20
_PATIENCE_S = 60.0
"""Timeout for a reader that waits for the disk."""
LENGTH = struct.Struct("<I")
"""Length prefix of messages between the processes."""
T = TypeVar("T")


class ReaderProcesses:
    """Starts reader processes; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._requests: socket.socket | None = None

    def close(self) -> None:
        """Stop starting readers; running ones end when closed."""
        with self._lock:
            self._end()

    def connect(self) -> socket.socket:
        """Start a reader and return a connection to it.

        Raises:
            RecordingError: If no process can be started.
        """
        with self._lock:
            if self._process is not None and self._process.poll() is not None:
                self._end()
            try:
                return self._connect(self._start() if self._requests is None else self._requests)
            except OSError as error:
                self._end()
                raise RecordingError(f"no reader can be started: {error.strerror}") from error

    def _connect(self, requests: socket.socket) -> socket.socket:
        mine, its = socket.socketpair()
        with its:
            mine.settimeout(_PATIENCE_S)
            socket.send_fds(requests, [b"+"], [its.fileno()])
            return mine

    def _start(self) -> socket.socket:
        requests, its = socket.socketpair()
        with its:
            command = [sys.executable, "-P", "-m", "tsd_twin.recording.reader_process"]
            self._process = subprocess.Popen(  # noqa: S603  Our own program.
                [*command, str(its.fileno())],
                pass_fds=[its.fileno()],
                stdin=subprocess.DEVNULL,
                process_group=0,  # Ctrl-C is for the dashboard, which ends its readers.
            )
        self._requests = requests
        return requests

    def _end(self) -> None:
        if self._requests is not None:
            self._requests.close()
        if self._process is not None:
            self._process.wait()
        self._process = self._requests = None


class RemoteFolderReader:
    """`FolderReader` in another process, which is restarted if it ended."""

    def __init__(self, processes: ReaderProcesses) -> None:
        self._processes = processes
        self._connection: _Connection | None = None

    def close(self) -> None:
        """End the process."""
        if self._connection is not None:
            self._connection.close()

    def listing(self, path: Path) -> RecordingSummary:
        """See `FolderReader.listing`."""
        return self._ask(path, "listing", RecordingSummary)

    def details(self, path: Path, points: int) -> RecordingDetails:
        """See `read_details`."""
        return self._ask(path, "details", RecordingDetails, points)

    def lanes(self, path: Path, count: int) -> tuple[float, dict[str, RobotLanes]]:
        """See `read_lanes`."""
        return self._ask(path, "lanes", tuple[float, dict[str, RobotLanes]], count)

    def _ask(self, path: Path, name: str, kind: type[T], *arguments: Any) -> T:
        if self._connection is None or self._connection.has_ended:
            self._connection = _Connection(self._processes.connect())
        return self._connection.ask(path, name, kind, str(path), *arguments)


class RemoteReader:
    """`RecordingReader` in another process; thread-safe."""

    def __init__(self, path: Path, processes: ReaderProcesses) -> None:
        """Open a recording.

        Raises:
            RecordingError: If the file is not a recording, or requires too much time or memory.
        """
        self._path = path
        self._connection = _Connection(processes.connect())
        try:
            self._ask("open", None, str(path))
        except BaseException:
            self._connection.close()
            raise

    def close(self) -> None:
        """End the process."""
        self._connection.close()

    def contents(self) -> Contents:
        """See `RecordingReader.contents`."""
        return self._ask("contents", Contents)

    def states(self, robot_ids: Sequence[str], at_ns: int) -> dict[str, RobotStates]:
        """See `RecordingReader.states`."""
        return self._ask("states", dict[str, RobotStates], robot_ids, at_ns)

    def next_status_ns(self, robot_id: str, at_ns: int, back: bool) -> int | None:
        """See `RecordingReader.next_status_ns`."""
        return self._ask("next_status_ns", int | None, robot_id, at_ns, back)

    def events(self) -> list[RecordedEvent]:
        """See `RecordingReader.events`."""
        return self._ask("events", list[RecordedEvent])

    def marks(self) -> list[Annotation]:
        """See `RecordingReader.marks`."""
        return self._ask("marks", list[Annotation])

    def _ask(self, name: str, kind: Any, *arguments: Any) -> Any:
        return self._connection.ask(self._path, name, kind, *arguments)


class _Connection:
    """Sequential requests to a reader."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self.has_ended = False

    def close(self) -> None:
        self.has_ended = True
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)  # Wake a thread that waits in `ask`.
        self._connection.close()

    def ask(self, path: Path, name: str, kind: Any, *arguments: Any) -> Any:
        try:
            with self._lock:
                send(self._connection, msgspec.msgpack.encode([name, *arguments]))
                answer = receive(self._connection, MOST_ANSWER_BYTES)
        except (OSError, EOFError) as error:
            self.close()
            raise RecordingError(
                f"{path} cannot be shown: reading it takes too much time or memory"
            ) from error
        problem, value = msgspec.msgpack.decode(answer, type=tuple[str, msgspec.Raw])
        if problem:
            raise RecordingError(problem)
        return msgspec.msgpack.decode(value, type=kind)


def send(connection: socket.socket, message: bytes) -> None:
    """Send a message with its length.

    Raises:
        OSError: If the other side has closed the connection.
    """
    connection.sendall(LENGTH.pack(len(message)) + message)


def receive(connection: socket.socket, most: int) -> bytes:
    """Receive a message of at most `most` bytes.

    Raises:
        EOFError: If the other side has closed the connection or sends more.
        OSError: If nothing is received within the timeout.
    """
    (length,) = LENGTH.unpack(_received(connection, LENGTH.size))
    if length > most:
        raise EOFError
    return _received(connection, length)


def _received(connection: socket.socket, length: int) -> bytes:
    data = bytearray()
    while len(data) < length:
        part = connection.recv(min(length - len(data), 1 << 18))
        if not part:
            raise EOFError
        data += part
    return bytes(data)
