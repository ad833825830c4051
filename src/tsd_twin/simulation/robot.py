"""Simulated robot behind the hardware interface, with the watchdog of its board and injected
faults.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation.factory import simulate

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
        robot: RobotDescription,
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
        joints = self._simulation.kinematics.joints
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
        return self._facts | dict(self._simulation.hardware_status())

    def close(self) -> None:
        """Do nothing: there is nothing to let go of."""

    def _advance(self, now_s: float) -> None:
        if self._now_s is None:
            self._now_s = now_s
        elif now_s - self._now_s > _SHORTEST_STEP_S:
            self._simulation.advance(now_s - self._now_s)
            self._now_s = now_s


TIMEOUT_S = 0.25
"""Set-points older than this are not obeyed any more."""


class BoardModel:
    """Passes set-points on to a simulated robot, and trips when they cease.

    `TIMEOUT_S` after the last set-point it puts the actuators at rest by itself, in the middle of
    whatever time has passed when it is asked next. A board that has tripped measures nothing, which
    is a fault to the node, and obeys nothing but zero throttle on all wheels, which ends it: so the
    way back is reset and arm. Where all throttles are zero there is nothing to trip.
    """

    def __init__(self, robot: RobotDescription, simulated: SimRobot) -> None:
        kinematics = robot.kinematics()
        self._simulated = simulated
        self._wheels = np.flatnonzero([j.kind is JointKind.VELOCITY for j in kinematics.joints])
        self._rest = kinematics.inverse(np.zeros(len(kinematics.twist_axes)))
        self._rest[self._wheels] = 0.0
        self._obeyed: Array = self._rest
        self._fed_s = 0.0
        self.tripped = False

    def read(self, now_s: float) -> Array | None:
        """Return the measured joints (n,); None once it has tripped."""
        self._look_at_the_clock(now_s)
        measured = self._simulated.read(now_s)
        return None if self.tripped else measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass a set-point (n,) on, unless it has tripped.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        self._look_at_the_clock(now_s)
        if self.tripped and not setpoint[self._wheels].any():
            self.tripped = False
        if not self.tripped:
            self._simulated.write(setpoint, now_s)
            self._obeyed, self._fed_s = setpoint.copy(), now_s

    def truth(self, now_s: float) -> Truth:
        """Return the true state."""
        self._look_at_the_clock(now_s)
        return self._simulated.truth(now_s)

    def hardware(self) -> Mapping[str, object]:
        """Return facts for the status that JSON can hold."""
        return {**self._simulated.hardware(), "tripped": self.tripped}

    def close(self) -> None:
        """Close what is behind it."""
        self._simulated.close()

    def _look_at_the_clock(self, now_s: float) -> None:
        spins = bool(self._obeyed[self._wheels].any())
        if spins and not self.tripped and now_s - self._fed_s > TIMEOUT_S:
            self.tripped = True
            self._obeyed = self._rest
            self._simulated.write(self._rest, self._fed_s + TIMEOUT_S)


USUAL_LEAN_DEG = 2.0


@dataclass(frozen=True, slots=True)
class StuckJoint:
    """A servo that turns no more, whatever it is told, once its gimbal leans so far."""

    joint: str
    lean_rad: float = 0.0

    @staticmethod
    def parse(text: str, robot: RobotDescription) -> StuckJoint:
        """Return the jam in `module2_alpha` or `module2_alpha@3`, where 3 is in degrees.

        Raises:
            TwinError: it is none, or the robot has no such gimbal.
        """
        joint, _, lean = text.partition("@")
        gimbals = [j.name for j in robot.kinematics().joints if j.kind is JointKind.POSITION]
        if joint not in gimbals:
            there = f"there are {', '.join(gimbals)}" if gimbals else "it has none"
            raise TwinError(f"--jam: '{joint}' is no gimbal of {robot.name}: {there}")
        try:
            lean_deg = float(lean) if lean else USUAL_LEAN_DEG
        except ValueError:
            lean_deg = math.nan
        if not 0.0 <= lean_deg < 90.0:
            raise TwinError(f"--jam: '{lean}' has to be degrees, from 0 to less than 90")
        return StuckJoint(joint, math.radians(lean_deg))


class RobotWithStuckJoint(SimRobot):
    """A simulated robot with gimbals that stick; all else is as it was."""

    def __init__(
        self, robot: RobotDescription, jams: Sequence[StuckJoint] = (), **kwargs: Any
    ) -> None:
        """Take what a `SimRobot` takes besides."""
        super().__init__(robot, **kwargs)
        self._names = [joint.name for joint in robot.kinematics().joints]
        self._leans: dict[int, float] = {}
        self._held: dict[int, float] = {}
        for jam in jams:
            self.jam(jam)

    def jam(self, jam: StuckJoint) -> None:
        """Let a gimbal stick from now on."""
        self._leans[self._names.index(jam.joint)] = jam.lean_rad

    def write(self, setpoint: Array, now_s: float) -> None:
        """Give the actuators their set-points (n,), those that stick the one that they are at."""
        if not self._leans:
            super().write(setpoint, now_s)
            return
        joints = self.truth(now_s).joints
        for place, lean_rad in self._leans.items():
            if abs(joints[place]) >= lean_rad:
                self._held.setdefault(place, float(joints[place]))
        if self._held and np.shape(setpoint) == np.shape(joints):
            setpoint = setpoint.copy()
            setpoint[list(self._held)] = list(self._held.values())
        super().write(setpoint, now_s)
