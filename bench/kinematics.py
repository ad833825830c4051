"""Benchmark of inverse kinematics, compared with a compiled swerve library called per twist."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from wpimath.geometry import Translation2d
from wpimath.kinematics import ChassisSpeeds, SwerveDrive3Kinematics

from bench.table import Row, Run
from tsd_twin import robots
from tsd_twin.robots import SingularityDescription, description_of_kind

_ROUNDS = 9


def rows(run: Run) -> Iterator[Row]:
    """Measure many twists in a batch, and individual calls."""
    number, calls = (1_000, 20) if run.smallest else (1_000_000, 10_000)
    drive = description_of_kind(robots.load_robot("tsd"), SingularityDescription).kinematics()
    library = SwerveDrive3Kinematics(*[Translation2d(x, y) for x, y in drive.pivots_m])
    twists = np.random.default_rng(0).normal(size=(number, 3))
    one = twists[0]
    vx, vy, omega = (float(v) for v in one)
    drive.inverse(twists)  # Warm up, so that the memory pages of the result exist.

    def peer() -> list[float]:
        return [each_us(lambda: library.toSwerveModuleStates(ChassisSpeeds(vx, vy, omega)), calls)]

    def batch() -> list[float]:
        return [each_us(lambda: drive.inverse(twists), 1) / number]

    def single() -> list[float]:
        return [each_us(lambda: drive.inverse(one), calls)]

    yield from run.alternate(["kinematics.batch"], batch, peer, rounds=_ROUNDS)
    yield from run.alternate(["kinematics.single"], single, peer, rounds=_ROUNDS)


def each_us(call: Callable[[], object], times: int) -> float:
    """Return the CPU time of a call, us."""
    start_s = time.thread_time()
    for _ in range(times):
        call()
    return 1e6 * (time.thread_time() - start_s) / times
