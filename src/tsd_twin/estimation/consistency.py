"""Consistency of the measured joints: a chi-square test of the residual of forward kinematics.

More actuators than degrees of freedom leave a residual. Beyond its noise it means that one of them
does not do what its measurement says; the test names the actuator that explains most of it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.estimation.joint_errors import JointNoise
from tsd_twin.kinematics import JointKind, Kinematics, TwistSolution
from tsd_twin.lie import Array
from tsd_twin.robots import JointCompliance, JointErrors

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


_YIELDS = (0.25, 0.5, 0.75, 1.0)
"""Shares of the reckoned force of a small slip: that of a large slip is less."""


@dataclass(frozen=True, slots=True, eq=False)
class ParitySpace:
    """Parity space at one joint vector: the residuals that errors of joints cause."""

    slopes: Array
    """(n, m): derivatives of the residual by the joints."""
    basis: Array
    """(d, m): orthonormal directions of the residual."""

    @staticmethod
    def at(kinematics: Kinematics[Any], joints: Array) -> ParitySpace:
        """Return the space at `joints` (n,): the forward kinematics to first order."""
        scale = np.maximum(1.0, np.abs(joints))
        steps = _NUDGE * scale
        nudged = np.empty((len(joints) + 1, len(joints)))
        nudged[:] = joints
        # The diagonal of the rows below the first, as one slice: each nudges a joint of its own.
        nudged.reshape(-1)[len(joints) :: len(joints) + 1] += steps
        residuals = kinematics.forward(nudged).residual
        slopes = (residuals[1:] - residuals[0]) / steps[:, None]
        _, sizes, directions = np.linalg.svd(slopes * scale[:, None], full_matrices=False)
        # The sizes fall.
        count = int(np.count_nonzero(sizes > _RANK * max(sizes[0], _NOTHING)))
        return ParitySpace(slopes, directions[:count])


@dataclass(frozen=True, slots=True, eq=False)
class ParityTest:
    """Chi-square parity test at one joint vector."""

    whiten: Array
    """(d, m): whitening of a residual to d independent, standard normal numbers."""
    threshold: float
    """Threshold of the squared length of the parity vector; infinite for d = 0."""
    slopes: Array
    """(n, m): derivatives of the residual by the joints."""

    @staticmethod
    def at(
        kinematics: Kinematics[Any],
        joints: Array,
        sigma: Array,
        false_alarm: float = FALSE_ALARM,
        *,
        common: Array | None = None,
    ) -> ParityTest:
        """Return the test around `joints` (n,) with standard deviations `sigma` (n,).

        `common` (n,) are deviations of all joints at once, by one standard normal number.
        """
        space = ParitySpace.at(kinematics, joints)
        return ParityTest.of(space, sigma, false_alarm, common=common)

    @staticmethod
    def of(
        space: ParitySpace,
        sigma: Array,
        false_alarm: float = FALSE_ALARM,
        *,
        common: Array | None = None,
    ) -> ParityTest:
        """Return the test in a parity space, as `at` does."""
        slopes, basis = space.slopes, space.basis
        if len(basis) == 0:
            return ParityTest(np.zeros((0, slopes.shape[1])), np.inf, slopes)
        noise = (np.maximum(sigma, _LEAST_SIGMA)[:, None] * slopes) @ basis.T
        covariance = noise.T @ noise
        if common is not None:
            together = common @ slopes @ basis.T
            covariance += together[:, None] * together
        root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
        whiten: Array = np.asarray(np.linalg.solve(root, basis), dtype=float)
        threshold = chi_square_bound(len(basis), false_alarm)
        return ParityTest(whiten, threshold, slopes)

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

    def single_fault(self, residual: Array, by_slip: Array | None = None) -> tuple[Array, Any]:
        """Return the joint that alone explains most of residuals (..., m), and whether all of it.

        All means that the rest is within the 99th percentile of the noise. `by_slip` (n, m) is by
        how much joints give way to a residual, if they do. A joint that explains all of it together
        with how others give way counts only where no joint alone does.
        """
        white = residual @ self.whiten.T
        squared = np.square(white).sum(axis=-1)
        most = chi_square_bound(self.dimensions - 1, _LEFT_OVER)
        # Unit vectors of the parity space, for a fault of one joint each; or zero.
        explained = np.square(white @ _unit_lines(self.slopes @ self.whiten.T).T)
        joint: Array = explained.argmax(axis=-1)
        enough: Any = squared - explained.max(axis=-1) <= most
        if by_slip is not None:
            each = [_unit_lines(slopes @ self.whiten.T) for slopes in self._yielding(by_slip)]
            explained = np.maximum.reduce([np.square(white @ lines.T) for lines in each])
            joint = np.where(enough, joint, explained.argmax(axis=-1))
            enough = enough | (squared - explained.max(axis=-1) <= most)
        return joint, enough

    def _yielding(self, by_slip: Array) -> list[Array]:
        """Return `slopes` where all joints give way to the residual, for each of `_YIELDS`.

        Each change of the residual moves the other joints, which changes the residual again.
        """
        again, eye = self.slopes.T @ by_slip, np.eye(len(by_slip.T))
        return [
            np.asarray(np.linalg.solve(eye - share * again, self.slopes.T), dtype=float).T
            for share in _YIELDS
        ]

    def exceeds_threshold(self, residual: Array, samples: float = 1.0) -> Any:
        """Return whether residuals (..., m) exceed the threshold, booleans (...)."""
        return self.statistic(residual, samples) > self.threshold


def _unit_lines(lines: Array) -> Array:
    """Return lines (n, d) of length one."""
    lengths: Array = np.sqrt(np.square(lines).sum(axis=1, keepdims=True))
    # The speed of an upright wheel is not observable: such a line would be rounding.
    return np.where(lengths > _RANK * lengths.max(), lines / np.maximum(lengths, 1e-300), 0.0)


@functools.cache
def chi_square_bound(dimensions: int, beyond: float) -> float:
    """Return the chi-square quantile that is exceeded with the probability `beyond`, below 0.3.

    To import scipy.special for it would take a third of the time in which a robot node starts.
    """
    if dimensions <= 0:
        return 0.0
    bound = float(dimensions)
    # Newton's method on the logarithm of the survival function, which is nearly a line.
    for _ in range(10):
        survival, density = _chi_square(bound, dimensions)
        bound += math.log(survival / beyond) * survival / density
    return bound


def _chi_square(x: float, dimensions: int) -> tuple[float, float]:
    """Return survival function and density of the chi-square distribution at `x`.

    With each two dimensions the survival function grows by twice the density.
    """
    odd = dimensions % 2
    densities = [
        0.5 * (0.5 * x) ** (0.5 * d - 1.0) * math.exp(-0.5 * x) / math.gamma(0.5 * d)
        for d in range(2 - odd, dimensions + 1, 2)
    ]
    first = math.erfc(math.sqrt(0.5 * x)) if odd else 2.0 * densities[0]
    return first + 2.0 * sum(densities[1:]), densities[-1]


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


_EDGE_SHARE = math.sqrt(3.0 / chi_square_bound(3, FALSE_ALARM))
"""Share of the dead band that counts as a standard deviation. Dead bands are no normal numbers, but
have an end: with this share, all joints of three modules at their ends reach the threshold, and no
more, on average over where the ends are."""
_LEAN_SHARE = 0.3
"""Standard deviation of how far a joint gives way, as a share of what is reckoned: loads are not
equal, and joints move within their play."""
_PLAY_SHARE = 1.0 / math.sqrt(12.0)
"""Standard deviation of a number that is anything between 0 and 1."""
_REMEMBERED_S = 0.2
"""Time constant with which motion and load are forgotten: what they did wears off."""
_SETTLED_S = 3.0
"""Time after which joints that stay the same change nothing any more."""


class ConsistencyMonitor:
    """Monitor of the smoothed residual of forward kinematics against what a sound robot causes.

    The residual is that of the joints alone, without the rolling of wheels by their turning
    gimbals: set-points are consistent without it. Errors of joints persist: steps of a servo and a
    wrong spin do not average out. So smoothing removes short disturbances, and the threshold is
    nonetheless that of a single sample. Joints of a robot that speeds up give way and trail: see
    `JointCompliance`. By how much together is not known, between not at all and as reckoned.

    The suspect is the actuator of the one joint that explains the whole residual, if there is one.
    Otherwise it is the actuator without which the others agree best. The second rule alone would
    not suffice: an error in the distance between two modules may be due to either.
    """

    def __init__(
        self,
        kinematics: Kinematics[Any],
        noise: JointErrors,
        compliance: JointCompliance | None = None,
    ) -> None:
        self._kinematics = kinematics
        self._noise = JointNoise(kinematics, noise)
        self._owners = [_owner(joint.name, kinematics.actuators) for joint in kinematics.joints]
        self._is_angle = np.array([j.kind is JointKind.POSITION for j in kinematics.joints])
        self._compliance = compliance
        if compliance is not None:
            self._play_share = _PLAY_SHARE * self._is_angle
            self._edge_rad = _EDGE_SHARE * compliance.dead_band_rad * self._is_angle
        self._joints, self._same_s = b"", 0.0
        self._latest: TwistSolution = TwistSolution(np.zeros(3), np.zeros(0))
        """Newest joints, for how long they have been the same, and their motion."""
        self._smooth: Array | None = None
        """(m + 3 + n,): smoothed residual, twist and joints."""
        self._lean: Array = np.zeros(len(self._is_angle))
        """(n,): deviation of joints that give way as reckoned, smoothed as the residual is."""
        self._largest: Array = np.zeros(2 * len(self._is_angle))
        """(2n,): largest sizes of late, of the lean and then of the rates of joints."""
        self._modelled: Array | None = None
        self._test: tuple[bytes, ParityTest] | None = None
        """Newest joints, and the test around them: joints that stay have the same one."""
        self._space: tuple[bytes, ParitySpace] | None = None

    def advance(self, joints: Array, dt_s: float, *, modelled: Array | None = None) -> None:
        """Update with joints (n,), `dt_s` after the last ones.

        `modelled` (n,) is true for speeds that a model supplies: they do not contradict each other.
        """
        self._modelled = modelled
        same = joints.tobytes()
        if same != self._joints:
            self._joints, self._latest = same, self._kinematics.forward(joints)
            self._same_s = 0.0
        elif self._same_s > _SETTLED_S:
            return
        self._same_s += dt_s
        # All in one array: for so few numbers, each call of numpy costs the same.
        newest = np.concatenate((self._latest.residual, self._latest.twist, joints))
        at = len(self._latest.residual)
        if self._smooth is None:
            self._smooth = newest.copy()
            self._smooth[:at] = 0.0
        share = 1.0 - math.exp(-dt_s / _SMOOTHING_S)
        self._smooth = smooth = self._smooth + share * (newest - self._smooth)
        if self._compliance is None:
            return
        # The derivative of what such a filter smooths is its input less its output, over its time.
        rates = (newest - smooth) / _SMOOTHING_S
        vx, vy, omega = smooth[at : at + 3].tolist()
        over_ground = rates[at : at + 3] + np.array([-omega * vy, omega * vx, 0.0])
        self._lean = self._compliance.by_acceleration @ over_ground
        sizes = np.abs(np.concatenate((self._lean, rates[at + 3 :])))
        kept = math.exp(-dt_s / _REMEMBERED_S)
        self._largest = np.maximum(sizes, kept * self._largest)

    def judge(self, joints: Array) -> ConsistencyResult:
        """Return the result of the test for a robot whose joints are at `joints` (n,)."""
        residual = None if self._smooth is None else self._smooth[: len(self._latest.residual)]
        squared = 0.0 if residual is None else float(residual @ residual)
        if residual is None or squared == 0.0:
            return ConsistencyResult(0.0, 0.0, np.zeros(len(self._kinematics.actuators)), None)
        test = self._test_at(joints)
        level = float(test.statistic(residual)) / test.threshold
        shares = self._kinematics.fault_contribution(residual) / squared
        shares = np.minimum(np.maximum(shares, 0.0), 1.0)
        suspect = None
        if level > 1.0:
            joint, enough = test.single_fault(residual, self._by_slip(joints))
            # Of actuators that explain it alike, the first, whatever the rounding.
            suspect = self._owners[int(joint)] if enough else int(shares.round(9).argmax())
        return ConsistencyResult(math.sqrt(squared / len(residual)), level, shares, suspect)

    def _test_at(self, joints: Array) -> ParityTest:
        key = joints.tobytes() + self._largest.tobytes()
        if self._test is None or self._test[0] != key:
            self._test = (key, self._made_test(joints))
        return self._test[1]

    def _space_at(self, joints: Array) -> ParitySpace:
        key = joints.tobytes()
        if self._space is None or self._space[0] != key:
            self._space = (key, ParitySpace.at(self._kinematics, joints))
        return self._space[1]

    def _made_test(self, joints: Array) -> ParityTest:
        sigma, compliance = self._noise.sigma(joints), self._compliance
        if self._modelled is not None:
            sigma = np.where(self._modelled, 0.0, sigma)
        if compliance is None:
            return ParityTest.of(self._space_at(joints), sigma)
        lean, rate = self._largest[: len(joints)], self._largest[len(joints) :]
        trail = np.minimum(compliance.lag_s * rate, compliance.play_rad)
        parts = (
            sigma,
            _LEAN_SHARE * lean,
            self._play_share * trail,
            self._edge_rad,
        )
        sigma = np.sqrt(np.square(parts).sum(axis=0))
        return ParityTest.of(self._space_at(joints), sigma, common=self._lean)

    def _by_slip(self, joints: Array) -> Array | None:
        """Return by how much joints (n, m) give way to a residual, if they do."""
        if self._compliance is None:
            return None
        return self._compliance.by_slip(float(np.abs(joints[~self._is_angle]).mean()))


def _owner(joint: str, actuators: tuple[str, ...]) -> int:
    """Return the actuator of a joint, whose name equals the joint's or is a prefix of it."""
    (owner,) = (
        i for i, name in enumerate(actuators) if joint == name or joint.startswith(name + "_")
    )
    return owner
