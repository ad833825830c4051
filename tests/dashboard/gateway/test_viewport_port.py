"""Both ports of the dashboard: routes, origins and headers."""

from __future__ import annotations

import asyncio
import base64
import gzip
import hashlib
import re
import socket
import time
from collections.abc import Callable, Generator
from urllib.parse import quote

import pytest
import viser

from tests.support.gateway_requests import (
    ask,
    cookie_of,
    dialled,
    is_closed,
    request,
    status_of,
    users,
)
from tests.support.page_client import Site, site
from tests.support.scene_doubles import EmptyScene
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.connection_limits import ConnectionLimits
from tsd_twin.dashboard.gateway.pages import BUNDLE, FILES, VIEWPORT_PATH
from tsd_twin.dashboard.gateway.server import HttpServer
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.errors import TwinError

PAGE = "0123456789abcdef"
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
}
FRAMED = [("GET", VIEWPORT_PATH), ("GET", f"{VIEWPORT_PATH}frame.js"), ("GET", f"/viser/{PAGE}")]
"""Routes of both ports."""
MAIN = [
    ("GET", "/"),
    *(("GET", "/" + name) for name in FILES),
    ("GET", f"/teleop?page={PAGE}"),
    ("GET", "/healthz"),
    ("GET", "/recordings"),
    ("GET", "/login"),
    ("POST", "/login"),
    ("POST", "/logout"),
]
"""Routes of the main port only."""


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


@pytest.fixture(scope="module")
def guarded(server: viser.ViserServer) -> Generator[Site]:
    with site(server.get_port(), AuthMiddleware(AccessSettings(users=users()))) as made:
        yield made


def framed(port: int, parent: str, **headers: str) -> tuple[int, str, str]:
    """Return status, body and frame ancestors of viser's page in a page of `parent`."""
    path = f"{VIEWPORT_PATH}?parent={quote(parent, safe='')}"
    answer, body = ask(port, "GET", path, **headers)
    return answer.status, body, ancestors(answer.headers["Content-Security-Policy"])


def ancestors(policy: str) -> str:
    return sources(policy)["frame-ancestors"]


def sources(policy: str) -> dict[str, str]:
    return dict(rule.split(" ", 1) for rule in policy.split("; "))


@pytest.mark.parametrize(("method", "path"), FRAMED + MAIN)
@pytest.mark.parametrize("listener", ["main", "viewport"])
@pytest.mark.parametrize("origin", ["none", "main", "viewport", "evil", "null"])
def test_each_port_answers_its_own_origin_on_its_own_routes_only(
    served: Site, listener: str, method: str, path: str, origin: str
) -> None:
    ports = {"main": served.port, "viewport": served.gateway.viewport_port}
    names = {name: f"http://127.0.0.1:{port}" for name, port in ports.items()}
    names |= {"evil": "http://evil.example", "null": "null"}
    headers = {"Origin": names[origin]} if origin in names else {}
    if path == VIEWPORT_PATH:
        path += f"?parent={quote(names['main'], safe='')}"
    if path.startswith(("/teleop", "/viser")):
        headers |= UPGRADE
    with socket.create_connection(("127.0.0.1", ports[listener]), 10.0) as connection:
        lines = [f"{name}: {value}" for name, value in headers.items()]
        head = [f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{ports[listener]}", *lines]
        length = ["Content-Length: 0"] if method == "POST" else []
        connection.sendall("\r\n".join([*head, *length, "", ""]).encode())
        status = status_of(connection)
    if origin not in ("none", listener):
        assert status == 403
    elif listener == "viewport" and (method, path.partition("?parent")[0]) not in FRAMED:
        assert status == 404
    elif (method, origin) == ("POST", "none"):
        assert status == 403  # Forms require an origin.
    else:
        assert status in (101, 200, 204, 303, 503)  # Without viser, its socket returns 503.


def test_a_socket_of_viser_connects_on_both_ports_with_the_same_login(guarded: Site) -> None:
    cookie = cookie_of(guarded.port, "alice")
    for port in (guarded.port, guarded.gateway.viewport_port):
        headers = {**UPGRADE, "Origin": f"http://127.0.0.1:{port}"}
        headers |= {"Sec-WebSocket-Protocol": f"viser-v{viser.__version__}"}
        lines = [f"{name}: {value}" for name, value in headers.items()]
        for login, expected in ((f"Cookie: {cookie}", 101), ("X-None: 1", 401)):
            with socket.create_connection(("127.0.0.1", port), 10.0) as connection:
                head = [f"GET /viser/{PAGE} HTTP/1.1", f"Host: 127.0.0.1:{port}", *lines, login]
                connection.sendall("\r\n".join([*head, "", ""]).encode())
                assert status_of(connection) == expected


@pytest.mark.parametrize("path", ["/", "/login", VIEWPORT_PATH, "/teleop", "/nothing"])
def test_the_port_of_the_viewport_has_no_login_page(guarded: Site, path: str) -> None:
    port = guarded.gateway.viewport_port
    assert ask(port, "GET", path)[0].status == 401
    if path == "/login":
        assert ask(port, "POST", path, "name=alice&password=x")[0].status == 401


def test_without_a_login_the_page_leads_to_the_login_page(guarded: Site) -> None:
    answer, _ = ask(guarded.port, "GET", "/")
    assert (answer.status, answer.headers["Location"]) == (302, "login")


@pytest.mark.parametrize("listener", ["main", "viewport"])
def test_only_the_page_may_frame_the_page_of_viser(served: Site, listener: str) -> None:
    main, port = f"http://127.0.0.1:{served.port}", served.gateway.viewport_port
    at = served.port if listener == "main" else port
    status, body, allowed = framed(at, main)
    assert (status, allowed) == (200, main)
    assert body.index('<script src="frame.js"></script>') < body.index("<script data-p")
    wrong = [
        "",
        "*",
        "'self'",
        "null",
        "http://evil.example",
        f"http://localhost:{served.port}",  # Another name without login cookie.
        f"http://127.0.0.1:{port}",
        f"http://127.0.0.1:{served.port + 2}",
        f"{main}/",
        f"{main} http://evil.example",
        f"{main}; script-src *",
    ]
    for parent in wrong:
        assert framed(at, parent)[::2] == (403, "'none'"), parent


def test_a_name_with_a_default_port_frames_itself(served: Site) -> None:
    """Behind a proxy or in a browser, the default port is not part of an origin."""
    port = served.gateway.viewport_port
    host = f"robot.example:{port}"
    assert framed(port, "https://robot.example", Host=host)[0] == 200
    assert framed(port, "https://other.example", Host=host)[0] == 403


def test_every_answer_of_both_ports_asks_for_a_process_of_its_own_and_forbids_other_frames(
    served: Site,
) -> None:
    for port in (served.port, served.gateway.viewport_port):
        for path in ("/", VIEWPORT_PATH, f"{VIEWPORT_PATH}frame.js", "/nothing"):
            headers = ask(port, "GET", path)[0].headers
            assert headers["Origin-Agent-Cluster"] == "?1"
            assert headers["Cross-Origin-Opener-Policy"] == "same-origin"
            assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
            assert headers["X-Content-Type-Options"] == "nosniff"
            assert ancestors(headers["Content-Security-Policy"]) == "'none'"


def test_parameters_that_lead_viser_elsewhere_are_stripped(served: Site) -> None:
    path = f"{VIEWPORT_PATH}?page={PAGE}&websocket=ws://evil.example&playbackPath=x"
    answer, _ = ask(served.gateway.viewport_port, "GET", path)
    assert (answer.status, answer.headers["Location"]) == (302, f"?page={PAGE}")


def test_the_policy_of_the_page_allows_its_inline_texts_and_the_frame_only(served: Site) -> None:
    answer, html = ask(served.port, "GET", "/")
    policy = sources(answer.headers["Content-Security-Policy"])
    assert "unsafe" not in answer.headers["Content-Security-Policy"]
    for kind in ("script", "style"):
        (text,) = re.findall(rf"<{kind}>(.*?)</{kind}>", html, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert policy[f"{kind}-src"] == f"'self' 'sha256-{digest}'"
    port = served.gateway.viewport_port
    assert policy["frame-src"] == f"'self' http://127.0.0.1:{port}"
    assert f'<meta name="tsd-viewport" content="{port}" />' in html
    assert "{{" not in html


def test_files_of_the_page_are_compressed_and_not_sent_again(served: Site) -> None:
    for name in FILES:
        path, file = "/" + name, (BUNDLE / name).read_bytes()
        with socket.create_connection(("127.0.0.1", served.port), 10.0) as connection:
            head = [f"GET {path} HTTP/1.1", f"Host: 127.0.0.1:{served.port}"]
            head += ["Accept-Encoding: gzip", "Connection: close", "", ""]
            connection.sendall("\r\n".join(head).encode())
            answer = b"".join(iter(lambda c=connection: c.recv(65536), b""))
        headers, _, body = answer.partition(b"\r\n\r\n")
        assert (b"Content-Encoding: gzip" in headers) == (not name.endswith(".woff2"))
        assert (gzip.decompress(body) if b"gzip" in headers else body) == file
        (tag,) = re.findall(rb"(?i)etag: (\S+)", headers)
        again, rest = ask(served.port, "GET", path, If_None_Match=tag.decode())
        assert (again.status, rest, again.headers["Cache-Control"]) == (304, "", "no-cache")


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_connections_of_both_ports_are_counted_together() -> None:
    count = ConnectionLimits().per_address
    with (
        site(auth=AuthMiddleware(AccessSettings(users=users()))) as made,
        dialled(made.port, count) as first,
    ):
        # It answers after it has accepted all of them, in their order.
        first[-1].sendall(request(made.port, "GET", "/login"))
        assert status_of(first[-1]) == 200
        with dialled(made.gateway.viewport_port, 3) as more:
            until(lambda: all(is_closed(each) for each in first[:3]))
            assert not any(is_closed(each) for each in [*first[3:], *more])


def viewport_port(
    port: int, wanted: int | None = None, rules: AccessSettings | None = None
) -> tuple[int, int]:
    """Return both ports of a dashboard that is started and stopped."""

    async def start() -> tuple[int, int]:
        gateway = HttpServer(
            SessionManager({}, EmptyScene()), 1, auth=AuthMiddleware(rules or LOCAL)
        )
        await gateway.start(port=port, viewport_port=wanted)
        try:
            return gateway.port, gateway.viewport_port
        finally:
            await gateway.stop()

    return asyncio.run(start())


LOCAL = AccessSettings()


def two_free_ports() -> int:
    """Return a free port whose successor is also free."""
    while True:
        with socket.create_server(("127.0.0.1", 0)) as first:
            port = first.getsockname()[1]
            try:
                socket.create_server(("127.0.0.1", port + 1)).close()
            except (OSError, OverflowError):
                continue
            return port


def test_the_viewport_has_the_next_port_or_any_free_one_or_the_given_one() -> None:
    port = two_free_ports()
    assert viewport_port(port) == (port, port + 1)
    with socket.create_server(("127.0.0.1", port + 1)):
        main, other = viewport_port(port)
        assert main == port
        assert other not in (0, port, port + 1)
        with pytest.raises(TwinError, match=f"port {port + 1} of 127.0.0.1 cannot be used"):
            viewport_port(port, port + 1)
    assert all(viewport_port(0))


def test_behind_a_proxy_the_viewport_has_a_port_only_if_its_origin_is_known() -> None:
    proxied = AccessSettings(users=users(), proxy="127.0.0.1", allowed_hosts=["robot.example"])
    assert viewport_port(0, rules=proxied)[1] == 0
    with pytest.raises(TwinError, match="--viewport-origin"):
        viewport_port(0, 0, proxied)


def test_an_origin_with_another_name_than_the_page_is_refused() -> None:
    names = ["robot.example"]
    AccessSettings(allowed_hosts=names, viewport_origin="https://robot.example:8443").check(
        "127.0.0.1"
    )
    for origin in ("https://view.example", "https://view.robot.example"):
        with pytest.raises(TwinError, match="another name"):
            AccessSettings(allowed_hosts=names, viewport_origin=origin).check("127.0.0.1")


def test_behind_a_proxy_the_page_names_the_origin_of_the_viewport() -> None:
    origin, parent = "https://robot.example:8443", "https://robot.example"
    rules = AccessSettings(
        users=users(), proxy="127.0.0.1", allowed_hosts=["robot.example"], viewport_origin=origin
    )
    forwarded = {"X_Forwarded_Proto": "https", "X_Forwarded_Prefix": "/twin"}
    with site(auth=AuthMiddleware(rules)) as made:
        main = {**forwarded, "Host": "robot.example"}
        view = {**forwarded, "Host": "robot.example:8443"}
        cookie = cookie_of(made.port, "alice", Origin=parent, **main)
        answer, html = ask(made.port, "GET", "/", Cookie=cookie, **main)
        assert f'<meta name="tsd-viewport" content="{origin}" />' in html
        policy = sources(answer.headers["Content-Security-Policy"])
        assert policy["frame-src"] == f"'self' {origin}"
        port = made.gateway.viewport_port
        assert framed(port, parent, Cookie=cookie, **view)[::2] == (200, parent)
        assert framed(port, origin, Cookie=cookie, **view)[0] == 403
        socket_path = f"/viser/{PAGE}"
        for name, expected in ((origin, 503), (parent, 403)):
            got = ask(port, "GET", socket_path, Cookie=cookie, Origin=name, **view)[0]
            assert got.status == expected
