"""Key folders of robots and routers: provisioning and reading."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tests.support.link_sockets import free_port
from tsd_twin import security
from tsd_twin.bus import client_config, from_file, node_config
from tsd_twin.security import Role
from tsd_twin.security.key_folder import KeyFolder, provision

NOW = datetime.now(UTC)
ALICE, BOB, GUEST = (
    security.client("alice", Role.OPERATOR),
    security.client("bob", Role.OPERATOR),
    security.client("guest", Role.VIEWER),
)
FIRST: dict[str, Any] = {"hosts": ("robot.local", "192.168.1.7"), "identities": (ALICE, GUEST)}


def provision_folder(path: Path, now: datetime = NOW, **order: Any) -> list[str]:
    """Provision a folder; return the names of the created files."""
    folder = KeyFolder(path)
    provision(
        folder,
        now,
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(client_config([endpoint]).json5),
        **order,
    )
    return [file.name for file in folder.made]


def content(path: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(path.iterdir())}


def setting(path: Path, name: str, key: str) -> Any:
    """Return a value of the configuration as parsed by Zenoh."""
    return json.loads(from_file(str(path / f"{name}.json5")).parsed().get_json(key))


def commanders(path: Path) -> set[str]:
    """Return the names of the clients that may send commands."""
    policies = setting(path, "robot", "access_control/policies")
    return {
        name
        for policy in policies
        for name in policy["subjects"]
        if f"drive-{name}" in policy["rules"]
    }


OPERATOR = "alice"


def make_router_keys(folder: Path, robots: Sequence[str]) -> str:
    """Write the configurations of a router, its robots and an operator; return the endpoint."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    router = ["--router-host", "127.0.0.1", "--listen", endpoint]
    names = [flag for robot in robots for flag in ("--robot", robot)]
    rights = ["--operator", OPERATOR, "--robots", ",".join(robots)]
    command = [sys.executable, "-m", "tsd_certs", str(folder), *router, *names, *rights]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return endpoint
