"""Raw HTTP on a socket: requests and bytes that no browser sends."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Generator

from tests.support.page_client import PATIENCE_S
from tests.support.withheld import Stopwatch

FORM = "application/x-www-form-urlencoded"


def dial(port: int) -> socket.socket:
    """Open a connection to this machine."""
    return socket.create_connection(("127.0.0.1", port), PATIENCE_S)


@contextlib.contextmanager
def dialled(port: int, count: int) -> Generator[list[socket.socket]]:
    """Open many connections, and close them afterwards."""
    opened = [dial(port) for _ in range(count)]
    try:
        yield opened
    finally:
        for each in opened:
            each.close()


def request(port: int, method: str, path: str, *lines: str, body: bytes = b"") -> bytes:
    """Return the bytes of a request; `lines` are headers beside those that it needs."""
    head = [f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{port}", *lines]
    if method == "POST":
        head += [f"Origin: http://127.0.0.1:{port}", f"Content-Length: {len(body)}"]
    return "\r\n".join([*head, "", ""]).encode("latin-1") + body


def status_of(connection: socket.socket) -> int:
    """Return the status of the next answer, 0 when the other side has closed."""
    got = b""
    with contextlib.suppress(ConnectionError):
        while b"\r\n" not in got:
            if not (more := connection.recv(4096)):
                break
            got += more
    return int(got.split()[1]) if got else 0


def answer(port: int, data: bytes) -> int:
    """Send bytes on a connection of their own and return the status of the answer."""
    with dial(port) as connection:
        connection.sendall(data)
        return status_of(connection)


def is_closed(connection: socket.socket) -> bool:
    """Return whether the other side has closed; what it has sent is thrown away."""
    connection.setblocking(False)
    try:
        while connection.recv(65536):
            pass
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def closed_after_s(connections: list[socket.socket], patience_s: float = PATIENCE_S) -> float:
    """Return how long it took until all connections were closed, less withheld time, in seconds.

    Raises:
        TimeoutError: some are still open.
    """
    watch = Stopwatch()
    left = connections
    while left := [each for each in left if not is_closed(each)]:
        if watch.took_s > patience_s:
            raise TimeoutError(f"{len(left)} are open after {patience_s:g} s")
        time.sleep(0.02)
    return watch.took_s


MALFORMED: tuple[tuple[str, str, bytes], ...] = (
    ("a multipart body without a boundary", "multipart/form-data", b"--x\r\n\r\n"),
    (
        "a part without a name",
        "multipart/form-data; boundary=x",
        b"--x\r\nContent-Disposition: form-data\r\n\r\nalice\r\n--x--\r\n",
    ),
    ("an unknown charset", f"{FORM}; charset=klingon", b"name=alice&password=x"),
    ("another charset", f"{FORM}; charset=utf-16", b"name=alice&password=x"),
    ("bytes that are not UTF-8", FORM, b"name=\xff\xfe&password=\xc3\x28"),
    ("escapes that are not UTF-8", FORM, b"name=%ff%fe&password=%c3%28"),
    ("a field without a value", FORM, b"name&password"),
    ("a field that comes twice", FORM, b"name=alice&name=bob&password=x"),
    ("a field that is not in the form", FORM, b"name=alice&password=x&role=operator"),
    ("half a form", FORM, b"name=alice"),
    ("no body", FORM, b""),
    ("JSON", "application/json", b'{"name":"alice","password":"x"}'),
    ("no type", "", b"name=alice&password=x"),
    ("100 kB", FORM, b"name=alice&password=" + b"x" * 100_000),
    ("a thousand fields", FORM, b"a=1&" * 500 + b"name=alice"),
)
"""What it is, its type, and the body."""


def malformed(port: int, kind: str, body: bytes) -> bytes:
    """Return a login with such a body."""
    return request(port, "POST", "/login", *([f"Content-Type: {kind}"] if kind else []), body=body)
