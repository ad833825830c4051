"""Former places of classes that snapshots in recordings name.

A snapshot is a pickle, so it has the module and the name of each class in it.
"""

from __future__ import annotations

_MODULES = {
    "tsd_twin.control.faults": "tsd_twin.control.monitors",
    "tsd_twin.estimation.pose_spread": "tsd_twin.estimation.pose_uncertainty",
    "tsd_twin.estimation.sensor_odometry": "tsd_twin.estimation.odometry_kinds",
    "tsd_twin.messages.requests": "tsd_twin.messages.commands",
    "tsd_twin.messages.ros": "tsd_twin.messages.cdr",
    "tsd_twin.robots.imported": "tsd_twin.robots.external",
}
"""From the old name of a module to the new one."""
_CLASSES = {
    ("tsd_twin.control.services", "OrientationCodec"): "tsd_twin.control.pose_codec",
    ("tsd_twin.control.services", "PlanarPoseCodec"): "tsd_twin.control.pose_codec",
    ("tsd_twin.control.services", "PoseCodec"): "tsd_twin.control.pose_codec",
    ("tsd_twin.control.services", "WheelSpeedController"): "tsd_twin.control.wheel_spin",
    ("tsd_twin.control.state_estimator", "PoseMeasurements"): "tsd_twin.control.sensor_inputs",
    ("tsd_twin.estimation.sensor_odometry", "DeadReckoning"): "tsd_twin.estimation.sensor_fusion",
    ("tsd_twin.estimation.sensor_odometry", "Estimate"): "tsd_twin.estimation.sensor_fusion",
    ("tsd_twin.estimation.sensor_odometry", "GyroOdometry"): "tsd_twin.estimation.sensor_fusion",
    ("tsd_twin.estimation.sensor_odometry", "SensorOdometry"): "tsd_twin.estimation.sensor_fusion",
    ("tsd_twin.messages.requests", "Event"): "tsd_twin.messages.events",
    ("tsd_twin.messages.requests", "PoseStamped"): "tsd_twin.messages.pose",
    ("tsd_twin.motion.prediction", "TwistLimiter"): "tsd_twin.motion.twist_limiter",
    ("tsd_twin.robots.description", "Gyro"): "tsd_twin.sensors.gyro",
    ("tsd_twin.robots.description", "PoseSensor"): "tsd_twin.sensors.pose",
    ("tsd_twin.robots.description", "Table"): "tsd_twin.tables",
    ("tsd_twin.robots.omni", "DeadWheel"): "tsd_twin.sensors.dead_wheels",
    ("tsd_twin.robots.omni", "DeadWheels"): "tsd_twin.sensors.dead_wheels",
    ("tsd_twin.safety.lease", "CommandGate"): "tsd_twin.safety.command_gate",
    ("tsd_twin.safety.lease", "Overaged"): "tsd_twin.safety.command_gate",
    ("tsd_twin.safety.supervisor", "Mode"): "tsd_twin.messages.modes",
}
"""From a class in its old module to its new module; these take precedence."""


def current(module: str, name: str) -> tuple[str, str]:
    """Return the module and the name that a class has today."""
    return _CLASSES.get((module, name), _MODULES.get(module, module)), name
