"""State estimation: wheel odometry, other odometry, pose filters and the consistency test.

Errors flow from `joint_errors` through `wheel_odometry` and `odometry_kinds` (errors of the twist)
to `pose_uncertainty` (errors of the pose); `pose_fusion` corrects the pose with `pose_filter` and
estimates biases with `bias_filter`.
"""

from __future__ import annotations

from tsd_twin.estimation.bias_filter import BiasFilter
from tsd_twin.estimation.consistency import ConsistencyMonitor, ConsistencyResult
from tsd_twin.estimation.drift_filter import DriftFilter
from tsd_twin.estimation.odometry_kinds import (
    AGE_SHARE,
    GyroOdometry,
    ReportedOdometry,
    sensor_odometry_of,
    with_gyro,
)
from tsd_twin.estimation.outage import OUTAGE_S, CoastStep, MeasurementOutage
from tsd_twin.estimation.pose_filter import PoseFilter
from tsd_twin.estimation.pose_fusion import FusedEstimate, FusionResult
from tsd_twin.estimation.pose_uncertainty import (
    REGION_SHARE,
    PoseErrors,
    TwistErrors,
    exponential_error,
    heading_region_rad,
    position_region,
)
from tsd_twin.estimation.sensor_correction import SensorCorrection
from tsd_twin.estimation.wheel_odometry import PlanarOdometry, WheelOdometry, WheelSpeedModel

__all__ = [
    "AGE_SHARE",
    "OUTAGE_S",
    "REGION_SHARE",
    "BiasFilter",
    "CoastStep",
    "ConsistencyMonitor",
    "ConsistencyResult",
    "DriftFilter",
    "FusedEstimate",
    "FusionResult",
    "GyroOdometry",
    "MeasurementOutage",
    "PlanarOdometry",
    "PoseErrors",
    "PoseFilter",
    "ReportedOdometry",
    "SensorCorrection",
    "TwistErrors",
    "WheelOdometry",
    "WheelSpeedModel",
    "exponential_error",
    "heading_region_rad",
    "position_region",
    "sensor_odometry_of",
    "with_gyro",
]
