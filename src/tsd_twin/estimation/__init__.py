"""What the robot does, from what it measures."""

from tsd_twin.estimation.conflict import ConflictMonitor
from tsd_twin.estimation.odometry import PlanarOdometry
from tsd_twin.estimation.spin import SpinModel

__all__ = ["ConflictMonitor", "PlanarOdometry", "SpinModel"]
