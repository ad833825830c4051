"""Thousands of open-loop squares at once, each with its own errors of wheels and gimbals."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from tsd_twin.drives import Drive, JointKind
from tsd_twin.estimation import Slip
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim import KinematicPlant, Servos, WheelSurface

PERIOD_S = 0.01
_SETTLE_S = 0.5
_AT_ONCE = 1e6
"""Radians a second, and 1/s: of servos that do not lag."""


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
    dead_band_rad: float = 0.0
    """Gimbals stop so close to where they are told."""
    backlash_rad: float = 0.0
    """Motors cross this alone after a reversal; it costs nothing when they do not lag."""
    delay_s: float = 0.0
    """What the robot is told comes so much later."""
    layer_m: float = 0.0
    """Of the surface of the wheels."""
    phase_rad: float | Array = 0.0
    """(n, k): where the first layer of each wheel begins."""
    slip: float = 0.0
    """1: the floor has the friction of the description; 0: wheels only roll."""

    def __add__(self, other: Errors) -> Errors:
        """Return both at once."""
        return Errors(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(Errors)))

    def part(self, rows: slice) -> Errors:
        """Return the errors of some of the robots."""
        phase = self.phase_rad
        phase = phase[rows] if isinstance(phase, np.ndarray) else phase
        return replace(
            self,
            spin_share=self.spin_share[rows],
            zero_rad=self.zero_rad[rows],
            phase_rad=phase,
        )


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
    """Drive the trajectory without correction, all robots in lockstep.

    Wheels are at speed when it starts. The command of each period is what its middle asks for.
    """
    drive: Drive[SE2] = robot.kinematics()
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    servos = _servos(robot, errors)
    plant = KinematicPlant(drive)
    runs = len(errors.spin_share)
    surface = WheelSurface(
        robot.kinematics(), errors.layer_m, np.zeros((runs, 1)) + errors.phase_rad
    )
    slip = Slip(robot, (runs,)) if errors.slip > 0.0 else None
    steps = round((trajectory.duration_s + _SETTLE_S) / PERIOD_S)
    t_s: Array = PERIOD_S * np.arange(steps, dtype=np.float64)
    told = drive.inverse(trajectory.at(t_s + 0.5 * PERIOD_S).twist)
    goals = told[:, is_angle]
    if errors.step_rad > 0.0:
        goals = np.round(goals / errors.step_rad) * errors.step_rad
    # Nothing here depends on the time itself: a robot that is told late is where it was then.
    shall = trajectory.at(t_s + PERIOD_S + errors.delay_s).pose[:, :2]
    nodes = np.empty((3, runs, len(is_angle)))
    nodes[..., ~is_angle] = told[0, ~is_angle] * (1.0 + errors.spin_share)
    play = np.zeros_like(errors.zero_rad)
    angles, pose = errors.zero_rad.copy(), SE2(np.tile(trajectory.at(0.0).pose, (runs, 1)))
    squared, worst, off = np.zeros(runs), np.zeros(runs), np.zeros(runs)
    halves = np.array([0.5, 1.0])[:, None, None] * PERIOD_S
    for goal, here in zip(goals, shall, strict=True):
        aim = goal + errors.zero_rad
        if servos is None:
            nodes[:, :, is_angle] = aim
        else:
            nodes[0][:, is_angle] = angles
            turning_s, plays = servos.cross(angles, aim, play, halves)
            nodes[1:, :, is_angle] = servos.after(angles, aim, turning_s)
            play = plays[1]
        angles = nodes[2][:, is_angle]
        tangent = plant.tangent(surface.roll(nodes), PERIOD_S)
        if slip is not None:
            before = slip.twist
            tangent = 0.5 * PERIOD_S * (before + slip.advance(tangent / PERIOD_S, PERIOD_S, 2))
        pose = pose @ SE2.exp(tangent)
        apart = pose.xy_heading[:, :2] - here
        off = np.hypot(apart[:, 0], apart[:, 1])
        squared += off * off
        worst = np.maximum(worst, off)
    return Outcome(np.sqrt(squared / steps), worst, off)


def _servos(robot: SingularityRobot, errors: Errors) -> Servos | None:
    """Return the servos of such robots; None when gimbals are at once where they are told."""
    play = {"dead_band_rad": errors.dead_band_rad, "backlash_rad": errors.backlash_rad}
    servos = replace(Servos.of(robot, robot.battery.nominal_v), **play)
    if errors.lag > 0.0:
        return servos
    if errors.dead_band_rad == 0.0:
        return None
    return replace(servos, speed_limit_rad_per_s=_AT_ONCE, approach_rate_per_s=_AT_ONCE)
