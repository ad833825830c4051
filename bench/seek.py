"""Seek in a recording of an hour: time to the state of the robot at any time, and memory."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import psutil

from bench.table import Row, percentile
from tsd_twin import robots
from tsd_twin.messages import topics
from tsd_twin.messages.ros import JointState, Odometry, encode_joints, encode_odometry
from tsd_twin.messages.status import Status, encode_status
from tsd_twin.messages.topics import Service
from tsd_twin.recording.channels import CDR, JSON, Entry
from tsd_twin.recording.events import read_events
from tsd_twin.recording.file import RecordingFile
from tsd_twin.recording.player import Player

START_NS = 1_700_000_000_000_000_000
_PERIOD_NS = 20_000_000
_CHUNK = 20
"""Periods in a chunk, as the recorder flushes."""
_EVENT_EVERY = 1500
_SEEKS = 500


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure 500 random seeks in a file written by the recorder's own writer, in virtual time."""
    seconds, seeks = (20, 20) if smallest else (3600, _SEEKS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.mcap"
        write(path, seconds)
        start_s = time.perf_counter()
        player = Player(path)
        opened_s = time.perf_counter() - start_s
        events = read_events(player.index)
        random, process = np.random.default_rng(1), psutil.Process()
        times_s = random.uniform(0.0, player.duration_s, size=2 * seeks)
        for t_s in times_s[:seeks]:
            player.seek(float(t_s))
        before = process.memory_info().rss
        taken_ms = [_seek_ms(player, float(t_s)) for t_s in times_s[seeks:]]
        grown_mb = (process.memory_info().rss - before) / 1e6
        player.close()
        size_mb = path.stat().st_size / 1e6
    about = f"{size_mb:.0f} MB, {len(events)} events"
    median = f"median {percentile(taken_ms, 0.5):.1f} ms"
    yield Row("seek in an hour, 95th percentile", percentile(taken_ms, 0.95), 100.0, "ms", median)
    yield Row("recording of an hour, opened", 1000.0 * opened_s, 1000.0, "ms", about)
    yield Row("memory after as many seeks again", grown_mb, 10.0, "MB", f"{seeks} seeks")


def _seek_ms(player: Player, t_s: float) -> float:
    start_s = time.perf_counter()
    player.seek(t_s)
    return 1000.0 * (time.perf_counter() - start_s)


def write(path: Path, seconds: int) -> None:
    """Write a recording of a robot that drives, with noise that no compression makes small."""
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
        yield topics.STATUS, encode_status(Status("driving"))
