"""viser's port serves only the gateway."""

from __future__ import annotations

import http.client
from contextlib import closing
from pathlib import Path

import pytest
import viser
import websockets.asyncio.server
from playwright.sync_api import sync_playwright
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.support.browser import CHEAP_FLAGS, PATIENCE_MS, executable
from tests.support.viser_client import viser_client
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.viser_compat import KEY_HEADER, access_key

VISER = Subprotocol(f"viser-v{viser.__version__}")


@pytest.mark.parametrize(
    "headers",
    [
        [],
        [("Origin", "http://evil.example")],
        [("Origin", "http://127.0.0.1:8080")],
        [(KEY_HEADER, "")],
        [(KEY_HEADER, "x" * 64)],
        [(KEY_HEADER, "\xe9")],
        [(KEY_HEADER, access_key()[:-1])],
        [(KEY_HEADER, access_key()), (KEY_HEADER, "x")],
    ],
)
def test_nobody_without_the_key_gets_a_socket(
    server: viser.ViserServer, headers: list[tuple[str, str]]
) -> None:
    with pytest.raises(InvalidStatus) as refused:
        connect(
            f"ws://127.0.0.1:{server.get_port()}",
            subprotocols=[VISER],
            additional_headers=headers,
        )
    assert refused.value.response.status_code == 403
    assert server.get_clients() == {}


@pytest.mark.parametrize("path", ["/", "/index.html", "/assets/../index.html"])
def test_nor_a_page(server: viser.ViserServer, path: str) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", server.get_port())) as connection:
        connection.request("GET", path)
        assert connection.getresponse().status == 403


def test_with_the_key_it_works_as_ever(server: viser.ViserServer) -> None:
    with viser_client(server.get_port()) as viewer:
        server.scene.add_frame("/there")
        viewer.until(lambda: viewer.node("/there"))


def test_other_servers_of_this_process_stay_open_to_all() -> None:
    """Only our server requires a key; the library is not modified."""
    before = websockets.asyncio.server.serve
    viser_compat.start_server("test").stop()
    assert websockets.asyncio.server.serve is before
    other = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    with connect(f"ws://127.0.0.1:{other.get_port()}", subprotocols=[VISER]) as socket:
        assert socket.recv(timeout=10.0)
    other.stop()


@pytest.mark.system
@pytest.mark.busy
def test_a_foreign_page_in_the_operators_browser_does_not_reach_it(
    server: viser.ViserServer, tmp_path: Path
) -> None:
    page_file = tmp_path / "evil.html"
    page_file.write_text("<!doctype html><title>evil</title>")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable(), args=list(CHEAP_FLAGS))
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(page_file.as_uri())
        how = page.evaluate(
            """([port, protocol]) => new Promise((done) => {
              const socket = new WebSocket(`ws://127.0.0.1:${port}/`, protocol);
              socket.onopen = () => done("open");
              socket.onerror = () => done("refused");
            })""",
            [server.get_port(), str(VISER)],
        )
        browser.close()
    assert how == "refused"
    assert server.get_clients() == {}
