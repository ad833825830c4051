"""Guided drives by a camera: routes, closed-loop driver, and camera consistency check."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from tsd_twin.errors import TwinError
from tsd_twin.estimation import PoseFilter
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.messages.sentences import sentence
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.paths import line, polyline
from tsd_twin.motion.routes import FixedHeading, Route, SampledHeading
from tsd_twin.motion.tracking import ExecutionPhase, TrajectoryExecutor
from tsd_twin.motion.trajectory import Reference, Trajectory, plan
from tsd_twin.robots import RobotDescription, SingularityDescription
from tsd_twin.robots.description import Limits
from tsd_twin.safety.lease import speed_cap_mps

WINDOW_S = 0.5
"""Time window over which the two motions are compared."""
MAX_DIFFERENCE_M, MAX_DIFFERENCE_RAD = 0.15, 0.5
"""Thresholds; gimbal errors of 0.5° cause 0.05 m and 0.3 rad, camera noise less."""
_TWIST_MEMORY_S = 3.0


class OdometryConsistency:
    """Consistency check of camera poses against wheel odometry.

    A frozen, jumping, mirrored or rotated camera image would mislead the closed loop, because it
    looks like a tracking error of the robot.
    """

    def __init__(self) -> None:
        self._odometry: deque[tuple[float, SE2]] = deque()
        self._camera: deque[tuple[float, SE2, SE2]] = deque()

    def add_twist(self, now_s: float, twist: Array) -> None:
        """Add the body twist (3,) until `now_s`; times increase."""
        before_s, before = self._odometry[-1] if self._odometry else (now_s, SE2.identity())
        self._odometry.append((now_s, before @ SE2.exp(twist * (now_s - before_s))))
        while self._odometry[0][0] < now_s - _TWIST_MEMORY_S:
            self._odometry.popleft()

    def add_pose(self, pose: SE2, seen_s: float) -> str:
        """Add a camera pose; return a description of the inconsistency, or ""."""
        odometry_pose = self._at(seen_s)
        if odometry_pose is None:
            return ""
        self._camera.append((seen_s, pose, odometry_pose))
        while len(self._camera) > 1 and self._camera[1][0] <= seen_s - WINDOW_S:
            self._camera.popleft()
        _, pose_then, odometry_then = self._camera[0]
        by_camera = (pose_then.inverse() @ pose).xy_heading
        by_wheels = (odometry_then.inverse() @ odometry_pose).xy_heading
        apart_m = math.dist(by_camera[:2], by_wheels[:2])
        apart_rad = abs(float(wrap(by_camera[2] - by_wheels[2])))
        if apart_m <= MAX_DIFFERENCE_M and apart_rad <= MAX_DIFFERENCE_RAD:
            return ""
        return (
            f"camera and wheels disagree by {apart_m:.2f} m and {math.degrees(apart_rad):.0f} "
            f"degrees about the last {WINDOW_S:g} s"
        )

    def _at(self, seen_s: float) -> SE2 | None:
        """Return the odometry pose at a time, or None before the memory begins."""
        index = bisect_right(self._odometry, seen_s, key=lambda each: each[0])
        if index == 0:
            return None
        before_s, before = self._odometry[index - 1]
        if index == len(self._odometry):
            return before
        after_s, after = self._odometry[index]
        share = (seen_s - before_s) / (after_s - before_s)
        step = np.array((before.inverse() @ after).log())
        return before @ SE2.exp(share * step)


FENCE_MARGIN_M = 0.15
"""Margin around the squares; beyond it the robot is stopped."""
_MAX_HALF_SIDE_M = 0.5
"""Maximum half side of the squares; the square of the thesis has a side of 1 m."""
_MIN_HALF_SIDE_M = 0.1
_MIN_SPEED_MPS = 0.1
_SHARE = 0.7
"""Fraction of the limits used by the trajectory; the rest is a margin for feedback."""
_TURN_PATH_M = 0.001
"""Path length of a turn in place, needed because routes are parameterized by arc length."""


@dataclass(frozen=True, slots=True, eq=False)
class GuidedRoute:
    """Route of a guided drive: trajectories from the start pose and back to it, in its frame."""

    legs: list[Trajectory]
    """Each begins at rest, where the one before ends."""
    limits: Limits
    """Limits of the commands."""
    half_m: float
    """Half side of the squares: maximum distance of the centre from the start in x and y."""
    fence_m: float
    """Distance from the start at which the robot is stopped."""

    @property
    def duration_s(self) -> float:
        """Duration of the route."""
        return sum(leg.duration_s for leg in self.legs)


def plan_calibration(robot: SingularityDescription, room_m: float, speed_mps: float) -> GuidedRoute:
    """Plan squares and turns, both ways; for arguments and exceptions see `_plan`."""

    def routes(half_m: float) -> list[Route]:
        return [
            route for way in (1.0, -1.0) for route in (_square_route(half_m, way), _turn_route(way))
        ]

    return _plan(robot, room_m, speed_mps, routes)


THESIS_LEG = 1
"""Index of the square in the route of `plan_thesis_square`."""


def plan_thesis_square(
    robot: SingularityDescription, room_m: float, speed_mps: float
) -> GuidedRoute:
    """Plan the square of the thesis from corner to corner, with the ways from the start and back.

    The start is in the middle of the square. For arguments and exceptions see `_plan`.
    """

    def routes(half_m: float) -> list[Route]:
        corners: Array = half_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], float)
        ways = (np.array([[0.0, 0.0], corners[0]]), corners, np.array([corners[0], [0.0, 0.0]]))
        return [Route(polyline(way), FixedHeading()) for way in ways]

    return _plan(robot, room_m, speed_mps, routes)


def _plan(
    robot: SingularityDescription,
    room_m: float,
    speed_mps: float,
    routes: Callable[[float], list[Route]],
) -> GuidedRoute:
    """Plan routes for a robot with `room_m` of free floor around its centre.

    `routes` returns them for half the side of a square. The room includes the stopping distance
    after a stop or a loss of the link, anywhere on the route.

    Raises:
        TwinError: If there is too little room, or the speed is out of range.
    """
    limits = robot.limits
    if not _MIN_SPEED_MPS <= speed_mps <= limits.speed_mps:
        raise TwinError(
            f"--speed must be {_MIN_SPEED_MPS:g} to {limits.speed_mps:g} m/s, which is the most "
            f"that {robot.name} drives, not {speed_mps:g}"
        )
    unheard_m = speed_mps * max_unheard_s(limits)
    needed_m = FENCE_MARGIN_M + (unheard_m + speed_mps**2 / (2.0 * limits.deceleration_mps2))
    half_m = min(_MAX_HALF_SIDE_M, room_m - needed_m)
    if not half_m >= _MIN_HALF_SIDE_M:
        raise TwinError(
            f"--room must be {needed_m + _MIN_HALF_SIDE_M:.2f} m or more at {speed_mps:g} m/s, "
            f"not {room_m:g}: slower takes less"
        )
    turn_rate = limits.turn_rate_rad_per_s * speed_mps / limits.speed_mps
    slower = replace(limits, speed_mps=speed_mps, turn_rate_rad_per_s=turn_rate)
    # The trajectory uses the full speed limit; the fraction lowers the acceleration.
    timed = replace(slower, speed_mps=_SHARE * speed_mps, turn_rate_rad_per_s=_SHARE * turn_rate)
    drive = robot.kinematics()
    # A gimbal that rests at one angle through a turn has one rounding error of its encoder, by
    # which the pivot radius would be 0.2 % off. So turns accelerate to their middle.
    rate = timed.turn_rate_rad_per_s
    timed = replace(
        timed,
        angular_acceleration_rad_per_s2=min(
            timed.angular_acceleration_rad_per_s2, rate**2 / (2.0 * math.pi * _SHARE)
        ),
    )
    legs = [plan(route, drive, timed, share=_SHARE) for route in routes(half_m)]
    return GuidedRoute(legs, slower, half_m, half_m + FENCE_MARGIN_M)


def max_unheard_s(limits: Limits) -> float:
    """Return the maximum time that a robot keeps driving after a loss of the link."""
    return 2.0 * limits.max_command_age_s


def requested_command_age_s(robot: RobotDescription, speed_mps: float) -> float | None:
    """Return the command age to request, so that short gaps do not end a drive.

    It is twice the default, or None (the default) if the lease would then forbid the speed.
    """
    age_s = 2.0 * robot.limits.max_command_age_s
    cap_mps = speed_cap_mps(robot, age_s)
    allowed = cap_mps >= speed_mps and age_s <= robot.limits.max_command_age_ceiling_s
    return age_s if allowed else None


def _square_route(half_m: float, way: float) -> Route:
    """Return a square around the start with a fixed heading; `way` is its sense of rotation."""
    corners: Array = half_m * np.array(
        [[0, 0], [1, 0], [1, way], [-1, way], [-1, -way], [1, -way], [1, 0], [0, 0]], dtype=float
    )
    return Route(polyline(corners), FixedHeading())


def _turn_route(way: float) -> Route:
    turn = SampledHeading([0.0, _TURN_PATH_M], [0.0, way * 2.0 * math.pi])
    return Route(line([0.0, 0.0], [_TURN_PATH_M, 0.0]), turn)


POSE_TIMEOUT_S = 1.5
"""Maximum time without a pose before the robot is stopped; poses may be delayed by 1 s."""
_REST_S = 0.3
"""Pause before each leg."""
_INTEGRAL_LIMITS = 0.2, 1.0
"""Anti-windup limits, m/s and rad/s: the creep of a robot with zeros that are off by 0.5°."""
_FILTER_MEMORY_S = 2.0
_TWIST_COVARIANCE_PER_S = np.diag([0.1, 0.1, 0.5]) ** 2 * 0.1
"""Growth of the covariance per second: uncalibrated wheels are off by 0.1 m/s and 0.5 rad/s, with a
correlation time of 0.1 s."""


@dataclass(frozen=True, slots=True, eq=False)
class GuidedStep:
    """State of a guided drive at a command; poses and twists in the frame of the start."""

    leg: int
    """Index in the route."""
    now_s: float
    reference: Reference
    pose: SE2
    """Estimate."""
    twist: Array
    """(3,): measured by the wheels, in the body frame."""


class GuidedDriver:
    """Closed-loop driver along a route, on camera poses, with stop conditions.

    Between poses, the pose is predicted with the measured twist. The robot's fused pose is not
    used, because an uncalibrated robot may reject the camera poses. Times are on the robot's
    monotonic clock.
    """

    def __init__(self, robot: SingularityDescription, route: GuidedRoute) -> None:
        self.route, self._lag_s = route, robot.lag_s
        self._drive = robot.kinematics()
        self._limiter = TwistLimiter(self._drive, route.limits)
        noise = robot.pose_sensor
        sigma = np.array([noise.sigma_m, noise.sigma_m, math.radians(noise.sigma_deg)])
        self._noise = np.diag(np.square(sigma))
        self._filter: PoseFilter | None = None
        self._consistency, self._disagreement = OdometryConsistency(), ""
        self._last_pose_s = -math.inf
        self._twist = np.zeros(3)
        self.start: SE2 | None = None
        """Pose at the start, once known."""
        self.steps: list[GuidedStep] = []
        self.poses: list[tuple[float, SE2]] = []
        """Camera poses with their times."""
        self._legs = iter(enumerate(route.legs))
        self._leg = 0
        self._follower: TrajectoryExecutor | None = None
        self._done_s = 0.0
        self._rest_until_s: float | None = None
        self.finished = False
        """Whether the route is complete and the robot at rest."""
        self.progress = 0.0
        """Progress of the route, 0 to 1."""

    def add_pose(self, pose: SE2, seen_s: float) -> None:
        """Add a camera pose with its time."""
        self.poses.append((seen_s, pose))
        if self._filter is None:
            self._filter = PoseFilter(
                self._drive, pose, self._noise, now_s=seen_s, memory_s=_FILTER_MEMORY_S
            )
        else:
            self._filter.fuse_pose(pose, self._noise, seen_s)
        self._disagreement = self._disagreement or self._consistency.add_pose(pose, seen_s)
        self._last_pose_s = max(self._last_pose_s, min(seen_s, self._filter.now_s))

    def add_twist(self, now_s: float, twist: Array) -> None:
        """Add the measured twist (3,) of the robot, in the body frame, until `now_s`."""
        self._twist = twist
        self._consistency.add_twist(now_s, twist)
        if self._filter is not None:
            self._filter.advance(now_s, twist, _TWIST_COVARIANCE_PER_S)

    def advance(self, now_s: float) -> Array:
        """Return the body twist (3,) to command now.

        Raises:
            TwinError: If a stop condition holds; the text is its reason.
        """
        if self._filter is None or not now_s - self._last_pose_s <= POSE_TIMEOUT_S:
            raise TwinError(f"no pose measurement for {POSE_TIMEOUT_S:g} s")
        if self._disagreement:
            raise TwinError(self._disagreement)
        here = self._filter.pose
        if self.start is None:
            self.start = here
        local = self.start.inverse() @ here
        x_m, y_m, _ = local.xy_heading.tolist()
        if not max(abs(x_m), abs(y_m)) <= self.route.fence_m:
            raise TwinError(
                f"it has left its area: it is {math.hypot(x_m, y_m):.2f} m from where it began"
            )
        follower = self._follower_at(now_s)
        if follower is None:
            return np.zeros(3)
        step = follower.advance(now_s, local)
        if step.why is not None:
            raise TwinError(sentence(step.why))
        trajectory = follower.trajectory
        reference = trajectory.at(step.reference_s)
        self.steps.append(GuidedStep(self._leg, now_s, reference, local, self._twist))
        share = min(step.done_m / trajectory.length_m, 1.0)
        self.progress = (self._done_s + share * trajectory.duration_s) / self.route.duration_s
        if step.phase is ExecutionPhase.ARRIVED:
            self._done_s += trajectory.duration_s
            self._follower, self._rest_until_s = None, None
        return step.twist

    def _follower_at(self, now_s: float) -> TrajectoryExecutor | None:
        """Return the executor of the leg, which starts after a pause; None between legs."""
        if self._follower is not None or self.finished:
            return self._follower
        if self._rest_until_s is None:
            self._rest_until_s = now_s + _REST_S
        if now_s < self._rest_until_s:
            return None
        following = next(self._legs, None)
        if following is None:
            self.finished, self.progress = True, 1.0
            return None
        self._leg, leg = following
        self._follower = TrajectoryExecutor(
            leg, self._limiter.cap, lag_s=self._lag_s, integral_limits=_INTEGRAL_LIMITS
        )
        return self._follower
