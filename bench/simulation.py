"""Benchmark of controller and simulator in virtual time."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import add

import msgspec
import numpy as np

from bench.table import Row
from research.budget import BATCH, ERROR_SOURCES, drive_open_loop
from tsd_twin import SimulatedRobot, robots
from tsd_twin.control import RobotController
from tsd_twin.lab.square import unlimited_trajectory
from tsd_twin.lab.tracking import named_path
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.commands import Sample, encode_attachment
from tsd_twin.messages.topics import Service
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.routes import Route
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.simulation import SimRobot, simulate

PERIOD_S = 0.01
_LEASE = bytes(16)


@dataclass(frozen=True)
class Size:
    """Amount of driving."""

    rounds: int = 10
    steps: int = 600
    batch: int = 2_000
    squares: int = 10_000
    drives: int = 60
    idle_s: float = 120.0
    driven_s: float = 3600.0
    settled_s: float = 60.0
    """Time after which the remaining objects are first counted."""


FULL = Size()
SMALLEST = Size(1, 50, 20, 20, 1, 0.1, 6.0, 2.0)


class BenchRobot:
    """Controller and simulated robot in virtual time, without a bus."""

    def __init__(self) -> None:
        robot = robots.load_robot("tsd")
        self.controller = RobotController(robot, lambda: _LEASE)
        self.io = SimRobot(robot)
        self.now_s = 0.0
        self.seq = 0
        self._serve(Service.LEASE, {"op": "acquire", "operator": "bench"})
        self._serve(Service.ARM, {"lease": _LEASE.hex()})
        while self.controller.supervisor.mode != "ready":
            renewal = {"op": "renew", "operator": "bench", "lease": _LEASE.hex()}
            self._serve(Service.LEASE, renewal)
            self.tick([])
        self.controller.take_events()

    def _serve(self, service: Service, request: Mapping[str, object]) -> None:
        self.controller.serve(service, msgspec.json.encode(request), self.now_s)

    def tick(self, samples: list[Sample]) -> None:
        """Run one control period."""
        self.now_s += PERIOD_S
        setpoint = self.controller.step(self.now_s, self.io.read(self.now_s), samples)
        self.io.write(setpoint, self.now_s)

    def command(self, twist: Array) -> Sample:
        """Return a command that is accepted now."""
        self.seq += 1
        self.controller.record_status_sent(self.seq, self.now_s)
        return Sample(
            "twin/tsd/cmd/bench/twist",
            encode_twist(TwistStamped(BASE, twist)),
            encode_attachment(self.seq, _LEASE, self.seq),
        )


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure a robot, a batch, the core alone, squares, and memory growth."""
    size = SMALLEST if smallest else FULL
    robot = BenchRobot()
    twist = np.array([0.6, 0.1, 0.0, 0.0, 0.0, 0.8])
    rounds = [drive(robot, twist, size.steps) for _ in range(size.rounds)]
    # Use the best round, because noise on a shared machine only adds.
    core_s, all_s = (min(times) for times in zip(*rounds, strict=True))
    share = 100 * core_s / PERIOD_S
    yield Row("core step, share of the period", share, 1.0, "%", "10 ms")
    faster = PERIOD_S / all_s
    yield Row("core and plant, one robot", faster, 60, "x", "real time", at_least=True)
    alone = f"the plant alone {plant_alone(size.drives):.0f} x"
    yield Row("SimulatedRobot, drives of 2 s", driven(size.drives), 80, "x", alone, at_least=True)
    yield Row("SimulatedRobot, idle", idle(size.idle_s), 300, "x", alone, at_least=True)
    yield Row(
        f"core and plant, batch of {size.batch:,}",
        batch(size.batch),
        1000,
        "rob s/s",
        "",
        at_least=True,
    )
    yield Row(
        f"{size.squares:,} open-loop squares, every error", squares(size.squares), 60, "s", ""
    )
    left = growth(robot, twist, size)
    what = f"objects left by {size.driven_s:g} s of driving"
    comparison = f"those after {size.settled_s:g} s"
    yield Row(what, left, 500, "", comparison)


def drive(robot: BenchRobot, twist: Array, steps: int) -> tuple[float, float]:
    """Return the time per period in the core alone, and with the plant, while driving."""
    in_core_s = 0.0
    start = time.perf_counter()
    for step in range(steps):
        samples = [robot.command(twist)] if step % 2 == 0 else []  # 50 Hz, like a page.
        robot.now_s += PERIOD_S
        measured = robot.io.read(robot.now_s)
        before = time.perf_counter()
        setpoint = robot.controller.step(robot.now_s, measured, samples)
        in_core_s += time.perf_counter() - before
        robot.io.write(setpoint, robot.now_s)
    return in_core_s / steps, (time.perf_counter() - start) / steps


_DRIVE_S = 2.0


def twists(drives: int) -> list[list[float]]:
    """Return twists for drives, mostly within the limits."""
    return (
        np.random.default_rng(0).uniform([-0.5, -0.5, -1.5], [0.5, 0.5, 1.5], (drives, 3)).tolist()
    )


def driven(drives: int) -> float:
    """Return the real-time factor of `SimulatedRobot`, in drives of 2 s.

    Measured in CPU time, like `idle` and `plant_alone`, because none of them waits.
    """
    with SimulatedRobot("tsd") as robot, robot.control("bench") as base:
        began_s, start = robot.time_s, time.process_time()
        for vx, vy, omega in twists(drives):
            base.drive(vx_mps=vx, vy_mps=vy, omega_rad_per_s=omega, duration_s=_DRIVE_S)
        return (robot.time_s - began_s) / (time.process_time() - start)


def idle(duration_s: float) -> float:
    """Return the real-time factor of a disarmed `SimulatedRobot`."""
    with SimulatedRobot("tsd") as robot:
        start = time.process_time()
        robot.sleep(duration_s)
        return duration_s / (time.process_time() - start)


def plant_alone(drives: int) -> float:
    """Return the real-time factor of simulated joints that follow twists without a controller."""
    robot = BenchRobot()  # Armed, because its wheels spin.
    simulated, kinematics = robot.io, robot.controller.kinematics
    periods = round(_DRIVE_S / PERIOD_S)
    start = time.process_time()
    for twist in twists(drives):
        setpoint = kinematics.inverse(np.array(twist))
        for _ in range(periods):
            robot.now_s += PERIOD_S
            simulated.read(robot.now_s)
            simulated.write(setpoint, robot.now_s)
    return drives * _DRIVE_S / (time.process_time() - start)


def batch(robots_at_once: int) -> float:
    """Return robot-seconds per second: limits, inverse, plant, forward and pose for all robots."""
    robot = robots.load_robot("tsd")
    drive, limiter = robot.kinematics(), TwistLimiter(robot.kinematics(), robot.limits)
    simulation = simulate(robot, (robots_at_once,))
    request = np.random.default_rng(0).normal(size=(robots_at_once, 3))
    twist, pose = np.zeros_like(request), SE2.identity((robots_at_once,))
    periods = 100
    start = time.perf_counter()
    for _ in range(periods):
        twist = limiter.approach(twist, limiter.cap(request), PERIOD_S)
        simulation.command(drive.inverse(twist))
        simulation.advance(PERIOD_S)
        pose = drive.integrate(pose, drive.forward(simulation.measure()).twist, PERIOD_S)
    return robots_at_once * periods * PERIOD_S / (time.perf_counter() - start)


def squares(runs: int) -> float:
    """Return the duration of `runs` squares, driven like in `python -m research budget`."""
    robot = description_of_kind(robots.load_robot("tsd"), SingularityDescription)
    random = np.random.default_rng(0)
    reference = unlimited_trajectory(Route(named_path("square")))
    errors = reduce(add, (source.draw(robot, random, runs) for source in ERROR_SOURCES))
    start = time.perf_counter()
    for at in range(0, runs, BATCH):
        drive_open_loop(robot, reference, errors.part(slice(at, at + BATCH)))
    return time.perf_counter() - start


def growth(robot: BenchRobot, twist: Array, size: Size) -> int:
    """Return the number of objects that a long drive adds after its first part."""
    early = 0
    for step in range(round(size.driven_s / PERIOD_S)):
        robot.tick([robot.command(twist)] if step % 2 == 0 else [])
        robot.controller.take_events()
        if step == round(size.settled_s / PERIOD_S):
            gc.collect()
            early = sys.getallocatedblocks()
    gc.collect()
    return max(0, sys.getallocatedblocks() - early)
