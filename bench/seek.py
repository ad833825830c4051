"""Seeking in a recording of an hour: time until a robot's state is available, and memory."""

from __future__ import annotations

import contextlib
import itertools
import secrets
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil
from websockets.sync.client import connect

from bench.bus import program
from bench.table import Row, percentile
from tsd_twin import robots
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import JointState, Odometry, encode_joints, encode_odometry
from tsd_twin.messages.status import LimitStatus, RobotStatus, encode_status
from tsd_twin.messages.topics import Service
from tsd_twin.recording.channels import CDR, JSON, Entry
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.recording.player import Player

START_NS = 1_700_000_000_000_000_000
_PERIOD_NS = 20_000_000
_CHUNK = 20
"""Periods per chunk, as the recorder flushes."""
_EVENT_EVERY = 1500
_LIMITS = LimitStatus(1.0, 3.0, 0.25)
_SEEKS = 500
_PAGES = 5
_BETWEEN_S = 0.05
"""Seek period of a page while its cursor is dragged."""
_PATIENCE_S = 30.0


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure 500 random seeks in a file written by the recorder's writer, in virtual time."""
    seconds, seeks = (20, 20) if smallest else (3600, _SEEKS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.mcap"
        write(path, seconds)
        start_s = time.perf_counter()
        player = Player(path)
        opened_s = time.perf_counter() - start_s
        events = player.reader.events()
        random, process = np.random.default_rng(1), psutil.Process()
        times_s = random.uniform(0.0, player.duration_s, size=2 * seeks)
        for t_s in times_s[:seeks]:
            player.seek(float(t_s))
        before = process.memory_info().rss
        taken_ms = [_seek_ms(player, float(t_s)) for t_s in times_s[seeks:]]
        grown_mb = (process.memory_info().rss - before) / 1e6
        player.close()
        size_mb = path.stat().st_size / 1e6
        in_page = list(_page_rows(Path(folder), seeks))
    about = f"{size_mb:.0f} MB, {len(events)} events"
    median = f"median {percentile(taken_ms, 0.5):.1f} ms"
    yield Row("seek in an hour, 95th percentile", percentile(taken_ms, 0.95), 100.0, "ms", median)
    yield Row("recording of an hour, opened", 1000.0 * opened_s, 1000.0, "ms", about)
    yield Row("memory after as many seeks again", grown_mb, 10.0, "MB", f"{seeks} seeks")
    yield from in_page


def _page_rows(folder: Path, seeks: int) -> Iterator[Row]:
    """Seek in the sockets of five pages, first in one page and then in turn."""
    run = [sys.executable, "-m"]
    page = [*run, "tsd_dashboard", "--port", "0", "--until-eof", "--record-dir", str(folder)]
    with program([*run, "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]) as endpoint:
        dashboard = program([*page, "--connect", endpoint])
        with dashboard as url, contextlib.ExitStack() as open_pages:
            pages = [RecordedPage(url, open_pages) for _ in range(_PAGES)]
            process, random = psutil.Process(dashboard.process.pid), np.random.default_rng(2)
            times_s = random.uniform(1.0, pages[0].duration_s, size=(3, seeks)).round(3).tolist()
            taken_ms = [pages[0].seek_ms(t_s) for t_s in times_s[0]]
            # In turn as below, so that the caches of all pages are full at the same time.
            for number, t_s in enumerate(times_s[1]):
                pages[number % len(pages)].seek_ms(t_s)
            before = process.memory_info().rss
            for number, t_s in enumerate([*times_s[2], *times_s[0]]):
                pages[number % len(pages)].seek_ms(t_s)
            grown_mb = (process.memory_info().rss - before) / 1e6
            size_mb = process.memory_info().rss / 1e6
    about = f"median {percentile(taken_ms, 0.5):.0f}, worst {max(taken_ms):.0f} ms; {_PAGES} pages"
    what = "seek in an hour to the state in the page's socket, p95"
    yield Row(what, percentile(taken_ms, 0.95), 100.0, "ms", about)
    about = f"{2 * seeks} seeks of {_PAGES} pages; {size_mb:.0f} MB in all"
    yield Row("memory of the dashboard after more seeks", grown_mb, 10.0, "MB", about)


class RecordedPage:
    """Page that shows the recording of an hour, without a browser."""

    def __init__(self, url: str, stack: contextlib.ExitStack) -> None:
        address = f"{url.replace('http://', 'ws://')}teleop?recording=hour.mcap&page="
        self._socket = stack.enter_context(connect(address + secrets.token_hex(8), max_size=None))
        self.duration_s = float(
            self._until(lambda message: message["t"] == "timeline")["duration_s"]
        )

    def seek_ms(self, t_s: float) -> float:
        """Show a time; return the time until its state arrives."""
        start_s = time.perf_counter()
        self._socket.send(msgspec.json.encode({"t": "seek", "t_s": t_s}).decode())
        self._until(lambda message: message["t"] == "cursor" and abs(message["t_s"] - t_s) < 1e-3)
        self._until(lambda message: message["t"] == "state")
        taken_s = time.perf_counter() - start_s
        time.sleep(max(0.0, _BETWEEN_S - taken_s))
        return 1000.0 * taken_s

    def _until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        while True:
            message = msgspec.json.decode(self._socket.recv(timeout=_PATIENCE_S))
            if message["t"] == "state" and message["status_seq"] % 4 == 0:
                beat = {
                    "t": "heartbeat",
                    "status_seq": message["status_seq"],
                    "sent_ms": 0.0,
                    "focus": True,
                }
                self._socket.send(msgspec.json.encode(beat).decode())
            if condition(message):
                return message


def _seek_ms(player: Player, t_s: float) -> float:
    start_s = time.perf_counter()
    player.seek(t_s)
    return 1000.0 * (time.perf_counter() - start_s)


def write(path: Path, seconds: int) -> None:
    """Write a recording of a driving robot, with incompressible noise."""
    text = robots.read_description("tsd")
    joints = [joint.name for joint in robots.parse_description(text, "bench").kinematics().joints]
    file, random = RecordingFile(path), np.random.default_rng(1)
    for topic, value in (
        (topics.alive_key("tsd"), {"alive": True}),
        (Service.DESC.key("tsd"), {"robot": text, "urdf": ""}),
    ):
        file.add(Entry(topic, JSON, "", START_NS, START_NS, 1, msgspec.json.encode(value)))
    numbers = itertools.count(1)
    for period in range(50 * seconds):
        log_ns = START_NS + period * _PERIOD_NS
        for topic, data in _messages(period, log_ns, joints, random):
            kind = (JSON, "") if topic.type == JSON else (CDR, topic.type)
            entry = Entry(topic.key("tsd"), *kind, log_ns, log_ns, next(numbers), data)
            file.add(entry)
        if period % _EVENT_EVERY == 0:
            event = b'{"kind":"mode","text":"From driving to stopping: a test."}'
            file.add(Entry("twin/tsd/event/mode", JSON, "", log_ns, log_ns, period, event))
        if period % _CHUNK == _CHUNK - 1:
            file.flush()
    file.close()


def _messages(
    period: int, log_ns: int, joints: list[str], random: np.random.Generator
) -> Iterator[tuple[topics.Topic, bytes]]:
    noise = random.normal(size=(2, len(joints)))
    angle = 1e-3 * period
    pose = np.array([np.cos(angle), np.sin(angle), angle]) + 1e-3 * noise[0, :3]
    odometry = Odometry(pose, noise[1, :3], np.eye(3), np.eye(3), log_ns)
    for topic in (topics.ODOM, topics.TRUTH):
        yield topic, encode_odometry(odometry)
    for topic in (topics.JOINTS, topics.SETPOINT):
        yield topic, encode_joints(JointState(joints, noise[0], noise[1], log_ns))
    if period % 2 == 0:
        yield topics.STATUS, encode_status(RobotStatus("driving", limits=_LIMITS))
