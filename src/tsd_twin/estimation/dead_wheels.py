"""The pose of a robot by wheels that are not driven, and a gyro."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.drives import Motion
from tsd_twin.estimation.odometry import PlanarOdometry
from tsd_twin.lie import Array
from tsd_twin.robots import OmniRobot


class DeadWheelOdometry(PlanarOdometry):
    """Two encoders in L and a rate gyro: driven wheels may slip, these do not.

    Source: Savnani et al. 2019, Eq. 12 to 16: distances from pulses, heading from the gyro. Eq. 14
    and 15 as printed hold for a straight line only; here twist and pose follow in the robot frame.
    In a step without these sensors the robot is taken to move as its driven wheels say.
    """

    def __init__(self, robot: OmniRobot) -> None:
        """Prepare for the dead wheels of `robot`.

        Raises:
            ValueError: it has none.
        """
        if robot.dead_wheels is None:
            raise ValueError(f"{robot.name} has no dead wheels")
        super().__init__(robot.kinematics(), robot.joint_errors())
        sensors = robot.dead_wheels
        wheels = np.array(sensors.rows()) / sensors.radius_m
        self._twist_from_rates = np.linalg.inv(np.vstack([wheels, [0.0, 0.0, 1.0]]))
        self._angles: Array | None = None
        self._rate = 0.0
        # A pulse, evenly spread, over the time that errors persist; the drift of the gyro.
        pulse = 2.0 * math.pi / sensors.pulses_per_turn / math.sqrt(12.0)
        drift = math.radians(sensors.gyro_drift_deg_per_h) / 3600.0
        spread = self._twist_from_rates * [pulse, pulse, drift]
        self._covariance = spread @ spread.T

    def follow(self, joints: Array, sensors: Array, motion: Motion, dt_s: float) -> None:
        """Take in both angles and the rate, (3,), measured `dt_s` after the last ones."""
        twist = motion.twist
        if len(sensors) == 3 and np.isfinite(sensors).all():
            if self._angles is not None:
                turned = (sensors[:2] - self._angles) / dt_s
                rate = 0.5 * (self._rate + sensors[2])
                twist = self._twist_from_rates @ np.array([turned[0], turned[1], rate])
            self._angles, self._rate = sensors[:2].copy(), float(sensors[2])
        else:
            self._angles = None
        self.motion = Motion(twist, np.zeros(0))
        moved = self._drive.move(self.pose, twist, dt_s)
        self._spread(moved, joints, dt_s)
        self.pose = moved

    def _twist_covariance(self, joints: Array) -> Array:  # noqa: ARG002  The shape.
        return self._covariance
