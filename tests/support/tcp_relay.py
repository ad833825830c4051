"""TCP relay in front of a robot; it sees when a connection has been given up, and can delay one."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Generator
from typing import Self


class Relay:
    """TCP relay that closes both sides when one closes; the first connection may have to wait."""

    def __init__(
        self,
        endpoint: str,
        on_given_up: Callable[[], None] = lambda: None,
        first_wait_s: float = 0.0,
    ) -> None:
        self._to = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open: set[socket.socket] = set()
        self._threads = [threading.Thread(target=self._accept)]
        self.endpoint = f"{endpoint[:3]}/127.0.0.1:{self._listener.getsockname()[1]}"
        self._on_given_up = on_given_up
        self._wait_s, self._cut = first_wait_s, False

    def __enter__(self) -> Self:
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._threads[0].join()
        for one in self._open:
            _hang_up(one)
        for thread in self._threads:
            thread.join()
        for one in (*self._open, self._listener):
            one.close()

    @contextlib.contextmanager
    def cut(self) -> Generator[None]:
        """Hang up all connections, and relay none until the end."""
        self._cut = True
        for one in tuple(self._open):
            _hang_up(one)
        try:
            yield
        finally:
            self._cut = False

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if self._cut:
                near.close()
                continue
            time.sleep(self._wait_s)
            self._wait_s = 0.0
            far = socket.create_connection(self._to)
            self._open |= {near, far}
            thread = threading.Thread(target=self._carry, args=(near, far))
            self._threads.append(thread)
            thread.start()

    def _carry(self, near: socket.socket, far: socket.socket) -> None:
        back = threading.Thread(target=_pump, args=(far, near))
        back.start()
        _pump(near, far)
        back.join()
        self._on_given_up()


def _pump(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while block := source.recv(65536):
            sink.sendall(block)
    for one in (source, sink):
        _hang_up(one)


def _hang_up(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
