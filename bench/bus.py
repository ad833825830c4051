"""Latency of commands and stops through the node, compared with a bare Zenoh loop at 100 Hz."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import tsd_twin
from bench import peers
from bench.programs import mock, peer
from bench.table import Row, Run, quantiles
from tests.support.bus_operator import BusOperator
from tests.support.robot_node import behind
from tsd_twin.bus import Bus, client_config
from tsd_twin.client import RobotClient
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_joints
from tsd_twin.messages.topics import QoS, Sample, Service

_PERIOD_S = 0.02
_GOLDEN = 0.618034
Latencies = Callable[[], tuple[float, float]]


def rows(run: Run) -> Iterator[Row]:
    """Measure at 50 Hz, the rate of a page; each value is a median or a 90th percentile."""
    count = int(run.pick(40, 10))
    with ExitStack() as stack:
        endpoint, bare_endpoint = (stack.enter_context(each) for each in (mock(), peer("node")))
        robot, bare = (stack.enter_context(Bus(client_config([each])))
                       for each in (endpoint, bare_endpoint))  # fmt: skip
        echo = bare_echo(bare)
        subjects: dict[str, Latencies] = {
            "put": lambda: quantiles(bus_commands(robot, endpoint, count)),
            "client": lambda: quantiles(client_commands(robot, tsd_twin.connect(endpoint), count)),
        }
        for name, subject in subjects.items():
            names = [f"bus.{name}_p50", f"bus.{name}_p90"]
            yield from run.alternate(names, subject, lambda: quantiles(paced(*echo, count)))
        stop, bare_stop = (_query(*each, count) for each in (
            (robot, Service.STOP.key("tsd"), b'{"reason":"bench"}'), (bare, peers.STOP, b"{}"),
        ))  # fmt: skip
        yield from run.alternate(["bus.stop_p50", "bus.stop_p90"], stop, bare_stop)


def _query(bus: Bus, key: str, payload: bytes, count: int) -> Latencies:
    answered = threading.Event()

    def measure() -> tuple[float, float]:
        return quantiles(paced(lambda: (bus.query(key, payload), answered.set()), answered, count))

    return measure


def bare_echo(bus: Bus) -> tuple[Callable[[], None], threading.Event]:
    """Return a function that sends to a bare peer, and an event for its answer."""
    came = threading.Event()
    bus.subscribe(peers.SETPOINT, lambda _sample: came.set())
    out = bus.publisher(peers.CMD, QoS.REAL_TIME)

    def send() -> None:
        came.clear()
        out.put(bytes(100))

    while not came.wait(0.05):
        send()
    return send, came


def bus_commands(bus: Bus, endpoint: str, count: int) -> list[float]:
    """Return times from a put without the client library to the setpoint, at 50 Hz."""
    came = watch_setpoint(bus)
    with BusOperator(behind(endpoint), "bench") as pilot:
        pilot.get_ready()
        times_ms = paced_speeds(lambda vx_mps: pilot.send((vx_mps, 0.0, 0.0)), came, count)
        pilot.drive((0.0, 0.0, 0.0), 0.4)  # A robot that moves would stop by a fault.
        pilot.ask(Service.DISARM, lease=pilot.lease)
        pilot.ask(Service.LEASE, op="release", operator=pilot.name, lease=pilot.lease)
    return times_ms


def client_commands(bus: Bus, connected: RobotClient, count: int) -> list[float]:
    """Return times from the client's `set_velocity` to the resulting setpoint, at 50 Hz."""
    came = watch_setpoint(bus, connected.id)
    with connected as robot, robot.control() as base:
        return paced_speeds(lambda vx_mps: base.set_velocity(vx_mps=vx_mps), came, count)


def watch_setpoint(bus: Bus, robot_id: str = "tsd") -> threading.Event:
    """Return an event that is set when the setpoint changes; each command changes the speed."""
    came = threading.Event()
    last = [0.0]

    def on_setpoint(sample: Sample) -> None:
        beta = decode_joints(sample.payload).position_rad[4]
        if abs(beta - last[0]) > 1e-9:
            last[0] = beta
            came.set()

    bus.subscribe(topics.SETPOINT.key(robot_id), on_setpoint)
    return came


def paced_speeds(send: Callable[[float], object], came: threading.Event, count: int) -> list[float]:
    """Return the response times to alternating speeds, ms, once the robot is up to speed."""
    # The limiter passes these steps unchanged, and they exceed two servo steps, so that the first
    # set-point after each shows it, in spite of joint rounding.
    speeds = itertools.cycle([0.40, 0.435])
    for _ in range(40):
        send(next(speeds))
        time.sleep(_PERIOD_S)
    return paced(lambda: send(next(speeds)), came, count)


def paced(send: Callable[[], object], came: threading.Event, count: int) -> list[float]:
    """Return many response times, ms, at 50 Hz.

    The phases of the sends in a control period are spread evenly, so that the quantiles do not
    depend on chance.
    """
    times_ms: list[float] = []
    began_s = time.perf_counter()
    for number in range(count):
        phase_s = peers.PERIOD_S * (number * _GOLDEN % 1.0)
        time.sleep(max(0.0, began_s + number * _PERIOD_S + phase_s - time.perf_counter()))
        came.clear()
        start_s = time.perf_counter()
        send()
        if came.wait(0.5):
            times_ms.append(1000 * (time.perf_counter() - start_s))
    if len(times_ms) < 0.9 * count:
        raise RuntimeError(f"{count - len(times_ms)} of {count} answers did not arrive")
    return times_ms
