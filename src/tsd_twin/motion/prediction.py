"""Motion prediction over the link delay: the motion model run forward with the commands still under
way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import Array
from tsd_twin.motion.limiter import TwistLimiter
from tsd_twin.robots.description import Limits

STEP_S = 0.01
"""As long as a period of the robot, which approaches a command in steps."""
AT_REST = 0.005
"""In m/s and rad/s: less is standstill."""
LONGEST_S = 5.0
"""Nobody wants to know what is later, and every robot has come to rest by then."""


@dataclass(frozen=True, slots=True, eq=False)
class PendingCommand:
    """A command that is on its way."""

    after_s: float
    """When it arrives, counted from the state that is run forward; before it when negative."""
    request: Array
    """(3,): the twist that it asks for."""
    to_base: Callable[[Any, Array], Array] | None = None
    """How the pose turns it into the base frame, where it is not in that frame already."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictedState(Generic[PoseT]):
    """One step of a prediction."""

    after_s: float
    pose: PoseT
    moving: Array
    """(3,): the twist with which it moves, which follows the one that is commanded."""


class Predictor(Generic[PoseT]):
    """Runs the limiter and the drive of the robot forward; everything is an argument.

    `lag_s` is how late the joints follow their set-points, as a first-order lag; `step_s` is best
    a period of the robot, and may be longer where a centimetre does not matter.
    """

    def __init__(
        self,
        kinematics: Kinematics[PoseT],
        limits: Limits,
        lag_s: float = 0.0,
        step_s: float = STEP_S,
    ) -> None:
        self._kinematics = kinematics
        self._step_s = step_s
        self._limiter = TwistLimiter(kinematics, limits)
        # What is left after a step of the difference between set-point and motion.
        self._left = math.exp(-step_s / lag_s) if lag_s > 0.0 else 0.0

    def moments(
        self, pose: PoseT, twist: Array, commands: Sequence[PendingCommand], share: float = 1.0
    ) -> Iterator[PredictedState[PoseT]]:
        """Yield state after state, from `pose` with `twist` (3,) commanded to the joints.

        `commands` are in the order of their arrival; the last one holds for ever, and without any
        the robot goes on as it does. `share` is that of the limits which the lease leaves.
        """
        waiting, step_s = list(commands), self._step_s
        goal = moving = twist = np.asarray(twist, float)
        newest: PendingCommand | None = None
        for step in range(round(LONGEST_S / step_s) + 1):
            after_s = step * step_s
            yield PredictedState(after_s, pose, moving)
            heard = newest
            while waiting and waiting[0].after_s <= after_s + 1e-9:
                newest = waiting.pop(0)
            if newest is not None and (newest is not heard or newest.to_base is not None):
                wanted = newest.request
                if newest.to_base is not None:
                    wanted = newest.to_base(pose, wanted)
                goal = self._limiter.cap(wanted, share)
            if twist is not goal:
                near = self._limiter.approach(twist, goal, step_s)
                twist = goal if np.array_equal(near, goal) else near
            moving = twist + self._left * (moving - twist)
            pose = self._kinematics.integrate(pose, moving, step_s)

    def after(
        self,
        ahead_s: float,
        pose: PoseT,
        twist: Array,
        commands: Sequence[PendingCommand],
        share: float = 1.0,
    ) -> PoseT:
        """Return the pose after `ahead_s`, to the step."""
        for moment in self.moments(pose, twist, commands, share):
            pose = moment.pose
            if moment.after_s >= ahead_s - 0.5 * self._step_s:
                break
        return pose

    def until_rest(
        self, pose: PoseT, twist: Array, commands: Sequence[PendingCommand], share: float = 1.0
    ) -> list[PoseT]:
        """Return the poses on the way until the last command holds and the robot is at rest."""
        path: list[PoseT] = []
        last_s = commands[-1].after_s if commands else 0.0
        for moment in self.moments(pose, twist, commands, share):
            path.append(moment.pose)
            if moment.after_s > last_s and np.abs(moment.moving).max() < AT_REST:
                break
        return path
