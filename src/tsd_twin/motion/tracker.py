"""Following a trajectory: feed-forward, and control of what is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.motion.pid import Gains, Pid
from tsd_twin.motion.trajectory import Reference, Trajectory


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """How a trajectory is followed."""

    lag_s: float = 0.04
    """Time by which the actuators follow late: acceleration is fed forward by so much."""
    along: Gains = field(default_factory=lambda: Gains(8.0, 1.0, integral_limit=0.05))
    """Against being early or late."""
    across: Gains = field(default_factory=lambda: Gains(8.0, 1.0, integral_limit=0.05))
    """Against being beside the path, the signed distance to it."""
    heading: Gains = field(default_factory=lambda: Gains(8.0, 1.0, integral_limit=0.2))


class Tracker:
    """Twists that make a robot follow a trajectory, open or closed loop.

    Feed-forward is the twist of the reference ahead by the lag of the actuators: to first order the
    twist now and its rate times the lag, which is what joints that follow late have to be told. The
    sum itself would jump with the acceleration, and the core would not let it. Time and poses are
    arguments; poses may have leading batch dimensions. Twists are not limited here: the trajectory
    is, and the core limits what correction adds.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        settings: TrackerSettings | None = None,
        told: Callable[[float], Array] | None = None,
    ) -> None:
        """`told` is the twist (3,) to tell a robot which, but for its lag, shall move as at a time.

        That of the trajectory, unless it is given.
        """
        settings = settings or TrackerSettings()
        self.trajectory = trajectory
        self._lag_s = settings.lag_s
        self._told = told or self._shall
        self._pid = Pid(settings.along, settings.across, settings.heading)

    def feed_forward(self, t_s: float) -> Array:
        """Return the body twist (3,) to command at `t_s` when nothing is measured: open loop."""
        return self._told(t_s + self._lag_s)

    def advance(self, t_s: float, pose: SE2, dt_s: float, ahead_s: float = 0.0) -> Array:
        """Return the body twist (..., 3) to command when the robot is at `pose` (...) at `t_s`.

        `dt_s` is the time since the last call; the command is meant for `ahead_s` later.
        """
        reference = self.trajectory.at(t_s)
        error = errors(reference, pose)
        correction = self._pid.advance(error, dt_s)
        ahead = self.feed_forward(t_s + ahead_s)
        wanted = SE2(reference.pose).rotate(ahead[:2])
        along = SE2(np.array([0.0, 0.0, float(reference.direction)]))
        world = wanted + along.rotate(correction[..., :2])
        out = np.empty(np.shape(pose.xy_heading))
        out[..., :2] = pose.inverse().rotate(world)
        out[..., 2] = ahead[2] + correction[..., 2]
        return out

    def _shall(self, t_s: float) -> Array:
        return self.trajectory.at(t_s).twist


def errors(reference: Reference, pose: SE2) -> Array:
    """Return what is left to the reference (..., 3): along and across the path, and the heading.

    Across is positive when the path lies to the left of the robot.
    """
    off = reference.pose - pose.xy_heading
    c, s = np.cos(reference.direction), np.sin(reference.direction)
    return np.stack(
        [
            c * off[..., 0] + s * off[..., 1],
            c * off[..., 1] - s * off[..., 0],
            wrap(off[..., 2]),
        ],
        axis=-1,
    )
