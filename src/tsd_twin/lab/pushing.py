"""What to tell a robot whose wheels have to push it, so that it moves as it shall."""

from __future__ import annotations

import numpy as np

from tsd_twin.estimation import Slip
from tsd_twin.lie import Array
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.robots import RPM, SingularityRobot

_STEP_S = 0.005


class Pushing:
    """Twists that move a robot of some mass along a trajectory, over a floor that it slides on.

    Wheels have to roll ahead of the body to push it, spin slower the more they have pushed, and
    lean aside under what they push with: a servo is a spring, whose stiffness follows from its
    torque and its approach to a goal. All of that is known from the trajectory beforehand.
    """

    def __init__(self, robot: SingularityRobot, slip: Slip, trajectory: Trajectory) -> None:
        drive, slip = robot.kinematics(), slip.later(0.0)
        self._twist_from_contacts = drive.twist_from_contacts
        servo = robot.servo
        stiffness_nm = servo.stall_torque_nm * servo.approach_rate_per_s
        stiffness_nm /= servo.no_load_speed_rpm * RPM
        # The floor turns a gimbal by the force times a radius, and the tilt moves the wheel by its
        # spin times a radius, at right angles to the force.
        self._aside_mps_per_n = drive.wheel_radius_m**2 * drive.spin_rad_per_s / stiffness_nm
        steps = int(np.ceil(trajectory.duration_s / _STEP_S)) + 1
        self._at_s: Array = _STEP_S * (0.5 + np.arange(steps, dtype=np.float64))
        shall = trajectory.at(self._at_s)
        told: list[Array] = [
            self._push(slip, shall.twist[i], shall.twist_rate[i]) for i in range(steps)
        ]
        self._told: Array = np.stack(told)

    def __call__(self, t_s: float) -> Array:
        """Return the twist (3,) to tell the robot for the time `t_s` of the trajectory."""
        told = self._told
        return np.array([float(np.interp(t_s, self._at_s, told[:, i])) for i in range(3)])

    def _push(self, slip: Slip, twist: Array, rate: Array) -> Array:
        """Return what moves the body by `twist` while that changes, and let a step of it pass."""
        x, y, turn = twist
        over_ground = rate + turn * np.array([-y, x, 0.0])
        rolled, force = slip.push(twist, over_ground, _STEP_S)
        aside = self._aside_mps_per_n * np.stack([-force[:, 1], force[:, 0]], axis=-1)
        # Wheels are told to turn as fast as they do at rest on this floor.
        return self._twist_from_contacts @ (slip.rest_share * rolled - aside).ravel()
