"""`tsd-ros`: delay of a twist, beside the client library in the same run, and its load."""

from __future__ import annotations

import itertools
import sys
import threading
import time
from collections.abc import Iterator

import psutil

from bench.bus import client_commands, paced, program, watch_setpoint
from bench.table import Row, percentile
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.interop.mapping import PUBLISHED
from tsd_twin.messages.ros import TRIGGER, encode_cdr, make_twist, type_hash
from tsd_twin.messages.topics import QoS
from tsd_twin.ros.wire import Attachment, topic_key

_COMMANDS, _SMALLEST = 600, 20
_PERIOD_S = 0.02
_ALLOWED_SHARE = 15.0
"""Percent of a core, with every topic of one robot subscribed."""
_TWIST = "geometry_msgs/msg/Twist"
_GID = bytes(range(16))


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure with one robot, and one node that subscribes to everything."""
    count = _SMALLEST if smallest else _COMMANDS
    mock = [sys.executable, "-m", "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    with program(mock) as endpoint, Bus(client_config([endpoint])) as bus:
        plain_ms = client_commands(bus, endpoint, count)
    with (
        program(mock) as endpoint,
        Bus(client_config([endpoint])) as bus,
        Bus(node_config(["tcp/127.0.0.1:0"])) as router,
    ):
        flags = ["--connect", endpoint, "--ros-connect", router.endpoints()[0], "--domain", "0"]
        adapter = program([sys.executable, "-m", "tsd_ros", *flags, "--until-eof"])
        with adapter:
            twist_ms, load = ros_commands(bus, router, adapter.process.pid, count)
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        plain = percentile(plain_ms, share)
        yield Row(
            f"cmd_vel from ROS to set-point published, {name}",
            percentile(twist_ms, share),
            plain + 10.0,
            "ms",
            f"client set_velocity {plain:.2f} ms + 10 ms",
        )
    yield Row(
        "tsd-ros, all topics of one robot, cmd_vel at 50 Hz", load, _ALLOWED_SHARE, "%", "of a core"
    )


def ros_commands(bus: Bus, router: Bus, pid: int, count: int) -> tuple[list[float], float]:
    """Return times from a published twist to the set-point that shows it, and processor share."""
    came, shown = watch_setpoint(bus), threading.Event()
    for row in PUBLISHED:
        name = row.name if row.name.startswith("/") else f"/{row.name}"
        router.subscribe(topic_key(0, name, row.type, type_hash(row.type)), lambda _: shown.set())
    assert shown.wait(10.0)
    numbers = itertools.count(1)

    def attachment() -> bytes:
        return Attachment(next(numbers), time.time_ns(), _GID).encode()

    _arm(router, attachment())
    time.sleep(0.6)
    cmd_vel = router.publisher(topic_key(0, "/cmd_vel", _TWIST, type_hash(_TWIST)), QoS.REAL_TIME)
    speeds = itertools.cycle([0.40, 0.42])

    def send() -> None:
        came.clear()
        twist = encode_cdr(make_twist((next(speeds), 0.0, 0.0, 0.0, 0.0, 0.0)))
        cmd_vel.put(twist, attachment())

    for _ in range(25):  # Up to speed first.
        send()
        time.sleep(_PERIOD_S)
    adapter = psutil.Process(pid)
    adapter.cpu_percent()
    times_ms = paced(send, came, count)
    return times_ms, adapter.cpu_percent()


def _arm(router: Bus, attachment: bytes) -> None:
    key = topic_key(0, "/arm", TRIGGER, type_hash(TRIGGER))
    end_s = time.monotonic() + 20.0
    while True:
        answer = router.query(key, b"\0\1\0\0\0", 15.0, attachment)
        if answer[4]:
            return
        assert time.monotonic() < end_s, answer
