"""Connections through a link behave like TCP over a bad link, seen from both ends."""

from __future__ import annotations

import errno
import gc
import socket
import struct
import threading
import time

import numpy as np
import pytest

from tests.support.link_sockets import (
    connected,
    eventually,
    listening,
    port_of,
    read_all,
    simulated,
)
from tests.support.withheld import PATIENCE_S, Stopwatch
from tsd_twin.link_emulation.emulator import Direction
from tsd_twin.link_emulation.link import Stream

RESET = struct.pack("ii", 1, 0)
"""Zero linger time, so that closing sends a reset."""
NOISE = np.random.default_rng(0).bytes(300_000)


@pytest.mark.parametrize(
    "spec", ["", "delay=1ms,jitter=1ms", "loss=2%,reorder=5%,seed=3", "bandwidth=50Mbit"]
)
def test_all_bytes_arrive_unchanged_both_ways_at_once(spec: str) -> None:
    with connected(spec) as (_, client, target):
        ends = ((client, NOISE), (target, NOISE[::-1]))
        senders = [threading.Thread(target=end.sendall, args=(data,)) for end, data in ends]
        for sender in senders:
            sender.start()
        assert read_all(target, len(NOISE)) == NOISE
        assert read_all(client, len(NOISE)) == NOISE[::-1]
        for sender in senders:
            sender.join()


def test_lost_segments_are_sent_again_and_counted() -> None:
    with connected("loss=10%,seed=1") as (simulator, client, target):
        client.sendall(NOISE[:60_000])
        assert read_all(target, 60_000) == NOISE[:60_000]
        counters = simulator.up
    segments = 60_000 // 1400 + 2  # A final one, and one on opening; small reads cause more.
    assert counters.lost > 0
    assert counters.delivered >= segments
    assert counters.packets == counters.delivered + counters.lost


def test_what_is_sent_takes_the_delay_and_a_handshake_takes_a_round_trip() -> None:
    delay_s = 0.05
    with listening() as server, simulated("delay=50ms", "tcp", server.getsockname()[1]) as link:
        start_s = time.monotonic()
        with socket.create_connection(("127.0.0.1", port_of(link.endpoint))) as client:
            client.settimeout(PATIENCE_S)
            client.sendall(b"ping")
            target, _ = server.accept()
            with target:
                target.settimeout(PATIENCE_S)
                assert read_all(target, 4) == b"ping"
                assert time.monotonic() - start_s >= 3.0 * delay_s
                watch, start_s = Stopwatch(), time.monotonic()
                target.sendall(b"pong")
                assert read_all(client, 4) == b"pong"
                assert time.monotonic() - start_s >= delay_s
                assert watch.took_s < delay_s + 0.5


def test_no_segment_waits_for_a_delayed_acknowledgement() -> None:
    """Linux delays an acknowledgement by at least 40 ms."""
    with connected("delay=1ms") as (_, client, target):
        took_s: list[float] = []
        for _ in range(30):
            watch = Stopwatch()
            client.sendall(b"next")
            assert read_all(target, 4) == b"next"
            target.sendall(NOISE[:14_000])
            assert read_all(client, 14_000) == NOISE[:14_000]
            took_s.append(watch.took_s)
    assert np.median(took_s) < 0.03


@pytest.mark.parametrize("direction", list(Direction))
def test_one_way_stalls_while_the_other_delivers(direction: Direction) -> None:
    """Replies on the open direction arrive at once; stalled data arrives later."""
    stall_s = 0.4
    with connected("") as (simulator, client, target):
        watch, start_s = Stopwatch(), time.monotonic()
        simulator.stall(stall_s, [direction])
        stalled, free = (client, target) if direction is Direction.UP else (target, client)
        stalled.sendall(b"late")
        free.sendall(b"now")
        assert read_all(stalled, 3) == b"now"
        assert watch.took_s < stall_s
        assert read_all(free, 4) == b"late"
        assert time.monotonic() - start_s >= stall_s


def test_the_end_of_one_direction_passes_and_the_other_goes_on() -> None:
    with connected("delay=5ms") as (_, client, target):
        client.sendall(NOISE[:10_000])
        client.shutdown(socket.SHUT_WR)
        assert read_all(target) == NOISE[:10_000]
        target.sendall(NOISE[:20_000])
        target.shutdown(socket.SHUT_WR)
        assert read_all(client) == NOISE[:20_000]


def test_what_a_client_says_before_it_hangs_up_at_once_arrives() -> None:
    with (
        listening() as server,
        simulated("delay=20ms", "tcp", server.getsockname()[1]) as simulator,
    ):
        with socket.create_connection(("127.0.0.1", port_of(simulator.endpoint))) as client:
            client.sendall(b"bye")
        target, _ = server.accept()
        with target:
            target.settimeout(PATIENCE_S)
            assert read_all(target) == b"bye"


@pytest.mark.parametrize("breaker", ["client", "target"])
def test_a_reset_passes(breaker: str) -> None:
    with connected("delay=5ms") as (_, client, target):
        broken, other = (client, target) if breaker == "client" else (target, client)
        broken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        broken.close()
        with pytest.raises(ConnectionResetError):
            other.recv(1)


def test_a_target_that_is_not_there_is_a_reset_and_one_that_comes_later_is_found() -> None:
    with listening() as server:
        port = server.getsockname()[1]
    with simulated("", "tcp", port) as simulator:
        address = ("127.0.0.1", port_of(simulator.endpoint))
        with (
            pytest.raises(ConnectionResetError),  # May arrive before the client polls.
            socket.create_connection(address, PATIENCE_S) as client,
        ):
            client.recv(1)
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(PATIENCE_S)
            with socket.create_connection(address, PATIENCE_S) as client:
                target, _ = server.accept()
                with target:
                    target.sendall(b"late")
                    assert read_all(client, 4) == b"late"


def fill(sender: socket.socket, at_most: int) -> int:
    """Send until no more data is accepted for a while; return the amount."""
    sender.settimeout(0.3)
    taken = 0
    while taken < at_most:
        try:
            taken += sender.send(b"x" * 65536)
        except TimeoutError:
            break
    return taken


def test_a_stalled_link_is_a_full_socket_and_everything_arrives_afterwards() -> None:
    with connected("") as (simulator, client, target):
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65536)
        simulator.stall(60.0)
        taken = fill(client, 64 << 20)
        assert 256 * 1024 <= taken < 1 << 20
        target.setblocking(False)
        with pytest.raises(BlockingIOError):
            target.recv(1)
    # Closing does not wait for the end of the stall.


def test_after_a_stall_a_full_socket_empties() -> None:
    with connected("") as (simulator, client, target):
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65536)
        simulator.stall(1.0)
        taken = fill(client, 64 << 20)
        assert taken < 1 << 20
        client.shutdown(socket.SHUT_WR)
        assert len(read_all(target)) == taken


def test_a_target_that_does_not_read_stops_the_client() -> None:
    with connected("delay=1ms") as (_, client, target):
        for end, buffer in ((client, socket.SO_SNDBUF), (target, socket.SO_RCVBUF)):
            end.setsockopt(socket.SOL_SOCKET, buffer, 65536)
        taken = fill(client, 64 << 20)
        assert taken < 2 << 20
        client.shutdown(socket.SHUT_WR)
        assert len(read_all(target)) == taken


def test_a_cut_link_delivers_nothing_and_a_mended_one_all() -> None:
    with connected("") as (simulator, client, target):
        simulator.cut()
        client.sendall(b"into the void")
        eventually(lambda: simulator.up.lost >= 2)  # Once originally, once as a retransmission.
        target.setblocking(False)
        with pytest.raises(BlockingIOError):
            target.recv(1)
        target.settimeout(PATIENCE_S)
        simulator.restore()
        assert read_all(target, 13) == b"into the void"


def test_a_client_that_gives_up_while_the_link_is_cut_is_forgotten() -> None:
    with listening() as server, simulated("", "tcp", server.getsockname()[1]) as simulator:
        simulator.cut()
        client = socket.create_connection(("127.0.0.1", port_of(simulator.endpoint)))
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        client.close()
        eventually(lambda: simulator.up.packets > 0)
        simulator.restore()
        server.settimeout(0.5)  # Longer than the timeout after which it would send again.
        with pytest.raises(TimeoutError):
            server.accept()


def test_a_client_that_gives_up_during_the_handshake_resets_the_target() -> None:
    with listening() as server, simulated("delay=100ms", "tcp", server.getsockname()[1]) as link:
        client = socket.create_connection(("127.0.0.1", port_of(link.endpoint)))
        target, _ = server.accept()
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        client.close()
        with target:
            target.settimeout(PATIENCE_S)
            with pytest.raises(ConnectionResetError):
                target.recv(1)


def test_each_connection_has_its_own_bytes() -> None:
    with (
        listening() as server,
        simulated("jitter=2ms,loss=1%", "tcp", server.getsockname()[1]) as simulator,
    ):
        address = ("127.0.0.1", port_of(simulator.endpoint))
        clients = [socket.create_connection(address, PATIENCE_S) for _ in range(10)]
        for number, client in enumerate(clients):
            client.sendall(bytes([number]) * 5000)
            client.shutdown(socket.SHUT_WR)
        seen: set[bytes] = set()
        for _ in clients:
            target, _ = server.accept()
            with target:
                target.settimeout(PATIENCE_S)
                seen.add(read_all(target))
        assert seen == {bytes([number]) * 5000 for number in range(10)}
        for client in clients:
            client.close()


def streams() -> int:
    """Return the number of existing streams."""
    gc.collect()
    return sum(isinstance(each, Stream) for each in gc.get_objects())


def test_nothing_is_left_of_connections_that_are_over() -> None:
    before = streams()
    with listening() as server, simulated("loss=5%", "tcp", server.getsockname()[1]) as link:
        address = ("127.0.0.1", port_of(link.endpoint))
        for reset in (False, True, False, True):
            with socket.create_connection(address, PATIENCE_S) as client:
                target, _ = server.accept()
                with target:
                    target.settimeout(PATIENCE_S)
                    client.sendall(b"over")
                    assert read_all(target, 4) == b"over"
                    assert streams() > before
                    if reset:
                        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        server.close()
        with (
            pytest.raises(ConnectionResetError),
            socket.create_connection(address, PATIENCE_S) as refused,
        ):
            refused.recv(1)
        eventually(lambda: streams() <= before)


def test_closing_breaks_all_connections_and_frees_the_port() -> None:
    with connected("delay=10ms") as (simulator, client, target):
        port = port_of(simulator.endpoint)
        simulator.close()
        for end in (client, target):
            with pytest.raises(ConnectionResetError):
                end.recv(1)
        with pytest.raises(ConnectionRefusedError) as raised:
            socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        assert raised.value.errno == errno.ECONNREFUSED
