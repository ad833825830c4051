"""Joint vectors as they go over the bus: angles in one list, speeds in another."""

from __future__ import annotations

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.lie import Array
from tsd_twin.messages.ros import JointState
from tsd_twin.robots import Robot


class JointStates:
    """Makes messages of what the joints of one robot are told and do, and of its other sensors."""

    def __init__(self, robot: Robot) -> None:
        joints, sensors = robot.kinematics().joints, robot.sensors
        self._names = [joint.name for joint in joints]
        self._is_angle = np.array([joint.kind is JointKind.POSITION for joint in joints])
        self._sensors = [sensor.name for sensor in sensors]
        self._sensor_is_angle = [sensor.kind is JointKind.POSITION for sensor in sensors]

    def measured(self, joints: Array, rates: Array, sensors: Array, stamp_ns: int) -> JointState:
        """Return measured joints (n,), how fast they change (n,), and other sensors (s,)."""
        state = self._state(joints, rates, stamp_ns)
        if not self._sensors:
            return state
        is_angle = self._sensor_is_angle
        return JointState(
            [*state.names, *self._sensors],
            np.append(state.position_rad, np.where(is_angle, sensors, np.nan)),
            np.append(state.velocity_rad_per_s, np.where(is_angle, np.nan, sensors)),
            stamp_ns,
        )

    def told(self, setpoint: Array, stamp_ns: int) -> JointState:
        """Return a set-point (n,)."""
        return self._state(setpoint, np.full(len(setpoint), np.nan), stamp_ns)

    def _state(self, joints: Array, rates: Array, stamp_ns: int) -> JointState:
        position = np.where(self._is_angle, joints, np.nan)
        return JointState(self._names, position, np.where(self._is_angle, rates, joints), stamp_ns)
