"""Pose sensor: its table."""

from __future__ import annotations

from tsd_twin.tables import NotNegative, Positive, Table


class PoseSensor(Table, frozen=True):
    """`[pose_sensor]`: noise of an external pose sensor, such as an overhead camera.

    Defaults match the camera simulated by `tsd-lab` and `tsd-mock --camera`.
    """

    sigma_m: Positive = 0.005
    """Standard deviation of x and y."""
    sigma_deg: Positive = 1.15
    """Standard deviation of the heading."""
    mounting_m: NotNegative = 0.01
    """Standard deviation of the bias in x and y, from the mounting position."""
    mounting_deg: NotNegative = 0.5
    """Standard deviation of the bias in the heading."""
