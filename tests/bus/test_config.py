"""Sessions are closed by default, and errors on opening are one sentence."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from tsd_twin.bus import Bus, Config, client_config, from_file, node_config
from tsd_twin.bus.config import MOST_MESSAGE_BYTES, is_loopback
from tsd_twin.errors import BusError

OPEN_DOORS = (
    "tcp/0.0.0.0:7447",
    "tcp/[::]:7447",
    "tcp/192.168.1.5:7447",
    "tcp/robot.local:7447",
    "udp/0.0.0.0:7447",
    "tls/0.0.0.0:7447",
    "quic/0.0.0.0:7447",
    "ws/127.0.0.2.example.com:80",
    "tcp/*:7447",
)


def setting(config: Config, key: str) -> Any:
    """Return a setting as Zenoh parses it."""
    return json.loads(config.parsed().get_json(key))


@pytest.mark.parametrize("endpoint", OPEN_DOORS)
def test_a_door_to_other_machines_is_refused_with_what_it_needs(endpoint: str) -> None:
    with pytest.raises(BusError, match="TLS and access control") as caught:
        node_config(["tcp/127.0.0.1:0", endpoint])
    assert str(caught.value).startswith(endpoint)
    assert "--zenoh-config" in str(caught.value)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/127.1.2.3:0",
        "tcp/localhost:7447",
        "tcp/[::1]:7447",
        "udp/127.0.0.1:7447",
        "tcp/127.0.0.1:7447?prio=1-3",
        "tcp/127.0.0.1:7447#iface=lo",
        "unixsock-stream//tmp/robot",
    ],
)
def test_doors_of_this_machine_are_allowed(endpoint: str) -> None:
    assert is_loopback(endpoint)
    assert setting(node_config([endpoint]), "listen/endpoints") == [endpoint]


@pytest.mark.parametrize("config", [node_config(["tcp/127.0.0.1:0"]), client_config(["tcp/h:1"])])
def test_nothing_is_found_or_shared_that_was_not_asked_for(config: Config) -> None:
    assert setting(config, "scouting/multicast/enabled") is False
    assert setting(config, "scouting/gossip/enabled") is False
    assert setting(config, "transport/shared_memory/enabled") is False
    assert setting(config, "transport/link/tx/lease") == 1000
    retry = setting(config, "connect/retry")
    assert (retry["period_init_ms"], retry["period_max_ms"]) == (100, 1000)


def test_a_client_listens_nowhere() -> None:
    assert setting(client_config(["tcp/127.0.0.1:7447"]), "listen/endpoints") == []
    with Bus(client_config([])) as bus:
        assert bus.endpoints() == []


def test_the_bus_can_be_looked_at_but_not_set_from_outside() -> None:
    config = node_config(["tcp/127.0.0.1:0"])
    assert setting(config, "adminspace/permissions") == {"read": True, "write": False}


@pytest.mark.parametrize("endpoint", ["nonsense", ""])
def test_what_is_no_endpoint_is_told_so(endpoint: str) -> None:
    with pytest.raises(BusError, match="no endpoint"):
        node_config([endpoint])


def test_a_port_in_use_is_one_sentence() -> None:
    with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
        (taken,) = bus.endpoints()
        with pytest.raises(BusError) as caught:
            Bus(node_config([taken]))
    assert str(caught.value) == f"cannot open the bus at {taken}: address already in use"


# Files.


def written(path: Path, **settings: Any) -> str:
    file = path / "zenoh.json5"
    file.write_text(json.dumps(settings))
    return str(file)


GUARD = {"enabled": True, "default_permission": "deny", "rules": [], "subjects": [], "policies": []}


@pytest.mark.parametrize(
    "settings",
    [
        {"listen": {"endpoints": ["tcp/0.0.0.0:7447"]}},
        {"listen": {"endpoints": {"router": ["tcp/0.0.0.0:7447"]}}},
        {"listen": {"endpoints": ["tls/0.0.0.0:7447"]}},
        {"listen": {"endpoints": ["tcp/0.0.0.0:7447"]}, "access_control": GUARD},
        {
            "listen": {"endpoints": ["tls/0.0.0.0:7447"]},
            "access_control": GUARD | {"default_permission": "allow"},
        },
        {},
    ],
    ids=["tcp", "for routers", "tls alone", "rules alone", "rules that allow", "by default"],
)
def test_a_file_that_opens_a_door_is_refused(tmp_path: Path, settings: dict[str, Any]) -> None:
    with pytest.raises(BusError, match="TLS and access control"):
        from_file(written(tmp_path, mode="router", **settings))


def test_a_file_with_tls_and_access_control_may_open_a_door(tmp_path: Path) -> None:
    endpoints = ["tls/0.0.0.0:7447"]
    config = from_file(
        written(tmp_path, mode="router", listen={"endpoints": endpoints}, access_control=GUARD)
    )
    assert setting(config, "listen/endpoints") == endpoints


@pytest.mark.parametrize(
    ("limit", "most"), [(None, MOST_MESSAGE_BYTES), (65536, 65536), (1 << 30, MOST_MESSAGE_BYTES)]
)
def test_a_file_may_only_lower_the_longest_message(
    tmp_path: Path, limit: int | None, most: int
) -> None:
    received = {} if limit is None else {"max_message_size": limit}
    plain = json.loads(node_config(["tcp/127.0.0.1:0"]).json5)
    plain["transport"].setdefault("link", {})["rx"] = received
    config = from_file(written(tmp_path, **plain))
    assert setting(config, "transport/link/rx/max_message_size") == most


def test_a_file_may_open_a_session(tmp_path: Path) -> None:
    plain = json.loads(node_config(["tcp/127.0.0.1:0"]).json5)
    with Bus(from_file(written(tmp_path, **plain))) as bus:
        assert bus.endpoints()[0].startswith("tcp/127.0.0.1:")


@pytest.mark.parametrize(
    ("text", "says"), [("{", "expected"), ('{"leese": 1}', "leese"), ('{"mode": "boat"}', "boat")]
)
def test_a_file_that_zenoh_does_not_understand_is_named(
    tmp_path: Path, text: str, says: str
) -> None:
    file = tmp_path / "mine.json5"
    file.write_text(text)
    with pytest.raises(BusError, match=says) as caught:
        from_file(str(file))
    assert str(caught.value).startswith(str(file))


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="No such file"):
        from_file(str(tmp_path / "none.json5"))


def test_the_version_that_was_measured_is_the_one_installed() -> None:
    """Queues, leases and access rules differ between versions; see the bound in pyproject."""
    assert version("eclipse-zenoh") == "1.10.2"
