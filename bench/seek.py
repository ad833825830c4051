"""Seeking in a recording of a quarter of an hour, compared with the mcap library, and memory."""

from __future__ import annotations

import itertools
import secrets
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil
from mcap.reader import make_reader
from websockets.sync.client import connect

from bench.programs import dashboard, mock
from bench.table import Row, Run, quantiles
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
_PAGES = 5
_BETWEEN_S = 0.05
"""Seek period of a page while its cursor is dragged."""
_PATIENCE_S = 30.0


def rows(run: Run) -> Iterator[Row]:
    """Measure random seeks in a file written by the recorder's writer, in virtual time."""
    seconds, seeks = int(run.pick(900, 20)), int(run.pick(20, 10))
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder) / "long.mcap"
        write(path, seconds)
        yield from run.alternate(
            ["seek.open"], lambda: [_open_ms(path)], lambda: [_summary_ms(path)]
        )
        random, player = np.random.default_rng(1), Player(path)
        stack.callback(player.close)

        def times_s() -> list[float]:
            return random.uniform(1.0, seconds - 1.0, size=seeks).round(3).tolist()

        def seek_all() -> tuple[float, float]:
            return quantiles([_elapsed_ms(partial(player.seek, t_s)) for t_s in times_s()])

        def read_all() -> tuple[float, float]:
            return quantiles([_elapsed_ms(partial(_read, path, t_s)) for t_s in times_s()])

        yield from run.alternate(["seek.player_p50", "seek.player_p90"], seek_all, read_all)
        if run.wants("seek.memory"):
            yield _memory("seek.memory", psutil.Process(), seek_all)
        if run.wants("seek.page_p50", "seek.page_p90", "seek.page_memory"):
            served = dashboard(stack.enter_context(mock()), "--record-dir", folder)
            url = stack.enter_context(served)
            pages = [RecordedPage(url, stack) for _ in range(_PAGES)]

            def seek_page() -> tuple[float, float]:
                return quantiles([pages[0].seek_ms(t_s) for t_s in times_s()])

            def seek_pages() -> None:
                for number, t_s in enumerate(times_s()):
                    pages[number % len(pages)].seek_ms(t_s)

            yield from run.alternate(
                ["seek.page_p50", "seek.page_p90"], seek_page, seek_all, rounds=3
            )
            if run.wants("seek.page_memory"):
                yield _memory("seek.page_memory", psutil.Process(served.process.pid), seek_pages)


def _memory(name: str, process: psutil.Process, seek: Callable[[], object]) -> Row:
    """Compare the memory after many seeks with that after the first ones, which fill caches."""
    sizes_mb: list[float] = []
    for repeats in (2, 4):
        for _ in range(repeats):
            seek()
        sizes_mb.append(1e-6 * process.memory_info().rss)
    return Row(name, sizes_mb[1:], sizes_mb[:1])


def _open_ms(path: Path) -> float:
    def call() -> None:
        Player(path).close()

    return _elapsed_ms(call)


def _summary_ms(path: Path) -> float:
    """Return the time in which the mcap library reads the summary."""

    def call() -> None:
        with path.open("rb") as file:
            make_reader(file).get_summary()

    return _elapsed_ms(call)


def _read(path: Path, t_s: float) -> None:
    """Read the messages of the last flush before a time with the mcap library."""
    end_ns = START_NS + round(1e9 * t_s)
    with path.open("rb") as file:
        for _ in make_reader(file).iter_messages(
            start_time=end_ns - _CHUNK * _PERIOD_NS, end_time=end_ns
        ):
            pass


def _elapsed_ms(call: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    call()
    return 1000.0 * (time.perf_counter() - start_s)


class RecordedPage:
    """Page that shows the recording, without a browser."""

    def __init__(self, url: str, stack: ExitStack) -> None:
        address = f"{url.replace('http://', 'ws://')}teleop?recording=long.mcap&page="
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
