"""What a page is told about gimbals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.dashboard.link import Snapshot
from tsd_twin.dashboard.protocol import Gears, Module
from tsd_twin.lie import Array
from tsd_twin.robots import RPM, SingularityRobot

SPINNING = 0.01
"""A wheel that turns with less than this share of its cruising speed is shown as at rest."""
_ROUNDING = 1e-6


class GimbalFigures:
    """Angles, tilt and leaning axle of each module, as it is and as it should be."""

    def __init__(self, robot: SingularityRobot) -> None:
        self._robot = robot
        self._drive = robot.kinematics()
        # From the module frame of the kinematics to the robot's: a turn by azimuth - pi/2.
        turn = self._drive.azimuths_rad - np.pi / 2
        c, s = np.cos(turn), np.sin(turn)
        self._base_from_module = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)

    def card(self) -> dict[str, Any]:
        """Return what belongs into a card."""
        gears = self._robot.gears
        return {
            "panel": "gimbals",
            "max_tilt_deg": self._robot.drive.max_tilt_deg,
            "modules": self._drive.actuators,
            "gears": Gears(
                least_rpm=math.ceil(gears.least_rad_per_s / RPM - _ROUNDING),
                most_rpm=math.floor(gears.most_rad_per_s / RPM + _ROUNDING),
                usual_rpm=round(self._drive.spin_rad_per_s / RPM),
                wheel_radius_m=self._drive.wheel_radius_m,
                servo_step_deg=math.degrees(gears.servo_step_rad),
            ),
        }

    def state(self, joints: Array, setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return what belongs into a state."""
        measured, wanted = joints.reshape(-1, 3), setpoint.reshape(-1, 3)
        degrees, wanted_degrees = np.degrees(measured), np.degrees(wanted)
        tilt = np.degrees(self._drive.tilt(joints))
        radius_mm = 1000.0 * self._drive.effective_radius_m(joints)
        axles, wanted_axles = self._axles(joints), self._axles(setpoint)
        slow = SPINNING * self._drive.spin_rad_per_s
        modules = [
            Module(
                alpha=round(float(degrees[i, 0]), 2),
                beta=round(float(degrees[i, 1]), 2),
                tilt=round(float(tilt[i]), 2),
                radius_mm=round(float(radius_mm[i]), 2),
                rpm=round(float(measured[i, 2]) / RPM),
                set_alpha=round(float(wanted_degrees[i, 0]), 2),
                set_beta=round(float(wanted_degrees[i, 1]), 2),
                axle=(round(float(axles[i, 0]), 4), round(float(axles[i, 1]), 4)),
                set_axle=(round(float(wanted_axles[i, 0]), 4), round(float(wanted_axles[i, 1]), 4)),
                spinning=bool(abs(measured[i, 2]) > slow),
            )
            for i in range(len(measured))
        ]
        return {"modules": modules}

    def _axles(self, joints: Array) -> Array:
        """Return where the axles (k, 2) lean in `base_link`; length 1 is the tilt limit."""
        modules = joints.reshape(-1, 3)
        alpha, beta = modules[:, 0], modules[:, 1]
        axles = np.stack([np.cos(alpha) * np.sin(beta), np.sin(alpha)], axis=-1)
        lean = (self._base_from_module @ axles[..., None])[..., 0]
        return lean / np.sin(self._drive.max_tilt_rad)
