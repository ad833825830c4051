"""How sure the robot is of where it is."""

from __future__ import annotations

import math

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.rate import Rate
from tsd_twin.lie import Array

SIGMAS = 2.0
_SIDES = 48
_SMALLEST_M = 0.002


class CovarianceEllipse:
    """Two standard deviations of the estimated position, on the floor below the robot."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        angles = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
        circle = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
        self._rate = Rate(5.0)
        self._handle = scene.add_line_segments(
            name,
            np.stack([circle[:-1], circle[1:]], axis=1),
            palette.ESTIMATE,
            thickness=1.5,
            thickness_units="screen",
            scale=_SMALLEST_M,
            position=(0.0, 0.0, 0.003),
        )

    def update(self, covariance: Array, heading_rad: float, now_s: float) -> None:
        """Show a covariance (3, 3) of x, y, heading in `odom`, below a robot with that heading."""
        if not self._rate.due(now_s):
            return
        variances, axes = np.linalg.eigh(covariance[:2, :2])
        radii = np.maximum(SIGMAS * np.sqrt(np.maximum(variances, 0.0)), _SMALLEST_M)
        # A tenth of a millimetre cannot be seen; what is rounded to it is sent when it changes.
        x_m, y_m = (round(float(radius), 4) for radius in radii)
        half = 0.5 * (math.atan2(axes[1, 0], axes[0, 0]) - heading_rad)
        self._handle.scale = (x_m, y_m, 1.0)
        if x_m != y_m:
            self._handle.wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))
