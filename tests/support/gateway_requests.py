"""HTTP requests to the gateway: raw bytes, logins, and nginx as in docs/access.md."""

from __future__ import annotations

import contextlib
import http.client
import shutil
import socket
import subprocess
import time
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import urlencode, urlsplit

from tests.support.link_sockets import free_port
from tests.support.markdown_pages import code, page
from tests.support.withheld import PATIENCE_S, Stopwatch
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.security import Role
from tsd_twin.security.rate_limits import AttemptLimits, LoginRateLimiter
from tsd_twin.security.users import Logins, Users

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
    """Return the bytes of a request; `lines` are additional headers."""
    head = [f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{port}", *lines]
    if method == "POST":
        head += [f"Origin: http://127.0.0.1:{port}", f"Content-Length: {len(body)}"]
    return "\r\n".join([*head, "", ""]).encode("latin-1") + body


def status_of(connection: socket.socket) -> int:
    """Return the status of the next response, or 0 if the peer has closed."""
    got = b""
    with contextlib.suppress(ConnectionError):
        while b"\r\n" not in got:
            if not (more := connection.recv(4096)):
                break
            got += more
    return int(got.split()[1]) if got else 0


def answer(port: int, data: bytes) -> int:
    """Send bytes on a new connection and return the status of the response."""
    with dial(port) as connection:
        connection.sendall(data)
        return status_of(connection)


def is_closed(connection: socket.socket) -> bool:
    """Discard received bytes; return whether the peer has closed."""
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
    """Return the time until all connections are closed, less withheld time, in seconds.

    Raises:
        TimeoutError: If connections remain open.
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
"""Description, content type and body."""


def malformed(port: int, kind: str, body: bytes) -> bytes:
    """Return a login request with a malformed body."""
    return request(port, "POST", "/login", *([f"Content-Type: {kind}"] if kind else []), body=body)


PHRASE = "correct horse battery"


@cache
def users() -> Users:
    """Return drivers Alice and Bob, viewer Guest, and Eve, a viewer who may stop; same password."""
    made = Users({})
    made.put("alice", Role.OPERATOR, PHRASE, may_stop=False)
    made.put("bob", Role.OPERATOR, PHRASE, may_stop=False)
    made.put("guest", Role.VIEWER, PHRASE, may_stop=False)
    made.put("eve", Role.VIEWER, PHRASE, may_stop=True)
    return made


def limiting(free: int, first_s: float) -> AuthMiddleware:
    """Return an access check with another limit on failed logins per address."""
    addresses = LoginRateLimiter(free=free, first_s=first_s, longest_s=900.0)
    logins = Logins(attempts=AttemptLimits(addresses))
    return AuthMiddleware(AccessSettings(users=users()), logins)


def ask(
    port: int, method: str, path: str, body: str = "", **headers: str
) -> tuple[http.client.HTTPResponse, str]:
    """Send one request like a page; underscores in header names become dashes."""
    fixed = {"Origin": f"http://127.0.0.1:{port}"} if method == "POST" else {}
    fixed |= {"Content-Type": "application/x-www-form-urlencoded"} if body else {}
    fixed |= {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)) as connection:
        connection.request(method, path, body=body or None, headers=fixed)
        answer = connection.getresponse()
        return answer, answer.read().decode()


def log_in(
    port: int, name: str, password: str = PHRASE, **headers: str
) -> tuple[http.client.HTTPResponse, str]:
    """Send the form of the login page."""
    form = urlencode({"name": name, "password": password})
    return ask(port, "POST", "/login", form, **headers)


def cookie_of(port: int, name: str, **headers: str) -> str:
    """Log in and return the `Cookie` header for further requests."""
    answer, body = log_in(port, name, **headers)
    assert answer.status == 303, body
    return answer.headers["Set-Cookie"].split(";")[0]


_MAIN = """daemon off;
master_process off;
pid {folder}/nginx.pid;
error_log stderr warn;
events {{}}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    include {folder}/site.conf;
}}
"""


def executable() -> str:
    """Return the path of the nginx that `scripts/ensure_servers` installs."""
    found = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
    assert found, "there is no nginx: run scripts/ensure_servers"
    return found


@dataclass
class Proxy:
    """nginx on a free port, started when its upstream is known."""

    folder: Path
    keys: Path
    port: int
    process: subprocess.Popen[bytes] | None = None

    def pass_on_to(self, url: str) -> None:
        """Start with the documented configuration, except for ports and files."""
        (text,) = code(page("access.md"), "nginx")
        changes = {
            "listen 443 ssl": f"listen 127.0.0.1:{self.port} ssl",
            "127.0.0.1:8080": urlsplit(url).netloc,
            "/etc/ssl/robots.pem": str(self.keys / "robot.pem"),
            "/etc/ssl/robots.key": str(self.keys / "robot.key"),
            # Redirects by nginx contain the port unless it is the default.
            "return 301 /twin/": f"return 301 https://$host:{self.port}/twin/",
        }
        for before, after in changes.items():
            assert text.count(before) == 1, before
            text = text.replace(before, after)
        (self.folder / "site.conf").write_text(text)
        main = self.folder / "nginx.conf"
        main.write_text(_MAIN.format(folder=self.folder))
        self.process = subprocess.Popen(
            [executable(), "-p", str(self.folder), "-e", "stderr", "-c", str(main)]
        )
        end_s = time.monotonic() + PATIENCE_S
        while True:
            assert self.process.poll() is None, "nginx has ended"
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            assert time.monotonic() < end_s, "nginx does not listen"
            time.sleep(0.02)


@contextmanager
def nginx(folder: Path, keys: Path) -> Generator[Proxy]:
    """Yield a proxy that starts later, because it and the dashboard need each other's address."""
    made = Proxy(folder, keys, free_port())
    try:
        yield made
    finally:
        if made.process is not None:
            made.process.terminate()
            made.process.wait(PATIENCE_S)
