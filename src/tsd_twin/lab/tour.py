"""Squares and turns on the spot, both ways, in the room that there is around a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from tsd_twin.authority.lease import speed_cap_mps
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.motion.arc import line
from tsd_twin.motion.chain import polyline
from tsd_twin.motion.heading import FixedHeading, HeadingProfile
from tsd_twin.motion.route import Route
from tsd_twin.motion.trajectory import Trajectory, plan
from tsd_twin.robots import Robot, SingularityRobot
from tsd_twin.robots.robot import Limits

LEEWAY_M = 0.15
"""So far beside its squares a robot may be: beyond, it is stopped."""
_LARGEST_M = 0.5
"""Half a side of the squares, at most: that of the thesis had 1 m."""
_SMALLEST_M = 0.1
_SLOWEST_MPS = 0.1
_SHARE = 0.7
"""Of the limits that the timing uses: the rest is for correction."""
_TURN_M = 0.001
"""A turn in place is a way this short: routes are measured by their length."""


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """Ways that begin and end where the robot stands; axes are its own at the start."""

    legs: list[Trajectory]
    limits: Limits
    """What is commanded keeps these."""
    half_m: float
    """Half a side of the squares: so far from the start the centre goes, along x and along y."""
    fence_m: float
    """So far it may get."""

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return sum(leg.duration_s for leg in self.legs)


def tour(robot: SingularityRobot, room_m: float, speed_mps: float) -> Tour:
    """Return squares and turns for a robot that has `room_m` on all sides of its centre.

    In that room it also comes to rest when it is told to stop, or hears nothing any more, wherever
    it may be by then.

    Raises:
        TwinError: there is too little room, or the speed is none.
    """
    limits = robot.limits
    if not _SLOWEST_MPS <= speed_mps <= limits.speed_mps:
        raise TwinError(
            f"--speed must be {_SLOWEST_MPS:g} to {limits.speed_mps:g} m/s, which is the most that "
            f"{robot.name} drives, not {speed_mps:g}"
        )
    needed_m = LEEWAY_M + stopping_m(limits, speed_mps)
    half_m = min(_LARGEST_M, room_m - needed_m)
    if not half_m >= _SMALLEST_M:
        raise TwinError(
            f"--room must be {needed_m + _SMALLEST_M:.2f} m or more at {speed_mps:g} m/s, "
            f"not {room_m:g}: slower takes less"
        )
    turn_rate = limits.turn_rate_rad_per_s * speed_mps / limits.speed_mps
    slower = replace(limits, speed_mps=speed_mps, turn_rate_rad_per_s=turn_rate)
    # Timing uses all of a limit of speed that it is given; a share is for acceleration.
    timed = replace(slower, speed_mps=_SHARE * speed_mps, turn_rate_rad_per_s=_SHARE * turn_rate)
    drive = robot.kinematics()
    legs = [
        plan(route, drive, timed, share=_SHARE)
        for way in (1.0, -1.0)
        for route in (_square(half_m, way), _turn(way))
    ]
    return Tour(legs, slower, half_m, half_m + LEEWAY_M)


def stopping_m(limits: Limits, speed_mps: float) -> float:
    """Travel in metres from the loss of the link, or from a command to stop, until rest."""
    return speed_mps * unheard_s(limits) + speed_mps**2 / (2.0 * limits.deceleration_mps2)


def unheard_s(limits: Limits) -> float:
    """Longest time for which a robot without a link drives on, under a lease of `patient_age_s`."""
    return 2.0 * limits.max_command_age_s


def patient_age_s(robot: Robot, speed_mps: float) -> float | None:
    """Command age to ask for with the lease, so that no short pause ends a drive.

    Twice the usual; None, the usual, when the lease would not allow that speed then.
    """
    age_s = 2.0 * robot.limits.max_command_age_s
    cap_mps = speed_cap_mps(robot, age_s)
    allowed = cap_mps >= speed_mps and age_s <= robot.limits.max_command_age_ceiling_s
    return age_s if allowed else None


def _square(half_m: float, way: float) -> Route:
    """Return a square around the start, one way or the other, the robot looking as it did."""
    corners: Array = half_m * np.array(
        [[0, 0], [1, 0], [1, way], [-1, way], [-1, -way], [1, -way], [1, 0], [0, 0]], dtype=float
    )
    return Route(polyline(corners), FixedHeading())


def _turn(way: float) -> Route:
    turn = HeadingProfile([0.0, _TURN_M], [0.0, way * 2.0 * math.pi])
    return Route(line([0.0, 0.0], [_TURN_M, 0.0]), turn)
