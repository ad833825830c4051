"""Dashboard and robot over a network, secured with certificates."""

from __future__ import annotations

import json
import re
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from tests.support.link_sockets import free_port
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S

pytestmark = pytest.mark.system

Start = Callable[..., Program]
_STATES = 600
_AGAIN = 10


@pytest.fixture
def keys(start: Start, tmp_path: Path) -> Path:
    """Keys for a robot on this machine, an operator and a viewer."""
    folder = tmp_path / "keys"
    people = ("--operator", "alice", "--viewer", "guest")
    where = ("--robot-host", "127.0.0.1", "--listen", f"tls/127.0.0.1:{free_port()}")
    assert start("tsd_certs", str(folder), *people, *where).wait() == 0
    start("tsd_mock", "--zenoh-config", str(folder / "robot.json5")).ready()
    return folder


def page_of(start: Start, config: Path) -> ClientConnection:
    """Connect to a user's dashboard as its page does, without a browser."""
    dashboard = start("tsd_dashboard", "--port", "0", "--zenoh-config", str(config))
    port = re.findall(r"http://127.0.0.1:(\d+)", dashboard.ready())[0]
    return connect(f"ws://127.0.0.1:{port}/teleop?page={secrets.token_hex(8)}")


def say(page: ClientConnection, **message: Any) -> None:
    page.send(json.dumps(message))


def hear(page: ClientConnection, kind: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    while True:
        message = json.loads(page.recv(PATIENCE_S))
        if message["t"] == kind:
            return message


def test_the_dashboard_of_an_operator_drives_under_her_name(start: Start, keys: Path) -> None:
    with page_of(start, keys / "alice.json5") as page:
        assert re.fullmatch(r"alice-[0-9a-f]{8}", hear(page, "welcome")["operator"])
        for number in range(_STATES):
            state = hear(page, "state")
            mode = state["status"]["mode"]
            say(page, t="heartbeat", status_seq=state["status_seq"], sent_ms=0.0)
            if not state["has_control"] or mode in ("disarmed", "fault"):
                # Repeat periodically, because a delayed client loses control and a delayed robot
                # faults.
                if number % _AGAIN == 0:
                    ask = {"t": "arm"} if mode == "disarmed" else {"t": "reset"}
                    say(page, **(ask if state["has_control"] else {"t": "lease", "op": "acquire"}))
            elif mode == "ready" and number % _AGAIN == 0:
                say(page, t="release")
            elif mode in ("ready", "driving"):
                say(page, t="drive", vx=0.3, vy=0.0, omega=0.0, status_seq=state["status_seq"])
            if state["twist"] is not None and state["twist"][0] > 0.2:
                assert state["status"]["lease"]["holder"].startswith("alice-")
                return
    pytest.fail("she never drove")


def test_the_dashboard_of_a_viewer_watches_and_stops(start: Start, keys: Path) -> None:
    with page_of(start, keys / "guest.json5") as page:
        assert hear(page, "welcome")["role"] == "viewer"
        assert hear(page, "state")["status"]["mode"] == "disarmed"
        say(page, t="lease", op="acquire")
        answer = hear(page, "reply")
        assert not answer["ok"]
        assert answer["why"]["code"] == "viewer"
        say(page, t="stop")
        assert hear(page, "reply")["ok"]
        for _ in range(_STATES):
            state = hear(page, "state")
            say(
                page, t="heartbeat", status_seq=state["status_seq"], sent_ms=0.0
            )  # Or none would follow.
            if state["status"]["mode"] == "stopped":
                return
    pytest.fail("it did not stop")
