"""Consistency of the measured joints: a chi-square test of the residual of forward kinematics.

More actuators than degrees of freedom leave a residual. Beyond its noise it means that one of them
does not do what its measurement says; the test names the actuator that explains most of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import gammaincinv  # pyright: ignore

from tsd_twin.estimation.wheel_odometry import JointNoise
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import Array
from tsd_twin.robots import JointErrors

FALSE_ALARM = 1e-4
"""False-alarm probability of a decision about a sound robot."""
_LEFT_OVER = 0.01
_NUDGE = 1e-5
"""Step of finite differences: radians, or a share of a speed."""
_LEAST_SIGMA = 1e-5
"""Minimum standard deviation, radians or rad/s, for joints described without noise."""
_NOTHING = 1e-4
"""m/s: directions of the residual below this are rounding, as with three wheels, which leave no
residual."""
_RANK = 1e-6
"""Rank tolerance: directions below this share of the largest singular value are dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class ParityTest:
    """Chi-square parity test at one joint vector."""

    whiten: Array
    """(d, m): whitening of a residual to d independent, standard normal numbers."""
    lines: Array
    """(n, d): unit vectors of the parity space for a fault of one joint each; or zero."""
    threshold: float
    """Threshold of the squared length of the parity vector; infinite for d = 0."""

    @staticmethod
    def at(
        kinematics: Kinematics[Any], joints: Array, sigma: Array, false_alarm: float = FALSE_ALARM
    ) -> ParityTest:
        """Return the test around `joints` (n,) with standard deviations `sigma` (n,).

        First-order error propagation through the forward kinematics, by differences.
        """
        steps = _NUDGE * np.maximum(1.0, np.abs(joints))
        nudged = np.concatenate([joints[None], joints + np.diag(steps)])
        residuals = kinematics.forward(nudged).residual
        slopes = (residuals[1:] - residuals[0]) / steps[:, None]
        _, sizes, directions = np.linalg.svd(slopes * np.maximum(1.0, np.abs(joints))[:, None])
        basis = directions[: int(np.count_nonzero(sizes > _RANK * max(sizes.max(), _NOTHING)))]
        if len(basis) == 0:
            return ParityTest(np.zeros((0, slopes.shape[1])), np.zeros((len(slopes), 0)), np.inf)
        noise = (np.maximum(sigma, _LEAST_SIGMA)[:, None] * slopes) @ basis.T
        covariance = noise.T @ noise
        root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
        whiten: Array = np.asarray(np.linalg.solve(root, basis), dtype=float)
        lines: Array = slopes @ whiten.T
        lengths: Array = np.sqrt(np.square(lines).sum(axis=1, keepdims=True))
        # The speed of an upright wheel is not observable: such a line would be rounding.
        lines = np.where(lengths > _RANK * lengths.max(), lines / np.maximum(lengths, 1e-300), 0.0)
        return ParityTest(whiten, lines, chi_square_bound(len(basis), false_alarm))

    @property
    def dimensions(self) -> int:
        """Dimension of the parity space."""
        return len(self.whiten)

    def statistic(self, residual: Array, samples: float = 1.0) -> Array:
        """Return the test statistic (...) for the mean of `samples` residuals.

        `residual` is (..., m); the noise of one sample is independent of that of the others.
        """
        white = residual @ self.whiten.T
        return samples * np.square(white).sum(axis=-1)

    def single_fault(self, residual: Array) -> tuple[Array, Any]:
        """Return the joint that alone explains most of residuals (..., m), and whether all of it.

        All means that the rest is within the 99th percentile of the noise.
        """
        white = residual @ self.whiten.T
        explained = np.square(white @ self.lines.T)
        left = np.square(white).sum(axis=-1) - explained.max(axis=-1)
        enough = left <= chi_square_bound(self.dimensions - 1, _LEFT_OVER)
        return explained.argmax(axis=-1), enough

    def exceeds_threshold(self, residual: Array, samples: float = 1.0) -> Any:
        """Return whether residuals (..., m) exceed the threshold, booleans (...)."""
        return self.statistic(residual, samples) > self.threshold


def chi_square_bound(dimensions: int, beyond: float) -> float:
    """Return the chi-square quantile that is exceeded with the probability `beyond`."""
    if dimensions <= 0:
        return 0.0
    return 2.0 * float(gammaincinv(0.5 * dimensions, 1.0 - beyond))


_SMOOTHING_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class ConsistencyResult:
    """Result of the consistency test."""

    residual_mps: float
    """Smoothed residual, root mean square over the contacts."""
    level: float
    """Chi-square of the residual over the threshold: above 1 it is more than noise explains."""
    shares: Array
    """(k,): share of the squared residual due to each actuator alone, 0 to 1."""
    suspect: int | None
    """The actuator suspected of a fault, when the residual exceeds the threshold."""

    @property
    def exceeds_threshold(self) -> bool:
        """Whether the residual is larger than the known noise explains."""
        return self.level > 1.0


class ConsistencyMonitor:
    """Monitor of the smoothed residual of forward kinematics against the known noise.

    Errors of joints persist: steps of a servo and a wrong spin do not average out. So smoothing
    removes short disturbances, and the threshold is nonetheless that of a single sample.

    The suspect is the actuator of the one joint that explains the whole residual, if there is one.
    Otherwise it is the actuator without which the others agree best. The second rule alone would
    not suffice: an error in the distance between two modules may be due to either.
    """

    def __init__(self, kinematics: Kinematics[Any], noise: JointErrors) -> None:
        self._kinematics = kinematics
        self._noise = JointNoise(kinematics, noise)
        self._owners = [_owner(joint.name, kinematics.actuators) for joint in kinematics.joints]
        self._residual: Array | None = None
        self._test: tuple[bytes, ParityTest] | None = None
        """Newest joints, and the test around them: joints that stay have the same one."""

    def advance(self, residual: Array, dt_s: float) -> None:
        """Update with the residual (m,) of one period."""
        if self._residual is None:
            self._residual = np.zeros(len(residual))
        share = 1.0 - math.exp(-dt_s / _SMOOTHING_S)
        self._residual = self._residual + share * (residual - self._residual)

    def judge(self, joints: Array) -> ConsistencyResult:
        """Return the result of the test for a robot whose joints are at `joints` (n,)."""
        residual = self._residual
        squared = 0.0 if residual is None else float(residual @ residual)
        if residual is None or squared == 0.0:
            return ConsistencyResult(0.0, 0.0, np.zeros(len(self._kinematics.actuators)), None)
        test = self._test_at(joints)
        level = float(test.statistic(residual)) / test.threshold
        shares = np.clip(self._kinematics.fault_contribution(residual) / squared, 0.0, 1.0)
        suspect = None
        if level > 1.0:
            joint, enough = test.single_fault(residual)
            suspect = self._owners[int(joint)] if enough else int(shares.argmax())
        return ConsistencyResult(math.sqrt(squared / len(residual)), level, shares, suspect)

    def _test_at(self, joints: Array) -> ParityTest:
        key = joints.tobytes()
        if self._test is None or self._test[0] != key:
            test = ParityTest.at(self._kinematics, joints, self._noise.sigma(joints))
            self._test = (key, test)
        return self._test[1]


def _owner(joint: str, actuators: tuple[str, ...]) -> int:
    """Return the actuator of a joint, whose name equals the joint's or is a prefix of it."""
    (owner,) = (
        i for i, name in enumerate(actuators) if joint == name or joint.startswith(name + "_")
    )
    return owner
