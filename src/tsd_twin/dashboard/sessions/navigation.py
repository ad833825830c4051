"""Navigation for a page: path planning, timing and execution while the button is held."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.client.motions import PlanLimits, plan
from tsd_twin.dashboard.scene.paths import ROUTE_POINTS
from tsd_twin.dashboard.sessions.lease import RpcExecutor
from tsd_twin.dashboard.wire.from_page import PlanRequest
from tsd_twin.dashboard.wire.to_page import ActionReply, RouteState
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import path_refusal, reason_of_path
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.motion.obstacles import Disc
from tsd_twin.motion.routes import NavigationGoal, check_free
from tsd_twin.motion.tracking import ExecutionPhase, ExecutionStep, TrajectoryExecutor
from tsd_twin.motion.trajectory import Trajectory

_MIN_DRAG_M = 0.05
"""Minimum length of a drag that sets a heading."""
_REACTION_S = 0.5
"""Time in which the robot still moves on after an obstacle was seen, without the link's delay."""
_START_TOLERANCE_M, _START_TOLERANCE_RAD = 0.03, 0.05
"""Position and heading tolerance between the robot and the start of its plan."""


@dataclass(frozen=True, slots=True, eq=False)
class TimedPlan:
    """Trajectory from the robot's pose at planning time."""

    number: int
    start: SE2
    limits_used: PlanLimits
    trajectory: Trajectory

    def is_valid(self, pose: SE2, limits_used: PlanLimits) -> bool:
        """Return whether it still starts at the robot's pose and uses the same limits."""
        off = pose.xy_heading - self.start.xy_heading
        return (
            bool(np.hypot(off[0], off[1]) < _START_TOLERANCE_M)
            and bool(abs(wrap(off[2])) < _START_TOLERANCE_RAD)
            and limits_used == self.limits_used
        )

    def is_free(self, discs: Sequence[Disc]) -> bool:
        """Return whether no obstacle has come onto the path since it was planned."""
        try:
            check_free(self.trajectory.route.path, discs)
        except PathError:
            return False
        return True

    def check_ahead(self, done_m: float, discs: Sequence[Disc], delay_s: float) -> None:
        """Check the part of the path in which the robot can still stop.

        Raises:
            PathError: If an obstacle is on it.
        """
        limits = self.limits_used.limits
        speed = limits.speed_mps
        stop_m = speed * (_REACTION_S + delay_s) + 0.5 * speed**2 / limits.deceleration_mps2
        check_free(self.trajectory.route.path, discs, done_m, done_m + stop_m)

    def route_state(
        self,
        phase: Literal["planned", "going", "arrived", "ended"],
        step: ExecutionStep | None = None,
    ) -> RouteState:
        """Return the route state for the page, after an execution step if one is given."""
        return RouteState(
            number=self.number,
            phase=phase,
            length_m=round(self.trajectory.length_m, 3),
            time_s=round(self.trajectory.duration_s, 2),
            done_m=0.0 if step is None else round(step.done_m, 3),
            off_mm=0.0 if step is None else round(1000.0 * min(step.cross_track_m, 1e3), 1),
            why=None if step is None else step.why,
        )


def navigation_goal(request: PlanRequest, points: Array) -> NavigationGoal:
    """Return the navigation goal of a request with floor points (n, 2).

    Raises:
        PathError: If there are no floor points.
    """
    if not len(points):
        raise path_refusal(because(Code.PATH_NOT_ON_FLOOR))
    heading = request.heading
    if request.kind == "to":
        if len(points) > 1 and np.hypot(*(ahead := points[1] - points[0])) > _MIN_DRAG_M:
            heading = float(np.arctan2(ahead[1], ahead[0]))
        points = points[:1]
    return NavigationGoal(points, heading)


def current_limits(link: RobotMonitor, level: int) -> PlanLimits:
    """Return the active limits at a speed level in percent."""
    return PlanLimits.in_force(
        link.robot, link.kinematics, link.snapshot.status, share=0.01 * level
    )


_LOG = logging.getLogger(__name__)

_MOVING_MODES = (Mode.DRIVING, Mode.STOPPING)


class NavigationSession:
    """Path planning and following for one page; event loop only.

    Only `step` moves the robot, and it is called only while the page reports the button as held.
    When that ends, the remaining path is planned again from the pose at rest and with a new number,
    so that a button that is still held does not resume the motion.
    """

    def __init__(
        self,
        page: str,
        executor: RpcExecutor,
        pick_floor: Callable[[str, Array], Future[Array]],
        show_route: Callable[[str, Array | None], None],
        send_reply: Callable[[ActionReply], None],
        obstacles: Callable[[RobotMonitor], Sequence[Disc]],
    ) -> None:
        """`obstacles` returns the places that a robot must not enter now."""
        self._page, self._executor, self._obstacles = page, executor, obstacles
        self._pick_floor, self._show_route = pick_floor, show_route
        self._send_reply = send_reply
        self._link: RobotMonitor | None = None
        self._navigation_goal: NavigationGoal | None = None
        self._speed_level_percent = 100
        self._timed_plan: TimedPlan | None = None
        self._follower: TrajectoryExecutor | None = None
        self._step: ExecutionStep | None = None
        self._is_drawn = self._started = False
        self._last_route: RouteState | None = None
        self._task: asyncio.Task[None] | None = None
        self._plan_count = 0

    @property
    def route_state(self) -> RouteState | None:
        """Route state for the page."""
        timed_plan, step = self._timed_plan, self._step
        if timed_plan is not None:
            going = self._follower is not None and step is not None
            return timed_plan.route_state("going" if going else "planned", step if going else None)
        if self._navigation_goal is not None or self._task is not None:
            return RouteState(self._plan_count, "planning", 0.0, 0.0)
        return self._last_route

    @property
    def is_following(self) -> bool:
        """Whether the button is held and the robot follows the path."""
        return self._follower is not None

    # Requests of the page.

    def request_plan(self, link: RobotMonitor, message: PlanRequest) -> None:
        """Plan a path for a robot controlled by this page, replacing any previous request."""
        self.clear()
        if link.kinematics.pose_type is not SE2:
            self._reject(because(Code.NO_PATHS))
            return
        status = link.snapshot.status
        if status is not None and status.mode in LATCHED:
            self._reject(status.why_no_drive)
            return
        self._link, self._speed_level_percent = link, message.level
        self._start(self._set_goal(message))

    def set_speed_level(self, level: int) -> None:
        """Set the speed level; a plan that is not being followed is retimed."""
        self._speed_level_percent = level
        if self._follower is None:
            self._timed_plan = None

    def clear(self) -> None:
        """Clear the path, and cancel planning."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._finish(None)

    # Execution.

    def update(self) -> None:
        """Start a pending plan when the robot is at rest."""
        link, timed_plan = self._link, self._timed_plan
        if link is None:
            return
        status, odom = link.snapshot.status, link.snapshot.odom
        if status is not None and status.mode in LATCHED:
            self.clear()  # A latched stop or fault ends the navigation.
            return
        if self._navigation_goal is None or self._task is not None or self._follower:
            return
        if status is None or odom is None or status.mode in _MOVING_MODES:
            return
        if self._started and self._navigation_goal.is_done(
            SE2(odom.xy_heading)
        ):  # The button was released just before the end.
            off_mm = 1000.0 * math.dist(self._navigation_goal.points[-1], odom.xy_heading[:2])
            self._finish(RouteState(self._plan_count, "arrived", 0.0, 0.0, off_mm=round(off_mm, 1)))
            return
        limits = current_limits(link, self._speed_level_percent)
        pose, discs = SE2(odom.xy_heading), self._obstacles(link)
        if (
            timed_plan is None
            or not timed_plan.is_valid(pose, limits)
            or not timed_plan.is_free(discs)
        ):
            self._timed_plan = None
            self._start(self._plan(link, self._navigation_goal, pose, limits, discs))

    def pause(self) -> None:
        """Handle release of the button; the remaining path is planned again."""
        timed_plan, step = self._timed_plan, self._step
        if self._follower is None or timed_plan is None or self._navigation_goal is None:
            return
        done_m = 0.0 if step is None else step.done_m
        self._navigation_goal = self._navigation_goal.remaining(
            timed_plan.trajectory.route.path, done_m
        )
        self._timed_plan = self._follower = self._step = None
        self._started = True

    def step(
        self,
        link: RobotMonitor,
        number: int,
        max_age_s: float,
        now_s: float,
        delay_s: float | None = None,
    ) -> ExecutionStep:
        """Return the command and the plan's state while the button is held.

        Args:
            link: Robot to command.
            number: Number of the plan to follow.
            max_age_s: Maximum age of the pose.
            now_s: Monotonic time.
            delay_s: Measured delay from a command to its effect in a state, if known.

        Raises:
            PathError: If the plan is outdated or for another robot, cannot be started, was aborted,
                or another robot is in the way.
        """
        timed_plan = self._timed_plan
        if timed_plan is None or link is not self._link or timed_plan.number != number:
            raise path_refusal(because(Code.PATH_NO_LONGER_PLANNED))
        snapshot = link.snapshot
        if snapshot.odom is None or now_s - snapshot.odom_received_s > max_age_s:
            raise path_refusal(because(Code.POSE_OUT_OF_DATE, s=max_age_s))
        pose = SE2(snapshot.odom.xy_heading)
        if self._follower is None:
            self._follower = self._start_following(link, timed_plan, pose)
        self._step = step = self._follower.advance(now_s, pose, delay_s)
        timed_plan.check_ahead(step.done_m, self._obstacles(link), delay_s or 0.0)
        match step.phase:
            case ExecutionPhase.GOING:
                pass
            case ExecutionPhase.ARRIVED:
                self._finish(timed_plan.route_state("arrived", step))
            case ExecutionPhase.LOST:
                self._finish(timed_plan.route_state("ended", step))
                raise path_refusal(step.why or because(Code.PATH_GIVEN_UP))
        return step

    def _start_following(
        self, link: RobotMonitor, timed_plan: TimedPlan, pose: SE2
    ) -> TrajectoryExecutor:
        status = link.snapshot.status
        if status is None or status.mode != Mode.READY:
            raise path_refusal(because(Code.PATH_STARTS_AT_REST))
        if not timed_plan.is_valid(pose, current_limits(link, self._speed_level_percent)):
            self._timed_plan = None
            raise path_refusal(because(Code.PATH_OUT_OF_DATE))
        return TrajectoryExecutor(
            timed_plan.trajectory,
            lambda twist: current_limits(link, self._speed_level_percent).cap(twist),
            lag_s=link.robot.lag_s,
            delay_s=link.round_trips.median_s() or 0.0,
        )

    # Planning.

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        async def until_done() -> None:
            try:
                await work
            except PathError as error:
                self._reject(reason_of_path(error))
            except Exception:  # The page needs a reply for every error.
                _LOG.exception("a way was not planned")
                self._reject(because(Code.PATH_NOT_PLANNED))
            if self._task is asyncio.current_task():
                self._task = None

        self._task = asyncio.create_task(until_done())

    async def _set_goal(self, request: PlanRequest) -> None:
        points = np.array(request.points, dtype=float)
        if request.on == "picture":
            points = await asyncio.wrap_future(self._pick_floor(self._page, points))
        self._navigation_goal = navigation_goal(request, points)
        self._send_reply(ActionReply(to="plan", ok=True))

    async def _plan(
        self,
        link: RobotMonitor,
        navigation_goal: NavigationGoal,
        start: SE2,
        limits: PlanLimits,
        discs: Sequence[Disc],
    ) -> None:
        trajectory = await self._executor.plan(plan, navigation_goal, start, limits, discs)
        self._plan_count += 1
        self._timed_plan = TimedPlan(self._plan_count, start, limits, trajectory)
        self._is_drawn = True
        at_m = np.linspace(0.0, trajectory.length_m, ROUTE_POINTS)
        self._show_route(link.id, trajectory.route.at(at_m).pose)

    def _finish(self, shown: RouteState | None) -> None:
        if self._link is not None and self._is_drawn:
            self._show_route(self._link.id, None)
        self._is_drawn = self._started = False
        self._link = self._navigation_goal = self._timed_plan = self._follower = self._step = None
        self._last_route = shown

    def _reject(self, why: Reason) -> None:
        self._finish(None)
        self._send_reply(ActionReply(to="plan", ok=False, why=why))
