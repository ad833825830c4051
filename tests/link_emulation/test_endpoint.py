"""Endpoints are parsed exactly in Zenoh's syntax."""

from __future__ import annotations

import pytest

from tsd_twin.link_emulation import LinkError
from tsd_twin.link_emulation.spec import Endpoint


@pytest.mark.parametrize(
    ("text", "protocol", "host", "port", "is_loopback"),
    [
        ("tcp/127.0.0.1:7447", "tcp", "127.0.0.1", 7447, True),
        ("udp/127.8.0.1:0", "udp", "127.8.0.1", 0, True),
        ("tcp/[::1]:65535", "tcp", "::1", 65535, True),
        ("tcp/localhost:7447", "tcp", "localhost", 7447, True),
        ("udp/10.0.0.5:7447", "udp", "10.0.0.5", 7447, False),
        ("tcp/[::]:7447", "tcp", "::", 7447, False),
        ("tcp/robot.example:7447", "tcp", "robot.example", 7447, False),
    ],
)
def test_an_endpoint_reads_and_writes_the_same(
    text: str, protocol: str, host: str, port: int, is_loopback: bool
) -> None:
    endpoint = Endpoint.parse(text)
    assert (endpoint.protocol, endpoint.host, endpoint.port) == (protocol, host, port)
    assert endpoint.is_loopback is is_loopback
    assert str(endpoint) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nonsense",
        "127.0.0.1:7447",
        "tls/127.0.0.1:7447",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:",
        "tcp/127.0.0.1:65536",
        "tcp/:7447",
        "tcp/::1:7447",
        "tcp/127.0.0.1:7447?prio=1-3",
    ],
)
def test_anything_else_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(LinkError) as raised:
        Endpoint.parse(text)
    assert f"'{text}' is no endpoint" in str(raised.value)
    assert "tcp/127.0.0.1:7447" in str(raised.value)
