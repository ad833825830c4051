"""How errors of poses hang together that come from joints whose noise adds up on the way."""

from __future__ import annotations

import numpy as np

from tsd_twin.drives import SingularityDrive
from tsd_twin.lab.recording import Recording
from tsd_twin.lie import Array
from tsd_twin.robots.robot import JointErrors
from tsd_twin.sim import CameraNoise

_KNOT_S = 0.2
"""The walk of the pose is taken to go in steps of this."""
_MEANS = 120
"""No more of a run: frames that follow one another say much the same, and time goes by its cube."""


class Whitening:
    """Makes residuals of one run independent, and of unit variance.

    What a camera sees is as far off as the last time in no way; what the joints tell is: a heading
    that has once gone astray turns all that follows. Left out, a fit believes itself too well.
    """

    def __init__(
        self, drive: SingularityDrive, run: Recording, camera: CameraNoise, joints: JointErrors
    ) -> None:
        sigma = np.array([camera.sigma_m, camera.sigma_m, camera.sigma_rad])
        self._frames = len(run.seen_s)
        self._each = -(-self._frames // _MEANS)
        walk = self._means(self._walk(drive, run, joints.angle_rad))
        own = np.tile(np.square(sigma) / self._each, len(walk) // 3)
        covariance = walk @ walk.T + np.diag(own)
        self._unmix = np.linalg.inv(np.linalg.cholesky(covariance))

    def __call__(self, residual: Array) -> Array:
        """Return independent residuals from those of the frames (3 m,), or columns (3 m, c)."""
        return self._unmix @ self._means(residual)

    def _means(self, values: Array) -> Array:
        """Return means (3 g, ...) over neighbouring frames; what is left over is left out."""
        many = self._frames // self._each
        used = values[: 3 * many * self._each]
        by_frame = used.reshape(many, self._each, 3, *values.shape[1:])
        return by_frame.mean(axis=1).reshape(3 * many, *values.shape[1:])

    def _walk(self, drive: SingularityDrive, run: Recording, angle_rad: float) -> Array:
        """Return (3 m, 3 g): what a step of unit variance at each of g knots does to the poses."""
        knots = np.arange(run.t_s[0], run.t_s[-1], _KNOT_S)
        here = np.column_stack([np.interp(knots, run.seen_s, run.seen[:, i]) for i in (0, 1)])
        rim_mps = drive.wheel_radius_m * np.abs(run.told_rad_per_s).max(axis=0)
        by_angle = drive.twist_from_contacts * np.repeat(rim_mps, 2) * angle_rad
        dt_s = float(np.median(np.diff(run.t_s)))
        # Each sample is off by its own: in a knot, the root of their number adds up.
        x, y, heading = np.sqrt(np.square(by_angle).sum(axis=1) * dt_s * _KNOT_S)
        later = (run.seen_s[:, None] > knots).astype(float)
        steps = np.zeros((len(run.seen_s), 3, len(knots), 3))
        steps[:, 0, :, 0] = steps[:, 1, :, 1] = later * max(x, y)
        steps[:, 0, :, 2] = -later * heading * (run.seen[:, None, 1] - here[:, 1])
        steps[:, 1, :, 2] = later * heading * (run.seen[:, None, 0] - here[:, 0])
        steps[:, 2, :, 2] = later * heading
        return steps.reshape(3 * len(run.seen_s), -1)
