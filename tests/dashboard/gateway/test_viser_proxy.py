"""viser's socket through the gateway to a real viser server."""

from __future__ import annotations

import http.client
import queue
from collections.abc import Generator

import pytest
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.dashboard.viser_internals import request_headers
from tests.support.page_client import Site, site
from tests.support.viser_client import CAMERA, ViserClient
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.scene.viser_compat import page_of

PAGE = "0123456789abcdef"
VISER = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def served(server: viser.ViserServer) -> Generator[Site]:
    with site(server.get_port()) as made:
        yield made


def open_socket(port: int, protocol: str = VISER, look: str = "dark-rich") -> ClientConnection:
    return connect(
        f"ws://127.0.0.1:{port}/viser/{PAGE}?look={look}",
        subprotocols=[Subprotocol("other"), Subprotocol(protocol)],
        max_size=None,
        open_timeout=PATIENCE_S,
    )


def test_a_client_of_viser_works_through_the_gateway_both_ways(
    server: viser.ViserServer, served: Site
) -> None:
    moved: queue.SimpleQueue[tuple[float, str | None]] = queue.SimpleQueue()

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        @client.camera.on_update
        async def _(camera: viser.CameraHandle) -> None:
            moved.put((camera.position[0], page_of(server, client.client_id)))

    server.scene.add_frame("/seen")
    socket = open_socket(served.port)
    assert socket.subprotocol == VISER
    viewer = ViserClient(socket)
    try:
        viewer.send(CAMERA)
        viewer.until(lambda: viewer.node("/seen"))
        viewer.send(CAMERA | {"position": [4.0, 4.0, 4.0]})
        while moved.get(timeout=PATIENCE_S) != (4.0, PAGE):
            pass
    finally:
        viewer.join()


@pytest.mark.parametrize(
    ("look", "known"),
    [("dark-rich", "dark"), ("light-plain", "plain"), ("dark-plain", "dark-plain"), ("", "-")],
)
def test_viser_learns_which_look_the_browser_wants(
    server: viser.ViserServer, served: Site, look: str, known: str
) -> None:
    with open_socket(served.port, look=look) as socket:
        socket.recv(timeout=PATIENCE_S)
        assert known in [each["X-Tsd-Look"] for each in request_headers(server)]


def test_a_client_of_another_version_is_told_so(served: Site) -> None:
    socket = open_socket(served.port, "viser-v0.0.0")
    with pytest.raises(ConnectionClosed) as closed:
        socket.recv(timeout=PATIENCE_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1002


def test_without_a_viser_the_answer_is_a_sentence() -> None:
    with site(viser_port=1) as lonely:
        with pytest.raises(InvalidStatus) as refused:
            open_socket(lonely.port)
        assert refused.value.response.status_code == http.client.SERVICE_UNAVAILABLE
        assert b"viser does not answer" in (refused.value.response.body or b"")
