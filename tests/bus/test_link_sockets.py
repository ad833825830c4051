"""Sockets of a session's links: what happens to them when a peer has stopped."""

from __future__ import annotations

import socket
import struct
from pathlib import Path

import psutil
import pytest

from tests.bus.test_half_open import robot
from tests.support.robot_node import Mailbox
from tsd_twin.bus import Bus
from tsd_twin.bus.link_sockets import sockets_between
from tsd_twin.messages import topics


@pytest.mark.parametrize("kind", ["tcp", "tls"])
def test_a_link_to_a_stopped_peer_closes_without_delay(kind: str, tmp_path: Path) -> None:
    """On both sides; else a thread waits for the peer's socket, and all links that it serves."""
    with robot(kind, tmp_path) as (endpoint, config), Bus(config) as bus:
        statuses = Mailbox()
        bus.subscribe(topics.STATUS.key("tsd"), statuses)
        statuses.next()
        port = int(endpoint.rpartition(":")[2])
        links = [
            (f"tcp/{one.laddr.ip}:{one.laddr.port}", f"tcp/{one.raddr.ip}:{one.raddr.port}")
            for one in psutil.Process().net_connections("tcp")
            if one.status == psutil.CONN_ESTABLISHED and port in (one.laddr.port, one.raddr.port)
        ]
        assert [lingers(*ends) for ends in links] == [[False], [False]]


def lingers(source: str, target: str) -> list[bool]:
    """Return for each socket between two endpoints whether closing it may take a while."""
    size = struct.calcsize("ii")
    return [
        bool(struct.unpack("ii", one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, size))[0])
        for one in sockets_between(source, target)
    ]
