"""Benchmark of inverse kinematics, compared with a compiled swerve library called per twist."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import numpy as np
from wpimath.geometry import Translation2d
from wpimath.kinematics import ChassisSpeeds, SwerveDrive3Kinematics

from bench.table import Row
from tsd_twin import robots
from tsd_twin.robots import SingularityDescription, description_of_kind

_TWISTS, _CALLS = 1_000_000, 20_000
_SMALLEST = 1_000, 20


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure a million twists in a batch, and individual calls."""
    number, calls = _SMALLEST if smallest else (_TWISTS, _CALLS)
    drive = description_of_kind(robots.load_robot("tsd"), SingularityDescription).kinematics()
    peer = SwerveDrive3Kinematics(*[Translation2d(x, y) for x, y in drive.pivots_m])
    twists = np.random.default_rng(0).normal(size=(number, 3))
    one = twists[0]
    vx, vy, omega = (float(v) for v in one)
    peer_us = each_us(lambda: peer.toSwerveModuleStates(ChassisSpeeds(vx, vy, omega)), calls)
    drive.inverse(twists)  # Warm up, so that the memory pages of the result exist.
    batch_us = each_us(lambda: drive.inverse(twists), 3) / number
    single_us = each_us(lambda: drive.inverse(one), calls)
    comparison = f"wpimath {peer_us:.2f} us a twist"
    yield Row(
        f"inverse kinematics, {number:,} twists, each", batch_us, peer_us / 2, "us", comparison
    )
    yield Row("inverse kinematics, single call", single_us, 8 * peer_us, "us", comparison)


def each_us(call: Callable[[], object], times: int) -> float:
    """Return the time of a call, the best of five rounds, because noise only adds."""
    best = math.inf
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(times):
            call()
        best = min(best, (time.perf_counter() - start) / times)
    return 1e6 * best
