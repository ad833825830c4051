"""`tsd-ros`, compared with a bare forwarder between two Zenoh sessions."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

from bench.adapters import Send, adapter_rows, robots
from bench.programs import peer, tool
from bench.table import Row, Run
from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.zenoh_port import encode_attachment, topic_key
from tsd_twin.adapters.ros_topics import PUBLISHED
from tsd_twin.bus import Bus, node_config
from tsd_twin.messages.ros_types import TRIGGER, encode_cdr, make_twist, type_hash
from tsd_twin.messages.topics import QoS

_TWIST = "geometry_msgs/msg/Twist"
_GID = bytes(range(16))
_numbers = itertools.count(1)


def rows(run: Run) -> Iterator[Row]:
    """Measure with one robot and a node that subscribes to everything, in domains 0 and 1."""
    with ExitStack() as stack:
        endpoint, bare_endpoint, buses = robots(stack)
        router = stack.enter_context(Bus(node_config(["tcp/127.0.0.1:0"])))
        address = router.endpoints()[0]
        flags = ["--connect", endpoint, "--ros-connect", address, "--domain", "0"]
        adapter, bare = tool("tsd_ros", *flags), peer("ros", bare_endpoint, address)
        stack.enter_context(adapter)
        stack.enter_context(bare)
        _subscribe_to_all(router)
        _arm(router)
        time.sleep(0.6)
        yield from adapter_rows(
            run, "ros", buses, (adapter, _publisher(router, 0)), (bare, _publisher(router, 1))
        )


def _publisher(router: Bus, domain: int) -> Send:
    key = topic_key(domain, "/cmd_vel", _TWIST, type_hash(_TWIST))
    cmd_vel = router.publisher(key, QoS.REAL_TIME)

    def send(vx_mps: float) -> None:
        cmd_vel.put(encode_cdr(make_twist((vx_mps, 0.0, 0.0, 0.0, 0.0, 0.0))), _attachment())

    return send


def _subscribe_to_all(router: Bus) -> None:
    shown = threading.Event()
    for row in PUBLISHED:
        name = row.name if row.name.startswith("/") else f"/{row.name}"
        router.subscribe(topic_key(0, name, row.type, type_hash(row.type)), lambda _: shown.set())
    router.subscribe("1/twin/**", lambda _: None)
    if not shown.wait(10.0):
        raise RuntimeError("tsd-ros publishes no topic")


def _attachment() -> bytes:
    return encode_attachment(Origin(_GID, next(_numbers), time.time_ns()))


def _arm(router: Bus) -> None:
    key = topic_key(0, "/arm", TRIGGER, type_hash(TRIGGER))
    end_s = time.monotonic() + 20.0
    while True:
        answer = router.query(key, b"\0\1\0\0\0", 15.0, _attachment())
        if answer[4]:
            return
        if time.monotonic() > end_s:
            raise RuntimeError(f"the robot cannot be armed: {answer!r}")
