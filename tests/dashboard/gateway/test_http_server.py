"""Routes of the gateway, and access to them."""

from __future__ import annotations

import asyncio
import gzip
import http.client
import json
import socket
from collections.abc import Generator
from contextlib import closing
from pathlib import Path

import pytest

from tests.support.page_client import Site, site
from tests.support.scene_doubles import EmptyScene
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.gateway.pages import BUNDLE, FILES, VIEWPORT_PATH
from tsd_twin.dashboard.gateway.server import HttpServer
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.errors import TwinError


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


def get(
    port: int, path: str, headers: dict[str, str] | None = None
) -> tuple[http.client.HTTPResponse, bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)) as connection:
        connection.request("GET", path, headers=headers or {})
        answer = connection.getresponse()
        return answer, answer.read()


def test_the_page_is_the_built_one_with_the_place_of_the_viewport(served: Site) -> None:
    answer, body = get(served.port, "/")
    assert answer.status == 200
    built = (BUNDLE / "index.html").read_text(encoding="utf-8")
    assert body.decode() == built.replace("{{viewport}}", str(served.gateway.viewport_port))


def test_the_page_is_the_same_when_it_is_sent_compressed(served: Site) -> None:
    answer, packed = get(served.port, "/", {"Accept-Encoding": "gzip"})
    assert answer.headers["Content-Encoding"] == "gzip"
    assert gzip.decompress(packed) == get(served.port, "/")[1]


@pytest.mark.parametrize("path", ["/", "/page.js"])
def test_what_a_browser_has_already_is_not_sent_again(served: Site, path: str) -> None:
    answer, _ = get(served.port, path)
    assert answer.headers["Cache-Control"] == "no-cache"
    again, body = get(served.port, path, {"If-None-Match": answer.headers["Etag"]})
    assert (again.status, body) == (304, b"")


@pytest.mark.parametrize(
    ("query", "rest"),
    [
        ("websocket=ws://evil.example", "?"),
        ("playbackPath=https://evil.example/x", "?"),
        ("fixedDpr=1&websocket=a&websocket=b&playbackPath=c", "?fixedDpr=1"),
    ],
)
def test_parameters_that_lead_viser_to_a_foreign_server_are_stripped(
    served: Site, query: str, rest: str
) -> None:
    answer, _ = get(served.port, f"{VIEWPORT_PATH}?{query}")
    assert (answer.status, answer.headers["Location"]) == (302, rest)


@pytest.mark.parametrize("name", FILES)
def test_every_file_of_the_page_is_served_with_its_type(served: Site, name: str) -> None:
    answer, body = get(served.port, f"/{name}")
    assert answer.status == 200
    kinds = {".js": "text/javascript", ".css": "text/css", ".woff2": "font/woff2"}
    assert answer.headers.get_content_type() == kinds[Path(name).suffix]
    assert body == (BUNDLE / name).read_bytes()


@pytest.mark.parametrize("path", ["/", "/healthz", "/page.js", "/nothing", "/teleop"])
def test_every_answer_says_what_the_page_may_do_and_that_nobody_may_frame_it(
    served: Site, path: str
) -> None:
    headers = get(served.port, path)[0].headers
    policy = dict(rule.split(" ", 1) for rule in headers["Content-Security-Policy"].split("; "))
    assert policy["frame-ancestors"] == "'none'"
    assert policy["connect-src"].split(" ")[0] == "'self'"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize(
    "path", ["/", "/healthz", "/page.js", "/portraits/tsd", "/teleop", "/viser/00"]
)
@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Host": "robot.example", "Origin": "http://evil.example"},
    ],
)
def test_foreign_names_and_foreign_pages_are_refused_everywhere(
    served: Site, path: str, headers: dict[str, str]
) -> None:
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    }
    for more in ({}, upgrade):
        answer, body = get(served.port, path, {**headers, **more})
        assert answer.status == 403
        assert body.decode().endswith(".")


def test_a_name_that_was_allowed_is_answered(served: Site) -> None:
    headers = {"Host": "robot.example", "Origin": "https://robot.example"}
    assert get(served.port, "/healthz", headers)[0].status == 200


def test_health_names_the_robots_with_mode_and_age(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
    _, body = get(served.port, "/healthz")
    health = json.loads(body)
    assert health["ready"] is True
    assert list(health["robots"]) == ["tsd"]
    assert health["robots"]["tsd"]["mode"] == "disarmed"
    assert 0.0 <= health["robots"]["tsd"]["age_s"] < 1.0


def test_a_robot_on_the_bus_has_a_portrait_that_is_sent_once(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
    answer, body = get(served.port, "/portraits/tsd")
    assert answer.headers.get_content_type() == "image/webp"
    assert (body[:4], body[8:12]) == (b"RIFF", b"WEBP")
    again, nothing = get(served.port, "/portraits/tsd", {"If-None-Match": answer.headers["Etag"]})
    assert (again.status, nothing) == (304, b"")
    assert get(served.port, "/portraits/nobody")[0].status == 404


@pytest.mark.parametrize("page", ["", "0123", "0123456789abcdeg", "0123456789abcdef0"])
def test_a_socket_needs_a_page_id(served: Site, page: str) -> None:
    assert get(served.port, f"/teleop?page={page}")[0].status == 400
    assert get(served.port, f"/viser/{page or 'x'}")[0].status == 400


def test_it_does_not_listen_where_others_could_reach_it(served: Site) -> None:
    async def start() -> None:
        await HttpServer(SessionManager(served.discovery.links, EmptyScene()), 1).start(
            "0.0.0.0", 0
        )

    with pytest.raises(TwinError, match="has no login"):
        asyncio.run(start())


def test_a_port_in_use_is_one_clear_sentence(served: Site) -> None:
    async def start(port: int) -> None:
        sessions = SessionManager(served.discovery.links, EmptyScene())
        await HttpServer(sessions, 1).start(port=port)

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(TwinError, match=f"port {port} of 127.0.0.1 cannot be used"):
            asyncio.run(start(port))
