"""No messages of a hostile peer move the robot, end a process or exhaust its memory."""

from __future__ import annotations

import contextlib
import http.client
import json
import random
import secrets
import subprocess
import sys
import time
from collections.abc import Generator
from urllib.parse import urlsplit

import msgspec
import psutil
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.support.viser_client import CAMERA
from tests.support.withheld import AS_OTHERS, PATIENCE_S
from tests.system.fault_stage import ID, FaultStage, fault_stage
from tsd_twin.bus import Bus, client_config
from tsd_twin.errors import NoAnswerError
from tsd_twin.messages.services import LeaseReply, decode_json
from tsd_twin.messages.topics import Service

pytestmark = pytest.mark.system

WARM_UP, FLOOD, REQUESTS = 20_000, 80_000, 5_000
MESSAGES = 5_000
"""Messages on each of the two sockets of a page."""
ROUND, ECHO_EVERY = 250, 25
"""Messages per socket, and between two waits until they have been read."""
SLACK_MB = 40.0
"""Buffers of the allocator and of zenoh, and queues of samples of up to 60 kB. How far they fill
depends on the speed of the machine: 10 MB on a busy one, 28 MB on one that has nothing else to do;
45 to 49 MB after 300,000 to 900,000 samples.
"""
ANSWER_S = 2.0
"""Duration of a lease without renewal."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Generator[FaultStage]:
    with fault_stage(tmp_path_factory.mktemp("robot")) as it:
        yield it


class Ledger:
    """Tracks memory and liveness of robot node and dashboard."""

    def __init__(self, scene: FaultStage) -> None:
        programs = {"robot": scene.mock, "dashboard": scene.dashboard}
        self._processes = {name: psutil.Process(p.process.pid) for name, p in programs.items()}
        self.start_mb = self.rss_mb()

    def rss_mb(self) -> dict[str, float]:
        return {name: p.memory_info().rss / 1e6 for name, p in self._processes.items()}

    def check(self) -> dict[str, float]:
        """Return the memory growth of each, after checking its limit."""
        now_mb = self.rss_mb()
        growth = {name: round(now_mb[name] - mb, 1) for name, mb in self.start_mb.items()}
        assert max(growth.values()) <= SLACK_MB, growth
        return growth


def flood(scene: FaultStage, seed: int, count: int, *what: str) -> list[float]:
    """Send malformed samples, and return the node's response times during the flood."""
    arguments = [scene.endpoint, ID, str(seed), str(count), *what]
    # Normal priority, because an attacker would be another machine.
    hostile = subprocess.Popen(
        [*AS_OTHERS, sys.executable, "-m", "tests.system.hostile", *arguments]
    )
    took_s: list[float] = []
    with contextlib.ExitStack() as ends:
        ends.callback(hostile.wait)
        ends.callback(hostile.kill)
        bus = ends.enter_context(Bus(client_config([scene.endpoint])))
        assert bus.wait_for_peer(ANSWER_S)
        while hostile.poll() is None:
            start_s = time.monotonic()
            answer = ask_again_and_again(bus)
            took_s.append(time.monotonic() - start_s)
            assert decode_json(answer, LeaseReply, "an answer").ok
            assert is_well(scene.url)
            time.sleep(0.05)  # Continuous requests would be part of the flood.
    assert hostile.returncode == 0
    return took_s


def ask_again_and_again(bus: Bus) -> bytes:
    """Retry a request, because under load the oldest are dropped, including valid ones."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return bus.query(Service.LEASE.key(ID), b'{"op": "peek", "operator": "bob"}', 0.5)
        except NoAnswerError:
            assert time.monotonic() < end_s, "the node answers nobody any more"


def is_well(url: str) -> bool:
    """Ask the dashboard whether it sees a robot."""
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=5.0)
    try:
        connection.request("GET", "/healthz")
        return bool(json.load(connection.getresponse())["ready"])
    finally:
        connection.close()


def test_a_hundred_thousand_malformed_samples(
    scene: FaultStage, capsys: pytest.CaptureFixture[str]
) -> None:
    """The wheels spin, so one wrongly accepted command would move the robot."""
    page, observer = scene.page(), scene.observer
    page.get_ready()
    begin_s = time.monotonic()
    flood(scene, 1, WARM_UP)
    ledger, before, dropped = Ledger(scene), observer.status, observer.dropped
    flooded_s = time.monotonic()
    took_s = flood(scene, 2, FLOOD // 2)
    took_s += flood(scene, 4, REQUESTS, "ask")
    observer.until_time(time.monotonic())
    assert observer.status.mode == "ready", observer.status
    took_s += flood(scene, 3, FLOOD // 2, "stop")
    observer.until(lambda: observer.status.mode == "stopped", "a stop, which anybody may send")
    flooded_s = time.monotonic() - flooded_s
    observer.until_time(time.monotonic())
    assert all(speed == 0.0 for at_s, _, speed in observer.truth if at_s > begin_s)
    new = {name: count - dropped[name] for name, count in observer.dropped.items()}
    overruns = observer.status.loop.overruns - before.loop.overruns
    with capsys.disabled():
        sys.stdout.write(
            f"\nbus: {FLOOD / flooded_s:.0f} a second, answers p100 {1000 * max(took_s):.0f} ms, "
            f"overruns {overruns}, MB {ledger.check()}, dropped {new}\n"
        )
    assert all(new[reason] > 0 for reason in ("key", "shape", "nonfinite", "lease")), new
    assert scene.mock.process.poll() is None
    assert scene.dashboard.process.poll() is None


def teleop_garbage(dice: random.Random) -> str | bytes:
    """Return invalid or unauthorized messages for the teleop socket."""
    number = dice.choice(["NaN", "1e999", "-1e308", '"1"', "null", "[]", "0.5"])
    return dice.choice(
        [
            dice.randbytes(dice.randrange(300)),
            dice.randbytes(30).hex(),
            "",
            "{}",
            "[" * 2000,
            '{"t": "drive"}',
            f'{{"t": "drive", "vx": {number}, "vy": 0, "omega": 0, "status_seq": 0}}',
            f'{{"t": "heartbeat", "status_seq": {number}, "sent_ms": "{number}"}}',
            f'{{"t": "lease", "op": {number}}}',
            '{"t": "lease", "op": "acquire"}',
            '{"t": "arm"}',
            '{"t": "reset"}',
            '{"t": "robot", "id": "nobody"}',
            '{"t": "robot", "id": "' + "x" * 1000 + '"}',
        ]
    )


def bombard_teleop(url: str, count: int) -> int:
    """Send garbage to the teleop socket, and return the number of replies.

    Occasional heartbeats and their echoes show that earlier messages have been read.
    """
    dice = random.Random(count)  # noqa: S311  Garbage that can be sent again is what is wanted.
    answers = sent = 0
    while sent < count:
        with dial(url, "teleop?page=") as socket:
            for beat in range(1, 1 + ROUND // ECHO_EVERY):
                for _ in range(ECHO_EVERY):
                    socket.send(teleop_garbage(dice))
                socket.send(f'{{"t": "heartbeat", "status_seq": 0, "sent_ms": {beat}}}')
                answers += until_echo(socket, beat)
            sent += ROUND
            socket.send("x" * (1 << 14) + "x")  # More than any message of a page.
            until_closed(socket)
    return answers


def until_echo(socket: ClientConnection, beat: int) -> int:
    """Return the number of replies before the echo of a heartbeat."""
    answers = 0
    while True:
        message = json.loads(socket.recv(timeout=PATIENCE_S))
        answers += message["t"] == "reply" and not message["ok"]
        if message["t"] == "heartbeat" and message["sent_ms"] == beat:
            return answers


def until_closed(socket: ClientConnection) -> None:
    """Wait until the other side closes the connection."""
    with contextlib.suppress(ConnectionClosed):
        while True:
            socket.recv(timeout=PATIENCE_S)  # Raises TimeoutError otherwise.


def viser_garbage(dice: random.Random) -> bytes:
    """Return a well-formed viser message about objects that do not exist."""
    wild = dice.choice([float("nan"), -1e308, None, "x" * 500, [], {}])
    kinds = [
        {"type": "GuiUpdateMessage", "uuid": "nobody", "updates": {"value": wild}},
        {"type": "ShareUrlRequest"},
        {"type": "ShareUrlDisconnect"},
        CAMERA | {"position": [float("nan")] * 3, "fov": float("inf")},
    ]
    return msgspec.msgpack.encode(dice.choice(kinds))


def bombard_viser(url: str, count: int) -> None:
    """Send garbage to the scene; undecodable data ends only that connection."""
    dice = random.Random(count)  # noqa: S311  As above.
    for _ in range(count // ROUND):
        with dial(url, "viser/") as socket:
            for _ in range(ROUND - 1):
                socket.send(viser_garbage(dice))
            unreadable = [dice.randbytes(200), "text", b"", b"\x81\xa4type\xa3Foo", b"\x91" * 3000]
            socket.send(dice.choice(unreadable))
            until_closed(socket)


def dial(url: str, where: str) -> ClientConnection:
    """Open one of the two sockets of a page."""
    viser = where.startswith("viser")
    return connect(
        url.replace("http://", "ws://") + where + secrets.token_hex(8),
        subprotocols=[Subprotocol("viser-v1.1.1")] if viser else None,
        compression=None,
        max_size=None,
    )


def test_ten_thousand_messages_that_are_none(
    scene: FaultStage, capsys: pytest.CaptureFixture[str]
) -> None:
    """On both sockets of a page, while another operator controls a ready robot."""
    page, observer = scene.page(), scene.observer
    page.get_ready()
    bombard_teleop(scene.url, MESSAGES // 5)
    bombard_viser(scene.url, MESSAGES // 5)
    ledger, begin_s = Ledger(scene), time.monotonic()
    answers = bombard_teleop(scene.url, MESSAGES)
    bombard_viser(scene.url, MESSAGES)
    took_s = time.monotonic() - begin_s
    observer.until_time(time.monotonic())
    assert all(speed == 0.0 for at_s, _, speed in observer.truth if at_s > begin_s)
    assert observer.status.mode == "ready"
    with capsys.disabled():
        sys.stdout.write(
            f"\nsockets: {2 * MESSAGES / took_s:.0f} a second, {answers} refusals, "
            f"MB {ledger.check()}\n"
        )
    assert answers > 0
    assert is_well(scene.url)
    page.do("push", 1.0)  # The holder has kept control.
    observer.until_speed()
    page.do("release")
    observer.until_rest()
