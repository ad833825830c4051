"""Simulated robot that a node runs, and the watchdog of its board."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import RobotDescription, SingularityDescription, description_of_kind
from tsd_twin.simulation.factory import simulate

_MIN_STEP_S = 1e-9
"""Minimum integration step, below which rounding errors dominate the speeds."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulationTruth:
    """Ground truth of a simulated robot."""

    pose: SE2 | SO3
    """Pose of the robot in the world."""
    twist: Array
    """(3,): velocity in the base frame, m/s and rad/s."""
    joints: Array
    """(n,): joint vector, before quantization and noise."""


class SimRobot:
    """Simulated robot in virtual time: actuators, sensors and body.

    The first call sets the time; each later call integrates the motion up to its time. Times in the
    past have no effect.

    `noise` scales the described standard deviations. Wheel speeds are measured if robots of this
    kind do so, unless `measures_spin` overrides it. For `plant`, `errors` and exceptions see
    `simulate`.

    The controller is configured with the description `believed`, by default that of the robot. The
    interface carries servo angles and throttles, and each side converts them to joints by its own
    `[calibration]`.
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
        believed: SingularityDescription | None = None,
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
        self._offsets = None
        if believed is not None:
            own = description_of_kind(robot, SingularityDescription)
            self._offsets = own.actuator_offsets(), believed.actuator_offsets()
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
        """Bus delay of setpoints and measurements."""

    def read(self, now_s: float) -> Array:
        """Return the measurements (n + s,): joints, then sensors; NaN if not measured."""
        self._advance(now_s)
        measured = self._simulation.measure()
        measured[self._unmeasured] = np.nan
        if self._offsets is not None:
            (own, believed), count = self._offsets, self._shape[0]
            measured[:count] = believed.from_servos(own.to_servos(measured[:count]))
        return measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Command the setpoints (n,): angles, and wheel speeds, where 0 is zero throttle.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        if np.shape(setpoint) != self._shape:
            raise ValueError(
                f"set-points must have the shape {self._shape}, these have {np.shape(setpoint)}"
            )
        self._advance(now_s)
        if self._offsets is not None:
            own, believed = self._offsets
            setpoint = own.from_actuators(believed.to_actuators(setpoint))
        self._simulation.command(self._reachable(setpoint))

    def truth(self, now_s: float) -> SimulationTruth:
        """Return the true state."""
        self._advance(now_s)
        simulation = self._simulation
        return SimulationTruth(simulation.pose, simulation.twist(), simulation.joints.copy())

    def hardware(self) -> dict[str, object]:
        """Return JSON-serializable facts for the status."""
        return self._facts | dict(self._simulation.hardware_status())

    def close(self) -> None:
        """Do nothing, because the simulation holds no resources."""

    def _reachable(self, setpoint: Array) -> Array:
        """Return the setpoints (n,) that the joints can follow."""
        return setpoint

    def _advance(self, now_s: float) -> None:
        if self._now_s is None:
            self._now_s = now_s
        elif now_s - self._now_s > _MIN_STEP_S:
            self._simulation.advance(now_s - self._now_s)
            self._now_s = now_s


TIMEOUT_S = 0.25
"""Timeout of the command watchdog."""


class BoardModel:
    """Controller board with a command watchdog, in front of a simulated robot.

    `TIMEOUT_S` after the last setpoint, the watchdog trips and stops the actuators, even between
    two calls. A tripped board returns no measurements, which is a fault for the node. It ignores
    setpoints until all wheels are at zero throttle, so the operator must reset and arm. At zero
    throttle on all wheels the watchdog does not trip.
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
        """Return the measured joints (n,), or None if the watchdog has tripped."""
        self._check_watchdog(now_s)
        measured = self._simulated.read(now_s)
        return None if self.tripped else measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Forward a setpoint (n,), unless the watchdog has tripped.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        self._check_watchdog(now_s)
        if self.tripped and not setpoint[self._wheels].any():
            self.tripped = False
        if not self.tripped:
            self._simulated.write(setpoint, now_s)
            self._obeyed, self._fed_s = setpoint.copy(), now_s

    def truth(self, now_s: float) -> SimulationTruth:
        """Return the true state."""
        self._check_watchdog(now_s)
        return self._simulated.truth(now_s)

    def hardware(self) -> Mapping[str, object]:
        """Return JSON-serializable facts for the status."""
        return {**self._simulated.hardware(), "tripped": self.tripped}

    def close(self) -> None:
        """Close the simulated robot."""
        self._simulated.close()

    def _check_watchdog(self, now_s: float) -> None:
        is_late = now_s - self._fed_s > TIMEOUT_S  # First, because it is rarely so.
        if is_late and not self.tripped and self._obeyed[self._wheels].any():
            self.tripped = True
            self._obeyed = self._rest
            self._simulated.write(self._rest, self._fed_s + TIMEOUT_S)
