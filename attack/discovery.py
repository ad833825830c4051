"""Attacks on discovery: forged robots, descriptions, key patterns, duplicate ids, links and
clocks."""

# Some types of zenoh are incomplete.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import zenoh

from attack.live import (
    ForgedRobots,
    behind,
    dashboard,
    mock,
    operator,
    program,
    seconds_until,
    shown,
    threads_of,
)
from attack.table import Row
from tests.support.bus_operator import BusOperator
from tests.support.page_client import Page
from tests.support.programs import Program
from tests.support.robot_node import ANY_PORT, QUICK
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.errors import NoAnswerError
from tsd_twin.messages.events import duplicate_id_text
from tsd_twin.messages.topics import Service

MANY = 1000
PATTERNS = ("**", "twin/**", "twin/tsd/*", "twin/*/stop", "twin/tsd/srv/*", "twin/t$*/stop")
PAGE = "0123456789abcdef"
CLOCKS = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <time.h>
int clock_gettime(clockid_t id, struct timespec *t)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int failed = real(id, t);
    if (!failed && id == CLOCK_REALTIME) {
        struct timespec now;
        real(CLOCK_MONOTONIC, &now);
        long turn = (now.tv_sec / 2) % 3;
        t->tv_sec += turn == 0 ? 0 : turn == 1 ? 3 * 3600 : -3 * 3600;
    }
    return failed;
}
"""
"""Library for a wall clock that jumps by three or six hours every other second."""


def rows() -> Iterator[Row]:
    """Yield one row per attack."""
    with ThreadPoolExecutor(1) as aside:  # This part mostly waits for its link.
        far = aside.submit(_far)
        yield from _at_a_dashboard()
        yield _living()
        with mock() as robot:
            yield from _patterns(robot.endpoint)
            yield from _sessions(robot.endpoint)
        yield far.result()
    yield from _duplicate_ids()
    yield from _clocks()


def _at_a_dashboard() -> Iterator[Row]:
    with mock() as robot, dashboard(robot.endpoint) as (board, port):
        seconds_until(lambda: "tsd" in shown(port))
        with Bus(node_config([ANY_PORT], [robot.endpoint])) as bus, ForgedRobots(bus) as hostile:
            yield from _descriptions(hostile, port)
            yield _folder(hostile, port)
            yield from _tokens(hostile, board, port)
        yield _nested_json(port)


def _tokens(hostile: ForgedRobots, board: Program, port: int) -> Iterator[Row]:
    before, threads = shown(port), threads_of(board)
    for i in range(MANY):
        hostile.announce(f"a-{i}", silent=i % 2 == 0)
    time.sleep(1.0)
    now = threads_of(board)
    hostile.describe("late")
    took_s = seconds_until(lambda: "late" in shown(port))
    yield Row(
        f"{MANY} tokens, half of them never answer; then a robot comes",
        "listed within 5 s",
        f"{took_s:.2f} s",
        took_s < 5.0 and shown(port) == before | {"late"},
        size=took_s,
    )
    yield Row(
        f"{MANY} tokens: threads of the dashboard",
        "at most 5 more",
        f"{threads} before, {now} then",
        now <= threads + 5,
        size=now - threads,
    )


def _descriptions(hostile: ForgedRobots, port: int) -> Iterator[Row]:
    bad = {
        "deep": ("a=" + "[" * 10_000, "lists 10,000 deep"),
        "long": (QUICK + "#" * 100_000, "100,000 characters too many"),
        "digits": ("a=" + "9" * 5000, "a number of 5,000 digits"),
    }
    for name, (toml, what) in bad.items():
        hostile.describe(name, toml)
        time.sleep(0.2)
        hostile.describe(f"after-{name}")
        took_s = seconds_until(lambda name=name: f"after-{name}" in shown(port))
        yield Row(
            f"a description with {what}; then a robot comes",
            "listed within 2 s",
            f"{took_s:.2f} s",
            took_s < 2.0 and name not in shown(port),
            size=took_s,
        )


def _folder(hostile: ForgedRobots, port: int) -> Row:
    """Set `body.meshes` to a pipe, which shows whether it was opened."""
    with tempfile.TemporaryDirectory() as folder:
        pipe = Path(folder, "parts.json")
        os.mkfifo(pipe)
        text = QUICK.replace("[body]", f'[body]\nmeshes = "{folder}"', 1)
        hostile.describe("folder", text.replace('title = "', 'title = "x', 1))
        listed_s = seconds_until(lambda: "folder" in shown(port))
        opened = False
        end_s = time.monotonic() + 3.0
        while time.monotonic() < end_s and not opened:
            with suppress(OSError):  # The pipe has no reader.
                os.close(os.open(pipe, os.O_WRONLY | os.O_NONBLOCK))
                opened = True
            time.sleep(0.01)
    return Row(
        "a description names a folder of the dashboard's machine",
        "no file of it is opened",
        "opened" if opened else "not opened",
        not opened and listed_s < 5.0,
    )


def _nested_json(port: int) -> Row:
    page = Page(port, PAGE)
    try:
        page.send(t="robot", id="tsd")  # Forged robots precede it in the menu.
        page.until(lambda: page.state)
        for text in ("[" * 8000, '{"t": "drive", "a": ' + '{"a": ' * 2000):
            page.send_raw(text)
        answered = page.answer("stop", t="stop")["ok"]
        closed = page.closed
    finally:
        page.close()
    return Row(
        "a page sends JSON that is nested 8,000 deep, then a stop",
        "socket open, stop answered",
        "answered" if answered and closed is None else f"closed with {closed}",
        answered and closed is None,
    )


def _living() -> Row:
    with Bus(node_config([ANY_PORT])) as bus:
        for i in range(400):
            bus.declare_token(f"twin/t{i}/alive")
        found: list[str] = []
        asking = threading.Thread(
            target=lambda: found.extend(bus.living_tokens("twin/*/alive")), daemon=True
        )
        start_s = time.monotonic()
        asking.start()
        asking.join(10.0)
        took_s = time.monotonic() - start_s
        ended = not asking.is_alive()
    return Row(
        "a router asks who lives, with 400 tokens of its own",
        "400 found, within 1 s",
        f"{len(found)} in {took_s:.2f} s",
        ended and len(set(found)) == 400 and took_s < 1.0,
        size=took_s,
    )


def _patterns(endpoint: str) -> Iterator[Row]:
    with operator(behind(endpoint)) as alice, Bus(client_config([endpoint])) as eve:
        eve.wait_for_peer(5.0)
        for pattern in PATTERNS:
            for payload in (b"", b'{"reason": "x"}'):
                with suppress(NoAnswerError):
                    eve.query(pattern, payload)
        alice.wait_for_news()
        yield Row(
            f"queries to {len(PATTERNS)} patterns, with and without payload",
            "no stop",
            f"mode {alice.status.mode}",
            alice.status.mode == "ready",
        )
        eve.query(Service.STOP.key("tsd"), b"")
        stopped_s = seconds_until(lambda: alice.status.mode == "stopped")
        yield Row(
            "an empty query to exactly the key of the stop",
            "stops within 0.2 s",
            f"{stopped_s:.2f} s",
            stopped_s < 0.2,
            size=stopped_s,
        )
        _reset(alice)


def _reset(pilot: BusOperator) -> None:
    """Reset and arm after a stop, then release the lease."""
    pilot.drive((0.0, 0.0, 0.0), 0.6)
    pilot.ask(Service.RESET, lease=pilot.lease)
    pilot.ask(Service.LEASE, op="release", operator=pilot.name, lease=pilot.lease)


def _raw(endpoint: str, zid: str = "") -> zenoh.Session:
    config = zenoh.Config.from_json5('{mode: "client", connect: {timeout_ms: 200}}')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    if zid:
        config.insert_json5("id", f'"{zid}"')
    return zenoh.open(config)


def _close(session: zenoh.Session) -> None:
    session.close()


def _sessions(endpoint: str) -> Iterator[Row]:
    with operator(behind(endpoint)) as alice, ExitStack() as stack:
        driving, stop = _keep_driving(alice)
        accepted = alice.status.command.accepted
        start_s = time.monotonic()
        opened = refused = 0
        for _ in range(80):
            try:
                stack.callback(_close, _raw(endpoint))
                opened += 1
            except zenoh.ZError:
                refused += 1
        took_s = time.monotonic() - start_s
        counted = (alice.status.command.accepted - accepted) / took_s
        kept = alice.status.mode == "driving" and alice.status.stops == 0
        yield Row(
            "80 sessions at once while an operator drives in a circle",
            "drives on",
            f"{opened} open, {refused} not; {counted:.0f} Hz",
            kept and counted > 25.0,
            size=-counted,
        )
        stack.close()
        first = _raw(endpoint, "abcdef01")
        second: zenoh.Session | None = None
        with suppress(zenoh.ZError):
            second = _raw(endpoint, "abcdef01")
        time.sleep(0.5)
        heard = list(first.get(Service.DESC.key("tsd"), timeout=1.0))
        yield Row(
            "a second session with a session id that is in use",
            "neither the first nor the operator loses",
            f"second {'in' if second else 'refused'}, first "
            + ("answered" if heard else "not answered"),
            bool(heard) and alice.status.mode == "driving" and alice.status.stops == 0,
        )
        for session in (first, second):
            if session is not None:
                session.close()
        stop.set()
        driving.join()
        alice.ask(Service.STOP, operator="alice")
        _reset(alice)


def _keep_driving(pilot: BusOperator, x: float = 0.2) -> tuple[threading.Thread, threading.Event]:
    """Drive in a circle until `stop` is called."""
    stop = threading.Event()

    def drive() -> None:
        while not stop.wait(0.02):
            pilot.send((x, 0.0, 0.5))

    thread = threading.Thread(target=drive)
    thread.start()
    seconds_until(lambda: pilot.status.mode == "driving")
    return thread, stop


def _far() -> Row:
    """Drive over a link with a round trip of 900 ms, and fall silent at the lease's top speed."""
    flags = ("--listen", "tcp/127.0.0.1:0", "--link", "delay=450ms", "--target")
    with mock() as robot, program("tsd_link", *flags, robot.endpoint) as link:
        far = behind(link.ready().split()[-1])
        with BusOperator(far, "far") as pilot, BusOperator(robot, "near") as near:
            granted = pilot.acquire(max_age_s=1.0)
            pilot.ask(Service.ARM, lease=pilot.lease)
            pilot.drive((0.0, 0.0, 0.0), until=lambda: pilot.status.mode == "ready")
            pilot.drive((1.0, 0.0, 0.0), 4.0)
            # Commands in flight still arrive, so measure from the last delivered one.
            near.wait_until(lambda: near.status.command.age_s not in (None, 0.0))
            seconds_until(lambda: (near.status.command.age_s or 0.0) > 0.1, 3.0)
            seen = near.status
            x, y, _ = near.truth.xy_heading
            seconds_until(lambda: near.status.mode == "ready", 5.0)
            seconds_until(lambda: bool(np.abs(near.truth.twist).max() < 1e-3), 3.0)
            end_x, end_y, _ = near.truth.xy_heading
            way_m = float(np.hypot(end_x - x, end_y - y)) + 0.1 * seen.limits.speed_mps
            drops = near.status.command.dropped
    return Row(
        "drive over 900 ms there and back, lease of 1.0 s, then silence",
        "drives, and stands within 0.35 m",
        f"{float(np.hypot(x, y)):.2f} m, then {way_m:.2f} m; {drops.stale} stale",
        bool(granted["granted"]) and float(np.hypot(x, y)) > 0.2 and way_m <= 0.35,
        size=way_m,
    )


def _duplicate_ids() -> Iterator[Row]:
    words = duplicate_id_text("tsd")
    with mock() as one, mock() as two, operator(two, "bob") as bob, operator(one) as alice:
        driving, stop = _keep_driving(alice)
        start_s = time.monotonic()
        with Bus(node_config([ANY_PORT], [one.endpoint, two.endpoint])):
            alice.wait_for("fault")
            bob.wait_for("fault")
            took_s = time.monotonic() - start_s
            reasons = {alice.status.stop_reason, bob.status.stop_reason}
            with dashboard(one.endpoint) as (_, port):
                page = Page(port, PAGE)
                page.until(lambda: page.state)
                time.sleep(2.0)
                states = {
                    (s["status"]["mode"], s["status"]["stop_reason"]) for s in page.all("state")
                }
                page.close()
        stop.set()
        driving.join()
    yield Row(
        "two robots with one id; their networks are joined later",
        "both stop and say why, within 2 s",
        f"{took_s:.2f} s",
        took_s < 2.0 and reasons == {words},
        size=took_s,
    )
    yield Row(
        "the page of a dashboard beside them, for 2 s",
        "one mode, one reason",
        f"{len(states)}: {', '.join(sorted(mode for mode, _ in states))}",
        states == {("fault", words)},
    )


def _clocks() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "clocks.c"), Path(folder, "clocks.so")
        source.write_text(CLOCKS, "ascii")
        compiler = shutil.which("cc") or "cc"
        subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
        with (
            mock(preload=str(library)) as robot,
            dashboard(robot.endpoint, str(library)) as (_, port),
            BusOperator(robot, "watcher") as watcher,
        ):
            page = Page(port, PAGE)
            try:
                page.make_ready()
                time.sleep(2.0)
                moved_m = float(np.hypot(*watcher.truth.xy_heading[:2]))
                page.drive(0.1)
                accepted, start_s = watcher.status.command.accepted, time.monotonic()
                time.sleep(7.0)
                rate = (watcher.status.command.accepted - accepted) / (time.monotonic() - start_s)
                status = watcher.status
            finally:
                page.close()
    dropped = status.command.dropped
    yield Row(
        "wall clocks of robot and dashboard jump by hours, robot armed",
        "does not move",
        f"{1000.0 * moved_m:.0f} mm",
        moved_m < 0.005,
        size=moved_m,
    )
    yield Row(
        "the same while driving for 7 s",
        "drives on, no command dropped",
        f"{rate:.0f} Hz, {dropped.stale} stale, {status.stops} stops",
        rate > 25.0 and dropped.stale == 0 and status.stops == 0 and status.mode == "driving",
    )
