"""Sockets at both ends of an emulated link, and a TCP relay that can hang up or delay."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Generator
from typing import NamedTuple, Self

from tests.support.withheld import PATIENCE_S
from tsd_twin.link_emulation import LinkEmulator, LinkSpec

ANY = ("127.0.0.1", 0)


class Ends(NamedTuple):
    """Both ends of a TCP connection through a link."""

    simulator: LinkEmulator
    client: socket.socket
    target: socket.socket


def free_port() -> int:
    """Return a free TCP port."""
    with socket.create_server(ANY) as probe:
        return probe.getsockname()[1]


def port_of(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


@contextlib.contextmanager
def simulated(spec: str, protocol: str, port: int) -> Generator[LinkEmulator]:
    """Run a link to a local port."""
    text, target = LinkSpec.parse(spec), f"{protocol}/127.0.0.1:{port}"
    with LinkEmulator(text, f"{protocol}/127.0.0.1:0", target) as simulator:
        yield simulator


@contextlib.contextmanager
def listening() -> Generator[socket.socket]:
    """Yield a listening target."""
    with socket.create_server(ANY) as server:
        server.settimeout(PATIENCE_S)
        yield server


@contextlib.contextmanager
def connected(spec: str) -> Generator[Ends]:
    """Connect through a link and yield both ends."""
    with listening() as server, simulated(spec, "tcp", server.getsockname()[1]) as simulator:
        address = ("127.0.0.1", port_of(simulator.endpoint))
        with socket.create_connection(address, PATIENCE_S) as client:
            target, _ = server.accept()
            with target:
                target.settimeout(PATIENCE_S)
                client.sendall(b"?")  # The byte arrives after the handshake.
                assert read_all(target, 1) == b"?"
                yield Ends(simulator, client, target)


@contextlib.contextmanager
def datagram_socket() -> Generator[socket.socket]:
    """Yield a datagram socket on a free port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(ANY)
        made.settimeout(PATIENCE_S)
        yield made


def read_all(source: socket.socket, count: int | None = None) -> bytes:
    """Read `count` bytes, or until the peer closes."""
    pieces: list[bytes] = []
    got = 0
    while count is None or got < count:
        piece = source.recv(65536 if count is None else min(65536, count - got))
        if not piece:
            break
        pieces.append(piece)
        got += len(piece)
    return b"".join(pieces)


def eventually(happens: Callable[[], bool]) -> None:
    """Poll a condition on counters of another thread."""
    end_s = time.monotonic() + PATIENCE_S
    while not happens():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.001)


class Relay:
    """TCP relay that closes both sides when one closes; it can delay the first connection."""

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
        """Close all connections, and accept none until the context ends."""
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
