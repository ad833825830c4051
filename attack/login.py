"""Attacks on access to the dashboard: logins, headers, connections, reverse proxy."""

from __future__ import annotations

import contextlib
import http.client
import re
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode, urlsplit

from attack.table import Row
from tests.support.gateway_requests import (
    FORM,
    MALFORMED,
    PHRASE,
    answer,
    cookie_of,
    dial,
    is_closed,
    malformed,
    nginx,
    request,
)
from tests.support.page_client import Page, tls_connection
from tests.support.programs import Program
from tsd_twin.dashboard.gateway.connection_limits import ConnectionLimits
from tsd_twin.security import Role
from tsd_twin.security.users import Users

_PAGE = "0123456789abcdef"
_MEASURE_S = 3.0
_LOAD_PER_S = 200.0
_CLIENTS = 4
_LAX_HOSTS = (
    "{}#.evil.com",
    "{}?x",
    "{}/",
    "evil@{}",
    "{},{}",
    "[127.0.0.1]:{port}",
    "127.1:{port}",
)
_LAX_ORIGINS = (
    *("file://{}", "chrome-extension://{}", "ftp://{}", "ws://{}", "http://{}#.evil.com"),
    *("http://{}?x", "http://{}/", "http://evil@{}", "null"),
)


@dataclass
class _Site:
    """Processes of a simulated robot and a dashboard with users, and their output."""

    folder: Path
    dashboard: Program
    endpoint: str
    url: str

    @property
    def port(self) -> int:
        return int(urlsplit(self.url).port or 0)

    def memory_mb(self) -> float:
        """Memory of the dashboard, MB."""
        status = Path(f"/proc/{self.dashboard.process.pid}/status").read_text()
        return int(re.findall(r"VmRSS:\s+(\d+)", status)[0]) / 1000.0


@contextmanager
def _site(folder: Path, *flags: str) -> Generator[_Site]:
    started: list[Program] = []
    try:
        started.append(Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0"]))
        endpoint = started[0].ready().split()[-1]
        users = str(folder / "users.toml")
        flags = ("--port", "0", "--connect", endpoint, "--users", users, *flags)
        started.append(Program(["tsd_dashboard", *flags]))
        url = re.findall(r"https?://\S+", started[1].ready())[0]
        yield _Site(folder, started[1], endpoint, url)
    finally:
        for program in started:
            program.process.terminate()
        for program in started:
            program.clean_up()


def rows() -> Iterator[Row]:
    """Yield one row per attack."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _make_users(folder)
        with _site(folder) as site:
            yield _open_bus(site)
            yield _bodies(site)
            yield from _names(site)
            yield from _crowd(site)
            yield from _slow(site)
            yield _frames(site)
        with _site(folder, *_tls(folder)) as site:
            yield _handshakes(site)
        yield from _proxied(folder)


def _make_users(folder: Path) -> None:
    users = Users({})
    for user in ("alice", "bob"):
        users.put(user, Role.OPERATOR, PHRASE, may_stop=False)
    users.put("guest", Role.VIEWER, PHRASE, may_stop=False)
    users.save(folder / "users.toml")
    hosts = ["--robot-host", "localhost", "--robot-host", "robots.example"]
    command = [sys.executable, "-m", "tsd_certs", str(folder / "keys"), *hosts]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _tls(folder: Path) -> list[str]:
    keys = folder / "keys"
    return ["--tls-cert", str(keys / "robot.pem"), "--tls-key", str(keys / "robot.key")]


# Contents of requests.


def _open_bus(site: _Site) -> Row:
    warnings = [
        line for line in site.dashboard.errors if "WARNING" in line and site.endpoint in line
    ]
    return Row(
        "--users beside a bus without certificates",
        "a warning before `ready:`",
        f"{len(warnings)} warning",
        len(warnings) == 1,
    )


def _bodies(site: _Site) -> Row:
    before = len(site.dashboard.errors)
    statuses = [answer(site.port, malformed(site.port, kind, body)) for _, kind, body in MALFORMED]
    lines = len(site.dashboard.errors) - before
    refused = sum(status in (400, 429) for status in statuses)
    right = refused == len(MALFORMED) and 429 in statuses and lines == 0
    return Row(
        f"{len(MALFORMED)} malformed login bodies",
        "400, after 5 of one address 429; no traceback",
        f"{refused} refused, {lines} lines on stderr",
        right,
    )


def _names(site: _Site) -> Iterator[Row]:
    ours = f"127.0.0.1:{site.port}"
    login = request(site.port, "GET", "/login")

    def passed(lax: tuple[str, ...], change: Callable[[str], bytes]) -> int:
        names = [each.replace("{}", ours).replace("{port}", str(site.port)) for each in lax]
        return sum(answer(site.port, change(name)) not in (400, 403) for name in names)

    hosts = passed(
        _LAX_HOSTS, lambda name: login.replace(f"Host: {ours}".encode(), f"Host: {name}".encode())
    )
    origins = passed(
        _LAX_ORIGINS, lambda name: request(site.port, "GET", "/login", f"Origin: {name}")
    )
    for what, lax, count in (("Host", _LAX_HOSTS, hosts), ("Origin", _LAX_ORIGINS, origins)):
        yield Row(
            f"{len(lax)} values of {what} that only resemble ours",
            "0 pass",
            f"{count} pass",
            count == 0,
            size=count,
        )


# Number and slowness of connections.


def _crowd(site: _Site) -> Iterator[Row]:
    time.sleep(6.0)  # The malformed bodies have rate-limited the address.
    cookie = _cookie(site)
    with _driving(Page(site.port, _PAGE, user="alice", cookie=cookie)) as page:
        calm = _accepted_per_s(page)
        opened = [dial(site.port) for _ in range(1000)]
        try:
            busy = _accepted_per_s(page)
            start_s = time.monotonic()
            cookie_of(site.port, "bob")
            login_s = time.monotonic() - start_s
            left = sum(not is_closed(each) for each in opened)
            start_s = time.monotonic()
            stopped = page.answer("stop", t="stop")["ok"]
            stop_s = time.monotonic() - start_s
        finally:
            for each in opened:
                each.close()
    share = busy / calm
    promise = f"{ConnectionLimits().per_address} stay open, commands 90 %, login 3 s, STOP 0.5 s"
    measured = f"{left} open, {share:.0%}, {login_s:.2f} s, {stop_s:.2f} s"
    held = (
        left <= ConnectionLimits().per_address
        and share > 0.9
        and login_s < 3.0
        and stop_s < 0.5
        and stopped
    )
    yield Row(
        "1,000 connections while an operator drives and another logs in", promise, measured, held
    )


def _slow(site: _Site) -> Iterator[Row]:
    cookie = _cookie(site)
    socket_ = (
        *("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"),
        *("Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", f"Cookie: {cookie}"),
    )
    limits = ConnectionLimits()
    kinds: list[tuple[str, bytes, bool, float]] = [
        ("10 connections that say nothing", b"", False, limits.request_s + 2.0),
        (
            "10 requests of which a letter comes every 0.2 s",
            b"GET /login HTTP/1.1\r\nX: ",
            True,
            limits.request_s + 2.0,
        ),
        (
            "10 login forms of which a letter comes every 0.2 s",
            request(site.port, "POST", "/login", f"Content-Type: {FORM}", body=b"x" * 900)[:-900],
            True,
            limits.request_s + 4.0,
        ),
        (
            "5 websockets that read nothing and send nothing",
            request(site.port, "GET", "/teleop?page={page}", *socket_),
            False,
            limits.stall_s + 2.0,
        ),
    ]

    def attack(what: str, beginning: bytes, trickles: bool, limit_s: float) -> Row:
        opened = [dial(site.port) for _ in range(int(what.split()[0]))]
        for number, each in enumerate(opened):
            each.sendall(beginning.replace(b"{page}", f"{number:016x}".encode()))
        took_s = _until_closed(opened, trickles=trickles, patience_s=limit_s + 5.0)
        return Row(
            what, f"closed within {limit_s:g} s", f"{took_s:.1f} s", took_s < limit_s, "", took_s
        )

    with ThreadPoolExecutor(len(kinds)) as pool:
        for result in [pool.submit(attack, *kind) for kind in kinds]:
            yield result.result()


def _until_closed(opened: list[socket.socket], *, trickles: bool, patience_s: float) -> float:
    start_s = time.monotonic()
    left = opened
    while left and time.monotonic() - start_s < patience_s:
        time.sleep(0.2)
        if trickles:
            for each in left:
                with contextlib.suppress(OSError):
                    each.send(b"x")
        left = [each for each in left if not is_closed(each)]
    for each in opened:
        each.close()
    return time.monotonic() - start_s


def _frames(site: _Site) -> Row:
    cookie, before_mb = _cookie(site), site.memory_mb()
    bomb = bytes([0xC1, 0xFE, 0x3F, 0xFF]) + bytes(4) + bytes(0x3FFF)  # Compressed, 16 kB of zeros.
    piece = bytes([0x00, 0xFE, 0x3F, 0xFF]) + bytes(4) + bytes(0x3FFF)
    closed = 0
    for number in range(40):
        with dial(site.port) as connection:
            lines = (
                *("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"),
                "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
                "Sec-WebSocket-Extensions: permessage-deflate",
                f"Cookie: {cookie}",
            )
            connection.sendall(request(site.port, "GET", f"/teleop?page={number:016x}", *lines))
            connection.recv(1024)
            with contextlib.suppress(OSError):
                for _ in range(64):
                    connection.sendall(bomb if number % 2 else piece)
            end_s = time.monotonic() + 3.0
            while not (gone := is_closed(connection)) and time.monotonic() < end_s:
                time.sleep(0.02)
            closed += gone
    grown_mb = site.memory_mb() - before_mb
    return Row(
        "40 websockets with compressed frames and endless pieces, 42 MB",
        "all closed, less than 20 MB kept",
        f"{closed} closed, {grown_mb:+.1f} MB",
        closed == 40 and grown_mb < 20.0,
        size=grown_mb,
    )


def _handshakes(site: _Site) -> Row:
    opened = [dial(site.port) for _ in range(1000)]
    start_s = time.monotonic()
    context = ssl.create_default_context(cafile=site.folder / "keys" / "ca.pem")
    with closing(
        http.client.HTTPSConnection("localhost", site.port, timeout=20.0, context=context)
    ) as asked:
        asked.request("GET", "/login")
        status = asked.getresponse().status
    took_s = time.monotonic() - start_s
    over_s = took_s + _until_closed(
        opened, trickles=False, patience_s=ConnectionLimits().handshake_s + 5.0
    )
    limit_s = ConnectionLimits().handshake_s + 5.0
    return Row(
        "1,000 connections that begin no TLS, and a browser that does",
        f"it is answered in 5 s, the others closed in {limit_s:g} s",
        f"{status} in {took_s:.2f} s, {over_s:.1f} s",
        status == 200 and took_s < 5.0 and over_s < limit_s,
        size=took_s,
    )


# Behind the proxy.


def _proxied(folder: Path) -> Iterator[Row]:
    own = folder / "nginx"
    own.mkdir()
    with nginx(own, folder / "keys") as proxy:
        host = f"robots.example:{proxy.port}"
        with _site(folder, "--behind-proxy", "--allow-host", host) as site:
            proxy.pass_on_to(site.url)
            yield _under_load(site, host, proxy.port)
            yield _forged_addresses(site, host)


def _under_load(site: _Site, host: str, port: int) -> Row:
    trusting = ssl.create_default_context(cafile=site.folder / "keys" / "ca.pem")
    form = urlencode({"name": "alice", "password": PHRASE})
    headers = {"Host": host, "Origin": f"https://{host}", "Content-Type": FORM}
    with closing(http.client.HTTPSConnection("localhost", port, context=trusting)) as asked:
        asked.request("POST", "/twin/login", form, headers)
        cookie = asked.getresponse().headers["Set-Cookie"].split(";")[0]
    with (
        tls_connection(
            f"wss://{host}/twin/teleop?page={_PAGE}",
            host="127.0.0.1",
            port=port,
            additional_headers={"Cookie": cookie, "Origin": f"https://{host}"},
            ssl=trusting,
        ) as opened,
        _driving(Page(site.port, _PAGE, user="alice", through=opened)) as page,
    ):
        calm = _accepted_per_s(page)
        with _loaded(port, host, cookie, trusting) as done:
            start, start_s = sum(done), time.monotonic()
            busy = _accepted_per_s(page)
            per_s = (sum(done) - start) / (time.monotonic() - start_s)
            start_s = time.monotonic()
            stopped = page.answer("stop", t="stop")["ok"]
            stop_s = time.monotonic() - start_s
    share = busy / calm
    return Row(
        "static files through nginx, 200 requests/s, while one drives through it",
        "commands 90 %, STOP 0.5 s",
        f"{per_s:.0f}/s, {share:.0%}, {stop_s:.2f} s",
        per_s > 0.75 * _LOAD_PER_S and share > 0.9 and stopped and stop_s < 0.5,
        size=stop_s,
    )


@contextmanager
def _loaded(port: int, host: str, cookie: str, trusting: ssl.SSLContext) -> Generator[list[int]]:
    """Request a script repeatedly on a few connections; yield the number per connection."""
    done, ended = [0] * _CLIENTS, threading.Event()

    def request_scripts(client: int) -> None:
        with closing(http.client.HTTPSConnection("localhost", port, context=trusting)) as asked:
            headers = {"Host": host, "Cookie": cookie}
            next_s = time.monotonic() + client / _LOAD_PER_S
            while not ended.wait(max(0.0, next_s - time.monotonic())):
                asked.request("GET", "/twin/page.js", headers=headers)
                done[client] += len(asked.getresponse().read()) > 1000
                next_s += _CLIENTS / _LOAD_PER_S

    with ThreadPoolExecutor(_CLIENTS) as pool:
        for client in range(_CLIENTS):
            pool.submit(request_scripts, client)
        try:
            yield done
        finally:
            ended.set()


def _forged_addresses(site: _Site, host: str) -> Row:
    start_s, tried, slowed = time.monotonic(), 0, 0
    with closing(http.client.HTTPConnection("127.0.0.1", site.port)) as asked:
        for number in range(200):
            form = urlencode({"name": f"user-{number % 97}", "password": "wrong wrong wrong"})
            headers = {
                "Host": host,
                "Origin": f"https://{host}",
                "Content-Type": FORM,
                "X-Forwarded-Proto": "https",
                "X-Forwarded-For": f"203.0.{number // 250}.{number % 250}",
            }
            asked.request("POST", "/login", form, headers)
            reply = asked.getresponse()
            reply.read()
            tried += reply.status == 401
            slowed += reply.status == 429
    took_s = time.monotonic() - start_s
    most = 60 + took_s / 5.0 + 1.0
    return Row(
        "200 wrong passwords with as many X-Forwarded-For and 97 names",
        "at most 60 are checked, and one each 5 s",
        f"{tried} checked, {slowed} slowed down",
        tried <= most and tried + slowed == 200,
        size=tried,
    )


# An operator who drives.


def _cookie(site: _Site) -> str:
    """Log in as soon as the rate limit of the address allows it."""
    end_s = time.monotonic() + 20.0
    while True:
        try:
            return cookie_of(site.port, "alice")
        except AssertionError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.5)


@contextmanager
def _driving(page: Page) -> Generator[Page]:
    try:
        page.make_ready()
        page.drive(0.0, 0.0, 0.5)
        yield page
    finally:
        page.close()


def _accepted_per_s(page: Page) -> float:
    """Return the rate of accepted commands, 1/s."""
    first, start_s = page.state["status"]["command"]["accepted"], time.monotonic()
    while time.monotonic() - start_s < _MEASURE_S:
        time.sleep(0.1)
        if page.mode == "ready":  # Released on a busy machine, so centre the controls first.
            held, page.holds = page.holds, None
            time.sleep(0.2)
            page.holds = held
    took_s = time.monotonic() - start_s
    return (page.state["status"]["command"]["accepted"] - first) / took_s
