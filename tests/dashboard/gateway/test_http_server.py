"""What the gateway serves, and to whom."""

from __future__ import annotations

import asyncio
import gzip
import http.client
import json
import socket
from collections.abc import Generator
from contextlib import closing
from html.parser import HTMLParser
from pathlib import Path

import pytest
import viser
from tsd_twin.dashboard.gateway.pages import with_scripts

from tests.support.empty_scene import EmptyScene
from tests.support.page_client import PATIENCE_S, Site, site
from tsd_twin.dashboard.gateway.server import HttpServer
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.errors import TwinError

STATIC = Path(__file__).parents[3] / "src" / "tsd_twin" / "dashboard" / "static"


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


class Scripts(HTMLParser):
    """The scripts in the head of a page, in order; empty names are those written in the page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self._in_head = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "head":
            self._in_head = True
        if tag == "script" and self._in_head:
            self.names.append(dict(attrs).get("src") or "")

    def handle_endtag(self, tag: str) -> None:
        if tag == "head":
            self._in_head = False


def test_the_page_is_that_of_viser_with_our_scripts_first_and_last(served: Site) -> None:
    answer, body = get(served.port, "/")
    assert answer.status == 200
    names = Scripts(body.decode()).names
    assert names[:2] == ["static/boot.js", "static/render_throttle.js"]
    assert names[-1] == "static/main.js"
    own = Path(viser.__file__).parent / "client" / "build" / "index.html"
    rest = body.decode()
    for ours in (
        'src="static/boot.js"',
        'src="static/render_throttle.js"',
        'type="module" src="static/main.js"',
    ):
        rest = rest.replace(f"<script {ours}></script>", "")
    assert rest == own.read_text(encoding="utf-8")


def test_a_script_that_mentions_the_end_of_the_head_is_left_alone() -> None:
    html = "<html><head><script>const s = '</head>'</script></head><body></body></html>"
    page = with_scripts(html)
    assert page.index("static/main.js") > page.index("const s")
    assert page.count("<script") == html.count("<script") + 3


def test_the_page_is_the_same_when_it_is_sent_compressed(served: Site) -> None:
    answer, packed = get(served.port, "/", {"Accept-Encoding": "gzip"})
    assert answer.headers["Content-Encoding"] == "gzip"
    assert gzip.decompress(packed) == get(served.port, "/")[1]


@pytest.mark.parametrize("path", ["/", "/static/main.js"])
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
def test_parameters_that_lead_to_a_foreign_server_are_stripped(
    served: Site, query: str, rest: str
) -> None:
    answer, _ = get(served.port, f"/?{query}")
    assert (answer.status, answer.headers["Location"]) == (302, rest)
    assert get(served.port, f"/{rest}")[0].status == 200


@pytest.mark.parametrize(
    "name", sorted(str(file.relative_to(STATIC)) for file in STATIC.rglob("*.js"))
)
def test_every_script_is_served_as_one(served: Site, name: str) -> None:
    answer, body = get(served.port, f"/static/{name}")
    assert answer.status == 200
    assert answer.headers.get_content_type() in ("text/javascript", "application/javascript")
    assert body == (STATIC / name).read_bytes()


@pytest.mark.parametrize("path", ["/", "/healthz", "/static/boot.js", "/nothing", "/teleop"])
def test_every_answer_says_what_the_page_may_do_and_that_nobody_may_frame_it(
    served: Site, path: str
) -> None:
    headers = get(served.port, path)[0].headers
    policy = dict(rule.split(" ", 1) for rule in headers["Content-Security-Policy"].split("; "))
    assert policy["frame-ancestors"] == "'none'"
    assert policy["connect-src"] == "'self' data: blob:"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize("path", ["/", "/healthz", "/static/boot.js", "/teleop", "/viser/00"])
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
