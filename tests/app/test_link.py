"""`tsd-link` as a user runs it, alone and in the demo."""

from __future__ import annotations

import json
import signal
import socket
import time
import urllib.request
from collections.abc import Callable

import pytest

from tests.support.programs import Program, children_of
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages.topics import Service

pytestmark = pytest.mark.system

Start = Callable[..., Program]
ANY_PORT = ("--listen", "tcp/127.0.0.1:0")


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_a_robot_is_found_behind_it_and_is_as_far_as_it_says(
    start: Start, signal_number: int
) -> None:
    robot_at = start("tsd_mock", *ANY_PORT).ready().split()[-1]
    link = start("tsd_link", *ANY_PORT, "--target", robot_at, "--link", "delay=60ms,jitter=1ms")
    ready = link.ready()
    assert f"delay=60ms,jitter=1ms to {robot_at} on tcp/127.0.0.1:" in ready
    with Bus(client_config([ready.split()[-1]])) as bus:
        assert bus.wait_for_peer(10.0)
        assert bus.living_tokens("twin/*/alive", timeout_s=5.0)
        start_s = time.monotonic()
        assert bus.query(Service.DESC.key("tsd"), b"", timeout_s=5.0)
        assert time.monotonic() - start_s >= 2 * 0.06
    assert link.end(signal_number) == 0
    assert link.sentence == ""


def test_it_waits_for_a_robot_that_comes_later_and_ends_with_its_standard_input(
    start: Start,
) -> None:
    link = start("tsd_link", "--link", "delay=1ms", "--until-eof")
    assert link.ready().split()[-1].startswith("tcp/127.0.0.1:")
    assert link.process.stdin is not None
    link.process.stdin.close()
    assert link.wait() == 0


def test_it_ends_at_once_while_something_is_still_on_its_way(start: Start) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        target = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        link = start("tsd_link", "--target", target, "--link", "delay=600s")
        port = int(link.ready().rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)) as client:
            client.sendall(b"for later")
            assert link.end() == 0
    assert link.sentence == ""


def test_datagrams_are_relayed_when_the_target_is_of_datagrams(start: Start) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as target:
        target.bind(("127.0.0.1", 0))
        target.settimeout(20.0)
        endpoint = f"udp/127.0.0.1:{target.getsockname()[1]}"
        ready = start("tsd_link", "--target", endpoint, "--link", "delay=1ms").ready()
        assert ready.split()[-1].startswith("udp/127.0.0.1:")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.sendto(b"hello", ("127.0.0.1", int(ready.rpartition(":")[2])))
        assert target.recv(100) == b"hello"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--link", "dealy=1ms"], ["no 'dealy'", "did you mean 'delay'"]),
        (["--link", "delay=150"], ["'150' is no time", "150ms"]),
        (["--link", "delay=1ms", "--target", "nonsense"], ["'nonsense' is no endpoint of a link"]),
        (["--link", "", "--target", "tls/robot:7447"], ["no endpoint of a link"]),
        (["--link", "", "--listen", "tcp/0.0.0.0:0"], ["other machines", "tcp/127.0.0.1:0"]),
        (["--link", "", "--listen", "udp/127.0.0.1:0"], ["both be tcp or both udp"]),
        ([], ["required: --link"]),
    ],
)
def test_a_mistake_ends_in_one_clear_sentence(
    start: Start, arguments: list[str], words: list[str]
) -> None:
    link = start("tsd_link", *arguments)
    assert link.wait() != 0
    assert "Traceback" not in link.sentence
    assert link.output == []
    for word in words:
        assert word in link.sentence


def test_a_port_in_use_is_named(start: Start) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        link = start("tsd_link", "--listen", endpoint, "--link", "")
        assert link.wait() == 1
    assert link.errors == [f"tsd-link: cannot listen at {endpoint}: address already in use"]


def test_help_shows_examples(start: Start) -> None:
    link = start("tsd_link", "--help")
    assert link.wait() == 0
    assert "examples:" in "\n".join(link.output)
    assert "stall=2s@10s" in "\n".join(link.output)


def test_the_demo_puts_it_between_dashboard_and_robot_and_ends_all_three(start: Start) -> None:
    ports = ("--port", "0", "--bus-port", "0", "--no-record", "--no-browser", "--until-eof")
    demo = start("tsd_demo", *ports, "--link", "delay=100ms,jitter=10ms,loss=1%")
    url = demo.ready().split()[1]
    assert len(children_of(demo.process.pid)) == 3
    with urllib.request.urlopen(url + "healthz") as answer:  # noqa: S310  Our own page.
        assert json.load(answer)["ready"] is True
    assert demo.end() == 0
    assert demo.sentence == ""


def test_the_demo_explains_a_mistake_in_the_link_before_it_starts_anything(start: Start) -> None:
    demo = start("tsd_demo", "--no-record", "--no-browser", "--link", "loss=2")
    assert demo.wait() == 1
    assert len(demo.errors) == 1
    assert "loss: '2' is no share" in demo.sentence
