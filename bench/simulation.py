"""Benchmark of controller and simulator in virtual time."""

from __future__ import annotations

import gc
import math
import statistics
import sys
import time
from collections.abc import Iterator, Mapping
from functools import reduce
from operator import add

import msgspec
import numpy as np

from bench.table import Row, Run
from research.budget import BATCH, ERROR_SOURCES, STEP_S, drive_open_loop
from tsd_twin import SimulatedRobot, robots
from tsd_twin.control import RobotController
from tsd_twin.lab.square import unlimited_trajectory
from tsd_twin.lab.tracking import named_path
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.routes import Route
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.simulation import SimRobot, simulate

PERIOD_S = 0.01
_LEASE = bytes(16)
_PERIODS = 100
_AROUND = np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False)
_TWISTS = np.zeros((len(_AROUND), 6))
"""Twists of a drive whose direction always turns: joints that rest cost a plant almost nothing."""
_TWISTS[:, 0], _TWISTS[:, 1], _TWISTS[:, 5] = 0.6 * np.cos(_AROUND), 0.6 * np.sin(_AROUND), 0.8


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


def rows(run: Run) -> Iterator[Row]:
    """Measure a robot, a batch, squares and memory growth, all in CPU time."""
    plant, robot = Plant(), BenchRobot()
    steps, drives = int(run.pick(2000, 50)), int(run.pick(20, 1))
    plant(200)  # Warm up.
    drive(robot, 200)
    yield from run.alternate(
        ["simulation.step"], lambda: [drive(robot, steps)], lambda: [1e3 * PERIOD_S * plant(steps)]
    )
    yield from run.alternate(
        ["simulation.drive"],
        lambda: [driven(drives)],
        lambda: [statistics.mean(plant(200, twist) for twist in twists(drives))],
    )
    still = np.zeros(3)
    plant(200, still)
    yield from run.alternate(
        ["simulation.idle"],
        lambda: [idle(2.0 * drives)],
        lambda: [plant(200 * drives, still)],
    )
    count = int(run.pick(2000, 20))

    def plants() -> list[float]:
        return [batch_plant(count)]

    yield from run.alternate(["simulation.batch"], lambda: [batch(count)], plants)
    yield from run.alternate(["simulation.squares"], lambda: [squares(count)], plants)
    if run.wants("simulation.growth"):
        early, late = objects(robot, run.pick(60.0, 2.0), run.pick(600.0, 6.0))
        yield Row("simulation.growth", [late], [early], note="count; independent of the load")


class Plant:
    """Simulated joints that follow a setpoint without a controller."""

    def __init__(self) -> None:
        robot = BenchRobot()  # Armed, because its wheels spin.
        self._joints, self._now_s = robot.io, robot.now_s
        self._kinematics = robot.controller.kinematics

    def __call__(self, periods: int, twist: Array | None = None) -> float:
        """Return the CPU time per simulated time, ms/s; without a twist, of `_TWISTS`."""
        twists = _TWISTS[:, [0, 1, 5]] if twist is None else twist[None]
        setpoints = [self._kinematics.inverse(each) for each in twists]
        start_s = time.thread_time()
        for period in range(periods):
            self._now_s += PERIOD_S
            self._joints.read(self._now_s)
            self._joints.write(setpoints[period // 2 % len(setpoints)], self._now_s)
        return 1e3 * (time.thread_time() - start_s) / (periods * PERIOD_S)


def drive(robot: BenchRobot, steps: int) -> float:
    """Return the time of a period of controller and plant while driving, us."""
    start_s = time.thread_time()
    for step in range(steps):
        twist = _TWISTS[step // 2 % len(_TWISTS)]
        robot.tick([robot.command(twist)] if step % 2 == 0 else [])  # 50 Hz, like a page.
        robot.controller.take_events()
    return 1e6 * (time.thread_time() - start_s) / steps


def twists(drives: int) -> Array:
    """Return twists for drives, mostly within the limits."""
    return np.random.default_rng(0).uniform([-0.5, -0.5, -1.5], [0.5, 0.5, 1.5], (drives, 3))


def driven(drives: int) -> float:
    """Return the CPU time of `SimulatedRobot` in drives of 2 s, ms per simulated second."""
    with SimulatedRobot("tsd") as robot, robot.control("bench") as base:
        began_s, start_s = robot.time_s, time.process_time()
        for vx, vy, omega in twists(drives).tolist():
            base.drive(vx_mps=vx, vy_mps=vy, omega_rad_per_s=omega, duration_s=2.0)
        return 1e3 * (time.process_time() - start_s) / (robot.time_s - began_s)


def idle(duration_s: float) -> float:
    """Return the CPU time of a disarmed `SimulatedRobot`, ms per simulated second."""
    with SimulatedRobot("tsd") as robot:
        start_s = time.process_time()
        robot.sleep(duration_s)
        return 1e3 * (time.process_time() - start_s) / duration_s


def batch(count: int) -> float:
    """Return the time of a period of many robots with limits, plant and odometry, us per robot."""
    robot = robots.load_robot("tsd")
    drive, limiter = robot.kinematics(), TwistLimiter(robot.kinematics(), robot.limits)
    simulation = simulate(robot, (count,))
    request = np.random.default_rng(0).normal(size=(count, 3))
    twist, pose = np.zeros_like(request), SE2.identity((count,))
    start_s = time.thread_time()
    for _ in range(_PERIODS):
        twist = limiter.approach(twist, limiter.cap(request), PERIOD_S)
        simulation.command(drive.inverse(twist))
        simulation.advance(PERIOD_S)
        pose = drive.integrate(pose, drive.forward(simulation.measure()).twist, PERIOD_S)
    return 1e6 * (time.thread_time() - start_s) / (count * _PERIODS)


def batch_plant(count: int) -> float:
    """Return the time of a period of the same plant alone, us per robot."""
    robot = robots.load_robot("tsd")
    simulation = simulate(robot, (count,))
    setpoint = robot.kinematics().inverse(np.random.default_rng(0).normal(size=(count, 3)))
    start_s = time.thread_time()
    for _ in range(_PERIODS):
        simulation.command(setpoint)
        simulation.advance(PERIOD_S)
        simulation.measure()
    return 1e6 * (time.thread_time() - start_s) / (count * _PERIODS)


def squares(runs: int) -> float:
    """Return the time of a period in squares as in `python -m research budget`, us per robot."""
    robot = description_of_kind(robots.load_robot("tsd"), SingularityDescription)
    reference = unlimited_trajectory(Route(named_path("square")))
    random = np.random.default_rng(0)
    errors = reduce(add, (source.draw(robot, random, runs) for source in ERROR_SOURCES))
    start_s = time.thread_time()
    for at in range(0, runs, BATCH):
        drive_open_loop(robot, reference, errors.part(slice(at, at + BATCH)))
    return 1e6 * (time.thread_time() - start_s) / (runs * reference.duration_s / STEP_S)


def objects(robot: BenchRobot, settled_s: float, driven_s: float) -> tuple[int, int]:
    """Return the numbers of allocated objects after the first part and the whole of a drive."""
    counts: list[int] = []
    for duration_s in (settled_s, driven_s - settled_s):
        drive(robot, round(duration_s / PERIOD_S))
        gc.collect()
        counts.append(sys.getallocatedblocks())
    return counts[0], counts[1]
