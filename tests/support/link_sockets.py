"""Plain sockets at both ends of an emulated link."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Generator
from typing import NamedTuple

from tsd_twin.link_emulation import LinkEmulator, LinkSpec

PATIENCE_S = 60.0
ANY = ("127.0.0.1", 0)


class Ends(NamedTuple):
    """Both ends of a TCP connection through a link."""

    simulator: LinkEmulator
    client: socket.socket
    target: socket.socket


def port_of(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


@contextlib.contextmanager
def simulated(spec: str, protocol: str, port: int) -> Generator[LinkEmulator]:
    """Run a link towards a port of this machine."""
    text, target = LinkSpec.parse(spec), f"{protocol}/127.0.0.1:{port}"
    with LinkEmulator(text, f"{protocol}/127.0.0.1:0", target) as simulator:
        yield simulator


@contextlib.contextmanager
def listening() -> Generator[socket.socket]:
    """Listen as a target does."""
    with socket.create_server(ANY) as server:
        server.settimeout(PATIENCE_S)
        yield server


@contextlib.contextmanager
def connected(spec: str) -> Generator[Ends]:
    """Connect through a link, and hold both ends."""
    with listening() as server, simulated(spec, "tcp", server.getsockname()[1]) as simulator:
        address = ("127.0.0.1", port_of(simulator.endpoint))
        with socket.create_connection(address, PATIENCE_S) as client:
            target, _ = server.accept()
            with target:
                target.settimeout(PATIENCE_S)
                client.sendall(b"?")  # What arrives shows that the handshake is over.
                assert read_all(target, 1) == b"?"
                yield Ends(simulator, client, target)


@contextlib.contextmanager
def datagram_socket() -> Generator[socket.socket]:
    """Open a socket for datagrams on a free port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(ANY)
        made.settimeout(PATIENCE_S)
        yield made


def read_all(source: socket.socket, count: int | None = None) -> bytes:
    """Read `count` bytes, or until the end."""
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
