"""Geometry compiled into the firmware, and its comparison with a robot description."""

from __future__ import annotations

import numpy as np

from tsd_twin.hardware.dynamixel.control_table import ESCS, Geometry
from tsd_twin.hardware.joints import padded
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.robots import SingularityDescription

_TOLERANCE = 0.1
"""Maximum difference relative to the largest value of an item, to allow for calibration."""
_KEYS: dict[str, tuple[str, float]] = {
    "wheel_radius_um": ("drive.wheel_radius_m", 1e-6),
    "pivot_x": ("x_m of the modules", 1e-4),
    "pivot_y": ("y_m of the modules", 1e-4),
    "cruise_rpm": ("drive.cruise_speed_rpm", 1.0),
    "max_tilt": ("drive.max_tilt_deg", 0.01),
    "servo_steps": ("servo.steps_per_turn", 1.0),
    "speed": ("limits.speed_mps", 1e-3),
    "turn_rate": ("limits.turn_rate_rad_per_s", 1e-3),
    "acceleration": ("limits.acceleration_mps2", 1e-3),
    "angular_acceleration": ("limits.angular_acceleration_rad_per_s2", 0.01),
}
"""Key in the robot file and unit of each item."""


def compiled_geometry(robot: SingularityDescription) -> Geometry:
    """Return the geometry that firmware for a robot with at most three modules contains."""
    drive, limits = robot.drive, robot.limits
    pivots = np.round(1e4 * drive.pivots_m).astype(int)
    ratio = np.array(drive.spin_ratio or [1.0] * drive.modules)
    rpm = np.round(drive.cruise_speed_rpm * ratio).astype(int)
    return Geometry(
        wheel_radius_um=round(1e6 * drive.wheel_radius_m),
        pivot_x=padded(pivots[:, 0].tolist(), ESCS, 0),
        pivot_y=padded(pivots[:, 1].tolist(), ESCS, 0),
        cruise_rpm=padded(rpm.tolist(), ESCS, 0),
        max_tilt=round(100.0 * drive.max_tilt_deg),
        servo_steps=robot.servo.steps_per_turn,
        speed=round(1e3 * limits.speed_mps),
        turn_rate=round(1e3 * limits.turn_rate_rad_per_s),
        acceleration=round(1e3 * limits.acceleration_mps2),
        angular_acceleration=round(1e2 * limits.angular_acceleration_rad_per_s2),
    )


def geometry_fault(board: Geometry, robot: Geometry) -> Reason | None:
    """Return the reason why a board must not drive a robot, or None if it was built for it.

    Under PC control the gimbal goals come from the PC, but the radio control can take over at any
    time and then drives the geometry of the firmware.
    """
    for name, (key, unit) in _KEYS.items():
        theirs, ours = (np.atleast_1d(getattr(it, name)) for it in (board, robot))
        # A difference by one unit is rounding.
        if (np.abs(ours - theirs) > max(1.0, _TOLERANCE * np.abs(ours).max())).any():
            return because(
                Code.BOARD_GEOMETRY,
                item=key,
                board=_text(theirs * unit),
                robot=_text(ours * unit),
            )
    return None


def _text(values: np.ndarray) -> str:
    return ", ".join(f"{value:.6g}" for value in values)
