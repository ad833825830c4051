"""What the robot does, from what it measures."""

from tsd_twin.estimation.conflict import ConflictMonitor, Verdict
from tsd_twin.estimation.corrected import CorrectedEstimate, Fate
from tsd_twin.estimation.drift import DriftFilter
from tsd_twin.estimation.gyro import with_gyro
from tsd_twin.estimation.odometry import (
    ODOMETRY,
    JointOdometry,
    OrientationOdometry,
    PlanarOdometry,
)
from tsd_twin.estimation.pose_filter import PoseFilter
from tsd_twin.estimation.second import SECOND, Estimate, SecondEstimate, second_estimate
from tsd_twin.estimation.slip import Slip
from tsd_twin.estimation.spin import SpinModel

__all__ = [
    "ODOMETRY",
    "SECOND",
    "ConflictMonitor",
    "CorrectedEstimate",
    "DriftFilter",
    "Estimate",
    "Fate",
    "JointOdometry",
    "OrientationOdometry",
    "PlanarOdometry",
    "PoseFilter",
    "SecondEstimate",
    "Slip",
    "SpinModel",
    "Verdict",
    "second_estimate",
    "with_gyro",
]
