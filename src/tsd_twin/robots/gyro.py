"""The description of a yaw gyro."""

from __future__ import annotations

from tsd_twin.robots.robot import NotNegative, Positive, Table


class Gyro(Table, frozen=True):
    """`[gyro]`: measures how fast the robot turns about the vertical.

    As given: of a small MEMS gyro, by the data sheet of the Bosch BMI270 (0.007 deg/s/sqrt(Hz)).
    """

    noise_rad_per_s: Positive = 0.0012
    """Standard deviation of one reading, at the 100 Hz of the core."""
    bias_rad_per_s: NotNegative = 0.0005
    """Standard deviation of the offset, which stays for the run: what is left after a second at
    rest."""
