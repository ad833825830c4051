"""The viser server is reachable only by the gateway, prints nothing, and stops completely."""

from __future__ import annotations

import socket
import threading
from collections.abc import Generator

import msgspec
import pytest
import viser

from tests.dashboard.viser_internals import handled_messages
from tests.support.viser_client import viser_client
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.scene import viser_compat


@pytest.fixture
def server() -> Generator[viser.ViserServer]:
    made = viser_compat.start_server("test")
    yield made
    made.stop()


def test_it_listens_on_the_loopback_alone(server: viser.ViserServer) -> None:
    assert server.get_host() == "127.0.0.1"
    with socket.socket() as probe, pytest.raises(ConnectionRefusedError):
        probe.connect(("127.0.0.2", server.get_port()))  # Would answer if bound to all addresses.


def test_two_of_them_have_a_port_each(server: viser.ViserServer) -> None:
    other = viser_compat.start_server("test")
    ports = {server.get_port(), other.get_port()}
    other.stop()
    assert len(ports) == 2
    assert 0 not in ports


def test_it_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    """Standard output is reserved for the program's ready line."""
    server = viser_compat.start_server("test")
    with viser_client(server.get_port()):
        pass
    server.stop()
    assert capfd.readouterr() == ("", "")


def test_no_client_can_make_it_public(server: viser.ViserServer) -> None:
    """A share request is ignored, and the client remains connected."""
    with viser_client(server.get_port()) as viewer:
        viewer.socket.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        server.scene.add_frame("/after")
        viewer.until(lambda: viewer.node("/after"))
    heard = {kind.__name__ for kind in handled_messages(server)}
    assert "ViewerCameraMessage" not in heard  # Camera handlers are registered per client.
    assert not any("Share" in kind for kind in heard)


@pytest.mark.parametrize("dark", [True, False])
def test_colours_are_as_asked_for(dark: bool) -> None:
    server = viser_compat.start_server("test", dark=dark)
    with viser_client(server.get_port()) as viewer:
        assert viewer.dark is dark
        assert viewer.camera.keys() >= {"SetCameraPositionMessage", "SetCameraLookAtMessage"}
    server.stop()


def test_stopping_ends_it_while_clients_look_on() -> None:
    """The port closes, clients are disconnected, and no server thread is left."""
    before = set(threading.enumerate())
    server = viser_compat.start_server("test")
    port = server.get_port()
    with viser_client(port) as viewer:
        server.stop()
        viewer.until(lambda: viewer.closed)
        with socket.socket() as probe, pytest.raises(ConnectionRefusedError):
            probe.connect(("127.0.0.1", port))
    left = set(threading.enumerate()) - before
    for thread in left:
        thread.join(PATIENCE_S)
    assert not {thread for thread in left if thread.is_alive()}
