"""The way that one page has planned, and what to command while the page holds the button."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np

from tsd_twin.authority import LATCHED, Mode
from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.floor import Picture
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.planned import Planned, Terms, errand_of, terms_in_force, timed
from tsd_twin.dashboard.protocol import Answer, Plan, Route
from tsd_twin.dashboard.route_line import POINTS
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.errand import Errand
from tsd_twin.motion.follower import Follower, Phase, Step

_LOG = logging.getLogger(__name__)

_IN_MOTION = (Mode.DRIVING, Mode.STOPPING)


class Going:
    """All methods belong to the event loop.

    Nothing moves but in `step`, which is called when the page says that the button is held. What
    ends that ends the run: what is left is planned anew from where the robot has come to rest, and
    has another number, so that a button that is still held does not go on with it.
    """

    def __init__(
        self, page: str, calls: Calls, picture: Picture, answer: Callable[[Answer], None]
    ) -> None:
        self._page, self._calls, self._picture = page, calls, picture
        self._answer = answer
        self._link: RobotLink | None = None
        self._errand: Errand | None = None
        self._level = 100
        self._planned: Planned | None = None
        self._follower: Follower | None = None
        self._step: Step | None = None
        self._drawn = self._begun = False
        self._ended: Route | None = None
        self._task: asyncio.Task[None] | None = None
        self._numbers = 0

    @property
    def shown(self) -> Route | None:
        """What the page is told."""
        planned, step = self._planned, self._step
        if planned is not None:
            going = self._follower is not None and step is not None
            return planned.shown("going" if going else "planned", step if going else None)
        if self._errand is not None or self._task is not None:
            return Route(self._numbers, "planning", 0.0, 0.0)
        return self._ended

    @property
    def follows(self) -> bool:
        """The button is held, and the robot follows the way."""
        return self._follower is not None

    # What the page asks for.

    def wish(self, link: RobotLink, message: Plan) -> None:
        """Plan a way for a robot that this page has control of; the newest wish counts."""
        self.drop()
        if link.drive.space is not SE2:
            self._give_up("this robot goes nowhere")
            return
        status = link.snapshot.status
        if status is not None and status.mode in LATCHED:
            self._give_up(f"the robot is {status.mode}: reset first")
            return
        self._link, self._level = link, message.level
        self._begin(self._take(message))

    def pace(self, level: int) -> None:
        """Go at another speed level; a way that nobody has begun to go is timed anew."""
        self._level = level
        if self._follower is None:
            self._planned = None

    def drop(self) -> None:
        """Forget the way, and whatever is being planned."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._end(None)

    # What comes of it.

    def tick(self) -> None:
        """Plan, when there is something to plan and the robot stands."""
        link, planned = self._link, self._planned
        if link is None:
            return
        status, odom = link.snapshot.status, link.snapshot.odom
        if status is not None and status.mode in LATCHED:
            self.drop()  # Whoever stopped it, and whatever broke: there is no way on from that.
            return
        if self._errand is None or self._task is not None or self._follower:
            return
        if status is None or odom is None or status.mode in _IN_MOTION:
            return
        if self._begun and self._errand.is_done(SE2(odom.xy_heading)):  # Let go of at the very end.
            off_mm = 1000.0 * math.dist(self._errand.points[-1], odom.xy_heading[:2])
            self._end(Route(self._numbers, "arrived", 0.0, 0.0, off_mm=round(off_mm, 1)))
            return
        terms = terms_in_force(link, self._level)
        if planned is None or not planned.holds(SE2(odom.xy_heading), terms):
            self._planned = None
            self._begin(self._plan(link, self._errand, SE2(odom.xy_heading), terms))

    def pause(self) -> None:
        """Nobody holds the button any more: what is left of the way is planned anew."""
        planned, step = self._planned, self._step
        if self._follower is None or planned is None or self._errand is None:
            return
        done_m = 0.0 if step is None else step.done_m
        self._errand = self._errand.rest(planned.trajectory.route.path, done_m)
        self._planned = self._follower = self._step = None
        self._begun = True

    def step(self, link: RobotLink, number: int, max_age_s: float, now_s: float) -> Step:
        """Return what to command while the button is held: the way `number` is going, or arrived.

        `link` is the robot that the command is for; a way of another is none of its.

        Raises:
            PathError: it cannot be begun, or has come to its end, and why.
        """
        planned = self._planned
        if planned is None or link is not self._link or planned.number != number:
            raise PathError("this way is planned no longer")
        snapshot = link.snapshot
        if snapshot.odom is None or now_s - snapshot.odom_s > max_age_s:
            raise PathError(f"where the robot is has not been heard for {max_age_s:g} s")
        pose = SE2(snapshot.odom.xy_heading)
        if self._follower is None:
            self._follower = self._set_out(link, planned, pose)
        self._step = step = self._follower.advance(now_s, pose)
        match step.phase:
            case Phase.GOING:
                pass
            case Phase.ARRIVED:
                self._end(planned.shown("arrived", step))
            case Phase.LOST:
                self._end(planned.shown("ended", step))
                raise PathError(step.reason)
        return step

    def _set_out(self, link: RobotLink, planned: Planned, pose: SE2) -> Follower:
        status = link.snapshot.status
        if status is None or status.mode != Mode.READY:
            raise PathError("the robot is not at rest")
        if not planned.holds(pose, terms_in_force(link, self._level)):
            self._planned = None
            raise PathError("the robot or its limits are not what they were: it is planned anew")
        return Follower(
            planned.trajectory,
            lambda twist: self._cap(link, twist),
            lag_s=link.robot.lag_s,
            delay_s=link.trips.typical_s() or 0.0,
        )

    def _cap(self, link: RobotLink, twist: Array) -> Array:
        terms = terms_in_force(link, self._level)
        return TwistLimiter(terms.drive, terms.limits).cap(twist)

    # Planning.

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        async def until_done() -> None:
            try:
                await work
            except PathError as error:
                self._give_up(str(error))
            except Exception:  # Whatever it was, the page has to hear of it.
                _LOG.exception("a way was not planned")
                self._give_up("it could not be planned")
            if self._task is asyncio.current_task():
                self._task = None

        self._task = asyncio.create_task(until_done())

    async def _take(self, wish: Plan) -> None:
        points = np.array(wish.points, dtype=float)
        if wish.on == "picture":
            points = await asyncio.wrap_future(self._picture.floor(self._page, points))
        self._errand = errand_of(wish, points)
        self._answer(Answer(to="plan", ok=True))

    async def _plan(self, link: RobotLink, errand: Errand, start: SE2, terms: Terms) -> None:
        trajectory = await self._calls.plan(timed, errand, start, terms)
        self._numbers += 1
        self._planned = Planned(self._numbers, start, terms, trajectory)
        self._drawn = True
        at_m = np.linspace(0.0, trajectory.length_m, POINTS)
        self._picture.show_route(link.id, trajectory.route.at(at_m).pose)

    def _end(self, shown: Route | None) -> None:
        if self._link is not None and self._drawn:
            self._picture.show_route(self._link.id, None)
        self._drawn = self._begun = False
        self._link = self._errand = self._planned = self._follower = self._step = None
        self._ended = shown

    def _give_up(self, reason: str) -> None:
        self._end(None)
        self._answer(Answer(to="plan", ok=False, reason=reason))
