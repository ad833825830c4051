"""Benchmark of inverse kinematics, against a compiled swerve library called once per twist."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import numpy as np
from wpimath.geometry import Translation2d
from wpimath.kinematics import ChassisSpeeds, SwerveDrive3Kinematics

from bench.table import Row
from tsd_twin import robots

_TWISTS = 1_000_000
_CALLS = 20_000


def rows() -> Iterator[Row]:
    """Measure a million twists at once, and one at a time."""
    drive = robots.load_robot("tsd").kinematics()
    peer = SwerveDrive3Kinematics(*[Translation2d(x, y) for x, y in drive.pivots_m])
    twists = np.random.default_rng(0).normal(size=(_TWISTS, 3))
    one = twists[0]
    vx, vy, omega = (float(v) for v in one)
    peer_us = each_us(lambda: peer.toSwerveModuleStates(ChassisSpeeds(vx, vy, omega)), _CALLS)
    drive.inverse(twists)  # Warm-up call, so that the memory pages of the result exist.
    batch_us = each_us(lambda: drive.inverse(twists), 3) / _TWISTS
    single_us = each_us(lambda: drive.inverse(one), _CALLS)
    beside = f"wpimath {peer_us:.2f} us a twist"
    yield Row("inverse kinematics, 1e6 twists, each", batch_us, peer_us / 2, "us", beside)
    yield Row("inverse kinematics, single call", single_us, 8 * peer_us, "us", beside)


def each_us(call: Callable[[], object], times: int) -> float:
    """Return the time of a call, the best of five rounds: noise only ever adds."""
    best = math.inf
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(times):
            call()
        best = min(best, (time.perf_counter() - start) / times)
    return 1e6 * best
