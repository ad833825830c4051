"""Squares both ways and turns on the spot, once with each wheel faster than the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from tsd_twin.lab.machine import Machine
from tsd_twin.lab.observer import voltage_share
from tsd_twin.lab.recording import Recording
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim import Camera, CameraNoise, Frame

FASTER = 1.6
"""Of one wheel in each run but the first, over the others."""
SPEED_MPS, SIDE_M, TURN_RAD_PER_S = 1.0, 1.0, 2.0
TACHOMETER_SHARE = 0.002
"""Noise of one reading of a wheel's speed (assumed)."""
_REST_S = 0.5
"""More than the camera is late."""


def patterns(modules: int) -> list[list[float]]:
    """Return the speeds of the wheels over the gear, run by run: all alike, then one faster.

    At one speed for all, a robot that creeps tells three things about the zeros of its gimbals, and
    the rest of them only pushes its wheels against one another. A wheel that is faster makes its
    own errors count for more, so each is told apart.
    """
    return [[FASTER if i == j - 1 else 1.0 for i in range(modules)] for j in range(modules + 1)]


def script() -> Array:
    """Return the twists (n, 3) of a run, period by period: squares and turns, both ways."""
    sides = SPEED_MPS * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    legs: list[tuple[Array, float]] = [(np.zeros(3), _REST_S)]
    for way, corners in ((1.0, sides), (-1.0, sides[::-1])):
        legs += [(np.append(side, 0.0), SIDE_M / SPEED_MPS) for side in corners]
        turn = np.array([0.0, 0.0, way * TURN_RAD_PER_S])
        legs.append((turn, 2.0 * math.pi / TURN_RAD_PER_S))
    legs.append((np.zeros(3), _REST_S))
    return np.concatenate([np.tile(leg, (round(s / PERIOD_S), 1)) for leg, s in legs])


def drive(
    believed: SingularityRobot,
    machine: Machine,
    ratio: list[float],
    seed: int,
    start_s: float = 0.0,
    *,
    tachometer: bool,
    periods: Callable[[Array], Iterable[Array]] = iter,
) -> Recording:
    """Drive one run open loop, wheels at `ratio` (k,) of the gear, and return what was measured.

    The machine has been at rest since `start_s`.
    """
    random = np.random.default_rng(seed)
    robot = VirtualRobot(_at(believed, ratio), machine, start_s)
    at_voltage = voltage_share(robot)
    camera = Camera(CameraNoise(), random)
    measured: list[Array] = []
    told: list[Array] = []
    speeds: list[Array] = []
    frames: list[Frame] = []
    start_s, t_s = robot.now_s, np.empty(0)
    for twist in periods(script()):
        now_s = robot.now_s - start_s
        t_s = np.append(t_s, now_s)
        measured.append(robot.core.joints.reshape(-1, 3)[:, :2].ravel())
        told.append(at_voltage * robot.core.setpoint[2::3])
        speeds.append(machine.truth(robot.now_s).joints[2::3])
        frames += camera.watch(now_s, robot.truth)
        robot.drive(twist)
    spin = np.array(speeds) * (1.0 + TACHOMETER_SHARE * random.standard_normal(np.shape(speeds)))
    return Recording(
        t_s,
        np.array(measured),
        np.array(told),
        spin if tachometer else np.full(spin.shape, np.nan),
        np.array([frame.taken_s for frame in frames]),
        np.array([frame.pose for frame in frames]),
    )


def _at(robot: SingularityRobot, ratio: list[float]) -> SingularityRobot:
    return msgspec.structs.replace(
        robot, drive=msgspec.structs.replace(robot.drive, spin_ratio=ratio)
    )
