"""Attacks on the two sockets of a page: floods, and messages that viser cannot parse."""

from __future__ import annotations

import contextlib
import json
import random
import re
import secrets
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from attack.table import Row
from tests.support.gateway_requests import PHRASE, cookie_of
from tests.support.page_client import Page
from tests.support.programs import Program
from tests.support.robot_node import ANY_PORT, QUICK
from tests.support.viser_client import CAMERA
from tsd_twin.security import Role
from tsd_twin.security.users import Users

VIEWERS = 10
STOPS = 200
"""Sufficient for a 99th percentile at the third-worst value."""
FLOOD_S = 18.0
DRIVE_S = 4.0
CAMERAS, BURST = 20_000, 250
"""Number of malformed camera messages, and per socket: below the disconnection limit."""
GROWTH_MB = 24.0
"""Allowed growth, within which the allocator's buffers settle."""


@dataclass
class Scene:
    """Processes of a robot and a dashboard with users, and the cookies of logged-in users."""

    dashboard: Program
    port: int

    def cookie(self, name: str) -> str:
        """Log in and return the cookie."""
        return cookie_of(self.port, name)

    @property
    def rss_mb(self) -> float:
        """Memory of the dashboard."""
        return psutil.Process(self.dashboard.process.pid).memory_info().rss / 1e6

    @property
    def stderr_bytes(self) -> int:
        """Size of the dashboard's standard error."""
        return sum(len(line) + 1 for line in self.dashboard.errors)


@contextlib.contextmanager
def scene() -> Generator[Scene]:
    """Start both processes; end them on exit."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        description, file = Path(folder, "quick.toml"), Path(folder, "users.toml")
        description.write_text(QUICK, encoding="utf-8")
        users = Users({})
        for name in ("alice", "bob"):
            users.put(name, Role.OPERATOR, PHRASE, may_stop=False)
        for number in range(VIEWERS):
            users.put(f"guest{number}", Role.VIEWER, PHRASE, may_stop=False)
        users.save(file)
        mock = Program(["tsd_mock", "--listen", ANY_PORT, "--robot", str(description)])
        stack.callback(mock.clean_up)
        (endpoint,) = re.findall(r"tcp/[\d.:]+", mock.ready())
        flags = ("--port", "0", "--connect", endpoint, "--users", str(file))
        dashboard = Program(["tsd_dashboard", *flags])
        stack.callback(dashboard.clean_up)
        (port,) = re.findall(r"http://\S+?:(\d+)", dashboard.ready())
        yield Scene(dashboard, int(port))


def page_of(scene: Scene, name: str) -> Page:
    """Open a page without a browser."""
    return Page(scene.port, secrets.token_hex(8), user=name, cookie=scene.cookie(name))


def rows() -> Generator[Row]:
    """Run the attacks; yield one row each."""
    with scene() as it:
        guests = [it.cookie(f"guest{number}") for number in range(VIEWERS)]
        driver, stopper = page_of(it, "alice"), page_of(it, "bob")
        try:
            yield from flooded(it, driver, stopper, guests)
        finally:
            driver.close()
            stopper.close()
        guests = [it.cookie(f"guest{number}") for number in range(VIEWERS)]  # The old are blocked.
        yield from unreadable(it, guests)


def flooded(scene: Scene, driver: Page, stopper: Page, guests: list[str]) -> Generator[Row]:
    """Drive and stop while ten viewers flood."""
    driver.make_ready()
    stopper.until(lambda: stopper.state)
    calm = drive(driver)
    yield Row("nothing: an operator drives", ">= 95 % count", *share(*calm))
    stderr = scene.stderr_bytes
    rss_mb = scene.rss_mb
    flooder = subprocess.Popen(
        [sys.executable, "-m", "attack.flooder", str(scene.port), str(FLOOD_S), *guests],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert flooder.stdout is not None
    flooder.stdout.readline()
    end_s = time.monotonic() + FLOOD_S
    under = drive(driver)
    yield Row("ten viewers flood, an operator drives", ">= 95 % count", *share(*under))
    took_ms = [1000.0 * stop_s(stopper) for _ in until(end_s, STOPS)]
    p50, p99 = statistics.median(took_ms), sorted(took_ms)[-1 - len(took_ms) // 100]
    most = max(took_ms)
    yield Row(
        "ten viewers flood, STOP by another operator again and again",
        "p99 <= 100 ms",
        f"p50 {p50:.0f}, p99 {p99:.0f}, most {most:.0f} ms of {len(took_ms)}",
        p99 <= 100.0 and len(took_ms) >= STOPS // 2,
        size=p99,
    )
    saw = json.loads(flooder.stdout.read())
    flooder.wait()
    yield Row(
        "ten viewers flood: times cut off, refused",
        "each is cut off",
        f"{saw.get('cut off', 0)}, {saw.get('status 429', 0)}, by {saw['frames']} frames",
        saw.get("cut off", 0) >= VIEWERS,
        size=-saw.get("cut off", 0),
    )
    grown, bytes_said = scene.rss_mb - rss_mb, scene.stderr_bytes - stderr
    yield Row(
        "ten viewers flood: memory and log of the dashboard",
        f"<= {GROWTH_MB:g} MB, 10 kB",
        f"{grown:.1f} MB, {bytes_said} bytes",
        grown <= GROWTH_MB and bytes_said <= 10_000,
        size=grown,
    )


def until(end_s: float, count: int) -> Generator[int]:
    """Count up to `count` or until `end_s`."""
    for number in range(count):
        if time.monotonic() > end_s:
            return
        yield number


def drive(page: Page) -> tuple[int, int]:
    """Hold the stick; return the number of accepted and of due commands."""
    count = len(page.all("state"))
    page.until(lambda: len(page.all("state")) > count)
    before = page.state["status"]["command"]["accepted"]
    begin_s = time.monotonic()
    page.holds = {"vx": 0.1, "vy": 0.0, "omega": 0.5}
    while (held_s := time.monotonic() - begin_s) < DRIVE_S:
        time.sleep(0.05)
        if page.all("released"):  # Like a person: centre the stick and push again.
            page.messages[:] = [m for m in page.messages if m["t"] != "released"]
            page.send(t="release")
    page.holds = None
    page.send(t="release")
    time.sleep(0.5)
    return page.state["status"]["command"]["accepted"] - before, sent(held_s)


def sent(held_s: float) -> int:
    """Return the number of commands a page sends in this time, with slightly late timers."""
    return int(held_s / 0.021)


def share(counted: int, due: int) -> tuple[str, bool, str, float]:
    """Return the last four fields of a row: 95 % of the commands must be accepted."""
    return f"{counted} of {due}", counted >= 0.95 * due, "", -counted / due


def stop_s(page: Page) -> float:
    """Press STOP; return the time until its acknowledgement."""
    before = len(page.all("reply"))
    begin_s = time.monotonic()
    page.send(t="stop")
    page.until(lambda: page.all("reply")[before:])
    took_s = time.monotonic() - begin_s
    time.sleep(0.02)
    return took_s


def malformed(dice: random.Random) -> bytes:
    """Return a random malformed camera message."""
    wild: list[Any] = [
        "x" * dice.randrange(4000),
        [dice.random()] * dice.randrange(4, 400),
        {str(dice.random()): dice.random()},
        [float("nan")] * 3,
        [float("inf"), 0.0, 0.0],
        [str(dice.random())] * 3,
        None,
    ]
    field = dice.choice(["look_at", "position", "up_direction", "wxyz", "fov", "near"])
    if dice.random() < 0.2:
        return msgspec.msgpack.encode(CAMERA | {f"more{dice.random()}": dice.random()})
    return msgspec.msgpack.encode(CAMERA | {field: dice.choice(wild)})


def unreadable(scene: Scene, guests: list[str]) -> Generator[Row]:
    """Send camera messages that viser cannot parse."""
    dice = random.Random(10)  # noqa: S311  Reproducible messages.
    cameras(scene, guests, dice, CAMERAS // 20)
    rss_mb, stderr = scene.rss_mb, scene.stderr_bytes
    cameras(scene, guests, dice, CAMERAS)
    time.sleep(1.0)
    grown, logged = scene.rss_mb - rss_mb, scene.stderr_bytes - stderr
    yield Row(
        f"{CAMERAS} malformed camera messages by viewers",
        f"<= {GROWTH_MB:g} MB, 10 kB",
        f"{grown:.1f} MB, {logged} bytes",
        grown <= GROWTH_MB and logged <= 10_000,
        size=grown,
    )


def cameras(scene: Scene, guests: list[str], dice: random.Random, count: int) -> None:
    """Send `count` malformed messages, on one socket after the other."""
    for number in range(count // BURST):
        with (
            connect(
                f"ws://127.0.0.1:{scene.port}/viser/{secrets.token_hex(8)}",
                additional_headers={"Cookie": guests[number % len(guests)]},
                subprotocols=[Subprotocol("viser-v1.1.1")],
                compression=None,
                max_size=None,
                close_timeout=0.2,
            ) as socket,
            contextlib.suppress(ConnectionClosed),
        ):
            for _ in range(BURST):
                socket.send(malformed(dice))
