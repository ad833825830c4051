"""Online estimation of a robot's biases with an extended Kalman filter.

The filter also tracks a pose, but does not affect the pose estimate in `pose_fusion.py`. Derived in
`docs/estimation.md`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tsd_twin.estimation.consistency import is_plausible
from tsd_twin.estimation.pose_uncertainty import PlanarBlock, PoseErrors, TwistErrors
from tsd_twin.estimation.sensor_correction import LinearReading
from tsd_twin.lie import SE2, Array, wrap

_STEPS_KEPT = 128
"""Steps buffered for late poses: more than one second."""
_FORGET_S = 600.0
"""Time constant of bias changes, such as a sagging battery."""

CAUTION = 0.005
"""Additional twist error per second, relative to the twist: printed wheel layers, gimbal dead
bands."""


class _BiasStep(NamedTuple):
    end_s: float
    twist: Array
    errors: TwistErrors


class BiasFilter:
    """Extended Kalman filter for the biases of `TwistErrors` and the resulting pose.

    It integrates the same twists as the pose estimate, corrected by the biases estimated so far, up
    to the time of the latest measured pose. Late poses therefore need no recomputation; poses older
    than the last one are ignored.
    """

    def __init__(self, biases: int) -> None:
        self._state: Array = np.zeros(3 + biases)
        """(3 + m,): pose and biases."""
        self._covariance: Array = np.diag([0.0] * 3 + [1.0] * biases)
        self._steps: deque[_BiasStep] = deque()
        self._at_s: float | None = None
        """Time of the pose, or None before the first."""
        self._measured_s: float | None = None
        """Time of the last comparison."""
        self._errors = TwistErrors.none(biases)
        self._begin()

    @property
    def has_measured(self) -> bool:
        """Whether any measurement has been fused."""
        return self._at_s is not None or self._measured_s is not None

    @property
    def biases(self) -> Array:
        """(m,): estimated biases, relative to their described standard deviations."""
        return self._state[3:]

    @property
    def covariance(self) -> Array:
        """(m, m): covariance of `biases`."""
        return self._covariance[3:, 3:]

    def learned(self, rows: Mapping[str, Array]) -> dict[str, tuple[float, float]]:
        """Return value and standard deviation of named biases with Jacobian rows (m,) `rows`."""
        return {
            name: (float(row @ self.biases), math.sqrt(float(row @ self.covariance @ row)))
            for name, row in rows.items()
        }

    def follow(self, now_s: float, twist: Array, errors: TwistErrors) -> None:
        """Add a step to `now_s` with the mean `twist` (3,) and its `errors`."""
        if self._at_s is None:
            return  # Without a pose, twists carry no information.
        self._steps.append(_BiasStep(now_s, twist, errors))
        if len(self._steps) > _STEPS_KEPT:
            self._carry(self._steps[0].end_s)

    def forget_pose(self) -> None:
        """Discard the pose, after it was set or the robot was carried."""
        self._at_s = None
        self._steps.clear()
        self._begin()

    def compare(self, now_s: float, comparison: LinearReading) -> None:
        """Fuse a comparison between a sensor and the joints, which is independent of the pose."""
        if self._at_s is None and self._measured_s is not None:
            self._forget(now_s - self._measured_s)
        self._measured_s = now_s
        rows = np.hstack([comparison.rows, comparison.bias_jacobian])
        self._correct(rows, comparison.offset - rows @ self._state, comparison.covariance)

    def fuse_pose(self, pose: SE2, covariance: Array, mounting: Array, at_s: float) -> None:
        """Fuse a pose measured at `at_s`; `mounting` (3, m) is its Jacobian w.r.t. the biases.

        A pose that contradicts the biases restarts the filter at that pose, because the robot slid
        or was carried.
        """
        if self._at_s is not None:
            if at_s <= self._at_s:
                return
            self._carry(at_s)
            self._end_block()
            rows = np.hstack([np.eye(3), mounting])
            off = pose.xy_heading - rows @ self._state
            off[2] = wrap(off[2])
            expected = rows @ self._covariance @ rows.T + covariance
            if is_plausible(off, expected):
                self._correct(rows, off, covariance)
                self._begin()
                return
        self._begin_at(pose, PoseErrors(-mounting, covariance), at_s)

    def begin_pose(self, pose: SE2, errors: PoseErrors, at_s: float) -> None:
        """Begin with a pose that the estimate has, with its errors, unless there is one."""
        if self._at_s is None:
            self._begin_at(pose, errors, at_s)

    def fuse_readings(
        self, at_s: float, linearized: Callable[[SE2], Sequence[LinearReading]]
    ) -> None:
        """Fuse readings taken at `at_s`, linearized at the pose of this filter."""
        if self._at_s is None or at_s < self._at_s:
            return
        self._carry(at_s)
        self._end_block()
        for reading in linearized(SE2(self._state[:3].copy())):
            rows = np.hstack([reading.rows, reading.bias_jacobian])
            off = reading.offset - reading.bias_jacobian @ self.biases
            expected = rows @ self._covariance @ rows.T + reading.covariance
            if is_plausible(off, expected):
                self._correct(rows, off, reading.covariance)
        self._begin()

    def _begin_at(self, pose: SE2, errors: PoseErrors, at_s: float) -> None:
        while self._steps and self._steps[0].end_s <= at_s:
            self._steps.popleft()
        self._at_s = at_s
        by, prior = errors.bias_jacobian, self.covariance
        self._state[:3] = pose.xy_heading + by @ self.biases
        crossed = by @ prior
        self._covariance[:3, :3] = errors.noise_cov + crossed @ by.T
        self._covariance[:3, 3:], self._covariance[3:, :3] = crossed, crossed.T
        self._begin()

    def _correct(self, rows: Array, off: Array, noise: Array) -> None:
        """Kalman update, Joseph form."""
        innovation = rows @ self._covariance @ rows.T + noise
        gain = np.linalg.solve(innovation, rows @ self._covariance).T
        keep = np.eye(len(self._state)) - gain @ rows
        self._state = self._state + gain @ off
        self._covariance = keep @ self._covariance @ keep.T + gain @ noise @ gain.T

    def _forget(self, seconds: float) -> None:
        """Age the biases; their stationary distribution is the described one."""
        keep = math.exp(-seconds / _FORGET_S)
        self._state[3:] *= keep
        self._covariance[3:] *= keep
        self._covariance[:, 3:] *= keep
        self._covariance[3:, 3:] += (1.0 - keep * keep) * np.eye(len(self._state) - 3)

    def _begin(self) -> None:
        """Begin a block of steps with equal twist errors."""
        self._rate: Array = self._errors.bias_jacobian @ self.biases
        """(3,): correction of the twist."""
        self._block = PlanarBlock()
        self._heading, self._turned = float(self._state[2]), 0.0
        self._speed_s = self._turn_rate_s = 0.0

    def _carry(self, until_s: float) -> None:
        """Process the buffered steps until `until_s`."""
        at_s = self._at_s or 0.0
        while self._steps and at_s < until_s:
            step = self._steps[0]
            end_s = min(step.end_s, until_s)
            if step.errors is not self._errors:
                self._end_block()
                self._errors = step.errors
                self._begin()
            self._add(step.twist, end_s - at_s)
            at_s = end_s
            if end_s == step.end_s:
                self._steps.popleft()
        self._at_s = at_s

    def _add(self, twist: Array, dt_s: float) -> None:
        vx, vy, omega = (twist + self._rate).tolist()
        middle = self._heading + 0.5 * omega * dt_s
        direction = complex(math.cos(middle), math.sin(middle))
        self._block.add(dt_s * direction * complex(vx, vy), direction, middle, dt_s)
        self._speed_s += dt_s * math.hypot(vx, vy)
        self._turn_rate_s += dt_s * abs(omega)
        self._heading += omega * dt_s
        self._turned += omega * dt_s

    def _end_block(self) -> None:
        """Propagate state and covariance over the block."""
        block, dt_s = self._block, self._block.elapsed_s
        if dt_s == 0.0:
            return
        carry, by_twist = block.jacobians()
        self._state[:2] += block.displacement.real, block.displacement.imag
        self._state[2] += self._turned
        move = np.eye(len(self._state))
        move[:3, :3] = carry
        move[:3, 3:] = by_twist @ self._errors.bias_jacobian
        axes = block.axes()
        self._covariance = move @ self._covariance @ move.T
        self._covariance[:3, :3] += dt_s * axes @ self._errors.white_per_s @ axes.T
        own = CAUTION * np.array([self._speed_s, self._speed_s, self._turn_rate_s]) / dt_s
        self._covariance[:3, :3] += dt_s * np.diag(np.square(own))
        self._forget(dt_s)
        self._begin()
