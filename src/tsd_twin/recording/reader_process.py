"""Process that reads recordings: `python -m tsd_twin.recording.reader_process FD`.

It forks a reader for each connection that it receives, see `remote`. All exit with the dashboard.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import msgspec

from tsd_twin.errors import RecordingError
from tsd_twin.recording.details import read_details, read_lanes
from tsd_twin.recording.reader import FolderReader, RecordingReader
from tsd_twin.recording.remote import MOST_ANSWER_BYTES, receive, send

NICE = 5
"""Lower priority, so that commands and STOP of the dashboard are not delayed."""
CPU_S = 10
"""CPU time limit per request."""
MEMORY_BYTES = 768 << 20
"""Memory limit of a reader, in addition to the process itself."""
_MOST_REQUEST_BYTES = 1 << 16


_READ_ONCE: dict[str, Callable[[RecordingReader, int], Any]] = {
    "details": read_details,
    "lanes": read_lanes,
}
"""Requests that open the file, read and close it, with the number of samples."""


class _Reader:
    """Answers the requests of a connection."""

    def __init__(self) -> None:
        self._folder = FolderReader()
        self._open: RecordingReader | None = None

    def answer(self, name: str, *arguments: Any) -> Any:
        if name == "listing":
            return self._folder.listing(Path(arguments[0]))
        if name in _READ_ONCE:
            path, count = arguments
            with contextlib.closing(RecordingReader(Path(path))) as recording:
                return _READ_ONCE[name](recording, count)
        if name == "open":
            self._open = RecordingReader(Path(arguments[0]))
            return None
        if self._open is None:
            raise RecordingError("no recording is open")
        return getattr(self._open, name)(*arguments)


def serve(connection: socket.socket) -> None:
    """Answer requests until the connection is closed."""
    reader = _Reader()
    while True:
        try:
            request = msgspec.msgpack.decode(receive(connection, _MOST_REQUEST_BYTES))
        except (EOFError, OSError):
            return
        _allow_cpu()
        try:
            answer = msgspec.msgpack.encode(["", reader.answer(*request)])
            if len(answer) > MOST_ANSWER_BYTES:
                raise RecordingError("there is too much in this recording to be shown")
        except RecordingError as error:
            answer = msgspec.msgpack.encode([str(error), None])
        except Exception as error:  # An unforeseen file must not end the listing.
            problem = f"this recording cannot be read: {type(error).__name__}"
            answer = msgspec.msgpack.encode([problem, None])
        try:
            send(connection, answer)
        except OSError:  # The page was closed.
            return


def _allow_cpu() -> None:
    used = resource.getrusage(resource.RUSAGE_SELF)
    until_s = int(used.ru_utime + used.ru_stime) + CPU_S + 1
    resource.setrlimit(resource.RLIMIT_CPU, (until_s, resource.RLIM_INFINITY))


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    # If memory runs out, the kernel should kill a reader, not the dashboard.
    Path("/proc/self/oom_score_adj").write_text("1000", "ascii")


def main(requests: socket.socket) -> NoReturn:
    """Fork a reader for each connection until the dashboard exits."""
    os.nice(NICE)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # Readers are reaped automatically.
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while True:
        data, fds, *_ = socket.recv_fds(requests, 1, 1)
        if not data:
            sys.exit()
        if os.fork() == 0:
            requests.close()
            with socket.socket(fileno=fds[0]) as connection:
                _limit_memory()
                serve(connection)
            os._exit(0)
        os.close(fds[0])


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
