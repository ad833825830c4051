"""Motions as procedures: drive, stop, follow a planned path."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import msgspec
import numpy as np

from tsd_twin.client.arguments import (
    check_duration,
    check_frame,
    check_numbers,
    check_optional,
    checked_points,
    checked_twist,
)
from tsd_twin.client.errors import ClientError, MotionFailed
from tsd_twin.client.port import Compute, NextStatus, Procedure, Sleep
from tsd_twin.client.protocol import COMMAND_PERIOD_S, ZERO_TWIST, ControlProtocol
from tsd_twin.errors import PathError
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.status import RobotStatus
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.obstacles import Disc
from tsd_twin.motion.routes import NavigationGoal
from tsd_twin.motion.tracking import ExecutionPhase, TrajectoryExecutor
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.motion.trajectory import plan as time_parameterize
from tsd_twin.robots import RPM, RobotDescription
from tsd_twin.robots.description import Limits

TwistSource = Callable[[float], Sequence[float] | Array | None]
"""Returns the twist (3,) to command at a given time, or None to end the motion."""

_REST_S = 10.0
_STILL_S = 0.5
_SPEED_SHARE = 0.9
_SHARE = 0.7
"""Fractions of the speed limits and of the others used for planning; the rest is for feedback."""
_CELLS = 250
_SHORTEST_CELL_M = 0.01


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """Limits and kinematics for trajectory timing."""

    limits: Limits
    wheel_speed_rpm: float | None
    """Speed of continuously spinning wheels, or None if the robot has none."""
    kinematics: Kinematics[Any] = field(compare=False)
    """Kinematics at that wheel speed."""
    drives_sideways: bool = True
    """Whether the robot is omnidirectional, as planned paths require."""

    @staticmethod
    def in_force(
        robot: RobotDescription,
        kinematics: Kinematics[Any],
        status: RobotStatus | None,
        *,
        speed_mps: float = math.inf,
        share: float = 1.0,
    ) -> PlanLimits:
        """Return `share` of the described limits, lowered by the lease and `speed_mps`."""
        speed, turn = robot.limits.speed_mps, robot.limits.turn_rate_rad_per_s
        if status is not None and status.limits.speed_mps > 0.0:
            speed = min(speed, status.limits.speed_mps)
        if status is not None and status.limits.turn_rate_rad_per_s > 0.0:
            turn = min(turn, status.limits.turn_rate_rad_per_s)
        speed, turn = share * min(speed, speed_mps), share * turn
        return PlanLimits(
            msgspec.structs.replace(robot.limits, speed_mps=speed, turn_rate_rad_per_s=turn),
            None
            if status is None or status.wheel_speed is None
            else status.wheel_speed.requested_rpm,
            kinematics_in_force(robot, kinematics, status),
            robot.drives_sideways,
        )

    def cap(self, twist: Array) -> Array:
        """Scale the whole twist (3,) to satisfy the limits."""
        return TwistLimiter(self.kinematics, self.limits).cap(twist)


def kinematics_in_force(
    robot: RobotDescription, kinematics: Kinematics[Any], status: RobotStatus | None
) -> Kinematics[Any]:
    """Return the kinematics at the wheel speed in `status`."""
    speeds = robot.wheel_speed_range
    if speeds is None or status is None or status.wheel_speed is None:
        return kinematics
    spin = status.wheel_speed.requested_rpm * RPM
    return speeds.kinematics.with_spin(spin) if speeds.allows(spin) else kinematics


def goal_at(x_m: float, y_m: float, heading_rad: float | None) -> NavigationGoal:
    """Return a goal pose; without a heading, the robot keeps its heading."""
    check_numbers(x_m=x_m, y_m=y_m)
    check_optional(heading_rad=heading_rad)
    return NavigationGoal(np.array([[x_m, y_m]]), heading_rad)


def goal_along(points: Sequence[Sequence[float]], heading_rad: float | None) -> NavigationGoal:
    """Return a goal path through `points` of (x, y) in metres."""
    check_optional(heading_rad=heading_rad)
    return NavigationGoal(checked_points(points), heading_rad)


def plan(
    goal: NavigationGoal, start: SE2, limits: PlanLimits, discs: Sequence[Disc] = ()
) -> Trajectory:
    """Plan a path from `start` to the goal, timed within the limits; takes about 50 ms.

    It leads around `discs`; a drawn line that enters one is refused.

    Raises:
        PathError: If no path exists or the robot cannot follow it.
    """
    if not limits.drives_sideways:
        raise PathError("this robot cannot drive sideways, as it would have to on a planned path")
    route = goal.route(start, discs)
    turn = _SPEED_SHARE * limits.limits.turn_rate_rad_per_s
    return time_parameterize(
        route,
        limits.kinematics,
        msgspec.structs.replace(limits.limits, turn_rate_rad_per_s=turn),
        share=_SHARE,
        speed_mps=_SPEED_SHARE * limits.limits.speed_mps,
        cell_m=max(_SHORTEST_CELL_M, route.length_m / _CELLS),
    )


# Motions; they raise a `ClientError` as `ControlProtocol.check_motion`, or for invalid arguments.


def drive(
    protocol: ControlProtocol, now_s: float, twist: Sequence[float], duration_s: float, frame: str
) -> Procedure[None]:
    """Command a twist for `duration_s`, then zero until the robot is at rest."""
    check_duration(duration_s=duration_s)
    checked_twist(twist, frame)

    def body(now_s: float, motion: int) -> Procedure[None]:
        return _send_twists(protocol, now_s, motion, lambda _: twist, frame, now_s + duration_s)

    yield from _motion(protocol, now_s, body)


def drive_by(
    protocol: ControlProtocol, now_s: float, twist_at: TwistSource, frame: str = BASE
) -> Procedure[None]:
    """Command the twists from `twist_at`, then zero until the robot is at rest."""
    check_frame(frame)
    yield from _motion(
        protocol,
        now_s,
        lambda now_s, motion: _send_twists(protocol, now_s, motion, twist_at, frame),
    )


def rest(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Command zero until the robot is at rest; ends any other motion of this script."""
    end_s = now_s + _REST_S
    while protocol.mode is Mode.STOPPING and now_s < end_s:
        now_s = (yield NextStatus(end_s)).now_s
    motion = protocol.begin_rest(now_s)
    try:
        yield from _come_to_rest(protocol, now_s, motion)
    finally:
        protocol.end_motion(motion)


def follow(
    protocol: ControlProtocol, now_s: float, goal: NavigationGoal, speed_mps: float | None
) -> Procedure[None]:
    """Follow a planned path to the goal, with feedback from odometry.

    Raises:
        PathError: If no such path exists.
        MotionFailed: If the robot leaves the path or misses the goal.
        ClientError: As for `ControlProtocol.check_motion`.
    """
    check_optional(speed_mps=speed_mps)
    if speed_mps is not None and speed_mps <= 0.0:
        raise ClientError(f"speed_mps must be greater than 0, not {speed_mps}", "not_positive")

    def body(now_s: float, motion: int) -> Procedure[None]:
        start = protocol.pose(now_s)
        if goal.is_done(start):
            return
        outcome = yield Compute(partial(plan, goal, start, _limits(protocol, speed_mps)))
        executor = TrajectoryExecutor(
            outcome.value,
            lambda twist: _limits(protocol, speed_mps).cap(twist),
            lag_s=protocol.robot.lag_s,
            delay_s=protocol.round_trip_s,
        )
        lost: list[str] = []

        def twist_at(now_s: float) -> Array | None:
            step = executor.advance(now_s, protocol.pose(now_s), protocol.delay_s(now_s))
            lost.extend([sentence(step.why)] if step.why else [])
            return step.twist if step.phase is ExecutionPhase.GOING else None

        yield from _send_twists(protocol, outcome.now_s, motion, twist_at, BASE)
        if lost:
            stale = protocol.stale_commands
            late = f"; {stale} commands came too late and were dropped" if stale else ""
            reason = f"{protocol.robot_id} stopped on its way: {lost[0]}{late}"
            raise MotionFailed(reason, "left_path")

    yield from _motion(protocol, now_s, body)


def _limits(protocol: ControlProtocol, speed_mps: float | None) -> PlanLimits:
    return PlanLimits.in_force(
        protocol.robot, protocol.kinematics, protocol.status, speed_mps=speed_mps or math.inf
    )


def _motion(
    protocol: ControlProtocol, now_s: float, body: Callable[[float, int], Procedure[None]]
) -> Procedure[None]:
    """Run the commands of a motion; on an error, send a zero first."""
    now_s = yield from _finish_setpoint(protocol, now_s)
    motion = protocol.begin_motion(now_s)
    try:
        yield from body(now_s, motion)
    except GeneratorExit:  # A closed generator can no longer send.
        raise
    except BaseException:
        if protocol.has_lease and protocol.is_active(motion):
            yield protocol.command(ZERO_TWIST, BASE, now_s)
        raise
    finally:
        protocol.end_motion(motion)


def _send_twists(
    protocol: ControlProtocol,
    now_s: float,
    motion: int,
    twist_at: TwistSource,
    frame: str,
    end_s: float = math.inf,
) -> Procedure[None]:
    """Command twists at 50 Hz until `end_s` or None, then come to rest."""
    while now_s < end_s - 1e-9:
        twist = twist_at(now_s)
        protocol.check_motion(now_s, motion)
        if twist is None:
            break
        yield protocol.command(twist, frame, now_s)
        now_s = (yield Sleep(min(now_s + COMMAND_PERIOD_S, end_s))).now_s
    yield from _come_to_rest(protocol, now_s, motion)


def _come_to_rest(protocol: ControlProtocol, now_s: float, motion: int) -> Procedure[None]:
    first, still_s, end_s = None, None, now_s + _REST_S
    while True:
        protocol.check_motion(now_s, motion)
        command = protocol.command(ZERO_TWIST, BASE, now_s)
        first = command.seq if first is None else first
        yield command
        now_s = (yield Sleep(now_s + COMMAND_PERIOD_S)).now_s
        if protocol.at_rest_since(first):
            # Joints lag behind, and a noisy estimate never shows zero.
            still_s = now_s + _STILL_S if still_s is None else still_s
            if protocol.is_still() or now_s >= still_s:
                return
        if now_s > end_s:
            raise MotionFailed(f"{protocol.robot_id} does not come to rest", "not_at_rest")


def _finish_setpoint(protocol: ControlProtocol, now_s: float) -> Procedure[float]:
    """Wait for a velocity setpoint to end before another motion begins."""
    protocol.end_setpoint()
    end_s = now_s + _REST_S
    while protocol.has_setpoint:
        now_s = (yield Sleep(now_s + COMMAND_PERIOD_S)).now_s
        if now_s > end_s:
            raise MotionFailed(f"{protocol.robot_id} does not come to rest", "not_at_rest")
    protocol.raise_failure()
    return now_s
