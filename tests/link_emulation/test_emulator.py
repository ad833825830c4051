"""A simulated link starts and ends, and reports invalid requests."""

from __future__ import annotations

import socket
import threading

import pytest

from tests.support.link_sockets import datagram_socket, listening
from tsd_twin.link_emulation import LinkEmulator, LinkError, LinkSpec

TARGET = "127.0.0.1:7447"


@pytest.mark.parametrize(
    ("listen", "target", "words"),
    [
        ("tcp/127.0.0.1:0", f"udp/{TARGET}", ["must both be tcp or both udp"]),
        ("tcp/10.0.0.5:7447", f"tcp/{TARGET}", ["other machines", "tcp/127.0.0.1:7447"]),
        ("udp/[::]:7447", f"udp/{TARGET}", ["other machines", "udp/127.0.0.1:7447"]),
        ("nonsense", f"tcp/{TARGET}", ["'nonsense' is no endpoint"]),
        ("tcp/127.0.0.1:0", "tls/robot:7447", ["'tls/robot:7447' is no endpoint"]),
    ],
)
def test_endpoints_that_cannot_be_are_refused(listen: str, target: str, words: list[str]) -> None:
    with pytest.raises(LinkError) as raised:
        LinkEmulator(LinkSpec(), listen, target)
    for word in words:
        assert word in str(raised.value)


def test_a_port_in_use_is_named() -> None:
    with listening() as tcp, datagram_socket() as udp:
        for protocol, taken in (("tcp", tcp), ("udp", udp)):
            endpoint = f"{protocol}/127.0.0.1:{taken.getsockname()[1]}"
            simulator = LinkEmulator(LinkSpec(), endpoint, f"{protocol}/{TARGET}")
            with pytest.raises(LinkError) as raised:
                simulator.start()
            assert str(raised.value) == f"cannot listen at {endpoint}: address already in use"
            simulator.close()


@pytest.mark.parametrize("host", ["no-such-host.invalid", "x" * 70])
def test_a_target_of_datagrams_that_nobody_knows_is_named(host: str) -> None:
    simulator = LinkEmulator(LinkSpec(), "udp/127.0.0.1:0", f"udp/{host}:7447")
    with pytest.raises(LinkError, match=f"the host of udp/{host}:7447 cannot be resolved"):
        simulator.start()


def test_a_port_of_one_s_choice_is_kept() -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with LinkEmulator(LinkSpec(), f"tcp/127.0.0.1:{port}", f"tcp/{TARGET}") as simulator:
        assert simulator.endpoint == f"tcp/127.0.0.1:{port}"


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_it_can_be_closed_twice_and_leaves_no_thread_and_started_again(protocol: str) -> None:
    before = threading.active_count()
    simulator = LinkEmulator(LinkSpec(), f"{protocol}/127.0.0.1:0", f"{protocol}/{TARGET}")
    for _ in range(2):
        simulator.start()
        assert threading.active_count() == before + 1
        simulator.close()
        simulator.close()
        assert threading.active_count() == before


@pytest.mark.parametrize("call", ["cut", "restore"])
def test_what_does_not_run_cannot_be_controlled(call: str) -> None:
    simulator = LinkEmulator(LinkSpec(), "tcp/127.0.0.1:0", f"tcp/{TARGET}")
    with pytest.raises(LinkError, match="not running"):
        getattr(simulator, call)()
