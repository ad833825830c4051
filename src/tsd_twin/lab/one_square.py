"""One drive of the square: open loop as in the thesis, or closed and timed to the limits."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.estimation import Slip
from tsd_twin.lab import shapes
from tsd_twin.lab.drive_path import Record, follow
from tsd_twin.lab.observer import Loop, Observer, observer
from tsd_twin.lab.pushing import Pushing
from tsd_twin.lab.virtual_robot import VirtualRobot
from tsd_twin.motion.pid import Gains
from tsd_twin.motion.route import Route
from tsd_twin.motion.timing import SpeedProfile
from tsd_twin.motion.tracker import Tracker, TrackerSettings
from tsd_twin.motion.trajectory import Trajectory, plan
from tsd_twin.robots import Robot, SingularityRobot, of_kind
from tsd_twin.sim import SimRobot

SPEED_MPS = 1.0
ACCELERATION_MPS2, DECELERATION_MPS2 = 4.0, 4.0
"""Of the closed loop; the limits of the robot are raised to leave room above them."""
SMOOTH_S = 0.0495
"""In which acceleration rises, and falls: what is left of 5.2 s, on four sides."""
_ROOM = 0.5
"""Share of these limits that the timing uses: what is late, slides or gives has to be told more."""
_ABOVE = 1.5
"""Limit of speed over that of the square: with a battery that is low all speeds are told higher."""
_GAINS = Gains(6.0, 1.0, integral_limit=0.05)
"""Softer than a tracker's own: feed-forward leaves little, and each frame of a camera is noisy."""
_PLAY_LAG_S = 0.01
"""By which a robot with the errors of `tsd` follows later when it pushes: while the motor of a
servo crosses its play, the floor turns the gimbal. Measured in MuJoCo, the one figure here that is;
the rest of the lag is in the description."""
THESIS_SHARE = 0.16
"""The largest error of position that the thesis reports, of the side."""
_ANY_MPS2 = 1000.0
"""The thesis had no limit of acceleration: a corner was passed as fast as servos turn."""


@dataclass(frozen=True, slots=True)
class Square:
    """What is asked for, as by the flags of `tsd-lab square`."""

    robot: str
    loop: Loop
    seed: int
    noise: float
    errors: float
    plant: str
    believed_friction: float
    """What the robot takes the friction of the floor for, over what it is."""
    turns: bool
    """Whether it turns on the spot first, to learn how fast its wheels spin."""

    @staticmethod
    def of(args: argparse.Namespace, seed: int) -> Square:
        """Return the square that `args` ask for, with another seed."""
        return Square(
            robot=args.robot,
            loop=Loop(args.loop),
            seed=seed,
            noise=args.noise,
            errors=args.errors,
            plant=args.plant,
            believed_friction=args.believed_friction,
            turns=args.turn,
        )

    def drive(self, periods: Callable[[range], Iterable[int]] = iter) -> tuple[Trajectory, Record]:
        """Drive it, and return what was to be done, and what was."""
        robot = robots.load(self.robot)
        route = Route(shapes.shape("square"))
        if self.loop is Loop.OPEN:
            robot = _with_limits(robot, _ANY_MPS2, _ANY_MPS2)
            trajectory = sharp(route)
        else:
            robot = _with_limits(robot, ACCELERATION_MPS2 / _ROOM, DECELERATION_MPS2 / _ROOM)
            trajectory = plan(
                route,
                robot.kinematics(),
                robot.limits,
                share=_ROOM,
                speed_mps=SPEED_MPS,
                smooth_s=SMOOTH_S,
            )
        simulated = SimRobot(
            robot, seed=self.seed, noise=self.noise, plant=self.plant, errors=self.errors
        )
        virtual = VirtualRobot(robot, simulated)
        slip = self._slip(robot) if self.plant == "mujoco" else None
        watching = observer(self.loop, virtual, self.seed, slip, turns=self.turns)
        tracker = self._tracker(robot, trajectory, watching)
        return trajectory, follow(virtual, trajectory, tracker, watching, periods)

    def _slip(self, robot: Robot) -> Slip:
        """Return how wheels slide on the floor that the robot believes in."""
        known = of_kind(robot, SingularityRobot)
        friction = self.believed_friction * known.floor.friction
        floor = msgspec.structs.replace(known.floor, friction=friction)
        return Slip(msgspec.structs.replace(known, floor=floor))

    def _tracker(self, robot: Robot, trajectory: Trajectory, watching: Observer | None) -> Tracker:
        """Return what follows the trajectory; errors are known up to the size described."""
        if watching is None:
            return Tracker(trajectory, TrackerSettings(lag_s=0.0))
        lag_s = robot.lag_s + robot.with_errors(self.errors).delay_s
        if watching.slip is None:
            return Tracker(trajectory, TrackerSettings(lag_s, _GAINS, _GAINS))
        lag_s += _PLAY_LAG_S * min(self.errors, 1.0)
        pushing = Pushing(of_kind(robot, SingularityRobot), watching.slip, trajectory)
        return Tracker(trajectory, TrackerSettings(lag_s, _GAINS, _GAINS), pushing)


def sharp(route: Route) -> Trajectory:
    """Return the reference of the thesis: full speed at once, and around corners in an instant."""
    s_m = np.array([0.0, *route.breaks_m, route.length_m])
    speed = np.full(len(s_m), SPEED_MPS)
    profile = SpeedProfile(s_m, speed, np.zeros(len(s_m) - 1), s_m / SPEED_MPS)
    return Trajectory(route, profile)


def _with_limits(robot: Robot, acceleration_mps2: float, deceleration_mps2: float) -> Robot:
    """Return the robot with other limits of acceleration, and room above the speed."""
    limits = msgspec.structs.replace(
        robot.limits,
        speed_mps=max(robot.limits.speed_mps, _ABOVE * SPEED_MPS),
        acceleration_mps2=acceleration_mps2,
        deceleration_mps2=deceleration_mps2,
    )
    return msgspec.structs.replace(robot, limits=limits)
