"""Neither many nor slow connections keep out an operator."""

from __future__ import annotations

import select
import socket
import ssl
import struct
import time
from collections.abc import Generator
from contextlib import closing, contextmanager
from functools import partial
from http.client import HTTPSConnection
from pathlib import Path

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.support.gateway_requests import (
    FORM,
    ask,
    closed_after_s,
    cookie_of,
    dial,
    dialled,
    is_closed,
    log_in,
    request,
    status_of,
    users,
)
from tests.support.key_folders import provision_folder
from tests.support.page_client import Site, site
from tests.support.withheld import PATIENCE_S, Stopwatch
from tsd_twin.dashboard.gateway import connection_limits
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.connection_limits import ConnectionLimits
from tsd_twin.dashboard.gateway.pages import VIEWPORT_PATH
from tsd_twin.security.web_access import server_tls_context

PAGE = "0123456789abcdef"
FULL = 503


@pytest.fixture
def fresh() -> Generator[Site]:
    with site(auth=AuthMiddleware(AccessSettings(users=users()))) as made:
        yield made


@contextmanager
def limited(
    viser_port: int = 1, tls: ssl.SSLContext | None = None, **changes: float
) -> Generator[Site]:
    """Run a site with some of the shipped limits changed."""
    with pytest.MonkeyPatch.context() as patch:
        changed = partial(ConnectionLimits, **changes)
        patch.setattr(connection_limits, "ConnectionLimits", changed)
        with site(viser_port, AuthMiddleware(AccessSettings(users=users(), tls=tls))) as made:
            yield made


def test_strangers_share_a_few_places_and_are_told_so(fresh: Site) -> None:
    with dialled(fresh.port, 200) as opened:
        answers = [status_of(each) for each in opened[: 200 - ConnectionLimits().per_address]]
        assert set(answers) == {FULL}
        assert not any(is_closed(each) for each in opened[200 - ConnectionLimits().per_address :])
        assert log_in(fresh.port, "alice")[0].status == 303


def test_a_thousand_connections_neither_stop_an_operator_nor_keep_one_out(fresh: Site) -> None:
    with fresh.page(PAGE, user="alice", cookie=cookie_of(fresh.port, "alice")) as page:
        page.make_ready()
        page.drive()
        with dialled(fresh.port, 1000):
            bob = cookie_of(fresh.port, "bob")
            assert ask(fresh.port, "GET", "/healthz", Cookie=bob)[0].status == 200
            assert page.mode == "driving", page.all("released")
            assert page.answer("stop", t="stop")["ok"]
        assert page.closed is None


def test_through_the_proxy_strangers_share_all_places() -> None:
    count = ConnectionLimits().unauthenticated
    behind = AuthMiddleware(AccessSettings(users=users(), proxy="127.0.0.1"))
    with site(auth=behind) as served, dialled(served.port, count + 5) as opened:
        assert {status_of(each) for each in opened[:5]} == {FULL}
        assert not any(is_closed(each) for each in opened[5:])


def test_a_user_has_so_many_connections_and_others_do_not_notice() -> None:
    with limited(per_user=6) as fresh:
        guest = cookie_of(fresh.port, "guest")
        pages = [f"{number:016x}" for number in range(6)]
        opened = [
            connect(
                f"ws://127.0.0.1:{fresh.port}/teleop?page={page}",
                additional_headers={"Cookie": guest},
            )
            for page in pages
        ]
        refused, text = ask(fresh.port, "GET", "/healthz", Cookie=guest)
        assert refused.status == FULL
        assert "close some pages" in text
        with pytest.raises(InvalidStatus) as no:
            connect(
                f"ws://127.0.0.1:{fresh.port}/teleop?page={PAGE}",
                additional_headers={"Cookie": guest},
            )
        assert no.value.response.status_code == FULL
        alice = cookie_of(fresh.port, "alice")
        assert ask(fresh.port, "GET", "/healthz", Cookie=alice)[0].status == 200
        opened[0].close()
        watch = Stopwatch()
        while ask(fresh.port, "GET", "/healthz", Cookie=guest)[0].status != 200:
            assert watch.took_s < 5.0
        for each in opened:
            each.close()


def test_an_idle_connection_of_a_user_gives_way_to_another_of_hers() -> None:
    with limited(per_user=3) as fresh:
        cookie = cookie_of(fresh.port, "guest")
        kept = [dial(fresh.port) for _ in range(4)]
        for each in kept:
            each.sendall(request(fresh.port, "GET", "/healthz", f"Cookie: {cookie}"))
            assert status_of(each) == 200
        closed_after_s(kept[:1])
        assert not any(is_closed(each) for each in kept[1:])
        for each in kept:
            each.close()


def test_who_begins_no_tls_gives_way_and_is_cut_off(tmp_path: Path) -> None:
    provision_folder(tmp_path, hosts=("localhost",))
    tls = server_tls_context(tmp_path / "robot.pem", tmp_path / "robot.key")
    with limited(tls=tls, handshake_s=1.0) as served, dialled(served.port, 100) as opened:
        trusting = ssl.create_default_context(cafile=tmp_path / "ca.pem")
        connection = HTTPSConnection("localhost", served.port, context=trusting)
        with closing(connection):
            connection.request("GET", "/login")
            assert connection.getresponse().status == 200
        assert closed_after_s(opened) < 5.0


@pytest.mark.parametrize(
    "beginning",
    [
        b"",
        b"GET /lo",
        b"GET /login HTTP/1.1\r\nX: ",
    ],
)
def test_a_request_that_trickles_is_cut_off(beginning: bytes) -> None:
    with limited(request_s=0.5) as fresh, dial(fresh.port) as connection:
        watch, start_s = Stopwatch(), time.monotonic()
        connection.sendall(beginning)
        while not is_closed(connection):
            if beginning:
                try:
                    connection.send(b"a")
                except OSError:
                    break
            time.sleep(0.05)
            assert watch.took_s < 5.0
        assert time.monotonic() - start_s > 0.4


def test_a_form_that_trickles_is_cut_off_with_a_sentence(
    fresh: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsd_twin.dashboard.gateway.login.READ_S", 0.3)
    with dial(fresh.port) as connection:
        connection.sendall(
            request(fresh.port, "POST", "/login", f"Content-Type: {FORM}", body=b"x" * 90)[:-80]
        )
        assert status_of(connection) == 408


def test_an_idle_connection_is_closed_and_one_that_is_used_is_not() -> None:
    with limited(idle_s=1.5, request_s=0.2) as fresh:
        cookie = cookie_of(fresh.port, "guest")
        with dial(fresh.port) as idle, dial(fresh.port) as used:
            ask_health = request(fresh.port, "GET", "/healthz", f"Cookie: {cookie}")
            for each in (idle, used):
                each.sendall(ask_health)
                assert status_of(each) == 200
            for _ in range(8):
                time.sleep(0.4)
                used.setblocking(True)
                used.sendall(ask_health)
                assert status_of(used) == 200
            assert is_closed(idle)
            assert not is_closed(used)


def test_a_browser_that_never_reads_is_cut_off(server: viser.ViserServer) -> None:
    with limited(server.get_port(), stall_s=0.5) as served:
        cookie = cookie_of(served.port, "guest")
        with dial(served.port) as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            # More than the kernel buffers for a connection.
            page = f"{VIEWPORT_PATH}?parent=http://127.0.0.1:{served.port}"
            start_s = time.monotonic()
            connection.sendall(20 * request(served.port, "GET", page, f"Cookie: {cookie}"))
            lost = select.poll()
            lost.register(connection, select.POLLHUP)  # Poll the socket without reading.
            assert lost.poll(PATIENCE_S * 1000.0)
            assert time.monotonic() - start_s > 0.4


def frame(opcode: int, payload: bytes, *, final: bool = True, rsv1: bool = False) -> bytes:
    """Encode a websocket frame as a client does."""
    first = opcode | (0x80 if final else 0) | (0x40 if rsv1 else 0)
    size = len(payload)
    head = (
        struct.pack("!BB", first, 0x80 | size)
        if size < 126
        else struct.pack("!BBH", first, 0xFE, size)
    )
    return head + bytes(4) + payload


@pytest.mark.parametrize("path", [f"/teleop?page={PAGE}", f"/viser/{PAGE}"])
@pytest.mark.parametrize(
    "frames",
    [
        pytest.param([frame(1, b"\x00" * 20, rsv1=True)], id="compressed without an agreement"),
        pytest.param(
            [frame(1, b"{", final=False), *[frame(0, b" " * 60_000, final=False)] * 40],
            id="2.4 MB in pieces",
        ),
        pytest.param([frame(9, b"x" * 200)], id="a control frame that is too long"),
        pytest.param([frame(3, b"x")], id="an opcode that is none"),
        pytest.param([frame(0, b"x")], id="a piece of nothing"),
    ],
)
def test_frames_that_no_page_sends_close_the_socket_and_nothing_else(
    server: viser.ViserServer, path: str, frames: list[bytes]
) -> None:
    with site(server.get_port(), AuthMiddleware(AccessSettings(users=users()))) as served:
        cookie = cookie_of(served.port, "guest")
        with dial(served.port) as connection:
            upgrade = (
                *("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"),
                "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
                "Sec-WebSocket-Extensions: permessage-deflate; client_max_window_bits",
                f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
                f"Cookie: {cookie}",
            )
            connection.sendall(request(served.port, "GET", path, *upgrade))
            assert status_of(connection) == 101
            try:
                for each in frames:
                    connection.sendall(each)
            except OSError:
                return  # Already closed.
            closed_after_s([connection])
        assert ask(served.port, "GET", "/healthz", Cookie=cookie)[0].status == 200
