"""Benchmark of command latency through the node, compared with a bare ping over the same bus."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np

import tsd_twin
from bench.table import Row, percentile
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, TwistStamped, decode_joints, encode_twist
from tsd_twin.messages.commands import Sample, encode_attachment
from tsd_twin.messages.status import decode_stamp
from tsd_twin.messages.topics import QoS, Service

_COMMANDS = 500
_SMALLEST = 20
_PERIOD_S = 0.02
_HALF_CONTROL_PERIOD_MS = 5.0
_ADAPTER_SHARE = 15.0
"""CPU load in percent of a core, with all topics of a robot subscribed."""

_ECHO = """
import sys, threading
from tsd_twin.bus import Bus, node_config
from tsd_twin.messages.topics import QoS
with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
    back = bus.publisher("bench/pong", QoS.REAL_TIME)
    bus.subscribe("bench/ping", lambda sample: back.put(sample.payload))
    print("ready:", bus.endpoints()[0], flush=True)
    sys.stdin.read()
"""


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure at 50 Hz, the rate of a page."""
    count = _SMALLEST if smallest else _COMMANDS
    with program([sys.executable, "-c", _ECHO]) as endpoint, Bus(client_config([endpoint])) as bus:
        ping_ms = pings(bus, count)
    mock = [sys.executable, "-m", "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    with program(mock) as endpoint, Bus(client_config([endpoint])) as bus:
        command_ms = commands(bus, count)
    with program(mock) as endpoint, Bus(client_config([endpoint])) as bus:
        client_ms = client_commands(bus, endpoint, count)
    for name, share, sampling_ms in (
        ("p50", 0.5, _HALF_CONTROL_PERIOD_MS),
        ("p99", 0.99, 2 * _HALF_CONTROL_PERIOD_MS),
    ):
        floor = percentile(ping_ms, share)
        yield Row(
            f"command put to set-point published, {name}",
            percentile(command_ms, share),
            floor + sampling_ms + 1.0,
            "ms",
            f"ping {floor:.2f} ms + {sampling_ms:g} ms of sampling + 1 ms",
        )
        bare = percentile(command_ms, share)
        yield Row(
            f"client set_velocity to set-point published, {name}",
            percentile(client_ms, share),
            bare + 1.0,
            "ms",
            f"bare put {bare:.2f} ms + 1 ms",
        )


def pings(bus: Bus, count: int) -> list[float]:
    """Return round trips of a bare ping, at 50 Hz."""
    came = threading.Event()
    bus.subscribe("bench/pong", lambda _sample: came.set())
    out = bus.publisher("bench/ping", QoS.REAL_TIME)

    def send() -> None:
        came.clear()
        out.put(bytes(100))

    while not came.wait(0.05):
        send()
    return paced(send, came, count)


def commands(bus: Bus, count: int) -> list[float]:
    """Return times from the put of a command to the resulting setpoint, at 50 Hz."""
    robot = "tsd"
    seen_seq, seen_mode = 0, ""
    came = watch_setpoint(bus)

    def on_status(sample: Sample) -> None:
        nonlocal seen_seq, seen_mode
        seen_seq = decode_stamp(sample.attachment)[0]
        seen_mode = json.loads(sample.payload)["mode"]

    bus.subscribe(topics.STATUS.key(robot), on_status)
    until(lambda: seen_seq > 0)
    ask = json.dumps({"op": "acquire", "operator": "bench"}).encode()
    lease = json.loads(bus.query(Service.LEASE.key(robot), ask))["lease"]
    bus.query(Service.ARM.key(robot), json.dumps({"lease": lease}).encode())
    renew = json.dumps({"op": "renew", "operator": "bench", "lease": lease}).encode()
    until(lambda: bool(bus.query(Service.LEASE.key(robot), renew)) and seen_mode == "ready")
    out = bus.publisher(topics.twist_key(robot, "bench"), QoS.REAL_TIME, topics.TWIST.type)
    numbers = itertools.count(1)

    def send(vx_mps: float) -> None:
        twist = np.array([vx_mps, 0.0, 0.0, 0.0, 0.0, 0.0])
        out.put(
            encode_twist(TwistStamped(BASE, twist)),
            encode_attachment(next(numbers), bytes.fromhex(lease), seen_seq),
        )

    return paced_speeds(send, came, count)


def adapter_rows(
    adapter: str, source: str, plain_ms: list[float], twist_ms: list[float], load: float
) -> Iterator[Row]:
    """Return rows for an adapter: latency compared with the client library, and CPU load."""
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        plain = percentile(plain_ms, share)
        yield Row(
            f"cmd_vel from {source} to set-point published, {name}",
            percentile(twist_ms, share),
            plain + 10.0,
            "ms",
            f"client set_velocity {plain:.2f} ms + 10 ms",
        )
    what = f"{adapter}, all topics of one robot, cmd_vel at 50 Hz"
    yield Row(what, load, _ADAPTER_SHARE, "%", "of a core")


def client_commands(bus: Bus, endpoint: str, count: int) -> list[float]:
    """Return times from the client's `set_velocity` to the resulting setpoint, at 50 Hz."""
    came = watch_setpoint(bus)
    with tsd_twin.connect(endpoint) as robot, robot.control("bench") as base:
        return paced_speeds(lambda vx_mps: base.set_velocity(vx_mps=vx_mps), came, count)


def watch_setpoint(bus: Bus) -> threading.Event:
    """Return an event that is set when the setpoint changes; each command changes the speed."""
    came = threading.Event()
    last = [0.0]

    def on_setpoint(sample: Sample) -> None:
        beta = decode_joints(sample.payload).position_rad[4]
        if abs(beta - last[0]) > 1e-9:
            last[0] = beta
            came.set()

    bus.subscribe(topics.SETPOINT.key("tsd"), on_setpoint)
    return came


def paced_speeds(send: Callable[[float], object], came: threading.Event, count: int) -> list[float]:
    """Return the response times to alternating speeds, ms, once the robot is up to speed."""
    # Use small steps that the limiter passes unchanged, so that one setpoint shows each.
    speeds = itertools.cycle([0.40, 0.42])

    def send_next() -> None:
        came.clear()
        send(next(speeds))

    for _ in range(25):
        send_next()
        time.sleep(_PERIOD_S)
    return paced(send_next, came, count)


def paced(send: Callable[[], None], came: threading.Event, count: int) -> list[float]:
    """Return many response times, ms, at 50 Hz with a drifting phase."""
    times_ms: list[float] = []
    random = np.random.default_rng(0)
    for _ in range(count):
        start = time.perf_counter()
        send()
        if came.wait(0.5):
            times_ms.append(1000 * (time.perf_counter() - start))
        left_s = _PERIOD_S - (time.perf_counter() - start) + float(random.uniform(0, 0.005))
        time.sleep(max(left_s, 0.0))
    if len(times_ms) < 0.99 * count:
        raise RuntimeError(f"{count - len(times_ms)} answers never came")
    return times_ms


def until(condition: Callable[[], bool], patience_s: float = 20.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError("waited in vain")
        time.sleep(0.02)


class program:  # noqa: N801  It is used as a function.
    """Process that prints `ready: ... <address>` and ends with its standard input."""

    def __init__(self, command: list[str]) -> None:
        self._command = command

    def __enter__(self) -> str:
        self.process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith("ready:"):
                return line.split()[-1]
        raise RuntimeError(f"{self._command} ended before it was ready")

    def __exit__(self, *_: object) -> None:
        self.process.communicate(timeout=10)
