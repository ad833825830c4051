"""`tsd-ros`: latency of a twist, compared with the client library, and CPU load."""

from __future__ import annotations

import itertools
import sys
import threading
import time
from collections.abc import Iterator

import psutil

from bench.bus import adapter_rows, client_commands, paced_speeds, program, watch_setpoint
from bench.table import Row
from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.zenoh_port import encode_attachment, topic_key
from tsd_twin.adapters.ros_messages import PUBLISHED
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.messages.ros_types import TRIGGER, encode_cdr, make_twist, type_hash
from tsd_twin.messages.topics import QoS

_COMMANDS, _SMALLEST = 600, 20
_TWIST = "geometry_msgs/msg/Twist"
_GID = bytes(range(16))


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure with one robot and a node that subscribes to everything."""
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
    yield from adapter_rows("tsd-ros", "ROS", plain_ms, twist_ms, load)


def ros_commands(bus: Bus, router: Bus, pid: int, count: int) -> tuple[list[float], float]:
    """Return times from a published twist to the resulting setpoint, and CPU load."""
    came, shown = watch_setpoint(bus), threading.Event()
    for row in PUBLISHED:
        name = row.name if row.name.startswith("/") else f"/{row.name}"
        router.subscribe(topic_key(0, name, row.type, type_hash(row.type)), lambda _: shown.set())
    assert shown.wait(10.0)
    numbers = itertools.count(1)

    def attachment() -> bytes:
        return encode_attachment(Origin(_GID, next(numbers), time.time_ns()))

    _arm(router, attachment())
    time.sleep(0.6)
    cmd_vel = router.publisher(topic_key(0, "/cmd_vel", _TWIST, type_hash(_TWIST)), QoS.REAL_TIME)

    def send(vx_mps: float) -> None:
        twist = encode_cdr(make_twist((vx_mps, 0.0, 0.0, 0.0, 0.0, 0.0)))
        cmd_vel.put(twist, attachment())

    adapter = psutil.Process(pid)
    adapter.cpu_percent()
    times_ms = paced_speeds(send, came, count)
    return times_ms, adapter.cpu_percent()


def _arm(router: Bus, attachment: bytes) -> None:
    key = topic_key(0, "/arm", TRIGGER, type_hash(TRIGGER))
    end_s = time.monotonic() + 20.0
    while True:
        answer = router.query(key, b"\0\1\0\0\0", 15.0, attachment)
        if answer[4]:
            return
        assert time.monotonic() < end_s, answer
