"""What the robot does, from what it measures."""

from tsd_twin.estimation.conflict import ConflictMonitor
from tsd_twin.estimation.odometry import (
    ODOMETRY,
    JointOdometry,
    OrientationOdometry,
    PlanarOdometry,
)
from tsd_twin.estimation.second import SECOND, Estimate, SecondEstimate, second_estimate
from tsd_twin.estimation.spin import SpinModel

__all__ = [
    "ODOMETRY",
    "SECOND",
    "ConflictMonitor",
    "Estimate",
    "JointOdometry",
    "OrientationOdometry",
    "PlanarOdometry",
    "SecondEstimate",
    "SpinModel",
    "second_estimate",
]
