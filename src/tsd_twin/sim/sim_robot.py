"""A simulated robot behind the same face as a real one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import Robot
from tsd_twin.sim.kinds import simulate

_SHORTEST_STEP_S = 1e-9
"""Less is left to the next call: speeds over such a step would be differences of roundings."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What only a simulator knows."""

    pose: SE2 | SO3
    """Pose of the robot in the world."""
    twist: Array
    """(3,): velocity in the base frame, metres and radians a second."""
    joints: Array
    """(n,): joint vector, before steps and noise."""


class SimRobot:
    """Actuators, sensors and body of one robot, in virtual time.

    It stands still until the first call says what time it is, and is moved on to the time of each
    call after that; a time that lies in the past moves nothing. Nothing here looks at a clock.
    `noise` scales the standard deviations of the description; 0 is none. How fast wheels turn is
    measured if robots of this kind do, or as `measures_spin` says. `plant` is what moves it, and
    `errors` scales what is wrong with it: see `simulate`, which also names what is raised.
    """

    def __init__(
        self,
        robot: Robot,
        seed: int | None = 0,
        noise: float = 0.0,
        *,
        measures_spin: bool | None = None,
        battery_v: float | None = None,
        pose: SE2 | SO3 | None = None,
        plant: str = "kinematic",
        errors: float = 0.0,
    ) -> None:
        self._simulation = simulate(
            robot,
            seed=seed,
            noise=noise,
            battery_v=battery_v,
            pose=pose,
            plant=plant,
            errors=errors,
        )
        joints = self._simulation.drive.joints
        measured = robot.measures_spin if measures_spin is None else measures_spin
        self._shape = (len(joints),)
        self._unmeasured = np.flatnonzero(
            [joint.kind is JointKind.VELOCITY and not measured for joint in joints]
        )
        self._facts: dict[str, object] = {
            "kind": "sim",
            "noise": noise,
            "errors": errors,
            "seed": seed,
        }
        self._now_s: float | None = None
        self.delay_s = robot.with_errors(errors).delay_s
        """Time by which the bus makes set-points and measurements late."""

    def read(self, now_s: float) -> Array:
        """Return what is measured, (n + s,): joints, then sensors; NaN is not measured."""
        self._advance(now_s)
        measured = self._simulation.measure()
        measured[self._unmeasured] = np.nan
        return measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Give the actuators their set-points (n,): angles, and wheel speeds; 0 is zero throttle.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        if np.shape(setpoint) != self._shape:
            raise ValueError(
                f"set-points must have the shape {self._shape}, these have {np.shape(setpoint)}"
            )
        self._advance(now_s)
        self._simulation.command(setpoint)

    def truth(self, now_s: float) -> Truth:
        """Return the true state."""
        self._advance(now_s)
        simulation = self._simulation
        return Truth(simulation.pose, simulation.twist(), simulation.joints.copy())

    def hardware(self) -> dict[str, object]:
        """Return facts for the status that JSON can hold."""
        return self._facts | dict(self._simulation.facts())

    def close(self) -> None:
        """Do nothing: there is nothing to let go of."""

    def _advance(self, now_s: float) -> None:
        if self._now_s is None:
            self._now_s = now_s
        elif now_s - self._now_s > _SHORTEST_STEP_S:
            self._simulation.advance(now_s - self._now_s)
            self._now_s = now_s
