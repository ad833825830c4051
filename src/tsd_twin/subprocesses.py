"""Subprocesses of a program: started together, ended together, with free ports."""

from __future__ import annotations

import contextlib
import random
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Generator
from typing import IO

from tsd_twin.errors import TwinError

ANY_PORTS = range(20_000, 30_000)
"""Search range for free ports, below the ephemeral ports that operating systems assign."""
PATIENCE_S = 30.0
"""Timeout for a program to become ready."""


class Subprocess:
    """A running child process; its output is forwarded, and its `ready:` line is stored."""

    def __init__(self, name: str, process: subprocess.Popen[str], stop: threading.Event) -> None:
        self._name = name
        self._process = process
        self._stop = stop
        self._ready = threading.Event()
        self._line = ""
        assert process.stdout is not None  # noqa: S101  Opened as a pipe by `start_program`.
        threading.Thread(target=self._read, args=(process.stdout,), daemon=True).start()

    def wait_for(self) -> str:
        """Wait for the `ready:` line of the program, and return it.

        Raises:
            TwinError: it ended, or took too long.
        """
        if not self._ready.wait(PATIENCE_S):
            raise TwinError(f"{self._name} was not ready within {PATIENCE_S:g} s")
        if not self._line:
            if self._process.wait(PATIENCE_S) == 0:
                sys.exit(0)  # A signal ended it while starting, as by Ctrl-C.
            raise TwinError(f"{self._name} ended before it was ready; see above")
        return self._line

    def _read(self, output: IO[str]) -> None:
        for line in output:
            if line.startswith("ready: "):
                self._line = line.strip()
                self._ready.set()
        self._ready.set()
        self._stop.set()  # The parent ends when one of its programs ends.


@contextlib.contextmanager
def start_program(arguments: list[str], stop: threading.Event) -> Generator[Subprocess]:
    """Context manager that runs one of the project's programs and ends it on exit."""
    # Its own process group: Ctrl-C reaches the parent only, which ends the children in order. When
    # the parent is killed, the broken pipe ends them.
    process = subprocess.Popen(  # noqa: S603  The program is ours, the flags went through argparse.
        [sys.executable, "-m", *arguments, "--until-eof"],
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield Subprocess(arguments[0].replace("_", "-"), process, stop)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def free_port(chosen: int | None, usual: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Chosen port if it is free; when none was chosen the usual one, or any free one.

    Raises:
        TwinError: the chosen port is in use, or is none.
    """
    anywhere = random.sample(ANY_PORTS, 32)
    for port in anywhere if chosen == 0 else (chosen,) if chosen else (usual, *anywhere):
        with socket.socket(type=kind) as probe:
            if kind is socket.SOCK_STREAM:
                # As servers do, so that a port that was in use a minute ago counts as free.
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except (OSError, OverflowError):
                continue
            return port
    raise TwinError(f"port {chosen} cannot be used: choose another, or 0 for any free one")
