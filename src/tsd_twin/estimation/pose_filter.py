"""A pose from twists, and from what else is measured, each at the time it was measured.

An extended Kalman filter on x, y and heading (Thrun, Burgard, Fox, "Probabilistic Robotics", 2005,
section 3.3). What comes late is fused where it belongs: the filter goes back to that time, and runs
again over all that has come since.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from tsd_twin.drives import Drive
from tsd_twin.lie import SE2, Array, wrap

_POSITION = np.eye(3)[:2]
_HEADING = np.eye(3)[2:]
_POSE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class _Measurement:
    """`value` (..., j) of the parts of the pose that `rows` (j, 3) picks, with a covariance."""

    rows: Array
    value: Array
    covariance: Array


@dataclass(slots=True, eq=False)
class _Step:
    """What drives the filter up to one time, what is measured there, and what comes of it."""

    end_s: float
    twist: Array
    growth_per_s: Array
    pose: Array
    covariance: Array
    measured: list[_Measurement] = field(default_factory=list[_Measurement])


class PoseFilter:
    """Pose and covariance in the world, at the time of the newest twist.

    All arrays may have leading batch dimensions, the same for all. Times are seconds of one clock
    and rise from twist to twist.
    """

    def __init__(
        self,
        drive: Drive[SE2],
        pose: SE2,
        covariance: Array | None = None,
        *,
        now_s: float = 0.0,
        memory_s: float = 1.0,
    ) -> None:
        self._drive = drive
        self._memory_s = memory_s
        start = np.array(pose.xy_heading, dtype=float)
        spread = np.zeros((*start.shape, 3)) if covariance is None else np.array(covariance)
        none = np.zeros_like(start)
        self._steps = [_Step(now_s, none, np.zeros((*start.shape, 3)), start, spread)]

    @property
    def now_s(self) -> float:
        """Time of the newest twist."""
        return self._steps[-1].end_s

    @property
    def pose(self) -> SE2:
        """The estimate."""
        return SE2(self._steps[-1].pose)

    @property
    def covariance(self) -> Array:
        """(..., 3, 3): of x, y, heading."""
        return self._steps[-1].covariance

    def advance(self, now_s: float, twist: Array, growth_per_s: Array) -> None:
        """Move on to `now_s` with the mean `twist` (..., 3) since the last time.

        `growth_per_s` (..., 3, 3) is what a second of such twists adds to the covariance of a pose,
        in the body frame: of white noise with the covariance S in each sample of dt, S times dt.
        """
        if not now_s > self.now_s:
            return
        last = self._steps[-1]
        step = _Step(now_s, np.array(twist), np.array(growth_per_s), last.pose, last.covariance)
        self._steps.append(step)
        self._run(len(self._steps) - 1)
        # One step older than the memory stays: what happened since is what is between.
        oldest = now_s - self._memory_s
        while len(self._steps) > 2 and self._steps[1].end_s <= oldest:
            del self._steps[0]

    def fuse_heading(self, heading: Array, sigma: float, measured_s: float | None = None) -> bool:
        """Take in headings (...), radians; False: older than the memory, or not finite."""
        value = np.asarray(heading, dtype=float)[..., None]
        return self._fuse(_Measurement(_HEADING, value, np.array([[sigma**2]])), measured_s)

    def fuse_position(self, xy: Array, sigma_m: float, measured_s: float | None = None) -> bool:
        """Take in positions (..., 2), metres; False: as in `fuse_heading`."""
        covariance = sigma_m**2 * np.eye(2)
        return self._fuse(
            _Measurement(_POSITION, np.array(xy, dtype=float), covariance), measured_s
        )

    def fuse_pose(self, pose: SE2, covariance: Array, measured_s: float | None = None) -> bool:
        """Take in outside poses with a covariance (..., 3, 3); False: as in `fuse_heading`."""
        value = np.array(pose.xy_heading, dtype=float)
        return self._fuse(_Measurement(_POSE, value, np.array(covariance)), measured_s)

    def _fuse(self, measurement: _Measurement, measured_s: float | None) -> bool:
        at_s = self.now_s if measured_s is None else min(measured_s, self.now_s)
        if not np.isfinite(measurement.value).all() or not at_s >= self._steps[0].end_s:
            return False
        index = bisect_right([step.end_s for step in self._steps], at_s) - 1
        if self._steps[index].end_s < at_s:
            index += 1
            self._split(index, at_s)
        self._steps[index].measured.append(measurement)
        if index == 0:
            step = self._steps[0]
            step.pose, step.covariance = _corrected(step.pose, step.covariance, measurement)
            index = 1
        for i in range(index, len(self._steps)):
            self._run(i)
        return True

    def _split(self, index: int, at_s: float) -> None:
        """Cut the step at `index` in two: a first that ends at `at_s`, and the rest."""
        step = self._steps[index]
        first = _Step(at_s, step.twist, step.growth_per_s, step.pose, step.covariance)
        self._steps.insert(index, first)

    def _run(self, index: int) -> None:
        before, step = self._steps[index - 1], self._steps[index]
        dt_s = step.end_s - before.end_s
        pose = self._drive.move(SE2(before.pose), step.twist, dt_s).xy_heading
        off = pose - before.pose
        carry = np.zeros((*off.shape, 3)) + np.eye(3)
        carry[..., 0, 2], carry[..., 1, 2] = -off[..., 1], off[..., 0]
        # The noise of the twist, seen from the middle of the way.
        middle = before.pose[..., 2] + 0.5 * off[..., 2]
        turn = np.zeros((*off.shape, 3)) + np.eye(3)
        turn[..., 0, 0] = turn[..., 1, 1] = np.cos(middle)
        turn[..., 1, 0] = np.sin(middle)
        turn[..., 0, 1] = -turn[..., 1, 0]
        covariance = carry @ before.covariance @ _transposed(carry)
        covariance = covariance + dt_s * (turn @ step.growth_per_s @ _transposed(turn))
        for measurement in step.measured:
            pose, covariance = _corrected(pose, covariance, measurement)
        step.pose, step.covariance = pose, covariance


def _corrected(pose: Array, covariance: Array, measurement: _Measurement) -> tuple[Array, Array]:
    """Return pose and covariance after a measurement, in Joseph's form: it stays symmetric."""
    rows = measurement.rows
    off = measurement.value - pose @ rows.T
    heading = rows[:, 2] != 0.0
    off[..., heading] = wrap(off[..., heading])
    innovation: Array = rows @ covariance @ rows.T + measurement.covariance
    gain = _transposed(np.asarray(np.linalg.solve(innovation, rows @ covariance), dtype=float))
    keep = np.eye(3) - gain @ rows
    corrected = keep @ covariance @ _transposed(keep)
    corrected = corrected + gain @ measurement.covariance @ _transposed(gain)
    return pose + (gain @ off[..., None])[..., 0], corrected


def _transposed(matrices: Array) -> Array:
    return np.swapaxes(matrices, -1, -2)


def with_gyro(
    twist: Array, covariance: Array, turn_rate: Array, sigma_rad_per_s: float
) -> tuple[Array, Array]:
    """Return planar twists (..., 3) and covariances, corrected by a yaw gyro's `turn_rate` (...).

    The gyro takes part by its share of certainty; what the wheels had wrong in the same way, as a
    slow wheel that both turns and shifts the robot, is corrected with it.
    """
    column = covariance[..., :, 2]
    gain = column / (column[..., 2:] + sigma_rad_per_s**2)
    off = turn_rate - twist[..., 2]
    return twist + gain * off[..., None], covariance - gain[..., :, None] * column[..., None, :]
