"""State estimation: wheel odometry, other odometry, pose filters and the consistency test."""

from __future__ import annotations

from tsd_twin.estimation.bias_filter import BiasFilter
from tsd_twin.estimation.consistency import ConsistencyMonitor, ConsistencyResult
from tsd_twin.estimation.odometry_kinds import ReportedOdometry, sensor_odometry_of
from tsd_twin.estimation.outage import OUTAGE_S, CoastStep, MeasurementOutage
from tsd_twin.estimation.pose_filter import DriftFilter, PoseFilter
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
from tsd_twin.estimation.sensor_fusion import (
    DeadReckoning,
    Estimate,
    GyroOdometry,
    SensorOdometry,
    with_gyro,
)
from tsd_twin.estimation.wheel_odometry import (
    ODOMETRY,
    OrientationOdometry,
    PlanarOdometry,
    WheelOdometry,
    WheelSpeedModel,
)

__all__ = [
    "ODOMETRY",
    "OUTAGE_S",
    "REGION_SHARE",
    "BiasFilter",
    "CoastStep",
    "ConsistencyMonitor",
    "ConsistencyResult",
    "DeadReckoning",
    "DriftFilter",
    "Estimate",
    "FusedEstimate",
    "FusionResult",
    "GyroOdometry",
    "MeasurementOutage",
    "OrientationOdometry",
    "PlanarOdometry",
    "PoseErrors",
    "PoseFilter",
    "ReportedOdometry",
    "SensorCorrection",
    "SensorOdometry",
    "TwistErrors",
    "WheelOdometry",
    "WheelSpeedModel",
    "exponential_error",
    "heading_region_rad",
    "position_region",
    "sensor_odometry_of",
    "with_gyro",
]
