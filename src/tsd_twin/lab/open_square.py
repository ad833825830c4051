"""Thousands of open-loop squares at once, each with its own errors of wheels and gimbals."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tsd_twin.drives import Drive, JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim import KinematicPlant, Servos

PERIOD_S = 0.01
_SETTLE_S = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """What is wrong with n robots; nothing, unless given."""

    spin_share: Array
    """(n, k): of the speed of each wheel."""
    zero_rad: Array
    """(n, g): by how much each gimbal stands beside where it is told."""
    step_rad: float = 0.0
    """Gimbals go to whole numbers of this; 0: anywhere."""
    lag: float = 0.0
    """1: gimbals follow as servos do; 0: at once."""

    def __add__(self, other: Errors) -> Errors:
        """Return both at once."""
        return Errors(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(Errors)))

    def part(self, rows: slice) -> Errors:
        """Return the errors of some of the robots."""
        return Errors(self.spin_share[rows], self.zero_rad[rows], self.step_rad, self.lag)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """How n runs ended, metres."""

    rms_m: Array
    """(n,): root mean square distance to the reference in time."""
    worst_m: Array
    """(n,): greatest."""
    closure_m: Array
    """(n,): at the end."""


def drive_open(robot: SingularityRobot, trajectory: Trajectory, errors: Errors) -> Outcome:
    """Drive the trajectory without correction, all robots in lockstep, wheels rolling without slip.

    Wheels are at speed when it starts. The command of each period is what its middle asks for.
    """
    drive: Drive[SE2] = robot.kinematics()
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    servos = Servos.of(robot, robot.battery.nominal_v)
    plant = KinematicPlant(drive)
    runs = len(errors.spin_share)
    steps = round((trajectory.duration_s + _SETTLE_S) / PERIOD_S)
    t_s: Array = PERIOD_S * np.arange(steps, dtype=np.float64)
    told = drive.inverse(trajectory.at(t_s + 0.5 * PERIOD_S).twist)
    goals = told[:, is_angle]
    if errors.step_rad > 0.0:
        goals = np.round(goals / errors.step_rad) * errors.step_rad
    shall = trajectory.at(t_s + PERIOD_S).pose[:, :2]
    nodes = np.empty((3, runs, len(is_angle)))
    nodes[..., ~is_angle] = told[0, ~is_angle] * (1.0 + errors.spin_share)
    angles, pose = errors.zero_rad.copy(), SE2(np.tile(trajectory.at(0.0).pose, (runs, 1)))
    squared, worst, off = np.zeros(runs), np.zeros(runs), np.zeros(runs)
    halves = np.array([0.5, 1.0])[:, None, None] * PERIOD_S
    for goal, here in zip(goals, shall, strict=True):
        aim = goal + errors.zero_rad
        if errors.lag > 0.0:
            nodes[0][:, is_angle] = angles
            nodes[1:, :, is_angle] = servos.after(angles, aim, halves)
        else:
            nodes[:, :, is_angle] = aim
        angles = nodes[2][:, is_angle]
        pose = plant.move(pose, nodes, PERIOD_S)
        apart = pose.xy_heading[:, :2] - here
        off = np.hypot(apart[:, 0], apart[:, 1])
        squared += off * off
        worst = np.maximum(worst, off)
    return Outcome(np.sqrt(squared / steps), worst, off)
