"""Keys of a router on this machine."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

OPERATOR = "alice"


def free_endpoint() -> str:
    """Return a TCP endpoint that nothing uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def make_router_keys(folder: Path, robots: Sequence[str]) -> str:
    """Write the configurations of a router, its robots and an operator of them; return where."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    router = ["--router-host", "127.0.0.1", "--listen", endpoint]
    names = [flag for robot in robots for flag in ("--robot", robot)]
    rights = ["--operator", OPERATOR, "--robots", ",".join(robots)]
    command = [sys.executable, "-m", "tsd_certs", str(folder), *router, *names, *rights]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return endpoint
