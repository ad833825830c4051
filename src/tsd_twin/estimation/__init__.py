"""What the robot does, from what it measures."""

from tsd_twin.estimation.conflict import ConflictMonitor, Verdict
from tsd_twin.estimation.odometry import PlanarOdometry
from tsd_twin.estimation.pose_filter import PoseFilter, with_gyro
from tsd_twin.estimation.spin import SpinModel

__all__ = ["ConflictMonitor", "PlanarOdometry", "PoseFilter", "SpinModel", "Verdict", "with_gyro"]
