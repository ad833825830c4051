"""Real datagrams through a link are delayed, lost and reordered."""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections.abc import Generator

import pytest

from tests.support.link_sockets import datagram_socket, eventually, port_of, simulated
from tests.support.withheld import PATIENCE_S, Stopwatch
from tsd_twin.link_emulation import LinkEmulator, LinkSpec
from tsd_twin.link_emulation.relays import CAPACITY_BYTES, HEADER_BYTES

FEW = 200
"""Datagrams buffered by a socket that is not read."""


@pytest.fixture
def target() -> Generator[socket.socket]:
    with datagram_socket() as made:
        yield made


@pytest.fixture
def client() -> Generator[socket.socket]:
    with datagram_socket() as made:
        yield made


def link_to(target: socket.socket, spec: str) -> contextlib.AbstractContextManager[LinkEmulator]:
    return simulated(spec, "udp", target.getsockname()[1])


def address(simulator: LinkEmulator) -> tuple[str, int]:
    return ("127.0.0.1", port_of(simulator.endpoint))


def numbers_until_end(target: socket.socket) -> list[int]:
    numbers: list[int] = []
    while (data := target.recv(100)) != b"end":
        numbers.append(int(data))
    return numbers


def test_each_client_gets_its_own_answers(target: socket.socket, client: socket.socket) -> None:
    with link_to(target, "delay=1ms") as simulator, datagram_socket() as other:
        for name, end in ((b"client", client), (b"other", other)):
            end.sendto(name, address(simulator))
        calls = dict(target.recvfrom(100) for _ in range(2))
        assert len(set(calls.values())) == 2
        for name, caller in calls.items():
            target.sendto(b"to " + name, caller)
        assert client.recvfrom(100) == (b"to client", address(simulator))
        assert other.recvfrom(100) == (b"to other", address(simulator))
        client.sendto(b"client", address(simulator))  # Still known by the same address.
        assert target.recvfrom(100) == (b"client", calls[b"client"])


def test_a_datagram_takes_the_delay(target: socket.socket, client: socket.socket) -> None:
    with link_to(target, "delay=50ms") as simulator:
        watch, start_s = Stopwatch(), time.monotonic()
        client.sendto(b"ping", address(simulator))
        _, caller = target.recvfrom(100)
        assert time.monotonic() - start_s >= 0.05
        assert watch.took_s < 0.55
        target.sendto(b"pong", caller)
        assert client.recv(100) == b"pong"
        assert time.monotonic() - start_s >= 0.1
        assert watch.took_s < 1.1


def send_numbers(simulator: LinkEmulator, client: socket.socket) -> None:
    """Send a few numbers, then an end marker that is neither lost nor overtakes them."""
    for number in range(FEW):
        client.sendto(str(number).encode(), address(simulator))
    eventually(lambda: simulator.up.packets == FEW)
    simulator.set(LinkSpec())
    eventually(lambda: simulator.up.delivered + simulator.up.lost == FEW)
    client.sendto(b"end", address(simulator))


def test_lost_is_lost_and_counted_and_the_same_with_the_same_seed(
    target: socket.socket, client: socket.socket
) -> None:
    runs: list[list[int]] = []
    for seed in (1, 1, 2):
        with link_to(target, f"loss=30%,seed={seed}") as simulator:
            send_numbers(simulator, client)
            runs.append(numbers_until_end(target))
            lost = simulator.up.lost
        assert len(runs[-1]) == FEW - lost
        assert lost == pytest.approx(0.3 * FEW, abs=5.0 * math.sqrt(0.3 * 0.7 * FEW))
        assert runs[-1] == sorted(runs[-1])
    assert runs[0] == runs[1] != runs[2]


def test_each_direction_has_its_own_chance(target: socket.socket, client: socket.socket) -> None:
    with link_to(target, "loss=50%") as simulator:
        simulator.set(LinkSpec())
        client.sendto(b"hello", address(simulator))
        _, caller = target.recvfrom(100)
        target.sendto(b"hello", caller)
        assert client.recv(100) == b"hello"
        simulator.set(LinkSpec(loss=0.5))
        for number in range(FEW):
            client.sendto(str(number).encode(), address(simulator))
            target.sendto(str(number).encode(), caller)
        eventually(lambda: simulator.up.packets == simulator.down.packets == FEW + 1)
        simulator.set(LinkSpec())
        client.sendto(b"end", address(simulator))
        target.sendto(b"end", caller)
        assert set(numbers_until_end(target)) != set(numbers_until_end(client))


def test_reordered_datagrams_are_overtaken_and_all_there(
    target: socket.socket, client: socket.socket
) -> None:
    with link_to(target, "reorder=20%") as simulator:
        send_numbers(simulator, client)
        numbers = numbers_until_end(target)
    assert sorted(numbers) == list(range(FEW))
    assert numbers != sorted(numbers)


def test_a_stall_keeps_datagrams_until_the_queue_is_full_and_then_loses_them(
    target: socket.socket, client: socket.socket
) -> None:
    large, fitting = bytes(20_000), CAPACITY_BYTES // (20_000 + HEADER_BYTES)
    with link_to(target, "") as simulator:
        simulator.stall(60.0)
        for sent in range(1, fitting + 4):
            client.sendto(large, address(simulator))
            eventually(lambda sent=sent: simulator.up.packets == sent)
        assert simulator.up.lost == 3
        assert simulator.up.delivered == 0
        target.setblocking(False)
        with pytest.raises(BlockingIOError):
            target.recv(1)


def test_a_stall_ends_with_everything_that_was_kept(
    target: socket.socket, client: socket.socket
) -> None:
    with link_to(target, "") as simulator:
        simulator.stall(0.3)
        start_s = time.monotonic()
        for number in range(10):
            client.sendto(str(number).encode(), address(simulator))
        assert [int(target.recv(100)) for _ in range(10)] == list(range(10))
        assert time.monotonic() - start_s > 0.2


def test_a_cut_loses_datagrams_for_good(target: socket.socket, client: socket.socket) -> None:
    with link_to(target, "delay=100ms") as simulator:
        client.sendto(b"on its way", address(simulator))
        eventually(lambda: simulator.up.packets == 1)
        simulator.cut()
        client.sendto(b"into the void", address(simulator))
        eventually(lambda: simulator.up.lost == 2)
        simulator.restore()
        client.sendto(b"after", address(simulator))
        assert target.recv(100) == b"after"


def test_nobody_at_the_target_is_no_end_of_the_link(client: socket.socket) -> None:
    with datagram_socket() as gone:
        port = gone.getsockname()[1]
    with simulated("", "udp", port) as simulator:
        for sent in range(1, 4):
            client.sendto(b"anybody?", address(simulator))
            eventually(lambda sent=sent: simulator.up.delivered == sent)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as target:
            target.bind(("127.0.0.1", port))
            target.settimeout(PATIENCE_S)
            client.sendto(b"now?", address(simulator))
            assert target.recv(100) == b"now?"
